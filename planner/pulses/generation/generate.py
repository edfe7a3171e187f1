"""From a whole motion to pulses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import unknown_name
from kinematics.foundation.options import read_options, split_options
from kinematics.machine.axis import Axis
from planner.parallel import Progress, ignore_progress
from planner.pulses.compensation.compensate import CompensatedMotion, counted_motion
from planner.pulses.generation.firing_rule import Rule
from planner.pulses.generation.rules import RULES
from planner.pulses.generation.sent import SentPulses
from planner.pulses.generation.stream import PulseStream
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import PulseSchedule


def find_rule(text: str) -> Rule:
    """Return the rule of a name with or without options.

    Examples: "sampled", "sampled:period=50us", "dda:spacing=2ms,rate=200kHz".

    Raises MotionError for an unknown name or option, with the nearest, and for a value that the
    rule refuses.
    """
    name, given = split_options(text, "firing rule")
    if name not in RULES:
        raise unknown_name("firing rule", name, RULES)
    return RULES[name](**read_options(RULES[name], given, f"firing rule {name}"))


@dataclass(frozen=True, slots=True)
class _Counted:
    axes: Sequence[Axis]
    home_q: Array


def generate(
    trajectory: AxesMotion,
    machine_axes: Sequence[Axis],
    home_q: ArrayLike,
    clock_hz: int = 10_000_000,
    rule: str | Rule = "nearest",
    progress: Progress = ignore_progress,
    sent: Sequence[SentPulses] = (),
) -> PulseSchedule:
    """The pulses of a motion by a firing rule, on a clock of whole ticks, as far apart as the
    drives' timing asks.

    Axes that ask for compensation count what their motors have to do
    (`planner.pulses.compensation.compensate`): a motion of motors is taken as it is. home_q (n,) is
    the axis position from which pulses count; rule: one, or its name and options as
    `planner.pulses.find_rule` reads them; progress is told how far it is; sent: what axes were sent
    before it begins, which its pulses go on from. Raises Infeasible where the rule cannot keep what
    it states, as where an axis would need more than one pulse per tick, MotionError where axes do
    not match.
    """
    home = np.asarray(home_q, float)
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if not len(machine_axes) == width == home.size:
        given = f"{len(machine_axes)} machine axes, {width} axes of the motion, {home.size} home positions"
        raise MotionError(f"{given}: give one of each per axis")
    rule = find_rule(rule) if isinstance(rule, str) else rule
    motion = (
        trajectory
        if isinstance(trajectory, CompensatedMotion)
        else counted_motion(trajectory, machine_axes, home)
    )
    schedule = PulseStream(_Counted(machine_axes, home), clock_hz, rule, sent).add(
        motion, last=True, progress=progress
    )
    return (
        replace(schedule, compensations=motion.costs)
        if isinstance(motion, CompensatedMotion)
        else schedule
    )


def pace_axes(
    axes: Sequence[Axis], clock_hz: int, rule: str | Rule = "nearest"
) -> tuple[Axis, ...]:
    """The axes with the pulse rates that a motion has to keep, for the rule's pulses to be as far
    apart as they state.

    Times of pulses are whole ticks of the clock (and of the rule's own): a drive that takes a pulse
    every 3.8 us takes one every 4 us on a clock of 1 MHz. Raises MotionError for a clock that the
    rule cannot run on.
    """
    rule = find_rule(rule) if isinstance(rule, str) else rule
    return tuple(
        axis if rate >= axis.pulse_rate else replace(axis, max_pulse_rate=rate)
        for axis, rate in zip(axes, rule.rates(axes, clock_hz), strict=True)
    )
