"""motion.bin: the closed-form pieces of a motion, exact to the last bit.

It is a file of `kinematics.files.chunk_file`:

    HEAD   JSON: kind "pulsepath motion", schema 1, and the unit of each array
    PART   JSON: the beginning of a part, if the motion was planned in parts: begin (s) and length
           (m) from the start of the whole; step: its first piece of the whole path, steps: their
           number; near: coordinates (m or rad) of the axes near which it begins. After it, time,
           path length and path pieces count from this beginning.
    MOTN   uint64 pieces n, at most 2¹⁴; deflated (zlib, RFC 1950): the bytes of 6n + 1 numbers,
           first the lowest byte of all, then the next, up to the eighth. The numbers are float64
           (little-endian): n + 1 knots, of which the first is the last of the chunk before, and n
           s, n v, n a, n j as in `Trajectory`; then int64: n indices of path pieces
    MARK   JSON: complete (true), duration (s), pieces (their number)

A motion that was planned as a whole has no PART.
"""

import json
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO
from zlib import compress, decompressobj
from zlib import error as ZlibError

import numpy as np

from kinematics import Fault, FileError, Machine, MotionError, Pose
from kinematics.files.chunk_file import (
    Chunk,
    ChunkFile,
    ChunkWriter,
    open_chunks,
    read_integer,
    read_number,
)
from kinematics.foundation.arrays import Array
from planner.certificate.continuity import piece_end_lengths
from planner.path.actuation import ActuatorPath, MachinePath
from planner.path.join_and_blend import PathStep, list_avoidable
from planner.trajectory import Trajectory

PIECES = ("s", "v", "a", "j", "piece")
"""Arrays of `Trajectory` with one entry per time piece; knots have one more."""
KIND = "pulsepath motion"
SCHEMA = 1
PART = "PART"
"""Kind of the chunks with the head of a part."""
MOTION = "MOTN"
"""Kind of the chunks with pieces."""
UNITS = {"knots": "s", "s": "m", "v": "m/s", "a": "m/s^2", "j": "m/s^3", "piece": ""}
MAX_CHUNK_PIECES = 1 << 14
"""Largest number of pieces in a chunk: it bounds the memory for writing and reading."""
COUNT = struct.Struct("<Q")
LEVEL = 1
"""zlib level. Higher levels save little, as most bytes of such numbers look random."""


@dataclass(frozen=True, slots=True)
class PartHead:
    """The beginning of a part of a motion.

    begin, length  s and m, from the start of the whole
    step, steps    its first piece of the whole path, from 0, and their number
    near           (n,) coordinates of the axes near which it begins; None: near home's
    """

    begin: float
    length: float
    step: int
    steps: int
    near: tuple[float, ...] | None = None


@dataclass(frozen=True, slots=True)
class PieceBatch:
    """Pieces of a motion: knots (n + 1,), and s, v, a, j and path piece (n,).

    head: of their part; None if the motion has no parts.
    """

    head: PartHead | None
    knots: Array
    columns: list[Array]


@dataclass(frozen=True, slots=True)
class _FileEnd:
    """End of a file that is written or read piece by piece.

    pieces  number of pieces before it
    head    of the current part
    knot    time (s) from the start of that part
    before  time (s) of the parts before it, exact
    """

    pieces: int = 0
    head: PartHead | None = None
    knot: float | None = None
    before: Fraction = Fraction(0)

    @property
    def duration(self) -> float:
        return float(self.before + Fraction(self.knot or 0.0))

    def begin(self, head: PartHead) -> "_FileEnd":
        """Return the end after the head of another part.

        Raises MotionError for a gap or an overlap in time.
        """
        if head.begin != self.duration:
            end = f"those before end at {self.duration:.17g} s"
            raise MotionError(f"the part begins at {head.begin:.17g} s, and {end}")
        return replace(self, head=head, knot=0.0, before=self.before + Fraction(self.knot or 0.0))


class MotionWriter:
    """Writes a file of a motion piece by piece."""

    __slots__ = ("_chunks", "_end")

    def __init__(self, file: BinaryIO) -> None:
        """Write the head of a file."""
        self._chunks = ChunkWriter(file, {"kind": KIND, "schema": SCHEMA, "units": UNITS})
        self._end = _FileEnd()

    def add(self, motion: Trajectory, head: PartHead | None = None) -> None:
        """Write the pieces that follow; head: of a part that they begin.

        Raises MotionError unless they begin when those before end.
        """
        if head is not None:
            self._end = self._end.begin(head)
            self._chunks.add(PART, json.dumps(asdict(head)).encode())
        knot = self._end.knot
        if knot is not None and len(motion.s) and motion.knots[0] != knot:
            end = f"those before end at {knot:.17g} s"
            raise MotionError(f"the pieces begin at {motion.knots[0]:.17g} s, and {end}")
        for first in range(0, len(motion.s), MAX_CHUNK_PIECES):
            last = min(first + MAX_CHUNK_PIECES, len(motion.s))
            self._chunks.add(MOTION, _encode(motion, first, last))
            pieces = self._end.pieces + last - first
            self._end = replace(self._end, pieces=pieces, knot=float(motion.knots[last]))

    def finish(self) -> None:
        """Complete the file: the motion rests where it ends."""
        self._chunks.finish({"duration": self._end.duration, "pieces": self._end.pieces})


def write_motion(trajectory: Trajectory, path: Path) -> None:
    """Write a whole motion: the same floats are read back."""
    with path.open("wb") as file:
        writer = MotionWriter(file)
        writer.add(trajectory)
        writer.finish()


def write_motion_json(trajectory: Trajectory, path: Path) -> None:
    """Write knots and pieces; Python's shortest decimals read back as the same floats."""
    arrays = {name: getattr(trajectory, name).tolist() for name in ("knots", *PIECES)}
    path.write_text(json.dumps(arrays) + "\n")


def motion_parts(path: Path) -> Iterator[PieceBatch]:
    """Read the pieces in a file, chunk by chunk.

    Raises FileError for another kind or version of file, and for one that is cut or damaged.
    """
    chunks = _open(path)
    end = _FileEnd()
    for chunk, contents in chunks.contents():
        if chunk.kind == PART:
            try:
                end = end.begin(_decode_head(contents, chunk, path))
            except MotionError as error:
                raise _refusal(path, f"chunk {chunk.number}: {error}") from None
            continue
        knots, columns = _decode(contents, chunk, path, _count_left(chunks, end))
        if end.knot is not None and knots[0] != end.knot:
            message = f"begins at {knots[0]} s, where the one before ends at {end.knot} s"
            raise _refusal(path, f"chunk {chunk.number} {message}")
        end = replace(end, pieces=end.pieces + len(columns[0]), knot=float(knots[-1]))
        yield PieceBatch(end.head, knots, columns)
    if (end.pieces, end.duration) != (chunks.mark.get("pieces"), chunks.mark.get("duration")):
        raise _refusal(
            path, f"holds {end.pieces} pieces up to {end.duration} s, and says otherwise"
        )


def read_duration(path: Path) -> float:
    """Return the duration (s) of the whole motion that the last chunk of a file states.

    Raises as `motion_parts`.
    """
    try:
        return read_number(_open(path).mark.get("duration"), 0.0)
    except ValueError as error:
        raise _refusal(path, f"states no duration: {error}") from None


def _open(path: Path) -> ChunkFile:
    return open_chunks(path, KIND, SCHEMA, (PART, MOTION))


def _count_left(chunks: ChunkFile, end: _FileEnd) -> int:
    """Return the number of the following pieces by the statement in the last chunk of a file."""
    pieces = chunks.mark.get("pieces")
    return pieces - end.pieces if type(pieces) is int else 0


def join_parts(parts: Iterable[PieceBatch]) -> Iterator[PieceBatch]:
    """Join the chunks of each part."""
    chunks: list[PieceBatch] = []
    for part in parts:
        if chunks and part.head != chunks[0].head:
            yield _join_chunks(chunks)
            chunks = []
        chunks.append(part)
    if chunks:
        yield _join_chunks(chunks)


def _join_chunks(chunks: list[PieceBatch]) -> PieceBatch:
    knots = np.concatenate([chunks[0].knots, *(chunk.knots[1:] for chunk in chunks[1:])])
    columns = zip(*(chunk.columns for chunk in chunks), strict=True)
    return PieceBatch(chunks[0].head, knots, [np.concatenate(each) for each in columns])


def read_motion(path: Path, along: ActuatorPath) -> Trajectory:
    """Read the trajectory in a file, along its whole path.

    Raises FileError if it is damaged or belongs to another path.
    """
    knots: list[Array] = []
    columns: list[list[Array]] = [[] for _ in PIECES]
    before = Fraction(0)  # s, exactly: the duration is what the file states, to the last bit
    for part in join_parts(motion_parts(path)):
        _check_numbers(part, path)
        begin = 0.0
        first = 0
        if part.head is not None:
            begin = part.head.begin
            # the nearest break: sums of lengths round differently
            first = int(np.abs(along.breaks - part.head.length).argmin())
        knots.append(begin + part.knots[:-1])
        before += Fraction(float(part.knots[-1]))
        end = float(before)
        shift = float(along.breaks[first]) if first else 0.0
        for column, values, by in zip(
            columns, part.columns, (shift, 0.0, 0.0, 0.0, first), strict=True
        ):
            column.append(values + by if by else values)
    if not knots:
        raise _refusal(path, "holds no motion")
    s, v, a, j, piece = (np.concatenate(column) for column in columns)
    _check_piece(piece, len(along.breaks) - 1, path)
    return Trajectory(along, np.append(np.concatenate(knots), end), s, v, a, j, piece)


def read_parts(
    path: Path, steps: Iterator[PathStep], machine: Machine, tool: Pose | None
) -> Trajectory:
    """Read the trajectory in a file that was planned in parts, along as much of the path as they
    cover.

    steps: of the whole path, from its start on. Raises as `read_motion`.
    """
    heads = [part.head for part in motion_parts(path) if part.head is not None]
    count = max((head.step + head.steps for head in heads), default=0)
    covered = list(islice(steps, count))
    if len(covered) < count or not covered:
        raise _other_path(path)
    along = _draw_path(
        machine,
        covered,
        tool,
        blends=[step.blend for step in covered if step.blend is not None],
        fits=[step.fitted for step in covered if step.fitted is not None],
        overshoots=[step.overshoot for step in covered if step.overshoot is not None],
        avoidable=list_avoidable(covered[:-1]),  # a motion that ends early ends at a join
    )
    return read_motion(path, along)


def _draw_path(
    machine: Machine, steps: Sequence[PathStep], tool: Pose | None, **of: Any
) -> MachinePath:
    """Return the path along steps, with rests at both ends; of: further fields of the path."""
    stops = np.array([1, *(step.stop for step in steps[:-1]), 1])
    dwells = np.array([steps[0].wait, *(step.dwell for step in steps)])
    return MachinePath(machine, [step.piece for step in steps], stops, dwells, tool=tool, **of)


# Largest jump from one part to the next. For rates: share of the largest rate; for coordinates:
# share of the distance at the largest speed in a second. A larger one would hide an edited file.
SEAM_JUMP = 1e-9
# Added to it: share of the value itself, for rounding.
SEAM_ROUNDING = 1e-12


def follow_motion(
    path: Path,
    steps: Iterator[PathStep],
    machine: Machine,
    tool: Pose | None,
    *,
    whole: bool = True,
) -> Iterator[Trajectory]:
    """Read the trajectory in a file part by part, each on its own path.

    Each part begins where the one before ended, at its speed, and the last ends with the path.

    whole: False for a plan that ends before its path does.
    steps: of the whole path, from its start on, as `planner.path.chain.walk_path` yields them.

    Raises as `read_motion`.
    """
    ahead = list[PathStep]()
    skipped = after = 0
    speed = acceleration = 0.0
    last: Trajectory | None = None
    parts = join_parts(motion_parts(path))
    following = next(parts, None)
    while following is not None:
        part = following
        following = next(parts, None)
        head = part.head
        _check_numbers(part, path)
        if head is None:
            ahead = list(steps)
            head = PartHead(0.0, 0.0, 0, len(ahead))
        # step of the path after the previous part; a stop continues on the path of that part
        first = after
        if head.step not in (skipped, first):
            raise _refusal(
                path,
                f"the part from {head.begin} s does not continue the path of the previous part",
            )
        del ahead[: head.step - skipped]
        if head.near is not None and len(head.near) != len(machine.axes):
            counts = f"{len(head.near)} coordinates, and the machine has {len(machine.axes)} axes"
            raise _refusal(path, f"the part from {head.begin} s begins near {counts}")
        skipped = head.step
        after = head.step + head.steps
        ahead += islice(steps, max(0, head.steps - len(ahead)))
        covered = ahead[: head.steps]
        if len(covered) < head.steps or not covered:
            raise _other_path(path)
        v = 0.0
        a = 0.0
        if following is not None:
            v = float(following.columns[1][0])
            a = float(following.columns[2][0])
        along = _draw_path(
            machine,
            covered,
            tool,
            end_speeds=(speed, v),
            end_accelerations=(acceleration, a),
            near=None if head.near is None else np.array(head.near),
            origin=(head.length, head.begin),
        )
        _check_piece(part.columns[-1], len(along.breaks) - 1, path)
        motion = Trajectory(along, part.knots - part.knots[0], *part.columns)
        start = 0.0
        if head.step != first and last is not None:
            start = float(piece_end_lengths(last)[-1])
        if abs(float(motion.s[0]) - start) > SEAM_JUMP * float(along.breaks[-1]):
            raise _refusal(
                path,
                f"the part from {head.begin} s does not continue the path of the previous part",
            )
        if last is not None:
            _check_seam(last, motion, path)
        yield motion
        speed = v
        acceleration = a
        last = motion
    if whole and (last is None or len(ahead) > after - skipped or next(steps, None) is not None):
        raise _refusal(path, "ends before the path of the program does")


def _check_seam(one: Trajectory, other: Trajectory, path: Path) -> None:
    """Raise FileError unless a part begins where the previous one ended, at the same speed of each
    axis.
    """
    end = one.within(np.array([len(one.s) - 1]), np.diff(one.knots)[-1:])
    start = other.within(np.array([0]), np.zeros(1))
    both = [each.within(np.arange(len(each.s)), np.zeros(len(each.s))) for each in (one, other)]
    continuous = [("q", "qd"), ("qd", "qd")]
    if one.j.any() or other.j.any():
        continuous.append(("qdd", "qdd"))
    for name, rate in continuous:
        before = getattr(end, name)[0]
        after = getattr(start, name)[0]
        most = max(float(np.abs(getattr(each, rate)).max()) for each in both)
        jump = np.abs(after - before) - SEAM_JUMP * most - SEAM_ROUNDING * np.abs(before)
        if not jump.max() <= 0:
            place = other.path.place(float(other.s[0]), int(other.piece[0]), 0.0)
            raise _refusal(path, f"jumps in {one.path.names[int(np.argmax(jump))]} at {place}")


def _check_numbers(part: PieceBatch, path: Path) -> None:
    if (
        not np.isfinite(np.concatenate([part.knots, *part.columns[:4]])).all()
        or (np.diff(part.knots) < 0).any()
    ):
        raise FileError(str(path), [Fault("", "its pieces do not make a motion: plan it again")])


def _check_piece(piece: Array, count: int, path: Path) -> None:
    if piece.min() < 0 or piece.max() >= count:
        raise _other_path(path)


def _other_path(path: Path) -> FileError:
    return FileError(str(path), [Fault("piece", "belongs to another path: plan it again")])


def _encode(motion: Trajectory, first: int, last: int) -> bytes:
    """Return the contents of a chunk: the pieces from `first` to before `last`."""
    numbers = [
        motion.knots[first : last + 1],
        *(getattr(motion, name)[first:last] for name in PIECES[:4]),
    ]
    pieces = np.asarray(motion.piece[first:last], "<i8")
    words = np.frombuffer(
        np.concatenate(numbers).astype("<f8").tobytes() + pieces.tobytes(), np.uint8
    )
    return COUNT.pack(last - first) + compress(words.reshape(-1, 8).T.tobytes(), LEVEL)


def _decode(contents: bytes, chunk: Chunk, path: Path, left: int) -> tuple[Array, list[Array]]:
    """Return knots, and s, v, a, j and piece.

    left: number of pieces from this chunk on, by the statement in the file.
    """
    try:
        (count,) = COUNT.unpack_from(contents)
        most = min(left, MAX_CHUNK_PIECES)
        if not 0 < count <= most:
            raise ValueError(f"it states {count} pieces, and there are 1 to {most}")
        inflate = decompressobj()
        size = 8 * (6 * count + 1)
        planes = inflate.decompress(contents[COUNT.size :], size)
        if len(planes) != size or not inflate.eof or inflate.unused_data:
            raise ValueError(f"{count} pieces do not have {len(planes)} bytes")
    except (struct.error, ZlibError, ValueError) as error:
        raise _chunk_error(path, chunk, error) from None
    words = np.ascontiguousarray(np.frombuffer(planes, np.uint8).reshape(8, -1).T).reshape(-1)
    numbers = words[: 8 * (5 * count + 1)].view("<f8").astype(float)
    piece = words[8 * (5 * count + 1) :].view("<i8").astype(int)
    if not np.isfinite(numbers).all():
        raise _chunk_error(
            path, chunk, ValueError("numbers that are not finite do not make a motion")
        )
    return numbers[: count + 1], [*np.split(numbers[count + 1 :], 4), piece]


def _decode_head(contents: bytes, chunk: Chunk, path: Path) -> PartHead:
    try:
        record = json.loads(contents)
        near = record["near"]
        return PartHead(
            read_number(record["begin"], 0.0),
            read_number(record["length"], 0.0),
            read_integer(record["step"], 0, MAX_STEPS),
            read_integer(record["steps"], 1, MAX_STEPS),
            None if near is None else tuple(read_number(value) for value in near),
        )
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise _chunk_error(path, chunk, error) from None


MAX_STEPS = 1 << 62
"""Largest number of pieces of a path: sums of two such numbers fit into an int64."""


def _chunk_error(path: Path, chunk: Chunk, error: Exception) -> FileError:
    where = f"chunk {chunk.number}, from byte {chunk.begin}"
    return _refusal(path, f"{where}, holds no motion: {error}")


def _refusal(path: Path, message: str) -> FileError:
    return FileError(str(path), [Fault("", f"{message}: plan it again")])
