"""Published numbers and published calculations next to ours, as tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.evidence.table import Table


@dataclass(frozen=True, slots=True)
class NumberComparison:
    """A published number and ours, in the same unit.

    published  the number as it is printed; its last digit states how far it is rounded
    """

    name: str
    unit: str
    published: str
    ours: float
    remark: str = ""

    @property
    def digits(self) -> int:
        """Printed digits after the point."""
        return len(self.published.partition(".")[2])

    @property
    def difference(self) -> float:
        """Ours − published."""
        return self.ours - float(self.published)

    def cells(self) -> list[str]:
        """Return the cells of the table: ours and the difference have one digit more than print."""
        digits = self.digits + 1
        return [
            self.name,
            self.published,
            f"{self.ours:.{digits}f}",
            f"{self.difference:+z.{digits}f}",
            self.unit,
            self.remark,
        ]


def compare_numbers(numbers: Iterable[NumberComparison]) -> Table:
    """Return the table of some numbers. Without any remark, the column of remarks is left out."""
    columns: Sequence[str] = ("what", "published", "ours", "ours − published", "unit", "remark")
    rows = [number.cells() for number in numbers]
    if not any(row[-1] for row in rows):
        columns = columns[:-1]
        rows = [row[:-1] for row in rows]
    return Table("", columns, rows)


@dataclass(frozen=True, slots=True)
class PublishedLine:
    """One line of a published calculation.

    printed      the number as it is printed, "8.060e-5"; its last digit states how far it is
                 rounded
    redone       result of the printed formula with its printed inputs
    ours         result of our model, None if it has no such line
    readings     results for other inputs that the source may have meant, by their names
    approximate  whether the source itself says "approx."
    note         further remark, for example why our model differs
    """

    name: str
    unit: str
    printed: str
    redone: float
    ours: float | None
    readings: Mapping[str, float] = field(default_factory=dict)
    approximate: bool = False
    note: str = ""

    @property
    def value(self) -> float:
        """The printed number."""
        return float(self.printed)

    @property
    def rounding(self) -> float:
        """One unit of the last printed digit."""
        mantissa, _, exponent = self.printed.partition("e")
        digits = len(mantissa.partition(".")[2])
        return float(10.0 ** (int(exponent or 0) - digits))

    @property
    def slip(self) -> bool:
        """True if the line gives another number than printed, and is not called approximate."""
        return not self.approximate and not self.gives(self.redone)

    @property
    def explained_by(self) -> tuple[str, ...]:
        """Readings that give the printed number."""
        return tuple(name for name, value in self.readings.items() if self.gives(value))

    def gives(self, value: float) -> bool:
        """Return whether `value`, rounded or cut off, is the printed number."""
        beyond = abs(value) - abs(self.value)
        rounded = abs(beyond) <= self.rounding / 2
        cut = 0 <= beyond < self.rounding
        return value * self.value > 0 and (rounded or cut)

    def remark(self) -> str:
        """Return the remark of the table: a slip, the readings that explain it, and the note."""
        parts = []
        if self.slip:
            parts.append(f"SLIP: the line gives {format_value(self.redone)}")
            if self.explained_by:
                parts.append(f"the number follows from {', or '.join(self.explained_by)}")
        elif not self.gives(self.redone):
            parts.append("printed as approximate")
        if self.note:
            parts.append(self.note)
        return "; ".join(parts)

    def cells(self) -> list[str]:
        """Return the cells of the table: the difference to a tenth of the last printed digit."""
        ours, difference = "-", "-"
        if self.ours is not None:
            tenth = self.rounding / 10
            rounded = round((self.ours - self.value) / tenth) * tenth
            ours = format_value(self.ours)
            difference = f"{rounded:+.2g}" if rounded else "0"
        return [
            self.name,
            self.printed,
            format_value(self.redone),
            ours,
            difference,
            self.unit,
            self.remark(),
        ]


def compare_lines(lines: Iterable[PublishedLine]) -> Table:
    """Return the table of a calculation, line by line."""
    columns = ("line", "printed", "redone", "ours", "ours - printed", "unit", "remark")
    return Table("", columns, [line.cells() for line in lines])


def format_value(value: float) -> str:
    """Return five significant digits; tiny and huge numbers as 8.06e-5."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        return f"{value:.5g}"
    return f"{value:.4g}".replace("e-0", "e-").replace("e+0", "e")
