"""Pulse CSV, as a logic analyser would have recorded it: one row per edge with the levels of every
line.

    Time[s], leg1 STEP, leg1 DIR, leg2 STEP, leg2 DIR
    0.000000000, 0, 1, 0, 0
    0.012345600, 1, 1, 0, 0

- A rising STEP is a pulse, at its tick; STEP falls one pulse width later. Before the first row
  every STEP is low.
- DIR 1 is a positive count of the wiring: the pulse moves q by +axis.direction pulses; DIR 0 is a
  negative one. For axes wired +1 that is +1 in q. DIR changes when the pulse before falls, or when
  the drive's hold after that pulse's rise is over, if that is later. It is right for the first
  pulse from time 0 on. So its set-up is as long as it can be.
- The first row, at time 0, states the level of every line; the last is the last edge.
- Of a program with triggers an exported file has a column for each name, `trigger photo`. It rises
  at the tick of every trigger and falls like STEP, or half-way to the next one of its name. Above
  16 names all share `trigger all`.
- Times are exact decimals of the tick where the clock allows (10 MHz: 7 of the 9 digits), else
  rounded to 1/20 tick.
- UTF-8, line ends \\n, decimal points whatever the locale. The file holds no start counts: keep
  them beside it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import merge_rising
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import option
from kinematics.machine.axis import StepTiming, ceil_ticks
from planner.export.format import Exported, ExportSource
from planner.export.trigger_lines import TriggerLine, describe_lines, join_lines, list_lines
from planner.parallel import Progress, ignore_progress, share_progress
from planner.pulses.checking import edge_reader
from planner.pulses.checking.pulse_reader import PulseFile
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks, holds_same_pulses

STEP_WIDTH = 2e-6  # s, enough for every common drive
WINDOW = 1 << 15  # pulses per axis written together
DECIMALS = 9


@dataclass(frozen=True, slots=True)
class PulseCsv:
    """Every edge of the step and direction lines, as a logic analyser records them."""

    suffix: ClassVar[str] = ".csv"
    triggered: ClassVar[bool] = True
    width: float | None = option(
        None,
        "pulse width of STEP. Default 2 us, or half the smallest interval if less",
        "s",
        like="2 us",
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, pulses = source.machine.axes, source.pulses
        wiring, timing = [axis.direction for axis in axes], [axis.timing for axis in axes]
        refuse_high(source, high_ticks(measure_spacing([pulses]), self.width, timing))
        lines = list_lines(source.triggers, pulses)
        tell = share_progress(source.tell, 0, 2)
        write(pulses, path, wiring, width=self.width, timing=timing, tell=tell, triggers=lines)
        tell = share_progress(source.tell, 1, 2)
        marks: list[list[Ticks]] = [[] for _ in lines]

        def read() -> Iterator[PulseSchedule]:
            for part in edge_reader.parts(
                path, pulses.clock_hz, axes, source.machine.home_q, tell=tell
            ):
                for ticks, new in zip(marks, part.marks, strict=True):
                    ticks.append(new)
                yield part.schedule

        exact = holds_same_pulses(pulses, read())
        exact &= all(
            np.array_equal(np.concatenate(ticks), line.ticks)
            for ticks, line in zip(marks, lines, strict=True)
        )
        notes = (
            describe_high(measure_spacing([pulses]), self.width, timing),
            *describe_lines(source.triggers, lines),
        )
        return Exported(0.0 if exact else np.inf, "the pulses, edge by edge", notes, pulses.total)


def write(
    schedule: PulseSchedule | PulseFile,
    path: str | PathLike[str],
    wiring: Sequence[int],
    *,
    width: float | None = None,
    timing: Sequence[StepTiming | None] = (),
    tell: Progress = ignore_progress,
    triggers: Sequence[TriggerLine] = (),
) -> None:
    """Write the edges of every axis, in pieces of bounded memory; the pulses of a file are read
    twice.

    wiring  (n,) +1/-1, the `direction` of each machine axis
    width   s that STEP stays high, rounded to ticks; None: 2 µs, or half the smallest pulse
            interval if that is less, or else what the drives allow
    timing  (n,) what each drive asks of its inputs
    tell    receives the tick up to which the file is written, and the last one
    triggers  further lines, with the edges of triggers
    Raises MotionError where the width leaves STEP no time to be low or a drive another, or the
    wiring does not match.
    """
    stated = schedule.stated if isinstance(schedule, PulseFile) else schedule
    if len(wiring) != len(stated.axes) or any(sign not in (1, -1) for sign in wiring):
        raise MotionError(
            f"wiring {tuple(wiring)}: give +1 or -1 for each of the {count_noun(len(stated.axes), 'axis')}"
        )
    spacing = measure_spacing(_parts(schedule))
    high = high_ticks(spacing, width, timing)
    names = [f"{axis.name} {line}" for axis in stated.axes for line in ("STEP", "DIR")]
    names += [f"{edge_reader.TRIGGER}{line.name}" for line in triggers]
    with Path(path).open("wb") as file:
        file.write((", ".join(["Time[s]", *map(_quote, names)]) + "\n").encode())
        turns = turn_ticks(spacing, high, timing)
        rows = _join_rows(_parts(schedule), spacing, wiring, high, turns)
        for ticks, levels in join_lines(rows, triggers, high):
            file.write(_text(ticks, levels, stated.clock_hz))
            tell(int(ticks[-1]), spacing.last + high)


def _parts(schedule: PulseSchedule | PulseFile) -> Iterable[PulseSchedule]:
    return schedule.parts() if isinstance(schedule, PulseFile) else [schedule]


FOREVER = int(np.iinfo(np.int64).max)


@dataclass(frozen=True, slots=True)
class Spacing:
    """What edges need to know of the pulses that come later: of a schedule in parts that follow
    each other.

    closest  ticks between the two closest pulses of any one axis; None where no axis has two
    back     ticks of each axis, between the closest two of which the second goes back; None where
             none does
    last     tick of the last pulse of all
    ends     tick before which each part ends
    ahead    (axes,) of each part: the direction of the first pulse behind it; 0: there is none
    names    of the axes, where known
    """

    clock_hz: int
    closest: int | None
    back: tuple[int | None, ...]
    last: int
    ends: tuple[int, ...]
    ahead: tuple[Signs, ...]
    names: tuple[str, ...] = ()


def measure_spacing(parts: Iterable[PulseSchedule]) -> Spacing:
    """Go through the pulses of one or more parts once."""
    clock, last, closest, names = 0, 0, FOREVER, tuple[str, ...]()
    ends: list[int] = []
    first: list[Signs] = []
    held: list[tuple[Ticks, Signs]] = []  # the last pulse of each axis
    back: list[int] = []
    for part in parts:
        clock, axes = part.clock_hz, part.axes
        names = tuple(axis.name for axis in axes)
        held = held or [(axis.ticks[:0], axis.direction[:0]) for axis in axes]
        back = back or [FOREVER] * len(axes)
        for k, axis in enumerate(axes):
            gaps = np.diff(np.concatenate([held[k][0], axis.ticks]))
            turned = np.diff(np.concatenate([held[k][1], axis.direction])) != 0
            closest = min(closest, int(gaps.min(initial=FOREVER)))
            back[k] = min(back[k], int(gaps[turned].min(initial=FOREVER)))
            held[k] = (axis.ticks[-1:], axis.direction[-1:]) if len(axis) else held[k]
            last = max(last, int(axis.ticks[-1]) if len(axis) else 0)
        ends.append(last + 1)
        first.append(np.array([axis.direction[0] if len(axis) else 0 for axis in axes], np.int8))
    ahead = [np.zeros(len(held), np.int8)]
    for signs in first[:0:-1]:
        ahead.append(np.where(signs != 0, signs, ahead[-1]))
    known = (None if least == FOREVER else least for least in back)
    least = None if closest == FOREVER else closest
    return Spacing(
        clock, least, tuple(known), last, (*ends[:-1], FOREVER), tuple(ahead[::-1]), names
    )


def high_ticks(spacing: Spacing, width: float | None, timing: Sequence[StepTiming | None]) -> int:
    """Return the ticks that STEP stays high: as the drives ask, with room for the low level between
    the closest pulses.

    DIR changes when STEP falls or later, so that a reversal has to leave room for the set-up of its
    drive as well. Raises MotionError if no width, or not the given one (s), does so.
    """
    clock, closest = spacing.clock_hz, spacing.closest
    least, room = _bound_high(spacing, timing)
    usual = min(STEP_WIDTH * clock, np.inf if closest is None else closest // 2)
    high = (
        int(min(max(round(usual), least.ticks), room.ticks))
        if width is None
        else round(width * clock)
    )
    if least.ticks <= high <= room.ticks:
        return high
    given = high / clock if width is None else width
    shown = f"{given:.6g} s" if given >= 0.1 else f"{1e6 * given:.6g} us"
    broken = [
        f"at {side} {bound.describe(clock)}"
        for side, bound, holds in (
            ("least", least, least.ticks <= high and least.ticks <= room.ticks),
            ("most", room, high <= room.ticks and least.ticks <= room.ticks),
        )
        if not holds
    ]
    remedy = (
        "choose another width"
        if least.ticks <= room.ticks
        else "choose a faster clock, or a slower motion"
    )
    raise MotionError(f"pulse width {shown}: must be {' and '.join(broken)}; {remedy}")


def turn_ticks(spacing: Spacing, high: int, timing: Sequence[StepTiming | None]) -> tuple[int, ...]:
    """Return for each axis the ticks from a pulse to the change of DIR after it, where the next one
    goes back.

    The hold of a drive counts only there: between pulses of one direction DIR does not change,
    however close they are. Raises MotionError for a reversal that is too short for hold and set-up.
    """
    clock = spacing.clock_hz
    drives = [*timing, *[None] * (len(spacing.back) - len(timing))]
    names = [*spacing.names, *[""] * (len(spacing.back) - len(spacing.names))]
    turns = []
    for back, drive, name in zip(spacing.back, drives, names, strict=True):
        hold, setup = (
            (0, 0) if drive is None else (ceil_ticks(t, clock) for t in (drive.hold, drive.setup))
        )
        if back is not None and hold + setup > back:
            raise MotionError(
                f"{name} reverses within {1e6 * back / clock:.6g} us, and its drive needs DIR "
                f"{1e6 * hold / clock:.6g} us after STEP rises and {1e6 * setup / clock:.6g} us before it rises again; "
                "slow the motion at the reversal, or take another drive"
            )
        turns.append(max(high, hold))
    return tuple(turns)


@dataclass(frozen=True, slots=True)
class _Bound:
    """A bound of the ticks that STEP stays high, and its reason."""

    ticks: float
    reason: str

    def describe(self, clock: int) -> str:
        return f"{1e6 * self.ticks / clock:.6g} us ({self.reason})"


def _bound_high(spacing: Spacing, timing: Sequence[StepTiming | None]) -> tuple[_Bound, _Bound]:
    """The least and the most."""
    clock, closest = spacing.clock_hz, spacing.closest
    names = [*spacing.names, *[""] * len(timing)]
    drives = [
        (f"the drive of {name}", drive)
        for name, drive in zip(names, timing, strict=False)
        if drive is not None
    ]
    lows = [_Bound(1, "a tick of the clock")]
    lows += [
        _Bound(ceil_ticks(drive.high, clock), f"{who} needs STEP high so long")
        for who, drive in drives
    ]
    rooms = [_Bound(np.inf, "")]
    if closest is not None:
        apart = f"the closest pulses are {1e6 * closest / clock:.6g} us apart, and"
        rooms.append(_Bound(closest - 1, f"{apart} STEP is low for a tick of the clock"))
        rooms += [
            _Bound(
                closest - ceil_ticks(drive.low, clock),
                f"{apart} {who} needs STEP low for {1e6 * drive.low:.6g} us",
            )
            for who, drive in drives
        ]
    for back, drive, name in zip(spacing.back, timing, names, strict=False):
        if drive is not None and back is not None:
            apart = f"{name} reverses within {1e6 * back / clock:.6g} us, and its drive needs DIR"
            room = back - ceil_ticks(drive.setup, clock)
            rooms.append(_Bound(room, f"{apart} {1e6 * drive.setup:.6g} us before STEP rises"))
    return max(lows, key=lambda each: each.ticks), min(rooms, key=lambda each: each.ticks)


def refuse_high(source: ExportSource, high: int) -> None:
    """Raise MotionError where a section begins while STEP is still high of a pulse before it: a
    file begins low.

    high: ticks that STEP is high.
    """
    since = [
        (sent.last.tick, axis.name)
        for sent, axis in zip(source.sent, source.pulses.axes, strict=False)
        if sent.last
    ]
    tick, name = max(since, default=(-high, ""))
    if source.goes_on and tick + high > 0:
        clock = source.pulses.clock_hz
        raise MotionError(
            f"STEP of {name} is high where this begins, from a pulse {-1e6 * tick / clock:.4g} us before: choose an "
            f"instant {1e6 * (tick + high) / clock:.4g} us later, or a format of pulses (steps, binary, npz)"
        )


def describe_high(
    spacing: Spacing, width: float | None, timing: Sequence[StepTiming | None]
) -> str:
    """How long STEP is high, for the notes."""
    return f"STEP is high for {1e6 * high_ticks(spacing, width, timing) / spacing.clock_hz:.6g} us"


def _quote(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if set(name) & set(',"\n\r') else name


Rows = Iterator[tuple[Ticks, NDArray[np.uint8]]]


def _join_rows(
    parts: Iterable[PulseSchedule],
    spacing: Spacing,
    wiring: Sequence[int],
    high: int,
    turns: Sequence[int],
) -> Rows:
    """Yield the rows of all parts.

    Each part also gets the pulse before it, whose STEP or DIR may change in it, and the direction
    of the next pulse.
    """
    begin = 0
    last = [AxisPulses("", np.empty(0, np.int64), np.empty(0, np.int8), 0, 1.0, 0.0)] * len(wiring)
    for part, end, ahead in zip(parts, spacing.ends, spacing.ahead, strict=True):
        axes = []
        for before, axis, way in zip(last, part.axes, ahead, strict=True):
            after = np.array([FOREVER // 2] * int(way != 0), np.int64)
            ticks = np.concatenate([before.ticks[-1:], axis.ticks, after])
            signs = np.concatenate(
                [before.direction[-1:], axis.direction, np.full(len(after), way, np.int8)]
            )
            axes.append(replace(axis, ticks=ticks, direction=signs))
        if begin < end:
            yield from edge_rows(replace(part, axes=tuple(axes)), wiring, high, (begin, end), turns)
        last = [axis if len(axis) else before for before, axis in zip(last, part.axes, strict=True)]
        begin = end


def edge_rows(
    schedule: PulseSchedule,
    wiring: Sequence[int],
    high: int,
    span: tuple[int, int] = (0, FOREVER),
    turns: Sequence[int] = (),
) -> Rows:
    """Yield, in windows, the instants (N,) of edges within a span of ticks and the levels of all
    lines there (N, 2 n).

    turns: ticks from a pulse of each axis to the change of DIR (`turn_ticks`); if not given, DIR
    changes with STEP
    """
    begin, end = span
    turns = turns or [high] * len(schedule.axes)
    inside = [axis.ticks[WINDOW::WINDOW] for axis in schedule.axes]
    marks = np.unique(
        np.concatenate([[begin], *(each[(each > begin) & (each < end)] for each in inside)])
    )
    ends = [*marks[1:].tolist(), end]
    for lo, hi in zip(marks.tolist(), ends, strict=True):
        edges = [np.zeros(int(lo == 0), np.int64)]
        for axis, turn in zip(schedule.axes, turns, strict=True):
            edges += _find_edges(axis, high, turn, (lo, hi))
        instants = merge_rising(*edges)
        levels = np.zeros((len(instants), 2 * len(wiring)), np.uint8)
        for k, (axis, turn) in enumerate(zip(schedule.axes, turns, strict=True)):
            if not len(axis):
                continue
            first = int(np.searchsorted(axis.ticks, lo - turn))
            near = axis.ticks[first : int(np.searchsorted(axis.ticks, hi))]
            up = np.searchsorted(near, instants, side="right")
            down = np.searchsorted(near, instants - high, side="right")
            turned = np.searchsorted(near, instants - turn, side="right")
            levels[:, 2 * k] = up - down
            following = np.minimum(first + turned, len(axis) - 1)
            levels[:, 2 * k + 1] = axis.direction[following] == wiring[k]
        yield instants, levels


def _find_edges(axis: AxisPulses, high: int, turn: int, span: tuple[int, int]) -> list[Ticks]:
    """Return the instants at which STEP rises, STEP falls and, where it turns later, DIR changes,
    within a span.
    """
    lo, hi = span
    falling, rising, fallen, risen = np.searchsorted(
        axis.ticks, (lo - high, lo, hi - high, hi)
    ).tolist()
    edges = [axis.ticks[rising:risen], axis.ticks[falling:fallen] + high]
    if turn > high:
        first, last = np.searchsorted(axis.ticks, (lo - turn, hi - turn)).tolist()
        back = np.flatnonzero(np.diff(axis.direction[first : last + 1]) != 0)
        edges.append(axis.ticks[first + back] + turn)
    return edges


def _decimals(clock_hz: int) -> tuple[int, int]:
    """Digits after the point, and ten to that power: exact where 15 digits can be, else good to
    1/20 tick.
    """
    for digits in range(DECIMALS, 16):
        if 10**digits % clock_hz == 0:
            return digits, 10**digits
    digits = max(DECIMALS, len(str(clock_hz)) + 1)
    if clock_hz * 10**digits >= 2**63:
        raise MotionError(
            f"clock {clock_hz} Hz: too fine for decimal seconds; use one below 900 MHz, or a divisor of 1e15 Hz"
        )
    return digits, 10**digits


def _text(ticks: Ticks, levels: NDArray[np.uint8], clock_hz: int) -> bytes:
    """Write the rows as text. Only whole numbers are used: float formatting could move an edge."""
    digits, scale = _decimals(clock_hz)
    second, rest = np.divmod(ticks, clock_hz)
    fraction = (
        rest * (scale // clock_hz)
        if scale % clock_hz == 0
        else (rest * scale + clock_hz // 2) // clock_hz
    )
    parts = []
    # Rows with equally long whole seconds share one table of characters.
    sizes = [len(str(n)) for n in (second[:1].tolist() + second[-1:].tolist())]
    for size in range(sizes[0], sizes[-1] + 1) if sizes else ():
        lo, hi = np.searchsorted(second, (10 ** (size - 1) if size > 1 else 0, 10**size))
        table = np.empty((hi - lo, size + 1 + digits + 3 * levels.shape[1] + 1), np.uint8)
        _put_digits(table[:, :size], second[lo:hi])
        table[:, size] = ord(".")
        _put_digits(table[:, size + 1 : size + 1 + digits], fraction[lo:hi])
        lines = table[:, size + 1 + digits : -1].reshape(hi - lo, levels.shape[1], 3)
        lines[:, :, 0], lines[:, :, 1], lines[:, :, 2] = (
            ord(","),
            ord(" "),
            levels[lo:hi] + ord("0"),
        )
        table[:, -1] = ord("\n")
        parts.append(table.tobytes())
    return b"".join(parts)


def _put_digits(table: NDArray[np.uint8], number: Ticks) -> None:
    for column in range(table.shape[1] - 1, -1, -1):
        number, digit = np.divmod(number, 10)
        table[:, column] = digit + ord("0")
