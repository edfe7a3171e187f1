"""LinuxCNC halstreamer: a line per real-time sample and a field per axis, for `halstreamer FILE`
and streamer.

    0.000000 0.000000 0.000000
    0.000012 -0.000007 0.000031

- Load it with `loadrt streamer depth=… cfg=fff`, an f for each axis (an s with counts), and have
  `streamer.0` run in a thread of the period stated; line 1 is the start of the motion, the last one
  its end or the sample after it.
- Positions in mm and degrees, from home or natural; or whole pulses in the sense of the axes'
  wiring, from home.
- No header and no comments: halstreamer takes neither. ASCII, fields parted by one space, line ends
  \\n, decimal points whatever the locale.
- streamer holds each value for a period; what is told of the error takes the drive to go straight
  from one to the next.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import LEAST_POSITIVE, Array, finite_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.export.columns import Columns, line_blocks, make_columns, origin_option
from planner.export.format import Exported, ExportSource
from planner.export.knots import Knots, choose_knots, compare, steps_to_seconds

PINS = 21  # HAL_STREAM_MAX_PINS of LinuxCNC 2.9


@dataclass(frozen=True, slots=True)
class Halstreamer:
    """Positions at every sample of a real-time thread, for LinuxCNC's halstreamer."""

    suffix: ClassVar[str] = ".txt"
    period: float = option(1e-3, "period of the real-time thread. Default 1 ms", "s", like="1 ms")
    origin: Literal["home", "natural"] = origin_option("home")
    unit: Literal["mm", "counts"] = option(
        "mm", "mm (rotary axes: deg), or counts: pulses of the wiring. Default mm"
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes = source.machine.axes
        if len(axes) > PINS:
            raise MotionError(
                f"axis {axes[PINS].name}: {len(axes)} axes, but a stream has at most {PINS} pins"
            )
        if self.unit == "counts" and self.origin == "natural":
            raise MotionError("counts are from home; give origin home, or unit mm")
        finite_array(self.period, "period", (), unit="s", least=LEAST_POSITIVE)
        knots = choose_knots(
            source.counted, axes, 1, step=self.period, tolerance=None, spacing=self.period
        )
        form = make_columns(source, None, origin=self.origin, unit=self.unit)
        form = replace(form, decimals=0) if self.unit == "counts" else form
        with path.open("w", encoding="ascii", newline="") as file:
            for _, units in form.blocks(source, knots, 1):
                file.writelines(" ".join(row) + "\n" for row in form.text_rows(units))
        names = ", ".join(axis.name for axis in axes)
        notes = (
            f"fields in the order {names}; in {form.unit} from {self.origin}",
            f"a sample lasts {self.period:g} s",
        )
        late = source.describe_phase(self.period)
        return compare(source.counted, axes, knots, _points(form, knots, path), (*notes, *late))


def _points(form: Columns, knots: Knots, path: Path) -> Iterator[tuple[Array, Array]]:
    """What the lines state."""
    first = 0
    for lines in line_blocks(path):
        numbers = np.array([line.split() for line in lines], float)
        yield (
            steps_to_seconds(first + np.arange(len(lines)), knots.step),
            form.natural(numbers[None]),
        )
        first += len(lines)
