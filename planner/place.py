"""Places along a plan, and the errors that name them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.table import Column
from kinematics.foundation.units import format_distinct


@dataclass(frozen=True, slots=True)
class Place:
    """A place along a plan: path length s (m) and, if known, segment (from 1) and time t (s).

    axis        axis or body whose limit is concerned
    repetition  from 1, if the program runs more than once
    """

    s: float
    segment: int | None = None
    t: float | None = None
    axis: str = ""
    repetition: int | None = None

    def record(self) -> dict[str, Any]:
        """Return the place as plain data, with its repetition only if the program runs more than once."""
        repetition = {} if self.repetition is None else {"repetition": self.repetition}
        return {
            "axis": self.axis or None,
            "segment": self.segment,
            **repetition,
            "distance_m": self.s,
            "time_s": self.t,
        }

    @staticmethod
    def columns(places: "Sequence[Place]") -> tuple[Column, ...]:
        """Return the columns of places: axis, segment, distance and time, as far as any is known."""
        units = "m" if any(place.segment is not None for place in places) else ""
        columns = (
            Column("at", [place.axis or None for place in places]),
            Column("segment", [place.segment for place in places]),
            Column("repetition", [place.repetition for place in places]),
            Column("s", [place.s for place in places], units, "human", ".3f" if units else ".6g"),
            Column("t", [place.t for place in places], "s", form=".4f"),
        )
        return tuple(each for each in columns if any(value is not None for value in each.values))

    def __str__(self) -> str:
        parts = [self.axis] if self.axis else []
        if self.segment is None:
            parts.append(f"s = {self.s:.6g}")
        else:
            parts.append(f"s = {self.s * 1e3:.4g} mm")
            again = "" if self.repetition is None else f" of repetition {self.repetition}"
            parts.append(f"segment {self.segment}{again}")
        if self.t is not None:
            parts.append(f"t = {self.t:.6g} s")
        return ", ".join(parts)


class Infeasible(MotionError):
    """A limit that no motion can keep: kind, axis, place, value and limit in a unit, and the remedy."""

    def __init__(
        self,
        kind: str,
        axis: str,
        place: Place | None,
        value: float,
        limit: float,
        unit: str,
        remedy: str,
    ) -> None:
        self.kind = kind
        self.axis = axis
        self.place = place
        self.value = value
        self.limit = limit
        self.unit = unit
        self.segment = None if place is None else place.segment
        self._remedy = remedy
        self._more: Callable[[], object] | None = None

        where = "" if place is None else f" at {place}"
        who = f"{axis} " if axis and (place is None or not place.axis) else ""
        text, bound = format_distinct(value, limit)
        excess = f"beyond {bound} {unit}" if value >= limit else f"below the {bound} {unit} minimum"
        super().__init__(f"{who}{kind} {text} {unit} is {excess}{where}")

    def __str__(self) -> str:
        return f"{self.args[0]}; {self.remedy}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error with its complete remedy: the function for more advice stays here."""
        self.remedy  # noqa: B018  reading it completes it
        return super().__reduce__()

    @property
    def remedy(self) -> str:
        """The change to make, and by how much."""
        if self._more is not None:
            self._remedy = f"{self._remedy}; {self._more()}"
            self._more = None
        return self._remedy

    @property
    def _arguments(self) -> tuple[str, str, Place | None, float, float, str]:
        return self.kind, self.axis, self.place, self.value, self.limit, self.unit

    def add_advice(self, more: Callable[[], object]) -> "Infeasible":
        """Return the error with more advice, computed when it is read: that may take a second."""
        advised = Infeasible(*self._arguments, self.remedy)
        advised._more = more
        return advised

    @property
    def relaxation(self) -> float:
        """Smallest factor on the limit, or divisor of a requested speed, that admits the value.

        It is ∞ if the limit is 0: an end of travel at home, which no factor moves.
        """
        return self.value / self.limit if self.limit else float("inf")


class LostPath(OutOfReach):
    """A path beyond the reach of the actuators, with more advice, computed when it is read."""

    def __init__(self, message: str, more: Callable[[], object]) -> None:
        self._more: Callable[[], object] | None = more
        super().__init__(message)

    def __str__(self) -> str:
        if self._more is not None:
            self.args = (f"{self.args[0]}; {self._more()}",)
            self._more = None
        return str(self.args[0])

    def __reduce__(self) -> tuple[Any, ...]:
        str(self)
        return super().__reduce__()


class ConstantRefused(Infeasible):
    """A constant speed that the machine cannot keep or attain.

    asked     m/s, required by the segment
    possible  m/s, largest that this place allows
    """

    def __init__(self, *arguments: Any, asked: float, possible: float) -> None:
        self.asked = asked
        self.possible = possible
        super().__init__(*arguments)

    def add_possible_speed(self, speed: float) -> "ConstantRefused":
        """Return the error with a speed (m/s) that is proved for the whole run."""
        remedy = f"{self.remedy}; {speed * 1e3:.6g} mm/s was found to hold"
        return ConstantRefused(*self._arguments, remedy, asked=self.asked, possible=self.possible)
