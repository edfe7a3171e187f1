"""Where a program leads the tool, without a machine: its polylines, extents and length."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.machine.pose import IDENTITY, from_numbers, join_pose
from planner.path.arc_length import measure_length
from planner.path.curve import curve
from planner.path.shape import Piece
from planner.path.spline import sample_splines
from planner.program.model import (
    Arc,
    Curve,
    Line,
    Program,
    Segment,
    SegmentStream,
    Spline,
    Synchronised,
)

ARC_STEP = pi / 48
"""rad between two points of an arc: the chord is off by 5e-4 of the radius."""
PIECE_POINTS, SPAN_POINTS = 33, 9
"""Points of a piece of a curve, and of a span of a spline that has MANY spans or more."""
MANY_SPANS = 8
PARTS, LENGTH_AGREEMENT = 8, 1e-10
"""Parts of a span of a spline where its length in one part is not known to that share of it."""
MOST_STROKES = 20_000
"""Strokes of the outline of a stream. More take minutes to draw, and none of them can be seen."""
SPAN_BATCH = 4096
"""Spans of splines that are worked out at once."""
_PLACES, _WEIGHTS = zip(*(np.polynomial.legendre.leggauss(count) for count in (8, 16)), strict=True)


@dataclass(frozen=True, slots=True)
class Outline:
    """The tool's way in the program's coordinates, m.

    strokes  the points (N, 3) of each segment that moves the tool, the first where the one before
             it ends; of a long stream those of several segments
    low, high  (3,) corners of the box around all of it: of lines, arcs and helices exact, of curves
               that of the points
    length   m of the way: of curves by quadrature
    """

    strokes: tuple[Array, ...]
    low: Array
    high: Array
    length: float


def outline(program: Program) -> Outline:
    """Return one run of the program's segments, from its start.

    A program without a start begins where the first line ends, or else at the origin.
    """
    outliner = Outliner(program)
    for segment in program.segments:
        outliner.add(segment)
    return outliner.finish()


class Outliner:
    """An outline that is made segment by segment.

    Of a stream that is longer than MOST_STROKES, neighbouring segments share a stroke.
    """

    def __init__(self, program: Program) -> None:
        self._here = _start(program)
        self._strokes: list[Array] = []
        self._length = 0.0
        self._splines: dict[int, list[tuple[int, Array]]] = defaultdict(list)
        stream = isinstance(program.segments, SegmentStream)
        self._share = ceil(len(program.segments) / MOST_STROKES) if stream else 1
        self._shared: list[Array] = []

    def follow(self, segments: Iterable[Segment]) -> Iterator[Segment]:
        """Yield segments, and add each of them on its way."""
        for segment in segments:
            self.add(segment)
            yield segment

    def add(self, segment: Segment) -> None:
        """Add the next segment."""
        stroke, length = _stroke(segment, self._here)
        if stroke is None:
            return
        self._here = stroke[-1]
        self._length += length
        if isinstance(segment, Spline):
            self._close()
            self._splines[len(stroke)].append((len(self._strokes), stroke))
            self._strokes.append(stroke)
            return
        self._shared.append(stroke)
        if len(self._shared) >= self._share:
            self._close()

    def _close(self) -> None:
        """Make one stroke of the segments that share one."""
        if self._shared:
            first, *others = self._shared
            self._strokes.append(
                np.concatenate([first, *(stroke[1:] for stroke in others)]) if others else first
            )
            self._shared = []

    def finish(self) -> Outline:
        """Return the outline of all segments."""
        self._close()
        strokes = self._strokes
        low, high = self._here.copy(), self._here.copy()
        for same in self._splines.values():
            each = max(1, SPAN_BATCH // len(same[0][1]))
            for begin in range(0, len(same), each):
                numbers, corners = zip(*same[begin : begin + each], strict=True)
                points, length = _splines(np.stack(corners))
                self._length += length
                for number, drawn in zip(numbers, points, strict=True):
                    strokes[number] = drawn
        if strokes:
            every = np.concatenate(strokes)
            low, high = np.minimum(low, every.min(0)), np.maximum(high, every.max(0))
        return Outline(
            tuple(map(freeze_array, strokes)), freeze_array(low), freeze_array(high), self._length
        )


def _start(program: Program) -> Array:
    """Programs in the base frame that state no start begin where the machine stands, which is not
    known here.
    """
    if program.start is not None:
        return np.array(program.start.translation)
    first = program.segments[0]
    if program.frame == "base":
        return np.array(first.to) if isinstance(first, Line | Synchronised) else np.zeros(3)
    start = np.zeros(3) if program.tool is None else program.tool.translation
    return np.array(start if program.work is None else program.work.inv().apply(start))


def _stroke(segment: Segment, here: Array) -> tuple[Array | None, float]:
    match segment:
        case Line() | Synchronised():  # where that leads between its ends is the machine's affair
            return np.stack([here, segment.to]), float(np.linalg.norm(segment.to - here))
        case Arc():
            return _arc(segment, here)
        case Spline():  # its corners, until all of as many are worked out
            return np.concatenate([here[None], segment.through]), 0.0
        case Curve():
            frame = from_numbers(IDENTITY)
            pieces = curve(join_pose(here, frame.rotation), segment, frame, 0)
            s = [piece.length * np.linspace(0, 1, PIECE_POINTS) for piece in pieces]
            points = np.concatenate(
                [piece.poses(own)[:, :3] for piece, own in zip(pieces, s, strict=True)]
            )
            return points, sum(_length(piece) for piece in pieces)
        case _:
            return None, 0.0


def _splines(corners: Array) -> tuple[Array, float]:
    """Points (L, k, 3) of L splines through as many points (L, N+1, 3) each, and the length of them
    all.

    By Gauss and Legendre, in one part of every span where 8 places say what 16 do, else in PARTS.
    """
    spans = np.linalg.norm(np.diff(corners, axis=1), axis=2)
    points = PIECE_POINTS if spans.shape[1] < MANY_SPANS else SPAN_POINTS
    shares = np.concatenate([np.linspace(0, 1, points), *((places + 1) / 2 for places in _PLACES)])
    drawn, slopes = sample_splines(corners, shares)
    speed = np.linalg.norm(slopes[:, :, points:], axis=3)
    coarse, fine = speed[..., :8] @ _WEIGHTS[0] / 2, speed[..., 8:] @ _WEIGHTS[1] / 2
    rough = (abs(fine - coarse) > LENGTH_AGREEMENT * fine).any(1)
    if rough.any():
        places = ((np.arange(PARTS)[:, None] + (_PLACES[1] + 1) / 2) / PARTS).ravel()
        speed = np.linalg.norm(sample_splines(corners[rough], places)[1], axis=3)
        fine[rough] = speed @ np.tile(_WEIGHTS[1] / 2 / PARTS, PARTS)
    return drawn[:, :, :points].reshape(len(corners), -1, 3), float((spans * fine).sum())


def _length(piece: Piece) -> float:
    return measure_length(
        lambda s: np.linalg.norm(piece.derivatives(s)[1][:, :3], axis=1), 0.0, piece.length
    ).length


def _arc(arc: Arc, here: Array) -> tuple[Array, float]:
    """Points of a helix, among them the farthest along each axis."""
    u = here - arc.centre
    v = np.cross(arc.normal, u)
    low, high = min(0.0, arc.angle), max(0.0, arc.angle)
    # p_i is stationary where −u_i sin + v_i cos + rise n_i/angle = 0
    rise = arc.rise / arc.angle * arc.normal
    size, phase = np.hypot(u, v), np.arctan2(v, u)
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = np.arcsin(rise / size)
    turns = 2 * pi * np.arange(np.floor(low / (2 * pi)) - 1, np.ceil(high / (2 * pi)) + 2)
    extreme = np.concatenate([phase + lean, phase + pi - lean])[:, None] + turns
    extreme = extreme[(low < extreme) & (extreme < high)]  # what is not a number is not taken
    even = np.linspace(0.0, arc.angle, ceil(abs(arc.angle) / ARC_STEP) + 1)
    angle = np.unique(np.concatenate([even, extreme]))
    angle = angle if arc.angle > 0 else angle[::-1]
    points = (
        arc.centre + np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v + angle[:, None] * rise
    )
    return points, float(np.hypot(np.linalg.norm(u) * arc.angle, arc.rise))
