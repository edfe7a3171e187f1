"""A motion in the numbers of a file: mm and degrees or pulses per axis, in as many decimals as its tolerance needs."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil, log10, pi
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array, frozen
from planner.export.format import Source, option
from planner.export.knots import TOLERANCE, Knots, rows_at, seconds

BLOCK = 1 << 12  # points written or read together
ROUNDING = 1e-3  # of the tolerance that half a unit of the last decimal may be
DECIMALS = (6, 15)  # at least and at most


def origin_option(default: Literal["home", "natural"]) -> Any:
    return option(default, "positions from home, or natural: leg lengths and angles. Default home; of ros: natural")


@dataclass(frozen=True, slots=True)
class Columns:
    """How each axis is written: number = (q - zero) · factor.

    factor    (n,) file units per m or rad
    zero      (n,) m or rad
    units     name of each axis' unit
    decimals  of positions and of their rates
    """

    factor: Array
    zero: Array
    units: tuple[str, ...]
    decimals: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", frozen(self.factor))
        object.__setattr__(self, "zero", frozen(self.zero))

    @property
    def unit(self) -> str:
        """All units that the axes have."""
        return " and ".join(dict.fromkeys(self.units))

    def blocks(
        self, source: Source, knots: Knots, rows: int, *, rest: bool = False
    ) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """Durations (K,) in steps up to each knot, and there (rows, K, axes) in whole units of the last decimal.

        In blocks of knots.

        rest  the rates at both ends are 0, not what solving left of them
        """
        scale = self.factor * 10.0**self.decimals
        lasting = np.diff(knots.steps, prepend=0)
        for first in range(0, len(knots.steps), BLOCK):
            steps = knots.steps[first : first + BLOCK]
            told = rows_at(source.counted, seconds(steps, knots.step), rows)
            told[0] -= self.zero
            units = np.rint(told * scale)
            if rest and first == 0:
                units[1:, 0] = 0.0
            if rest and first + BLOCK >= len(knots.steps):
                units[1:, -1] = 0.0
            yield lasting[first : first + BLOCK], units + 0.0  # no −0

    def text_rows(self, units: Array) -> list[list[str]]:
        """A list per point of (rows, K, axes) whole units: the rows of the first axis, of the second, … as numbers.

        Exact, and with a decimal point whatever the locale.
        """
        form = f"%.{self.decimals}f"
        table = units.transpose(1, 2, 0).reshape(units.shape[1], -1) / 10.0**self.decimals
        return [[form % number for number in row] for row in table.tolist()]

    def natural(self, numbers: Array) -> Array:
        """(rows, K, axes) q and its rates from what a file states."""
        told = numbers / self.factor
        told[0] += self.zero
        return np.asarray(told)


def columns(
    source: Source,
    tolerance: float | None,
    *,
    origin: Literal["home", "natural"] = "home",
    unit: Literal["mm", "SI", "counts"] = "mm",
) -> Columns:
    """How the axes of a machine are written in mm and deg, in m and rad, or in pulses of the axis' wiring."""
    axes = source.machine.axes
    own = [(unit, axis.kind) for axis in axes]
    factors = {("mm", "linear"): 1e3, ("mm", "rotary"): 180 / pi}
    pulses = np.array([axis.pulse for axis in axes])
    signs = np.array([axis.direction for axis in axes])
    factor = signs / pulses if unit == "counts" else np.array([factors.get(key, 1.0) for key in own])
    names = {("mm", "rotary"): "deg", ("SI", "linear"): "m", ("SI", "rotary"): "rad"}
    finest = float((pulses * abs(factor)).min()) * ROUNDING * 2 * min(tolerance or TOLERANCE, TOLERANCE)
    decimals = min(max(DECIMALS[0], ceil(-log10(finest))), DECIMALS[1])
    home = np.asarray(source.machine.home_q, float)
    zero = home if origin == "home" or unit == "counts" else np.zeros(len(axes))
    return Columns(factor, zero, tuple(names.get(key, unit) for key in own), decimals)
