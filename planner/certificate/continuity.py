"""Continuity and completeness: no jumps, and the motion runs the whole path once, forwards.

Without that a motion could respect every limit by leaving out half of its path. Only the motion's
coefficients and its path are used, none of the timing's claims.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.cells import find_sequences
from planner.path.actuation import ActuatorPath, has_constant_speed
from planner.path.polynomial import PolynomialPath
from planner.place import Place
from planner.trajectory import Trajectory

# Largest jump of q, q̇ (and q̈ under jerk limits) that is rounding, as a share of the range of its
# values.
MAX_JUMP = 1e-9
# Rounding of the common origin of all axes, as a share of the largest range.
AXIS_ROUNDING = 1e-13
# Rounding of an instant, as a share of it: a sum of durations, and a difference of two instants.
INSTANT_ROUNDING = 8 * float(np.finfo(float).eps)
# Rounding of q, q′ or q″, as a share of the largest on a path piece: Horner's scheme of degree 9
# rounds 18 times, in terms a few times as large as their sum (N. Higham, Accuracy and Stability,
# 2002, 5.1).
VALUE_ROUNDING = 64 * float(np.finfo(float).eps)
# Time pieces evaluated together, which bounds the memory.
STATE_BATCH = 1 << 14
# Quantities that have to be continuous; the third one at order 3.
QUANTITIES = ("position jump", "speed jump", "acceleration jump")


@np.errstate(invalid="ignore", over="ignore")  # an undefined jump counts as infinite
def find_jumps(trajectory: Trajectory, order: int) -> dict[str, Place]:
    """Return each quantity that is not continuous, or at an end not as stated.

    The place is that of the largest jump. At an end ṡ and s̈ are as the path states, 0 if it states
    none: q̇ = q′ ṡ and q̈ = q′ s̈ + q″ ṡ². Whether the motion ends at the path's end is checked by
    `find_gaps`.
    """
    trajectory = _leave_out_instants(trajectory)
    names = trajectory.path.names
    shape = order, len(names)
    worst = np.full(shape, -np.inf)
    largest = np.full(shape, -np.inf)
    least = np.full(shape, np.inf)
    at = np.zeros(shape, int)
    first = 0
    for before, after in _pair_states(trajectory, order):
        for values in (before[:order], after[:order]):
            least = np.fmin(least, np.fmin.reduce(values, axis=1))
            largest = np.fmax(largest, np.fmax.reduce(values, axis=1))
        stop = first + after.shape[1]
        blur = INSTANT_ROUNDING * trajectory.knots[first:stop]
        jumps = _measure_jumps(before, after, blur)
        most = jumps.max(1)
        at = np.where(most > worst, first + jumps.argmax(1), at)
        worst = np.maximum(worst, most)
        first = stop
    size = np.maximum(np.abs(least), np.abs(largest))
    scale = largest - least + 1e-6 * size
    beyond = worst - MAX_JUMP * scale - AXIS_ROUNDING * scale.max(1, keepdims=True)
    places: dict[str, Place] = {}
    for name, excess, knots in zip(QUANTITIES, beyond, at, strict=False):
        axis = int(np.argmax(excess))
        if not excess[axis] <= 0:
            instant = float(trajectory.knots[knots[axis]])
            places[name] = place_at(trajectory, instant, names[axis])
    return places


def _pair_states(
    trajectory: Trajectory,
    order: int,
) -> Iterator[tuple[Array, Array]]:
    """Yield the states before and after consecutive knots, each (2 order+1, N, n), in batches.

    The path states the first and the last one for its ends.
    """
    previous, final = _states_at_ends(trajectory.path, order)
    for first, stop in _batches(trajectory.piece):
        after, end = _states_of_pieces(trajectory, slice(first, stop), order)
        if first == 0:
            previous[0] = after[0, 0]
        before = np.concatenate([previous[:, None], end], 1)
        if stop == len(trajectory.s):
            final[0] = end[0, -1]
            after = np.concatenate([after, final[:, None]], 1)
        yield before[:, : after.shape[1]], after
        previous = end[:, -1]


def _states_at_ends(path: ActuatorPath, order: int) -> tuple[Array, Array]:
    """Return the states (2 order+1, n) that the path states for its ends, with no rounding."""
    states = np.zeros((2, 2 * order + 1, len(path.names)))
    pieces = np.array([0, len(path.breaks) - 2])
    q, q1, q2 = path.derivatives(path.breaks[[0, -1]], pieces, 2)
    v = np.array(path.end_speeds)[:, None]
    a = np.array(path.end_accelerations)[:, None]
    values = (q, q1 * v, q1 * a + q2 * v**2)
    for n in range(order):
        states[:, n] = values[n]
    return states[0], states[1]


def _batches(piece: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield begin and end of batches of about STATE_BATCH time pieces, each of whole path
    pieces.
    """
    count = len(piece)
    ends = np.append(np.flatnonzero(np.diff(piece)) + 1, count)
    first = 0
    while first < count:
        least_stop = min(first + STATE_BATCH, count)
        stop = int(ends[np.searchsorted(ends, least_stop)])
        yield first, stop
        first = stop


def _states_of_pieces(
    trajectory: Trajectory,
    own: slice,
    order: int,
) -> tuple[Array, Array]:
    """Return the states (2 order+1, M, n) where time pieces start, and where they end."""
    piece = trajectory.piece[own]
    v = trajectory.v[own]
    a = trajectory.a[own]
    j = trajectory.j[own]
    lengths = np.diff(trajectory.knots)[own]
    last, last_v, last_a = trajectory.advance(own, lengths)
    start, end = _derive_at_starts_and_ends(trajectory, own, last, order)
    first = np.flatnonzero(np.diff(piece, prepend=-1))
    largest = np.maximum.reduceat(np.abs(start[:3]), first, axis=1)
    rounding = VALUE_ROUNDING * largest
    if isinstance(trajectory.path, PolynomialPath):  # its coefficients are rounded too
        rounding = np.maximum(trajectory.path.rounding[:, piece[first]], rounding)
    counts = np.diff(np.append(first, len(piece)))
    rounding = np.repeat(rounding, counts, axis=1)
    return (
        _find_states(start, rounding, (v, a, j)),
        _find_states(end, rounding, (last_v, last_a, j)),
    )


def _find_states(
    slopes: Array,
    rounding: Array,
    rates: tuple[Array, Array, Array],
) -> Array:
    """Return q, q̇, … up to the order-th derivative, and the rounding of all but that.

    q̇ = q′ ṡ,  q̈ = q′ s̈ + q″ ṡ²,  q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³. The rounding of q, q′, q″
    enters likewise: near rest, where q′ is almost zero, a large s̈ multiplies it.

    slopes (order+1, N, n) q, q′, …; rounding (3, N, n); rates ṡ, s̈, s⃛ (N,)
    """
    v, a, j = (rate[:, None] for rate in rates)
    square = v * v
    q, q1, q2, *third = slopes
    states = [q, q1 * v, q1 * a + q2 * square]
    states += [q1 * j + q2 * (3 * v * a) + q3 * (square * v) for q3 in third]
    errors = [
        rounding[0],
        rounding[1] * np.abs(v),
        rounding[1] * np.abs(a) + rounding[2] * square,
    ]
    return np.stack([*states, *errors[: len(states) - 1]])


def _measure_jumps(before: Array, after: Array, blur: Array) -> Array:
    """Return the jumps (order, N, n) that rounding does not explain; ∞ where one is undefined.

    before, after (2 order+1, N, n)  states on the two sides of N knots: see `_find_states`
    blur (N,) s  rounding of the instants, in which a value changes by its derivative
    """
    order = len(before) // 2
    sides = np.stack([before, after])
    rates = np.abs(sides[:, 1 : order + 1]).max(0)
    rounding = sides[:, order + 1 :].max(0)
    jumps = np.abs(after[:order] - before[:order])
    jumps -= blur[:, None] * rates + rounding
    return np.where(np.isnan(jumps), np.inf, jumps)


def _derive_at_starts_and_ends(
    trajectory: Trajectory,
    own: slice,
    last: Array,
    order: int,
) -> tuple[Array, Array]:
    """Return q, q′, q″ (and q‴ at order 3), (order + 1, M, n), where time pieces start and end.

    last  (M,) path lengths at which they end

    A piece ends where the next one starts, but for rounding δ. On the same piece of path the values
    there are those at the next start plus δ times the next derivative.
    """
    path = trajectory.path
    piece = trajectory.piece[own]
    s = trajectory.s[own]
    start = np.stack(path.derivatives(s, piece, order))
    ahead = last - np.append(s[1:], np.nan)
    same = piece == np.append(piece[1:], -1)
    near = same & (np.abs(ahead) <= INSTANT_ROUNDING * np.abs(last))
    end = np.roll(start, -1, axis=1)
    end[:-1] += end[1:] * ahead[:, None]
    far = np.flatnonzero(~near)
    end[:, far] = path.derivatives(last[far], piece[far], order)
    return start, end


def find_gaps(trajectory: Trajectory) -> dict[str, Place]:
    """Return each way in which the motion does not run the whole path once, and where first.

    A part is left out where a time piece does not begin where the previous one ends. Up to a share
    of the path, over all knots together, that is rounding.
    """
    path = trajectory.path
    knots = trajectory.knots
    ordered = np.isfinite(knots[1:]) & (np.diff(knots) >= 0)
    disorder = np.append(knots[0] != 0, ~ordered)
    if disorder.any():
        k = max(int(np.argmax(disorder)) - 1, 0)
        place = path.place(trajectory.s[k], trajectory.piece[k])
        return {"time out of order": place}
    trajectory = _leave_out_instants(trajectory)
    s = trajectory.s
    speed = trajectory.v
    end, last_speed, last_acceleration = _advance_to_ends(trajectory)
    # how far, and by how much faster, the motion goes while an instant is rounded
    blur = INSTANT_ROUNDING * trajectory.knots[1:]
    drift = blur * np.abs(last_speed)
    gain = blur * np.abs(last_acceleration)
    allowed = allow_gap(path)
    slack = allowed + drift
    slowest = np.minimum(np.minimum(speed, last_speed), _find_least_speeds(trajectory))
    next_start = np.append(s[1:], end[-1])
    gap = np.maximum(np.abs(next_start - end) - drift, 0.0)
    low = path.breaks[trajectory.piece]
    high = path.breaks[trajectory.piece + 1]
    steps = np.diff(trajectory.piece)
    is_first = np.arange(len(s)) == 0
    wrong = {
        "start off the path's": is_first & ~(np.abs(s - path.breaks[0]) <= slack),
        "end off the path's": is_first[::-1] & ~(np.abs(end - path.breaks[-1]) <= slack),
        "place left out": ~(np.cumsum(gap) <= allowed),
        "motion backwards": ~(slowest >= -MAX_JUMP * np.abs(speed).max() - gain),
        "place off its piece": ~((s >= low - slack) & (end <= high + slack)),
        "piece out of turn": np.append(False, ~np.isin(steps, (0, 1))),
        "dwell left out": _find_short_rests(trajectory),
        "constant speed left out": _find_lost_speeds(trajectory),
    }
    places = {}
    for name, where in wrong.items():
        if where.any():
            instant = float(trajectory.knots[int(np.argmax(where))])
            places[name] = place_at(trajectory, instant, "")
    return places


def allow_gap(path: ActuatorPath) -> float:
    """Return the length of the path that may be left out by rounding."""
    return MAX_JUMP * float(path.breaks[-1] - path.breaks[0])


def _find_least_speeds(trajectory: Trajectory) -> Array:
    """Return the least ṡ inside each time piece (M,), ∞ where it is at an end."""
    a = trajectory.a
    j = trajectory.j
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = -a / j
        inside = (j > 0) & (turn > 0) & (turn < np.diff(trajectory.knots))
        return np.where(inside, trajectory.v - a**2 / (2 * j), np.inf)


def _leave_out_instants(trajectory: Trajectory) -> Trajectory:
    """Return the motion without time pieces of zero length: they contain no instant."""
    lasting = np.diff(trajectory.knots) > 0
    if lasting.all() or not lasting.any():
        return trajectory
    knots = np.append(trajectory.knots[:-1][lasting], trajectory.knots[-1])
    columns = (getattr(trajectory, name)[lasting] for name in ("s", "v", "a", "j", "piece"))
    return Trajectory(trajectory.path, knots, *columns)


def _find_short_rests(trajectory: Trajectory) -> np.ndarray:
    """Return the time pieces (M,) that begin where the path states a longer rest than there is.

    Of a rest at the end of the path, the last time piece.
    """
    path = trajectory.path
    short = np.zeros(len(trajectory.s), bool)
    rests = np.flatnonzero(trajectory.resting)
    lengths = np.diff(trajectory.knots)
    allowed = allow_gap(path)
    for stop in np.flatnonzero(path.dwells > 0):
        place = path.breaks[stop]
        here = rests[np.abs(trajectory.s[rests] - place) <= allowed]
        least = path.dwells[stop] - INSTANT_ROUNDING * trajectory.duration
        if not lengths[here].sum() >= least:
            short[
                min(
                    int(np.searchsorted(trajectory.s, place)),
                    len(short) - 1,
                )
            ] = True
    return short


def _find_lost_speeds(trajectory: Trajectory) -> np.ndarray:
    """Return the first time piece (M,) on each segment without the one stretch of its stated speed.

    How steady the speed is there is proved by `planner.certificate.constant_speed`.
    """
    path = trajectory.path
    lost = np.zeros(len(trajectory.s), bool)
    if not has_constant_speed(path):
        return lost
    segments = []
    for piece in range(len(path.breaks) - 1):
        place = path.place(path.breaks[piece], piece)
        segments.append((path.constant(piece), place.segment, place.repetition))
    begins = [one != other for one, other in pairwise(segments)]
    number = np.cumsum([0, *begins])[trajectory.piece]
    constant = np.isfinite(trajectory.constant_speeds)
    for segment in np.unique(number):
        pieces = np.flatnonzero(number == segment)
        speed, *_ = segments[trajectory.piece[pieces[0]]]
        if speed is not None:
            lost[pieces[0]] = len(find_sequences(constant[pieces])) != 1
    return lost


def _advance_to_ends(trajectory: Trajectory) -> tuple[Array, Array, Array]:
    """Return s, ṡ and s̈ (M,) at the end of each time piece."""
    return trajectory.advance(slice(None), np.diff(trajectory.knots))


def piece_end_lengths(trajectory: Trajectory) -> Array:
    """Return the path lengths (M,) at which the time pieces end."""
    return _advance_to_ends(trajectory)[0]


def place_at(trajectory: Trajectory, t: float, axis: str) -> Place:
    """Return the place of the motion at instant t."""
    k = trajectory.locate(np.array([t]))
    tau = min(max(t, 0.0), trajectory.duration) - trajectory.knots[k]
    s, _, _ = trajectory.advance(k, tau)
    return trajectory.path.place(s[0], trajectory.piece[k[0]], t, axis)
