"""Joins: what becomes of the places where segments meet: stops, smooth passages and blends that never overlap."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array, frozen
from kinematics.table import Column, Table
from planner.path.blend import LOWEST, rounded
from planner.path.shape import Piece
from planner.program import Blend, Join, Stop

# A jump of a derivative of the pose that is rounding, as a share of its size: a tenth of what the certificate allows.
ROUNDING = 1e-10
ALWAYS, NEVER = 1, 0
# The least that a blend may reach, as a share of the machine's characteristic length: its curvature goes with 1/reach,
# and below so much the rounding of coordinates leaves no proof of an acceleration within the certificate's tolerance.
# It is some 0.1 µm, far less than a pulse of the machines at hand.
SMALLEST = 1e-6
# Share by which two lengths may differ and be the same: rounding.
SAME_LENGTH = 1e-12


@dataclass(frozen=True, slots=True)
class Blended:
    """What a join that asks for a blend became.

    segment     number of the one before it; the blend leads to the next that moves
    tolerance   m, and angle (rad): what it may leave the unblended path by
    deviation   m, and turned (rad): by how much it does, at most (see planner.path.blend)
    reach       m of each segment that it takes the place of
    half_of     the segments of which it takes half, or all that can be had, though the tolerance would allow more
    stop        why the motion rests there instead, or ""
    """

    segment: int
    tolerance: float
    angle: float
    deviation: float = 0.0
    turned: float = 0.0
    reach: float = 0.0
    half_of: tuple[int, ...] = ()
    stop: str = ""

    @property
    def used(self) -> float:
        """The share of the tolerance that it uses."""
        return max(self.deviation / self.tolerance, self.turned / self.angle)


def blend_tables(blends: "Sequence[Blended]") -> tuple[Table, ...]:
    """How far each blend leaves the corner, and what it could not have; no table where there is none."""
    if not blends:
        return ()
    figures = (
        ("tolerance", [blend.tolerance for blend in blends], "m", "micro"),
        ("deviation", [None if blend.stop else blend.deviation for blend in blends], "m", "micro"),
        ("angle", [None if blend.stop else blend.turned for blend in blends], "rad", "micro"),
        ("reach", [None if blend.stop else blend.reach for blend in blends], "m", "human"),
    )
    columns = (Column(name, values, unit, scale, ".4g") for name, values, unit, scale in figures)  # type: ignore[arg-type]
    after = Column("after segment", [blend.segment for blend in blends])
    return (Table("blends", (after, *columns, Column("note", [_note(blend) for blend in blends]))),)


def _note(blend: Blended) -> str:
    if blend.stop:
        return f"stops: {blend.stop}"
    return f"half of segment {' and '.join(map(str, blend.half_of))}" if blend.half_of else ""


def join(
    segments: Sequence[Sequence[Piece]], joins: Sequence[Join], dwells: Array, characteristic: float
) -> tuple[tuple[Piece, ...], np.ndarray, Array, tuple[Blended, ...]]:
    """Pieces of the whole path, stops (P+1,) and dwells (P+1,) s at their ends as MachinePath has them, and the blends.

    segments  the pieces of each, smooth inside;  joins  at their ends;  dwells (S+1,) s at the ends of segments
    characteristic  m that count like a radian: the machine's characteristic length
    """
    pieces: list[Piece] = []
    stops, rests, blends = [ALWAYS], [float(dwells[0])], list[Blended]()
    before = 0.0
    for n, own in enumerate(segments):
        last = n == len(segments) - 1
        rest, made = ALWAYS, list[Piece]()
        if not (last or isinstance(joins[n], Stop)):
            rest = _rest(own[-1], segments[n + 1][0], dwells[n + 1], characteristic)
            asked = joins[n]
            if isinstance(asked, Blend) and rest != NEVER:
                made, told = _blend(own, segments[n + 1], asked, dwells[n + 1], characteristic)
                blends.append(told)
                rest = NEVER if made else ALWAYS
        reach = made[0].length if made else 0.0
        pieces += [*_kept(own, before, reach), *made]
        inner = len(pieces) - len(stops)
        stops += [NEVER] * inner + [rest]
        rests += [0.0] * inner + [float(dwells[n + 1])]
        before = reach
    return tuple(pieces), frozen(stops), frozen(rests), tuple(blends)


def _rest(a: Piece, b: Piece, dwell: float, characteristic: float) -> int:
    """The order of motion from which it has to rest between two pieces: that of the first derivative that jumps, + 1.

    Orientation counts in metres, and curvatures against that of the machine's own size.
    """
    if dwell > 0:
        return ALWAYS
    size = np.concatenate([np.ones(3), np.full(9, characteristic / np.sqrt(2))])
    ends = zip(a.derivatives(np.array([a.start + a.length])), b.derivatives(np.array([b.start])), strict=True)
    for order, (left, right) in enumerate(ends):
        least = characteristic ** (1 - order)
        if np.abs((left - right) * size).max() > ROUNDING * max(
            least, *np.abs(np.stack([left, right]) * size).max((1, 2))
        ):
            return order + 1
    return NEVER


def _blend(
    before: Sequence[Piece], after: Sequence[Piece], asked: Blend, dwell: float, characteristic: float
) -> tuple[list[Piece], Blended]:
    """The pieces of the blend of two segments, none where there can be none, and what to say of it."""
    a, b = before[-1], after[0]
    angle = asked.tolerance / characteristic if asked.angle is None else asked.angle
    told = Blended(a.segment, asked.tolerance, angle)
    if dwell > 0:
        return [], replace(told, stop="a dwell")
    most = {part.segment: _half(own, part) for own, part in ((before, a), (after, b))}
    made = rounded(a, b, min(most.values()), asked.tolerance, angle)
    if made is None:
        return [], replace(told, stop="it turns back")
    if made.reach < SMALLEST * characteristic:
        return [], replace(told, stop=f"it would reach {made.reach * 1e6:.2g} um, too little beside rounding")
    told = replace(told, deviation=made.deviation, turned=made.turned, reach=made.reach)
    if told.used < LOWEST:
        told = replace(told, half_of=tuple(n for n, length in most.items() if length <= made.reach * (1 + SAME_LENGTH)))
    return list(made.halves), told


def _half(own: Sequence[Piece], end: Piece) -> float:
    """What a blend may take of a segment at one of its ends: half of it, and not more than its piece there (m)."""
    half = sum(piece.length for piece in own) / 2
    return min(half, end.length / 2 if len(own) == 1 else end.length)


def _kept(own: Sequence[Piece], before: float, after: float) -> list[Piece]:
    """A segment's pieces without the lengths that blends take of the first and the last."""
    if len(own) == 1:
        kept = [own[0].trimmed(before, after)]
    else:
        kept = [own[0].trimmed(before, 0.0), *own[1:-1], own[-1].trimmed(0.0, after)]
    return [piece for piece in kept if piece.length > 0]
