"""An export format: a table of times and positions, as a programmable controller plays from its memory."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import LEAST_POSITIVE, Array, finite_array
from kinematics.foundation.options import option
from planner.export.columns import Columns, make_columns
from planner.export.format import Exported, ExportSource
from planner.export.knots import choose_knots, compare, steps_to_seconds


@dataclass(frozen=True, slots=True)
class Plc:
    """Times (ms) and positions from home (mm, deg) at an even period, as CSV with one line of names."""

    suffix: ClassVar[str] = ".csv"
    period: float = option(4e-3, "time from row to row. Default 4 ms", "s")

    def write(self, source: ExportSource, path: Path) -> Exported:
        finite_array(self.period, "period", (), unit="s", least=LEAST_POSITIVE)
        axes = source.machine.axes
        knots = choose_knots(
            source.counted, axes, 1, step=self.period, tolerance=None, spacing=self.period
        )
        form = make_columns(source, None)
        times = iter((steps_to_seconds(knots.steps, knots.step) * 1e3).tolist())
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(["ms", *(axis.name for axis in axes)])
            for _, units in form.blocks(source, knots, 1):
                table.writerows([f"{next(times):g}", *row] for row in form.text_rows(units))
        return compare(
            source.counted,
            axes,
            knots,
            _points(form, path),
            (f"positions in {form.unit} from home",),
        )


def _points(form: Columns, path: Path) -> Iterator[tuple[Array, Array]]:
    """What the file says, read as its reader would: that is what the error is measured on."""
    rows = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    yield rows[:, 0] / 1e3, form.natural(rows[None, :, 1:])
