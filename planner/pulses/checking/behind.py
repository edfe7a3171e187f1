"""Where counts that make up for play and screws leave their axes: simulated, and held against the planned motion."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.pulses.checking.search import HALF_TICK, Samples, Search, check_band
from planner.pulses.motion import AxesMotion, apply_play, apply_screw
from planner.pulses.schedule import Compensation, PulseSchedule, Ticks

BLOCK = 1 << 14  # instants looked at together


@dataclass(slots=True)
class MechanicsStandard:
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
    exact: bool = False
    begins: tuple[float, float] = (np.inf, np.inf)
    wait: float = 2 * HALF_TICK

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

    def conclude(self, search: Search) -> None:
        """An axis that is left behind has left its band."""


def search_behind(schedule: PulseSchedule, planned: AxesMotion, axes: Sequence[Axis], grid: Array) -> Iterator[Search]:
    """A search for each axis that makes up for something, on the planned motion of the axes; grid (s) to look at."""
    speeds = np.max(
        [abs(planned.at(grid[lo : lo + BLOCK]).qd).max(axis=0) for lo in range(0, len(grid), BLOCK)], axis=0
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
