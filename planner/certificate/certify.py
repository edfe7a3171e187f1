"""The certificate: a bound of every limit over continuous time, from the trajectory and the limits' `value` alone.

Time is cut into cells; over each, the motion is enclosed by Taylor series (planner.certificate.enclosure) and a limit's
value follows by its own formula. A cell's bound is that of the series' polynomial plus the error; cells are cut
until the bounds are tight. It is also proved that the motion is one (planner.certificate.continuity).
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array, largest_in_rows
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.constant_speed import CONSTANT_SPEED, prove_speed_deviation
from planner.certificate.continuity import MAX_JUMP, find_gaps, find_jumps, piece_end_lengths, place_at
from planner.certificate.limit_use import ProvedUse, prove, round_reached_use
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit, order_of
from planner.limits.resonance import Resonance
from planner.path.actuation import ActuatorPath
from planner.place import Place
from planner.trajectory import Trajectory, unit_speed_trajectory

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

    def __repr__(self) -> str:
        most = max(self.worst, key=lambda name: self.worst[name], default="")
        used = f": {self.worst[most]:.7f} of {most}, of {len(self.worst)} limits" if most else ""
        return f"<Certificate {'holds' if self.holds else 'DOES NOT HOLD'}{used}>"

    def tables(self) -> tuple[Table, ...]:
        """The worst proven use of each limit, and where."""
        head = "the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD"
        ratios = Column("bound", [*self.worst.values()], form=".7f", up=True)
        where = Place.columns([self.where[name] for name in self.worst])
        names = Column("limit", [*self.worst])
        return (Table(f"{head}: value/limit, bounded over continuous time", (names, ratios, *where)),)


def certify(trajectory: Trajectory, limits: Sequence[Limit], known: ProvedUse | None = None) -> Certificate:
    """Prove what the trajectory uses of every limit, and that it is the motion asked for.

    It runs the whole path once, forwards, from rest to rest or between the speeds that the path states for its ends,
    and is as smooth as its order asks: nothing jumps.

    known spares the work on time pieces of which the timing limits are proved already: on those with the numbers that
    it was proved of. What a geometric limit uses
    depends on the place alone: it is proved once along the path, and each time piece has what the parts of the path
    use through which it passes.
    """
    order = order_of(limits)
    known = None if known is None else known.fit(trajectory)
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


def find_place(trajectory: Trajectory, limits: Sequence[Limit], name: str, k: int) -> Place:
    """Where in time piece k what a certificate states by a name is used most, and by which axis.

    What no instant tells, such as a stay in a band of speed, is placed where the piece begins.
    """
    limit = next((limit for limit in limits if limit.name == name), None)
    if limit is not None:
        return _find_worst_place(trajectory, limit, k)
    return trajectory.path.place(float(trajectory.s[k]), int(trajectory.piece[k]), float(trajectory.knots[k]))


def _find_worst_place(trajectory: Trajectory, limit: Limit, k: int) -> Place:
    """Where in time piece k, and in which channel, a limit is used most."""
    span = trajectory.knots[k + 1] - trajectory.knots[k]
    state = trajectory.within(np.full(WORST_PLACE_INSTANTS, k), span * np.linspace(0.0, 1.0, WORST_PLACE_INSTANTS))
    value = limit.value(state)
    row, channel = np.unravel_index(int(np.argmax(limit.use(value, value, state.piece))), value.shape)
    return place_at(trajectory, float(state.t[row]), limit.channels[int(channel)])
