"""Which actuators and joints of a catalogue can do what a set of motions needs, in order; and why the others cannot."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Generic

from kinematics.catalogue import Actuator, Joint, Part
from kinematics.errors import MotionError
from kinematics.needs import UNITS, ActuatorNeed, JointNeed
from kinematics.registry import nearest
from kinematics.result import Result
from kinematics.sizing import ROUNDING
from kinematics.table import Column, Table
from kinematics.units import describe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AnyPart = Actuator | Joint

_NO_MORE = ("precision",)
"""Properties of which a part may offer no more than the need; of all others it must offer no less."""


@dataclass(frozen=True, slots=True)
class Choice(Generic[Part]):
    """A part that does: `reserve` is the smallest offered/needed over all properties, at `tightest`."""

    part: Part
    reserve: float
    tightest: str


@dataclass(frozen=True, slots=True)
class Refusal(Generic[Part]):
    """A part that does not, and every reason."""

    part: Part
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Selection(Result, Generic[Part]):
    """The feasible parts, best first by `criterion`, and the refused ones with their reasons."""

    need: ActuatorNeed | JointNeed
    criterion: str
    feasible: tuple[Choice[Part], ...]
    refused: tuple[Refusal[Part], ...]

    def tables(self) -> tuple[Table, ...]:
        """The parts in their order, then those that do not, and why."""
        wanted = ", ".join(f"{name} {describe(value, UNITS[name])}" for name, value in self.need.asked().items())
        parts: list[AnyPart] = [*(choice.part for choice in self.feasible), *(out.part for out in self.refused)]
        others = [None] * len(self.refused)
        columns = (
            Column("rank", [*range(1, len(self.feasible) + 1), *others]),
            Column("part", [part.name for part in parts]),
            Column("cost from", [part.cost and part.cost[0] for part in parts]),
            Column("to", [part.cost and part.cost[1] for part in parts]),
            Column("mass", [part.mass for part in parts], "kg", "human"),
            Column("reserve", [*(choice.reserve for choice in self.feasible), *others], form=".2f"),
            Column(
                "tightest, or why not",
                [*(choice.tightest for choice in self.feasible), *("; ".join(out.reasons) for out in self.refused)],
            ),
        )
        return (Table(f"needed: {wanted}; ranked by {self.criterion}", columns),)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The reserve of each part that does."""
        from kinematics.bars import bars

        names, reserves = [each.part.name for each in self.feasible], [each.reserve for each in self.feasible]
        return bars(names, reserves, "smallest offered / needed", ax, 1.0)


_CRITERIA: dict[str, tuple[str, Callable[[AnyPart, float], float | None]]] = {
    "cost": ("the upper end of the stated price, cheapest first", lambda part, reserve: part.cost and part.cost[1]),
    "mass": ("mass, lightest first", lambda part, reserve: part.mass),
    "precision": ("precision, finest first", lambda part, reserve: part.precision),
    "reserve": ("the smallest offered/needed, largest first", lambda part, reserve: -reserve),
}


def select_parts(parts: Sequence[Part], need: ActuatorNeed | JointNeed, by: str = "cost") -> Selection[Part]:
    """The parts that offer what is needed, ranked; each other one with every reason.

    by  "cost", "mass", "precision" or "reserve": parts of which it is not stated come last; ties go to the larger
        reserve, then to the catalogue's order
    A property that is needed but not stated counts as not offered. Raises MotionError for a need of the other kind of
    part, an empty need and an unknown criterion.
    """
    if by not in _CRITERIA:
        raise MotionError(f'no criterion "{by}"{nearest(by, _CRITERIA)}; criteria: {", ".join(_CRITERIA)}')
    wanted = need.asked()
    if not wanted:
        raise MotionError("selection: nothing is needed; state at least one property")
    feasible: list[Choice[Part]] = []
    refused: list[Refusal[Part]] = []
    for part in parts:
        foreign = [name for name in wanted if not hasattr(part, name)]
        if foreign:
            raise MotionError(f"{part.name}: {type(part).__name__.lower()}s have no {foreign[0]}")
        reasons = tuple(filter(None, (_reason(part, name, value) for name, value in wanted.items())))
        if reasons:
            refused.append(Refusal(part, reasons))
        else:
            reserve = {name: _ratio(name, getattr(part, name), value) for name, value in wanted.items()}
            tightest = min(reserve, key=reserve.__getitem__)
            feasible.append(Choice(part, reserve[tightest], tightest))
    text, key = _CRITERIA[by]
    feasible.sort(key=lambda choice: (_or_last(key(choice.part, choice.reserve)), -choice.reserve))
    return Selection(need, f"{text}; not stated last", tuple(feasible), tuple(refused))


def _or_last(value: float | None) -> float:
    return inf if value is None else value


def _ratio(name: str, offered: float, needed: float) -> float:
    return needed / offered if name in _NO_MORE else offered / needed


def _reason(part: AnyPart, name: str, needed: float) -> str | None:
    offered, unit = getattr(part, name), UNITS[name]
    if offered is None:
        return f"{name} not stated, {describe(needed, unit)} needed"
    if _ratio(name, offered, needed) >= 1 - ROUNDING:
        return None
    sign = ">" if name in _NO_MORE else "<"
    return f"{name} {describe(offered, unit)} {sign} {describe(needed, unit)}"
