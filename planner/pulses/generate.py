"""From a motion to pulses: the firing rule at work."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from kinematics.axis import Axis
from kinematics.errors import MotionError
from planner.pulses.motion import Motion
from planner.pulses.rules import Rule, find_rule
from planner.pulses.schedule import PulseSchedule


def generate(
    trajectory: Motion,
    machine_axes: Sequence[Axis],
    home_q: ArrayLike,
    clock_hz: int = 10_000_000,
    rule: str | Rule = "nearest",
) -> PulseSchedule:
    """The pulses of a motion by a firing rule, on a clock of whole ticks.

    home_q (n,) is the axis position from which pulses count; rule: one, or its name and options as
    `planner.pulses.find_rule` reads them. Raises Infeasible where the rule cannot keep what it
    states, as where an axis would need more than one pulse per tick, MotionError where axes do not match.
    """
    home = np.asarray(home_q, float)
    width = trajectory.at(np.zeros(1)).q.shape[1]
    if not len(machine_axes) == width == home.size:
        given = f"{len(machine_axes)} machine axes, {width} axes of the motion, {home.size} home positions"
        raise MotionError(f"{given}: give one of each per axis")
    rule = find_rule(rule) if isinstance(rule, str) else rule
    return rule.fire(trajectory, machine_axes, home, clock_hz)
