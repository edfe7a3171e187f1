"""From a motion to pulses: the firing rule at work."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.parallel import Progress, silent
from planner.place import Infeasible
from planner.pulses.compensate import Compensated, counted
from planner.pulses.counter import refuse_counter
from planner.pulses.motion import Motion
from planner.pulses.rules import Rule, find_rule
from planner.pulses.schedule import PulseSchedule
from planner.pulses.spacing import spaced


def generate(
    trajectory: Motion,
    machine_axes: Sequence[Axis],
    home_q: ArrayLike,
    clock_hz: int = 10_000_000,
    rule: str | Rule = "nearest",
    progress: Progress = silent,
) -> PulseSchedule:
    """The pulses of a motion by a firing rule, on a clock of whole ticks, as far apart as the drives' timing asks.

    Axes that ask for compensation count what their motors have to do (`planner.pulses.compensate`): a motion of
    motors is taken as it is.
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
    motion = trajectory if isinstance(trajectory, Compensated) else counted(trajectory, machine_axes, home)
    fired = rule.fire(motion, machine_axes, home, clock_hz, progress)
    try:
        schedule = spaced(fired, motion, machine_axes, rule.grain(clock_hz))
    except Infeasible as no:
        raise _of_motor(no, machine_axes) from None
    for pulses, axis in zip(schedule.axes, machine_axes, strict=True):
        if axis.card is not None:
            refuse_counter(pulses, axis)
    return replace(schedule, compensations=motion.costs) if isinstance(motion, Compensated) else schedule


def paced(axes: Sequence[Axis], clock_hz: int, rule: str | Rule = "nearest") -> tuple[Axis, ...]:
    """The axes with the pulse rates that a motion has to keep, for the rule's pulses to be as far apart as they state.

    Times of pulses are whole ticks of the clock (and of the rule's own): a drive that takes a pulse every 3.8 us takes
    one every 4 us on a clock of 1 MHz. Raises MotionError for a clock that the rule cannot run on.
    """
    rule = find_rule(rule) if isinstance(rule, str) else rule
    return tuple(
        axis if rate >= axis.pulse_rate else replace(axis, max_pulse_rate=rate)
        for axis, rate in zip(axes, rule.rates(axes, clock_hz), strict=True)
    )


def _of_motor(no: Infeasible, axes: Sequence[Axis]) -> Infeasible:
    """A refusal of spacing; of an axis that makes up for its screw it says so: a plan keeps the rate of the motor."""
    made_up = next((axis.compensate for axis in axes if axis.name == no.axis), ())
    if not made_up:
        return no
    remedy = (
        f"that is with {' and '.join(made_up)} made up for: {no.remedy}; or let planner.plan make the motion, which "
        "keeps the rate of the motor behind its screw"
    )
    return Infeasible(no.kind, no.axis, no.place, no.value, no.limit, no.unit, remedy)
