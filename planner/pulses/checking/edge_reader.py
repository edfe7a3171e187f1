"""The step and direction lines of a file of edges, read back, proved against the motion, and timed
against the drives.

Independent of whatever wrote the file. A rising STEP is a pulse; DIR 1 is a positive count of the
wiring. `parts` reads in memory that does not grow with the file. Text is UTF-8, with or without a
byte order mark; lines end in LF or CR LF.
"""

import csv
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import BinaryIO, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.files.chunk_file import holds_chunks
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import Fault, FileError
from kinematics.foundation.units import format_distinct
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.parallel import Progress, ignore_progress
from planner.pulses.checking import check_motion_parts, check_parts
from planner.pulses.checking.pulse_reader import list_statements, open_pulses
from planner.pulses.checking.verdict import LineTimes, PulseCheck, PulseFault
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks

PART_BYTES = 1 << 23  # bytes read together
OFF_TICK = 0.1  # a time further from every tick was written for another clock
MAX_FAULTS = 20  # of one kind told of at once
EXACT_DIGITS = 15  # digits that floats hold, whatever they are
TIMES = ("high", "low", "setup", "hold", "interval")
TRIGGER = "trigger "
"""Beginning of the names of columns that hold triggers, which may follow those of the axes."""


@dataclass(frozen=True, slots=True)
class Lines:
    """Contents of a file of edges, or of a part of it: pulses, and the least times from the file's
    beginning on.

    marks: ticks at which each column of triggers rises
    """

    schedule: PulseSchedule
    times: tuple[LineTimes, ...]
    marks: tuple[Ticks, ...] = ()


def parts(
    path: str | PathLike[str],
    clock_hz: int,
    axes: Sequence[Axis],
    home_q: ArrayLike,
    *,
    start: Sequence[int] | None = None,
    tell: Progress = ignore_progress,
) -> Iterator[Lines]:
    """The lines of a pulse CSV in one or more parts that follow each other; what it cannot hold
    comes from the machine.

    start  counts before the first pulse; None: 0, a motion from home. Each part has those that the
           one before ends with
    tell   told how many bytes are read, of how many
    Raises FileError with the lines at fault: a header of other axes, a row that is not a time and
    levels, a time that
    runs back or is no tick of the clock, a STEP that is high when the file ends: such a file has
    been cut.
    """
    name, home = str(path), np.asarray(home_q, float)
    found, count = [_EdgeRecord() for _ in axes], [0] * len(axes) if start is None else list(start)
    with Path(path).open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        expected = [
            "Time[s]",
            *(f"{axis.name} {line}" for axis in axes for line in ("STEP", "DIR")),
        ]
        first = file.readline()
        while first.count(b'"') % 2 and (more := file.readline()):  # a name may hold a line feed
            first += more
        try:
            header = next(
                csv.reader([first.decode("utf-8-sig", errors="replace")], skipinitialspace=True), []
            )
        except csv.Error as error:  # such as a name of more than 131072 characters
            raise FileError(name, [Fault("header", f"not CSV: {error}", 1)]) from None
        columns = len(header)
        marked = range(len(expected), columns)
        if header[: len(expected)] != expected or not all(
            header[k].startswith(TRIGGER) for k in marked
        ):
            raise FileError(name, [Fault("header", f"{header} should be {expected}", 1)])
        last, before = -0.5 / clock_hz, None  # the first row may be at time 0
        for line, table in _tables(file, name, columns, first.count(b"\n") + 1):
            ticks = _ticks(table[:, 0], last, clock_hz, name, line)
            levels = table[:, 1:].astype(np.uint8)
            if len(table):
                last = float(table[-1, 0])
            pulses = []
            for k, (axis, one) in enumerate(zip(axes, found, strict=True)):
                rises, signs = one.add(
                    ticks,
                    levels[:, 2 * k : 2 * k + 2],
                    before[2 * k :][:2] if before is not None else None,
                    axis,
                )
                pulses.append(
                    AxisPulses(axis.name, rises, signs, count[k], axis.pulse, float(home[k]))
                )
                count[k] = pulses[k].final
            marks = tuple(
                _find_rises(ticks, levels[:, k - 1], None if before is None else before[k - 1])
                for k in marked
            )
            before = levels[-1] if len(table) else before
            rows = line + len(table) - 1
            times = (one.times(axis.name, clock_hz) for axis, one in zip(axes, found, strict=True))
            yield Lines(PulseSchedule(clock_hz, tuple(pulses), max(last, 0.0)), tuple(times), marks)
            tell(file.tell(), size)
        high = (
            []
            if before is None
            else [
                axis.name
                for axis, level in zip(axes, before[: 2 * len(axes) : 2], strict=True)
                if level
            ]
        )
        if high:
            message = (
                f"leaves STEP of {', '.join(high)} high: the file has been cut; write it again"
            )
            raise FileError(name, [Fault("row", message, rows)])


def _find_rises(ticks: Ticks, levels: NDArray[np.uint8], before: np.uint8 | None) -> Ticks:
    """Return the ticks at which a line rises; before: its level ahead of them, None: low."""
    first = 0 if before is None else int(before)
    return ticks[np.diff(levels.astype(np.int8), prepend=np.int8(first)) > 0]


@dataclass(slots=True)
class _EdgeRecord:
    """Of one axis, part after part: the last edge of each kind (ticks), and the least times
    between.
    """

    rise: float = -np.inf
    fall: float = -np.inf
    turn: float = 0.0
    least: dict[str, float] = field(default_factory=lambda: dict.fromkeys(TIMES, np.inf))

    def add(
        self, ticks: Ticks, levels: NDArray[np.uint8], before: NDArray[np.uint8] | None, axis: Axis
    ) -> tuple[Ticks, Signs]:
        """The pulses of the next part.

        levels (N, 2): STEP and DIR from each tick on; before (2,): ahead of the first, None: low
        and as it begins.
        """
        if not len(ticks):
            return ticks, np.empty(0, np.int8)
        first = np.array([0, levels[0, 1]], np.uint8) if before is None else before
        step, turn = np.diff(np.vstack((first, levels)).astype(np.int8), axis=0).T
        rising, falling, turning = (ticks[edge] for edge in (step > 0, step < 0, turn != 0))
        self._measure_gap("high", rising, self.rise, falling)
        self._measure_gap("low", falling, self.fall, rising)
        self._measure_gap("setup", turning, self.turn, rising)
        self._measure_gap("hold", rising, self.rise, turning)
        self._measure_gap("interval", rising[:-1], self.rise, rising)
        self.rise, self.fall, self.turn = (
            float(edges[-1]) if len(edges) else at
            for edges, at in ((rising, self.rise), (falling, self.fall), (turning, self.turn))
        )
        return rising, np.where(levels[step > 0, 1] == 1, axis.direction, -axis.direction).astype(
            np.int8
        )

    def _measure_gap(self, what: str, since: Ticks, earlier: float, until: Ticks) -> None:
        """The least time from the last edge of one kind to each of another."""
        if not len(until):
            return
        known = np.concatenate(([earlier], since.astype(float)))
        # at the same tick an edge of DIR comes before the rise that it is for, and after none
        side: Literal["left", "right"] = "left" if what in ("hold", "interval") else "right"
        last = known[np.searchsorted(since, until, side=side)]
        self.least[what] = min(self.least[what], float((until - last).min()))

    def times(self, name: str, clock_hz: int) -> LineTimes:
        return LineTimes(name, **{what: value / clock_hz for what, value in self.least.items()})


def _tables(file: BinaryIO, name: str, columns: int, line: int) -> Iterator[tuple[int, Array]]:
    """The rows as numbers, part by part, with the line that each part starts on; line: that of the
    first.

    One part without rows where there are none.
    """
    kept, begin = b"", line
    while part := file.read(PART_BYTES):
        text, newline, kept = (kept + part).rpartition(b"\n")
        if newline:
            yield line, _table(text, name, columns, line)
            line += text.count(b"\n") + 1
    if kept.strip():
        yield line, _table(kept, name, columns, line)
    elif line == begin:
        yield line, np.empty((0, columns))


def _table(text: bytes, name: str, columns: int, line: int) -> Array:
    if (even := _read_even_rows(text, columns)) is not None:
        return even
    try:
        table = np.loadtxt(BytesIO(text), delimiter=",", ndmin=2, comments=None)
    except ValueError:
        table = np.empty((0, 0))
    levels = table[:, 1:]
    if table.shape == (text.count(b"\n") + 1, columns) and ((levels == 0) | (levels == 1)).all():
        return table
    rows = enumerate(text.decode(errors="replace").split("\n"), line)
    odd = [(n, row) for n, row in rows if not _is_row(row, columns)][:MAX_FAULTS]
    message = f"is not a time and {columns - 1} levels 0 or 1"
    raise FileError(name, [Fault("row", f"{row!r} {message}", n) for n, row in odd])


def _read_even_rows(text: bytes, columns: int) -> Array | None:
    """The same of rows that are all laid out as the first one, digit by digit; None where they are
    not.
    """
    width = text.find(b"\n") + 1
    first = re.fullmatch(rb"(\d+\.\d+)((?:, ?[01]){%d})\r?\n" % (columns - 1), text[:width])
    if first is None or first.end(1) > EXACT_DIGITS + 1 or (len(text) + 1) % width:
        return None
    rows = np.frombuffer(text + b"\n", np.uint8).reshape(-1, width)
    like, point = rows[0], text.index(b".")
    digits = [k for k in range(first.end(1)) if k != point]
    levels = [k for k in range(*first.span(2)) if text[k] in b"01"]
    numbers = rows - np.uint8(ord("0"))  # other characters come out above 9
    same = np.delete(np.arange(width), [*digits, *levels])
    if (
        (rows[:, same] != like[same]).any()
        or (numbers[:, digits] > 9).any()
        or (numbers[:, levels] > 1).any()
    ):
        return None
    table, whole = np.empty((len(rows), columns)), np.zeros(len(rows), np.int64)
    for k in digits:
        whole = 10 * whole + numbers[:, k]
    table[:, 0] = whole / 10 ** (
        first.end(1) - point - 1
    )  # of exact numbers: the float nearest to the decimal
    table[:, 1:] = numbers[:, levels]
    return table


def _is_row(row: str, columns: int) -> bool:
    try:
        float(row.split(",")[0])
    except ValueError:
        return False
    levels = [cell.strip() for cell in row.split(",")[1:]]
    return len(levels) == columns - 1 and set(levels) <= {"0", "1"}


def _ticks(time: Array, last: float, clock_hz: int, name: str, line: int) -> Ticks:
    """The ticks (N,) that rising times (N,) stand for."""
    ticks = np.rint(time * clock_hz)
    off = np.flatnonzero(~(abs(time * clock_hz - ticks) <= OFF_TICK))
    back = np.flatnonzero(~(np.diff(time, prepend=last) > 0))
    faults = [(i, f"is not a tick of {clock_hz} Hz") for i in off[:MAX_FAULTS].tolist()]
    faults += [
        (i, "does not come after the row before, or after 0") for i in back[:MAX_FAULTS].tolist()
    ]
    if faults:
        raise FileError(
            name,
            [
                Fault("Time[s]", f"{float(time[i])!r} s {message}", line + i)
                for i, message in faults
            ],
        )
    return ticks.astype(np.int64)


DECIMAL_ROUNDING = 1e-12  # s by which decimal fractions may seem shorter than they are


class PlannedPulses(Protocol):
    """What a file of pulses stands for: a plan."""

    @property
    def machine(self) -> Machine: ...
    @property
    def counted(self) -> AxesMotion: ...
    @property
    def pulses(self) -> PulseSchedule: ...


def check_file(
    path: str | PathLike[str], plan: PlannedPulses, progress: Progress = ignore_progress
) -> PulseCheck:
    """Prove a file of pulses as `check` does: a CSV of edges, with the times on its lines against
    what each drive asks, or one in the binary form, with what it states against the plan.

    Only the pulses come from the file, part by part; start counts, duration, rule and bounds from
    the plan. progress is told how much of the file is done. Raises FileError where it cannot be
    read.
    """
    stated, machine = plan.pulses, plan.machine
    if holds_chunks(path):
        check = partial(check_parts, stated, trajectory=plan.counted)
        return _check_binary(path, stated, machine, check, progress)
    lined: tuple[LineTimes, ...] = ()

    def pulses() -> Iterator[PulseSchedule]:
        nonlocal lined
        for part in parts(path, stated.clock_hz, machine.axes, machine.home_q, tell=progress):
            lined = part.times
            yield part.schedule

    found = check_parts(stated, pulses(), plan.counted, machine.axes, machine.home_q)
    axes = []
    for one, times, axis in zip(found.axes, lined, machine.axes, strict=True):
        short = tuple(_find_short_times(times, axis))
        axes.append(
            replace(
                one,
                lines=times,
                faults=one.faults + short,
                fault_count=one.fault_count + len(short),
            )
        )
    return PulseCheck(tuple(axes))


def check_file_parts(
    path: str | PathLike[str],
    stated: PulseSchedule,
    machine: Machine,
    motions: Iterable[AxesMotion],
    progress: Progress = ignore_progress,
) -> PulseCheck:
    """The same of a file in the binary form and of a motion that comes in parts, each with a time
    from 0.

    stated: what the plan states of its pulses, without them
    """
    return _check_binary(
        path, stated, machine, partial(check_motion_parts, stated, motions=motions), progress
    )


def _check_binary(
    path: str | PathLike[str],
    stated: PulseSchedule,
    machine: Machine,
    check: Callable[..., PulseCheck],
    progress: Progress,
) -> PulseCheck:
    """The findings on a file in the binary form, with what it states otherwise than the plan;
    check: of its parts.
    """
    held = open_pulses(path)
    names, own = ([axis.name for axis in of.axes] for of in (stated, held.stated))
    if own != names:
        raise FileError(str(path), [Fault("axes", f"{own} should be {names}")])
    found = check(parts=held.parts(progress), machine_axes=machine.axes, home_q=machine.home_q)
    axes = []
    for k, one in enumerate(found.axes):
        says, should = (list_statements(of, k) for of in (held.stated, stated))
        other = tuple(
            PulseFault(
                one.name, 0, f"{name}: the file states {says[name]}, and the plan {should[name]}"
            )
            for name in should
            if says[name] != should[name]
        )
        axes.append(
            replace(one, faults=one.faults + other, fault_count=one.fault_count + len(other))
        )
    return PulseCheck(tuple(axes))


def _find_short_times(times: LineTimes, axis: Axis) -> Iterator[PulseFault]:
    """What a drive would not see."""
    asked = axis.timing
    if asked is None:
        return
    for name in ("high", "low", "setup", "hold"):
        least, needed = getattr(times, name), getattr(asked, name)
        if least < needed - DECIMAL_ROUNDING:
            seen, wanted = format_distinct(1e6 * least, 1e6 * needed, digits=4)
            yield PulseFault(axis.name, 0, f"{name}: {seen} us, and its drive needs {wanted}")
