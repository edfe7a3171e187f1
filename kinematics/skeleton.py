"""What of a machine can be drawn: straight bars and pivots, as expressions of pose and coordinates."""

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, frozen
from kinematics.expression import Expression
from kinematics.pose import symbols

if TYPE_CHECKING:
    from kinematics.machine import Machine

Sort = Literal["frame", "actuator", "link", "platform"]
"""What stands still, what changes its length, what an axis moves, and what carries the tool."""
Point = ca.SX | ca.DM
# Share of a ring's size below which its points have no other side.
FLAT = 1e-9


@dataclass(frozen=True, slots=True)
class Bar:
    """A straight part from start to end, (3,) in the base frame; axis: the name of the one that moves it, if any."""

    sort: Sort
    start: Point
    end: Point
    axis: str = ""


@dataclass(frozen=True, slots=True)
class Pivot:
    """A joint's centre, (3,) in the base frame; name: that of its tilt in `tilt_names`, or empty where it has none."""

    at: Point
    name: str = ""


@dataclass(frozen=True, slots=True)
class Skeleton:
    """The bars and pivots of a machine at a symbolic pose: what `Machine.skeleton` answers."""

    bars: tuple[Bar, ...] = ()
    pivots: tuple[Pivot, ...] = ()


@dataclass(frozen=True, slots=True)
class Placed:
    """A skeleton at N poses: start and end of every bar (N, bars, 2, 3) and centres (N, pivots, 3), m, base frame."""

    bars: Array
    pivots: Array


def place(machine: "Machine", x: Array, q: Array) -> Placed:
    """A machine's skeleton at pose numbers x (N, 12) and the coordinates q (N, n) that belong to them."""
    points = machine.skeleton_map(np.concatenate([x, q], 1)).reshape(len(x), -1, 3)
    ends = 2 * len(machine.parts.bars)
    return Placed(frozen(points[:, :ends].reshape(len(x), -1, 2, 3)), frozen(points[:, ends:]))


def skeleton_map(machine: "Machine") -> Expression:
    """x (12), q (n) -> all points of the skeleton, bars first, one after the other."""
    x, q = ca.SX.sym("x", 12), ca.SX.sym("q", len(machine.axes))
    parts = machine.skeleton(*machine.carried(*symbols(x), q), q)
    points = [end for bar in parts.bars for end in (bar.start, bar.end)] + [pivot.at for pivot in parts.pivots]
    return Expression("skeleton", ca.vertcat(x, q), ca.vertcat(*points) if points else ca.SX(0, 1))


def ring(points: ArrayLike) -> list[tuple[int, int]]:
    """Pairs of neighbours on the way round points (n, 3), as they lie about their middle in the plane nearest to them.

    Points on a line come in their order along it.
    """
    given = np.asarray(points, float)
    away = given - given.mean(0)
    _, size, plane = np.linalg.svd(away, full_matrices=False)
    across = away @ plane.T
    if len(given) < 3 or size[1] <= FLAT * size[0]:
        order = np.argsort(across[:, 0])
        return [(int(a), int(b)) for a, b in pairwise(order)]
    order = np.argsort(np.arctan2(across[:, 1], across[:, 0]))
    return [(int(a), int(b)) for a, b in zip(order, np.roll(order, -1), strict=True)]
