"""Colours and dashes of lines. A module of its own, because pages need them without matplotlib."""

from typing import Any

PALETTE = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#7F7F7F",
)
"""Colours that colour-blind readers can distinguish [Okabe and Ito 2008].

Grey replaces yellow and black.
"""
DASHES = ("-", "--", "-.", ":")
LINE_WIDTH = 1.3


def line_style(n: int) -> dict[str, Any]:
    """Return the colour, dash and width of the n-th line."""
    color = PALETTE[n % len(PALETTE)]
    dash = DASHES[n // len(PALETTE) % len(DASHES)]
    return {"color": color, "linestyle": dash, "linewidth": LINE_WIDTH}
