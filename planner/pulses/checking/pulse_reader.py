"""Pulses read back from the binary form, part by part; `planner.export.formats.binary` writes it
and says what it is.

Independent of what wrote the file: nothing but the layout is shared, and what a part holds has to
fit what the file says of it.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any
from zlib import decompressobj
from zlib import error as ZlibError

import numpy as np
from numpy.typing import NDArray

from kinematics.files.chunk_file import (
    MAX_INTEGER,
    Chunk,
    ChunkFile,
    open_chunks,
    read_integer,
    read_number,
)
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.options import check_arguments
from planner.parallel import Progress, ignore_progress
from planner.pulses.schedule import (
    AxisPulses,
    Compensation,
    MovedPulses,
    PulseSchedule,
    Signs,
    Ticks,
)

KIND, SCHEMA = "pulsepath pulses", 1
PULSES = "PULS"
"""Kind of the chunks that have pulses."""
SPAN, AXIS = struct.Struct("<qqQ"), struct.Struct("<IBI")
ESCAPES = {1: 0xFF, 2: 0xFFFF, 4: 0xFFFF_FFFF}
"""Of codes of so many bytes, the one whose value stands apart."""
MAX_PART_PULSES = 1 << 20
"""Pulses of an axis in a chunk, at most: what bounds the memory of those who read a file that
somebody else wrote.
"""
PULSE_BYTES = 13
"""Bytes of a pulse in a chunk that is inflated, at most: a code of 4, one of 8 apart from it, and
its direction.
"""
PULSES_PER_BYTE = 8
"""Pulses that there is room for before any are read, for each byte of a file: more than most files
have.
"""


@dataclass(frozen=True, slots=True)
class PulseFile:
    """A file of pulses, of which one part at a time is read.

    stated  the schedule without its pulses
    pulses  how many each axis has
    final   the count that each axis ends with
    until   tick before which all pulses come
    """

    stated: PulseSchedule
    pulses: tuple[int, ...]
    final: tuple[int, ...]
    until: int
    _chunks: ChunkFile

    def parts(self, tell: Progress = ignore_progress) -> Iterator[PulseSchedule]:
        """The pulses in parts that follow each other in time, each from the counts that the one
        before ends with.

        Ticks count from the start of the motion, and the duration is its. Raises FileError for
        damage, with its place.
        """
        stated = self.stated
        counts, done, begin = [axis.start for axis in stated.axes], [0] * len(stated.axes), 0
        for n, (chunk, contents) in enumerate(self._chunks.contents()):
            left = [stated - number for stated, number in zip(self.pulses, done, strict=True)]
            begin, pulses = self._decode(chunk, contents, begin, left)
            axes = tuple(
                replace(axis, ticks=ticks, direction=direction, start=count)
                for axis, (ticks, direction), count in zip(stated.axes, pulses, counts, strict=True)
            )
            counts = [axis.final for axis in axes]
            done = [number + len(axis) for number, axis in zip(done, axes, strict=True)]
            yield replace(stated, axes=axes, moves=(), compensations=())
            tell(n + 1, len(self._chunks.chunks))
        if (tuple(done), tuple(counts)) != (self.pulses, self.final):
            told = f"holds {done} pulses that count to {counts}, and says {self.pulses} that count to {self.final}"
            raise self._refusal(f"{told}: write it again")
        if begin != self.until:
            raise self._refusal(
                f"holds pulses up to tick {begin}, and says {self.until}: write it again"
            )

    def read(self, tell: Progress = ignore_progress) -> PulseSchedule:
        """All of it. Raises FileError as `parts` does."""
        # The arrays grow with the pulses read, as a damaged file may state more than fit into
        # memory.
        room = PULSES_PER_BYTE * self._chunks.size // max(1, len(self.pulses))
        ticks = [np.empty(min(number, room), np.int64) for number in self.pulses]
        direction = [np.empty(len(each), np.int8) for each in ticks]
        done = [0] * len(ticks)
        for part in self.parts(tell):
            for k, axis in enumerate(part.axes):
                end = done[k] + len(axis)
                if end > len(ticks[k]):
                    size = min(self.pulses[k], max(end, 2 * len(ticks[k])))
                    ticks[k].resize(size, refcheck=False)
                    direction[k].resize(size, refcheck=False)
                ticks[k][done[k] : end], direction[k][done[k] : end] = axis.ticks, axis.direction
                done[k] = end
        for k in range(len(ticks)):
            ticks[k].flags.writeable = direction[k].flags.writeable = (
                False  # so that they are not copied
            )
        axes = (
            replace(axis, ticks=ticks[k], direction=direction[k])
            for k, axis in enumerate(self.stated.axes)
        )
        return replace(self.stated, axes=tuple(axes))

    def _decode(
        self, chunk: Chunk, contents: bytes, begin: int, left: Sequence[int]
    ) -> tuple[int, list[tuple[Ticks, Signs]]]:
        """Return the tick that a chunk ends before, and the pulses of each axis from `begin` to
        there.

        left: how many pulses each axis has from `begin` on, as the mark states.
        """
        try:
            since, until, size = SPAN.unpack_from(contents)
            most = sum(AXIS.size + PULSE_BYTES * min(number, MAX_PART_PULSES) for number in left)
            if not 0 < size <= most:
                raise ValueError(
                    f"it states {size} bytes, and the pulses that are left have up to {most}"
                )
            inflate = decompressobj()
            content = inflate.decompress(contents[SPAN.size :], size)
            if (
                since != begin
                or until < since
                or len(content) != size
                or not inflate.eof
                or inflate.unused_data
            ):
                raise ValueError(f"its span {since} to {until} or its length do not fit")
            pulses, at = [], 0
            for number in left:
                ticks, direction, at = _decode_axis(
                    content, at, since, min(number, MAX_PART_PULSES)
                )
                rise = bool(
                    (ticks[1:] > ticks[:-1]).all()
                )  # differences of damaged ticks could overflow
                if len(ticks) and not (since <= ticks[0] and ticks[-1] < until and rise):
                    raise ValueError("its ticks do not rise, or leave its span")
                pulses.append((ticks, direction))
            if at != size:
                raise ValueError("it has more than its axes need")
        except (struct.error, ZlibError, ValueError) as error:
            where = f"chunk {chunk.number}, from byte {chunk.begin} and {begin / self.stated.clock_hz:.9g} s"
            raise self._refusal(f"{where}, holds no pulses: {error}; write it again") from None
        return until, pulses

    def _refusal(self, message: str) -> FileError:
        return FileError(str(self._chunks.path), [Fault("", message)])


def _decode_axis(content: bytes, at: int, begin: int, most: int) -> tuple[Ticks, Signs, int]:
    """Return ticks and directions of an axis, and the place of the next. most: pulses that the axis
    may have.
    """
    count, width, escaped = AXIS.unpack_from(content, at)
    if width not in ESCAPES:
        raise ValueError(f"its codes have {width} bytes")
    if count > most or escaped > count:
        raise ValueError(
            f"it states {count} pulses of which {escaped} are apart, and there are {most} at most"
        )
    at += AXIS.size
    narrow = np.frombuffer(content, f"<u{width}", count, at)
    at += count * width
    apart: NDArray[np.uint64] = np.frombuffer(content, "<u8", escaped, at)
    at += escaped * 8
    bits = np.frombuffer(content, np.uint8, (count + 7) // 8, at)
    codes = narrow.astype(np.uint64)
    if escaped:
        codes[narrow == ESCAPES[width]] = apart
    changes = ((codes >> np.uint64(1)) ^ (np.uint64(0) - (codes & np.uint64(1)))).view(np.int64)
    ticks = begin + np.cumsum(np.cumsum(changes))
    direction = 1 - 2 * np.unpackbits(bits, count=count).view(np.int8)
    ticks.flags.writeable = direction.flags.writeable = False  # so that they are not copied
    return ticks, direction, at + len(bits)


@check_arguments()
def open_pulses(path: str | PathLike[str]) -> PulseFile:
    """Open a file of pulses in the binary form, of which only the first and last chunk are read.

    Parameters
    ----------
    path
        Of the file.

    Returns
    -------
    PulseFile
        Reads its parts on demand.

    Raises
    ------
    FileError
        The file is no such file, of another version, cut or damaged.
    """
    chunks = open_chunks(path, KIND, SCHEMA, (PULSES,))
    try:
        return _interpret(chunks)
    except (KeyError, TypeError, ValueError, MotionError) as error:
        raise FileError(
            str(path), [Fault("", f"states no pulse schedule: {error!r}; write it again")]
        ) from None


@check_arguments()
def read_pulses(path: str | PathLike[str]) -> PulseSchedule:
    """Read the schedule in a file of the binary form, as it was written.

    Parameters
    ----------
    path
        Of the file.

    Returns
    -------
    PulseSchedule
        All pulses, in memory.

    Raises
    ------
    FileError
        As `open_pulses`.
    """
    return open_pulses(path).read()


def _interpret(chunks: ChunkFile) -> PulseFile:
    """Return what a file states.

    Raises KeyError, TypeError, ValueError or MotionError for what no writer states.
    """
    head, mark = chunks.head, chunks.mark
    axes = tuple(_read_axis(*pair) for pair in zip(head["axes"], mark["bound"], strict=True))
    clock, duration = read_number(head["clock_hz"], 1.0), read_number(mark["duration"], 0.0)
    clock_hz = int(clock)
    if clock_hz != clock:
        raise ValueError(f"a clock of {clock} Hz")
    if duration * clock_hz > MAX_INTEGER:
        raise ValueError(f"{duration} s have more ticks of {clock_hz} Hz than 63 bits count")
    stated = PulseSchedule(
        clock_hz,
        axes,
        duration,
        str(head["rule"]),
        tuple(_read_move(one) for one in mark["moves"]),
        tuple(read_compensation(one) for one in mark["compensations"]),
    )
    pulses = tuple(read_integer(number, 0) for number in mark["pulses"])
    final = tuple(read_integer(number) for number in mark["final"])
    if not len(pulses) == len(final) == len(axes):
        raise ValueError(
            f"{len(axes)} axes, pulses of {len(pulses)} and final counts of {len(final)}"
        )
    return PulseFile(stated, pulses, final, read_integer(mark["until"], 0), chunks)


def _read_axis(record: Mapping[str, Any], bound: object) -> AxisPulses:
    """Return an axis without its pulses, from its fields as JSON has them."""
    return AxisPulses(
        str(record["name"]),
        np.empty(0, np.int64),
        np.empty(0, np.int8),
        start=read_integer(record["start"], -MAX_START, MAX_START),
        pulse=read_number(record["pulse"], 0.0),
        home=read_number(record["home"]),
        bound=read_number(bound, 0.0),
    )


MAX_START = 1 << 62
"""Largest magnitude of the count before the first pulse: counts from there on fit into an int64."""


def _read_move(record: Mapping[str, Any]) -> MovedPulses:
    """Return what moving pulses cost, from its fields as JSON has them."""
    moved = MovedPulses(**record)
    read_integer(moved.pulses)
    for name in ("time", "error", "t", "length"):
        read_number(getattr(moved, name))
    return moved


def read_compensation(record: Mapping[str, Any]) -> Compensation:
    """Return what compensation costs, from its fields as JSON has them."""
    windows = tuple((read_number(begin), read_number(end)) for begin, end in record["windows"])
    kinds = tuple(str(kind) for kind in record["kinds"])
    cost = Compensation(**{**record, "kinds": kinds, "windows": windows})
    read_integer(cost.crossings)
    for name in ("off", "unturned", "speed", "acceleration", "jerk"):
        read_number(getattr(cost, name))
    for most in (cost.max_speed, cost.max_acceleration):
        if most is not None:
            read_number(most)
    return cost


def list_statements(schedule: PulseSchedule, k: int) -> dict[str, object]:
    """What a schedule states of its axis k, besides the pulses."""
    axis = schedule.axes[k]
    return {
        **{name: getattr(schedule, name) for name in ("clock_hz", "rule", "duration")},
        **{name: getattr(axis, name) for name in ("start", "pulse", "home", "bound")},
        "moves": [one for one in schedule.moves if one.axis == axis.name],
        "compensations": [one for one in schedule.compensations if one.axis == axis.name],
    }
