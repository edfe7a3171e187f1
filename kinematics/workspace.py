"""The workspace: where a machine can go at one orientation, and the largest box and sphere in there.

The positions of a plane, a line or a volume are cut into cells by a grid. `use` tells how much of its limits the
machine uses at every node; `proved` which cells are inside all limits as a whole (see `kinematics.containment`). The
largest box and sphere are made of proved cells, so what they promise holds at every point of theirs, and only their
being the largest depends on the grid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Integral
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, finite, frozen
from kinematics.block import largest_block
from kinematics.containment import KINDS, Containment, contains, pose_rows, prove, told, uses
from kinematics.errors import MotionError
from kinematics.freedom import HELD, refuse
from kinematics.margins import ROUNDING
from kinematics.pose import checked
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kinematics.machine import Machine

# Halvings of a cell that its proof may take.
DEPTH = 4
# Points a side of the coarse grid that looks for the machine's reach, and how often that may double.
COARSE, DOUBLINGS = 13, 12
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
    """Positions within `radius` of `centre` (3,), m, in the base frame; a disc where the workspace is a plane."""

    centre: Array
    radius: float


@dataclass(frozen=True)
class Workspace(Result):
    """nodes: three arrays of coordinates (m, base frame; one entry where a coordinate is held).

    uses    (nx, ny, nz, 3) share of travel, tilt and clearance that is used at each node
    proved  (nx − 1, ny − 1, nz − 1) bool: the whole cell is inside all limits (one cell where a coordinate is held)
    """

    machine: Machine
    rotation: Rotation
    nodes: tuple[Array, Array, Array]
    uses: Array = field(repr=False)
    proved: np.ndarray = field(repr=False)

    @property
    def reachable(self) -> np.ndarray:
        """(nx, ny, nz) bool: nodes inside all limits."""
        return np.asarray(self.uses.max(-1) <= 1 + ROUNDING)

    @property
    def volume(self) -> float:
        """Of the proved cells: m³ (m² in a plane, m on a line). What the machine reaches is more."""
        sides = [n[1] - n[0] for n in self.nodes if len(n) > 1]
        return float(self.proved.sum() * np.prod(sides))

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
        """Every node: its position, the share of each limit that is used there, and whether it is inside all."""
        grid = np.stack(np.meshgrid(*self.nodes, indexing="ij"), -1).reshape(-1, 3)
        places = (Column(name, grid[:, k], "m") for k, name in enumerate("xyz"))
        uses = (Column(kind, self.uses[..., k].ravel()) for k, kind in enumerate(KINDS))
        inside = Column("inside", self.reachable.ravel())
        return Table(f"workspace of {self.machine.name}", (*places, *uses, inside))

    def largest_box(self, around: ArrayLike | None = None) -> Box:
        """The box of proved cells with the largest volume: anywhere, or with the position `around` (3,) m in it.

        Raises MotionError where there is none.
        """
        sides = [1.0 if self._held(k) else self.nodes[k][1] - self.nodes[k][0] for k in range(3)]
        found = largest_block(self.proved, sides, None if around is None else self._cell(around))
        if found is None:
            raise self._nothing("box", around)
        low, high = (frozen([self._edges(k)[end[k]] for k in range(3)]) for end in found)
        return Box(low, high)

    def largest_sphere(self, around: ArrayLike | None = None) -> Sphere:
        """The largest sphere of proved cells about a node or the middle between some, or about `around` (3,) m.

        Its radius is the distance to the nearest cell that is not proved, or to the end of the grid; a disc in a plane.
        Raises MotionError where there is none.
        """
        if around is None:
            points = [np.linspace(n[0], n[-1], 2 * len(n) - 1) for n in self.nodes]
        else:
            self._cell(around)
            points = [np.array([value], float) for value in np.asarray(around)]
        border = [(0, 0) if self._held(k) else (1, 1) for k in range(3)]
        square = np.where(np.pad(self.proved, border), np.inf, 0.0)
        for k in range(3):  # the nearest over one coordinate after the other: squares of distances add up
            lines = np.moveaxis(square, k, -1)
            nearest = [(lines + gap**2).min(-1) for gap in self._gaps(k, points[k])]
            square = np.stack(nearest, k)
        best = np.unravel_index(int(np.argmax(square)), square.shape)
        if not square[best] > 0:
            raise self._nothing("sphere", around)
        return Sphere(frozen([points[k][best[k]] for k in range(3)]), float(np.sqrt(square[best])))

    def contains(self, low: ArrayLike, high: ArrayLike) -> Containment:
        """Whether the machine can go everywhere in the box low … high (3,) m, on the grid or off it; if not, where."""
        return contains(self.machine, self.rotation, low, high)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The figure of a plane or of a volume: see `kinematics.plots`."""
        from kinematics.plots import reach

        return reach(self, ax)

    def _held(self, k: int) -> bool:
        return len(self.nodes[k]) == 1

    def _edges(self, k: int) -> Array:
        """Of the cells along a coordinate."""
        nodes: Array = self.nodes[k]
        return np.repeat(nodes, 2) if self._held(k) else nodes

    def _gaps(self, k: int, points: Array) -> Array:
        """(P, cells) m along a coordinate from points to cells, and to what is beyond either end of the grid."""
        if self._held(k):
            return np.zeros((len(points), 1))
        edges = np.concatenate([[-np.inf], self._edges(k), [np.inf]])
        gaps: Array = np.maximum(edges[:-1] - points[:, None], points[:, None] - edges[1:])
        return np.maximum(gaps, 0.0)

    def _cell(self, position: ArrayLike) -> tuple[int, int, int]:
        """The cell that a position lies in."""
        place = finite(position, f"workspace of {self.machine.name}: around", (3,), unit="m")
        for k, name in enumerate("xyz"):
            low, high = self.nodes[k][0], self.nodes[k][-1]
            if not low - HELD <= place[k] <= high + HELD:
                raise MotionError(
                    f"workspace of {self.machine.name}: {name} = {place[k] * 1e3:.6g} mm lies outside the grid, which "
                    f"has {low * 1e3:.6g} to {high * 1e3:.6g} mm; ask for a larger one"
                )
        x, y, z = (
            int(np.clip(np.searchsorted(self.nodes[k], place[k], "right") - 1, 0, self.proved.shape[k] - 1))
            for k in range(3)
        )
        return x, y, z

    def _nothing(self, what: str, around: ArrayLike | None) -> MotionError:
        where = "" if around is None else f" around {1e3 * np.asarray(around, float)} mm"
        return MotionError(
            f"workspace of {self.machine.name}: no {what}{where} is proved to be inside all limits; "
            "take another orientation or place, or more cells"
        )


def workspace(
    machine: Machine,
    *,
    x: Range = None,
    y: Range = None,
    z: Range = None,
    rotation: Rotation | None = None,
    cells: int = 32,
) -> Workspace:
    """Where the machine can go at one orientation (home's by default), under travel, tilt and clearance together.

    x, y, z  (low, high) m in the base frame; one number: held there; None: as far as the machine reaches from home
    cells    of the grid along every side

    Raises OutOfReach where the machine does not control what is asked, MotionError where a range is none.
    """
    if not isinstance(cells, Integral) or isinstance(cells, bool) or cells < 1:
        raise MotionError(
            f"workspace of {machine.name}: cells must be a whole number of at least 1, not {cells!r:.100}"
        )
    rotation = machine.home.rotation if rotation is None else rotation
    if not isinstance(rotation, Rotation):
        raise MotionError(f"workspace of {machine.name}: rotation must be SciPy's Rotation, not {rotation!r:.100}")
    checked(machine.name, "the workspace's rotation", RigidTransform.from_rotation(rotation), single=True)
    asked = [_range(machine, k, given) for k, given in enumerate((x, y, z))]
    ranges = _reach(machine, rotation, asked) if None in asked else [r for r in asked if r is not None]
    counts = [cells if high > low else 0 for low, high in ranges]
    nodes: list[Array] = [frozen(np.linspace(*ends, n + 1)) for ends, n in zip(ranges, counts, strict=True)]
    positions = _points(*nodes)
    refuse(machine, pose_rows(positions, rotation), lambda k: f"position {positions[k] * 1e3} mm")
    used = uses(machine, rotation, positions).reshape(*(len(n) for n in nodes), len(KINDS))
    low, high = _points(*(n[: max(1, len(n) - 1)] for n in nodes)), _points(*(n[min(1, len(n) - 1) :] for n in nodes))
    inside = _cells_of(used.max(-1) <= 1 + ROUNDING).ravel()
    inside[inside] = prove(machine, rotation, low[inside], high[inside], DEPTH)[0]
    proved = inside.reshape([max(1, count) for count in counts])
    proved.flags.writeable = False
    return Workspace(machine, rotation, (nodes[0], nodes[1], nodes[2]), frozen(used), proved)


def _range(machine: Machine, k: int, given: Range) -> tuple[float, float] | None:
    """Low and high of a coordinate; None where it is to be found out."""
    name = "xyz"[k]
    if given is None:
        home = float(machine.home.translation[k])
        return None if name in machine.freedom + machine.follows else (home, home)
    what = f"workspace of {machine.name}: {name}, held or from low to high,"
    low, high = np.broadcast_to(finite(given, what, (), (2,), unit="m"), 2).tolist()
    if low > high:
        raise MotionError(f"workspace of {machine.name}: {name} from {low} to {high} m is no range")
    return low, high


def _reach(
    machine: Machine, rotation: Rotation, asked: Sequence[tuple[float, float] | None]
) -> list[tuple[float, float]]:
    """The ranges, with those not given grown from home until nothing inside is found on a face, then cut to fit."""
    home, size = machine.home.translation, machine.characteristic_length
    low = np.array([home[k] - size / 2 if r is None else r[0] for k, r in enumerate(asked)])
    high = np.array([home[k] + size / 2 if r is None else r[1] for k, r in enumerate(asked)])
    open_ = [k for k, r in enumerate(asked) if r is None]
    for _ in range(DOUBLINGS):
        nodes = [np.linspace(low[k], high[k], COARSE if high[k] > low[k] else 1) for k in range(3)]
        inside = uses(machine, rotation, _points(*nodes)).max(1).reshape([len(n) for n in nodes]) <= 1 + ROUNDING
        span, grown = high - low, False
        for k in open_:
            faces = np.moveaxis(inside, k, 0)
            low[k] -= span[k] / 2 * bool(faces[0].any())
            high[k] += span[k] / 2 * bool(faces[-1].any())
            grown |= bool(faces[0].any() or faces[-1].any())
        if not grown and not inside.any():
            raise MotionError(
                f"workspace of {machine.name}: nothing inside all limits near home at this orientation; at "
                f"{told(machine, rotation, home)}; give x, y and z, or another orientation"
            )
        if not grown:
            for k in open_:
                met = np.flatnonzero(np.moveaxis(inside, k, 0).reshape(COARSE, -1).any(1))
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
