"""Places along a plan, and the errors that name them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

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
        """Return the place as plain data, with its repetition only if the program runs more than
        once.
        """
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
        """Return the columns of places: axis, segment, distance and time, as far as any is
        known.
        """
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


@dataclass(eq=False, repr=False)
class Infeasible(MotionError):
    """A limit that no motion can keep: kind, axis, place, value and limit in a unit, and the
    remedy.

    advise  function that finds more advice, which may take a second: called when `remedy` is read
    """

    kind: str
    axis: str
    place: Place | None
    value: float
    limit: float
    unit: str
    stated_remedy: str
    advise: Callable[[], object] | None = None

    def __post_init__(self) -> None:
        place = self.place
        self.segment = None if place is None else place.segment
        where = "" if place is None else f" at {place}"
        who = f"{self.axis} " if self.axis and (place is None or not place.axis) else ""
        # rounding of a value that is 0, such as the travel at home
        shown = 0.0 if abs(self.value) < 1e-12 * abs(self.limit) else self.value
        value, limit = format_distinct(shown, self.limit)
        above = self.value >= self.limit
        bound = f"beyond {limit} {self.unit}" if above else f"below the {limit} {self.unit} minimum"
        super().__init__(f"{who}{self.kind} {value} {self.unit} is {bound}{where}")

    def __str__(self) -> str:
        return f"{self.args[0]}; {self.remedy}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error with its complete remedy: the function for more advice stays here."""
        self.stated_remedy = self.remedy
        self.advise = None
        return super().__reduce__()

    @cached_property
    def remedy(self) -> str:
        """The change to make, and by how much."""
        if self.advise is None:
            return self.stated_remedy
        return f"{self.stated_remedy}; {self.advise()}"

    def add_advice(self, advise: Callable[[], object]) -> Self:
        """Return the error with more advice, computed when it is read."""
        return replace(self, stated_remedy=self.remedy, advise=advise)

    @property
    def relaxation(self) -> float:
        """Smallest factor on the limit, or divisor of a requested speed, that admits the value.

        It is ∞ if the limit is 0: an end of travel at home, which no factor moves.
        """
        return self.value / self.limit if self.limit else float("inf")


@dataclass(eq=False, repr=False)
class ConstantRefused(Infeasible):
    """A constant speed that the machine cannot keep or attain.

    requested  m/s, of the segment
    possible   m/s, largest that this place allows
    """

    requested: float = field(kw_only=True)
    possible: float = field(kw_only=True)

    def add_possible_speed(self, speed: float) -> Self:
        """Return the error with a speed (m/s) that is proved for the whole run."""
        remedy = f"{self.remedy}; {speed * 1e3:.6g} mm/s was found to hold"
        return replace(self, stated_remedy=remedy, advise=None)


class LostPath(OutOfReach):
    """A path beyond the reach of the actuators, with more advice, computed when it is read."""

    def __init__(self, message: str, advise: Callable[[], object]) -> None:
        self._advise: Callable[[], object] | None = advise
        super().__init__(message)

    def __str__(self) -> str:
        if self._advise is not None:
            self.args = (f"{self.args[0]}; {self._advise()}",)
            self._advise = None
        return str(self.args[0])

    def __reduce__(self) -> tuple[Any, ...]:
        str(self)  # completes the message: the function stays here
        return super().__reduce__()
