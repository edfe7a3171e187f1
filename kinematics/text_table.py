"""Tables in plain text, for the `print` of result objects."""

from collections.abc import Sequence


def aligned(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Columns side by side, two spaces apart: the first from the left, those that hold numbers from the right.

    The last column, free text as a rule, is left as it is.
    """
    table = [header, *rows]
    widths = [max(len(row[k]) for row in table) for k in range(len(header))]
    number = [
        k > 0 and any(row[k] for row in rows) and all(_numeric(row[k]) for row in rows) for k in range(len(header))
    ]
    lines = (
        "  ".join(cell.rjust(w) if right else cell.ljust(w) for cell, w, right in zip(row, widths, number, strict=True))
        for row in table
    )
    return "\n".join(line.rstrip() for line in lines)


def _numeric(cell: str) -> bool:
    return not cell or cell == "-" or cell[0].isdigit() or (cell[0] in "+-" and cell[1:2].isdigit())
