"""Whether a motion is one: nothing jumps, and it runs the whole path once, forwards, between the speeds stated."""

import numpy as np

from kinematics.array import Array
from planner.place import Place
from planner.trajectory import Trajectory

# A jump of q, q̇ (and q̈ under jerk limits) between two pieces up to this share of the largest value met is rounding.
JUMP = 1e-9
# Rounding of what all axes are computed from, as a share of the largest of them.
ROUNDING = 1e-13
# Rounding of an instant, as a share of it: of a sum of durations, and of the difference of two instants.
INSTANT = 8 * float(np.finfo(float).eps)
# Rounding of a value of the path or of its derivatives, as a share of the largest on a piece.
EVALUATED = 8 * float(np.finfo(float).eps)
# States that are computed together: a state holds far more than what is kept of it.
STATES = 1 << 14


def jumps(trajectory: Trajectory, order: int) -> dict[str, Place]:
    """Each quantity that is not continuous between the pieces, or at an end not as stated, and where it jumps most.

    At an end ṡ is what the path states, rest if nothing, and s̈ is 0: q̇ = q′ ṡ and q̈ = q″ ṡ² there.
    """
    lengths = np.diff(trajectory.knots)
    start, end = _states(trajectory, order, np.zeros(len(lengths))), _states(trajectory, order, lengths)
    path = trajectory.path
    _, q1, q2 = path.derivatives(path.breaks[[0, -1]], np.array([0, len(path.breaks) - 2]), 2)
    stated = np.array(path.end_speeds)[:, None]
    asked = [np.stack([start[0][0], end[0][-1]]), q1 * stated, q2 * stated**2]
    found: dict[str, Place] = {}
    rounded = _rounded(trajectory)
    blur = INSTANT * trajectory.knots[:, None]
    for n, name in enumerate(("position jump", "speed jump", "acceleration jump")[:order]):
        begun, ended = start[n], end[n]
        before, after = asked[n][:1], asked[n][1:]
        gap = np.abs(np.concatenate([begun, after]) - np.concatenate([before, ended]))
        # rounding is that of each axis' own values, and of what they were made from together
        scale = np.ptp(begun, axis=0) + 1e-6 * np.abs(begun).max(0)
        # an instant is known to a share of itself, in which a value goes on by its derivative
        goes = np.abs(np.concatenate([start[n + 1], 0 * after])), np.abs(np.concatenate([0 * before, end[n + 1]]))
        beyond = gap - JUMP * scale - ROUNDING * scale.max() - blur * np.maximum(*goes) - rounded[n]
        if not beyond.max() <= 0:
            knot, axis = np.unravel_index(int(np.argmax(np.where(np.isnan(beyond), np.inf, beyond))), beyond.shape)
            found[name] = place_at(trajectory, float(trajectory.knots[knot]), trajectory.path.names[axis])
    return found


def _rounded(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """What rounding of q, q′ and q″, to a share of the largest on their piece, makes of q, q̇ and q̈: (M+1, n) each.

    A motion near rest at a place where q′ is all but nothing multiplies what rounding leaves of it by a large s̈.
    """
    path, pieces = trajectory.path, len(trajectory.path.breaks) - 1
    values = path.derivatives(trajectory.s, trajectory.piece, 2)
    largest = [np.zeros((pieces, value.shape[1])) for value in values]
    for most, value in zip(largest, values, strict=True):
        np.maximum.at(most, trajectory.piece, EVALUATED * np.abs(value))
    q, q1, q2 = (most[trajectory.piece] for most in largest)
    h, v, a, j = np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j
    found: list[Array] = []
    for speed, push in ((v, a), (v + h * (a + h * j / 2), a + h * j)):
        fast, hard = np.abs(speed)[:, None], np.abs(push)[:, None]
        found.append(np.stack([q, q1 * fast, q1 * hard + q2 * fast**2]))
    start, end = found
    both = np.concatenate([start, np.zeros_like(start[:, :1])], 1), np.concatenate([np.zeros_like(end[:, :1]), end], 1)
    one, two, three = np.maximum(*both)
    return one, two, three


def _states(trajectory: Trajectory, order: int, tau: Array) -> list[Array]:
    """q, q̇, q̈ (and q⃛ at order 3), each (M, n), tau (M,) after the start of every time piece."""
    parts = []
    for first in range(0, len(tau), STATES):
        k = np.arange(first, min(first + STATES, len(tau)))
        state = trajectory.within(k, tau[first : first + STATES], jerk=order == 3)
        parts.append((state.q, state.qd, state.qdd, *((state.qddd,) if order == 3 else ())))
    return [np.concatenate(each) for each in zip(*parts, strict=True)]


def gaps(trajectory: Trajectory) -> dict[str, Place]:
    """Where the motion leaves out, repeats or leaves the path: its first such place."""
    path, length = trajectory.path, float(trajectory.path.breaks[-1] - trajectory.path.breaks[0])
    h, v, a, j = np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j
    end = ends(trajectory)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where((j > 0) & (-a / j > 0) & (-a / j < h), v - a**2 / (2 * j), np.inf)  # least ṡ inside a piece
    slowest = np.minimum(np.minimum(v, v + h * (a + h * j / 2)), turn)
    low, high = path.breaks[trajectory.piece], path.breaks[trajectory.piece + 1]
    blur = INSTANT * trajectory.knots[1:]
    slack = JUMP * length + blur * np.abs(v + h * (a + h * j / 2))
    wrong = {
        "start off the path's": (np.arange(len(h)) == 0) & ~(np.abs(trajectory.s - path.breaks[0]) <= slack),
        "end off the path's": (np.arange(len(h)) == len(h) - 1) & ~(np.abs(end - path.breaks[-1]) <= slack),
        "motion backwards": ~(slowest >= -JUMP * np.abs(v).max() - blur * np.abs(a + h * j)),
        "place off its piece": ~((trajectory.s >= low - slack) & (end <= high + slack)),
        "piece out of turn": np.concatenate([[False], ~np.isin(np.diff(trajectory.piece), (0, 1))]),
    }
    return {
        name: place_at(trajectory, float(trajectory.knots[int(np.argmax(where))]), "")
        for name, where in wrong.items()
        if where.any()
    }


def ends(trajectory: Trajectory) -> Array:
    """Path lengths (M,) at which the time pieces end."""
    h, v, a, j = np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j
    return np.asarray(trajectory.s + h * (v + h * (a / 2 + h * j / 6)))


def place_at(trajectory: Trajectory, t: float, axis: str) -> Place:
    state = trajectory.at(t)
    return trajectory.path.place(float(state.along[0]), int(state.piece[0]), t, axis)
