"""The workspace: where a machine can go at one orientation, and the largest box and sphere in
there.

The positions of a plane, a line or a volume are cut into cells by a grid. `use` tells how much of
its limits the machine uses at every node; `proved` which cells are inside all limits as a whole
(see `kinematics.analysis.containment`). The largest box and sphere are made of proved cells, so
what they promise holds at every point of theirs, and only their being the largest depends on the
grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.analysis.containment import (
    KINDS,
    Containment,
    contains,
    describe_worst,
    pose_rows,
    prove,
    uses,
)
from kinematics.analysis.margins import USE_ROUNDING
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.kind import HELD_TOLERANCE, refuse_uncontrolled
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import check_pose

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

MAX_CELLS = 1000
"""Along every side: of more, the nodes of the grid do not fit into memory."""


def largest_block(
    solid: np.ndarray, sides: Sequence[float], holding: tuple[int, int, int] | None = None
) -> tuple[tuple[int, int, int], tuple[int, int, int]] | None:
    """First and end cell of the largest block of a grid (a, b, c) that is all true; `holding` a
    cell, or any.

    For every width and depth, the places where a block of that base is true, then the longest run
    of them upwards.
    """
    best, found = 0.0, None
    wide_solid = solid
    for wide in range(1, solid.shape[0] + 1):
        wide_solid = solid if wide == 1 else wide_solid[:-1] & solid[wide - 1 :]
        base = wide_solid
        for deep in range(1, solid.shape[1] + 1):
            base = wide_solid if deep == 1 else base[:, :-1] & wide_solid[:, deep - 1 :]
            if not base.any():
                break
            start, length = _longest_runs(base, None if holding is None else holding[2])
            if holding is not None:  # only blocks that begin at the cell or before, and reach it
                reach = np.zeros(length.shape, bool)
                i, j = holding[:2]
                reach[max(0, i - wide + 1) : i + 1, max(0, j - deep + 1) : j + 1] = True
                length = np.where(reach, length, 0)
            i, j = (int(n) for n in np.unravel_index(int(np.argmax(length)), length.shape))
            size = wide * deep * int(length[i, j]) * float(np.prod(sides))
            if size > best:
                first = int(start[i, j])
                best, found = size, ((i, j, first), (i + wide, j + deep, first + int(length[i, j])))
    return found


def _longest_runs(solid: np.ndarray, through: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Start and length (a, b) of the longest run of true along the last axis, or of the one through
    an index.
    """
    number = np.arange(1, solid.shape[2] + 1)
    run = number - np.maximum.accumulate(np.where(solid, 0, number), 2)
    if through is None:
        last = run.argmax(2)
        length = np.take_along_axis(run, last[..., None], 2)[..., 0]
        return last + 1 - length, length
    broken = ~solid[:, :, through:]
    ahead = np.where(broken.any(2), broken.argmax(2), broken.shape[2])
    back = run[:, :, through]
    return through + 1 - back, np.where(back > 0, back + ahead - 1, 0)


# Halvings of a cell that its proof may take.
MAX_PROOF_HALVINGS = 4
# Points a side of the coarse grid that looks for the machine's reach, and how often that may
# double.
COARSE_POINTS, MAX_DOUBLINGS = 13, 12
Range = tuple[float, float] | float | None


@dataclass(frozen=True, slots=True)
class Box:
    """The positions low … high (3,), m, in the base frame."""

    low: Array
    high: Array

    @property
    def size(self) -> Array:
        return self.high - self.low


@dataclass(frozen=True, slots=True)
class Sphere:
    """Positions within `radius` of `centre` (3,), m, in the base frame; a disc where the workspace
    is a plane.
    """

    centre: Array
    radius: float


@dataclass(frozen=True)
class Workspace(Result):
    """nodes: three arrays of coordinates (m, base frame; one entry where a coordinate is held).

    uses    (nx, ny, nz, 4) share of travel, tilt, clearance and room that is used at each node
    proved  (nx − 1, ny − 1, nz − 1) bool: the whole cell is inside all limits (one cell where a
            coordinate is held)
    """

    machine: Machine
    rotation: Rotation
    nodes: tuple[Array, Array, Array]
    uses: Array = field(repr=False)
    proved: np.ndarray = field(repr=False)

    @property
    def reachable(self) -> np.ndarray:
        """(nx, ny, nz) bool: nodes inside all limits."""
        return np.asarray(self.uses.max(-1) <= 1 + USE_ROUNDING)

    def tables(self) -> tuple[Table, ...]:
        """What was looked at, how much of it is proved, and the largest box and sphere in there."""
        looked = (
            Column("coordinate", ["x", "y", "z"]),
            Column("from", [float(nodes[0]) for nodes in self.nodes], "m", "human"),
            Column("to", [float(nodes[-1]) for nodes in self.nodes], "m", "human"),
            Column("nodes", [len(nodes) for nodes in self.nodes]),
        )
        share = f"{100 * self.proved.mean():.4g} % of the cells are proved to be inside all limits"
        title = f"workspace of {self.machine.name}"
        if not self.proved.any():
            return (Table(title, looked, (share,)),)
        box, sphere = self.largest_box(), self.largest_sphere()
        best = (
            Column("coordinate", ["x", "y", "z"]),
            Column("from", box.low, "m", "human"),
            Column("to", box.high, "m", "human"),
            Column("centre of the sphere", sphere.centre, "m", "human"),
            Column("its radius", [sphere.radius] * 3, "m", "human"),
        )
        return Table(title, looked, (share,)), Table("largest box and sphere that are proved", best)

    def data(self) -> Table:
        """Every node: its position, the share of each limit that is used there, and whether it is
        inside all.
        """
        grid = np.stack(np.meshgrid(*self.nodes, indexing="ij"), -1).reshape(-1, 3)
        places = (Column(name, grid[:, k], "m") for k, name in enumerate("xyz"))
        uses = (Column(kind, self.uses[..., k].ravel()) for k, kind in enumerate(KINDS))
        inside = Column("inside", self.reachable.ravel())
        return Table(f"workspace of {self.machine.name}", (*places, *uses, inside))

    def largest_box(self, around: ArrayLike | None = None) -> Box:
        """The box of proved cells with the largest volume: anywhere, or with the position `around`
        (3,) m in it.

        Raises MotionError where there is none.
        """
        sides = [1.0 if self._is_held(k) else self.nodes[k][1] - self.nodes[k][0] for k in range(3)]
        found = largest_block(self.proved, sides, None if around is None else self._cell(around))
        if found is None:
            raise self._make_refusal("box", around)
        low, high = (freeze_array([self._edges(k)[end[k]] for k in range(3)]) for end in found)
        return Box(low, high)

    def largest_sphere(self, around: ArrayLike | None = None) -> Sphere:
        """The largest sphere of proved cells about a node or the middle between some, or about
        `around` (3,) m.

        Its radius is the distance to the nearest cell that is not proved, or to the end of the
        grid; a disc in a plane. Raises MotionError where there is none.
        """
        if around is None:
            points = [np.linspace(n[0], n[-1], 2 * len(n) - 1) for n in self.nodes]
        else:
            self._cell(around)
            points = [np.array([value], float) for value in np.asarray(around)]
        border = [(0, 0) if self._is_held(k) else (1, 1) for k in range(3)]
        square = np.where(np.pad(self.proved, border), np.inf, 0.0)
        for k in range(
            3
        ):  # the nearest over one coordinate after the other: squares of distances add up
            lines = np.moveaxis(square, k, -1)
            nearest = [(lines + gap**2).min(-1) for gap in self._gaps(k, points[k])]
            square = np.stack(nearest, k)
        best = np.unravel_index(int(np.argmax(square)), square.shape)
        if not square[best] > 0:
            raise self._make_refusal("sphere", around)
        return Sphere(
            freeze_array([points[k][best[k]] for k in range(3)]), float(np.sqrt(square[best]))
        )

    def contains(self, low: ArrayLike, high: ArrayLike) -> Containment:
        """Whether the machine can go everywhere in the box low … high (3,) m, on the grid or off
        it; if not, where.
        """
        return contains(self.machine, self.rotation, low, high)

    def _is_held(self, k: int) -> bool:
        return len(self.nodes[k]) == 1

    def _edges(self, k: int) -> Array:
        """Of the cells along a coordinate."""
        nodes: Array = self.nodes[k]
        return np.repeat(nodes, 2) if self._is_held(k) else nodes

    def _gaps(self, k: int, points: Array) -> Array:
        """(P, cells) m along a coordinate from points to cells, and to what is beyond either end of
        the grid.
        """
        if self._is_held(k):
            return np.zeros((len(points), 1))
        edges = np.concatenate([[-np.inf], self._edges(k), [np.inf]])
        gaps: Array = np.maximum(edges[:-1] - points[:, None], points[:, None] - edges[1:])
        return np.maximum(gaps, 0.0)

    def _cell(self, position: ArrayLike) -> tuple[int, int, int]:
        """The cell that a position lies in."""
        place = finite_array(position, f"workspace of {self.machine.name}: around", (3,), unit="m")
        for k, name in enumerate("xyz"):
            low, high = self.nodes[k][0], self.nodes[k][-1]
            if not low - HELD_TOLERANCE <= place[k] <= high + HELD_TOLERANCE:
                raise MotionError(
                    f"workspace of {self.machine.name}: {name} = {place[k] * 1e3:.6g} mm lies outside the grid, which "
                    f"has {low * 1e3:.6g} to {high * 1e3:.6g} mm; ask for a larger one"
                )
        x, y, z = (
            int(
                np.clip(
                    np.searchsorted(self.nodes[k], place[k], "right") - 1,
                    0,
                    self.proved.shape[k] - 1,
                )
            )
            for k in range(3)
        )
        return x, y, z

    def _make_refusal(self, what: str, around: ArrayLike | None) -> MotionError:
        where = "" if around is None else f" around {1e3 * np.asarray(around, float)} mm"
        return MotionError(
            f"workspace of {self.machine.name}: no {what}{where} is proved to be inside all limits; "
            "choose another orientation or position, or more cells"
        )


@check_arguments("machine")
def workspace(
    machine: MachineSource,
    *,
    x: Range = None,
    y: Range = None,
    z: Range = None,
    rotation: Rotation | None = None,
    cells: int = 32,
) -> Workspace:
    """Find the workspace at one orientation, under travel, tilt and clearance together.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    x, y, z
        (low, high) m in the base frame; one number: held there. None: as far as the machine reaches
        from home.
    rotation
        Of the platform in the base frame. None: home's.
    cells
        Of the grid along every side.

    Returns
    -------
    Workspace
        What is proved to be inside, and what is seen to be.

    Raises
    ------
    OutOfReach
        The machine does not control what is asked.
    MotionError
        A range is none.
    """
    machine = load_machine(machine)
    if not isinstance(cells, Integral) or isinstance(cells, bool) or not 1 <= cells <= MAX_CELLS:
        raise MotionError(
            f"workspace of {machine.name}: cells must be a whole number from 1 to {MAX_CELLS}, not {cells!r:.100}"
        )
    rotation = machine.home.rotation if rotation is None else rotation
    if not isinstance(rotation, Rotation):
        raise MotionError(
            f"workspace of {machine.name}: rotation must be SciPy's Rotation, not {rotation!r:.100}"
        )
    check_pose(
        machine.name,
        "the workspace's rotation",
        RigidTransform.from_rotation(rotation),
        single=True,
    )
    asked = [_range(machine, k, given) for k, given in enumerate((x, y, z))]
    ranges = (
        _find_ranges(machine, rotation, asked)
        if None in asked
        else [r for r in asked if r is not None]
    )
    counts = [cells if high > low else 0 for low, high in ranges]
    nodes: list[Array] = [
        freeze_array(np.linspace(*ends, n + 1)) for ends, n in zip(ranges, counts, strict=True)
    ]
    positions = _points(*nodes)
    refuse_uncontrolled(
        machine, pose_rows(positions, rotation), lambda k: f"position {positions[k] * 1e3} mm"
    )
    used = uses(machine, rotation, positions).reshape(*(len(n) for n in nodes), len(KINDS))
    low, high = (
        _points(*(n[: max(1, len(n) - 1)] for n in nodes)),
        _points(*(n[min(1, len(n) - 1) :] for n in nodes)),
    )
    inside = _cells_of(used.max(-1) <= 1 + USE_ROUNDING).ravel()
    inside[inside] = prove(machine, rotation, low[inside], high[inside], MAX_PROOF_HALVINGS)[0]
    proved = inside.reshape([max(1, count) for count in counts])
    proved.flags.writeable = False
    return Workspace(machine, rotation, (nodes[0], nodes[1], nodes[2]), freeze_array(used), proved)


def _range(machine: Machine, k: int, given: Range) -> tuple[float, float] | None:
    """Low and high of a coordinate; None where it is to be found out."""
    name = "xyz"[k]
    if given is None:
        home = float(machine.home.translation[k])
        return None if name in machine.freedom + machine.follows else (home, home)
    what = f"workspace of {machine.name}: {name}, held or from low to high,"
    low, high = np.broadcast_to(finite_array(given, what, (), (2,), unit="m"), 2).tolist()
    if low > high:
        raise MotionError(f"workspace of {machine.name}: {name} from {low} to {high} m is no range")
    return low, high


def _find_ranges(
    machine: Machine, rotation: Rotation, asked: Sequence[tuple[float, float] | None]
) -> list[tuple[float, float]]:
    """The ranges, with those not given grown from home until nothing inside is found on a face,
    then cut to fit.
    """
    home, size = machine.home.translation, machine.characteristic_length
    low = np.array([home[k] - size / 2 if r is None else r[0] for k, r in enumerate(asked)])
    high = np.array([home[k] + size / 2 if r is None else r[1] for k, r in enumerate(asked)])
    open_ = [k for k, r in enumerate(asked) if r is None]
    for _ in range(MAX_DOUBLINGS):
        nodes = [
            np.linspace(low[k], high[k], COARSE_POINTS if high[k] > low[k] else 1) for k in range(3)
        ]
        inside = (
            uses(machine, rotation, _points(*nodes)).max(1).reshape([len(n) for n in nodes])
            <= 1 + USE_ROUNDING
        )
        span, grown = high - low, False
        for k in open_:
            faces = np.moveaxis(inside, k, 0)
            low[k] -= span[k] / 2 * bool(faces[0].any())
            high[k] += span[k] / 2 * bool(faces[-1].any())
            grown |= bool(faces[0].any() or faces[-1].any())
        if not grown and not inside.any():
            raise MotionError(
                f"workspace of {machine.name}: nothing inside all limits near home at this orientation; at "
                f"{describe_worst(machine, rotation, home)}; give x, y and z, or another orientation"
            )
        if not grown:
            for k in open_:
                met = np.flatnonzero(np.moveaxis(inside, k, 0).reshape(COARSE_POINTS, -1).any(1))
                low[k], high[k] = nodes[k][met[0] - 1], nodes[k][met[-1] + 1]
            return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]
    raise MotionError(
        f"workspace of {machine.name}: no end found within {(high - low).max():.4g} m; "
        "give x, y and z, or give its axes a travel"
    )


def _points(*coordinates: Array) -> Array:
    """(N, 3) of a grid, the last coordinate first to change."""
    return np.stack(np.meshgrid(*coordinates, indexing="ij"), -1).reshape(-1, 3)


def _cells_of(nodes: np.ndarray) -> np.ndarray:
    """Which cells have all their nodes."""
    for k in range(3):
        if nodes.shape[k] > 1:
            lines = np.moveaxis(nodes, k, 0)
            nodes = np.moveaxis(lines[:-1] & lines[1:], 0, k)
    return nodes
