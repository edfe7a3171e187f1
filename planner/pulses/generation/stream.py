"""The pulses of a motion part by part: joined they are those of the whole, and memory is bounded by
the part.

Each part's time begins at 0; ticks count from the start of the whole. The sum of the parts'
durations is kept exactly, as a fraction: no rounding drifts, however many parts there are. What the
next part may still change, a pulse that has to be moved apart from one behind the seam or cancels
with it, is held back and given with it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial
from math import floor
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.parallel import Progress, ignore_progress
from planner.place import Infeasible, Place
from planner.pulses.compensation.compensate import MotorsAhead, merge_costs
from planner.pulses.generation.firing_rule import Rule, describe_rule
from planner.pulses.generation.levels import cancel_pairs
from planner.pulses.generation.motion_parts import (
    TICK_BITS,
    JoinedMotion,
    MotionPart,
    MotionSpan,
    PieceMotion,
    refuse_long,
)
from planner.pulses.generation.pieces import FIT_TOLERANCE
from planner.pulses.generation.sent import SentPulses, go_on
from planner.pulses.generation.spacing import HeldPulses, LeastGaps, Spaced, space_pulses
from planner.pulses.generation.start_stop import Pace, begin_pace, follow_pulses, interval_at
from planner.pulses.motion import AxesMotion, MotorMotion
from planner.pulses.schedule import (
    AxisPulses,
    Compensation,
    MovedPulses,
    PulseSchedule,
    refuse_counter,
)
from planner.trajectory import Trajectory

# Pulses by which counts may be off where a motion goes on behind another's: they were moved by half
# of one at most, and the other half is left to how two motions differ.
MAX_SLIP = 1.0


class CountedMachine(Protocol):
    """What pulses are made for: axes, and the positions (n,) from which they count."""

    @property
    def axes(self) -> Sequence[Axis]: ...
    @property
    def home_q(self) -> Array: ...


@dataclass(frozen=True, slots=True)
class _Reached:
    """Where a stream stands: what the next part goes on from.

    tick    where it begins, in ticks; s: path length there
    counts  of the axes up to there; ways: of the last pulse of each; noise: m or rad, the largest
            of each
    given   the counts that the pulses given lead to; held: of each axis, the others
    bounds  of the counts, so far; moved: what moving pulses apart cost
    until   tick before which all pulses are given
    tail    the motion from there on
    ended   the motion ended: nothing follows
    ahead   of a machine that makes up for its play or screws: what its motors do not know yet
    costs   of that, so far
    """

    held: tuple[HeldPulses, ...]
    moved: tuple[MovedPulses | None, ...]
    bounds: tuple[float, ...]
    tick: Fraction = Fraction(0)
    s: float = 0.0
    counts: tuple[int, ...] = ()
    ways: tuple[int, ...] = ()
    noise: tuple[float, ...] = ()
    given: tuple[int, ...] = ()
    until: int = 0
    tail: PieceMotion | None = None
    ended: bool = False
    ahead: MotorsAhead = field(default_factory=MotorsAhead)
    costs: tuple[Compensation, ...] = ()


class PulseStream:
    """The pulses of a motion that comes in parts, by a firing rule, on a clock of whole ticks.

    A part goes on where the one before ended, with a time and, if it likes, a path length that
    begin at 0 again. The first goes on behind what another motion sent, if anything.
    """

    __slots__ = ("_clock_hz", "_gaps", "_machine", "_paces", "_reached", "_rule")

    def __init__(
        self, machine: CountedMachine, clock_hz: int, rule: Rule, sent: Sequence[SentPulses] = ()
    ) -> None:
        """Raises MotionError for a clock that the rule cannot run on."""
        self._machine, self._clock_hz, self._rule = machine, clock_hz, rule
        grain = rule.grain(clock_hz)
        self._gaps = tuple(LeastGaps.from_axis(axis, clock_hz, grain) for axis in machine.axes)
        self._paces: tuple[Pace, ...] | None = None
        none = HeldPulses(np.empty(0, np.int64), np.empty(0, np.int8))
        width = len(machine.axes)
        reached = _Reached((none,) * width, (None,) * width, (0.0,) * width)
        if sent:
            last, counts = [one.last for one in sent], tuple(one.count for one in sent)
            reached = replace(
                reached, held=tuple(replace(none, given=one) for one in last), given=counts
            )
            if (
                not rule.whole_reason
            ):  # else it begins anew: that asks for the count beside the one sent, at most
                ways = tuple(0 if one is None else one.direction for one in last)
                reached = replace(reached, counts=counts, ways=ways)
        self._reached = reached

    @property
    def until(self) -> int:
        """The tick before which all pulses have been given: what follows changes nothing there."""
        return self._reached.until

    def copy(self) -> "PulseStream":
        """Another stream that stands where this one does: for the pulses of a stop that the next
        part replaces.
        """
        made = PulseStream(self._machine, self._clock_hz, self._rule)
        made._reached, made._paces = self._reached, self._paces
        return made

    def add(
        self, motion: AxesMotion, last: bool = False, progress: Progress = ignore_progress
    ) -> PulseSchedule:
        """The pulses of the next part of the motion, as far as they are final, with those held back
        before.

        Ticks and the duration, which is where the part ends, count from the start of the whole;
        start counts are those reached by the pulses given before; bound and cost are those up to
        now. last: the motion ends with the part. Raises Infeasible where the rule cannot keep what
        it states, as where an axis would need more than one pulse per tick, with the place on the
        whole; MotionError for a part that does not go on from the one before, and for a rule that
        makes no pulses of parts. The stream then stands where it stood.
        """
        now, machine = self._reached, self._machine
        if now.ended:
            raise MotionError("the motion has ended: begin another stream for another motion")
        if motion.duration * self._clock_hz > 2.0 ** (
            TICK_BITS - 1
        ):  # up to there none is too long
            refuse_long(motion.duration, self._clock_hz)
        along = motion.at(np.array([0.0, motion.duration])).s
        offset, home = now.s - float(along[0]), np.asarray(machine.home_q, float)
        slip = MAX_SLIP if now.given and not now.tick else 0.0
        part = MotionPart(
            motion,
            machine.axes,
            home,
            self._clock_hz,
            now.tick,
            now.counts,
            now.ways,
            now.noise,
            slip,
            last,
            progress,
        )
        reached = replace(now, tick=part.end_tick, s=offset + float(along[1]), ended=bool(last))
        if any(axis.compensate for axis in machine.axes) and not isinstance(motion, MotorMotion):
            final, reached = self._compensate(part, offset, reached)
            if final is None:  # no more than where they start
                starts = now.given or tuple(axis.start for axis in self._rule.fire(part).axes)
                self._reached = reached
                return self._state(reached, starts)
            part, offset = final, 0.0
        schedule, self._reached = self._fire(part, offset, reached)
        return schedule

    def _compensate(
        self, part: MotionPart, offset: float, reached: _Reached
    ) -> tuple[MotionPart | None, _Reached]:
        """What the motors do, as far as that is final, with path lengths of the whole; None:
        nothing is.
        """
        now = self._reached
        held = 0.0 if now.ahead.planned is None else now.ahead.planned.duration
        tick = part.tick - Fraction(held) * self._clock_hz
        try:
            made, length, costs, ahead = now.ahead.add(
                part.motion, offset, part.axes, part.home, part.last
            )
        except Infeasible as no:
            raise _place_on_whole(no, replace(part, tick=tick), 0.0, own=True) from None
        tick = reached.tick - Fraction(length) * self._clock_hz
        begin = float(tick / self._clock_hz)
        merged = costs if not now.costs else tuple(map(merge_costs, now.costs, costs))
        merged = tuple(
            replace(one, windows=tuple((begin + lo, begin + hi) for lo, hi in own.windows))
            for one, own in zip(merged, costs, strict=True)
        )
        reached = replace(reached, ahead=ahead, costs=merged)
        return None if made is None else replace(part, motion=made, tick=tick), reached

    def _state(self, reached: _Reached, starts: tuple[int, ...]) -> PulseSchedule:
        """A part without a pulse."""
        none: dict[str, Any] = {"ticks": np.empty(0, np.int64), "direction": np.empty(0, np.int8)}
        home = np.asarray(self._machine.home_q, float)
        axes = tuple(
            AxisPulses(
                axis.name,
                start=count,
                pulse=axis.pulse,
                home=float(q),
                bound=bound + (moved.error if moved else 0.0),
                **none,
            )
            for axis, count, q, bound, moved in zip(
                self._machine.axes, starts, home, reached.bounds, reached.moved, strict=True
            )
        )
        duration, moves = (
            float(reached.tick / self._clock_hz),
            tuple(one for one in reached.moved if one is not None),
        )
        return PulseSchedule(
            self._clock_hz, axes, duration, describe_rule(self._rule), moves, reached.costs
        )

    def _fire(
        self, part: MotionPart, offset: float, reached: _Reached
    ) -> tuple[PulseSchedule, _Reached]:
        """The pulses of what the motors do, as far as they are final; and where the stream stands
        then.
        """
        now, machine, last = self._reached, self._machine, part.last
        try:
            fired = self._rule.fire(part)
        except Infeasible as no:
            raise _place_on_whole(no, part, offset, own=True) from None
        if now.given and part.tick == 0:
            travel = partial(
                _look, part, JoinedMotion.of(MotionSpan(part.motion, 0.0, part.motion.duration))
            )
            each = zip(fired.axes, now.given, self._gaps, strict=True)
            fired = replace(fired, axes=tuple(go_on(k, *one, travel) for k, one in enumerate(each)))
        known = self._join_tail(part, offset)
        end = round(float(part.end_tick)) if last else None
        until = (
            None
            if last
            else max(now.until, floor(part.end_tick) - max(gaps.hold for gaps in self._gaps))
        )
        try:
            spaced = [
                self._space(part, k, fired.axes[k], known, until, end)
                for k in range(len(machine.axes))
            ]
        except Infeasible as no:
            raise _add_motor_remedy(
                _place_on_whole(no, part, offset, own=False), machine.axes
            ) from None
        started = now.given or tuple(axis.start for axis in fired.axes)
        bounds = tuple(
            max(each) for each in zip(now.bounds, (axis.bound for axis in fired.axes), strict=True)
        )
        axes = tuple(
            replace(
                axis,
                ticks=one.ticks,
                direction=one.direction,
                start=count,
                bound=bound + (one.moved.error if one.moved else 0.0),
            )
            for axis, one, count, bound in zip(fired.axes, spaced, started, bounds, strict=True)
        )
        for pulses, axis in zip(axes, machine.axes, strict=True):
            if axis.card is not None:
                refuse_counter(pulses, axis)
        self._paces = self._follow_paces(part, axes)
        moves = tuple(one.moved for one in spaced if one.moved is not None)
        reached = replace(
            reached,
            held=tuple(one.held for one in spaced),
            moved=tuple(one.moved for one in spaced),
            bounds=bounds,
            counts=tuple(axis.final for axis in fired.axes),
            ways=fired.ways,
            noise=fired.noise,
            given=tuple(axis.final for axis in axes),
            until=1 + max((int(axis.ticks[-1]) for axis in axes if len(axis)), default=0)
            if until is None
            else until,
            tail=None if until is None else self._cut_tail(part, known, until),
        )
        rule, duration = (
            fired.rule or describe_rule(self._rule),
            float(reached.tick / self._clock_hz),
        )
        return PulseSchedule(self._clock_hz, axes, duration, rule, moves, reached.costs), reached

    def _follow_paces(
        self, part: MotionPart, pulses: Sequence[AxisPulses]
    ) -> tuple[Pace, ...] | None:
        """Return the paces after these pulses.

        Raise Infeasible where an axis starts or stops too fast.

        A stream that goes on from what another motion sent does not know the paces there: it
        follows none.
        """
        axes = self._machine.axes
        if all(axis.start_stop_rate is None for axis in axes):
            return None
        paces = self._paces
        clock = self._clock_hz
        first, last = part.motion.at(np.array([0.0, part.motion.duration])).qd
        if paces is None:
            if self._reached.given:
                return None
            paces = tuple(
                begin_pace(axis, float(speed), clock)
                for axis, speed in zip(axes, first, strict=True)
            )
        ends = [
            interval_at(axis, float(speed), clock) if part.last else None
            for axis, speed in zip(axes, last, strict=True)
        ]
        return tuple(
            follow_pulses(pace, train, axis, clock, end)
            for pace, train, axis, end in zip(paces, pulses, axes, ends, strict=True)
        )

    def _space(
        self,
        part: MotionPart,
        k: int,
        fired: AxisPulses,
        known: JoinedMotion,
        until: int | None,
        end: int | None,
    ) -> Spaced:
        now, axis = self._reached, self._machine.axes[k]
        ticks = np.concatenate([now.held[k].ticks, fired.ticks])
        direction = np.concatenate([now.held[k].direction, fired.direction])
        if len(now.held[k].ticks):
            begin = float(part.tick / self._clock_hz)
            remedy = "slow the motion, use a longer pulse, or a faster clock"
            place = Place(
                float(known.at(np.array([known.duration - part.motion.duration])).s[0]),
                t=begin,
                axis=axis.name,
            )
            rate = 2.0 * self._clock_hz
            refusal = Infeasible(
                "pulse rate", axis.name, place, rate, self._clock_hz, "1/s", remedy
            )
            ticks, direction = cancel_pairs(ticks, direction, lambda: refusal)
        held = replace(now.held[k], ticks=ticks, direction=direction)
        travel = partial(_look, part, known)
        return space_pulses(
            held,
            k,
            axis,
            self._gaps[k],
            self._clock_hz,
            travel,
            now.moved[k],
            now.until,
            until,
            end,
        )

    def _join_tail(self, part: MotionPart, offset: float) -> JoinedMotion:
        """The motion from where pulses are not given yet to the end of the part; path lengths are
        of the whole.
        """
        tail = self._reached.tail
        here = MotionSpan(part.motion, 0.0, part.motion.duration, offset)
        return (
            JoinedMotion.of(here)
            if tail is None
            else JoinedMotion.of(MotionSpan(tail, 0.0, tail.duration), here)
        )

    def _cut_tail(self, part: MotionPart, known: JoinedMotion, until: int) -> PieceMotion:
        """The last of it, from a tick on."""
        left = float(part.end_tick - until) / self._clock_hz
        rest = JoinedMotion.of(MotionSpan(known, max(0.0, known.duration - left), known.duration))
        return PieceMotion.of(rest, np.array([FIT_TOLERANCE * axis.pulse for axis in part.axes]))


def _place_on_whole(no: Infeasible, part: MotionPart, offset: float, *, own: bool) -> Infeasible:
    """The refusal with its place on the whole, its segment where that is known; own: it is placed
    on the part.
    """
    if no.place is None or no.place.t is None:
        return no
    begin, place = float(part.tick / part.clock_hz), no.place
    own_t, s = (no.place.t, place.s + offset) if own else (no.place.t - begin, place.s)
    motion = part.motion.planned if isinstance(part.motion, MotorMotion) else part.motion
    if isinstance(motion, Trajectory):
        piece = int(motion.at(own_t).piece[0])
        place = motion.path.place(s, piece, None, place.axis)
    placed = replace(place, s=s, t=own_t + begin)
    return replace(no, place=placed)


def _look(part: MotionPart, known: JoinedMotion, k: int, ticks: ArrayLike) -> tuple[Array, Array]:
    """Where an axis is at ticks of the whole (N,), in pulses, and the path length."""
    begin, rest = part.split_tick()
    t = (np.asarray(ticks) - begin - rest) / part.clock_hz + (known.duration - part.motion.duration)
    state = known.at(np.clip(t, 0.0, known.duration))
    return state.q[:, k] / part.axes[k].pulse, state.s


def _add_motor_remedy(no: Infeasible, axes: Sequence[Axis]) -> Infeasible:
    """A refusal of spacing; of an axis that makes up for its screw it says so: a plan keeps the
    rate of the motor.
    """
    made_up = next((axis.compensate for axis in axes if axis.name == no.axis), ())
    if not made_up:
        return no
    remedy = (
        f"that is with {' and '.join(made_up)} made up for: {no.remedy}; or let planner.plan make the motion, which "
        "keeps the rate of the motor behind its screw"
    )
    return replace(no, stated_remedy=remedy)
