"""The state of a motion at an instant, the rests next to it, and motions cut and joined."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis, directional_bounds
from planner.path.actuation import MachinePath
from planner.trajectory import Trajectory

# Share of a path's length up to which two of its places are the same.
SAME_PLACE = 1e-12
# Share of the largest ṡ up to which a motion rests at a knot: rounding of the solver.
REST_SHARE = 1e-12
# Share of the largest ṡ below which an instant may belong to a rest next to it.
RESTING_SHARE = 1e-6
# Share of a path's length that is too short for a motion of its own.
SHORT_DISTANCE = 1e-9
# m/s² or rad/s², against divisions by 0.
TINY = 1e-300
# Halvings that find the instant of a place inside a time piece to rounding.
HALVINGS = 60


@dataclass(frozen=True, slots=True)
class Instant:
    """The state of a motion at an instant.

    t     s
    knot  number of the time piece
    s     m along the path
    v     ṡ, m/s
    a     s̈, m/s²
    q     coordinates of the axes (n,)
    """

    t: float
    knot: int
    s: float
    v: float
    a: float
    q: Array


def look(motion: Trajectory, t: float) -> Instant:
    """Return the state at t (s); after the end of the motion, that of its end."""
    t = min(t, motion.duration)
    state = motion.at(t)
    knot = int(motion.locate(np.array([t]))[0])
    return Instant(
        t,
        knot,
        float(state.along[0]),
        float(state.sd[0]),
        float(state.sdd[0]),
        state.q[0],
    )


def find_passage(motion: Trajectory, place: float) -> Instant:
    """Find the instant at which the motion passes a place (m), or ends a rest there."""
    rounding = SAME_PLACE * float(motion.path.breaks[-1])
    k = int(np.searchsorted(motion.s, place + rounding, "right")) - 1
    k = max(k, 0)
    begin = float(motion.knots[k])
    s, v, a, j = (float(values[k]) for values in (motion.s, motion.v, motion.a, motion.j))

    low = begin
    high = float(motion.knots[k + 1])
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        h = middle - begin
        if s + h * (v + h * (a / 2 + h * j / 6)) < place:
            low = middle
        else:
            high = middle
    return replace(look(motion, low), s=place)


def find_longest(motion: Trajectory, axes: Sequence[Axis], edges: Array) -> Array:
    """Find the instants (s) with the longest stops: one or two between each two edges (N+1,) (s).

    The axes need at least T = max |q̇|/a for a stop, where a is the stated acceleration of an axis,
    or the largest sampled one if none is stated. The instants are those of the largest T and of the
    largest ṡ T. Of several equal ones the first counts.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        turns = -motion.a / motion.j
    inside = (turns > 0) & (turns < np.diff(motion.knots))
    peaks = (motion.knots[:-1] + turns)[inside]
    last_before_edges = np.nextafter(edges[1:], 0.0)
    times = np.unique(np.concatenate([edges[:-1], last_before_edges, motion.knots, peaks]))
    state = motion.at(np.minimum(times, motion.duration))

    stated = np.array([min(directional_bounds(axis.max_acceleration)) for axis in axes])
    sampled = np.abs(state.qdd).max(axis=0)
    hardest = np.where(np.isinf(stated), sampled, stated)
    need = (np.abs(state.qd) / np.maximum(hardest, TINY)).max(axis=1)
    need = np.where(times < motion.duration, need, 0.0)

    interval = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(edges) - 2)
    chosen = []
    for measure in (need, need * state.sd):
        order = np.lexsort((times, -measure, interval))
        first = np.searchsorted(interval[order], np.arange(len(edges) - 1))
        chosen.append(times[order[first]])
    return np.unique(chosen)


def find_rest(motion: Trajectory, now: Instant) -> Instant | None:
    """Find the beginning of the rest at an instant, or next to it; None where the motion moves."""
    if now.v > RESTING_SHARE * motion.v.max():
        return None
    slow = motion.v <= REST_SHARE * motion.v.max()
    resting = slow & (motion.a == 0) & (motion.j == 0)
    if resting[now.knot]:
        k = now.knot
    else:
        rests = np.flatnonzero(np.append(slow, True))
        k = int(rests[np.argmin(np.abs(motion.knots[rests] - now.t))])
    while k > 0 and resting[k - 1]:
        k -= 1
    return look(motion, float(motion.knots[k]))


def find_next_rest(motion: Trajectory, now: Instant) -> Instant:
    """Find the next rest after the time piece of an instant; without one, the end of the motion."""
    later = np.flatnonzero(motion.v[now.knot + 1 :] <= REST_SHARE * motion.v.max())
    if len(later) == 0:
        return look(motion, motion.duration)
    return look(motion, float(motion.knots[now.knot + 1 + int(later[0])]))


def find_near_rest(motion: Trajectory, now: Instant) -> Instant | None:
    """Find the next rest if the way to it is too short for a motion of its own."""
    rest = find_next_rest(motion, now)
    short = rest.s - now.s <= SHORT_DISTANCE * float(motion.path.breaks[-1])
    return rest if short else None


def find_rest_left(motion: Trajectory, now: Instant) -> float:
    """Return how long (s) the motion still rests from an instant on; 0 where it moves."""
    moves = np.flatnonzero(~motion.resting)
    later = moves[moves >= now.knot]
    after = int(later[0]) if len(later) else len(motion.s)
    return float(motion.knots[after] - now.t) if after > now.knot else 0.0


def cut_motion(motion: Trajectory, since: Instant, until: Instant) -> Trajectory:
    """Cut a motion at two instants; its time and its path length begin at 0."""
    # a time piece that begins at `until` has no part in it
    last = until.knot + (until.t > motion.knots[until.knot])
    knots = np.concatenate([[since.t], motion.knots[since.knot + 1 : last + 1]])
    knots[-1] = until.t
    inside = slice(since.knot + 1, last)
    s = np.append(since.s, motion.s[inside])
    v = np.append(since.v, motion.v[inside])
    a = np.append(since.a, motion.a[inside])
    pieces = slice(since.knot, last)
    return Trajectory(
        motion.path,
        knots - since.t,
        s - since.s,
        v,
        a,
        motion.j[pieces],
        motion.piece[pieces],
    )


def join_motions(path: MachinePath, before: Trajectory, after: Trajectory) -> Trajectory:
    """Join two motions along a path from whose start both count path lengths and pieces."""

    def join(name: str) -> Array:
        return np.concatenate([getattr(before, name), getattr(after, name)])

    knots = np.concatenate([before.knots, before.knots[-1] + after.knots[1:]])
    return Trajectory(path, knots, join("s"), join("v"), join("a"), join("j"), join("piece"))


def shift_motion(motion: Trajectory, distance: float, pieces: int) -> Trajectory:
    """Add a distance (m) to the path lengths of a motion, and a number to its path pieces."""
    return replace(motion, s=motion.s + distance, piece=np.maximum(motion.piece + pieces, 0))


def find_piece(path: MachinePath, place: float) -> int:
    """Return the number of the path piece at a place (m); where two meet, the later one."""
    return int(np.searchsorted(path.breaks, place, "right")) - 1
