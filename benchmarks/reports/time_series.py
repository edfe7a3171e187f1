"""Series over time that a page redraws: read from the figures, thinned by their extremes, packed as
text.
"""

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from kinematics.foundation.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TIME = "time (s)"
"""The label of axes that are drawn anew."""
MOST_STRETCHES = 2000
"""Stretches of time of a long series in a page: more than a screen has columns, and soon drawn at
every move.
"""


@dataclass(frozen=True, slots=True)
class TimeSeries:
    """One line: t (N,) s, values (N,) in the unit of its panel.

    step     each value holds up to the next instant
    thinned  these are extremes, as `keep_extremes` gives them
    """

    name: str
    t: Array
    values: Array
    color: str
    dash: int = 0
    step: bool = False
    thinned: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """The lines of one pair of axes over time. levels: values and colours of horizontal lines,
    mostly limits.
    """

    label: str
    series: tuple[TimeSeries, ...]
    levels: tuple[tuple[float, str], ...]


def read_panels(axes: Sequence["Axes"]) -> tuple[Panel, ...]:
    """The panels of those axes that are over time, and of others that lie upon them with a scale of
    their own.
    """
    figure = axes[0].get_figure(root=True)
    every = [*axes, *(ax for ax in ([] if figure is None else figure.axes) if ax not in axes)]
    clocks = [ax for ax in every if ax.get_xlabel() == TIME]
    over_time = [ax for ax in every if any(ax is clock or _share_x(ax, clock) for clock in clocks)]
    panels = (
        Panel(ax.get_ylabel(), tuple(_read_series(ax)), tuple(_read_levels(ax))) for ax in over_time
    )
    return tuple(panel for panel in panels if panel.series)


def _share_x(ax: "Axes", other: "Axes") -> bool:
    return bool(ax.get_shared_x_axes().joined(ax, other))


def _read_series(ax: "Axes") -> Iterator[TimeSeries]:
    from matplotlib.colors import to_hex
    from matplotlib.patches import StepPatch

    from kinematics.foundation.figure import read_label
    from kinematics.foundation.line_styles import DASHES

    for line in ax.lines:
        if line.get_transform() == ax.transData and not str(line.get_label()).startswith("_"):
            t, values = (np.asarray(each, float) for each in line.get_data())
            dash = DASHES.index(str(line.get_linestyle())) if line.get_linestyle() in DASHES else 1
            yield TimeSeries(
                read_label(line.get_label()), t, values, to_hex(line.get_color()), dash
            )
    for patch in ax.patches:
        if isinstance(patch, StepPatch):
            values, edges, _ = patch.get_data()
            dash = 0 if patch.get_linestyle() in ("-", "solid") else 1
            steps = np.append(values, values[-1:])
            color = to_hex(patch.get_edgecolor())
            yield TimeSeries(
                read_label(patch.get_label()), np.asarray(edges), steps, color, dash, True
            )


def _read_levels(ax: "Axes") -> Iterator[tuple[float, str]]:
    """The values of lines from one side of the axes to the other, at one height, and their
    colours.
    """
    from matplotlib.colors import to_hex

    for line in ax.lines:
        if line.get_transform() == ax.get_yaxis_transform(which="grid"):
            yield float(np.asarray(line.get_ydata(), float)[0]), to_hex(line.get_color())


def keep_extremes(t: Array, values: Array, most: int = MOST_STRETCHES) -> tuple[Array, Array]:
    """A series (N,) whose samples, all but the first and the last, are taken together in at most
    `most` stretches.

    Of each stretch there are the least and the greatest value, in their order: at the first instant
    of the stretch, and half-way to that of the next, so that series with the same instants share
    the new ones too. Returns t and values (2 K + 2,) of K stretches; a series of at most 2 `most` +
    2 samples as it is.
    """
    if len(t) <= 2 * most + 2:
        return t, values
    size = -(-(len(t) - 2) // most)
    inner = np.arange(1, len(t) - 1)
    rows = values[np.pad(inner, (0, -len(inner) % size), mode="edge").reshape(-1, size)]
    both = np.stack([rows.min(1), rows.max(1)], 1)
    falls = rows.argmin(1) > rows.argmax(1)
    both[falls] = both[falls, ::-1]
    begins = np.append(t[1:-1:size], t[-1])
    instants = np.stack([begins[:-1], (begins[:-1] + begins[1:]) / 2], 1)
    return (
        np.concatenate([t[:1], instants.ravel(), t[-1:]]),
        np.concatenate([values[:1], both.ravel(), values[-1:]]),
    )


def pack_panels(panels: Mapping[str, Sequence[Panel]]) -> dict[str, Any]:
    """The panels of figures, by name, as a page's script reads them; instants that series share are
    held once.
    """
    times: dict[str, int] = {}
    packed = {
        name: [_pack_panel(panel, times) for panel in each] for name, each in panels.items() if each
    }
    return {"times": list(times), "figures": packed}


def _pack_panel(panel: Panel, times: dict[str, int]) -> dict[str, Any]:
    series = [_pack_series(one, times) for one in panel.series]
    return {"label": panel.label, "levels": list(panel.levels), "series": series}


def _pack_series(series: TimeSeries, times: dict[str, int]) -> dict[str, Any]:
    t, values = keep_extremes(series.t, series.values)
    style = {"name": series.name, "color": series.color, "dash": series.dash, "step": series.step}
    at = times.setdefault(_pack(t), len(times))
    return {
        **style,
        "t": at,
        "y": _pack(values),
        "thinned": series.thinned or len(t) < len(series.t),
    }


def _pack(values: Array) -> str:
    """Return values as the base64 of little-endian float32."""
    return b64encode(np.ascontiguousarray(values, "<f4").tobytes()).decode("ascii")
