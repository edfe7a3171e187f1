"""The certificate: a bound of every limit over continuous time, from the trajectory and the limits' `value` alone.

Time is cut into cells; over each, the motion is enclosed by Taylor series (planner.certificate.enclosure) and a limit's
value follows by its own formula. A cell's bound is that of the series' polynomial plus the error; cells are cut
until the bounds are tight. It is also proved that the motion is one: nothing jumps, and it runs the whole path once,
forwards, between the speeds stated.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array, largest_in_rows
from kinematics.foundation.kernels import kernel
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.constant_speed import CONSTANT_SPEED, prove_speed_deviation
from planner.certificate.limit_use import ProvedUse, prove, round_reached_use
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit, order_of
from planner.limits.resonance import Resonance
from planner.path.actuation import ActuatorPath
from planner.place import Place, where_columns
from planner.trajectory import Trajectory, unit_speed_trajectory

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
    path, count = trajectory.path, len(trajectory.s)
    before, final = np.zeros((2, 3, order, len(path.names)))
    derivatives = path.derivatives(path.breaks[[0, -1]], np.array([0, len(path.breaks) - 2]), 2)
    for side, n in ((before, 0), (final, 1)):
        (q, q1, q2), speed, push = (each[n] for each in derivatives), path.end_speeds[n], path.end_accelerations[n]
        side[0] = [q, q1 * speed, q1 * push + q2 * speed**2][:order]
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
        look_for_jumps(start, end, motion, blur, trajectory.piece[own], before, worst, at, least, largest, first)
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
    before: Array,
    worst: Array,
    at: np.ndarray,
    least: Array,
    largest: Array,
    first: int,
) -> None:
    """What jumps most between time pieces one after the other, on from those before.

    start, end (order + 1, M, n)  q, q′, … where time pieces start and end; motion (2, 3, M): ṡ, s̈ and s⃛ there
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
            rounding[:] = 0.0
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
    """Where the motion leaves out, repeats or leaves the path: its first such place."""
    path, length = trajectory.path, float(trajectory.path.breaks[-1] - trajectory.path.breaks[0])
    h, v, a, j = np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j
    end = piece_end_lengths(trajectory)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.where((j > 0) & (-a / j > 0) & (-a / j < h), v - a**2 / (2 * j), np.inf)  # least ṡ inside a piece
    slowest = np.minimum(np.minimum(v, v + h * (a + h * j / 2)), turn)
    low, high = path.breaks[trajectory.piece], path.breaks[trajectory.piece + 1]
    blur = INSTANT_ROUNDING * trajectory.knots[1:]
    slack = MAX_JUMP * length + blur * np.abs(v + h * (a + h * j / 2))
    wrong = {
        "start off the path's": (np.arange(len(h)) == 0) & ~(np.abs(trajectory.s - path.breaks[0]) <= slack),
        "end off the path's": (np.arange(len(h)) == len(h) - 1) & ~(np.abs(end - path.breaks[-1]) <= slack),
        "motion backwards": ~(slowest >= -MAX_JUMP * np.abs(v).max() - blur * np.abs(a + h * j)),
        "place off its piece": ~((trajectory.s >= low - slack) & (end <= high + slack)),
        "piece out of turn": np.concatenate([[False], ~np.isin(np.diff(trajectory.piece), (0, 1))]),
    }
    return {
        name: place_at(trajectory, float(trajectory.knots[int(np.argmax(where))]), "")
        for name, where in wrong.items()
        if where.any()
    }


def piece_end_lengths(trajectory: Trajectory, own: slice = slice(None)) -> Array:
    """Path lengths (M,) at which the time pieces end."""
    h, v, a, j = (each[own] for each in (np.diff(trajectory.knots), trajectory.v, trajectory.a, trajectory.j))
    return np.asarray(trajectory.s[own] + h * (v + h * (a / 2 + h * j / 6)))


def place_at(trajectory: Trajectory, t: float, axis: str) -> Place:
    k = int(trajectory.locate(np.array([t]))[0])
    tau = min(max(t, 0.0), trajectory.duration) - trajectory.knots[k]
    s = trajectory.s[k] + tau * (trajectory.v[k] + tau * (trajectory.a[k] / 2 + tau * trajectory.j[k] / 6))
    return trajectory.path.place(float(s), int(trajectory.piece[k]), t, axis)


CROSSING = "resonance crossing"
"""What no value at an instant tells: the longest stay of an axis in a band of speed, over the time allowed."""
# Instants of a time piece that are looked at for where it uses a limit most (the bound itself needs none).
WORST_PLACE_INSTANTS = 65


@dataclass(frozen=True, slots=True)
class Certificate(Result):
    """worst: proven upper bound of value/limit over continuous time, per limit; where: the place of each.

    use       per limit, the proven bound over each time piece of the trajectory (M,); worst is its maximum, and tight;
              of pieces that surely use less it is only below that
    attained  per limit, the largest value/limit met in each time piece (M,), 0 where none was looked at: the truth lies
              between the two
    """

    holds: bool
    worst: dict[str, float]
    where: dict[str, Place]
    use: dict[str, Array] = field(repr=False)
    attained: dict[str, Array] = field(repr=False)

    def tables(self) -> tuple[Table, ...]:
        """The worst proven use of each limit, and where."""
        head = "the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD"
        ratios = Column("bound", [*self.worst.values()], form=".7f", up=True)
        where = where_columns([self.where[name] for name in self.worst])
        names = Column("limit", [*self.worst])
        return (Table(f"{head}: value/limit, bounded over continuous time", (names, ratios, *where)),)


def certify(trajectory: Trajectory, limits: Sequence[Limit], known: ProvedUse | None = None) -> Certificate:
    """Prove what the trajectory uses of every limit, and that it is the motion asked for.

    It runs the whole path once, forwards, from rest to rest or between the speeds that the path states for its ends,
    and is as smooth as its order asks: nothing jumps.

    known spares the work on time pieces of which the timing limits are proved already. What a geometric limit uses
    depends on the place alone: it is proved once along the path, and each time piece has what the parts of the path
    use through which it passes.
    """
    order = order_of(limits)
    timed, standing = ([limit for limit in limits if limit.geometric is still] for still in (False, True))
    use, attained = prove(trajectory, timed, order, known)
    use |= _geometric_use(trajectory, standing)
    attained |= use_at_knots(trajectory, standing, known)
    worst = {name: float(values.max()) for name, values in use.items()}
    # a bound that is kept need not be tight everywhere
    most = {limit.name: attained if limit.geometric or worst[limit.name] <= 1 else use for limit in limits}
    where = {
        limit.name: _find_worst_place(trajectory, limit, int(np.argmax(most[limit.name][limit.name])))
        for limit in limits
    }
    for limit in limits:
        if isinstance(limit, Resonance) and limit.bands:
            use[CROSSING], attained[CROSSING], where[CROSSING] = _prove_crossing(trajectory, limit)
            worst[CROSSING] = float(use[CROSSING].max())
    if np.isfinite(trajectory.constant_speeds).any():
        use[CONSTANT_SPEED], attained[CONSTANT_SPEED], where[CONSTANT_SPEED] = prove_speed_deviation(trajectory)
        worst[CONSTANT_SPEED] = float(use[CONSTANT_SPEED].max())
    for name, place in (find_jumps(trajectory, order) | find_gaps(trajectory)).items():
        worst[name], where[name] = float("inf"), place
    return Certificate(
        holds=all(value <= 1 for value in worst.values()),
        worst=worst,
        where=where,
        use={name: freeze_array(values) for name, values in use.items()},
        attained={name: freeze_array(values) for name, values in attained.items()},
    )


# Knots at which geometric limits are looked at, beside those around the worst of them.
KNOTS_SEEN = 128
# Paths whose geometry is remembered as proved.
KEPT_PATHS = 16
_PATH_USE: dict[Hashable, dict[str, Array]] = {}


def prove_path_use(path: ActuatorPath, limits: Sequence[Limit]) -> dict[str, Array]:
    """Per geometric limit, the proven bound of its use on every part of `unit_speed_trajectory(path)`.

    It is kept for the last few paths and limits by what decides it: orders, retries and reruns share it.
    """
    if not limits:
        return {}
    key = path.content, *(limit.content for limit in limits)
    use = _PATH_USE.pop(key, None)
    if use is None:
        proved, _ = prove(unit_speed_trajectory(path), limits, 2)
        use = {name: freeze_array(values) for name, values in proved.items()}
    _PATH_USE[key] = use  # the last, now
    while len(_PATH_USE) > KEPT_PATHS:
        _PATH_USE.pop(next(iter(_PATH_USE)), None)
    return use


def forget_paths() -> None:
    """Prove all geometry anew: for whoever measures what that takes."""
    _PATH_USE.clear()


def _geometric_use(trajectory: Trajectory, limits: Sequence[Limit]) -> dict[str, Array]:
    """Per geometric limit, the proven bound of its use over each time piece (M,): that of the parts of the path met."""
    if not limits:
        return {}
    along = unit_speed_trajectory(trajectory.path)
    proven = prove_path_use(trajectory.path, limits)
    s = np.append(trajectory.s, piece_end_lengths(trajectory)[-1:])
    slack = MAX_JUMP * (along.s[-1] - along.s[0])  # by which `find_gaps` lets a motion stray
    first = np.searchsorted(along.s, np.minimum(s[:-1], s[1:]) - slack, side="right") - 1
    last = np.searchsorted(along.s, np.maximum(s[:-1], s[1:]) + slack, side="right")
    ranges = np.stack([np.clip(first, 0, len(along.s) - 1), np.maximum(last, 1)], 1).ravel()
    return {name: np.maximum.reduceat(np.append(values, 0.0), ranges)[::2] for name, values in proven.items()}


def use_at_knots(trajectory: Trajectory, limits: Sequence[Limit], known: ProvedUse | None = None) -> dict[str, Array]:
    """Per geometric limit, the larger use attained at the two ends of each time piece (M,); known: what is already.

    A knot is one place: what the path uses there is the same on both sides. Some knots are looked at, and then all
    beside the one that uses a limit most: it says where a limit is used most, and proves nothing.
    """
    pieces = len(trajectory.s)
    nothing = np.full(pieces, np.nan)
    found = {limit.name: nothing.copy() if known is None else known.attained[limit.name].copy() for limit in limits}
    new = np.flatnonzero(np.isnan(found[limits[0].name])) if limits else np.zeros(0, int)
    knots = np.union1d(new, new + 1)
    met = {limit.name: np.zeros(pieces + 1) for limit in limits}
    step = -(-len(knots) // KNOTS_SEEN)
    some = knots[np.unique(np.append(np.arange(0, len(knots), step), len(knots) - 1))] if step else knots
    _look_at_knots(trajectory, limits, some, met)
    for limit in limits if step > 1 else ():
        best = int(np.searchsorted(knots, some[met[limit.name][some].argmax()]))
        _look_at_knots(trajectory, [limit], knots[max(best - step + 1, 0) : best + step], met)
    for name, values in met.items():
        found[name][new] = round_reached_use(np.maximum(values[new], values[new + 1]))
    return found


def _look_at_knots(trajectory: Trajectory, limits: Sequence[Limit], knots: np.ndarray, met: dict[str, Array]) -> None:
    """Fill met (M+1,) of each limit at some knots."""
    k = np.minimum(knots, len(trajectory.s) - 1)
    state = trajectory.within(k, np.where(knots < len(trajectory.s), 0.0, np.diff(trajectory.knots)[k]))
    for limit in limits:
        value = limit.value(state)
        met[limit.name][knots] = largest_in_rows(limit.use(value, value, state.piece))


def _prove_crossing(trajectory: Trajectory, limit: Resonance) -> tuple[Array, Array, Place]:
    """The longest stay that each time piece has part in, as a share of the time allowed: what is proved and what is
    attained (M,), and where the longest of all begins.
    """
    use, attained = np.zeros((2, len(trajectory.s)))
    longest, place = 0.0, place_at(trajectory, 0.0, "")
    for stay in find_stays(trajectory, limit):
        part = slice(stay.first, stay.last + 1)
        np.maximum(use[part], stay.use, out=use[part])
        np.maximum(attained[part], stay.inside / stay.band.time, out=attained[part])
        if stay.use > longest:
            longest, place = stay.use, place_at(trajectory, stay.start, limit.channels[stay.band.axis])
    return use, attained, place


def _find_worst_place(trajectory: Trajectory, limit: Limit, k: int) -> Place:
    """Where in time piece k, and in which channel, a limit is used most."""
    span = trajectory.knots[k + 1] - trajectory.knots[k]
    state = trajectory.within(np.full(WORST_PLACE_INSTANTS, k), span * np.linspace(0.0, 1.0, WORST_PLACE_INSTANTS))
    value = limit.value(state)
    row, channel = np.unravel_index(int(np.argmax(limit.use(value, value, state.piece))), value.shape)
    return place_at(trajectory, float(state.t[row]), limit.channels[int(channel)])
