"""Blends: one motion begins while the one before it ends, within a tolerance of the path that they leave."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TypeVar

import casadi as ca
import numpy as np

from kinematics.array import Array, frozen
from planner.path.shape import Piece, Shape, turning

# Where the deviation may lie, as a share of the tolerance, and where the search aims: under 1 by more than what the
# sampling of the largest deviation can miss.
LOWEST, AIM, HIGHEST = 0.97, 0.985, 0.998
# Points of a blend that are looked at, and as often as ZOOMS says so many between the neighbours of the farthest.
POINTS, ZOOMS = 33, 2
# Newton steps to the nearest point of the unblended path, and the step (as a share of the reach) that is the last.
STEPS, LAST = 8, 1e-4
# Least speed along the path, as a share of what the neighbours have: a reversal comes to rest, and so close to one the
# blend's curvature has no use.
SLOWEST = 0.01
# Guesses of how far a blend reaches; four are usual.
GUESSES = 60


Numbers = TypeVar("Numbers", ca.SX, Array)


@dataclass(frozen=True, slots=True)
class Rounded:
    """A blend: how far it reaches (m), and by how much it leaves the unblended path, in position (m) and angle (rad).

    halves: its pieces, each a part of the segment whose place it takes and under that segment's caps
    """

    halves: tuple[Piece, Piece]
    reach: float
    deviation: float
    turned: float


@cache
def _shape(first: Shape, second: Shape) -> Shape:
    """p = A(a) + B(b) − J,  R = R_A(a) R_Jᵀ R_B(b): A's last length d and B's first, overlapping.

    J is the pose at the join, from which both are counted: over s from 0 to 2d, x = s/d − 1,

        a = −d (1 − x)⁴ (x² + 4x + 5)/32,   b = d (1 + x)⁴ (x² − 4x + 5)/32,   a + b = s − d.

    At the start a runs with s and b rests, at the end a rests and b runs, each with no second and third derivative:
    so the blend meets its neighbours with three continuous derivatives, whatever they are. Between lines it is the
    polynomial of degree 7 that does so.
    """
    return Shape(f"blend_{first.name}_{second.name}", 15 + first.size + second.size, partial(_motion, first, second))


def _motion(first: Shape, second: Shape, s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    reach, from_a, from_b, position, rows, of_a, of_b = ca.vertsplit(
        parameters, np.cumsum([0, 1, 1, 1, 3, 9, first.size, second.size]).tolist()
    )
    a, b = overlap(s, reach)
    p_a, r_a = first.motion(from_a + a, of_a)
    p_b, r_b = second.motion(from_b + b, of_b)
    return p_a + p_b - position, r_a @ ca.reshape(rows, 3, 3) @ r_b  # the rows, read as columns: R_Jᵀ


def overlap(s: Numbers, reach: Numbers | float) -> tuple[Numbers, Numbers]:
    """a(s) and b(s) of a blend, from the join."""
    x = s / reach - 1
    down, up = (1 - x) ** 2, (1 + x) ** 2
    return -reach / 32 * down * down * (x * x + 4 * x + 5), reach / 32 * up * up * (x * x - 4 * x + 5)


def rounded(a: Piece, b: Piece, most: float, tolerance: float, angle: float) -> Rounded | None:
    """The blend of the end of `a` and the start of `b` that uses the tolerances, or takes `most` (m) of each.

    Deviation: a pose of the blend is compared with the nearest of the unblended path (the two pieces), where an angle
    counts as tolerance/angle times so many metres; the larger of the two, each as a share of its tolerance, has to lie
    between LOWEST and HIGHEST. None where the motion all but reverses, in space (or in orientation, where one of the
    two only turns).
    """
    found: dict[float, tuple[float, float]] = {}

    def share(reach: float) -> float:
        found[reach] = _deviation(a, b, reach, tolerance / angle)
        return max(found[reach][0] / tolerance, found[reach][1] / angle)

    reach = _reach(share, most)
    whole = _overlapping(a, b, reach)
    if _slowest(whole, a, b, tolerance / angle) < SLOWEST:
        return None
    first, second = whole.cut(2)
    second = replace(b, shape=whole.shape, parameters=whole.parameters, length=reach, start=second.start)
    halves = (replace(first, turn=turning(first)), replace(second, turn=turning(second)))
    return Rounded(halves, reach, *found[reach])


def _reach(share: Callable[[float], float], most: float) -> float:
    """The length at which the share meets its aim, or `most`: secants of a share that grows like a power."""
    reach, used, power = most, share(most), 1.0
    low, high = 0.0, most
    for _ in range(GUESSES):
        if LOWEST <= used <= HIGHEST or (used < LOWEST and reach == most):
            break
        low, high = (reach, high) if used < AIM else (low, reach)
        guess = reach * (AIM / max(used, 1e-12)) ** (1 / power)
        if not low < guess < high:
            guess = (low + high) / 2
        before, reach = (reach, used), guess
        used = share(reach)
        slope = np.log(used / before[1]) / np.log(reach / before[0]) if used > 0 < before[1] else 1.0
        power = float(np.clip(slope, 0.5, 8.0))
    return reach


def _overlapping(a: Piece, b: Piece, reach: float) -> Piece:
    join = b.poses(np.array([b.start]))[0]
    numbers = np.concatenate([[reach, a.start + a.length, b.start], join, a.parameters, b.parameters])
    return replace(a, shape=_shape(a.shape, b.shape), parameters=frozen(numbers), length=2 * reach, start=0.0)


def _deviation(a: Piece, b: Piece, reach: float, weight: float) -> tuple[float, float]:
    """The largest deviations of the blend of some reach, in position (m) and angle (rad)."""
    piece = _overlapping(a, b, reach)
    low, high = 0.0, 2 * reach
    most = np.zeros(2)
    for _ in range(1 + ZOOMS):
        s = np.linspace(low, high, POINTS)
        x = piece.poses(s)
        on_a, on_b = overlap(s, reach)
        feet = [
            _off(x, a, a.start + a.length + on_a, weight, LAST * reach),
            _off(x, b, b.start + on_b, weight, LAST * reach),
        ]
        apart = [np.hypot(off[0], weight * off[1]) for off in feet]
        off = np.where(apart[0] < apart[1], feet[0], feet[1])
        most = np.maximum(most, off.max(1))
        top = int(np.argmax(np.maximum(off[0], weight * off[1])))
        low, high = s[max(top - 1, 0)], s[min(top + 1, POINTS - 1)]
    return float(most[0]), float(most[1])


def _off(x: Array, piece: Piece, s: Array, weight: float, last: float) -> Array:
    """(2, N) distance and angle from poses x (N, 12) to the nearest ones of a piece, by Newton from s (N,)."""
    size = np.concatenate([np.ones(3), np.full(9, weight / np.sqrt(2))])  # |ΔR|/√2 is the angle, while it is small
    for _ in range(STEPS):
        y, y1, y2, _ = piece.derivatives(s)
        away, along = (x - y) * size, y1 * size
        square = (along**2).sum(1)
        bend = square - (away * y2 * size).sum(1)
        step = (away * along).sum(1) / np.where(bend > square / 4, bend, square)
        before, s = s, np.clip(s + step, piece.start, piece.start + piece.length)
        if np.abs(s - before).max() <= last:
            break
    away = x - piece.poses(s)
    chord = np.linalg.norm(away[:, 3:], axis=1) / np.sqrt(8)
    return np.stack([np.linalg.norm(away[:, :3], axis=1), 2 * np.arcsin(np.minimum(chord, 1.0))])


def _slowest(piece: Piece, a: Piece, b: Piece, weight: float) -> float:
    """The least speed along a blend, as a share of its neighbours'; angles count where one of them only turns."""
    ends = [part.derivatives(np.array([s]))[1][0] for part, s in ((a, a.start + a.length), (b, b.start))]
    still = any(np.linalg.norm(end[:3]) < SLOWEST for end in ends)
    size = np.concatenate([np.ones(3), np.full(9, weight / np.sqrt(2) if still else 0.0)])
    slowest = np.linalg.norm(piece.derivatives(np.linspace(0.0, piece.length, POINTS))[1] * size, axis=1).min()
    return float(slowest / min(np.linalg.norm(end * size) for end in ends))
