"""Figures in the units that people read."""

from __future__ import annotations

from math import inf, isfinite

HUMAN = {
    "m": ("µm", 1e6),
    "rad": ("mrad", 1e3),
    "s": ("ms", 1e3),
    "": ("%", 100.0),
    "m/s³": ("m/s³", 1.0),
    "rad/s³": ("rad/s³", 1.0),
    "m²": ("µm²", 1e12),
    "rad²": ("µrad²", 1e12),
    "pulses": ("pulses", 1.0),
}
"""SI unit -> what it is shown in, and the factor; shares in per cent."""


def shown(value: float, unit: str) -> str:
    """A value with its unit: "412 µm"."""
    name, _ = HUMAN.get(unit, (unit, 1.0))
    return f"{number(value, unit)} {name}"


def number(value: float, unit: str) -> str:
    """A value without it, to four digits at most: "412", "0.0713"; "∞" and "–" for none."""
    if value == inf:
        return "∞"
    if not isfinite(value):
        return "–"
    scaled = value * HUMAN.get(unit, (unit, 1.0))[1]
    if scaled == 0:
        return "0"
    digits = max(0, min(4, 2 - int(f"{abs(scaled):e}".partition("e")[2])))
    return f"{scaled:.{digits}f}".replace("-", "−")
