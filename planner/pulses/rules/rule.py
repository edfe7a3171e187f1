"""The plug point of the firing rules: when each axis of a motion is stepped."""

from collections.abc import Sequence
from typing import Protocol

from kinematics.array import Array
from kinematics.axis import Axis
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule


class Rule(Protocol):
    """A rule of firing. Its docstring says by how much a count may be from the motion; its schedules say it too.

    A rule is a frozen dataclass whose fields are its options.
    """

    @property
    def name(self) -> str: ...
    def fire(self, motion: Motion, axes: Sequence[Axis], home: Array, clock_hz: int, /) -> PulseSchedule:
        """The pulses of every axis; home (n,): the axis positions from which they count."""
