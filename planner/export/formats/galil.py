"""Galil contour mode: how many counts each axis goes in every interval of time.

    CM ABC
    DT 1
    CD 0,1,-1
    CD 12,9,-11
    CD 0,0,0=0

- CM names the axes, A to H in the machine's order. DT n makes every interval 2ⁿ samples of 1 ms (TM
  1000). The axes go evenly through an interval. The last line ends contour mode.
- Increments are whole counts in the sense of the axes' wiring, differences of rounded positions
  from home: the remainder goes on to the next line, so no rounding adds up. The motion begins where
  the axes stand.
- Nothing but commands, one a line; ASCII, line ends \\n. What sends them ends each with a carriage
  return, and waits while the contour buffer is full.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.export.columns import BLOCK_POINTS, Columns, describe_letters, make_columns
from planner.export.format import Exported, ExportSource
from planner.export.knots import Knots, choose_knots, compare
from planner.pulses.schedule import Ticks

AXES = "ABCDEFGH"
SAMPLE_TIME = 1e-3
INTERVALS_MS = range(1, 9)
MAX_COUNTS = 32767
"""Counts of an increment. An assumption: 16 bits with a sign."""


@dataclass(frozen=True, slots=True)
class Galil:
    """Galil contour mode: whole counts per axis and time interval."""

    suffix: ClassVar[str] = ".dmc"
    interval: int = option(1, "n of DT, for intervals of 2^n ms: 1 to 8. Default 1")

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        if len(axes) > len(AXES):
            raise MotionError(
                f"axis {axes[len(AXES)].name}: {len(axes)} axes, but contour mode has at most {len(AXES)}, {AXES}; "
                "choose another format"
            )
        if self.interval not in INTERVALS_MS:
            raise MotionError(f"interval {self.interval}: must be from 1 to 8, for 2^n ms")
        letters, each = AXES[: len(axes)], SAMPLE_TIME * 2**self.interval
        knots = choose_knots(motion, axes, 1, step=each, tolerance=None, spacing=each)
        form = replace(make_columns(source, None, unit="counts"), decimals=0)
        with path.open("w", encoding="ascii", newline="") as file:
            file.write(f"CM {letters}\nDT {self.interval}\n")
            for increments in _increments(source, form, knots):
                _refuse_fast(source, increments, each)
                file.writelines(f"CD {','.join(map(str, row))}\n" for row in increments.tolist())
            file.write(f"CD {','.join('0' * len(axes))}=0\n")
        start = next(iter(form.blocks(source, knots, 1)))[1][0, 0]
        counts = ", ".join(f"{n:.0f}" for n in start)
        notes = (
            describe_letters(axes, letters),
            f"begins at counts {counts} from home, in the sense of the wiring",
        )
        return compare(motion, axes, knots, _points(form, start, path), notes)


def _increments(source: ExportSource, form: Columns, knots: Knots) -> Iterator[Ticks]:
    """(K, axes) counts, in blocks."""
    at = np.empty((0, len(form.factor)))
    for _, units in form.blocks(source, knots, 1):
        place = np.concatenate([at, units[0]])
        at = place[-1:]
        yield np.diff(place, axis=0).astype(np.int64)


def _refuse_fast(source: ExportSource, increments: Ticks, each: float) -> None:
    """Raise MotionError where an axis goes further in an interval than a line can say."""
    most = abs(increments).max(axis=0, initial=0)
    k = int(most.argmax())
    if most[k] > MAX_COUNTS:
        raise MotionError(
            f"axis {source.machine.axes[k].name}: {most[k]} counts in {1e3 * each:g} ms, limit {MAX_COUNTS}; "
            "give a smaller interval, or a longer pulse"
        )


def _points(form: Columns, start: Array, path: Path) -> Iterator[tuple[Array, Array]]:
    """Where the increments lead from the start (axes,), in counts."""
    yield np.zeros(1), form.natural(start[None, None])
    t, at = 0.0, start
    with path.open(encoding="ascii", newline="") as file:
        _, each = next(file), SAMPLE_TIME * 2 ** int(next(file).split()[1])
        while lines := [line for line in islice(file, BLOCK_POINTS) if "=" not in line]:
            place = at + np.cumsum(np.array([line[3:].split(",") for line in lines], float), axis=0)
            yield t + each * np.arange(1, len(place) + 1), form.natural(place[None])
            t, at = t + each * len(place), place[-1]
