"""Tables of measurements, as GitHub's Markdown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Cell = str | float | None
"""A text is printed as it is, a number with six significant digits, None as an empty cell."""

Row = Sequence[Cell]


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells below a title.

    columns  headings, with units: "duration (s)"
    rows     may be a generator: each row is printed as soon as it is measured
    text     paragraph between the title and the rows
    """

    title: str
    columns: Sequence[str]
    rows: Iterable[Row]
    text: str = ""

    def lines(self) -> Iterator[str]:
        """Yield the lines of the table: title, text, header, rows."""
        if self.title:
            yield f"## {self.title}"
            yield ""
        if self.text:
            yield self.text
            yield ""
        yield markdown_row(self.columns)
        yield markdown_row(["---"] * len(self.columns))
        for row in self.rows:
            yield markdown_row(row)

    def __str__(self) -> str:
        return "\n".join(self.lines())


def markdown_row(cells: Row) -> str:
    """Return one line of a Markdown table."""
    return "| " + " | ".join(format_cell(cell).replace("|", r"\|") for cell in cells) + " |"


def format_cell(cell: Cell) -> str:
    """Return the text of a cell."""
    if cell is None:
        return ""
    if isinstance(cell, str):
        return cell
    return f"{cell:.6g}"


def store_rows(rows: Iterable[Row], store: list[Row]) -> Iterator[Row]:
    """Yield rows, and append each to a list for later use."""
    for row in rows:
        store.append(row)
        yield row


def quantile_table(title: str, samples: Mapping[str, Sequence[float]]) -> Table:
    """Return a table of least, median, nine tenths and largest value of each named sample."""
    rows = [
        [name, len(values), *np.quantile(values, [0.0, 0.5, 0.9, 1.0]).tolist()]
        for name, values in samples.items()
        if len(values)
    ]
    return Table(title, ("quantity", "number", "least", "median", "nine tenths", "largest"), rows)


def quote(title: str, result: object) -> str:
    """Return the printed form of a result as a block of text below a title."""
    return f"## {title}\n\n```text\n{result}\n```"
