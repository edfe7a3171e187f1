"""Zaber PVT as CSV: position and velocity of every axis at the end of each segment, and how long it lasts.

    Time (ms),X Position (mm),X Velocity (mm/s),Y Position (deg),Y Velocity (deg/s),Relative
    0.0,0.0000000,0.0000000,0.0000000,0.0000000,false
    12.5,0.0513020,8.1250000,0.0000000,0.0000000,false

- The device goes from point to point by the cubic that meets position and velocity at both.
- Time is the duration of the segment that ends there; the first row, of time 0, is where the motion starts: the device
  must stand there.
- Positions are absolute, mm or degrees, from the machine's home or, with origin natural, the axes' own coordinates;
  both in their sense, whatever the wiring.
- Durations are whole steps of 0.1 ms. ASSUMPTION: that is what the device keeps of them; `step` changes it.
- UTF-8, line ends \\n, decimal points whatever the locale.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.export.columns import (
    ALPHABET,
    BLOCK,
    Columns,
    assign_letters,
    letters_option,
    make_columns,
    origin_option,
    told,
)
from planner.export.format import Exported, ExportSource
from planner.export.knots import choose_knots, refuse_moving_ends, spacing_option, tolerance_option
from planner.export.roundtrip import compare
from planner.options import option

TIME_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class ZaberCsv:
    """Zaber PVT sequence: a CSV of segment times, positions and velocities, cubic between them."""

    suffix: ClassVar[str] = ".csv"
    tolerance: float | None = tolerance_option()
    spacing: float | None = spacing_option()
    origin: Literal["home", "natural"] = origin_option("home")
    letters: str | None = letters_option()
    step: float = option(TIME_STEP, "durations are whole steps of this; default 0.1 ms", "s")

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        letters = assign_letters(axes, self.letters, ALPHABET, "Zaber PVT")
        refuse_moving_ends(motion, axes, "Zaber PVT")
        if not 1e-9 <= self.step <= 1:
            raise MotionError(f"step {self.step!r} s: must be from 1 ns to 1 s")
        knots = choose_knots(motion, axes, 2, step=self.step, tolerance=self.tolerance, spacing=self.spacing)
        form = make_columns(source, knots.tolerance, origin=self.origin)
        with path.open("w", encoding="utf-8", newline="") as file:
            names = [
                f"{letter} Position ({unit}),{letter} Velocity ({unit}/s)"
                for letter, unit in zip(letters, form.units, strict=True)
            ]
            file.write(",".join(["Time (ms)", *names, "Relative"]) + "\n")
            for steps, units in form.blocks(source, knots, 2, rest=True):
                file.writelines(
                    f"{time:.10g},{','.join(row)},false\n"
                    for time, row in zip((steps * (1e3 * self.step)).tolist(), form.text_rows(units), strict=True)
                )
        notes = (told(axes, letters), f"positions from {self.origin}, in the sense of the axes")
        return compare(motion, axes, knots, _decode_points(path, form), notes)


def _decode_points(path: Path, form: Columns) -> Iterator[tuple[Array, Array]]:
    """The points as the device reads them."""
    with path.open(encoding="utf-8", newline="") as file:
        next(file)
        end = 0.0
        while lines := list(islice(file, BLOCK)):
            table = np.array([line.split(",")[:-1] for line in lines], float)
            t = end + np.cumsum(table[:, 0]) / 1e3
            end = float(t[-1])
            yield t, form.natural(np.stack([table[:, 1::2], table[:, 2::2]]))
