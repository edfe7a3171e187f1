"""The files of a plan's motion: trajectory.csv and triggers.csv as tables, motion.bin as its exact pieces.

trajectory.csv has one row per instant, for spreadsheets and plots. Columns are time, distance along the path, the pose
of the platform in the base frame (rx, ry, rz about the moving axes in turn), and position (natural coordinate), speed,
acceleration and jerk of every axis. SI units, as the header says.

triggers.csv has one row per event, in the order of time. Columns are name, segment, repetition (1 where the program
runs once), time, distance along the path, the pose of the platform in the base frame, and the count of every axis. SI
units.

motion.bin has the closed-form pieces, exact to the last bit, so that a plan can be taken up without solving. It is a
file of `kinematics.files.chunk_file`, which grows as `planner.export.formats.binary` has it of pulses:

    HEAD   JSON: kind "pulsepath motion", schema 1, and the unit of each array
    MOTN   uint64 pieces n; deflated (zlib, RFC 1950): the bytes of 6n + 1 numbers, first the lowest byte of all, then
           the next, up to the eighth; of float64 (little-endian) n + 1 knots, of which the first is the last of the
           chunk before, n s, n v, n a, n j as `Trajectory` has them, and of int64 n indices of path pieces
    motn   the same of a stop that the next chunks replace: it counts while the mark behind it is the last
    MARK   JSON: complete, duration (s), pieces (how many)
"""

import csv
import json
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO
from zlib import compress, decompressobj
from zlib import error as ZlibError

import numpy as np

from kinematics import Axis, Fault, FileError, MotionError
from kinematics.files.chunk_file import Chunk, ChunkWriter, open_chunks, resume_chunks
from kinematics.foundation.arrays import Array
from planner.path.actuation import ActuatorPath
from planner.pulses.triggers import Triggered
from planner.trajectory import Trajectory, column_headings, row_instants, rows

BLOCK_ROWS = 1 << 13
"""Rows computed and written together, so that memory stays bounded."""


def write_trajectory_csv(trajectory: Trajectory, path: Path) -> None:
    """Write the table: 12 significant digits, line ends \\n, decimal points whatever the locale."""
    t = row_instants(trajectory)
    header = [f"{name} [{unit}]" if unit else name for name, unit in column_headings(trajectory.path)]
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(header)
        for first in range(0, len(t), BLOCK_ROWS):
            np.savetxt(file, rows(trajectory, t[first : first + BLOCK_ROWS]), fmt="%.12g", delimiter=",")


def write_trigger_csv(triggers: Sequence[Triggered], axes: Sequence[Axis], path: Path) -> None:
    """Write the table: numbers as Python's shortest decimals, which read back as the same floats; line ends \\n."""
    place = [*(f"{name} [m]" for name in "xyz"), *(f"r{name} [rad]" for name in "xyz")]
    counts = [f"{axis.name} [counts]" for axis in axes]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["name", "segment", "repetition", "t [s]", "s [m]", *place, *counts])
        for event in sorted(triggers, key=lambda event: event.time):
            at, angles = event.where, event.pose.rotation.as_euler("XYZ", suppress_warnings=True)
            pose = [value + 0.0 for value in (*event.pose.translation.tolist(), *angles.tolist())]  # no −0
            table.writerow([event.name, at.segment, at.repetition or 1, event.time, at.s, *pose, *event.counts])


PIECES = ("s", "v", "a", "j", "piece")
"""One entry per time piece, as `Trajectory` has them; its knots are one more."""


def write_motion_json(trajectory: Trajectory, path: Path) -> None:
    """Write knots and pieces; Python's shortest decimals read back as the same floats."""
    path.write_text(json.dumps({name: getattr(trajectory, name).tolist() for name in ("knots", *PIECES)}) + "\n")


KIND, SCHEMA = "pulsepath motion", 1
UNITS = {"knots": "s", "s": "m", "v": "m/s", "a": "m/s^2", "j": "m/s^3", "piece": ""}
MAX_CHUNK_PIECES = 1 << 14
"""What bounds the memory of those who write and read, beside the motion itself."""
COUNT = struct.Struct("<Q")
LEVEL = 1
"""Of zlib: most bytes of such numbers are as good as random."""


class MotionWriter:
    """A file of a motion that grows, piece by piece, as `planner.export.formats.binary.PulseWriter` one of pulses."""

    __slots__ = ("_chunks", "_kept", "_stop")

    def __init__(self, chunks: ChunkWriter, pieces: int, knot: float | None) -> None:
        self._chunks = chunks
        self._kept: tuple[int, float | None] = pieces, knot
        self._stop: tuple[int, float | None] | None = None

    @classmethod
    def begin(cls, file: BinaryIO) -> "MotionWriter":
        """A new file."""
        return cls(ChunkWriter(file, {"kind": KIND, "schema": SCHEMA, "units": UNITS}), 0, None)

    @classmethod
    def resume(cls, path: Path, file: BinaryIO) -> "MotionWriter":
        """Go on with a file that is not finished, open to be read and written: from its last mark, without its stop.

        Raises MotionError where it is finished, FileError where it is damaged.
        """
        held = open_chunks(path, KIND, SCHEMA, partial=True)
        if held.complete:
            raise MotionError(f"{path} is finished: no motion can be added to it")
        pieces, knot = 0, None
        for chunk, contents in held.contents():
            if not chunk.kind.islower():
                knots, rest = _decode(contents, chunk, path)
                pieces, knot = pieces + len(rest[0]), float(knots[-1])
        return cls(resume_chunks(held, file), pieces, knot)

    def add(self, motion: Trajectory, *, stop: bool = False) -> None:
        """The pieces that follow; stop: they end the motion, until others replace them.

        Raises MotionError where they do not begin when those before end, and for others than a stop's behind one.
        """
        if self._stop is not None and not stop:
            raise MotionError("a stop was added and not marked: mark it before what replaces it")
        pieces, knot = self._stop or self._kept
        if knot is not None and len(motion.s) and motion.knots[0] != knot:
            raise MotionError(f"the pieces begin at {motion.knots[0]:.17g} s, and those before end at {knot:.17g} s")
        for first in range(0, len(motion.s), MAX_CHUNK_PIECES):
            last = min(first + MAX_CHUNK_PIECES, len(motion.s))
            self._chunks.add("motn" if stop else "MOTN", _encode(motion, first, last))
            pieces, knot = pieces + last - first, float(motion.knots[last])
        if stop:
            self._stop = pieces, knot
        else:
            self._kept = pieces, knot

    def mark(self, *, complete: bool = False) -> None:
        """What was added is whole, and the motion rests where it ends."""
        pieces, knot = self._stop or self._kept
        self._chunks.mark({"complete": complete, "duration": knot or 0.0, "pieces": pieces})
        self._stop = None


def write_motion(trajectory: Trajectory, path: Path) -> None:
    """Write a whole motion: the same floats are read back."""
    with path.open("wb") as file:
        writer = MotionWriter.begin(file)
        writer.add(trajectory)
        writer.mark(complete=True)


def motion_parts(path: Path, partial: bool = False) -> Iterator[tuple[Array, list[Array]]]:
    """Knots (n + 1,), and s, v, a, j and path piece (n,) of the pieces in a file, chunk by chunk.

    partial: also of one that is not finished, up to the stop that it holds. Raises FileError for a file that is none,
    of another version, cut or damaged.
    """
    held = open_chunks(path, KIND, SCHEMA, partial)
    pieces, end = 0, None
    for chunk, contents in held.contents():
        knots, rest = _decode(contents, chunk, path)
        if end is not None and knots[0] != end:
            raise _refusal(path, f"chunk {chunk.number} begins at {knots[0]} s, where the one before ends at {end} s")
        pieces, end = pieces + len(rest[0]), knots[-1]
        yield knots, rest
    if (pieces, end or 0.0) != (held.mark.get("pieces"), held.mark.get("duration")):
        raise _refusal(path, f"holds {pieces} pieces up to {end} s, and says otherwise")


def read_motion(path: Path, along: ActuatorPath, partial: bool = False) -> Trajectory:
    """The trajectory in a file, along its path. Raises FileError where it is damaged or belongs to another path."""
    held = list(motion_parts(path, partial))
    if not held:
        raise _refusal(path, "holds no motion")
    knots = np.concatenate([held[0][0], *(knots[1:] for knots, _ in held[1:])])
    s, v, a, j, piece = (np.concatenate([rest[k] for _, rest in held]) for k in range(len(PIECES)))
    if not np.isfinite(np.concatenate([knots, s, v, a, j])).all() or (np.diff(knots) < 0).any():
        raise FileError(str(path), [Fault("", "its pieces do not make a motion: plan it again")])
    if piece.min() < 0 or piece.max() >= len(along.breaks) - 1:
        raise FileError(str(path), [Fault("piece", "belongs to another path: plan it again")])
    return Trajectory(along, knots, s, v, a, j, piece)


def _encode(motion: Trajectory, first: int, last: int) -> bytes:
    """The contents of a chunk: the pieces from one to before another."""
    numbers = [motion.knots[first : last + 1], *(getattr(motion, name)[first:last] for name in PIECES[:4])]
    pieces = np.asarray(motion.piece[first:last], "<i8")
    words = np.frombuffer(np.concatenate(numbers).astype("<f8").tobytes() + pieces.tobytes(), np.uint8)
    return COUNT.pack(last - first) + compress(words.reshape(-1, 8).T.tobytes(), LEVEL)


def _decode(contents: bytes, chunk: Chunk, path: Path) -> tuple[Array, list[Array]]:
    """Knots, and s, v, a, j and piece."""
    try:
        (count,) = COUNT.unpack_from(contents)
        inflate, size = decompressobj(), 8 * (6 * count + 1)
        planes = inflate.decompress(contents[COUNT.size :], size)
        if not count or len(planes) != size or not inflate.eof or inflate.unused_data:
            raise ValueError(f"{count} pieces do not have {len(planes)} bytes")
    except (struct.error, ZlibError, ValueError) as error:
        where = f"chunk {chunk.number}, from byte {chunk.begin}"
        raise _refusal(path, f"{where}, holds no motion: {error}") from None
    words = np.ascontiguousarray(np.frombuffer(planes, np.uint8).reshape(8, -1).T).reshape(-1)
    numbers = words[: 8 * (5 * count + 1)].view("<f8").astype(float)
    piece = words[8 * (5 * count + 1) :].view("<i8").astype(int)
    return numbers[: count + 1], [*np.split(numbers[count + 1 :], 4), piece]


def _refusal(path: Path, message: str) -> FileError:
    return FileError(str(path), [Fault("", f"{message}: plan it again")])
