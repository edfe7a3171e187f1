"""What a kind of machine states: its inverse map as one expression, and what else only it knows.

That is which of a pose's six components it controls (poses that need another are refused), and what
can be drawn of it: straight bars and pivots.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import TYPE_CHECKING, ClassVar, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import BadValue, NotFree
from kinematics.foundation.rotations import find_vectors
from kinematics.machine.axis import Axis
from kinematics.machine.load import STANDARD_GRAVITY, Body, Load
from kinematics.machine.pose import COMPONENTS, column

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

Sort = Literal["frame", "actuator", "link", "platform"]
"""What stands still, what changes its length, what an axis moves, and what carries the tool."""
Point = ca.SX | ca.DM
# Share of a ring's size below which its points have no other side.
FLATNESS_SHARE = 1e-9


@dataclass(frozen=True, slots=True)
class Bar:
    """A straight part from start to end, (3,) in the base frame; axis: the name of the one that
    moves it, if any.
    """

    sort: Sort
    start: Point
    end: Point
    axis: str = ""


@dataclass(frozen=True, slots=True)
class Pivot:
    """A joint's centre, (3,) in the base frame; name: that of its tilt in `tilt_names`, or empty
    where it has none.
    """

    at: Point
    name: str = ""


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The bars and pivots of a machine at a symbolic pose: what `Machine.skeleton` answers."""

    bars: tuple[Bar, ...] = ()
    pivots: tuple[Pivot, ...] = ()


@dataclass(frozen=True, slots=True)
class PlacedSkeleton:
    """A skeleton at N poses: start and end of every bar (N, bars, 2, 3) and centres (N, pivots, 3),
    m, base frame.
    """

    bars: Array
    pivots: Array


def ring(points: ArrayLike) -> list[tuple[int, int]]:
    """Pairs of neighbours on the way round points (n, 3), as they lie about their middle in the
    plane nearest to them.

    Points on a line come in their order along it.
    """
    given = np.asarray(points, float)
    away = given - given.mean(0)
    _, size, plane = np.linalg.svd(away, full_matrices=False)
    across = away @ plane.T
    if len(given) < 3 or size[1] <= FLATNESS_SHARE * size[0]:
        order = np.argsort(across[:, 0])
        return [(int(a), int(b)) for a, b in pairwise(order)]
    order = np.argsort(np.arctan2(across[:, 1], across[:, 0]))
    return [(int(a), int(b)) for a, b in zip(order, np.roll(order, -1), strict=True)]


def side(x: ca.SX) -> ca.SX:
    """1 or −1, never 0: the sign by which `near` chooses."""
    return ca.sign(2 * ca.sign(x) + 1)


class Kind(ABC):
    """What `kinematics.machine.machine.Machine` asks of its kind.

    It states its map from pose to actuator coordinates once, symbolically, in `expression`; numeric
    evaluation, Jacobian, path derivatives, guaranteed enclosures and optimisation all come from
    that.

    freedom   which of x y z rx ry rz it controls, as many as it has axes
    follows   which go along with them: ignored by the inverse map, filled in by `forward`; all
              others are held at home
    branched  whether a pose has several coordinates (turns, elbows), among which `near` chooses
    lengths   whether coordinates are distances: none is below 0, and not all belong to a pose
    sorts     "linear" or "rotary" of each axis; empty: whichever it is
    """

    name: str
    axes: tuple[Axis, ...]
    home: Pose
    home_numbers: Array
    """(1, 12) position and rotation rows of home."""
    freedom: tuple[str, ...] = COMPONENTS
    follows: tuple[str, ...] = ()
    branched: bool = False
    lengths: ClassVar[bool] = False
    sorts: tuple[str, ...] = ()
    legs: ClassVar[int] = 0
    characteristic_length: float
    """m that count as one radian where lengths and angles meet, as in the path parameter of a pure
    turn.
    """

    load: Load
    """What it carries: its platform's masses, tool and wrench."""

    @property
    def vertical(self) -> Array:
        """(3,) unit vector that points up, in the base frame: z unless the kind says otherwise."""
        return freeze_array([0.0, 0.0, 1.0])

    @property
    def gravity(self) -> Array:
        """(3,) m/s² in the base frame: as the load states it, else down the vertical."""
        stated = self.load.gravity
        return freeze_array(0.0 - STANDARD_GRAVITY * self.vertical) if stated is None else stated

    @abstractmethod
    def expression(self, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
        """Actuator coordinates (n,) at position (3) and rotation (3, 3) of the platform frame in
        the base frame.

        near (n,) chooses where `branched`; others ignore it.
        """

    def fill_pose(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The pose with what `follows` filled in from the coordinates."""
        return position, rotation

    def alternatives(self, near: Array) -> list[Array]:
        """Coordinates near which a pose's are looked for, in turn, where there are none near
        (n,).
        """
        return []

    def tilts(self, position: ca.SX, rotation: ca.SX) -> ca.SX:
        """Cosine of each joint's angle from its rest axis (m,); none by default."""
        return ca.SX(0, 1)

    tilt_names: tuple[str, ...] = ()
    max_tilt: Array = freeze_array([])
    """(m,) rad, one per joint of `tilts`."""

    room: Sequence[tuple[float, float]] = ((-inf, inf),) * 3
    """m from which to which x, y and z of the platform's origin may be, in the base frame."""

    bodies: Bodies | None = None
    """What takes up room, so that its clearance can be measured; nothing by default."""

    def moving_bodies(
        self, position: ca.SX, rotation: ca.SX, q: ca.SX
    ) -> tuple[tuple[Body, ca.SX], ...]:
        """The bodies that move, the platform first, each with the twelve numbers of its frame.

        The pose has what follows filled in; q belongs to it.
        """
        return ((self.load.platform, column(*self.fill_pose(position, rotation, q))),)

    def skeleton(self, position: ca.SX, rotation: ca.SX, q: ca.SX) -> Skeleton:
        """Bars and pivots to draw, at a pose with what follows filled in and the coordinates that
        belong to it.

        Nothing by default: the machine is then drawn by the axes of its tool alone.
        """
        return Skeleton()


def check_room(name: str, room: ArrayLike) -> Sequence[tuple[float, float]]:
    """Rows from, to: both finite, or both infinite."""
    rows = np.asarray(room, float)
    good = rows.shape == (3, 2) and not np.isnan(rows).any() and (rows[:, 0] < rows[:, 1]).all()
    if not good or (np.isfinite(rows[:, 0]) != np.isfinite(rows[:, 1])).any():
        told = f"machine {name}: room {rows.tolist()!s:.80}: give from and to of x, y and z in m, the smaller first"
        raise BadValue(f"{told}; (-inf, inf) where there is no wall", key=("room",))
    return [(float(low), float(high)) for low, high in rows]


# m or rad off home up to which a held component counts as kept: the rounding of poses put together
# from rotations.
HELD_TOLERANCE = 1e-9


def columns(machine: Kind) -> np.ndarray:
    """Indices of the components that the machine controls: the columns of its Jacobian that
    count.
    """
    return np.array([COMPONENTS.index(name) for name in machine.freedom])


def spin_follows(machine: Kind) -> bool:
    """Return whether rx and ry are controlled and rz follows: a tool whose direction counts and
    whose spin does not.
    """
    return {"rx", "ry"} <= set(machine.freedom) and "rz" in machine.follows


def controlled_twists(machine: Kind, x: Array) -> Array:
    """Return the unit twists (N, 6, n) [v, ω] that the machine controls, in the base frame.

    They are along and about the base axes. Where the tool's spin follows, turns are about the
    tool's x and y axes instead, because no turn about an axis moves a tool that lies along it. x
    (N, 12): pose numbers.
    """
    twists = np.zeros((len(x), 6, len(machine.freedom)))
    free = columns(machine)
    twists[:, free, np.arange(len(free))] = 1.0
    if spin_follows(machine):
        rotation = x[:, 3:].reshape(-1, 3, 3)
        for axis, component in ((0, 3), (1, 4)):
            twists[:, 3:, free == component] = rotation[:, :, axis, None]
    return twists


def controlled_twist_symbols(machine: Kind, rotation: ca.SX) -> ca.SX:
    """Return the unit twists (6, n) that the machine controls, as symbols at a rotation (3, 3)."""
    free = columns(machine).tolist()
    twists = ca.SX(6, len(free))
    for k, component in enumerate(free):
        if spin_follows(machine) and component in (3, 4):
            twists[3:, k] = rotation[:, component - 3]
        else:
            twists[component, k] = 1
    return twists


def deviations(machine: Kind, x: Array) -> Array:
    """(N, 6) of pose numbers x (N, 12) from home: position, and the vector of the turn, in the base
    frame.
    """
    home = machine.home_numbers
    turn = x[:, 3:].reshape(-1, 3, 3) @ home[0, 3:].reshape(3, 3).T
    return np.concatenate([x[:, :3] - home[:, :3], find_vectors(turn)], 1)


def refuse_uncontrolled(
    machine: Kind, x: Array, name_of: Callable[[int], str] = "pose {}".format
) -> None:
    """Raise NotFree, naming the component, for the first of N poses that leaves the machine's
    freedom.
    """
    held = [k for k, name in enumerate(COMPONENTS) if name not in machine.freedom + machine.follows]
    if not held or not len(x):
        return
    off = deviations(machine, x)[:, held]
    wrong = np.abs(off) > HELD_TOLERANCE
    if wrong.any():
        pose = int(np.argmax(wrong.any(1)))
        size = np.where(np.array(held) < 3, 1 / machine.characteristic_length, 1.0)
        entry = int(
            np.argmax(np.abs(off[pose]) * size)
        )  # what is furthest off, at the machine's size
        name = COMPONENTS[held[entry]]
        value = (
            f"{off[pose, entry] * 1e3:.6g} mm"
            if held[entry] < 3
            else f"{np.rad2deg(off[pose, entry]):.6g} deg"
        )
        raise NotFree(
            f"machine {machine.name} holds {name}: {name_of(pose)} has {name} {value} off home; "
            f"it moves {', '.join(machine.freedom)} only; leave {name} as it is at home",
            pose,
        )


def describe_pose(x: Array, k: int) -> str:
    """Pose k of some (N, 12), as messages name it: by its number, where there are more, and its
    position.
    """
    number = f"pose {k}" if len(x) > 1 else "the pose"
    return f"{number}, position {', '.join(f'{each + 0.0:.6g}' for each in x[k, :3] * 1e3)} mm"
