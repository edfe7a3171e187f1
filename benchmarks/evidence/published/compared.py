"""A published number beside ours, and Markdown tables of them.

The command of a page in Markdown: printed, or written to a file.
"""

import argparse
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path


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
