"""The firing rule `timer`: a 16-bit counter times each pulse, and its count is changed pulse by
pulse.
"""

import logging
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.pulses.generation.equal_steps import fire_equal_steps
from planner.pulses.generation.firing_rule import Rule, require_whole
from planner.pulses.generation.levels import Levels, find_crossings
from planner.pulses.generation.motion_parts import Fired, MotionPart
from planner.pulses.generation.pieces import FIT_TOLERANCE, bound_rate, fit, rate_error


@dataclass(frozen=True, slots=True)
class Timer(Rule):
    """Intervals of whole timer counts, each the nearest that keeps its pulse at its crossing
    [Sasidhar 1981, 5.2].

    A counter counts down at a fixed clock; at zero it fires a pulse and starts again from the count
    it is given for the next. The crossings are those of `nearest`, and what rounding took from one
    interval the next one makes good, so errors never add up: |count - x| ≤ ½ + the travel in one
    timer count, + one tick's travel.

    An interval of more than 65535 counts (33 ms at 2 MHz: at rest, or as slow) is counted down in
    several loads, with the gate that follows the timer shut but for the last. It costs nothing in
    the bound.

    With `step` the pulses are the source's own ramps: between two rests of an axis the count is
    lowered by the step after each pulse while it speeds up, left as it is, and raised as it slows
    down. The ramps take the time of the motion, not its course: the schedule states by how much the
    counts leave it. Such a ramp is gentle at first and steep at the end (with count c it grows by
    step·(f/c)³ per s), so it may exceed the planned acceleration: a warning says so.

    Assumption: the source prints no timer clock. Its trigger pulse of 0.5 µs is one clock of 2 MHz,
    if the 8253 runs as a rate generator.
    """

    name: ClassVar[str] = "timer"
    clock: float = option(
        2e6, "timer frequency; the pulse clock must be a whole multiple of it", "1/s"
    )

    step: int = option(
        0, "counts by which the source's own ramps change the count after each pulse; 0: none"
    )

    def __post_init__(self) -> None:
        if not (isinstance(self.step, int) and self.step >= 0):
            raise MotionError(
                f"timer step {self.step!r}: must be a whole number of counts, at least 0"
            )
        if not (0 < self.clock < np.inf and self.clock == int(self.clock)):
            raise MotionError(
                f"timer clock {self.clock!r} Hz: must be a positive whole number, e.g. 2 MHz"
            )

    @property
    def whole_reason(self) -> str:
        return "its ramps reach from one rest to the next" if self.step else ""

    def grain(self, clock_hz: int) -> int:
        timer = int(self.clock)
        if clock_hz % timer:
            raise MotionError(
                f"timer clock {timer} Hz does not divide the {clock_hz} Hz of the pulses; use one that does"
            )
        return clock_hz // timer

    def fire(self, part: MotionPart) -> Fired:
        """Raises as `planner.pulses.generation.levels.find_crossings`, MotionError for a timer
        clock that does not divide the pulses', and with `step` for a part of a motion.
        """
        grain, timer = self.grain(part.clock_hz), int(self.clock)
        if self.step:
            require_whole(self, part)
            fired_ramps = fire_equal_steps(part, timer, self.step, grain)
            warn_of_steep_ramps(part, fired_ramps, self.step, timer)
            return fired_ramps
        pieces = fit(part.motion, np.array([FIT_TOLERANCE * axis.pulse for axis in part.axes]))
        counted = replace(part, clock_hz=timer, tick=part.tick / grain)
        last = int(float(counted.end_tick))
        crossings = find_crossings(counted, Levels(0.5))
        fired = []
        for k, (axis, crossed) in enumerate(zip(part.axes, crossings.axes, strict=True)):
            speed, t = bound_rate(pieces, k, 1)
            counts = (
                np.minimum(crossed.ticks, last) if part.last else crossed.ticks
            )  # none after the end of the motion
            if (counts[-1:] <= counts[-2:-1]).any():
                raise rate_error(
                    part.motion, axis, t, speed / axis.pulse, timer, "use a faster timer clock"
                )
            bound = 0.5 + speed / axis.pulse / timer
            fired.append(replace(crossed, ticks=counts * grain, bound=bound))
        return replace(crossings, axes=tuple(fired))


def warn_of_steep_ramps(part: MotionPart, fired: Fired, step: int, timer: int) -> None:
    """Warn of axes whose ramps are steeper than their acceleration limit: a ramp grows by
    step·(f/c)³ per s.
    """
    for axis, pulses in zip(part.axes, fired.axes, strict=True):
        if axis.max_acceleration is None or len(pulses) < 2:
            continue
        counts = np.diff(pulses.ticks) * timer / part.clock_hz
        changes = np.flatnonzero(np.abs(np.diff(counts)) == step)
        if not len(changes):
            continue
        fastest = timer / float(np.minimum(counts[changes], counts[changes + 1]).min())
        steepest = axis.pulse * step / timer * fastest**3
        limit = float(np.min(axis.max_acceleration))
        if steepest > limit:
            logging.getLogger("pulsepath").warning(
                "axis %s: ramps by a step of %d counts accelerate by up to %.4g %s/s², and its limit is %.4g %s/s²; "
                "use a smaller step or a slower motion, or make sure that the motor follows",
                axis.name, step, steepest, axis.unit, limit, axis.unit,
            )  # fmt: skip
