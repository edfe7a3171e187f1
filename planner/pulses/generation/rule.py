"""The plug point of the firing rules: when each axis of a motion is stepped."""

from collections.abc import Sequence
from typing import Any, Protocol

from kinematics.foundation.arrays import Array
from kinematics.machine.axis import Axis
from planner.options import options
from planner.parallel import Progress
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import PulseSchedule


class Rule(Protocol):
    """A rule of firing. Its docstring says by how much a count may be from the motion; its schedules say it too.

    A rule is a frozen dataclass whose fields, made by `planner.options.option`, are its options.
    """

    @property
    def name(self) -> str: ...
    def grain(self, clock_hz: int, /) -> int:
        """Ticks between the instants at which it can fire. Raises MotionError for a clock that it cannot run on."""

    def rates(self, axes: Sequence[Axis], clock_hz: int, /) -> list[float]:
        """(n,) 1/s: the pulses that a motion may need of each axis, for it to fire none sooner than the axis takes it.

        ∞ of an axis that states no rate.
        """

    def fire(
        self, motion: AxesMotion, axes: Sequence[Axis], home: Array, clock_hz: int, tell: Progress, /
    ) -> PulseSchedule:
        """The pulses of every axis; home (n,): the axis positions from which they count; tell: how far they are."""


def kept_rates(axes: Sequence[Axis], clock_hz: int, grain: int = 1) -> list[float]:
    """`Rule.rates` of a rule that fires on whole grains of ticks where the motion asks for it."""
    return [axis.held_rate(clock_hz, grain) for axis in axes]


def told(rule: Rule) -> str:
    """A rule as `find_rule` reads it, with the options that are not the default: "sampled:period=5e-05 s"."""
    kind: Any = type(rule)
    values = [(field, getattr(rule, name)) for name, field in options(kind).items()]
    given = [f"{field.name}={value!r} {field.metadata['unit']}" for field, value in values if value != field.default]
    return f"{rule.name}:{','.join(map(str.rstrip, given))}" if given else rule.name
