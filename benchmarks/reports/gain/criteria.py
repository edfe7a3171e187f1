"""What a verdict weighs: what a user of a machine would look at, each against the baseline, in
units people read.
"""

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
"""Of a path: its "floor", m or rad, below which errors are not told apart, and "pulses", m or rad,
of every axis.
"""

QUANTIZED = 0.3
"""Pulses RMS: what rounding to whole pulses alone shakes a shaft by, 1/√12; less is no
difference.
"""
LEAST_TORQUE = 0.01
"""Of the torque limit, RMS."""
MIN_LATE, MAX_LATE = 0.01, 0.5
"""s after the planned end: sooner is no difference, and a record ends so late that is off its goal
to the end.
"""


@dataclass(frozen=True, slots=True)
class Criterion:
    """One thing that is weighed.

    weight   of its logarithm: the weights of all sum to 1. A choice of this project, no measurement
    figure   of a run that it is; "" where it is made of several
    measure  value of a run's figures; None where the run has no such figure
    floor    value below which a difference does not count, on a path
    most     value above which it does not count either
    shown    a value in words; of the unit of the path's errors, where it is one
    """

    name: str
    weight: float
    figure: str
    measure: Callable[[Figures, About], float | None]
    floor: Callable[[About], float]
    shown: Callable[[float, str], str]
    most: float = inf

    def value(self, figures: Figures, about: About) -> float | None:
        """Return the value that counts, between floor and most; None where the run has no such
        figure.
        """
        measured = self.measure(figures, about)
        return None if measured is None else min(max(measured, self.floor(about)), self.most)


def _figure(name: str) -> Callable[[Figures, About], float | None]:
    return lambda figures, _: figures.get(name)


def _error_floor(about: About) -> float:
    return float(about["floor"])


def _vibration(figures: Figures, about: About) -> float | None:
    """Return the RMS of the shaft that shakes most, in its pulses."""
    pulses = about["pulses"]
    named = {axis: f"vibration_power.{axis}" for axis in pulses}
    powers = [
        figures[named[axis]] / pulse**2 for axis, pulse in pulses.items() if named[axis] in figures
    ]
    return sqrt(max(powers)) if powers else None


def _show_late(value: float, _: str) -> str:
    return f"{1e3 * value:.3g} ms late" if value < MAX_LATE else "off its goal to the end"


CRITERIA = (
    Criterion(
        "contour error", 0.4, "contour_rms", _figure("contour_rms"), _error_floor, format_unit
    ),
    Criterion(
        "tracking error", 0.2, "tracking_rms", _figure("tracking_rms"), _error_floor, format_unit
    ),
    Criterion(
        "vibration",
        0.2,
        "",
        _vibration,
        lambda _: QUANTIZED,
        lambda value, _: f"{count_noun(value, 'pulse', '.3g')} RMS",
    ),
    Criterion(
        "effort",
        0.1,
        "torque_rms",
        _figure("torque_rms"),
        lambda _: LEAST_TORQUE,
        lambda value, _: f"{100 * value:.3g} % of the torque limit RMS",
    ),
    Criterion("end", 0.1, "late", _figure("late"), lambda _: MIN_LATE, _show_late, MAX_LATE),
)
TRADE_RATIO = 1.25
"""A criterion that is worse by more than this factor is named beside what is gained."""


def compare_figures(own: Figures, base: Figures, about: About) -> dict[str, float]:
    """Return the ratio of a run to the baseline's by each criterion that both have, as it
    counts.
    """
    return _divide(own, base, about, lambda one: one.value)


def measure_ratios(own: Figures, base: Figures, about: About) -> dict[str, float]:
    """Return the ratios of the measured values, also below the floors, of criteria where both are
    above zero.
    """
    return _divide(own, base, about, lambda one: one.measure)


def _divide(
    own: Figures,
    base: Figures,
    about: About,
    choose: Callable[[Criterion], Callable[[Figures, About], float | None]],
) -> dict[str, float]:
    ratios = {}
    for one in CRITERIA:
        read = choose(one)
        mine, theirs = read(own, about), read(base, about)
        if mine is not None and theirs is not None and 0 < mine < inf and 0 < theirs < inf:
            ratios[one.name] = mine / theirs
    return ratios


def floors_text(floor: str) -> str:
    """Say below what the criteria do not count; `floor` is that of errors, with its unit."""
    return (
        f"errors below {floor} (a hundredth of the smallest pulse), "
        f"vibration below {QUANTIZED:g} pulses RMS (what whole pulses alone cause), "
        f"effort below {100 * LEAST_TORQUE:g} % of the torque limit RMS, "
        f"and an end less than {1e3 * MIN_LATE:g} ms late"
    )


def mean_of(ratios: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Geometric means, of the criteria that all have."""
    names = [one.name for one in CRITERIA if ratios and all(one.name in each for each in ratios)]
    return {name: exp(sum(log(each[name]) for each in ratios) / len(ratios)) for name in names}


def weigh(ratios: Mapping[str, float]) -> float:
    """The weighed ratio to the baseline, exp(Σ w ln r / Σ w) over the criteria there are; below 1
    is better.
    """
    present = [one for one in CRITERIA if one.name in ratios and isfinite(ratios[one.name])]
    total = sum(one.weight for one in present)
    return (
        exp(sum(one.weight * log(ratios[one.name]) for one in present) / total) if present else 1.0
    )


def weights_text() -> str:
    """ "contour error 40 %, …" """
    return ", ".join(f"{one.name} {100 * one.weight:.0f} %" for one in CRITERIA)
