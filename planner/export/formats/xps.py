"""Newport XPS PVT trajectory: one line per segment, `dt, d1, v1, d2, v2, …`, no header.

    0.02000000, 0.0011270, 0.1696447, -0.0042111, -0.6318177

- dt is the duration in s; d the way of the segment and v the speed at its end, mm or degrees (and per second), axes in
  the order of the machine, which has to be that of the group. The first segment starts from rest, the last ends there.
- The axes go by the cubic that meets way and both speeds. Where an end speed is too high for the way, it runs back
  inside the segment: with a tolerance segments are halved until none does so by more than 1/100 pulse where the
  motion itself does not; with a spacing it is told how many do, and by how much.
- Ways lead from rounded place to rounded place, so their rounding does not add up.
- ASCII, line ends \\n, decimal points whatever the locale.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.export.columns import BLOCK, make_columns
from planner.export.format import Exported, ExportSource
from planner.export.knots import choose_knots, refuse_moving_ends, spacing_option, tolerance_option
from planner.export.moves import make_moves, sum_moves
from planner.export.roundtrip import compare

TIME_STEP = 1e-8
MOST_AXES = 8  # that an XPS drives


@dataclass(frozen=True, slots=True)
class Xps:
    """Newport XPS PVT trajectory: relative moves and exit speeds, cubic between them."""

    suffix: ClassVar[str] = ".trj"
    tolerance: float | None = tolerance_option()
    spacing: float | None = spacing_option()

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        if len(axes) > MOST_AXES:
            raise MotionError(
                f"axis {axes[MOST_AXES].name}: {len(axes)} axes, but an XPS has at most {MOST_AXES}; "
                "choose another format"
            )
        refuse_moving_ends(motion, axes, "an XPS trajectory")
        knots = choose_knots(motion, axes, 2, step=TIME_STEP, tolerance=self.tolerance, spacing=self.spacing)
        form = make_columns(source, knots.tolerance)
        with path.open("w", encoding="ascii", newline="") as file:
            for steps, units in make_moves(form, source, knots):
                rows = form.text_rows(units)
                file.writelines(
                    f"{dt:.8f}, {', '.join(row)}\n" for dt, row in zip((steps * TIME_STEP).tolist(), rows, strict=True)
                )
        notes = (f"group in the order {', '.join(axis.name for axis in axes)}; in {form.unit}",)
        return compare(motion, axes, knots, sum_moves(form, source, _decode_points(path)), notes)


def _decode_points(path: Path) -> Iterator[tuple[Array, Array]]:
    with path.open(encoding="ascii", newline="") as file:
        while lines := list(islice(file, BLOCK)):
            table = np.array([line.split(",") for line in lines], float)
            yield table[:, 0], np.stack([table[:, 1::2], table[:, 2::2]])
