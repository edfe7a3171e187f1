"""Line styles of limits, the same by name in every figure and page."""

from collections.abc import Iterable, Sequence
from typing import Any

from kinematics.foundation.line_styles import PALETTE, line_style
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS, geometric_limits

TIMED_COLOURS = (
    "#0072B2", "#E69F00", "#56B4E9", "#CC79A7", "#009E73",
    "#D55E00", "#5D3A9B", "#8A5A00", "#882255", "#004D40",
    "#7F7F7F",
)  # fmt: skip
"""Colours of the limits that depend on timing, in the order of the tables."""


def style_limits(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Return the line style of each limit by name.

    Limits that depend on timing have a colour each, geometric ones are dashed, and those of a
    caller are dotted.
    """
    names = list(names)
    still = geometric_limits()
    timed = [limit.name for limit in (*AXIS_LIMITS, *MACHINE_LIMITS) if limit.name not in still]
    families: tuple[tuple[Sequence[str], Sequence[str], str], ...] = (
        (timed, TIMED_COLOURS, "-"),
        (still, PALETTE, "--"),
        (names, PALETTE, ":"),
    )
    styles: dict[str, dict[str, Any]] = {}
    for name in names:
        members, colours, line = next(family for family in families if name in family[0])
        color = colours[members.index(name) % len(colours)]
        styles[name] = {**line_style(0), "color": color, "linestyle": line}
    return styles
