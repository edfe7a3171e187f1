"""What every report page is made with: figures as PNG, numbers as text, and the template engine."""

from base64 import b64encode
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from io import BytesIO
from math import ceil, floor, inf
from typing import TYPE_CHECKING, Any

from kinematics.files.plain_text import plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI, SMALL_DPI = 150, 115
MAX_TEXT_LENGTH = 1 << 16
"""Characters from which on a text is a figure, which is base64, or data."""


def style() -> AbstractContextManager[None]:
    """Inside it, figures are drawn as a page has them."""
    from matplotlib import rc_context

    return rc_context(
        {"axes.grid": True, "grid.color": "#E6E6E6", "axes.spines.top": False, "axes.spines.right": False}
    )


def render_png(*axes: "Axes", colours: int | None = None) -> bytes:
    """The figure that the axes belong to; of those that share their time axis only the last is labelled.

    colours: of a palette to which the image is reduced, with fewer dots, where many figures must make a small page.
    """
    for ax in axes[:-1]:
        if ax.get_shared_x_axes().joined(ax, axes[-1]):
            ax.set_xlabel("")
    figure: Figure | None = axes[0].get_figure(root=True)
    buffer = BytesIO()
    if figure is not None:
        dpi = DPI if colours is None else SMALL_DPI
        figure.set_dpi(dpi)
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)  # saving would draw all of it once for that
            figure.set_layout_engine("none")
        figure.savefig(buffer, format="png", dpi=dpi)
    return buffer.getvalue() if colours is None else _reduce_colours(buffer, colours)


def _reduce_colours(image: BytesIO, colours: int) -> bytes:
    from PIL import Image  # comes with matplotlib

    out = BytesIO()
    Image.open(image).convert("RGB").quantize(colours, dither=Image.Dither.NONE).save(out, "PNG", compress_level=9)
    return out.getvalue()


def render(template: str, figures: Mapping[str, bytes], **values: object) -> str:
    """The page of a template; its figures are part of it, and names in it are no markup, and nothing that is obeyed."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages = Environment(
        loader=PackageLoader("benchmarks"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        finalize=_escape_text,
    )
    pages.filters.update(FILTERS)
    drawn = {name: b64encode(image).decode("ascii") for name, image in figures.items()}
    return pages.get_template(template).render(
        figures=drawn, **{name: _escape_data(value) for name, value in values.items()}
    )


def _escape_text(value: object) -> object:
    """What an expression of a template gives; markup and figures are ours."""
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


FILTERS: dict[str, Callable[..., Any]] = {
    "down": lambda value, digits: f"{floor(value * 10**digits) / 10**digits:.{digits}f}",
    "fixed": lambda value, digits: f"{value:.{digits}f}",
    "general": lambda value, digits: f"{value:.{digits}g}",
    "grouped": group_digits,
    "up": round_up,
    "zip": zip,
}
