"""That a motion is one: nothing jumps, and it runs the whole path once, forwards, with the rests that this states.

Without that a motion could keep every limit by leaving out half of its path. What timing says of it is not believed:
all of this is of the motion's numbers and its path alone.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.path.actuation import ActuatorPath
from planner.path.polynomial import PolynomialPath
from planner.place import Place
from planner.trajectory import Trajectory

# A jump of q, q̇ (and q̈ under jerk limits) between two pieces up to this share of the largest value met is rounding.
MAX_JUMP = 1e-9
# Rounding of what all axes are computed from, as a share of the largest of them.
AXIS_ROUNDING = 1e-13
# Rounding of an instant, as a share of it: of a sum of durations, and of the difference of two instants.
INSTANT_ROUNDING = 8 * float(np.finfo(float).eps)
# Rounding of a value of the path or of its derivatives, as a share of the largest on a piece: Horner's scheme of degree
# 9 rounds 18 times, in terms a few times as large as what they leave (N. Higham, Accuracy and Stability, 2002, 5.1).
VALUE_ROUNDING = 64 * float(np.finfo(float).eps)
# Time pieces that are looked at together: what is looked at is far more than what is kept.
STATE_BATCH = 1 << 14


def find_jumps(trajectory: Trajectory, order: int) -> dict[str, Place]:
    """Each quantity that is not continuous between the pieces, or at an end not as stated, and where it jumps most.

    At an end ṡ and s̈ are what the path states, nothing if it states none: q̇ = q′ ṡ and q̈ = q′ s̈ + q″ ṡ² there. Whether
    it is the path's end is for `find_gaps` to say.
    """
    trajectory = _leave_out_instants(trajectory)
    path, count = trajectory.path, len(trajectory.s)
    before, final = np.zeros((2, 3, order, len(path.names)))
    derivatives = path.derivatives(path.breaks[[0, -1]], np.array([0, len(path.breaks) - 2]), 2)
    for side, n in ((before, 0), (final, 1)):
        (q, q1, q2), speed, push = (each[n] for each in derivatives), path.end_speeds[n], path.end_accelerations[n]
        side[0] = [q, q1 * speed, q1 * push + q2 * speed**2][:order]
    open_ = find_rounding(path)
    worst, at = np.full((order, len(path.names)), -np.inf), np.zeros((order, len(path.names)), int)
    least, largest = -worst, worst.copy()
    for first, stop in _batches(trajectory.piece):
        own = slice(first, stop)
        start, end = _derive_at_starts_and_ends(trajectory, own, order)
        if first == 0:
            before[0, 0] = start[0, 0]
        h, v, a, j = np.diff(trajectory.knots)[own], trajectory.v[own], trajectory.a[own], trajectory.j[own]
        motion = np.array([[v, a, j], [v + h * (a + h * j / 2), a + h * j, j]])
        blur = INSTANT_ROUNDING * trajectory.knots[own]
        look_for_jumps(start, end, motion, blur, trajectory.piece[own], open_, before, worst, at, least, largest, first)
    least, largest = np.minimum(least, before[0]), np.maximum(largest, before[0])  # where it ends is met too
    final[0, 0] = before[0, 0]
    _, goes, rounded = np.maximum(np.abs(before), np.abs(final))
    beyond = np.abs(final[0] - before[0]) - INSTANT_ROUNDING * trajectory.duration * goes - rounded
    at = np.where(beyond <= worst, at, count)
    worst = np.maximum(worst, beyond)
    # rounding is that of each axis' own values, and of what they were made from together
    scale = largest - least + 1e-6 * np.maximum(np.abs(least), np.abs(largest))
    beyond = worst - MAX_JUMP * scale - AXIS_ROUNDING * scale.max(1, keepdims=True)
    found: dict[str, Place] = {}
    for n, name in enumerate(("position jump", "speed jump", "acceleration jump")[:order]):
        axis = int(np.argmax(np.where(np.isnan(beyond[n]), np.inf, beyond[n])))
        if not beyond[n, axis] <= 0:
            found[name] = place_at(trajectory, float(trajectory.knots[at[n, axis]]), path.names[axis])
    return found


def find_rounding(path: ActuatorPath) -> Array:
    """(3, P, n) rounding of q, q′ and q″ that a path of polynomials has in its coefficients; none of other paths."""
    if isinstance(path, PolynomialPath):
        return path.rounding
    return np.zeros((3, len(path.breaks) - 1, len(path.names)))


def _batches(piece: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last, exclusive, of batches of STATE_BATCH time pieces or more: all on one path piece are in one."""
    ends, first = np.append(np.flatnonzero(np.diff(piece)) + 1, len(piece)), 0
    while first < len(piece):
        after = int(ends[np.searchsorted(ends, min(first + STATE_BATCH, len(piece)))])
        yield first, after
        first = after


@kernel
def look_for_jumps(
    start: Array,
    end: Array,
    motion: Array,
    blur: Array,
    piece: np.ndarray,
    open_: Array,
    before: Array,
    worst: Array,
    at: np.ndarray,
    least: Array,
    largest: Array,
    first: int,
) -> None:
    """What jumps most between time pieces one after the other, on from those before.

    start, end (order + 1, M, n)  q, q′, … where time pieces start and end; motion (2, 3, M): ṡ, s̈ and s⃛ there
    open_ (3, P, n)  rounding of q, q′ and q″ on each path piece, as far as its own numbers leave it open
    blur (M,)  of instants, in which a value goes on by its derivative; piece (M,) of path
    before (3, order, n)  q, q̇ (and q̈ at order 3) at the end of the last; their derivatives by time; what rounding of
                          q, q′ and q″, to a share of the largest on their path piece, makes of them: a motion near rest
                          at a place where q′ is all but nothing multiplies what rounding leaves of it by a large s̈
    worst, at (order, n)  the largest jump beyond these, and the knot, counted on from first; least, largest: of each
    """
    order, width = worst.shape
    rounding, state, rounded = np.zeros((3, width)), np.zeros(4), np.zeros(3)
    for k in range(len(piece)):
        if k == 0 or piece[k] != piece[k - 1]:
            for i in range(3):
                for c in range(width):
                    rounding[i, c] = open_[i, piece[k], c]
            last = k
            while last < len(piece) and piece[last] == piece[k]:
                for i in range(3):
                    for c in range(width):
                        rounding[i, c] = max(rounding[i, c], VALUE_ROUNDING * abs(start[i, last, c]))
                last += 1
        for side in range(2):
            values, v, a, j = end if side else start, motion[side, 0, k], motion[side, 1, k], motion[side, 2, k]
            for c in range(width):
                q1, q2 = values[1, k, c], values[2, k, c]
                state[0], state[1], state[2] = values[0, k, c], q1 * v, q1 * a + q2 * v * v
                if order == 3:
                    state[3] = q1 * j + 3 * q2 * v * a + values[3, k, c] * v * v * v
                rounded[0], rounded[1] = rounding[0, c], rounding[1, c] * abs(v)
                rounded[2] = rounding[1, c] * abs(a) + rounding[2, c] * v * v
                for n in range(order):
                    if side == 0:
                        goes = max(abs(before[1, n, c]), abs(state[n + 1]))
                        beyond = abs(state[n] - before[0, n, c]) - blur[k] * goes - max(before[2, n, c], rounded[n])
                        if not beyond <= worst[n, c]:
                            worst[n, c], at[n, c] = beyond if beyond == beyond else np.inf, first + k
                        least[n, c], largest[n, c] = min(least[n, c], state[n]), max(largest[n, c], state[n])
                    before[0, n, c], before[1, n, c], before[2, n, c] = state[n], state[n + 1], rounded[n]


def _derive_at_starts_and_ends(trajectory: Trajectory, own: slice, order: int) -> tuple[Array, Array]:
    """q, q′, q″ (and q‴ at order 3), (order + 1, M, n), where time pieces start, and where they end.

    A piece ends where the next one starts, but for rounding δ: where that is on the same piece of path, values there
    are those at the start, moved on by δ times the next derivative.
    """
    path, piece, s = trajectory.path, trajectory.piece[own], trajectory.s[own]
    at, last = np.stack(path.derivatives(s, piece, order)), piece_end_lengths(trajectory, own)
    ahead = last - np.append(s[1:], np.nan)
    near = (np.abs(ahead) <= INSTANT_ROUNDING * np.abs(last)) & (piece == np.append(piece[1:], -1))
    by = np.roll(at, -1, axis=1)
    by[:-1] += by[1:] * ahead[:, None]
    far = np.flatnonzero(~near)
    by[:, far] = path.derivatives(last[far], piece[far], order)
    return at, by


def find_gaps(trajectory: Trajectory) -> dict[str, Place]:
    """Where the motion leaves out, repeats or leaves the path, a rest on it or the order of time: the first such place.

    A place is left out where a time piece does not begin where the one before ends. That is rounding up to a share of
    the path, of all knots together.
    """
    knots = trajectory.knots
    disorder = np.append(knots[0] != 0, ~(np.isfinite(knots[1:]) & (np.diff(knots) >= 0)))
    if disorder.any():
        k = max(int(np.argmax(disorder)) - 1, 0)
        return {"time out of order": trajectory.path.place(float(trajectory.s[k]), int(trajectory.piece[k]))}
    trajectory = _leave_out_instants(trajectory)
    path, length = trajectory.path, float(trajectory.path.breaks[-1] - trajectory.path.breaks[0])
    h, v, a, j = np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j
    end = piece_end_lengths(trajectory)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where((j > 0) & (-a / j > 0) & (-a / j < h), v - a**2 / (2 * j), np.inf)  # least ṡ inside a piece
    last_speed = v + h * (a + h * j / 2)
    slowest = np.minimum(np.minimum(v, last_speed), turn)
    low, high = path.breaks[trajectory.piece], path.breaks[trajectory.piece + 1]
    blur = INSTANT_ROUNDING * trajectory.knots[1:]
    slack = MAX_JUMP * length + blur * np.abs(last_speed)
    gap = np.maximum(np.abs(np.append(trajectory.s[1:], end[-1]) - end) - blur * np.abs(last_speed), 0.0)
    wrong = {
        "start off the path's": (np.arange(len(h)) == 0) & ~(np.abs(trajectory.s - path.breaks[0]) <= slack),
        "end off the path's": (np.arange(len(h)) == len(h) - 1) & ~(np.abs(end - path.breaks[-1]) <= slack),
        "place left out": ~(np.cumsum(gap) <= MAX_JUMP * length),
        "motion backwards": ~(slowest >= -MAX_JUMP * np.abs(v).max() - blur * np.abs(a + h * j)),
        "place off its piece": ~((trajectory.s >= low - slack) & (end <= high + slack)),
        "piece out of turn": np.concatenate([[False], ~np.isin(np.diff(trajectory.piece), (0, 1))]),
        "dwell left out": _find_short_rests(trajectory),
        "constant speed left out": _find_lost_speeds(trajectory),
    }
    return {
        name: place_at(trajectory, float(trajectory.knots[int(np.argmax(where))]), "")
        for name, where in wrong.items()
        if where.any()
    }


def _leave_out_instants(trajectory: Trajectory) -> Trajectory:
    """The motion without time pieces of no length: what they say is of no instant."""
    lasting = np.diff(trajectory.knots) > 0
    if lasting.all() or not lasting.any():
        return trajectory
    knots = np.append(trajectory.knots[:-1][lasting], trajectory.knots[-1])
    return Trajectory(trajectory.path, knots, *(getattr(trajectory, name)[lasting] for name in ("s", *"vaj", "piece")))


def _find_short_rests(trajectory: Trajectory) -> np.ndarray:
    """(M,) the time pieces that begin, or the last that ends, where the path states a longer rest than there is."""
    path, short = trajectory.path, np.zeros(len(trajectory.s), bool)
    rests = np.flatnonzero((trajectory.v == 0) & (trajectory.a == 0) & (trajectory.j == 0))
    length = float(path.breaks[-1] - path.breaks[0])
    for stop in np.flatnonzero(path.dwells > 0):
        here = rests[np.abs(trajectory.s[rests] - path.breaks[stop]) <= MAX_JUMP * length]
        lasts = float((trajectory.knots[here + 1] - trajectory.knots[here]).sum())
        if not lasts >= path.dwells[stop] - INSTANT_ROUNDING * trajectory.duration:
            short[min(int(np.searchsorted(trajectory.s, path.breaks[stop])), len(short) - 1)] = True
    return short


def _find_lost_speeds(trajectory: Trajectory) -> np.ndarray:
    """(M,) the first time piece on each segment that asks for a constant speed and has it nowhere, or not in one go.

    How steady it is there is for `planner.certificate.constant_speed` to say.
    """
    path, lost = trajectory.path, np.zeros(len(trajectory.s), bool)
    asked = [path.constant(piece) for piece in range(len(path.breaks) - 1)]
    if not any(speed is not None for speed in asked):
        return lost
    starts = zip(path.breaks[:-1].tolist(), range(len(asked)), strict=True)
    places = [path.place(s, piece) for s, piece in starts]
    whose = [(speed, place.segment, place.repetition) for speed, place in zip(asked, places, strict=True)]
    group = np.cumsum([0, *(one != other for one, other in pairwise(whose))])[trajectory.piece]
    has = np.isfinite(trajectory.constant_speeds)
    for own in np.unique(group):
        pieces = np.flatnonzero(group == own)
        if asked[int(trajectory.piece[pieces[0]])] is not None:
            begins = np.diff(has[pieces].astype(int), prepend=0) == 1
            lost[pieces[0]] = np.count_nonzero(begins) != 1
    return lost


def piece_end_lengths(trajectory: Trajectory, own: slice = slice(None)) -> Array:
    """Path lengths (M,) at which the time pieces end."""
    h, v, a, j = (each[own] for each in (np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j))
    return np.asarray(trajectory.s[own] + h * (v + h * (a / 2 + h * j / 6)))


def place_at(trajectory: Trajectory, t: float, axis: str) -> Place:
    k = int(trajectory.locate(np.array([t]))[0])
    tau = min(max(t, 0.0), trajectory.duration) - trajectory.knots[k]
    s = trajectory.s[k] + tau * (trajectory.v[k] + tau * (trajectory.a[k] / 2 + tau * trajectory.j[k] / 6))
    return trajectory.path.place(float(s), int(trajectory.piece[k]), t, axis)
