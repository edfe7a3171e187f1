"""The check of pulses: their order, whose they are, the motors against their motion, the axes
against the plan.

How far apart an axis asks for its pulses is written down again from what axes and drives state,
without their code. Where counts that make up for play and screws leave their axes is simulated, and
held against the planned motion.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.machine.axis import Axis
from planner.pulses.checking.convolution import rebuild_motion
from planner.pulses.checking.rolling_motion import RollingMotion
from planner.pulses.checking.search import (
    HALF_TICK,
    PART_INSTANTS,
    X_ROUNDING,
    Search,
    check_band,
    check_between,
)
from planner.pulses.checking.standards import MechanicsStandard, find_standard, search_behind
from planner.pulses.checking.verdict import AxisCheck, PulseCheck
from planner.pulses.motion import AxesMotion, MotorMotion
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks

SHORTENED_SHARE = 1e-3  # of the interval of a stated rate, which whole ticks may shorten by less
INTERVAL_ROUNDING = 1e-9  # ticks


@dataclass(frozen=True, slots=True)
class Gaps:
    """Least times (s) of an axis: from a pulse to the next, and to the next the other way; from 0
    to the first.

    1/max_pulse_rate, 1/max_rate and high + low of its drive, whichever is longest; for a reversal
    DIR has to have held after the one pulse and be set up before the other.

    start_stop  time between pulses at which the motor still starts and stops at once; next to a
                shorter one there is none that is more than twice as long, and so no rest and no
                turn
    """

    one: float
    other: float
    first: float
    start_stop: float = 0.0

    @classmethod
    def from_axis(cls, axis: Axis) -> "Gaps":
        rates = [axis.max_pulse_rate or inf]
        levels = turn = first = 0.0
        if (drive := axis.timing) is not None:
            rates.append(drive.max_rate or inf)
            levels, turn = drive.high + drive.low, max(drive.high, drive.hold) + drive.setup
            first = drive.setup
        one = max(levels, (1 - SHORTENED_SHARE) / min(rates))
        start_stop = 0.0 if axis.start_stop_rate is None else 1 / axis.start_stop_rate
        return cls(one, max(one, turn), first, start_stop)

    def check(self, search: Search, ticks: Ticks, direction: Signs, way: int) -> None:
        """Report those of the next pulses (N,) that come too soon; way: of the pulse before them, 0
        for none.
        """
        before = search.latest
        had = np.diff(ticks, prepend=0 if before is None else before)
        turned = np.diff(direction, prepend=way) != 0
        least: Array = np.where(turned, self.other, self.one)
        kinds = np.where(turned, "spacing at a reversal", "spacing")
        if before is None:
            least[0], kinds[0] = self.first, "direction set-up"
        short = had < least / search.tick - INTERVAL_ROUNDING
        for kind in np.unique(kinds[short]).tolist():
            these = np.flatnonzero(short & (kinds == kind))
            text = f"{{:.6g}} us, and the axis takes {1e6 * least[these[0]]:.6g} us"
            search.report(kind, ticks[these], text, 1e6 * had[these] * search.tick)

    def check_starts(self, search: Search, ticks: Ticks, direction: Signs, way: int) -> None:
        """Report where the next pulses (N,) jump in rate, beyond the rate at which the motor starts
        and stops.
        """
        if not self.start_stop:
            return
        if search.latest is None:
            search.interval = self._find_interval(search, 0.0)
        latest = -search.interval if search.latest is None else search.latest
        turned = np.diff(direction, prepend=way if way else direction[0]) != 0
        intervals = np.where(turned, inf, np.diff(ticks.astype(float), prepend=latest))
        self._report_jumps(
            search, np.concatenate([[search.interval], intervals[:-1]]), intervals, ticks
        )
        search.interval = float(intervals[-1])

    def check_stop(self, search: Search) -> None:
        """Report an axis that stops after its last pulse from beyond the start/stop rate."""
        if not self.start_stop or search.latest is None:
            return
        after = self._find_interval(search, search.motion.duration)
        self._report_jumps(
            search, np.array([search.interval]), np.array([after]), np.array([search.latest])
        )

    def _find_interval(self, search: Search, t: float) -> float:
        """Return the ticks from pulse to pulse at the speed that the axis has at t (s); ∞ at
        rest.
        """
        speed = abs(float(search.at(np.array([t])).v[0]))
        return 1 / (speed * search.tick) if speed else inf

    def _report_jumps(self, search: Search, earlier: Array, later: Array, ticks: Ticks) -> None:
        """Report intervals in turn (ticks) that differ by more than a factor of two beyond the
        start/stop rate.
        """
        shorter, longer = np.minimum(earlier, later), np.maximum(earlier, later)
        fast = shorter < self.start_stop / search.tick - START_ROUNDING
        jumps = fast & (longer > 2 * shorter + START_ROUNDING)
        text = f"{{:.6g}} 1/s next to a rest or to less than half of it; it starts at {1 / self.start_stop:.6g} 1/s"
        search.report("start/stop rate", ticks[jumps], text, 1 / (shorter[jumps] * search.tick))


START_ROUNDING = 2.0  # ticks by which rounding changes the difference of two intervals
BLOCK_PULSES = 1 << 13  # pulses gone through together: their arrays stay in the processor's cache
# Instants per knot interval besides the pulses' own: one in each half of a millisecond, and how
# many at least and most.
LEAST_INSTANTS, GRID_INSTANTS, INSTANT_PERIOD = 2, 8, 5e-4


def check(
    schedule: PulseSchedule,
    trajectory: AxesMotion,
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """Prove that every axis keeps to what its schedule states of it, and that it is of this motion.

    With x = (q - home)/pulse:
    - Under "nearest", "floor" and "timer" each pulse is at the true crossing of its level, to half
      a tick (of the timer's clock), and goes the motion's way; between pulses x crosses none, to
      the travel in that time. Hysteresis is part of the level. Under "sampled" and "dda" each pulse
      is at the look or listed step that asks for it.
    - Pulses that the drive's timing moved are as many as stated, and no farther from there than
      stated; near them, a pair whose excursion is below the bound's widening is not missed.
    - |count - x| ≤ bound + one tick's travel before, between and after the pulses. Between the
      samples too: an interval δ is halved until x is monotone in it, or max|count - x| + max|ẍ|
      δ²/8 is within the bound, with the motion's jerk taken to be largest at the ends of intervals
      (an eighth of a knot interval, or less).
    - No pulse comes sooner after another than its axis' pulse rate and its drive take it, where
      machine_axes are given, the other way neither (`planner.pulses.checking.check`).
    - The ticks rise; the start and final counts are the motion's, and so is the duration.
    - Names, pulses and homes are the machine's, where machine_axes and home_q (n,) are given.
    - Where the motion is that of motors which make up for play and screws, and machine_axes are
      given, the counts are carried through both, and the axes are where they are planned
      (`planner.pulses.checking.check`).
    Another rule, or another bound than the rule's, is held to its bound alone. Positions are
    trusted to 64 roundings of
    q, of home, and of q̇·t or s·dq/ds. The motion is asked about once per pulse, in blocks.
    Raises MotionError where the motion has another number of axes.
    """
    return check_parts(schedule, [schedule], trajectory, machine_axes, home_q)


def check_parts(
    stated: PulseSchedule,
    parts: Iterable[PulseSchedule],
    trajectory: AxesMotion,
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """The same of parts that follow each other in time, in memory for one: `stated` says all but
    their pulses.
    """
    trajectory = rebuild_motion(trajectory)
    searches = _begin(stated, trajectory, machine_axes, home_q)
    carried: dict[int, Search] = {}
    if isinstance(trajectory, MotorMotion) and machine_axes is not None:
        grid, planned = _make_grid(trajectory.knots), rebuild_motion(trajectory.planned)
        carried = {
            search.k: search for search in search_behind(stated, planned, machine_axes, grid)
        }
    gaps = _list_gaps(searches, machine_axes)
    for part in parts:
        for search, axis, gap in zip(searches, part.axes, gaps, strict=True):
            _check_part(search, carried.get(search.k), axis, gap)
    _check_stops(searches, gaps)
    return PulseCheck(tuple(_conclude(search, carried.get(search.k)) for search in searches))


def check_motion_parts(
    stated: PulseSchedule,
    parts: Iterable[PulseSchedule],
    motions: Iterable[AxesMotion],
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """The same of a motion that comes in parts as well, each with a time from 0; a few of them are
    held at a time.

    The parts of the pulses need not end where those of the motion do. Raises MotionError where
    there is no motion, for the rule `dda`, whose list of points is of the whole, and for axes that
    make up for their play or screws.
    """
    if any(axis.compensate for axis in machine_axes or ()):
        raise MotionError(
            "pulses that make up for play or lead errors are not checked part by part: check the whole"
        )
    motion = RollingMotion(motions, stated.duration)
    first = motion.load()
    if first is None:
        raise MotionError("the pulses are of a motion without parts: give at least one")
    searches = _begin(stated, motion, machine_axes, home_q)
    for search in searches:
        search.note_drift(first.motion)
    reach = stated.clock_hz**-1 * (
        4 + 2 * max(search.shift + search.standard.wait for search in searches)
    )
    gaps = _list_gaps(searches, machine_axes)
    for part in parts:
        ticks = [axis.ticks for axis in part.axes if len(axis)]
        begin, end = (
            float(of(each[n] for each in ticks)) if ticks else 0.0
            for of, n in ((min, 0), (max, -1))
        )
        while motion.end < end / stated.clock_hz + reach and _load(motion, searches):
            _advance(motion, searches, begin / stated.clock_hz, reach)
        for search, axis, gap in zip(searches, part.axes, gaps, strict=True):
            _check_part(search, None, axis, gap)
        _advance(motion, searches, end / stated.clock_hz, reach)
    _advance(motion, searches, motion.end, reach)
    while _load(motion, searches):
        _advance(motion, searches, motion.end, reach)
    for search in searches:
        _check_duration(search, motion.end)
    _check_stops(searches, gaps)
    return PulseCheck(tuple(_conclude(search, None) for search in searches))


def _begin(
    stated: PulseSchedule,
    motion: AxesMotion,
    machine_axes: Sequence[Axis] | None,
    home_q: ArrayLike | None,
) -> list[Search]:
    """A search for each axis, which has looked at what the schedule says of itself and at the
    start.
    """
    width = motion.at(np.zeros(1)).q.shape[1]
    if width != len(stated.axes):
        raise MotionError(
            f"the schedule has {count_noun(len(stated.axes), 'axis')}, the motion {width}; check it against its own"
        )
    grid = _make_grid(motion.knots)
    searches = [
        Search(stated, k, motion, grid, stated.axes[k].start, find_standard(stated, k, motion))
        for k in range(width)
    ]
    for search in searches:
        _check_duration(search, motion.duration)
        _check_identity(search, machine_axes, home_q)
        _check_end(search, "start count", 0.0, search.axis.start)
    return searches


def _list_gaps(
    searches: Sequence[Search], machine_axes: Sequence[Axis] | None
) -> list[Gaps | None]:
    return (
        [None] * len(searches)
        if machine_axes is None
        else [Gaps.from_axis(axis) for axis in machine_axes]
    )


def _check_stops(searches: Sequence[Search], gaps: Sequence[Gaps | None]) -> None:
    for search, gap in zip(searches, gaps, strict=True):
        if gap is not None:
            gap.check_stop(search)


def _load(motion: RollingMotion, searches: Sequence[Search]) -> bool:
    """The next part of a motion, to be looked at; False where there is none."""
    part = motion.load()
    if part is None:
        return False
    grid = _make_grid(part.knots, PART_INSTANTS)
    for search in searches:
        search.note_drift(part.motion)
        search.grid = np.concatenate((search.grid, grid[grid > part.begin]))
    return True


def _advance(motion: RollingMotion, searches: Sequence[Search], until: float, reach: float) -> None:
    """Look at all before a time (s), up to which there is no other pulse, and let go of the motion
    there.
    """
    ordered = [search for search in searches if search.is_ordered]
    for search in ordered:
        _check_motion(search, np.empty(0, np.int64), np.empty(0, np.int8), search.pulses, until)
    seen = [search.last.t[-1] if search.last is not None else 0.0 for search in ordered]
    motion.forget(float(min(seen, default=until)) - reach)


def _make_grid(knots: Array, instants: int = 64 * GRID_INSTANTS + 1) -> Array:
    """Instants that see every knot from both sides, and each interval inside."""
    lo, hi = knots[:-1], knots[1:]
    count = np.clip(np.ceil((hi - lo) / INSTANT_PERIOD), LEAST_INSTANTS, GRID_INSTANTS).astype(int)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    inside = np.repeat(lo, count) + np.repeat((hi - lo) / count, count) * nth
    throughout = np.linspace(knots[0], knots[-1], instants)
    return np.unique(np.concatenate((inside, np.nextafter(hi, lo), throughout)))


def _check_part(
    search: Search, carried: Search | None, part: AxisPulses, gaps: Gaps | None
) -> None:
    """Go through the pulses of a part, block by block."""
    _check_order(search, part, gaps)
    done = search.pulses - len(part)
    for lo in range(0, len(part) if search.is_ordered else 0, BLOCK_PULSES):
        ticks, direction = (
            part.ticks[lo : lo + BLOCK_PULSES],
            part.direction[lo : lo + BLOCK_PULSES],
        )
        _check_motion(search, ticks, direction, done + lo)
        if carried is not None:
            _check_motion(carried, ticks, direction, done + lo)
    if not search.is_ordered:
        search.count += int(part.direction.sum(dtype=np.int64))


def _conclude(search: Search, carried: Search | None) -> AxisCheck:
    """The findings, once there are no more pulses."""
    if search.is_ordered:
        for each in (search, carried):
            if each is not None:
                _check_motion(each, np.empty(0, np.int64), np.empty(0, np.int8), search.pulses)
        search.standard.conclude(search)
        _check_moved(search)
    else:
        search.time_error = search.position_error = np.inf
    time_error = search.time_error if search.standard.exact else None
    final_error = _check_end(search, "final count", search.motion.duration, search.count)
    figures = time_error, search.position_error, search.closest * search.tick, final_error
    found = AxisCheck(
        search.axis.name, search.pulses, *figures, tuple(search.faults), search.kinds.total()
    )
    found = replace(
        found, smallest_reversal=search.back * search.tick, first=search.begun * search.tick
    )
    if carried is None or not isinstance(carried.standard, MechanicsStandard):
        return found
    faults = tuple(
        replace(fault, what=f"behind play and screw, {fault.what}") for fault in carried.faults
    )
    return replace(
        found,
        behind=carried.standard.largest if search.is_ordered else np.inf,
        faults=found.faults + faults,
        fault_count=found.fault_count + carried.kinds.total(),
    )


def _check_duration(search: Search, duration: float) -> None:
    """The schedule takes as long as its motion (s)."""
    late = search.schedule.duration - duration
    if not abs(late) <= search.tick:
        search.report(
            "duration", np.zeros(1, np.int64), "{:+.9g} s from the motion's", np.array([late])
        )


def _check_identity(
    search: Search, machine_axes: Sequence[Axis] | None, home_q: ArrayLike | None
) -> None:
    """The schedule is of this machine."""
    axis, nowhere = search.axis, np.zeros(1, np.int64)
    if machine_axes is not None:
        given = machine_axes[search.k]
        if axis.name != given.name:
            search.report(
                f"name: the machine's axis is {given.name}",
                nowhere,
                "{:.0f}",
                np.array([search.k + 1]),
            )
        if axis.pulse != given.pulse:
            search.report(
                "pulse", nowhere, "{:.9g} times the machine's", np.array([axis.pulse / given.pulse])
            )
    if home_q is not None:
        off = axis.home - float(np.asarray(home_q, float)[search.k])
        if abs(off) > X_ROUNDING * abs(axis.home):
            search.report("home", nowhere, "{:+.9g} from the machine's", np.array([off]))


def _check_order(search: Search, part: AxisPulses, gaps: Gaps | None) -> None:
    """The ticks rise, from 0 to the end, as far apart as the axis takes them, and every direction
    is one.
    """
    way = search.way
    last = search.motion.duration / search.tick
    for lo in range(0, len(part), BLOCK_PULSES):
        ticks, direction = (
            part.ticks[lo : lo + BLOCK_PULSES],
            part.direction[lo : lo + BLOCK_PULSES],
        )
        steps = np.diff(ticks) if search.latest is None else np.diff(ticks, prepend=search.latest)
        back = np.flatnonzero(steps <= 0)
        search.report(
            "order",
            ticks[back + len(ticks) - len(steps)],
            "{} ticks after the pulse before it",
            steps[back],
        )
        outside = ticks[(ticks < 0) | (ticks > last + HALF_TICK)]
        search.report(
            "outside", outside, "the motion ends at tick {:.1f}", np.full(len(outside), last)
        )
        neither = abs(direction) != 1
        search.report("direction", ticks[neither], "{} is neither +1 nor -1", direction[neither])
        if gaps is not None:
            gaps.check(search, ticks, direction, way)
            gaps.check_starts(search, ticks, direction, way)
        turned = np.diff(direction) if search.latest is None else np.diff(direction, prepend=way)
        back_steps = steps[turned != 0]
        search.back = min(search.back, float(back_steps.min()) if len(back_steps) else np.inf)
        search.begun = min(search.begun, float(ticks[0]))
        way = int(direction[-1])
        search.closest = min(search.closest, float(steps.min()) if len(steps) else np.inf)
        search.latest, search.pulses = int(ticks[-1]), search.pulses + len(ticks)


def _check_motion(
    search: Search, ticks: Ticks, direction: Signs, first: int, until: float = inf
) -> None:
    """The next pulses (N,), and all that lies ahead of the last; without pulses, the motion before
    a time (s).
    """
    # A pulse that rounding put up to half a tick behind the end of the motion is seen at the end.
    fires = np.minimum(ticks / search.schedule.clock_hz, search.motion.duration)
    ahead = int(
        np.searchsorted(
            search.grid, fires[-1] if len(fires) else until, side="right" if len(fires) else "left"
        )
    )
    between, search.grid = search.grid[:ahead], search.grid[ahead:]
    t = np.concatenate((between, fires))
    order = np.argsort(
        t, kind="stable"
    )  # a grid instant at a pulse comes first: it sees the count before
    change = np.concatenate((np.zeros(ahead), direction))[order]
    fired = order >= ahead
    nth = np.cumsum(fired)
    ways = np.concatenate(([search.way], direction)).astype(float)[nth]
    counts = search.count + np.cumsum(change)
    if isinstance(search.standard, MechanicsStandard):
        counts = search.standard.carry(counts)
    samples = search.sample(t[order], counts, ways)
    search.standard.judge(search, ticks, direction.astype(float), samples[fired], first)
    check_band(search, samples[~fired])
    check_between(search, samples if search.last is None else search.last.followed_by(samples))
    search.count += int(change.sum())
    search.way = int(direction[-1]) if len(direction) else search.way
    search.last = samples[-1:] if len(t) else search.last


def _check_moved(search: Search) -> None:
    """As many pulses were moved apart as is stated."""
    stated = sum(one.pulses for one in search.schedule.moves if one.axis == search.axis.name)
    least, most = search.moved
    if not least <= stated <= most and stated:
        nowhere = np.zeros(1, np.int64)
        search.report(
            "moved",
            nowhere,
            f"{{:.0f}} pulses are off their crossing, {stated} stated",
            np.array([least]),
        )


def _check_end(search: Search, kind: str, t: float, count: int) -> float:
    """The count at one end of the motion: 0 where it is right, else by how many pulses it is
    not.
    """
    end = search.sample(
        np.array([t]), np.array([float(count)]), np.array([0.0 if t == 0 else float(search.way)])
    )
    error = count - end.x
    allowed = search.noise(end) + end.travel(search.standard.wait * search.tick)
    below, above = search.standard.begins if t == 0 else (np.inf, np.inf)
    inside = -below - allowed[0] <= -error[0] <= above + allowed[0]
    if inside and search.excess(end)[0] <= allowed[0]:
        return 0.0
    search.report(kind, np.rint(end.t / search.tick), "{:+.6g} pulses from the motion", error)
    return float(error[0])
