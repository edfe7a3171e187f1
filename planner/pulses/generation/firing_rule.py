"""The plug point of the firing rules: when each axis of a motion is stepped; and the two that
follow level crossings.

`nearest` steps an axis half-way between two counts, `floor` when it reaches one.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option, options
from kinematics.machine.axis import Axis
from planner.pulses.generation.levels import MAX_COUNT_BLUR, Levels, find_crossings
from planner.pulses.generation.motion_parts import Fired, MotionPart


class Rule(Protocol):
    """A rule of firing.

    Its docstring says by how much a count may be from the motion; its schedules say it too.

    A rule is a frozen dataclass whose fields, made by `kinematics.foundation.options.option`, are
    its options.
    """

    @property
    def name(self) -> str: ...
    @property
    def whole_reason(self) -> str:
        """Why it makes pulses of a whole motion only; "": of parts as well."""
        return ""

    def grain(self, clock_hz: int, /) -> int:
        """Ticks between the instants at which it can fire.

        Raises MotionError for a clock that it cannot run on.
        """
        return 1

    def rates(self, axes: Sequence[Axis], clock_hz: int, /) -> list[float]:
        """(n,) 1/s: the pulses that a motion may need of each axis, for it to fire none sooner than
        the axis takes it.

        ∞ of an axis that states no rate. That of the axis itself, for a rule that fires on whole
        grains of ticks where the motion asks for it.
        """
        return [axis.held_rate(clock_hz, self.grain(clock_hz)) for axis in axes]

    def fire(self, part: MotionPart, /) -> Fired:
        """The pulses of every axis of a part, or of a whole motion, which is one part."""


def describe_rule(rule: Rule) -> str:
    """A rule as `find_rule` reads it, with the options that are not the default:
    "sampled:period=5e-05 s".
    """
    kind: Any = type(rule)
    values = [(field, getattr(rule, name)) for name, field in options(kind).items()]
    given = [
        f"{field.name}={value!r} {field.metadata['unit']}"
        for field, value in values
        if value != field.default
    ]
    return f"{rule.name}:{','.join(map(str.rstrip, given))}" if given else rule.name


def require_whole(rule: Rule, part: MotionPart) -> None:
    """Raise MotionError for a part of a motion, where a rule needs the whole."""
    if not part.is_whole:
        raise MotionError(
            f"rule {rule.name} makes no pulses of a motion part by part: {rule.whole_reason}; use nearest, floor or "
            "timer, or plan the whole at once"
        )


@dataclass(frozen=True, slots=True)
class Nearest(Rule):
    """A pulse wherever x = (q(t) - home)/pulse crosses k + ½, at the true crossing time rounded to
    the nearest tick.

    |count - x| ≤ ½ pulse + one tick's travel at all times, and the final counts are exact.

    hysteresis h keeps an axis that hovers on a crossing from chattering: the first pulse after one
    the other way, and the very first, fires h beyond its level. It costs |count - x| ≤ ½ + h. Below
    ½, so that a motion which ends on a whole count ends with it.
    """

    name: ClassVar[str] = "nearest"
    hysteresis: float = option(0.0, "hysteresis at reversals, in pulses; below 0.5")

    def __post_init__(self) -> None:
        if not 0 <= self.hysteresis < 0.5:
            raise MotionError(
                f"hysteresis {self.hysteresis!r} pulses: must be from 0 to below 0.5, e.g. 0.2"
            )

    def fire(self, part: MotionPart) -> Fired:
        """Raises as `planner.pulses.generation.levels.find_crossings` does."""
        return find_crossings(part, Levels(0.5, self.hysteresis))


COUNT_ROUNDING = (
    2 * MAX_COUNT_BLUR
)  # pulses before a whole count where it counts as reached: more than rounding may take


@dataclass(frozen=True, slots=True)
class Floor(Rule):
    """A pulse wherever x = (q(t) - home)/pulse crosses a whole number: the count is the greatest
    not above x.

    |count - x| ≤ 1 pulse + one tick's travel at all times.

    A whole number counts as reached 0.002 pulse before it, so that rounding takes no pulse from a
    motion which ends on one, and gives none to an axis that rests at home.
    """

    name: ClassVar[str] = "floor"

    def fire(self, part: MotionPart) -> Fired:
        """Raises as `planner.pulses.generation.levels.find_crossings` does."""
        return find_crossings(part, Levels(1 - COUNT_ROUNDING))
