"""From a motion to pulses: a firing rule at work, and the rules by name.

Pulses closer together than their axis takes are moved apart, by the least that does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation import names
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import read_options, split_options
from kinematics.foundation.units import round_up_digits
from kinematics.machine.axis import Axis, ceil_ticks, directional_bounds
from planner.parallel import Progress, ignore_progress
from planner.place import Infeasible, Place
from planner.pulses.compensation.compensate import CompensatedMotion, counted_motion
from planner.pulses.generation.dda import Dda
from planner.pulses.generation.firing_rule import Floor, Nearest, Rule
from planner.pulses.generation.sampled import Sampled
from planner.pulses.generation.timer import Timer
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, MovedPulses, PulseSchedule, Ticks, refuse_counter

RULES: dict[str, type[Rule]] = {
    "nearest": Nearest,
    "floor": Floor,
    "sampled": Sampled,
    "dda": Dda,
    "timer": Timer,
}
"""By name; each is made without arguments as the default of its kind."""


def find_rule(text: str) -> Rule:
    """The rule of a name, or of a name and options: "sampled", "sampled:period=50us", "dda:spacing=2ms,rate=200kHz".

    Raises MotionError for an unknown name or option, with the nearest, and for a value that the rule refuses.
    """
    name, given = split_options(text, "firing rule")
    if name not in RULES:
        raise MotionError(f'unknown firing rule "{name}"{names.nearest(name, RULES)}; rules: {", ".join(RULES)}')
    return RULES[name](**read_options(RULES[name], given, f"firing rule {name}"))


__all__ = ["RULES", "Dda", "Floor", "Nearest", "Rule", "Sampled", "Timer", "find_rule"]


# Pulses by which moving may widen a count's bound; what needs more is no matter of a few ticks.
MAX_WIDENING = 0.5
# Instants looked at between where a pulse was and where it goes: the motion may turn there.
TRAVEL_INSTANTS = 9


# s from a pulse to the next one the other way of an axis that states a speed alone: a STEP of 2 µs, and a low as long.
DEFAULT_REVERSAL_GAP = 4e-6


def space_pulses(schedule: PulseSchedule, motion: AxesMotion, axes: Sequence[Axis], grain: int = 1) -> PulseSchedule:
    """The schedule with the pulses of every axis as far apart as its pulse rate and its `timing` ask.

    Those the other way may have to be farther; where an axis states a speed alone, these are 4 µs apart, or as pulses
    at that speed are. grain: ticks, of which all pulses of an axis stay whole multiples apart. The largest shift
    is the least possible: with G the sum of the gaps needed up to each pulse and y = t - G, the new y is half-way
    between the largest before and the smallest after, the monotone sequence nearest to y in its worst entry. Raises
    Infeasible where a count would be off by more than half a pulse beyond its bound.
    """
    kept, moves = [], list(schedule.moves)
    for k, (pulses, axis) in enumerate(zip(schedule.axes, axes, strict=True)):
        if not len(pulses):
            kept.append(pulses)
            continue
        ticks = _space_ticks(pulses, axis, schedule, grain)
        late = np.flatnonzero(ticks != pulses.ticks)
        if not len(late):
            kept.append(pulses)
            continue
        error = _motion_travel(motion, k, pulses, ticks[late], late, schedule)
        worst = int(np.argmax(error))
        t = float(pulses.ticks[late[worst]]) / schedule.clock_hz
        if error[worst] > MAX_WIDENING:
            raise _spacing_error(motion, axis, pulses, int(late[worst]), schedule.clock_hz, grain)
        farthest = float(abs(ticks - pulses.ticks).max()) / schedule.clock_hz
        widened = float(error[worst])
        moves.append(MovedPulses(axis.name, len(late), farthest, widened, t, widened * axis.pulse))
        kept.append(replace(pulses, ticks=ticks, bound=pulses.bound + widened))
    return replace(schedule, axes=tuple(kept), moves=tuple(moves))


def _space_ticks(pulses: AxisPulses, axis: Axis, schedule: PulseSchedule, grain: int) -> Ticks:
    gaps, setup = _required_gaps(pulses, axis, schedule.clock_hz, grain)
    if pulses.ticks[0] >= setup and (np.diff(pulses.ticks) >= gaps).all():
        return pulses.ticks
    offset = int(pulses.ticks[0]) % grain
    needed = np.concatenate([[0], np.cumsum(gaps)]) // grain
    free = (pulses.ticks - offset) // grain - needed
    before = np.maximum.accumulate(free)
    after = np.minimum.accumulate(free[::-1])[::-1]
    # before the first pulse DIR is set up, after the end is none
    first = -(-(setup - offset) // grain)
    last = (int(schedule.duration * schedule.clock_hz) - offset) // grain - needed[-1]
    ticks: Ticks = (np.clip((before + after) // 2, first, max(last, first)) + needed) * grain + offset
    return ticks


def _required_gaps(pulses: AxisPulses, axis: Axis, clock_hz: int, grain: int) -> tuple[Ticks, int]:
    """(N-1,) ticks from each pulse to the next, at least; and from the start, when DIR is set, to the first."""
    straight, back = axis.pulse_ticks(clock_hz, grain)
    turns = pulses.direction[1:] != pulses.direction[:-1]
    if axis.max_pulse_rate is None and axis.timing is None and axis.max_speed is not None:
        least = ceil_ticks(min(DEFAULT_REVERSAL_GAP, axis.pulse / max(directional_bounds(axis.max_speed))), clock_hz)
        back = max(back, -(-least // grain) * grain)
    return np.where(turns, back, straight), ceil_ticks(axis.timing.setup, clock_hz) if axis.timing is not None else 0


def _motion_travel(
    motion: AxesMotion, k: int, pulses: AxisPulses, ticks: Ticks, which: np.ndarray, schedule: PulseSchedule
) -> Array:
    """(N,) pulses that the motion runs from where the chosen pulses were to where they go."""
    old, new = pulses.ticks[which], ticks
    share = np.linspace(0.0, 1.0, TRAVEL_INSTANTS)
    t = np.minimum((old + (new - old) * share[:, None]) / schedule.clock_hz, motion.duration)
    x = motion.at(t.ravel()).q[:, k].reshape(t.shape) / pulses.pulse
    travel: Array = abs(x - x[0]).max(axis=0)
    return travel


def _spacing_error(
    motion: AxesMotion, axis: Axis, pulses: AxisPulses, which: int, clock_hz: int, grain: int
) -> Infeasible:
    """What an axis cannot take: where, how fast, and what it would."""
    # of the times up to each pulse, the first from when DIR is set, the one too short that is nearest to the one moved
    gaps, setup = _required_gaps(pulses, axis, clock_hz, grain)
    turns = np.concatenate([[False], pulses.direction[1:] != pulses.direction[:-1]])
    had, needed = np.diff(pulses.ticks, prepend=0), np.concatenate([[setup], gaps])
    short = np.flatnonzero(had < needed)
    first = int(short[np.argmin(abs(short - which))])
    t, time, least = float(pulses.ticks[first]) / clock_hz, had[first] / clock_hz, needed[first] / clock_hz
    place = Place(float(motion.at(np.array([min(t, motion.duration)])).s[0]), t=t, axis=axis.name)
    who = "it" if axis.timing is None else "its drive"
    what, limit = "pulse rate" if axis.timing is None else "drive timing", 1 / least
    if first == 0:
        what = "direction set-up before the first pulse"
        remedy = (
            f"its drive needs DIR {1e6 * least:.4g} us before STEP, and the first pulse is due after "
            f"{1e6 * time:.4g}: let the program begin with a dwell of {round_up_digits(least - time + 1 / clock_hz)} s"
        )
    elif turns[first]:
        what += " at a reversal"
        remedy = (
            f"{who} needs {1e6 * least:.4g} us between opposite pulses: let the axis "
            f"rest there for {round_up_digits(least)} s (a dwell), use a longer pulse, or hysteresis at reversals "
            '(rule "nearest:hysteresis=0.2")'
        )
    else:
        limit = min(limit, axis.pulse_rate)
        remedy = (
            f"{who} takes {limit:.4g} pulses/s one way, so no pulse sooner than {1e6 * least:.4g} us after "
            f"another, and one comes after {1e6 * time:.4g}: "
            f"slow the motion there to {100 * time / least:.4g} % or less, "
            f"use a pulse {round_up_digits(least / max(time, 1 / clock_hz))} times as long, or a rule "
            "that fires no faster"
        )
    return Infeasible(what, axis.name, place, 1 / max(time, 1 / clock_hz), limit, "1/s", remedy)


def generate(
    trajectory: AxesMotion,
    machine_axes: Sequence[Axis],
    home_q: ArrayLike,
    clock_hz: int = 10_000_000,
    rule: str | Rule = "nearest",
    progress: Progress = ignore_progress,
) -> PulseSchedule:
    """The pulses of a motion by a firing rule, on a clock of whole ticks, as far apart as the drives' timing asks.

    Axes that ask for compensation count what their motors have to do (`planner.pulses.compensation.compensate`): a
    motion of motors is taken as it is.
    home_q (n,) is the axis position from which pulses count; rule: one, or its name and options as
    `planner.pulses.find_rule` reads them; progress is told how far it is. Raises Infeasible where the rule cannot keep
    what it states, as where an axis would need more than one pulse per tick, MotionError where axes do not match.
    """
    home = np.asarray(home_q, float)
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if not len(machine_axes) == width == home.size:
        given = f"{len(machine_axes)} machine axes, {width} axes of the motion, {home.size} home positions"
        raise MotionError(f"{given}: give one of each per axis")
    rule = find_rule(rule) if isinstance(rule, str) else rule
    motion = trajectory if isinstance(trajectory, CompensatedMotion) else counted_motion(trajectory, machine_axes, home)
    fired = rule.fire(motion, machine_axes, home, clock_hz, progress)
    try:
        schedule = space_pulses(fired, motion, machine_axes, rule.grain(clock_hz))
    except Infeasible as no:
        raise _add_motor_remedy(no, machine_axes) from None
    for pulses, axis in zip(schedule.axes, machine_axes, strict=True):
        if axis.card is not None:
            refuse_counter(pulses, axis)
    return replace(schedule, compensations=motion.costs) if isinstance(motion, CompensatedMotion) else schedule


def pace_axes(axes: Sequence[Axis], clock_hz: int, rule: str | Rule = "nearest") -> tuple[Axis, ...]:
    """The axes with the pulse rates that a motion has to keep, for the rule's pulses to be as far apart as they state.

    Times of pulses are whole ticks of the clock (and of the rule's own): a drive that takes a pulse every 3.8 us takes
    one every 4 us on a clock of 1 MHz. Raises MotionError for a clock that the rule cannot run on.
    """
    rule = find_rule(rule) if isinstance(rule, str) else rule
    return tuple(
        axis if rate >= axis.pulse_rate else replace(axis, max_pulse_rate=rate)
        for axis, rate in zip(axes, rule.rates(axes, clock_hz), strict=True)
    )


def _add_motor_remedy(no: Infeasible, axes: Sequence[Axis]) -> Infeasible:
    """A refusal of spacing; of an axis that makes up for its screw it says so: a plan keeps the rate of the motor."""
    made_up = next((axis.compensate for axis in axes if axis.name == no.axis), ())
    if not made_up:
        return no
    remedy = (
        f"that is with {' and '.join(made_up)} made up for: {no.remedy}; or let planner.plan make the motion, which "
        "keeps the rate of the motor behind its screw"
    )
    return Infeasible(no.kind, no.axis, no.place, no.value, no.limit, no.unit, remedy)
