"""Value change dump (IEEE 1800) of the step and direction lines, for GTKWave and PulseView.

    $timescale 1 ns $end
    $scope module pulsepath $end
    $var wire 1 ! leg1_STEP $end
    $var wire 1 " leg1_DIR $end
    $upscope $end
    $enddefinitions $end
    #0
    $dumpvars
    0!
    1"
    $end
    #1250
    1!

- The levels are those of the pulse CSV: a rising STEP is a pulse, DIR 1 a positive count of the
  wiring, and DIR changes when the pulse before falls, or after the hold of the drive. The last time
  is the end of the motion.
- The time unit is the coarsest, from 1 ns down to 1 fs by tens, of which a tick is a whole number:
  1 ns at 10 MHz. Where there is none, times are rounded to the finest that 63 bits hold, at least a
  twentieth of a tick.
- Of a program with triggers there is a wire for each name, trigger_photo, with the edges of the
  pulse CSV.
- Names are printable ASCII without white space: every character but letters, digits, _ and - is
  written as % and two hexadecimal digits for each of its UTF-8 bytes. Line ends \\n.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.export.format import Exported, ExportSource
from planner.export.formats.pulse_csv import (
    describe_high,
    edge_rows,
    high_ticks,
    measure_spacing,
    refuse_high,
    turn_ticks,
)
from planner.export.trigger_lines import (
    MAX_LINES,
    TriggerLine,
    describe_lines,
    join_lines,
    list_lines,
)
from planner.pulses.schedule import PulseSchedule, Ticks

SUFFIXES = {9: "1 ns", 10: "100 ps", 11: "10 ps", 12: "1 ps", 13: "100 fs", 14: "10 fs", 15: "1 fs"}
PART_BYTES = 1 << 22  # bytes read together
TIME_BYTES = 24  # bytes of a time
IDS = range(ord("!"), ord("~") + 1)


@dataclass(frozen=True, slots=True)
class Vcd:
    """Value change dump of the step and direction lines, for GTKWave and PulseView."""

    suffix: ClassVar[str] = ".vcd"
    triggered: ClassVar[bool] = True
    width: float | None = option(
        None,
        "pulse width of STEP. Default 2 us, or half the smallest interval if less",
        "s",
        like="2 us",
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        pulses, axes = source.pulses, source.machine.axes
        if 2 * len(axes) > len(IDS):
            raise MotionError(
                f"{len(axes)} axes, but a dump has at most {len(IDS) // 2}; choose another format"
            )
        spacing = measure_spacing([pulses])
        timing = [axis.timing for axis in axes]
        high = high_ticks(spacing, self.width, timing)
        turns = turn_ticks(spacing, high, timing)
        refuse_high(source, high)
        wiring, digits = [axis.direction for axis in axes], _digits(pulses)
        lines = list_lines(source.triggers, pulses, min(MAX_LINES, len(IDS) - 2 * len(axes)))
        with path.open("wb") as file:
            file.write(_head(source, digits, lines))
            before, last = None, 0
            for ticks, levels in join_lines(
                edge_rows(pulses, wiring, high, turns=turns), lines, high
            ):
                times = _times(ticks, pulses.clock_hz, digits)
                if before is None:
                    file.write(_start(levels[0]))
                    before, times, levels = levels[:1], times[1:], levels[1:]
                if len(times):
                    file.write(_text(times, levels, before))
                    before, last = levels[-1:], int(times[-1])
            end = round(pulses.duration * 10**digits)
            file.write(b"#%d\n" % end if end > last else b"")
        width = describe_high(spacing, self.width, timing)
        notes = (
            width,
            f"times in units of {SUFFIXES[digits]}",
            *describe_lines(source.triggers, lines),
        )
        return replace(_compare(pulses, wiring, path, digits, lines), notes=notes)


def plain(name: str) -> str:
    """A name as a word of printable ASCII that stands for no other name."""
    return quote(name, safe="").replace(".", "%2E").replace("~", "%7E")


def _head(source: ExportSource, digits: int, triggers: Sequence[TriggerLine]) -> bytes:
    names = [
        f"{plain(axis.name)}_{line}" for axis in source.pulses.axes for line in ("STEP", "DIR")
    ]
    names += [f"trigger_{plain(line.name)}" for line in triggers]
    lines = [f"$comment pulsepath {plain(source.name)} $end", f"$timescale {SUFFIXES[digits]} $end"]
    lines += ["$scope module pulsepath $end"]
    lines += [f"$var wire 1 {chr(IDS[k])} {name} $end" for k, name in enumerate(names)]
    return "\n".join([*lines, "$upscope $end", "$enddefinitions $end", ""]).encode("ascii")


def _start(levels: NDArray[np.uint8]) -> bytes:
    """All levels (lines,) at time 0."""
    return (
        b"#0\n$dumpvars\n"
        + b"".join(b"%d%c\n" % pair for pair in zip(levels.tolist(), IDS, strict=False))
        + b"$end\n"
    )


def _digits(pulses: PulseSchedule) -> int:
    """The power of ten of the time unit."""
    clock, seconds = pulses.clock_hz, int(pulses.duration) + 2
    fitting = [digits for digits in SUFFIXES if 10**digits * max(seconds, clock) < 2**63]
    exact = [
        digits for digits in SUFFIXES if 10**digits % clock == 0 and 10**digits * seconds < 2**63
    ]
    if not exact and (not fitting or 10 ** fitting[-1] < 20 * clock):
        raise MotionError(
            f"clock {clock} Hz: no unit of time from 1 ns to 1 fs holds {seconds} s of its ticks; "
            "use a clock of which a tick is whole nanoseconds"
        )
    return exact[0] if exact else fitting[-1]


def _times(ticks: Ticks, clock_hz: int, digits: int) -> Ticks:
    """In whole units of time, the nearest."""
    second, rest = np.divmod(ticks, clock_hz)
    scale = 10**digits
    part = (
        rest * (scale // clock_hz)
        if scale % clock_hz == 0
        else (rest * scale + clock_hz // 2) // clock_hz
    )
    return np.asarray(second * scale + part)


def _text(times: Ticks, levels: NDArray[np.uint8], before: NDArray[np.uint8]) -> bytes:
    """A time (N,) and the lines that change there; levels (N, lines), and before (1, lines) the
    first.
    """
    changed = levels != np.concatenate([before, levels[:-1]])
    size = len(str(times[-1]))
    table = np.zeros((len(times), size + 2 + 3 * levels.shape[1]), np.uint8)  # zeros are left out
    number, more = times.copy(), np.ones(len(times), bool)
    for column in range(size, 0, -1):
        number, digit = np.divmod(number, 10)
        table[:, column] = (digit + ord("0")) * more
        more = number > 0
    table[:, 0], table[:, size + 1] = ord("#"), ord("\n")
    change = table[:, size + 2 :].reshape(len(times), -1, 3)
    change[:, :, 0] = (levels + ord("0")) * changed
    change[:, :, 1] = np.array(IDS[: levels.shape[1]], np.uint8) * changed
    change[:, :, 2] = ord("\n") * changed
    return table[table > 0].tobytes()


def _compare(
    pulses: PulseSchedule,
    wiring: Sequence[int],
    path: Path,
    digits: int,
    triggers: Sequence[TriggerLine],
) -> Exported:
    read = _read(path, 2 * len(wiring) + len(triggers))
    same = True
    for k, (axis, sign) in enumerate(zip(pulses.axes, wiring, strict=True)):
        turned, way = read[2 * k + 1]
        times = _find_rises(read[2 * k])
        direction = np.where(
            way[np.searchsorted(turned, times, side="right") - 1] == 1, sign, -sign
        )
        same &= np.array_equal(_ticks(times, pulses.clock_hz, digits), axis.ticks)
        same &= np.array_equal(direction, axis.direction)
    for changes, line in zip(read[2 * len(wiring) :], triggers, strict=True):
        same &= np.array_equal(_ticks(_find_rises(changes), pulses.clock_hz, digits), line.ticks)
    return Exported(0.0 if same else np.inf, "the pulses, edge by edge", moves=pulses.total)


def _find_rises(changes: tuple[Ticks, NDArray[np.uint8]]) -> Ticks:
    """Return the times at which a line rises, of its changes; before the first it is low."""
    at, level = changes
    rises = (level == 1) & (np.concatenate([[0], level[:-1]]) == 0)
    return np.asarray(at[rises])


def _ticks(times: Ticks, clock_hz: int, digits: int) -> Ticks:
    scale = 10**digits
    exact = scale % clock_hz == 0
    return np.asarray(times // (scale // clock_hz) if exact else np.rint(times / scale * clock_hz))


def _read(path: Path, lines: int) -> list[tuple[Ticks, NDArray[np.uint8]]]:
    """For each line the times at which it changes, and to which level."""
    found: list[list[tuple[Ticks, NDArray[np.uint8]]]] = [[] for _ in range(lines)]
    with path.open("rb") as file:
        while not file.readline().startswith(b"$enddefinitions"):
            pass
        now, kept = 0, b""
        while part := file.read(PART_BYTES):
            *words, kept = (kept + part).split(b"\n")
            if not words:
                continue
            table = np.array(words, f"S{TIME_BYTES}").view(np.uint8).reshape(len(words), TIME_BYTES)
            timed = table[:, 0] == ord("#")
            times = np.array(
                [now, *(int(word[1:]) for word in words if word[:1] == b"#")], np.int64
            )
            at, now = times[np.cumsum(timed)], int(times[-1])
            changes = (table[:, 0] == ord("0")) | (table[:, 0] == ord("1"))
            for k in range(lines):
                own = changes & (table[:, 1] == IDS[k])
                found[k].append((at[own], table[own, 0] - ord("0")))
    return [
        (np.concatenate([t for t, _ in part]), np.concatenate([v for _, v in part]))
        for part in found
    ]
