"""Axis values as a piecewise polynomial: a path without a machine.

For timing it is drawn anew: cut where it stands, and straight stretches by their way. What the axes
pass is the same,
and `PolynomialPath.parameter` tells the given parameter of every place. A stretch that is straight
in the axes, q = q₀
+ g(s) d with rising g, may be timed as q = q₀ + σ d: its fastest motion is known in closed form,
and neither where g′ =
0 nor where g bends does anything happen in space. Elsewhere the path keeps its parameter, and rests
where it stands
(planner.path.stands): at order 2 that costs nothing, as no motion along a parameter has a speed
there. At order 3 a
motion that passes such a place has an acceleration there, q̈ = q″ ṡ², and a rest has none: either
may be the faster, so
both are given.
"""

from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.kernels import (
    FixedFloats3,
    FixedInts1,
    Floats1,
    Floats3,
    call_light,
    kernel,
)
from kinematics.foundation.taylor_model import Series
from planner.path.actuation import Derivatives
from planner.path.rounding import bound_rounding
from planner.path.stands import count_zero_derivatives, cut_at_slow_places, cut_at_stands
from planner.place import Place

# A jump of a derivative at a break up to this share of its axis' largest value is rounding, or of
# any axis' largest.
MAX_JUMP, VALUE_ROUNDING = 1e-9, 1e-13
# Halvings that find a parameter: to rounding.
BISECTIONS_OF_PARAMETER = 54
# Places that are evaluated without loading the compiler.
FEW_PLACES = 8


class PolynomialPath:
    """Axis values given as a piecewise polynomial of any parameter: a path without a machine."""

    def __init__(
        self,
        breaks: Array,
        coefficients: Array,
        names: Sequence[str],
        end_speeds: tuple[float, float] = (0.0, 0.0),
        *,
        rests: np.ndarray | None = None,
        lines: np.ndarray | None = None,
        origin: "PolynomialPath | None" = None,
    ) -> None:
        """coefficients (degree+1, P, n), the highest power of s − breaks[p] first, as SciPy has
        them.

        rests   (P+1,) further places at which a motion rests: where the path stands
        lines   (P,) pieces that are straight, and drawn by their way
        origin  the path as it was given, of which such pieces are drawn
        """
        self.breaks, self.names, self.end_speeds = freeze_array(breaks), tuple(names), end_speeds
        self.coefficients: Array = freeze_array(coefficients)
        self.dwells: Array = freeze_array(np.zeros(len(breaks)))
        self.tool, self.end_accelerations = None, (0.0, 0.0)
        self.origin = self if origin is None else origin
        self.rests = freeze_array(np.zeros(len(breaks), bool) if rests is None else rests)
        self.lines = freeze_array(np.zeros(len(breaks) - 1, bool) if lines is None else lines)
        self.turns: Array = freeze_array(
            np.zeros(len(breaks) - 1)
        )  # a piece of low degree bends little

    @cached_property
    def rounding(self) -> Array:
        """(3, P, n) of q, q′ and q″ at the ends of each piece: see `bound_rounding`."""
        return freeze_array(bound_rounding(self.breaks, self.coefficients))

    def stops(self, order: int) -> np.ndarray:
        """Return where a motion rests: at corners (q′ jumps), under jerk limits also where q″
        jumps.
        """
        inner = np.arange(1, len(self.breaks) - 1)
        left, right = (
            self.derivatives(self.breaks[inner], inner - 1),
            self.derivatives(self.breaks[inner], inner),
        )
        stops = np.ones(len(self.breaks), bool)
        stops[inner] = self.rests[inner]
        still = count_zero_derivatives(self)
        turning = (still[1, :-1] > 0) & (still[0, 1:] > 0)  # there q′ is nothing but rounding
        size = np.maximum(np.abs(left[1]), np.abs(right[1]))
        most = np.maximum(size.max(0, initial=0.0), np.finfo(float).tiny)
        # where the parameter is slow, ṡ is large: q̇ = q′ ṡ jumps by as much more, and q″ ṡ² by the
        # square
        slow = np.where(turning[:, None], 1.0, (size / most).max(1, keepdims=True, initial=0.0))
        for k in range(1, order):
            gap, size = (
                np.abs(left[k] - right[k]),
                np.maximum(np.abs(left[k]), np.abs(right[k])).max(0, initial=0.0),
            )
            rounding = np.maximum(self.rounding[k, inner - 1], self.rounding[k, inner])
            jumps = (
                gap > MAX_JUMP * size * slow**k + VALUE_ROUNDING * size.max(initial=0.0) + rounding
            ).any(1)
            stops[inner] |= jumps & ~turning if k == 1 else jumps
        return stops

    def parameter(self, s: Array, piece: np.ndarray) -> Array:
        """The parameter of the path as it was given: s itself, but on pieces that are drawn by
        their way.
        """
        found = np.array(s, float)
        drawn = np.flatnonzero(self.lines[piece])
        if not len(drawn):
            return found
        own = piece[drawn]
        way, there = self.coefficients[-2, own], self.derivatives(found[drawn], own, 0)[0]
        axis = np.abs(way).argmax(1)[:, None]
        rising, target = (
            np.sign(np.take_along_axis(way, axis, 1)),
            np.take_along_axis(there, axis, 1),
        )
        low, high = self.breaks[own], self.breaks[own + 1]
        given = self.origin
        for _ in range(BISECTIONS_OF_PARAMETER):
            middle = (low + high) / 2
            at = np.clip(
                np.searchsorted(given.breaks, middle, side="right") - 1, 0, len(given.breaks) - 2
            )
            value = np.take_along_axis(given.derivatives(middle, at, 0)[0], axis, 1)
            early = (rising * (value - target))[:, 0] < 0
            low, high = np.where(early, middle, low), np.where(early, high, middle)
        start, end = self.breaks[own], self.breaks[own + 1]
        near = MAX_JUMP * (end - start)  # of an end, where the given path may stand: rounding
        at_ends = np.where(
            found[drawn] - start < near, start, np.where(end - found[drawn] < near, end, high)
        )
        found[drawn] = at_ends
        return found

    @property
    def content(self) -> Hashable:
        return (
            self.breaks.tobytes(),
            self.coefficients.shape,
            self.coefficients.tobytes(),
            self.names,
        )

    def constant(self, piece: int) -> None:
        return None

    def segment(self, piece: int) -> None:
        return None

    def place(self, s: float, piece: int, t: float | None = None, axis: str = "") -> Place:
        parameter = self.parameter(np.array([s]), np.array([piece]))
        return Place(float(parameter[0]), None, None if t is None else float(t), axis)

    def derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives:
        return self._evaluate(0, self.coefficients.shape[2], s, piece, highest)

    def axis_derivatives(
        self, axis: int, s: Array, piece: np.ndarray, highest: int = 3
    ) -> Derivatives:
        return self._evaluate(axis, 1, s, piece, highest)

    def _evaluate(
        self, axis: int, count: int, s: Array, piece: np.ndarray, highest: int
    ) -> Derivatives:
        found = np.zeros((4, len(s), count))
        given = self.coefficients, axis, s - self.breaks[piece], piece, found
        if len(s) <= FEW_PLACES:
            call_light(evaluate_polynomials, *given)
        else:
            evaluate_polynomials(*given)
        return tuple(found[: highest + 1])

    def pose_numbers(self, s: Array, piece: np.ndarray) -> None:
        return None

    def pose_derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> None:
        return None

    def enclose_pose(self, s: Series, piece: np.ndarray) -> None:
        return None

    def enclose(self, s: Series, piece: np.ndarray) -> Series:
        x = (s - self.breaks[piece])[None]
        # cells last, which numpy's loops run along
        first, *rest = np.ascontiguousarray(self.coefficients[:, piece].transpose(0, 2, 1))
        q = Series.constant(first, s.order)
        for c in rest:
            q = q * x + c
        return Series(q.mid.transpose(0, 2, 1), q.rad.transpose(0, 2, 1), q.order)


@kernel
def evaluate_polynomials(
    coefficients: FixedFloats3, axis: int, x: Floats1, piece: FixedInts1, found: Floats3
) -> None:
    """Fill found (4, N, m), zeros so far: the values of m axes from `axis` on, and their first
    three derivatives.

    coefficients (d + 1, P, n), the highest power first, of which piece (N,) and x (N,) from its
    start: Horner's scheme.
    """
    for k in range(len(x)):
        for c in range(found.shape[2]):
            q = q1 = half_q2 = sixth_q3 = 0.0
            for i in range(len(coefficients)):
                sixth_q3 = sixth_q3 * x[k] + half_q2
                half_q2 = half_q2 * x[k] + q1
                q1 = q1 * x[k] + q
                q = q * x[k] + coefficients[i, piece[k], axis + c]
            found[0, k, c], found[1, k, c], found[2, k, c], found[3, k, c] = (
                q,
                q1,
                2 * half_q2,
                6 * sixth_q3,
            )


# Share of an axis' extent by which a stretch may leave its chord and be straight, and of its
# values: rounding.
STRAIGHTNESS_SHARE, COEFFICIENT_ROUNDING = 1e-12, 4e-16


@dataclass(frozen=True, slots=True)
class PathSection:
    """Pieces between two places at which every motion rests: resting inside where the path stands,
    or passing that.

    passing: ways of passing some of these places, or all; none where nothing is to be passed
    """

    resting: PolynomialPath
    passing: tuple[PolynomialPath, ...]


def cut_sections(path: PolynomialPath, order: int) -> list[PathSection]:
    """The path in sections, one after the other, drawn for a motion of an order."""
    cut = cut_at_stands(path.breaks, path.coefficients)
    if order == 2:
        cut = cut_at_slow_places(*cut, SLOW_SHARE)
    drawn = PolynomialPath(*cut, path.names, path.end_speeds, origin=path)
    still = count_zero_derivatives(drawn)
    both = np.concatenate([[0], np.minimum(still[1, :-1], still[0, 1:]), [0]])
    corner = drawn.stops(order)
    ends = corner.copy()
    ends[1:-1] |= (still[1, :-1] > 0) | (still[0, 1:] > 0)
    stretches = [*_find_stretches(drawn, ends)]
    inner = {k for first, last in stretches for k in range(first + 1, last)}
    corners = [k for k in np.flatnonzero(corner).tolist() if k not in inner]
    found = []
    for first, last in pairwise(corners):
        own = [(a, b) for a, b in stretches if first <= a and b <= last]
        covered = {k for a, b in own for k in range(a, b)}
        parts = sorted([*own, *((k, k + 1) for k in range(first, last) if k not in covered)])
        resting = _draw_path(drawn, parts, {a for a, b in own}, both > 0)
        turns = [k for k in range(first + 1, last) if both[k] == 1 and k not in inner]
        passing = []
        if order == 3 and last - first <= MOST_PIECES:
            numbers = (
                [len(turns)]
                if turns and (last - first <= FEW_PIECES or len(turns) <= MOST_PASSED)
                else []
            )
            numbers += [MOST_PASSED] if len(turns) > MOST_PASSED else []
            passing = [
                _draw_passing(drawn, (first, last), own, both, turns, count) for count in numbers
            ]
        slow = _find_slow_places(drawn, first, last) if order == 2 else []
        if slow:
            passing.append(
                _draw_path(
                    drawn,
                    parts,
                    {a for a, b in own},
                    (both > 0) | np.isin(np.arange(len(both)), slow),
                )
            )
        found.append(PathSection(resting, tuple(passing)))
    return found


# Turns that a motion passes in a section of more than FEW_PIECES pieces: those between the longest
# ways. It rests at the others, which costs little. Recorded samples with a pause have dozens of
# turns, each a quarter of the one before; passing them all takes the solver minutes.
MOST_PASSED, FEW_PIECES = 6, 100
# Pieces of a section above which no passing is tried: it takes minutes and gains little.
MOST_PIECES = 300
# Share of the largest q′ of a section below which a rest is tried: no grid resolves ṡ there.
SLOW_SHARE = 1e-6


def _find_slow_places(path: PolynomialPath, first: int, last: int) -> list[int]:
    """Find breaks inside a section at which q′ is almost 0, and less than at the breaks on both
    sides.
    """
    inner = np.arange(first, last + 1)
    size = np.abs(path.derivatives(path.breaks[inner], np.minimum(inner, last - 1), 1)[1]).max(1)
    least = (
        (size[1:-1] <= size[:-2])
        & (size[1:-1] <= size[2:])
        & (size[1:-1] < SLOW_SHARE * size.max())
    )
    return [int(k) for k in inner[1:-1][least]]


def _draw_passing(
    path: PolynomialPath,
    section: tuple[int, int],
    stretches: Sequence[tuple[int, int]],
    still: np.ndarray,
    turns: Sequence[int],
    count: int,
) -> PolynomialPath:
    """Draw a section for motions that pass `count` turns, between the longest ways, and rest at the
    others.

    section: first break and last; stretches of it that are straight from rest to rest
    still (P+1,)  how many derivatives are nothing on both sides of a break; turns: breaks at which
                  q′ alone is
    """
    first, last = section
    ends = [first, *(k for k in range(first + 1, last) if still[k] > 0), last]
    values = np.concatenate(
        [path.coefficients[-1], path.derivatives(path.breaks[-1:], _last_piece(path), 0)[0]]
    )
    way = {k: float(np.abs(values[k] - values[at]).max()) for at, k in pairwise(ends)}
    after = {at: way[k] for at, k in pairwise(ends)}
    passed = set(sorted(turns, key=lambda k: -min(way[k], after[k]))[:count])
    lines = (
        [(a, b) for a, b in stretches if not passed & {a, b}] if len(passed) < len(turns) else []
    )
    covered = {k for a, b in lines for k in range(a, b)}
    parts = sorted([*lines, *((k, k + 1) for k in range(first, last) if k not in covered)])
    rests = still > 0
    rests[list(passed)] = False
    return _draw_path(path, parts, {a for a, _ in lines}, rests)


def _last_piece(path: PolynomialPath) -> np.ndarray:
    return np.array([len(path.breaks) - 2])


def join_sections(parts: Sequence[PolynomialPath]) -> PolynomialPath:
    """Sections one after the other."""
    speeds = parts[0].end_speeds[0], parts[-1].end_speeds[1]
    breaks = np.concatenate([parts[0].breaks[:1], *(part.breaks[1:] for part in parts)])
    rests = np.concatenate([[True], *(np.append(part.rests[1:-1], True) for part in parts)])
    coefficients = np.concatenate([part.coefficients for part in parts], 1)
    lines = np.concatenate([part.lines for part in parts])
    origin = parts[0].origin
    return PolynomialPath(
        breaks, coefficients, parts[0].names, speeds, rests=rests, lines=lines, origin=origin
    )


def _draw_path(
    path: PolynomialPath, parts: Sequence[tuple[int, int]], lines: set[int], rests: np.ndarray
) -> PolynomialPath:
    """Parts (first piece, the one after the last) of a path, those that begin with one of `lines`
    as such.
    """
    at = [first for first, _ in parts]
    after = parts[-1][1]
    coefficients = path.coefficients[:, at].copy()
    values = path.coefficients[-1]
    whole = len(path.breaks) - 1
    for n, (first, last) in enumerate(parts):
        if first in lines:
            end = (
                values[last]
                if last < whole
                else path.derivatives(path.breaks[-1:], np.array([whole - 1]), 0)[0][0]
            )
            coefficients[:-2, n] = 0.0
            coefficients[-2, n] = (end - values[first]) / (path.breaks[last] - path.breaks[first])
    speeds = (
        (path.end_speeds[0] if at[0] == 0 else 0.0),
        (path.end_speeds[1] if after == whole else 0.0),
    )
    return PolynomialPath(
        path.breaks[[*at, after]],
        coefficients,
        path.names,
        speeds,
        rests=rests[[*at, after]],
        lines=np.array([first in lines for first in at]),
        origin=path.origin,
    )


def _find_stretches(path: PolynomialPath, ends: np.ndarray) -> Iterator[tuple[int, int]]:
    """First piece and the one after the last of every longest straight stretch from an end to an
    end (P+1,).

    ends: where a motion rests, or the path stands on one side. Not those that are lines by their
    way already, nor what begins or ends at a speed: that is one of the parameter given.
    """
    count = path.coefficients.shape[1]
    straight, extent = _find_straight(path)
    values = np.concatenate(
        [path.coefficients[-1], path.derivatives(path.breaks[-1:], np.array([count - 1]), 0)[0]]
    )
    first = 0
    while first < count:
        last = first + 1
        if straight[first]:
            while (
                last < count
                and straight[last]
                and _follows_line(values[first : last + 2], extent[first : last + 1])
            ):
                last += 1
            moving = (first == 0 and path.end_speeds[0] > 0) or (
                last == count and path.end_speeds[1] > 0
            )
            done = not path.coefficients[:-2, first:last].any() and not ends[first + 1 : last].any()
            if ends[first] and ends[last] and not moving and not done:
                yield first, last
        first = last


def _find_straight(path: PolynomialPath) -> tuple[np.ndarray, Array]:
    """Whether each piece (P,) runs along its chord, and by how much each axis changes over it (P,
    n).

    It runs forwards, as it is cut where it stands.
    """
    powers = np.arange(len(path.coefficients) - 1, 0, -1)[:, None, None]
    own = path.coefficients[:-1] * np.diff(path.breaks)[:, None] ** powers
    chord = own.sum(0)
    size = np.abs(own).max(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        unit = np.where(size > 0, chord / np.where(size > 0, size, 1.0), 0.0)
        share = (own / np.where(size > 0, size, 1.0) * unit).sum(2) / (unit * unit).sum(1)
        away = np.abs(own - share[..., None] * chord).max(0)
    small = away <= STRAIGHTNESS_SHARE * size + COEFFICIENT_ROUNDING * np.abs(path.coefficients[-1])
    return np.asarray(small.all(1) & (unit != 0).any(1)), size


def _follows_line(points: Array, extent: Array) -> bool:
    """Whether points (K, n) follow each other along one straight line."""
    chord = points[-1] - points[0]
    most = np.abs(chord).argmax()
    if chord[most] == 0:
        return False
    share = (points[:, most] - points[0, most]) / chord[most]
    away = np.abs(points - points[0] - share[:, None] * chord)
    within = away <= STRAIGHTNESS_SHARE * extent.sum(0) + 4 * COEFFICIENT_ROUNDING * np.abs(points)
    return bool((np.diff(share) > 0).all() and within.all())
