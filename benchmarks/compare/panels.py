"""What the figures of a gain report share: lines, marks, panels and one legend for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from kinematics.figure import PALETTE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.2)), (0, (7, 2, 1.5, 2)), (0, (1, 1)))
MARKS = "osD^vPX*<>hp"
COLOURS = (*PALETTE, "#5D3A9B", "#8A5A00", "#882255", "#004D40", "#4D4D4D")
"""As many as there are marks: more settings than the palette has colours share none."""
WIDTH = 11.0
"""Inches: as wide as a page of A4 on its side, so that text stays as large as it was drawn."""


def line(n: int) -> dict[str, Any]:
    return {
        "color": color(n),
        "linestyle": DASHES[n % len(DASHES)],
        "linewidth": 1.7 if n < 2 else 1.2,
    }


def color(n: int) -> str:
    return COLOURS[n % len(COLOURS)]


def mark(n: int) -> dict[str, Any]:
    """Hollow beyond the palette."""
    return {"marker": MARKS[n % len(MARKS)], "markerfacecolor": color(n) if n < len(PALETTE) else "white"}


def grid(count: int, columns: int, height: float) -> list[Axes]:
    """So many panels of a height in inches, in up to so many columns."""
    from matplotlib.figure import Figure

    columns = min(columns, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH, rows * height + 0.9), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.remove()
    return axes[:count]


def legend(axes: Sequence[Axes], columns: int = 3) -> list[Axes]:
    """One legend above all axes, of every line that any has."""
    known: dict[str, Any] = {}
    for ax in axes:
        known.update(dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True)))
    figure = axes[0].get_figure(root=True)
    if figure is not None and known:
        figure.legend(known.values(), known.keys(), loc="outside upper center", ncols=columns, frameon=False)
    return list(axes)
