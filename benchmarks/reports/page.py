"""The parts of every report page: figures as PNG, numbers as text, and the template engine."""

from base64 import b64encode
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from io import BytesIO
from math import ceil, floor, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.reports.time_series import Panel, pack_panels, read_panels
from kinematics.files.plain_text import plain
from kinematics.foundation.names import count_noun

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI, SMALL_DPI = 150, 115
NARROW = 5.4
"""Width (inches) of a figure whose letters are large enough on the screen of a telephone."""
COLOURS, NEARLY_WHITE = 128, 248
"""Colours in the palette of a figure, enough for a colour map and soft edges; channel value that
counts as white.
"""
EDGE = 12
"""Blank dots that stay at the left and the right of a figure."""
MAX_TEXT_LENGTH = 1 << 16
"""Characters from which on a text is a figure, which is base64, or data."""


def style() -> AbstractContextManager[None]:
    """Inside it, figures are drawn as a page has them."""
    from matplotlib import rc_context

    return rc_context(
        {
            "axes.grid": True,
            "grid.color": "#E6E6E6",
            "axes.spines.top": False,
            "axes.spines.right": False,
        }
    )


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure as a PNG image, and its panels over time, which a page can redraw."""

    png: bytes
    panels: tuple[Panel, ...] = ()


def draw_figure(*axes: "Axes", small: bool = False) -> Picture:
    """Return the picture of the figure that the axes belong to.

    Axes that share a time axis have one label.

    small: fewer dots, for pages with many figures.
    """
    panels = read_panels(axes)
    for ax in axes[:-1]:
        if ax.get_shared_x_axes().joined(ax, axes[-1]):
            ax.set_xlabel("")
    figure: Figure | None = axes[0].get_figure(root=True)
    if figure is None:
        return Picture(b"", panels)
    figure.set_dpi(SMALL_DPI if small else DPI)
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)  # drawing would draw all of it once for that
        figure.set_layout_engine("none")
    return Picture(_render_png(figure), panels)


def _render_png(figure: "Figure") -> bytes:
    """Render with a palette of 128 colours: a quarter of the bytes, in the time of their
    compression.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image  # comes with matplotlib

    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]  # matplotlib states no types here
    dots = np.asarray(canvas.buffer_rgba())[..., :3]  # type: ignore[no-untyped-call]  # matplotlib states no types here
    inked = np.flatnonzero((dots < NEARLY_WHITE).any((0, 2)))
    if len(inked):  # a figure in space leaves its sides blank, which is all that a phone would show
        dots = dots[:, max(inked[0] - EDGE, 0) : inked[-1] + EDGE]
    drawn = Image.fromarray(np.ascontiguousarray(dots))
    out = BytesIO()
    reduced = drawn.quantize(COLOURS, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE)
    palette = np.array(reduced.getpalette("RGB"))
    reduced.putpalette(
        np.where(palette >= NEARLY_WHITE, 255, palette).tolist()
    )  # the paper stays white
    reduced.save(out, "PNG", dpi=(figure.dpi, figure.dpi))
    return out.getvalue()


def render(template: str, figures: Mapping[str, Picture], **values: object) -> str:
    """Return the page of a template, with its figures. Names in it are escaped."""
    drawn = {name: b64encode(drawing.png).decode("ascii") for name, drawing in figures.items()}
    series = pack_panels({name: drawing.panels for name, drawing in figures.items()})
    return (
        _open_templates()
        .get_template(template)
        .render(
            figures=drawn,
            series=series,
            **{name: _escape_data(value) for name, value in values.items()},
        )
    )


@cache
def _open_templates() -> "Environment":
    """Return the templates of pages. Each is compiled at its first use in a process."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    pages = Environment(
        loader=PackageLoader("benchmarks"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        finalize=_escape_text,
    )
    pages.filters.update(FILTERS)
    pages.globals["read_file"] = lambda name: Markup(
        _read_template_file(name)
    )  # ours, as it stands
    return pages


def _read_template_file(name: str) -> str:
    return files("benchmarks").joinpath("templates", *name.split("/")).read_text(encoding="utf-8")


def save_figures(figures: Mapping[str, Picture], page: Path) -> None:
    """Save every figure of a page as `figures/*.png` in its folder."""
    folder = page.parent / "figures"
    for name, drawing in figures.items():
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.png").write_bytes(drawing.png)


def _escape_text(value: object) -> object:
    """Escape the value of an expression in a template. Markup and figures are our own."""
    return plain(value) if type(value) is str and len(value) < MAX_TEXT_LENGTH else value


def _escape_data(value: object) -> object:
    """Data for a page's script, which shows texts in it without the template."""
    match value:
        case dict():
            return {_escape_data(key): _escape_data(entry) for key, entry in value.items()}
        case list():
            return [_escape_data(entry) for entry in value]
    return _escape_text(value)


def group_digits(number: int | str) -> str:
    """A whole number in groups of three digits, kept together by narrow spaces."""
    return f"{int(number):,}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def round_up(value: float, digits: int) -> str:
    """An upper bound, rounded up, so that the text is a bound too."""
    return f"{ceil(value * 10**digits) / 10**digits:.{digits}f}" if value < inf else "∞"


def describe_span(seconds: float) -> str:
    """A span of time, in ms below a second."""
    return f"{1e3 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.4g} s"


FILTERS: dict[str, Callable[..., Any]] = {
    "counted": count_noun,
    "down": lambda value, digits: f"{floor(value * 10**digits) / 10**digits:.{digits}f}",
    "fixed": lambda value, digits: f"{value:.{digits}f}",
    "general": lambda value, digits: f"{value:.{digits}g}",
    "grouped": group_digits,
    "sentence": lambda text: f"{text[:1].upper()}{text[1:]}.",
    "span": describe_span,
    "up": round_up,
    "zip": zip,
}
