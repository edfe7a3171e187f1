"""PMAC motion program in PVT mode: `PVT` sets the duration of the segments that follow, in ms, X100:1500 is a move.

    INC
    PVT20.00025
    X0.0011270:0.1696447 Y-0.0042111:-0.6318177
    X0.0081118:0.0000000 Y-0.0295623:0.0000000

- A move is the way of a segment and the speed at its end, per second (Isx90 = 1000); axes go by the cubic that meets
  way and both speeds, from rest to rest. Moves lead from rounded place to rounded place: rounding does not add up.
- In mm and degrees, axes in their own sense; or, with unit counts, in pulses of the wiring.
- Durations are whole quarters of a microsecond and at most 4095.99975 ms (I42 = 0).
- ASCII, line ends \\n, decimal points whatever the locale; comments from ; to the end of the line. The file is the body
  of a program: OPEN PROG, CLEAR and CLOSE are the user's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.export.columns import BLOCK, USUAL, assign_letters, letters_option, make_columns, plain, told
from planner.export.format import Exported, ExportSource
from planner.export.knots import choose_knots, refuse_moving_ends, spacing_option, tolerance_option
from planner.export.moves import make_moves, sum_moves
from planner.export.roundtrip import compare
from planner.options import option

STEP = 0.25e-6
MAX_SEGMENT_STEPS = 4 * 4096_000 - 1  # steps


@dataclass(frozen=True, slots=True)
class Pmac:
    """PMAC motion program in PVT mode: relative moves and end speeds, cubic between them."""

    suffix: ClassVar[str] = ".pmc"
    tolerance: float | None = tolerance_option()
    spacing: float | None = spacing_option()
    letters: str | None = letters_option()
    unit: Literal["mm", "counts"] = option("mm", "mm (rotary axes: deg), or counts: pulses of the wiring. Default mm")

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        letters = assign_letters(axes, self.letters, USUAL, "a PMAC coordinate system")
        refuse_moving_ends(motion, axes, "a PMAC program in PVT mode")
        knots = choose_knots(
            motion, axes, 2, step=STEP, tolerance=self.tolerance, spacing=self.spacing, longest=MAX_SEGMENT_STEPS
        )
        form = make_columns(source, knots.tolerance, unit=self.unit)
        named = told(axes, letters)
        with path.open("w", encoding="ascii", newline="") as file:
            file.write(f"; {plain(source.name)}\n; {plain(named)}\n; in {form.unit}\nINC\n")
            before = 0
            for steps, units in make_moves(form, source, knots):
                for lasting, row in zip(steps.tolist(), form.text_rows(units), strict=True):
                    if lasting != before:
                        file.write(f"PVT{lasting * (STEP * 1e3):.10g}\n")
                        before = lasting
                    pairs = zip(letters, row[::2], row[1::2], strict=True)
                    file.write(" ".join(f"{letter}{way}:{speed}" for letter, way, speed in pairs) + "\n")
        notes = (named, "speeds are per second (Isx90 = 1000), durations as with I42 = 0")
        return compare(motion, axes, knots, sum_moves(form, source, _decode_points(path)), notes)


def _decode_points(path: Path) -> Iterator[tuple[Array, Array]]:
    with path.open(encoding="ascii", newline="") as file:
        lasting = 0.0
        while lines := list(islice(file, BLOCK)):
            times, rows = [], []
            for line in lines:
                if line.startswith("PVT"):
                    lasting = float(line[3:]) / 1e3
                elif ":" in line and not line.startswith(";"):
                    times.append(lasting)
                    rows.append([word[1:].split(":") for word in line.split()])
            if rows:
                yield np.array(times), np.array(rows, float).transpose(2, 0, 1)
