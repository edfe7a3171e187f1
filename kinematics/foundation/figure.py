"""Figures that a notebook shows without pyplot, as the value of a cell: axes and the figure they
are on; and bars.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from io import BytesIO
from math import ceil, floor, log10
from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from kinematics.foundation.errors import MotionError
from kinematics.foundation.line_styles import PALETTE

TICK_DECADE = 8.0
"""Ratio of an axis's ends from which on it has ticks by decades."""


class NotebookFigure(Figure):
    """A figure that draws itself where it is the value of a cell; pyplot does not know it, so it is
    shown once.
    """

    def _repr_png_(self) -> bytes:
        buffer = BytesIO()
        self.savefig(buffer, format="png", bbox_inches="tight")
        return buffer.getvalue()


class _Shown:
    """Axes that show the figure they are on."""

    def _repr_png_(self) -> bytes | None:
        root = cast(Axes, self).get_figure(root=True)
        return root._repr_png_() if isinstance(root, NotebookFigure) else None


class NotebookAxes(_Shown, Axes):
    """Axes, flat."""


class NotebookAxes3D(_Shown, Axes3D):  # type: ignore[misc]  # mpl_toolkits comes without types
    """Axes in space."""


def new_axes(ax: Axes | None, size: tuple[float, float] = (9, 3.4)) -> Axes:
    """`ax`, or the axes of a new figure of so many inches. Raises MotionError for axes in space."""
    if isinstance(ax, Axes3D):
        raise MotionError(
            "this figure is flat, and its axes are in space; give others: plt.subplots(), or none"
        )
    return _new_figure(size).add_subplot(axes_class=NotebookAxes) if ax is None else ax


def new_axes_3d(ax: Axes3D | None, size: tuple[float, float] = (9, 5.4)) -> Axes3D:
    """The same in space. Raises MotionError for flat axes."""
    if ax is not None and not isinstance(ax, Axes3D):
        raise MotionError(
            "this figure is in space, and its axes are flat; give others: "
            'plt.subplots(subplot_kw={"projection": "3d"}), or none'
        )
    return (
        cast(Axes3D, _new_figure(size).add_subplot(axes_class=NotebookAxes3D)) if ax is None else ax
    )


UNSEEN = "\N{ZERO WIDTH SPACE}"
"""Before names that begin with an underscore, which matplotlib would leave out of legends."""


SPACE_TICKS = ((0.8, 4), (0.7, 3), (0.3, 2))
"""From which share of the longest side on, a side of axes in space has room for how many numbers;
below for one.
"""
CORNER = 0.08
"""Of a side: so near to its ends no number stands, since that of the next side may stand there."""
SPACE_ZOOM = 0.86
"""Of the size that leaves no room for names below."""
FLAT = 0.05
"""Share of the longest side, below which the height has no name."""
LEAST_PAD, MOST_PAD = 3.0, 32.0
"""Points between numbers and name of an axis, beside long sides and sides of no length:
matplotlib's own are shares of these.
"""


def label_space(ax: Axes3D) -> None:
    """Equal scales, and numbers and names of axes in space that do not overlap; call it when the
    limits stand.

    A side that is short beside the longest has few numbers, and one of next to no length no name:
    there is no room.
    """
    limits = {name: getattr(ax, f"get_{name}lim")() for name in "xyz"}
    ax.set_box_aspect([high - low for low, high in limits.values()], zoom=SPACE_ZOOM)
    longest = max(high - low for low, high in limits.values())
    shares = {name: (high - low) / longest for name, (low, high) in limits.items()}
    beside = {
        "x": (shares["y"] + shares["z"]) / 2,
        "y": (shares["x"] + shares["z"]) / 2,
        "z": max(shares["x"], shares["y"]),
    }
    for name, (low, high) in limits.items():
        axis = getattr(ax, f"{name}axis")
        count = next((count for share, count in SPACE_TICKS if shares[name] >= share), 1)
        axis.set_ticks(_choose_space_ticks(low, high, count))
        ax.tick_params(axis=name, labelsize="small", pad=2)
        flat = name == "z" and shares[name] < FLAT
        axis.set_label_text("" if flat else f"{name} (mm)")
        axis.labelpad = max(LEAST_PAD, MOST_PAD * (1 - beside[name]) * shares[name] ** 0.3)


def _choose_space_ticks(low: float, high: float, count: int) -> list[float]:
    """Round numbers, `count` at most, none of them near an end."""
    from matplotlib.ticker import MaxNLocator

    room = CORNER * (high - low)
    for bins in range(count + 2, 0, -1):
        ticks = [round(float(tick), 12) for tick in MaxNLocator(bins).tick_values(low, high)]
        inner = [tick for tick in ticks if low + room <= tick <= high - room]
        if 0 < len(inner) <= count:
            return inner
    return [round((low + high) / 2, 1 - floor(log10(high - low)))]


def literal_label(name: str) -> str:
    """A name as it stands: between two dollars matplotlib would read it as maths; `read_label` has
    it back.
    """
    return UNSEEN * name.startswith("_") + name.replace("$", r"\$")


def read_label(label: object) -> str:
    """The name that a label was made of."""
    return str(label).removeprefix(UNSEEN).replace(r"\$", "$")


def unique_labels(names: Iterable[str]) -> list[str]:
    """Names, literal, the second of a name with its number: bars of one name would lie upon each
    other.
    """
    told, met = [], Counter[str]()
    for name in names:
        met[name] += 1
        told.append(literal_label(name if met[name] == 1 else f"{name} ({met[name]})"))
    return told


def choose_ticks(low: float, high: float) -> tuple[float, ...]:
    """Round values of a logarithmic axis: like steps in one decade, beyond 1, 2 and 5 of each,
    powers over four.
    """
    from matplotlib.ticker import MaxNLocator

    if high < TICK_DECADE * low:
        ticks = [
            float(tick) for tick in MaxNLocator(nbins=7, steps=[1, 2, 5, 10]).tick_values(low, high)
        ]
    else:
        powers = range(floor(log10(low)), ceil(log10(high)) + 1)
        ticks = [
            float(f"{part}e{power}")
            for power in powers
            for part in ((1, 2, 5) if high < 1e4 * low else (1,))
        ]
    return tuple(round(tick, 9) for tick in ticks if low <= tick <= high)


def scale_error_axis(ax: Axes) -> None:
    """A logarithmic axis of errors that says 200 and 500, not powers; call it when all is drawn."""
    ax.set_yscale("log")
    ax.set_yticks([], minor=True)
    ticks = choose_ticks(*ax.get_ylim())
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])


def invert_y_axis(ax: Axes) -> None:
    """The first at the top, however often something is drawn."""
    ax.yaxis.set_inverted(True)


def _new_figure(size: tuple[float, float]) -> Figure:
    return NotebookFigure(figsize=size, layout="constrained")


def draw_bars(
    names: Sequence[str],
    values: Sequence[float],
    label: str,
    ax: Axes | None = None,
    limit: float | None = None,
) -> Axes:
    """Lying bars, the first on top; a dashed line at the limit."""
    from matplotlib.ticker import MaxNLocator

    ax = new_axes(ax, (7, max(2.2, 0.3 * len(names) + 1)))
    ax.barh(unique_labels(names), list(values), color=PALETTE[0])
    invert_y_axis(ax)
    if limit is not None:
        ax.axvline(limit, color="black", linestyle=(0, (6, 3)), linewidth=1)
    ax.set(xlabel=label)
    ax.xaxis.set_major_locator(MaxNLocator(6))  # small values have long numbers
    return ax
