"""Fitting: chains of short lines and arcs become smooth curves that stay within a tolerance of
them, proved.

A stream: pieces come in as they are drawn, and go out as curves, exact lines and arcs, and corners.
What is looked at at once is a window of some hundred pieces, so that work grows with the path and
memory does not.

A join between two pieces is a corner where the direction jumps by more than an angle, or by so much
that no curve through the middles of both stays within the tolerance: there the curve ends, and what
the program's join says of corners happens. Else it is smooth. A piece that is long beside what
smoothing its ends needs stays what it is, and gives its ends to the curves; these meet it with
three continuous derivatives. In between lies a quintic spline, near the chain in the least squares,
whose spans are halved where they leave it by too much; windows follow each other with four. What is
proved is `planner.path.closeness`.
"""

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from planner.path.closeness import Closeness, Track, bound_distance
from planner.path.shape import ARC, LINE, Drawn, Fitted, Piece, Shape, measure_turns
from planner.path.spline import SPLINE, STEADY_SPLINE, align_signs, smooth_spline
from planner.program.modifiers import Fit, Join, Through

# Pieces that are looked at at once, at first, at least and at most; and the spans that a window
# begins with.
WINDOW, WINDOWS, WINDOW_SPANS = 96, (48, 1536), 4
# Share of the tolerance that the spline is to leave unused, as its places are looked at, and what
# of it is tried next where the proof says that it was too much.
TARGET_SHARE, LESS, MAX_TRIES = 0.9, 0.85, 6
# Sagitta, as a multiple of the tolerance, from which two pieces meet at a corner, whatever the
# angle.
CORNER_SAGITTA = 1.5
# A piece is long from so many times what a smooth end takes of it; that is at most so many
# tolerances.
LONG, MAX_END = 4.0, 400.0
# Length of a curve, in tolerances, that a blend at a corner is kept to.
TAIL = 16.0
# Places of a piece at which a spline is held to it at least, and for each span.
PIECE_PLACES, SPAN_PLACES = 4, 8
# Spans of a window at most.
MAX_SPANS = 20_000
# Share of a piece that is none.
NOTHING = 1e-9


@dataclass(frozen=True, slots=True)
class _Joint:
    """Where two pieces meet: whether smoothly, and how much of either (m) a smooth passage
    takes.
    """

    smooth: bool
    reach: float = 0.0


CORNER = _Joint(False)


@dataclass(slots=True)
class _Unit:
    """Part of a chain that becomes a curve: its pieces, and the derivatives that the curve has at
    its start.

    start (m, 7) None: it begins at the place and orientation of its first piece, in any direction
    """

    tolerance: float
    angle: float
    links: list[Piece] = field(default_factory=list)
    start: Array | None = None
    window: int = WINDOW


def fit_chains(drawn: Iterable[Drawn], characteristic: float) -> Iterator[Drawn]:
    """The same path with curves instead of chains whose joins ask for a fit; what else there is as
    it comes.

    Joins at corners that remain ask for a fit still: there it is a blend within what is left of the
    tolerance. characteristic: m that count like a radian, the machine's characteristic length.
    """
    unit: _Unit | None = None
    before = CORNER
    for item, joint in _find_joints(drawn, characteristic):
        if not (before.smooth or joint.smooth):
            yield item
            before = joint
            continue
        (piece,) = item.pieces
        if unit is None:
            assert isinstance(item.join, Fit)
            unit = _Unit(item.join.tolerance, item.join.angle_at(characteristic))
        if _is_long(item, before, joint):
            if before.smooth:
                unit.links.append(piece.trim(0.0, piece.length - before.reach))
                yield from _close(unit, _derivatives(piece, piece.start + before.reach), Through())
            ends = before.reach, joint.reach
            join = Through() if joint.smooth else item.join
            yield replace(item, pieces=[piece.trim(*ends)], join=join)
            if joint.smooth:
                fresh = _Unit(unit.tolerance, unit.angle)
                fresh.links.append(piece.trim(piece.length - joint.reach, 0.0))
                fresh.start = _derivatives(fresh.links[0], fresh.links[0].start)
                unit = fresh
            else:
                unit = None
        else:
            unit.links.append(piece)
            if not joint.smooth:
                yield from _close(unit, None, item.join, item.dwell)
                unit = None
            elif len(unit.links) >= unit.window:
                yield from _advance(unit)
        before = joint


def _find_joints(drawn: Iterable[Drawn], characteristic: float) -> Iterator[tuple[Drawn, _Joint]]:
    """Each segment, and how it meets the next.

    Two that are long both meet in a blend, which then does as well; and so it is where the
    tolerance changes.
    """
    known = _pair_up(drawn, characteristic)
    before, held, join = CORNER, next(known, None), None
    while held is not None:
        item, joint = held
        held = next(known, None)
        if joint.smooth and held is not None:
            other, after = held
            long = _is_long(item, before, joint) and _is_long(other, joint, after)
            if long or (before.smooth and item.join != join):
                joint = CORNER
        yield item, joint
        join = item.join
        before = joint


def _pair_up(drawn: Iterable[Drawn], characteristic: float) -> Iterator[tuple[Drawn, _Joint]]:
    held: Drawn | None = None
    for item in drawn:
        if held is not None:
            yield held, _classify(held, item, characteristic)
        held = item
    if held is not None:
        yield held, CORNER


def _is_long(item: Drawn, before: _Joint, after: _Joint) -> bool:
    return item.pieces[0].length >= LONG * max(before.reach, after.reach)


def _classify(one: Drawn, other: Drawn, characteristic: float) -> _Joint:
    join = one.join
    if not (isinstance(join, Fit) and one.plain and other.plain and one.dwell == 0):
        return CORNER
    a, b = one.pieces[0], other.pieces[0]
    (out, bend), (into, bent) = _direction(a, a.start + a.length), _direction(b, b.start)
    weight = join.tolerance / join.angle_at(characteristic)
    size = np.concatenate([np.ones(3), np.full(9, weight / np.sqrt(2))])
    jump = (into - out) * size
    turn = 2 * np.arcsin(min(1.0, float(np.linalg.norm(jump[:3])) / 2))
    least, change = min(a.length, b.length), max(turn, float(np.linalg.norm(jump[3:])))
    if turn > join.corner or change * least / 8 > CORNER_SAGITTA * join.tolerance:
        return CORNER
    curvature = change / least + float(np.linalg.norm((bent - bend) * size))
    reach = MAX_END * join.tolerance
    if curvature > 0:
        reach = min(reach, float(np.sqrt(6 * join.tolerance / curvature)))
    return _Joint(True, reach)


def _direction(piece: Piece, s: float) -> tuple[Array, Array]:
    """First and second derivative (12,) of the pose."""
    if piece.shape is LINE and piece.parameters[-1] == 0:
        return np.concatenate([piece.parameters[3:6], np.zeros(9)]), np.zeros(12)
    _, x1, x2, _ = piece.derivatives(np.array([s]))
    return x1[0], x2[0]


def is_plain(pieces: Sequence[Piece]) -> bool:
    """Whether a segment's pieces may become part of a curve: one line or arc that moves, without a
    constant speed.
    """
    if len(pieces) != 1 or pieces[0].shape not in (LINE, ARC) or pieces[0].constant:
        return False
    return pieces[0].shape is ARC or bool(np.any(pieces[0].parameters[3:6]))


def _derivatives(piece: Piece, s: float) -> Array:
    """(4, 7) position and quaternion, and their first three derivatives, of a line or an arc at its
    own s.
    """
    from scipy.spatial.transform import Rotation

    x, x1, x2, x3 = (values[0] for values in piece.derivatives(np.array([s])))
    found = np.zeros((4, 7))
    found[:, :3] = x[:3], x1[:3], x2[:3], x3[:3]
    found[0, 3:] = Rotation.from_matrix(x[3:].reshape(3, 3)).as_quat()
    rate = piece.parameters[-1]
    half = (
        rate / 2 * piece.parameters[-4:-1]
    )  # both shapes turn steadily about an axis: q′ = q ∘ (half, 0)
    for k in range(1, 4):
        found[k, 3:] = _multiply(found[k - 1, 3:], half)
    return found


def _multiply(q: Array, v: Array) -> Array:
    """The quaternion q ∘ (v, 0), x y z w."""
    return np.append(q[3] * v + np.cross(q[:3], v), -q[:3] @ v)


def _close(unit: _Unit, end: Array | None, join: Join, dwell: float = 0.0) -> Iterator[Drawn]:
    """The rest of a chain, to its end: with given derivatives there, or at a corner."""
    if len(unit.links) > 2 * unit.window:
        yield from _advance(unit)
    spline = _fit(unit, end, 1, whole=True)
    yield from spline.emit(unit, join, dwell)


def _advance(unit: _Unit) -> Iterator[Drawn]:
    """The first half of a window, as soon as it has been read; the rest stays."""
    spline = _fit(unit, None, WINDOW_SPANS, whole=False)
    count = len(spline.knots) - 1
    low, high = WINDOWS
    if count <= WINDOW_SPANS:
        unit.window = min(2 * unit.window, high)
        if len(unit.links) < unit.window:
            return
    elif count > 8 * WINDOW_SPANS:
        unit.window = max(unit.window // 2, low)
    yield from spline.emit(unit, Through(), 0.0)
    unit.links[:] = spline.rest
    unit.start = spline.state


@dataclass(frozen=True, slots=True)
class _Spline:
    """Spans between knots (K+1,), and what is proved of them; whole, or as far as a window goes
    that has more.

    shape, parameters (K, size): of the spans
    rest, state: what of the chain is left, and (5, 7) derivatives with which the next one begins
    """

    knots: Array
    shape: Shape
    parameters: Array
    links: list[Piece]
    proved: Closeness
    rest: list[Piece]
    state: Array | None

    def emit(self, unit: _Unit, join: Join, dwell: float) -> Iterator[Drawn]:
        pieces = self._pieces(unit)
        proved, near = self.proved, TAIL * unit.tolerance
        head, tail = ((proved.s[:-1] < near), (proved.s[1:] > proved.s[-1] - near))
        close = [
            (float(proved.position[part].max()), float(proved.angle[part].max()))
            for part in (head, tail)
        ]
        worst = int(proved.position.argmax())
        s = float(proved.s[worst] + proved.s[worst + 1]) / 2
        link = int(
            np.clip(np.searchsorted(proved.places, s, side="right") - 1, 0, len(self.links) - 1)
        )
        found = unit.tolerance, unit.angle, len(self.links), len(pieces), *proved.worst
        told = Fitted(*found, head=close[0], tail=close[1], s=s, segment=self.links[link].segment)
        yield Drawn(pieces, join, dwell, fitted=told)

    def _pieces(self, unit: _Unit) -> list[Piece]:
        """Its spans, cut where caps change and a little before corners, each a part of the segment
        it is beside.
        """
        ends = self.proved.places[1:].tolist()
        keys = [_caps(link) for link in self.links]
        cuts = [ends[k - 1] for k in range(1, len(keys)) if keys[k] != keys[k - 1]]
        last = float(self.knots[-1])
        cuts += [] if self.state is not None else [last - TAIL * unit.tolerance]
        cuts += [TAIL * unit.tolerance] if unit.start is None else []
        least = NOTHING * last
        spans: list[Piece] = []
        for (knot, after), row in zip(pairwise(self.knots.tolist()), self.parameters, strict=True):
            inner = sorted({cut for cut in cuts if knot + least < cut < after - least})
            parameters = freeze_array(row)
            for low, high in pairwise([knot, *inner, after]):
                k = bisect_right(ends, (low + high) / 2)
                link = self.links[min(k, len(self.links) - 1)]
                spans.append(
                    replace(
                        link,
                        shape=self.shape,
                        parameters=parameters,
                        length=high - low,
                        start=low - knot,
                    ),
                )
        return measure_turns(spans)


def _caps(link: Piece) -> tuple[object, ...]:
    return (
        link.tool_speed,
        link.tool_acceleration,
        link.tool_jerk,
        link.angular_speed,
        link.repetition,
    )


def _fit(unit: _Unit, end: Array | None, spans: int, *, whole: bool) -> _Spline:
    """The spline along a unit's links, proved as far as it is used: all of it, or the first half of
    its spans.
    """
    track = Track(unit.links)
    start = _derivatives(unit.links[0], unit.links[0].start)[:1]
    origin = start[0] * np.array([1, 1, 1, 0, 0, 0, 0])
    first = start if unit.start is None else unit.start.copy()
    first[0] = first[0] - origin
    tail = unit.links[-1]
    last = _derivatives(tail, tail.start + tail.length)[:1] if end is None else end.copy()
    last[0] = last[0] - origin
    if not whole:
        last = last[:0]
    turning = any(link.parameters[-1] != 0 for link in unit.links)
    if not (turning or first[1:, 3:].any() or last[1:, 3:].any()):
        first, last = first[:, :3], last[:, :3]
    target, use = TARGET_SHARE, 0.0
    knots = np.linspace(0.0, track.breaks[-1], max(spans, len(first) + len(last) - 5) + 1)
    for _ in range(MAX_TRIES):
        knots, powers = _refine(track, knots, origin, (first, last), unit, target)
        powers[:, 0] += origin[: powers.shape[2]]
        found = _prove(unit, knots, powers, whole)
        use = max(
            worst / most
            for worst, most in zip(found.proved.worst, (unit.tolerance, unit.angle), strict=True)
        )
        if use <= 1:
            return found
        target *= LESS
        knots = _halve_open_spans(found, knots, unit)
    raise MotionError(
        f"no curve within {unit.tolerance * 1e3:g} mm was proved from segment {unit.links[0].segment} to "
        f"{unit.links[-1].segment}: the best one leaves the path by {use:.3f} of the tolerance; use a blend there"
    ).in_segment(unit.links[0].segment)


def _halve_open_spans(spline: _Spline, knots: Array, unit: _Unit) -> Array:
    """The knots, and the middles of the spans where the proof finds the curve too far from the
    chain.
    """
    proved = spline.proved
    far = (proved.position > unit.tolerance) | (proved.angle > unit.angle)
    span = np.unique(
        np.searchsorted(knots, (proved.s[:-1] + proved.s[1:])[far] / 2, side="right") - 1
    )
    return np.sort(np.concatenate([knots, (knots[:-1] + knots[1:])[span] / 2]))


def _refine(
    track: Track, knots: Array, origin: Array, ends: tuple[Array, Array], unit: _Unit, target: float
) -> tuple[Array, Array]:
    """Knots, halved until the spline between them is near the chain where that is looked at, and
    its coefficients.

    ends: (m, 7) values and derivatives there, of position and quaternion; (m, 3) where the chain
    does not turn
    """
    reach = unit.tolerance * target, unit.angle * target
    while True:
        s, link, weights = _sample(track, knots)
        x, x1, _, _ = track.derivatives(s, link)
        values = x[:, :3] - origin[:3]
        first, last = ends
        if first.shape[1] > 3:
            values = np.concatenate([values, _quaternions(x, first[0, 3:])], 1)
            if len(last):
                last = last.copy()
                last[:, 3:] *= np.sign(last[0, 3:] @ values[-1, 3:])
        powers = smooth_spline(knots, s, values, weights, (first, last))
        span = np.clip(np.searchsorted(knots, s, side="right") - 1, 0, len(powers) - 1)
        away = _evaluate(powers[span], s - knots[span]) - values
        along = x1[:, :3]
        across = away[:, :3] - (away[:, :3] * along).sum(1, keepdims=True) * along
        turned = 2 * np.linalg.norm(away[:, 3:], axis=1)
        use = np.maximum(np.linalg.norm(across, axis=1) / reach[0], turned / reach[1])
        worst = np.zeros(len(powers))
        np.maximum.at(worst, span, use)
        if not (worst > 1).any():
            return knots, powers
        if len(knots) > MAX_SPANS:
            raise MotionError(
                f"no curve stays within {unit.tolerance * 1e3:g} mm of segments {unit.links[0].segment} to "
                f"{unit.links[-1].segment}; use a larger tolerance, or a blend there"
            ).in_segment(unit.links[0].segment)
        middles = (knots[:-1] + knots[1:])[worst > 1] / 2
        knots = np.sort(np.concatenate([knots, middles]))


def _sample(track: Track, knots: Array) -> tuple[Array, np.ndarray, Array]:
    """Places s (N,) of a chain, the links (N,) that they are on, and the lengths (N,) that each
    stands for.

    As close as the narrowest span beside a link asks.
    """
    h = np.diff(knots)
    ends = np.clip(np.searchsorted(knots, track.breaks, side="right") - 1, 0, len(h) - 1)
    narrow = np.minimum(np.minimum.reduceat(h, ends[:-1]), h[ends[1:]])
    count = np.maximum(PIECE_PLACES, np.ceil(SPAN_PLACES * track.length / narrow)).astype(int)
    link = np.repeat(np.arange(len(count)), count)
    nth = np.arange(len(link)) - np.repeat(np.cumsum(count) - count, count)
    step = (track.length / count)[link]
    return track.breaks[link] + (nth + 0.5) * step, link, step


def _quaternions(x: Array, first: Array) -> Array:
    """(N, 4) of poses (N, 12), each on the side of the one before it, the first on that of a given
    one.
    """
    rows = x[:, 3:]
    if (rows == rows[0]).all():
        return np.tile(first, (len(rows), 1))
    from scipy.spatial.transform import Rotation

    found = Rotation.from_matrix(rows.reshape(-1, 3, 3)).as_quat()
    return align_signs(np.concatenate([first[None], found]))[1:]


def _evaluate(powers: Array, s: Array) -> Array:
    value = powers[:, -1]
    for k in reversed(range(powers.shape[1] - 1)):
        value = value * s[:, None] + powers[:, k]
    return value


def _prove(unit: _Unit, knots: Array, powers: Array, whole: bool) -> _Spline:
    count = len(powers) if whole else len(powers) // 2
    shape, parameters = SPLINE, powers[:count].reshape(count, -1)
    begin = unit.links[0]
    if powers.shape[2] == 3:
        rotation = begin.poses(np.array([begin.start]))[:, 3:]
        shape, parameters = (
            STEADY_SPLINE,
            np.hstack([parameters, np.repeat(rotation, count, axis=0)]),
        )
    pieces = [
        Piece(shape, freeze_array(row), float(h), 0)
        for row, h in zip(parameters, np.diff(knots)[:count], strict=True)
    ]
    links, rest, state = unit.links, [], None
    if not whole:
        track = Track(links)
        state = np.zeros((5, 7))
        state[0, 3:] = _derivatives(begin, begin.start)[0, 3:]
        state[:, : powers.shape[2]] = powers[count, :5] * np.array([1.0, 1, 2, 6, 24])[:, None]
        k = int(track.find_piece(knots[count : count + 1])[0])
        # the link on which the chain comes nearest, among its neighbours
        around = np.arange(max(k - 1, 0), min(k + 2, len(links)))
        x = np.tile(state[0, :3], (len(around), 1))
        low, high = track.breaks[around], track.breaks[around + 1]
        u = track.nearest(
            x, np.clip(np.full(len(around), knots[count]), low, high), around, low, high
        )
        away = np.linalg.norm(track.positions(u, around)[0] - x, axis=1)
        best = int(np.argmin(away))
        k, done = int(around[best]), float(u[best] - low[best])
        links, rest = [*unit.links[:k]], [*unit.links[k + 1 :]]
        whole_link = unit.links[k]
        if done > NOTHING * whole_link.length:
            links.append(whole_link.trim(0.0, max(whole_link.length - done, 0.0)))
        if whole_link.length - done > NOTHING * whole_link.length:
            rest.insert(0, whole_link.trim(done, 0.0))
    proved = bound_distance(pieces, links, unit.tolerance, unit.angle)
    return _Spline(knots[: count + 1], shape, parameters, links, proved, rest, state)
