"""Where along a plan something happens, and the refusal that names it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.table import Column
from kinematics.foundation.units import format_distinct


@dataclass(frozen=True, slots=True)
class Place:
    """A place along a plan: path length s (m) and, where known, segment (from 1), time t (s) and whose limit.

    repetition  from 1, where the program is run more than once
    """

    s: float
    segment: int | None = None
    t: float | None = None
    axis: str = ""
    repetition: int | None = None

    def __str__(self) -> str:
        parts = [self.axis] if self.axis else []
        parts.append(f"s = {self.s * 1e3:.4g} mm" if self.segment is not None else f"s = {self.s:.6g}")
        if self.segment is not None:
            again = "" if self.repetition is None else f" of repetition {self.repetition}"
            parts.append(f"segment {self.segment}{again}")
        if self.t is not None:
            parts.append(f"t = {self.t:.6g} s")
        return ", ".join(parts)


def where_columns(places: "Sequence[Place]") -> tuple[Column, ...]:
    """Whose limit, segment, distance and time of places, as far as any of them tells."""
    units = "m" if any(place.segment is not None for place in places) else ""
    columns = (
        Column("at", [place.axis or None for place in places]),
        Column("segment", [place.segment for place in places]),
        Column("repetition", [place.repetition for place in places]),
        Column("s", [place.s for place in places], units, "human", ".3f" if units else ".6g"),
        Column("t", [place.t for place in places], "s", form=".4f"),
    )
    return tuple(column for column in columns if any(value is not None for value in column.values))


class Infeasible(MotionError):
    """A motion that cannot respect a limit: kind, axis, place, value and limit in a unit, and the remedy."""

    def __init__(
        self, kind: str, axis: str, place: Place | None, value: float, limit: float, unit: str, remedy: str
    ) -> None:
        self.kind, self.axis, self.place = kind, axis, place
        self.value, self.limit, self.unit = value, limit, unit
        self.segment = None if place is None else place.segment
        self._remedy = remedy
        self._more: Callable[[], object] | None = None
        where = "" if place is None else f" at {place}"
        who = f"{axis} " if axis and (place is None or not place.axis) else ""
        reached, allowed = format_distinct(value, limit)
        told = f"beyond {allowed} {unit}" if value >= limit else f"below the {allowed} {unit} minimum"
        super().__init__(f"{who}{kind} {reached} {unit} is {told}{where}")

    def __str__(self) -> str:
        return f"{self.args[0]}; {self.remedy}"

    def __reduce__(self) -> tuple[Any, ...]:
        """With its remedy worked out: what does that need not be known where it is sent."""
        self.remedy  # noqa: B018  a cached property: looking at it works it out
        return super().__reduce__()

    @property
    def remedy(self) -> str:
        """What to change, and by how much."""
        if self._more is not None:
            self._remedy, self._more = f"{self._remedy}; {self._more()}", None
        return self._remedy

    def add_advice(self, more: Callable[[], object]) -> "Infeasible":
        """With more to its remedy, which is worked out when it is read: that may take a second."""
        advised = Infeasible(self.kind, self.axis, self.place, self.value, self.limit, self.unit, self.remedy)
        advised._more = more
        return advised

    @property
    def relaxation(self) -> float:
        """The smallest factor on the limit that makes room for the value, and by which a speed asked for must fall.

        ∞ where the limit is 0: an end of travel at home, which no factor moves.
        """
        return self.value / self.limit if self.limit else float("inf")


class LostPath(OutOfReach):
    """A path that leaves what the actuators reach or hold, and more to its remedy, worked out when it is read."""

    def __init__(self, told: str, more: Callable[[], object]) -> None:
        self._more: Callable[[], object] | None = more
        super().__init__(told)

    def __str__(self) -> str:
        if self._more is not None:
            self.args, self._more = (f"{self.args[0]}; {self._more()}",), None
        return str(self.args[0])

    def __reduce__(self) -> tuple[Any, ...]:
        str(self)
        return super().__reduce__()


class ConstantRefused(Infeasible):
    """A constant speed that cannot be kept or reached: asked, and possible, as far as that place goes (m/s)."""

    def __init__(self, *told: Any, asked: float, possible: float) -> None:
        self.asked, self.possible = asked, possible
        super().__init__(*told)

    def add_possible_speed(self, speed: float) -> "ConstantRefused":
        """With a speed of which it was proved that the whole run can be made at it."""
        remedy = f"{self.remedy}; {speed * 1e3:.6g} mm/s was found to hold"
        told = self.kind, self.axis, self.place, self.value, self.limit, self.unit, remedy
        return ConstantRefused(*told, asked=self.asked, possible=self.possible)
