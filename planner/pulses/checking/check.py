"""The check of pulses: their order, whose they are, the motors against their motion, the axes against the plan.

How far apart an axis asks for its pulses is written down again from what axes and drives state, without their code.
Where counts that make up for play and screws leave their axes is simulated, and held against the planned motion.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.pulses.checking.search import HALF_TICK, X_ROUNDING, Samples, Search, Standard, check_band, check_between
from planner.pulses.checking.standards import find_standard
from planner.pulses.checking.verdict import AxisCheck, PulseCheck
from planner.pulses.motion import AxesMotion, MotorMotion, apply_play, apply_screw
from planner.pulses.schedule import AxisPulses, Compensation, PulseSchedule, Signs, Ticks

INSTANT_BLOCK = 1 << 14  # instants looked at together


@dataclass(slots=True)
class MechanicsStandard(Standard):
    """An axis behind what its pulses make up for: place = screw(play(count·pulse)), in pulses from home.

    |place - x| ≤ s (bound + one tick's travel of the motor + what turned nothing), and s·off more in the windows of
    time that are stated for crossing the play; s is the steepest slope of the screw. The play operator makes no
    difference between two motors larger than it is. Play or screw that is not made up for was not asked to be.
    Independent of how they were made up for: beside `off`, its windows and the farthest run back that turns nothing,
    which the schedule states, only the machine's own play and table are used.
    """

    axis: Axis
    held: float
    bound: float
    off: float
    windows: Array
    place: float = 0.0
    largest: float = 0.0

    @property
    def exact(self) -> bool:
        return False

    def carry(self, counts: Array) -> Array:
        """(N,) the places, in pulses, to which the next counts lead the axis."""
        motor = counts * self.axis.pulse
        if "backlash" in self.axis.compensate:
            motor = apply_play(motor, self.axis, self.held)
            self.held = float(motor[-1]) if len(motor) else self.held
        return (apply_screw(motor, self.axis) if "lead" in self.axis.compensate else motor) / self.axis.pulse

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        begin, end = self.windows
        n = np.searchsorted(begin, s.t, side="right") - 1
        crossing = (n >= 0) & (s.t <= end[n]) if len(begin) else np.zeros(len(s.t), bool)
        side = self.bound + self.off * crossing
        return side, side

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        if not len(ticks):
            return
        before = replace(s, count=np.concatenate(([self.place], s.count[:-1])))
        self.place = float(s.count[-1])
        for each in (s, before):
            check_band(search, each)
            self.largest = max(self.largest, float(abs(each.x - each.count).max()))


def search_behind(schedule: PulseSchedule, planned: AxesMotion, axes: Sequence[Axis], grid: Array) -> Iterator[Search]:
    """A search for each axis that makes up for something, on the planned motion of the axes; grid (s) to look at."""
    speeds = np.max(
        [abs(planned.at(grid[lo : lo + INSTANT_BLOCK]).qd).max(axis=0) for lo in range(0, len(grid), INSTANT_BLOCK)],
        axis=0,
    )
    for k, (pulses, axis) in enumerate(zip(schedule.axes, axes, strict=True)):
        if not axis.compensate:
            continue
        cost = next((one for one in schedule.compensations if one.axis == pulses.name), Compensation(axis.name, ()))
        windows = np.array(cost.windows).reshape(-1, 2).T
        slope = axis.axis_ratio
        travel = max(float(speeds[k]), cost.speed) * axis.motor_ratio / schedule.clock_hz
        bound = slope * (pulses.bound + (travel + cost.unturned) / axis.pulse)
        start = pulses.start * axis.pulse
        mechanics = MechanicsStandard(axis, start, bound, slope * cost.off * axis.motor_ratio / axis.pulse, windows)
        mechanics.place = float(mechanics.carry(np.array([float(pulses.start)]))[0])
        yield Search(
            schedule, k, planned, np.union1d(grid, windows.ravel().clip(0.0, planned.duration)), pulses.start, mechanics
        )


SHORTENED_SHARE = 1e-3  # of the interval of a stated rate, which whole ticks may shorten by less
INTERVAL_ROUNDING = 1e-9  # ticks


@dataclass(frozen=True, slots=True)
class Gaps:
    """Least times (s) of an axis: from a pulse to the next, and to the next the other way; from 0 to the first.

    1/max_pulse_rate, 1/max_rate and high + low of its drive, whichever is longest; for a reversal DIR has to have held
    after the one pulse and be set up before the other.
    """

    one: float
    other: float
    first: float

    @classmethod
    def from_axis(cls, axis: Axis) -> "Gaps":
        rates = [axis.max_pulse_rate or inf]
        levels = turn = first = 0.0
        if (drive := axis.timing) is not None:
            rates.append(drive.max_rate or inf)
            levels, turn = drive.high + drive.low, max(drive.high, drive.hold) + drive.setup
            first = drive.setup
        one = max(levels, (1 - SHORTENED_SHARE) / min(rates))
        return cls(one, max(one, turn), first)

    def check(self, search: Search, ticks: Ticks, direction: Signs, way: int) -> None:
        """Report those of the next pulses (N,) that come too soon; way: of the pulse before them, 0 for none."""
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


BLOCK_PULSES = 1 << 13  # pulses gone through together: their arrays stay in the processor's cache
GRID_INSTANTS = 8  # instants per knot interval besides the pulses' own


def check(
    schedule: PulseSchedule,
    trajectory: AxesMotion,
    machine_axes: Sequence[Axis] | None = None,
    home_q: ArrayLike | None = None,
) -> PulseCheck:
    """Prove that every axis keeps to what its schedule states of it, and that it is of this motion.

    With x = (q - home)/pulse:
    - Under "nearest", "floor" and "timer" each pulse is at the true crossing of its level, to half a tick (of the
      timer's clock), and goes the motion's way; between pulses x crosses none, to the travel in that time. Hysteresis
      is part of the level. Under "sampled" and "dda" each pulse is at the look or listed step that asks for it.
    - Pulses that the drive's timing moved are as many as stated, and no farther from there than stated; near
      them, a pair whose excursion is below the bound's widening is not missed.
    - |count - x| ≤ bound + one tick's travel before, between and after the pulses. Between the samples too: an interval
      δ is halved until x is monotone in it, or max|count - x| + max|ẍ| δ²/8 is within the bound, with the motion's jerk
      taken to be largest at the ends of intervals (an eighth of a knot interval, or less).
    - No pulse comes sooner after another than its axis' pulse rate and its drive take it, where machine_axes are given,
      the other way neither (`planner.pulses.checking.check`).
    - The ticks rise; the start and final counts are the motion's, and so is the duration.
    - Names, pulses and homes are the machine's, where machine_axes and home_q (n,) are given.
    - Where the motion is that of motors which make up for play and screws, and machine_axes are given, the counts are
      carried through both, and the axes are where they are planned (`planner.pulses.checking.check`).
    Another rule, or another bound than the rule's, is held to its bound alone. Positions are trusted to 64 roundings of
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
    """The same of parts that follow each other in time, in memory for one: `stated` says all but their pulses."""
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if width != len(stated.axes):
        raise MotionError(f"the schedule has {len(stated.axes)} axes, the motion {width}; check it against its own")
    grid = _make_grid(trajectory)
    searches = [
        Search(stated, k, trajectory, grid, stated.axes[k].start, find_standard(stated, k, trajectory))
        for k in range(width)
    ]
    carried: dict[int, Search] = {}
    if isinstance(trajectory, MotorMotion) and machine_axes is not None:
        carried = {search.k: search for search in search_behind(stated, trajectory.planned, machine_axes, grid)}
    gaps = [None] * width if machine_axes is None else [Gaps.from_axis(axis) for axis in machine_axes]
    for search in searches:
        _check_identity(search, machine_axes, home_q)
    for part in parts:
        for search, axis, gap in zip(searches, part.axes, gaps, strict=True):
            _check_part(search, carried.get(search.k), axis, gap)
    return PulseCheck(tuple(_conclude(search, carried.get(search.k)) for search in searches))


def _make_grid(motion: AxesMotion) -> Array:
    """Instants that see every knot from both sides, and each interval inside."""
    lo, hi = motion.knots[:-1], motion.knots[1:]
    inside = lo[:, None] + (hi - lo)[:, None] * np.arange(GRID_INSTANTS) / GRID_INSTANTS
    throughout = np.linspace(0.0, motion.duration, 64 * GRID_INSTANTS + 1)
    return np.unique(np.concatenate((inside.ravel(), np.nextafter(hi, lo), throughout)))


def _check_part(search: Search, carried: Search | None, part: AxisPulses, gaps: Gaps | None) -> None:
    """Go through the pulses of a part, block by block."""
    _check_order(search, part, gaps)
    done = search.pulses - len(part)
    for lo in range(0, len(part) if search.is_ordered else 0, BLOCK_PULSES):
        ticks, direction = part.ticks[lo : lo + BLOCK_PULSES], part.direction[lo : lo + BLOCK_PULSES]
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
    _check_end(search, "start count", 0.0, search.axis.start)
    final_error = _check_end(search, "final count", search.motion.duration, search.count)
    figures = time_error, search.position_error, search.closest * search.tick, final_error
    found = AxisCheck(search.axis.name, search.pulses, *figures, tuple(search.faults), search.kinds.total())
    if carried is None or not isinstance(carried.standard, MechanicsStandard):
        return found
    faults = tuple(replace(fault, what=f"behind play and screw, {fault.what}") for fault in carried.faults)
    return replace(
        found,
        behind=carried.standard.largest if search.is_ordered else np.inf,
        faults=found.faults + faults,
        fault_count=found.fault_count + carried.kinds.total(),
    )


def _check_identity(search: Search, machine_axes: Sequence[Axis] | None, home_q: ArrayLike | None) -> None:
    """The schedule is of this motion, and of this machine."""
    axis, nowhere = search.axis, np.zeros(1, np.int64)
    late = search.schedule.duration - search.motion.duration
    if not abs(late) <= search.tick:
        search.report("duration", nowhere, "{:+.9g} s from the motion's", np.array([late]))
    if machine_axes is not None:
        given = machine_axes[search.k]
        if axis.name != given.name:
            search.report(f"name: the machine's axis is {given.name}", nowhere, "{:.0f}", np.array([search.k + 1]))
        if axis.pulse != given.pulse:
            search.report("pulse", nowhere, "{:.9g} times the machine's", np.array([axis.pulse / given.pulse]))
    if home_q is not None:
        off = axis.home - float(np.asarray(home_q, float)[search.k])
        if abs(off) > X_ROUNDING * abs(axis.home):
            search.report("home", nowhere, "{:+.9g} from the machine's", np.array([off]))


def _check_order(search: Search, part: AxisPulses, gaps: Gaps | None) -> None:
    """The ticks rise, from 0 to the end, as far apart as the axis takes them, and every direction is one."""
    way = search.way
    last = search.motion.duration / search.tick
    for lo in range(0, len(part), BLOCK_PULSES):
        ticks, direction = part.ticks[lo : lo + BLOCK_PULSES], part.direction[lo : lo + BLOCK_PULSES]
        steps = np.diff(ticks) if search.latest is None else np.diff(ticks, prepend=search.latest)
        back = np.flatnonzero(steps <= 0)
        search.report("order", ticks[back + len(ticks) - len(steps)], "{} ticks after the pulse before it", steps[back])
        outside = ticks[(ticks < 0) | (ticks > last + HALF_TICK)]
        search.report("outside", outside, "the motion ends at tick {:.1f}", np.full(len(outside), last))
        neither = abs(direction) != 1
        search.report("direction", ticks[neither], "{} is neither +1 nor -1", direction[neither])
        if gaps is not None:
            gaps.check(search, ticks, direction, way)
        way = int(direction[-1])
        search.closest = min(search.closest, float(steps.min()) if len(steps) else np.inf)
        search.latest, search.pulses = int(ticks[-1]), search.pulses + len(ticks)


def _check_motion(search: Search, ticks: Ticks, direction: Signs, first: int) -> None:
    """The next pulses (N,), and all that lies ahead of the last; without pulses, the rest of the motion."""
    # A pulse that rounding put up to half a tick behind the end of the motion is seen at the end.
    fires = np.minimum(ticks / search.schedule.clock_hz, search.motion.duration)
    ahead = int(np.searchsorted(search.grid, fires[-1], side="right")) if len(fires) else len(search.grid)
    between, search.grid = search.grid[:ahead], search.grid[ahead:]
    t = np.concatenate((between, fires))
    order = np.argsort(t, kind="stable")  # a grid instant at a pulse comes first: it sees the count before
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
        search.report("moved", nowhere, f"{{:.0f}} pulses are off their crossing, {stated} stated", np.array([least]))


def _check_end(search: Search, kind: str, t: float, count: int) -> float:
    """The count at one end of the motion: 0 where it is right, else by how many pulses it is not."""
    end = search.sample(np.array([t]), np.array([float(count)]), np.array([0.0 if t == 0 else float(search.way)]))
    error = count - end.x
    allowed = search.noise(end) + end.travel(search.standard.wait * search.tick)
    below, above = search.standard.begins if t == 0 else (np.inf, np.inf)
    inside = -below - allowed[0] <= -error[0] <= above + allowed[0]
    if inside and search.excess(end)[0] <= allowed[0]:
        return 0.0
    search.report(kind, np.rint(end.t / search.tick), "{:+.6g} pulses from the motion", error)
    return float(error[0])
