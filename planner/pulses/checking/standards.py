"""What the check holds each firing rule to: written down again from what the rules state, without
their code.

Crossings of evenly spaced levels: of half a pulse, of whole counts, with hysteresis or not. Bursts
of a digital differential analyser between listed points of the motion. Looks at the motion at even
times, at each one pulse towards it where it is more than half a pulse away. And pulses of which
nothing is known but by how much their count may be from the motion.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.machine.axis import Axis
from planner.pulses.checking.search import (
    HALF_TICK,
    Samples,
    Search,
    Standard,
    check_band,
    find_reversals,
)
from planner.pulses.motion import AxesMotion, apply_play, apply_screw
from planner.pulses.schedule import Compensation, PulseSchedule, Ticks

MOVED_INSTANTS = 33  # instants about a pulse that was moved for its drive


@dataclass(frozen=True, slots=True)
class Crossings(Standard):
    """A pulse wherever x crosses k + above, on the nearest whole `grain` of ticks; between pulses x
    crosses none.

    hysteresis  pulses: the first pulse after one the other way, and the very first, is so far
                beyond its level
    """

    above: float
    hysteresis: float = 0.0
    grain: int = 1

    @property
    def wait(self) -> float:
        return (
            HALF_TICK * self.grain if self.grain == 1 else float(self.grain)
        )  # the last may be cut to the end

    @property
    def begins(self) -> tuple[float, float]:
        return 1 - self.above, self.above

    def sides(self, search: Search, s: Samples) -> tuple[Array, Array]:
        below, above = (
            np.where(s.way >= 0, self.hysteresis, 0.0),
            np.where(s.way <= 0, self.hysteresis, 0.0),
        )
        return below + (1 - self.above + search.extra_bound), above + (
            self.above + search.extra_bound
        )

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        """Each pulse at the crossing of the level between its two counts, going its way, on an axis
        that moves.
        """
        tick, noise = search.tick, search.noise(s)
        beyond = sign * self.hysteresis * find_reversals(sign, search.way)
        level = s.count - (1 + sign) / 2 + self.above + beyond
        miss = level - s.x
        miss = np.sign(miss) * np.maximum(abs(miss) - noise, 0.0)
        # The nearer root of v τ + a τ²/2 = miss: how long after the sample x is at the level.
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(np.maximum(s.v**2 + 2 * s.a * miss, 0.0))
            wait = np.where(miss == 0, 0.0, 2 * miss / (s.v + np.copysign(root, s.v)))
        error = (ticks * tick - s.t - wait) / tick
        error[np.isnan(error)] = np.inf
        tolerance = np.full(len(ticks), HALF_TICK * self.grain)
        if self.grain > 1:
            final = search.motion.duration / tick // self.grain * self.grain
            tolerance[ticks == final] = self.grain * (1 + 1e-3)
            error[ticks % self.grain != 0] = np.inf  # the timer's clock has no such tick
        near = np.zeros(len(ticks), bool)
        late = np.flatnonzero(abs(error) > tolerance)
        if search.shift and len(late) <= sum(one.pulses for one in search.schedule.moves):
            near[late] = self._comes_near(search, ticks[late], level[late])
        search.due(ticks, error, tolerance, near)
        kept = ~near
        told = abs(miss) - s.travel(self.grain * tick) - search.extra_bound * near
        search.position_error = max(search.position_error, float(told.max(initial=0.0)))
        astray = kept & (
            sign * s.v < -(abs(s.a) * tick + abs(s.j) * tick**2) * self.grain - noise / tick
        )
        search.report(
            "against the motion", ticks[astray], "x moves at {:+.4g} pulses/s", s.v[astray]
        )
        still = np.flatnonzero(kept & (s.v == 0))
        around = np.concatenate((s.t[still] - tick, s.t[still] + tick)).clip(
            0.0, search.motion.duration
        )
        resting = still[(search.at(around).v.reshape(2, -1) == 0).all(axis=0)]
        search.report("at rest", ticks[resting], "the axis stands still at {:.9g} s", s.t[resting])

    def _comes_near(self, search: Search, ticks: Ticks, level: Array) -> np.ndarray:
        """(N,) whether x comes by the level within the largest shift that is stated for the
        axis.
        """
        reach = search.shift + HALF_TICK * self.grain
        t = ((ticks + np.linspace(-reach, reach, MOVED_INSTANTS)[:, None]) * search.tick).clip(
            0.0, search.motion.duration
        )
        s = search.at(t.ravel())
        x, blur = (each.reshape(t.shape) for each in (s.x, search.noise(s)))
        near: np.ndarray = (x.min(axis=0) - blur[0] <= level) & (level <= x.max(axis=0) + blur[0])
        return near


@dataclass(frozen=True, slots=True)
class BurstStandard(Standard):
    """Bursts of `size` pulses at a rate (1/s), each of one direction.

    Of the c counts of an axis in a move of k steps, the n-th is sent at step ⌈(n·k - 1)/c⌉ of 1 … k
    (k = 1: at the one), and the steps share the time between two listed points evenly. began (B,)
    s, sign (B,): of all bursts of the axis, as the motion at the listed points asks for them
    """

    size: int
    rate: float
    began: Array
    sign: Array

    @classmethod
    def from_motion(
        cls,
        motion: AxesMotion,
        k: int,
        schedule: PulseSchedule,
        spacing: float,
        size: int,
        rate: float,
    ) -> "BurstStandard":
        moves = max(1, int(np.ceil(motion.duration / spacing)))
        gap = motion.duration / moves
        listed = motion.at(np.minimum(np.arange(moves + 1) * gap, motion.duration)).q
        pulse, home = (
            np.array([getattr(axis, name) for axis in schedule.axes]) for name in ("pulse", "home")
        )
        x = (listed - home) / pulse
        counts = np.diff(np.rint((x - x[0]) / size).astype(np.int64), axis=0)
        steps, own = abs(counts).max(axis=1), abs(counts[:, k])
        move = np.repeat(np.arange(moves), own)
        nth = np.arange(len(move)) - np.repeat(np.cumsum(own) - own, own) + 1
        step = -(-(nth * steps[move] - (steps[move] > 1)) // own[move])
        began = (move + (step - 1) / steps[move]) * gap
        return cls(size, rate, freeze_array(began), freeze_array(np.sign(counts[move, k])))

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        check_band(search, s)
        check_band(search, replace(s, count=s.count - sign))
        burst, nth = np.divmod(first + np.arange(len(ticks)), self.size)
        known = burst < len(self.began)
        burst = np.minimum(burst, len(self.began) - 1)
        error = np.full(len(ticks), np.inf)
        if known.any():
            due = (self.began[burst] + nth / self.rate) / search.tick
            error[known] = (ticks - due)[known]
            wrong = known & (sign != self.sign[burst])
            search.report(
                "against the motion",
                ticks[wrong],
                "its listed points ask for {:+.0f}",
                self.sign[burst][wrong],
            )
        near = abs(error) <= search.shift + HALF_TICK
        search.due(ticks, error, np.full(len(ticks), HALF_TICK), near)

    def conclude(self, search: Search) -> None:
        missing = len(self.began) * self.size - search.pulses
        if missing:
            end = np.array([search.motion.duration / search.tick])
            search.report(
                "pulses",
                np.rint(end),
                "{:.0f} fewer than its listed points ask for",
                np.array([missing]),
            )


BLOCK_LOOKS = 1 << 15  # looks gone through together


@dataclass(frozen=True, slots=True)
class PeriodStandard(Standard):
    """Every pulse at a look, towards x, which is ½ or more from the count; after each look it is no
    farther than ½.

    Looks are a period (ticks) apart, and the last at the end of the motion. With those two there is
    no other schedule, but where x is half-way to rounding. Pulses that were moved apart are late
    for as many looks as their largest shift holds, at most; within that number another pulse may be
    late unseen.
    """

    period: int

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        before = replace(s, count=s.count - sign)
        check_band(search, s)
        check_band(search, before)
        offset = round(search.motion.duration / search.tick) % self.period
        error = (ticks - offset + self.period // 2) % self.period - self.period // 2
        far = sign * (s.x - before.count)
        asked = far >= 0.5 - search.noise(s)
        early = search.shift > 0 and far >= 0.5 - search.noise(s) - search.extra_bound
        needless = ~(asked | early)
        search.report(
            "not asked for", ticks[needless], "x is {:+.6g} pulses on its way", far[needless]
        )
        # by whole periods, too, a pulse may have been moved to before it was asked for
        off = np.where((error == 0) & ~asked & early, self.period, error).astype(float)
        search.due(ticks, off, np.full(len(ticks), HALF_TICK), early | (abs(off) <= search.shift))
        until = int(ticks[-1]) if len(ticks) else round(search.motion.duration / search.tick)
        self._check_looks(search, ticks, sign, until, offset)

    def conclude(self, search: Search) -> None:
        """No more looks found x farther than ½ than those that moved pulses were late for."""
        stated = sum(one.pulses for one in search.schedule.moves if one.axis == search.axis.name)
        late = search.moved[1] - search.moved[0]
        if late > stated * (search.shift // self.period + 1):
            search.report("late at looks", np.zeros(1, np.int64), "{:.0f} in all", np.array([late]))

    def _check_looks(
        self, search: Search, ticks: Ticks, sign: Array, until: int, offset: int
    ) -> None:
        """After every look since the pulses before, up to a tick, x is at most ½ from the count."""
        counts = search.count + np.concatenate(([0.0], np.cumsum(sign)))
        begin = -(-(search.seen - offset) // self.period) * self.period + offset
        for lo in range(begin, until + 1, self.period * BLOCK_LOOKS):
            looks = np.arange(lo, min(lo + self.period * BLOCK_LOOKS, until + 1), self.period)
            s = search.at((looks * search.tick).clip(0.0, search.motion.duration))
            away = abs(s.x - counts[np.searchsorted(ticks, looks, side="right")])
            late = ~(away <= 0.5 + search.noise(s))
            # a pulse that was moved may be due at the look, and come after
            far = late & ~(
                (search.shift > 0)
                & (away <= search.axis.bound + s.travel(search.tick) + search.noise(s))
            )
            search.report("late at a look", looks[far], "{:.6g} pulses away", away[far])
            least, most = search.moved
            search.moved = least, most + int((late & ~far).sum())
        search.seen = until + 1


class BoundStandard(Standard):
    """|count - x| ≤ bound + one tick's travel; a pulse against the motion brings the count nearer
    to it.
    """

    @property
    def exact(self) -> bool:
        return False

    def judge(self, search: Search, ticks: Ticks, sign: Array, s: Samples, first: int) -> None:
        check_band(search, s)
        before = replace(s, count=s.count - sign)
        check_band(search, before)
        away = sign * (s.x - before.count) < 0.5 - search.noise(s)
        astray = away & (sign * s.v < -(abs(s.a) * search.tick) - search.noise(s) / search.tick)
        search.report(
            "against the motion", ticks[astray], "x moves at {:+.4g} pulses/s", s.v[astray]
        )


INSTANT_BLOCK = 1 << 14  # instants looked at together


@dataclass(slots=True)
class MechanicsStandard(Standard):
    """An axis behind what its pulses make up for: place = screw(play(count·pulse)), in pulses from
    home.

    |place - x| ≤ s (bound + one tick's travel of the motor + what turned nothing), and s·off more in the windows of
    time that are stated for crossing the play; s is the steepest slope of the screw. The play
    operator makes no
    difference between two motors larger than it is. Play or screw that is not made up for was not
    asked to be.
    Independent of how they were made up for: beside `off`, its windows and the farthest run back
    that turns nothing,
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
        return (
            apply_screw(motor, self.axis) if "lead" in self.axis.compensate else motor
        ) / self.axis.pulse

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


def search_behind(
    schedule: PulseSchedule, planned: AxesMotion, axes: Sequence[Axis], grid: Array
) -> Iterator[Search]:
    """A search for each axis that makes up for something, on the planned motion of the axes; grid
    (s) to look at.
    """
    speeds = np.max(
        [
            abs(planned.at(grid[lo : lo + INSTANT_BLOCK]).qd).max(axis=0)
            for lo in range(0, len(grid), INSTANT_BLOCK)
        ],
        axis=0,
    )
    for k, (pulses, axis) in enumerate(zip(schedule.axes, axes, strict=True)):
        if not axis.compensate:
            continue
        cost = next(
            (one for one in schedule.compensations if one.axis == pulses.name),
            Compensation(axis.name, ()),
        )
        windows = np.array(cost.windows).reshape(-1, 2).T
        slope = axis.axis_ratio
        travel = max(float(speeds[k]), cost.speed) * axis.motor_ratio / schedule.clock_hz
        bound = slope * (pulses.bound + (travel + cost.unturned) / axis.pulse)
        start = pulses.start * axis.pulse
        mechanics = MechanicsStandard(
            axis, start, bound, slope * cost.off * axis.motor_ratio / axis.pulse, windows
        )
        mechanics.place = float(mechanics.carry(np.array([float(pulses.start)]))[0])
        yield Search(
            schedule,
            k,
            planned,
            np.union1d(grid, windows.ravel().clip(0.0, planned.duration)),
            pulses.start,
            mechanics,
        )


REACHED_SHARE = 0.002  # pulses before a whole count where `floor` counts it as reached
SAMPLED_PERIOD, TIMER_RATE = (
    2e-5,
    2e6,
)  # s and 1/s: what `sampled` and `timer` do where they state nothing else
DDA_SPACING, DDA_COUNT = 1e-2, 50  # and `dda`: s and pulses; it always states its rate
BOUND_TOLERANCE = 1e-9  # of a bound


def find_standard(schedule: PulseSchedule, k: int, motion: AxesMotion) -> Standard:
    """What axis k of a schedule is held to: its rule where its bound is the rule's, else its bound
    alone.
    """
    name, _, rest = schedule.rule.partition(":")
    try:
        pairs = (part.partition("=") for part in rest.split(",") if part)
        stated = {key.strip(): float(value.strip().partition(" ")[0]) for key, _, value in pairs}
    except ValueError:  # not as schedules state their rules: a number in SI, a space, its unit
        return BoundStandard()
    axis = schedule.axes[k]
    bound = axis.bound - sum(one.error for one in schedule.moves if one.axis == axis.name)
    if name == "nearest":
        late = stated.get("hysteresis", 0.0)
        if abs(bound - 0.5 - late) <= BOUND_TOLERANCE:
            return Crossings(0.5, late)
    if name == "floor" and abs(bound - 1 + REACHED_SHARE) <= BOUND_TOLERANCE:
        return Crossings(1 - REACHED_SHARE)
    if name == "timer" and not stated.get("step") and bound >= 0.5:
        return Crossings(0.5, grain=round(schedule.clock_hz / stated.get("clock", TIMER_RATE)))
    if name == "sampled" and bound >= 0.5:
        return PeriodStandard(round(stated.get("period", SAMPLED_PERIOD) * schedule.clock_hz))
    if name == "dda" and bound >= 0.5 and "rate" in stated:
        count = round(stated.get("pulses_per_count", DDA_COUNT))
        return BurstStandard.from_motion(
            motion, k, schedule, stated.get("spacing", DDA_SPACING), count, stated["rate"]
        )
    return BoundStandard()
