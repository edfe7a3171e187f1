"""Position, velocity and time: the formats of Newport XPS, PMAC and Zaber, whose axes run by cubics
between points.

Newport XPS PVT trajectory: one line per segment, `dt, d1, v1, d2, v2, …`, no header.

    0.02000000, 0.0011270, 0.1696447, -0.0042111, -0.6318177

- dt is the duration in s; d the way of the segment and v the speed at its end, mm or degrees (and
  per second), axes in the order of the machine, which has to be that of the group. The first
  segment starts from rest, the last ends there.
- The axes go by the cubic that meets way and both speeds. Where an end speed is too high for the
  way, it runs back inside the segment: with a tolerance segments are halved until none does so by
  more than 1/100 pulse where the motion itself does not; with a spacing it is told how many do, and
  by how much.
- Ways lead from rounded place to rounded place, so their rounding does not add up.
- ASCII, line ends \\n, decimal points whatever the locale.

PMAC motion program in PVT mode: `PVT` sets the duration of the segments that follow, in ms,
X100:1500 is a move.

    INC
    PVT20.00025
    X0.0011270:0.1696447 Y-0.0042111:-0.6318177
    X0.0081118:0.0000000 Y-0.0295623:0.0000000

- A move is the way of a segment and the speed at its end, per second (Isx90 = 1000); axes go by the
  cubic that meets way and both speeds, from rest to rest. Moves lead from rounded place to rounded
  place: rounding does not add up.
- In mm and degrees, axes in their own sense; or, with unit counts, in pulses of the wiring.
- Durations are whole quarters of a microsecond and at most 4095.99975 ms (I42 = 0).
- ASCII, line ends \\n, decimal points whatever the locale; comments from ; to the end of the line.
  The file is the body of a program: OPEN PROG, CLEAR and CLOSE are the user's.

Zaber PVT as CSV: position and velocity of every axis at the end of each segment, and how long it
lasts.

    Time (ms),X Position (mm),X Velocity (mm/s),Y Position (deg),Y Velocity (deg/s),Relative
    0.0,0.0000000,0.0000000,0.0000000,0.0000000,false
    12.5,0.0513020,8.1250000,0.0000000,0.0000000,false

- The device goes from point to point by the cubic that meets position and velocity at both.
- Time is the duration of the segment that ends there; the first row, of time 0, is where the motion
  starts: the device must stand there.
- Positions are absolute, mm or degrees, from the machine's home or, with origin natural, the axes'
  own coordinates; both in their sense, whatever the wiring.
- Durations are whole steps of 0.1 ms. ASSUMPTION: that is what the device keeps of them; `step`
  changes it.
- UTF-8, line ends \\n, decimal points whatever the locale.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.export.columns import (
    ALPHABET,
    LETTERS,
    Columns,
    assign_letters,
    describe_letters,
    letters_option,
    line_blocks,
    make_columns,
    origin_option,
    plain,
)
from planner.export.format import Exported, ExportSource
from planner.export.knots import KnotFormat, Knots, compare, refuse_moving_ends, rows_at


def make_moves(
    columns: Columns, source: ExportSource, knots: Knots
) -> Iterator[tuple[NDArray[np.int64], Array]]:
    """Durations (K,) of segments in steps, and their moves and end speeds (2, K, axes), in blocks.

    Both in whole units of the last decimal. A move leads from rounded point to rounded point, so
    the sum of any number of moves is off by no more than one of them.
    """
    at = None
    for steps, units in columns.blocks(source, knots, 2, rest=True):
        position = units[0] if at is None else np.concatenate([at, units[0]])
        skipped = int(at is None)  # the first point of all is where the axes stand
        at = position[-1:]
        if len(steps) > skipped:
            yield steps[skipped:], np.stack([np.diff(position, axis=0), units[1, skipped:]]) + 0.0


def sum_moves(
    columns: Columns, source: ExportSource, decoded: Iterable[tuple[Array, Array]]
) -> Iterator[tuple[Array, Array]]:
    """Where the moves of a file lead from the start of the motion, at rest: what `knots.compare`
    takes.

    decoded  in blocks: durations (K,) s, and moves and end speeds (2, K, axes) in the units of the
             file
    """
    t = 0.0
    stated = rows_at(source.counted, np.zeros(1), 2)
    stated[1] = 0.0
    yield np.zeros(1), stated
    for lasting, numbers in decoded:
        when = t + np.cumsum(lasting)
        t = float(when[-1])
        way, rate = numbers / columns.factor
        stated = np.stack([stated[0, -1] + np.cumsum(way, 0), rate])
        yield when, stated


XPS_STEP = 1e-8
MOST_AXES = 8  # that an XPS drives


@dataclass(frozen=True, slots=True)
class Xps(KnotFormat):
    """Newport XPS PVT trajectory: relative moves and exit speeds, cubic between them."""

    suffix: ClassVar[str] = ".trj"
    from_rest: ClassVar[str] = "an XPS trajectory"

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        if len(axes) > MOST_AXES:
            raise MotionError(
                f"axis {axes[MOST_AXES].name}: {len(axes)} axes, but an XPS has at most {MOST_AXES}; "
                "choose another format"
            )
        refuse_moving_ends(motion, axes, self.from_rest)
        knots = self.knots(source, 2, XPS_STEP)
        form = make_columns(source, knots.tolerance)
        with path.open("w", encoding="ascii", newline="") as file:
            for steps, units in make_moves(form, source, knots):
                rows = form.text_rows(units)
                file.writelines(
                    f"{dt:.8f}, {', '.join(row)}\n"
                    for dt, row in zip((steps * XPS_STEP).tolist(), rows, strict=True)
                )
        notes = (f"group in the order {', '.join(axis.name for axis in axes)}; in {form.unit}",)
        return compare(motion, axes, knots, sum_moves(form, source, _read_xps(path)), notes)


def _read_xps(path: Path) -> Iterator[tuple[Array, Array]]:
    for lines in line_blocks(path):
        table = np.array([line.split(",") for line in lines], float)
        yield table[:, 0], np.stack([table[:, 1::2], table[:, 2::2]])


PMAC_STEP = 0.25e-6
MAX_SEGMENT_STEPS = 4 * 4096_000 - 1  # steps


@dataclass(frozen=True, slots=True)
class Pmac(KnotFormat):
    """PMAC motion program in PVT mode: relative moves and end speeds, cubic between them."""

    suffix: ClassVar[str] = ".pmc"
    from_rest: ClassVar[str] = "a PMAC program in PVT mode"
    letters: str | None = letters_option()
    unit: Literal["mm", "counts"] = option(
        "mm", "mm (rotary axes: deg), or counts: pulses of the wiring. Default mm"
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        letters = assign_letters(axes, self.letters, LETTERS, "a PMAC coordinate system")
        refuse_moving_ends(motion, axes, self.from_rest)
        knots = self.knots(source, 2, PMAC_STEP, MAX_SEGMENT_STEPS)
        form = make_columns(source, knots.tolerance, unit=self.unit)
        named = describe_letters(axes, letters)
        with path.open("w", encoding="ascii", newline="") as file:
            file.write(f"; {plain(source.name)}\n; {plain(named)}\n; in {form.unit}\nINC\n")
            before = 0
            for steps, units in make_moves(form, source, knots):
                for lasting, row in zip(steps.tolist(), form.text_rows(units), strict=True):
                    if lasting != before:
                        file.write(f"PVT{lasting * (PMAC_STEP * 1e3):.10g}\n")
                        before = lasting
                    pairs = zip(letters, row[::2], row[1::2], strict=True)
                    file.write(
                        " ".join(f"{letter}{way}:{speed}" for letter, way, speed in pairs) + "\n"
                    )
        notes = (named, "speeds are per second (Isx90 = 1000), durations as with I42 = 0")
        return compare(motion, axes, knots, sum_moves(form, source, _read_pmac(path)), notes)


def _read_pmac(path: Path) -> Iterator[tuple[Array, Array]]:
    lasting = 0.0
    for lines in line_blocks(path):
        times, rows = [], []
        for line in lines:
            if line.startswith("PVT"):
                lasting = float(line[3:]) / 1e3
            elif ":" in line and not line.startswith(";"):
                times.append(lasting)
                rows.append([word[1:].split(":") for word in line.split()])
        if rows:
            yield np.array(times), np.array(rows, float).transpose(2, 0, 1)


ZABER_STEP = 1e-4


@dataclass(frozen=True, slots=True)
class ZaberCsv(KnotFormat):
    """Zaber PVT sequence: a CSV of segment times, positions and velocities, cubic between them."""

    suffix: ClassVar[str] = ".csv"
    from_rest: ClassVar[str] = "Zaber PVT"
    origin: Literal["home", "natural"] = origin_option("home")
    letters: str | None = letters_option()
    step: float = option(ZABER_STEP, "resolution of durations. Default 0.1 ms", "s", like="0.1 ms")

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        letters = assign_letters(axes, self.letters, ALPHABET, "Zaber PVT")
        refuse_moving_ends(motion, axes, self.from_rest)
        if not 1e-9 <= self.step <= 1:
            raise MotionError(f"step {self.step!r} s: must be from 1 ns to 1 s")
        knots = self.knots(source, 2, self.step)
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
                    for time, row in zip(
                        (steps * (1e3 * self.step)).tolist(), form.text_rows(units), strict=True
                    )
                )
        notes = (
            describe_letters(axes, letters),
            f"positions from {self.origin}, in the sense of the axes",
        )
        return compare(motion, axes, knots, _read_zaber(path, form), notes)


def _read_zaber(path: Path, form: Columns) -> Iterator[tuple[Array, Array]]:
    """The points as the device reads them."""
    end = 0.0
    for lines in line_blocks(path, 1, encoding="utf-8"):
        table = np.array([line.split(",")[:-1] for line in lines], float)
        t = end + np.cumsum(table[:, 0]) / 1e3
        end = float(t[-1])
        yield t, form.natural(np.stack([table[:, 1::2], table[:, 2::2]]))
