"""What a verdict weighs: what a user of a machine would look at, each against the baseline, in units people read."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, inf, isfinite, log, sqrt
from typing import Any

from kinematics.foundation.names import count_noun

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


def format_unit(value: float, unit: str) -> str:
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


Figures = Mapping[str, float]
About = Mapping[str, Any]
"""Of a path: its "floor", m or rad, below which errors are not told apart, and "pulses", m or rad, of every axis."""

QUANTIZED = 0.3
"""Pulses RMS: what rounding to whole pulses alone shakes a shaft by, 1/√12; less is no difference."""
LEAST_TORQUE = 0.01
"""Of the torque limit, RMS."""
MIN_LATE, MAX_LATE = 0.01, 0.5
"""s after the planned end: sooner is no difference, and a record ends so late that is off its goal to the end."""


@dataclass(frozen=True, slots=True)
class Criterion:
    """One thing that is weighed.

    weight  of its logarithm: the weights of all sum to 1. A choice of this project, no measurement
    figure  of a run that it is; "" where it is made of several
    value   of a run's figures, never below what makes a difference; None where the run has no such figure
    shown   a value in words; of the unit of the path's errors, where it is one
    """

    name: str
    weight: float
    figure: str
    value: Callable[[Figures, About], float | None]
    shown: Callable[[float, str], str]


def _error(name: str) -> Callable[[Figures, About], float | None]:
    return lambda figures, about: None if name not in figures else max(figures[name], about["floor"])


def _vibration(figures: Figures, about: About) -> float | None:
    """RMS of the shaft that shakes most, in its pulses."""
    pulses = about["pulses"]
    named = {axis: f"vibration_power.{axis}" for axis in pulses}
    powers = [figures[named[axis]] / pulse**2 for axis, pulse in pulses.items() if named[axis] in figures]
    return max(sqrt(max(powers)), QUANTIZED) if powers else None


def _effort(figures: Figures, about: About) -> float | None:
    return max(figures["torque_rms"], LEAST_TORQUE) if "torque_rms" in figures else None


def _end(figures: Figures, about: About) -> float | None:
    return min(max(figures["late"], MIN_LATE), MAX_LATE) if "late" in figures else None


CRITERIA = (
    Criterion("contour error", 0.4, "contour_rms", _error("contour_rms"), format_unit),
    Criterion("tracking error", 0.2, "tracking_rms", _error("tracking_rms"), format_unit),
    Criterion("vibration", 0.2, "", _vibration, lambda value, _: f"{count_noun(value, 'pulse', '.3g')} RMS"),
    Criterion("effort", 0.1, "torque_rms", _effort, lambda value, _: f"{100 * value:.3g} % of the torque limit RMS"),
    Criterion(
        "end",
        0.1,
        "late",
        _end,
        lambda value, _: f"{1e3 * value:.3g} ms late" if value < MAX_LATE else "off its goal to the end",
    ),
)
TRADE_RATIO = 1.25
"""A criterion that is worse by more than this factor is named beside what is gained."""


def compare_figures(own: Figures, base: Figures, about: About) -> dict[str, float]:
    """The ratio of a run to the baseline's by each criterion that both have."""
    found = {}
    for one in CRITERIA:
        mine, theirs = one.value(own, about), one.value(base, about)
        if mine is not None and theirs is not None:
            found[one.name] = mine / theirs
    return found


def mean_of(ratios: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Geometric means, of the criteria that all have."""
    names = [one.name for one in CRITERIA if ratios and all(one.name in each for each in ratios)]
    return {name: exp(sum(log(each[name]) for each in ratios) / len(ratios)) for name in names}


def weigh(ratios: Mapping[str, float]) -> float:
    """The weighed ratio to the baseline, exp(Σ w ln r / Σ w) over the criteria there are; below 1 is better."""
    present = [one for one in CRITERIA if one.name in ratios and isfinite(ratios[one.name])]
    total = sum(one.weight for one in present)
    return exp(sum(one.weight * log(ratios[one.name]) for one in present) / total) if present else 1.0


def weights_text() -> str:
    """ "contour error 40 %, …" """
    return ", ".join(f"{one.name} {100 * one.weight:.0f} %" for one in CRITERIA)
