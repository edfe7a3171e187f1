"""The run-length step queue as text: commands for firmware that makes the steps itself, as
Klipper's does.

    # pulsepath circle: ticks of 10000000 Hz, every pulse within 10 of them
    # oid 0 = "leg1", "dir" 1 is a positive count of the wiring
    reset_step_clock 0 0
    set_next_step_dir 0 1
    queue_step 0 84721 1 0
    queue_step 0 35092 3 -5122

- queue_step oid interval count add: pulse k (from 0) falls at last + (k+1)·interval + add·k(k+1)/2,
  where last is the axis' last pulse, or the tick of its reset_step_clock. count is 1 to 65535, add
  ±32767, interval up to 3·2²⁸, since firmware takes what is 2³¹ ticks ahead for past.
- reset_step_clock oid clock stands before an axis' first pulse, and after a wait longer than an
  interval can be. Of a motion that goes on with another it stands before no axis that a pulse was
  sent to: firmware refuses it while a stepper is active. `# oid 0 goes on, its last pulse at
  -84721` says from where its first command counts.
- set_next_step_dir oid dir stands before the first command, and before each that goes the other
  way.
- Commands of all axes stand in the order of the ticks from which they count. With --named each
  number is written with its name, `queue_step oid=0 interval=84721 count=1 add=0`, as Klipper's own
  console takes it.
- Lines from # on are comments, names in them in double quotes with JSON's escapes. ASCII, line ends
  \\n.
"""

import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, floor
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import finite_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from kinematics.foundation.units import format_distinct
from planner.export.format import Exported, ExportSource
from planner.pulses.compression import MAX_INTERVAL, StepQueue, compress, decompress
from planner.pulses.schedule import Signs, Ticks

TOLERANCE = 1e-6  # s
TICK_ROUNDING = 1e-6  # ticks: a time so near to whole ones is meant to be whole
BLOCK_COMMANDS = 1 << 13  # commands written together
GOES_ON = re.compile(r"# oid (\d+) goes on, its last pulse at (-?\d+)")
COMMANDS = {
    "queue_step": ("oid", "interval", "count", "add"),
    "set_next_step_dir": ("oid", "dir"),
    "reset_step_clock": ("oid", "clock"),
}


@dataclass(frozen=True, slots=True)
class Steps:
    """Run-length step queue as in Klipper: commands of interval, count and add, in clock ticks."""

    suffix: ClassVar[str] = ".steps"
    within: float = option(
        TOLERANCE,
        "largest time error of a pulse, for longer commands. Default 1 us",
        "s",
        like="1 us",
    )
    least: float | None = option(
        None, "smallest time between pulses of an axis. Default: as its drive requires", "s"
    )
    named: bool = option(False, "write each number with its name, as Klipper's console takes it")

    def write(self, source: ExportSource, path: Path) -> Exported:
        pulses, clock = source.pulses, source.pulses.clock_hz
        tolerance = floor(
            float(finite_array(self.within, "within", (), unit="s", least=0.0)) * clock
            + TICK_ROUNDING
        )
        asked = ceil(
            float(finite_array(self.least or 0.0, "least", (), unit="s", least=0.0)) * clock
            - TICK_ROUNDING
        )
        own = [axis.pulse_ticks(clock)[0] for axis in source.machine.axes]
        least = [max(asked, 1, 0 if self.least is not None else ticks) for ticks in own]
        queues = (
            compress(pulses.axes, tolerance, least[0])
            if len(set(least)) == 1
            else tuple(
                compress([axis], tolerance, n)[0]
                for axis, n in zip(pulses.axes, least, strict=True)
            )
        )
        forms = {
            name: " ".join([name, *(f"{key}=%d" if self.named else "%d" for key in keys)]) + "\n"
            for name, keys in COMMANDS.items()
        }
        with path.open("w", encoding="ascii", newline="") as file:
            file.write(
                f"# pulsepath {json.dumps(source.name)}: ticks of {clock} Hz, pulses within {tolerance} of them\n"
            )
            for k, axis in enumerate(pulses.axes):
                file.write(
                    f"# oid {k} = {json.dumps(axis.name)}, dir 1 is a positive count of the wiring\n"
                )
            begun = [_find_begun(source, k, queue) for k, queue in enumerate(queues)]
            for k, last in enumerate(begun):
                file.write("" if last is None else f"# oid {k} goes on, its last pulse at {last}\n")
            for lines in _lines(
                queues, begun, [axis.direction for axis in source.machine.axes], forms
            ):
                file.write(lines)
        return _compare(source, path, sum(map(len, queues)))


def _find_begun(source: ExportSource, k: int, queue: StepQueue) -> int | None:
    """The tick of the last pulse that axis k was sent, if its first command counts from there: 0 or
    less.
    """
    sent = source.sent[k].last if source.goes_on and source.sent else None
    if (
        sent is None
        or not len(queue)
        or queue.reset[0] != 0
        or queue.interval[0] - sent.tick > MAX_INTERVAL
    ):
        return None
    return sent.tick


def _lines(
    queues: Sequence[StepQueue],
    begun: Sequence[int | None],
    wiring: Sequence[int],
    forms: dict[str, str],
) -> Iterator[str]:
    """The commands of all axes, in the order of the ticks from which they count, in blocks.

    begun: of each axis the tick that its first command counts from, instead of a reset
    """
    lasts = [queue.last.copy() for queue in queues]
    resets, intervals = (
        [queue.reset.copy() for queue in queues],
        [queue.interval.copy() for queue in queues],
    )
    for last, reset, interval, tick in zip(lasts, resets, intervals, begun, strict=True):
        if tick is not None:  # the first command is of one pulse
            last[0], reset[0], interval[0] = tick, -1, interval[0] - tick
    oid = np.repeat(np.arange(len(queues)), [len(queue) for queue in queues])
    nth = np.concatenate([np.arange(len(queue)) for queue in queues])
    order = np.argsort(np.concatenate(lasts), kind="stable")
    reset = np.concatenate(resets)
    way = np.concatenate(
        [queue.direction == sign for queue, sign in zip(queues, wiring, strict=True)]
    ).astype(np.int64)
    turned = (nth == 0) | (np.diff(way, prepend=-1) != 0)
    numbers = np.concatenate(
        [
            np.column_stack([own, queue.count, queue.add])
            for own, queue in zip(intervals, queues, strict=True)
        ]
    )
    step, turn, restart = (forms[name] for name in COMMANDS)
    for first in range(0, len(order), BLOCK_COMMANDS):
        part = order[first : first + BLOCK_COMMANDS]
        rows = zip(
            *(column[part].tolist() for column in (oid, reset, turned, way, numbers)), strict=True
        )
        yield "".join(
            (restart % (k, clock) if clock >= 0 else "")
            + (turn % (k, to) if turns else "")
            + step % (k, *of_command)
            for k, clock, turns, to, of_command in rows
        )


def read(path: Path, wiring: Sequence[int]) -> tuple[tuple[Ticks, Signs], ...]:
    """Ticks and directions in q of the pulses of each axis, by the `direction` of each."""
    commands: list[list[tuple[int, ...]]] = [[] for _ in wiring]
    clock, way = dict.fromkeys(range(len(wiring)), -1), dict.fromkeys(range(len(wiring)), 0)
    begun: dict[int, int] = {}
    with path.open(encoding="ascii", newline="") as file:
        for line in file:
            if going := GOES_ON.fullmatch(line.strip()):
                begun[int(going[1])] = int(going[2])
            name, *words = line.partition("#")[0].split() or [""]
            k, *values = (int(word.rpartition("=")[2]) for word in words) if name else (0,)
            if name == "reset_step_clock":
                clock[k] = values[0]
            elif name == "set_next_step_dir":
                way[k] = wiring[k] if values[0] else -wiring[k]
            elif name == "queue_step":
                if k in begun:
                    values[0], clock[k] = values[0] + begun.pop(k), 0
                commands[k].append((*values, way[k], clock[k]))
                clock[k] = -1
    return tuple(
        decompress(StepQueue("", *np.array(rows, np.int64).reshape(-1, 5).T)) for rows in commands
    )


def _compare(source: ExportSource, path: Path, commands: int) -> Exported:
    """How far the decoded pulses are from their own, along the straight lines between either."""
    pulses = source.pulses
    worst, late = 0.0, 0
    held = read(path, [axis.direction for axis in source.machine.axes])
    for axis, (ticks, direction), driven in zip(
        pulses.axes, held, source.machine.axes, strict=True
    ):
        if not np.array_equal(direction, axis.direction):
            return Exported(np.inf, f"the pulses: axis {axis.name} has others")
        back = np.diff(ticks)[np.diff(direction) != 0]
        needed = driven.pulse_ticks(pulses.clock_hz)[1]
        if len(back) and back.min() < needed:
            closest, taken = format_distinct(
                1e6 * back.min() / pulses.clock_hz, 1e6 * needed / pulses.clock_hz, digits=4
            )
            raise MotionError(
                f"steps: axis {axis.name}: a reversal within {closest} us, and it takes {taken} us; "
                "give a shorter --within"
            )
        nth = np.arange(len(ticks))
        late = max(late, int(abs(ticks - axis.ticks).max(initial=0)))
        for one, other in ((ticks, axis.ticks), (axis.ticks, ticks)):
            worst = max(
                worst,
                float(abs(np.interp(one, other, nth) - nth).max(initial=0.0)) if len(nth) else 0.0,
            )
    notes = (
        f"commands: {commands}, each of {pulses.total / max(commands, 1):.1f} pulses on average",
        f"a pulse is off by up to {1e6 * late / pulses.clock_hz:.4g} us",
    )
    return Exported(
        worst, "the pulses, joined by straight lines", notes, sum(len(ticks) for ticks, _ in held)
    )
