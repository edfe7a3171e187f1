"""From a motion to pulses: the firing rule at work."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.parallel import Progress, silent
from planner.place import Infeasible, Place
from planner.pulses.compensate import Compensated, counted
from planner.pulses.counter import refuse_counter
from planner.pulses.motion import Motion
from planner.pulses.rules import Rule, find_rule
from planner.pulses.schedule import AxisPulses, PulseSchedule
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
    schedule = spaced(rule.fire(motion, machine_axes, home, clock_hz, progress), motion, machine_axes)
    for pulses, axis in zip(schedule.axes, machine_axes, strict=True):
        if axis.card is not None:
            refuse_counter(pulses, axis)
        if axis.compensate:
            _refuse_rate(pulses, axis, trajectory, clock_hz)
    return replace(schedule, compensations=motion.costs) if isinstance(motion, Compensated) else schedule


def _refuse_rate(pulses: AxisPulses, axis: Axis, motion: Motion, clock_hz: int) -> None:
    """Raise Infeasible for a motion whose motors take more pulses than their axis: one that no plan has held to it."""
    steps = np.where(np.diff(pulses.direction) == 0, np.diff(pulses.ticks), np.iinfo(np.int64).max)
    if not len(steps) or steps.min() >= np.floor(clock_hz / axis.pulse_rate):
        return
    rate = clock_hz / float(steps.min())
    t = float(pulses.ticks[int(np.argmin(steps))]) / clock_hz
    place = Place(float(motion.at(np.array([t])).s[0]), t=t, axis=axis.name)
    remedy = (
        f"that is with {' and '.join(axis.compensate)} made up for: slow {axis.name} there to "
        f"{100 * axis.pulse_rate / rate:.4g} % or less, or let planner.plan make the motion, which keeps the rate of "
        "the motor behind its screw"
    )
    raise Infeasible("pulse rate", axis.name, place, rate, axis.pulse_rate, "1/s", remedy)
