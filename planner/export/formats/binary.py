"""Pulses in the binary form: chunks of some thousand pulses, a quarter of a byte each.

The file is one of `kinematics.files.chunk_file`, which says how chunks are laid out. All numbers
are little-endian.

    HEAD   JSON: kind "pulsepath pulses", schema 1, clock_hz (ticks/s), rule, and of each axis:
           name, start (count), pulse and home (in its unit), unit ("m" or "rad")
    PULS   int64 begin, int64 end: the span of ticks, from begin to before end, of which it has the
           pulses of all axes; uint64 length of what follows once it is inflated; that, deflated
           (zlib, RFC 1950). In there, of each axis:
               uint32 pulses n, uint8 width w (1, 2, 4), uint32 escapes e
               n codes of w bytes, e codes of 8 bytes, ⌈n/8⌉ bytes of directions; n is at most 2²⁰
    MARK   JSON: complete (true), until (the tick at which the last PULS ends), duration (s), of
           each axis: bound (pulses), pulses (how many), final (count); moves, compensations

A code c stands for the change of interval d = c/2 (c even) or -(c + 1)/2 (c odd): with the interval
before the first pulse of a chunk taken as 0, and the tick before it as begin, interval += d, tick
+= interval. Of w bytes, the largest code says that the next of 8 bytes takes its place. The bits of
the directions have the first pulse in the highest bit of the first byte; 1 is a pulse towards
smaller q. The first chunk begins at tick 0, each other where one before ends.

The same schedule gives the same bytes with the same zlib. A file holds the pulses as they are in
`PulseSchedule`, with directions in q, not in the wiring's count.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO, ClassVar
from zlib import compress

import numpy as np

from kinematics.files.chunk_file import ChunkWriter
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from planner.export.format import Exported, ExportSource
from planner.parallel import Progress, ignore_progress, share_progress
from planner.pulses.checking.pulse_reader import (
    AXIS,
    ESCAPES,
    KIND,
    PULSES,
    SCHEMA,
    SPAN,
    open_pulses,
)
from planner.pulses.checking.pulse_reader import MAX_PART_PULSES as LARGEST_PART
from planner.pulses.schedule import UNKNOWN_UNIT, PulseSchedule, Signs, Ticks, holds_same_pulses

MAX_PART_PULSES = 1 << 16
"""Pulses of an axis in a chunk: more take more memory to read, fewer make the file larger."""
LEVEL = 1
"""zlib level. Higher levels take five times as long and save a fifth of the bytes."""


@dataclass(frozen=True, slots=True)
class Binary:
    """The pulse schedule itself in compressed chunks, for pulsepath.read_pulses."""

    suffix: ClassVar[str] = ".bin"
    part: int = option(MAX_PART_PULSES, "largest number of pulses per axis and part")

    def write(self, source: ExportSource, path: Path) -> Exported:
        units = {axis.name: axis.unit for axis in source.machine.axes}
        write(source.pulses, path, units, self.part, share_progress(source.tell, 0, 2))
        written = open_pulses(path).parts(share_progress(source.tell, 1, 2))
        exact = holds_same_pulses(source.pulses, written)
        return Exported(
            0.0 if exact else np.inf, "the pulses, tick for tick", moves=source.pulses.total
        )


def write(
    schedule: PulseSchedule,
    path: str | PathLike[str],
    units: Mapping[str, str] | None = None,
    part: int = MAX_PART_PULSES,
    tell: Progress = ignore_progress,
) -> None:
    """Write a schedule; units: m or rad by axis. Raises MotionError for invalid pulses."""
    with Path(path).open("wb") as file:
        writer = PulseWriter(file, schedule, units, part)
        writer.add(schedule, find_end(schedule), tell)
        writer.finish(schedule)


def find_end(schedule: PulseSchedule) -> int:
    """Return the tick after the motion and its last pulse."""
    last = max((int(axis.ticks[-1]) for axis in schedule.axes if len(axis)), default=0)
    return 1 + max(last, int(schedule.duration * schedule.clock_hz))


class PulseWriter:
    """Writes a file of pulses part by part. until: the tick before which all pulses are written."""

    __slots__ = ("_chunks", "_counts", "_names", "_part", "_pulses", "until")

    def __init__(
        self,
        file: BinaryIO,
        stated: PulseSchedule,
        units: Mapping[str, str] | None = None,
        part: int = MAX_PART_PULSES,
    ) -> None:
        """Write the head of a file: clock, rule and axes of `stated`, without its pulses."""
        if not 1 <= part <= LARGEST_PART:
            raise MotionError(f"parts of {part} pulses: give 1 to {LARGEST_PART}")
        axes = [
            {
                "name": axis.name,
                "start": axis.start,
                "pulse": axis.pulse,
                "home": axis.home,
                "unit": (units or {}).get(axis.name, UNKNOWN_UNIT),
            }
            for axis in stated.axes
        ]
        head = {
            "kind": KIND,
            "schema": SCHEMA,
            "clock_hz": stated.clock_hz,
            "rule": stated.rule,
            "axes": axes,
        }
        self._chunks = ChunkWriter(file, head)
        self._names = tuple(axis.name for axis in stated.axes)
        self._part = part
        self._counts = [axis.start for axis in stated.axes]
        self._pulses = [0] * len(stated.axes)
        self.until = 0

    def add(self, part: PulseSchedule, until: int, tell: Progress = ignore_progress) -> None:
        """Write the pulses that follow, all those before the tick `until`.

        Raises MotionError for pulses that do not follow the previous part.
        """
        if until < self.until:
            message = f"the pulses up to tick {self.until} are in the file: these are said to end at {until}"
            raise MotionError(message)
        _check_part(part, self._names, self.until, until)
        total = max(1, part.total)
        written = 0
        for span, axes in _cut(part, self.until, until, self._part):
            self._chunks.add(PULSES, encode(span, axes))
            for k, (ticks, directions) in enumerate(axes):
                self._pulses[k] += len(ticks)
                self._counts[k] += int(directions.sum(dtype=np.int64))
                written += len(ticks)
            tell(min(total, written), total)
        self.until = until

    def finish(self, stated: PulseSchedule) -> None:
        """Complete the file with the totals, and with the duration and the bounds of `stated`."""
        self._chunks.finish(
            {
                "until": self.until,
                "duration": stated.duration,
                "bound": [axis.bound for axis in stated.axes],
                "pulses": self._pulses,
                "final": self._counts,
                "moves": [asdict(one) for one in stated.moves],
                "compensations": [asdict(one) for one in stated.compensations],
            }
        )


def _check_part(part: PulseSchedule, names: tuple[str, ...], begin: int, until: int) -> None:
    if tuple(axis.name for axis in part.axes) != names:
        raise MotionError(
            f"the pulses are of axes {[axis.name for axis in part.axes]}, the file's are {list(names)}"
        )
    for axis in part.axes:
        if (abs(axis.direction) != 1).any():
            raise MotionError(f"axis {axis.name}: a direction is neither +1 nor -1")
        if not len(axis):
            continue
        if not (np.diff(axis.ticks) > 0).all():
            raise MotionError(f"axis {axis.name}: its ticks do not rise")
        if axis.ticks[0] < begin or axis.ticks[-1] >= until:
            ticks = f"ticks {axis.ticks[0]} to {axis.ticks[-1]}"
            raise MotionError(f"axis {axis.name}: {ticks} are not from {begin} to before {until}")


Span = tuple[int, int]
Pulses = tuple[Ticks, Signs]


def _cut(
    part: PulseSchedule, begin: int, until: int, most: int
) -> Iterator[tuple[Span, list[Pulses]]]:
    """Cut a part into spans of time in which no axis has more than `most` pulses."""
    done = [0] * len(part.axes)
    while begin < until:
        following = (
            int(axis.ticks[k + most])
            for axis, k in zip(part.axes, done, strict=True)
            if k + most < len(axis)
        )
        end = min(following, default=until)
        cuts = [int(np.searchsorted(axis.ticks, end)) for axis in part.axes]
        yield (
            (begin, end),
            [
                (axis.ticks[k:to], axis.direction[k:to])
                for axis, k, to in zip(part.axes, done, cuts, strict=True)
            ],
        )
        done, begin = cuts, end


def encode(span: Span, axes: list[Pulses]) -> bytes:
    """Return the contents of a chunk."""
    content = b"".join(_encode_axis(ticks, direction, span[0]) for ticks, direction in axes)
    return SPAN.pack(*span, len(content)) + compress(content, LEVEL)


def _encode_axis(ticks: Ticks, direction: Signs, begin: int) -> bytes:
    changes = np.diff(np.diff(ticks, prepend=begin), prepend=0)
    codes = ((changes << 1) ^ (changes >> 63)).view(np.uint64)
    apart = {width: codes >= most for width, most in ESCAPES.items()}
    width = min(apart, key=lambda each: each * len(codes) + 8 * int(np.count_nonzero(apart[each])))
    far = apart[width]
    escapes: Any = codes[far].astype("<u8")
    narrow: Any = np.minimum(codes, np.uint64(ESCAPES[width])).astype(f"<u{width}")
    bits = np.packbits(direction < 0)
    return b"".join(
        (
            AXIS.pack(len(ticks), width, len(escapes)),
            narrow.tobytes(),
            escapes.tobytes(),
            bits.tobytes(),
        )
    )
