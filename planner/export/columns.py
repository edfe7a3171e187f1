"""Axis positions as numbers of a file: mm and degrees or pulses, with the decimals that the
tolerance needs.

The letters by which controllers know their axes are chosen here too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from math import ceil, log10, pi
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from kinematics.machine.axis import Axis
from planner.export.format import ExportSource
from planner.export.knots import TOLERANCE, Knots, rows_at, steps_to_seconds

BLOCK_POINTS = 1 << 12  # points written or read together
ROUNDING_SHARE = 1e-3  # of the tolerance that half a unit of the last decimal may be
DECIMALS_RANGE = (6, 15)  # at least and at most


def origin_option(default: Literal["home", "natural"]) -> Any:
    return option(
        default,
        "positions from home, or natural coordinates: leg lengths and angles. Default home; ros: natural",
    )


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
        freeze_fields(self, "factor", "zero")

    @property
    def unit(self) -> str:
        """All units that the axes have."""
        return " and ".join(dict.fromkeys(self.units))

    def blocks(
        self, source: ExportSource, knots: Knots, rows: int, *, rest: bool = False
    ) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """Durations (K,) in steps up to each knot, and there (rows, K, axes) in whole units of the
        last decimal.

        In blocks of knots.

        rest  the speeds at both ends are 0, not what solving left of them
        """
        scale = self.factor * 10.0**self.decimals
        lasting = np.diff(knots.steps, prepend=0)
        for first in range(0, len(knots.steps), BLOCK_POINTS):
            steps = knots.steps[first : first + BLOCK_POINTS]
            told = rows_at(source.counted, steps_to_seconds(steps, knots.step), rows)
            told[0] -= self.zero
            units = np.rint(told * scale)
            if rest and first == 0:
                units[1, 0] = 0.0
            if rest and first + BLOCK_POINTS >= len(knots.steps):
                units[1, -1] = 0.0
            yield lasting[first : first + BLOCK_POINTS], units + 0.0  # no −0

    def text_rows(self, units: Array) -> list[list[str]]:
        """A list per point of (rows, K, axes) whole units: the rows of the first axis, of the
        second, … as numbers.

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


def make_columns(
    source: ExportSource,
    tolerance: float | None,
    *,
    origin: Literal["home", "natural"] = "home",
    unit: Literal["mm", "SI", "counts"] = "mm",
) -> Columns:
    """How the axes of a machine are written in mm and deg, in m and rad, or in pulses of the axis'
    wiring.
    """
    axes = source.machine.axes
    own = [(unit, axis.kind) for axis in axes]
    factors = {("mm", "linear"): 1e3, ("mm", "rotary"): 180 / pi}
    pulses = np.array([axis.pulse for axis in axes])
    signs = np.array([axis.direction for axis in axes])
    factor = (
        signs / pulses if unit == "counts" else np.array([factors.get(key, 1.0) for key in own])
    )
    names = {("mm", "rotary"): "deg", ("SI", "linear"): "m", ("SI", "rotary"): "rad"}
    finest = (
        float((pulses * abs(factor)).min())
        * ROUNDING_SHARE
        * 2
        * min(tolerance or TOLERANCE, TOLERANCE)
    )
    decimals = min(max(DECIMALS_RANGE[0], ceil(-log10(finest))), DECIMALS_RANGE[1])
    home = np.asarray(source.machine.home_q, float)
    zero = home if origin == "home" or unit == "counts" else np.zeros(len(axes))
    return Columns(factor, zero, tuple(names.get(key, unit) for key in own), decimals)


LETTERS = "XYZABCUVW"
MAX_COMMENT_LENGTH = 200  # characters of a comment: G-code lines have 255 at most
ALPHABET = "ABCDEFGHIJKLMNOPQRSTUVWXYZ"


def letters_option() -> Any:
    return option(
        None,
        f"letters of the axes, in the machine's order. Default: their names where letters, else {LETTERS}",
    )


def assign_letters(axes: tuple[Axis, ...], given: str | None, allowed: str, format_: str) -> str:
    """A letter for each axis: those given, or the axes' own names where all are allowed letters,
    else the usual ones.

    Raises MotionError where there are more axes than letters, or those given are not one allowed
    letter per axis.
    """
    if len(axes) > len(allowed):
        raise MotionError(
            f"axis {axes[len(allowed)].name}: {len(axes)} axes, but {format_} has at most {len(allowed)}, {allowed}; "
            "choose another format"
        )
    if given is not None:
        chosen = given.upper()
        if (
            len(chosen) != len(axes)
            or len(set(chosen)) != len(chosen)
            or not set(chosen) <= set(allowed)
        ):
            raise MotionError(
                f"letters {given}: {format_} needs {len(axes)} different ones of {allowed}"
            )
        return chosen
    names = "".join(axis.name.upper() for axis in axes if len(axis.name) == 1)
    own = len(names) == len(axes) == len(set(names)) and set(names) <= set(allowed)
    usual = (
        LETTERS
        if len(axes) <= len(LETTERS)
        else LETTERS + "".join(sorted(set(allowed) - set(LETTERS)))
    )
    return names if own else usual[: len(axes)]


def describe_letters(axes: tuple[Axis, ...], letters: str) -> str:
    """Which letter is which axis, for the notes."""
    return ", ".join(f"{letter} = {axis.name}" for letter, axis in zip(letters, axes, strict=True))


def plain(text: str) -> str:
    """The text as one line of printable ASCII, for comments; what is not shows as ?, and what is
    too long is cut.
    """
    return "".join(char if " " <= char <= "~" else "?" for char in text[:MAX_COMMENT_LENGTH])


def line_blocks(
    path: Path, skip: int = 0, size: int = BLOCK_POINTS, encoding: str = "ascii"
) -> Iterator[list[str]]:
    """The lines of a written file in blocks, but for some at its head."""
    with path.open(encoding=encoding, newline="") as file:
        list(islice(file, skip))
        while lines := list(islice(file, size)):
            yield lines
