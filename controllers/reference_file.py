"""References from files: positions of axes over time, and their speeds where the file has them;
CSV.

    time [s], yaw [deg], shoulder [deg], yaw speed [deg/s]
    0, 0, 0, 0
    0.1, 0.4, 0, 8.1
    …

The first line names the columns with their units: the time, an axis by its name, or its name and
"speed". On a rig of one axis that may be "position" and "speed". Positions count from home. Axes
that have no column rest, and so does the motion before the first and after the last row. Commas or
semicolons part the columns; decimals have points.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from controllers.rig import MotionSample
from kinematics.files.toml_document import bytes_of
from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import BadValue, Fault, FileError, MotionError
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.units import describe_value, unit_value
from kinematics.machine.axis import Axis

TIME, POSITION, SPEED = "time", "position", "speed"
MAX_BYTES = 64_000_000
"""Size of a file, which is read whole: a million rows of six columns."""
MAX_SECONDS = 1e6
"""s: later times are slips of the unit."""
_COLUMN = re.compile(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*")


@dataclass(frozen=True, slots=True)
class Recorded:
    """q = home + the cubic through samples and speeds (q, qd) at t, one cubic between two samples.

    Where no speeds are stated, each is that of the parabola through a sample and its neighbours: so
    a pause or a corner changes the motion next to it only, by less than the neighbouring steps.

    home       (n,) rad or m
    t          (N,) s, rising from 0
    position, speed  (N, n) rad or m from home, and by s
    """

    home: Array
    t: Array
    position: Array
    speed: Array

    def __post_init__(self) -> None:
        freeze_fields(self, *Recorded.__slots__)

    @property
    def duration(self) -> float:
        """Time of the last sample, in s."""
        return float(self.t[-1])

    @property
    def knots(self) -> Array:
        """Times (N,) in s between which the motion is one cubic."""
        return self.t

    def at(self, t: Array, /) -> MotionSample:
        """Return the motion at instants (M,) in s; it rests before the first and after the last
        sample.
        """
        instants = np.atleast_1d(np.asarray(t, float))
        inside = np.clip(instants, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(self.t) - 2)
        step = (self.t[k + 1] - self.t[k])[:, None]
        u = (inside - self.t[k])[:, None] / step

        # the cubic of Hermite by its Taylor coefficients in u
        here, rise = self.position[k], self.position[k + 1] - self.position[k]
        begin, end = self.speed[k] * step, self.speed[k + 1] * step
        bend, twist = 3 * rise - 2 * begin - end, begin + end - 2 * rise
        moving = ((instants >= 0) & (instants <= self.duration))[:, None]
        return MotionSample(
            inside,
            self.home + here + u * (begin + u * (bend + u * twist)),
            np.where(moving, begin + u * (2 * bend + u * 3 * twist), 0.0) / step,
            np.where(moving, 2 * bend + u * 6 * twist, 0.0) / step**2,
            np.where(moving, 6 * twist, 0.0) / step**3,
        )


class Column(NamedTuple):
    """A column of the file: whose axis (its place, −1 of the time), which quantity, and the SI
    value of its unit.
    """

    axis: int
    quantity: Literal["time", "position", "speed"]
    unit: float
    name: str


def read_reference(path: Path, axes: Sequence[Axis], home: Array) -> Recorded:
    """Read the motion of axes from a CSV file.

    home  (n,) rad or m, from which positions count

    Raises FileError with every fault of the file and its line.
    """
    text = _read_text(path)
    faults: list[Fault] = []
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    if not lines:
        raise FileError(str(path), [Fault("", f"no header: write e.g. {_example(axes)}", 1)])
    number, header = lines[0]
    delimiter = ";" if ";" in header else ","
    columns = list(_read_header(header.split(delimiter), axes, number, faults))
    if faults:
        raise FileError(str(path), faults)

    rows = np.array([*_read_rows(lines[1:], columns, delimiter, faults)]).reshape(-1, len(columns))
    if not faults and len(rows) < 2:
        faults.append(
            Fault("", f"{len(rows)} rows below the header: a motion has at least 2", number)
        )
    if faults:
        raise FileError(str(path), faults)
    rows = rows * [column.unit for column in columns]
    t = rows[:, [column.axis for column in columns].index(-1)]
    if (faults := list(_check_times(t, [n for n, _ in lines[1:]]))) != []:
        raise FileError(str(path), faults)

    position, speed = np.zeros((2, len(rows), len(axes)))
    stated = {column.axis for column in columns if column.quantity == SPEED}
    for place, column in enumerate(columns):
        if column.quantity == POSITION:
            position[:, column.axis] = rows[:, place]
        elif column.quantity == SPEED:
            speed[:, column.axis] = rows[:, place]
    for k in range(len(axes)):
        if k not in stated:
            speed[:, k] = estimate_speed(t, position[:, k])
    return Recorded(freeze_array(home), t - t[0], position, speed)


def estimate_speed(t: Array, x: Array) -> Array:
    """Return the slopes (N,) of the parabolas through each sample and its neighbours; at the ends
    those of theirs.
    """
    if len(t) == 2:
        return np.full(2, (x[1] - x[0]) / (t[1] - t[0]))
    return np.asarray(np.gradient(x, t, edge_order=2))


def _read_text(path: Path) -> str:
    try:
        return bytes_of(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        fault = Fault("", f"byte {error.start + 1} is not UTF-8 text: save it as UTF-8", None)
        raise FileError(str(path), [fault]) from None


def _example(axes: Sequence[Axis]) -> str:
    unit = "deg" if axes[0].kind == "rotary" else "mm"
    return f'"time [s], {axes[0].name} [{unit}], {axes[0].name} speed [{unit}/s]"'


def _read_header(
    cells: Sequence[str], axes: Sequence[Axis], line: int, faults: list[Fault]
) -> Iterator[Column]:
    """Yield the columns of a header line and append its errors to `faults`."""
    places = {axis.name.lower(): k for k, axis in enumerate(axes)}
    names = {TIME: (-1, TIME)}
    for name, k in places.items():
        names |= {
            name: (k, POSITION),
            f"{name} {POSITION}": (k, POSITION),
            f"{name} {SPEED}": (k, SPEED),
        }
    if len(axes) == 1:
        names |= {POSITION: (0, POSITION), SPEED: (0, SPEED)}
    known: set[tuple[int, str]] = set()
    for cell in cells:
        match = _COLUMN.fullmatch(cell)
        name = match[1].lower() if match else ""
        if match is None or name not in names:
            allowed = ", ".join([TIME, *(axis.name for axis in axes)])
            message = f"column {describe_value(cell.strip())}{nearest(name, names)}; write e.g. {_example(axes)}"
            faults.append(Fault("", message, line, cell.strip(), allowed, closest(name, names)))
            continue
        k, quantity = names[name]
        if (k, quantity) in known:
            faults.append(Fault("", f"column {match[1]} appears twice", line))
            continue
        known.add((k, quantity))
        unit = "s" if k < 0 else axes[k].unit + "/s" * (quantity == SPEED)
        try:
            if match[2] is None:
                raise BadValue(f'has no unit: write e.g. "{match[1]} [{_usual(unit)}]"')
            yield Column(k, quantity, unit_value(match[2], unit), match[1])  # type: ignore[arg-type]  # by `names`
        except MotionError as error:
            faults.append(Fault("", f"column {match[1]}: {error}", line))
    if (-1, TIME) not in known:
        faults.append(Fault("", f"no column {TIME}: write e.g. {_example(axes)}", line))
    moved = {k for k, quantity in known if quantity == POSITION}
    if not moved and not faults:
        faults.append(
            Fault("", f"no column with the position of an axis: write e.g. {_example(axes)}", line)
        )
    for k in sorted({k for k, quantity in known if quantity == SPEED} - moved):
        faults.append(
            Fault(
                "",
                f"column {axes[k].name} speed without {axes[k].name}: give its position too",
                line,
            )
        )


def _usual(unit: str) -> str:
    return unit.replace("rad", "deg").replace("m", "mm", 1) if unit != "s" else unit


def _read_rows(
    lines: Sequence[tuple[int, str]], columns: Sequence[Column], delimiter: str, faults: list[Fault]
) -> Iterator[list[float]]:
    """Yield the numbers of each line and append its errors to `faults`, at most a hundred."""
    for number, line in lines:
        try:
            cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
        except csv.Error as error:
            faults.append(Fault("", f"not a row of a table: {error}", number))
            continue
        if len(cells) != len(columns):
            faults.append(Fault("", f"{len(cells)} values for {len(columns)} columns", number))
            continue
        values = []
        for cell, column in zip(cells, columns, strict=True):
            try:
                value = float(cell)
            except ValueError:
                value = np.nan
            if not np.isfinite(value) or not cell.isascii() or "_" in cell:
                message = (
                    f"column {column.name}: {describe_value(cell.strip())} is not a finite number"
                )
                faults.append(Fault("", message, number, cell.strip()))
            values.append(value)
        yield values
        if len(faults) >= MAX_FAULTS:
            faults.append(Fault("", f"{len(faults)} faults; the rest was not checked", number))
            return


MAX_FAULTS = 100


def _check_times(t: Array, lines: Sequence[int]) -> Iterator[Fault]:
    """Find the first row whose time does not rise, and times beyond what means anything."""
    stuck = np.flatnonzero(~(np.diff(t) > 0))
    if len(stuck):
        k = int(stuck[0]) + 1
        yield Fault(
            "", f"time {t[k]:.9g} s does not rise from {t[k - 1]:.9g} s in the row before", lines[k]
        )
    if np.abs(t).max() > MAX_SECONDS:
        k = int(np.abs(t).argmax())
        yield Fault("", f"time {t[k]:.6g} s is beyond {MAX_SECONDS:g} s: check its unit", lines[k])
