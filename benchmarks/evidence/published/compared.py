"""Published numbers and published calculations beside ours: as Markdown tables, and the command of a page of them.

A calculation stands line by line: what is printed, the same line redone, and ours, with the slips found.
"""

import argparse
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, log10
from pathlib import Path

from kinematics.foundation.table import Column, Table


@dataclass(frozen=True, slots=True)
class NumberComparison:
    """published: the number as it stands in print, whose last digit says how far it is rounded; ours, in that unit."""

    what: str
    unit: str
    published: str
    ours: float
    remark: str = ""

    @property
    def digits(self) -> int:
        return len(self.published.partition(".")[2])

    @property
    def difference(self) -> float:
        """ours − published."""
        return self.ours - float(self.published)

    @property
    def cells(self) -> list[str]:
        """Ours and the difference with one digit more than is printed."""
        digits = self.digits + 1
        difference = round(self.difference, digits) + 0.0  # no −0
        return [
            self.what,
            self.published,
            f"{self.ours:.{digits}f}",
            f"{difference:+.{digits}f}",
            self.unit,
            self.remark,
        ]


HEADER = ("what", "published", "ours", "ours − published", "unit", "remark")


def comparison(rows: Iterable[NumberComparison]) -> str:
    """The table of some numbers; no column of remarks where there are none."""
    cells = [row.cells for row in rows]
    if not any(row[-1] for row in cells):
        return markdown(HEADER[:-1], [row[:-1] for row in cells])
    return markdown(HEADER, cells)


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of GitHub's Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines)


def run(about: str, page: Callable[[], str]) -> None:
    """Print what `page` makes, or write it where --out says; about: the command's help."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the page here; printed by default")
    out = parser.parse_args().out
    text = page()
    if out is None:
        print(text, end="")
        return
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        parser.error(f"cannot write {out}: {error.strerror}")


@dataclass(frozen=True, slots=True)
class PublishedLine:
    """One line of a calculation.

    printed   the number as it stands in print, "8.060e-5", whose last digit says how far it is rounded
    redone    the printed formula, with its printed inputs
    ours      what our model gives, None where it has no such line
    readings  other inputs that may have been meant, and what they give: those that give what is printed explain a slip
    approximate  the source itself says "approx."
    note      what else there is to say, such as why our model differs
    """

    what: str
    unit: str
    printed: str
    redone: float
    ours: float | None
    readings: Mapping[str, float] = field(default_factory=dict)
    approximate: bool = False
    note: str = ""

    @property
    def value(self) -> float:
        return float(self.printed)

    @property
    def rounding(self) -> float:
        """One unit of the last printed digit."""
        mantissa, _, exponent = self.printed.lower().partition("e")
        digits = len(mantissa.partition(".")[2])
        return float(10.0 ** (int(exponent or 0) - digits))

    @property
    def difference(self) -> float | None:
        """ours − printed."""
        return None if self.ours is None else self.ours - self.value

    @property
    def slip(self) -> bool:
        """Whether the line gives another number than is printed: neither rounded, nor cut off, nor "approx."."""
        return not self.approximate and not self._gives(self.redone)

    @property
    def explained_by(self) -> tuple[str, ...]:
        """The readings that give the printed number."""
        return tuple(name for name, value in self.readings.items() if self._gives(value))

    @property
    def remark(self) -> str:
        parts = [self.note] if self.note else []
        if self.slip:
            meant = ", or ".join(self.explained_by)
            parts.insert(0, f"SLIP: the line gives {format_value(self.redone)}")
            if meant:
                parts.insert(1, f"the number follows from {meant}")
        elif not self._gives(self.redone):
            parts.insert(0, "printed as approximate")
        return "; ".join(parts)

    def _gives(self, value: float) -> bool:
        beyond = abs(value) - abs(self.value)
        rounded, cut = abs(beyond) <= self.rounding / 2, 0 <= beyond < self.rounding
        return value * self.value > 0 and (rounded or cut)


LINE_HEADER = ("line", "printed", "redone", "ours", "ours - printed", "unit", "remark")


def cells(line: PublishedLine) -> list[str]:
    """What a table shows of it; a difference to a tenth of the last printed digit."""
    tenth = line.rounding / 10
    difference = None if line.difference is None else round(line.difference / tenth) * tenth
    return [
        line.what,
        line.printed,
        format_value(line.redone),
        "-" if line.ours is None else format_value(line.ours),
        "-" if difference is None else f"{difference:+.2g}" if difference else "0",
        line.unit,
        line.remark,
    ]


def table(lines: Iterable[PublishedLine]) -> str:
    """All of them, in plain text."""
    return text_table(LINE_HEADER, map(cells, lines), LINE_HEADER[1:5])


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[str]) -> str:
    """Texts as a table for a terminal; numbers: the columns that hold such."""
    columns = zip(header, zip(*rows, strict=True), strict=True)
    return str(Table("", tuple(Column(name, texts, right=name in numbers) for name, texts in columns)))


def format_value(value: float) -> str:
    """Five significant digits; tiny numbers as 8.06e-5."""
    if value and not -3 <= floor(log10(abs(value))) < 6:
        return re.sub(r"e([+-])0*(\d)", lambda m: f"e{m[1].replace('+', '')}{m[2]}", f"{value:.4g}")
    return f"{value:.5g}"
