"""A stepper's pull-out curve as straight lines: the force that it gives at a speed."""

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Curve:
    """F(v) falling or level: force[i] − slope[i] v on segment i, from ends[i] to ends[i+1]; nothing beyond the last.

    ends (S+1,) from 0, force (S,) each line's value at rest, slope (S,) ≥ 0. What an axis states is its motor's
    pull-out curve, the border of the slew region of [Sasidhar 1981, 3.2]: as much as it gives at a speed it gives at
    every lower one. The start/stop region, in which a motor may jump to a speed without a ramp, lies inside, and says
    nothing here: speeds are continuous.
    """

    ends: Array
    force: Array
    slope: Array

    @staticmethod
    def of(axis: Axis) -> "Curve":
        """The curve of an axis that states one."""
        speeds, forces = np.array(axis.torque_speed, float).T
        ends, levels = [0.0], [forces[0]]  # below the first speed as there
        for k in range(len(speeds)):
            if k and forces[k] < levels[-1] < forces[k - 1]:  # it rose, and falls below where it was
                share = (forces[k - 1] - levels[-1]) / (forces[k - 1] - forces[k])
                ends.append(speeds[k - 1] + share * (speeds[k] - speeds[k - 1]))
                levels.append(levels[-1])
            if speeds[k] > ends[-1]:
                ends.append(speeds[k])
                levels.append(min(forces[k], levels[-1]))
        gives = np.array(levels) > 0
        if not gives[0]:
            raise MotionError(f"axis {axis.name}: torque_speed gives no force at rest; state what the motor holds")
        count = int(np.argmin(np.append(gives, False))) + 1  # up to where it gives none, if there is such a place
        v, f = np.array(ends)[:count], np.array(levels)[:count]
        slope = (f[:-1] - f[1:]) / np.diff(v)
        return Curve(frozen(v), frozen(f[:-1] + slope * v[:-1]), frozen(slope))

    @property
    def holding(self) -> float:
        """What it gives at rest."""
        return float(self.force[0])

    @property
    def fastest(self) -> float:
        """The speed beyond which it gives nothing."""
        return float(self.ends[-1])

    def hull(self) -> "Curve":
        """The least concave curve above it: its lines hold whatever keeps it, at every speed."""
        v = self.ends
        f = np.append(self.force, self.force[-1]) - np.append(self.slope, self.slope[-1]) * v
        kept = [0]
        while kept[-1] < len(v) - 1:  # on to the corner to which it falls least steeply
            rest = np.arange(len(v) - 1, kept[-1], -1)
            kept.append(int(rest[np.argmin((f[kept[-1]] - f[rest]) / (v[rest] - v[kept[-1]]))]))
        slope = -np.diff(f[kept]) / np.diff(v[kept])
        return Curve(frozen(v[kept]), frozen(f[kept][:-1] + slope * v[kept][:-1]), frozen(slope))

    def about(self) -> tuple[Array, Array]:
        """Low and high (S,): near which speeds each line is one of those whose least is a concave floor of the curve.

        That floor touches the curve at the speed itself: to the right go the lines each steeper than all before, to the
        left those each less steep. So a line counts from as far left as all lines up to it are less steep, to as far
        right as all lines from it are steeper.
        """
        count = len(self.slope)
        low, high = np.empty(count), np.empty(count)
        for i, slope in enumerate(self.slope):
            first, last = i, i
            while first > 0 and self.slope[first - 1] < slope:
                first -= 1
            while last < count - 1 and self.slope[last + 1] > slope:
                last += 1
            low[i], high[i] = self.ends[first], self.ends[last + 1] if last < count - 1 else np.inf
        return low, high
