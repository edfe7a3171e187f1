"""What a rig is asked to do: a motion, and how often the host commands.

The motions of tasks: a path run by one classical profile of a stated duration, and sines of single axes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError
from planner.actuation import MachinePath
from planner.baselines.shapes import quarter_sine, trapezoid
from planner.pulses.motion import AxesMotion
from planner.timing.profile import Profile
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Task:
    """A motion to be tracked.

    motion  axis positions over time; where it is a `Trajectory` on a machine's path, errors in space are known too
    dt      s between the host's commands
    """

    name: str
    motion: AxesMotion
    dt: float


SHAPES: dict[str, Callable[[float], Profile]] = {"quarter-sine": quarter_sine, "trapezoid": trapezoid}
"""Profiles by name; each takes the share of the time that a ramp lasts."""


def time_path(path: MachinePath, shape: str, share: float, duration: float) -> Trajectory:
    """The path within `duration` seconds: between two stops one profile, its time in proportion to its length.

    share  of the time of each profile that a ramp lasts, up to 1/2
    No limit of the machine is looked at: the rig is told when to be where, as by [Sahbaz 2007].
    """
    if not 0 < share <= 0.5:
        raise MotionError(f"a ramp of {share * duration:g} s does not fit twice into {duration:g} s; shorten it")
    if path.dwells.any():
        raise MotionError("a task's program has no dwells: its profile runs from end to end; leave them out")
    unit = SHAPES[shape](share)
    stops = np.flatnonzero(path.stops(2))
    profiles = []
    for a, b in pairwise(stops.tolist()):
        breaks = path.breaks[a : b + 1]
        profiles.append(unit.over(breaks, a, duration * float(breaks[-1] - breaks[0]) / float(path.breaks[-1])))
    return Profile.joined(profiles).along(path)


@dataclass(frozen=True, slots=True)
class SineState:
    """q, q̇, q̈, q⃛ (N, n) and the angle s (N,) that the sine has run."""

    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


@dataclass(frozen=True, slots=True)
class Sine:
    """q = home + A sin(ω t) for `duration` seconds, at rest before and after: it starts at speed A ω at once.

    home, amplitude  (n,) rad or m;  omega  rad/s
    """

    home: Array
    amplitude: Array
    omega: float
    duration: float

    def __post_init__(self) -> None:
        freeze_fields(self, "home", "amplitude", dtype=np.float64)

    @property
    def knots(self) -> Array:
        return freeze_array([0.0, self.duration])

    def at(self, t: Array, /) -> SineState:
        t = np.atleast_1d(np.asarray(t, float))
        angle = self.omega * np.clip(t, 0.0, self.duration)
        moving = ((t >= 0) & (t <= self.duration)).astype(float)
        a = self.amplitude
        q, qd, qdd, qddd = (
            np.multiply.outer(of, a * self.omega**n)
            for n, of in enumerate(
                (np.sin(angle), moving * np.cos(angle), -moving * np.sin(angle), -moving * np.cos(angle))
            )
        )
        return SineState(angle, self.home + q, qd, qdd, qddd)
