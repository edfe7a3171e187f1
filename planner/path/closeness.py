"""How near two paths run to each other, proved: a bound of their Fréchet distance, in position and
in orientation.

Along both at once: cell by cell of a correspondence that never turns back, each path runs evenly
through its own part, and the difference of the two poses there is a Taylor model, whose Bernstein
coefficients bound it. So every pose of one has a near one of the other, both ways round and in
order: no loop is cut off. Any correspondence gives a bound; that of nearest points gives a tight
one. Roundings are in the balls. Fréchet distance: Alt and Godau, Computing the Fréchet distance
between two polygonal curves (1995). Bernstein form: Farouki, Computer Aided Geometric Design 29
(2012), 379.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from math import comb

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import EPS, Series
from planner.path.shape import (
    Piece,
    Shape,
    pose_derivatives_map,
    pose_map,
    position_map,
    split_derivatives,
)

# Highest power of the Taylor models, and degree of the Bernstein forms.
ORDER, BERNSTEIN_DEGREE = 6, 9
# How often cells are halved, and by which share the bound may lie above what was met.
MAX_HALVINGS, TIGHTNESS = 10, 0.005
# Cells at first, at least.
MIN_CELLS = 16
# Steps of Gauss and Newton to the nearest point.
NEAREST_STEPS = 4
# How far from its even share of the path, in tolerances, the like of a place is looked for at
# least.
DRIFT = 16.0
# Floor of a share of the tolerance below which no bound is made tighter.
ENOUGH_SHARE = 0.02


class Track:
    """Pieces one after the other, evaluated at many places at once: s from 0, and the piece that it
    is meant on.
    """

    def __init__(self, pieces: Sequence[Piece]) -> None:
        self.pieces = pieces
        self.length = np.array([piece.length for piece in pieces])
        self.start = np.array([piece.start for piece in pieces])
        self.breaks: Array = np.concatenate([[0.0], np.cumsum(self.length)])
        shapes = list({piece.shape: None for piece in pieces})
        self._kind = np.array([shapes.index(piece.shape) for piece in pieces])
        self._row = np.zeros(len(pieces), int)
        self._groups = []
        for k, shape in enumerate(shapes):
            own = np.flatnonzero(self._kind == k)
            self._row[own] = np.arange(len(own))
            # what the maps take of each piece: room for s, and its parameters
            inputs = np.zeros((len(own), 1 + shape.size))
            inputs[:, 1:] = [pieces[n].parameters for n in own.tolist()]
            self._groups.append((shape, inputs))

    def find_piece(self, s: Array) -> np.ndarray:
        """The piece (N,) that s (N,) lies on."""
        return np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.pieces) - 1)

    def local(self, s: Array, piece: np.ndarray) -> Array:
        """The shape's own s (N,), exactly its ends at a piece's ends."""
        own = np.clip(s - self.breaks[piece], 0.0, self.length[piece])
        return np.asarray(
            np.where(s == self.breaks[piece + 1], self.length[piece], own) + self.start[piece]
        )

    def derivatives(self, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array, Array]:
        """The pose's numbers and their first three derivatives by s, each (N, 12)."""
        return split_derivatives(self._evaluate(pose_derivatives_map, 48, s, piece))

    def positions(self, s: Array, piece: np.ndarray) -> tuple[Array, Array, Array]:
        """The position and its first two derivatives by s, each (N, 3)."""
        values = self._evaluate(position_map, 9, s, piece)
        return values[:, :3], values[:, 3:6], values[:, 6:]

    def _evaluate(
        self, make: Callable[[Shape], Expression], size: int, s: Array, piece: np.ndarray
    ) -> Array:
        """Evaluate the map (s, parameters) -> values (size,) of each piece's shape."""
        values = np.empty((len(s), size))
        local = self.local(s, piece)
        alone = len(self._groups) == 1
        for k, (shape, table) in enumerate(self._groups):
            chosen = slice(None) if alone else np.flatnonzero(self._kind[piece] == k)
            inputs = table.take(self._row[piece[chosen]], axis=0)
            inputs[:, 0] = local[chosen]
            values[chosen] = make(shape)(inputs)
        return values

    def nearest(self, x: Array, s: Array, piece: np.ndarray, low: Array, high: Array) -> Array:
        """s (N,) in [low, high] on pieces, where they come near positions x (N, 3), sought from
        s.
        """
        for _ in range(NEAREST_STEPS):
            y, y1, y2 = self.positions(s, piece)
            square = (y1 * y1).sum(1)
            bend = square - ((x - y) * y2).sum(1)
            step = ((x - y) * y1).sum(1) / np.where(
                bend > square / 4, bend, np.maximum(square, 1e-12)
            )
            s = np.clip(s + step, low, high)
        return s

    def enclose(self, first: Array, last: Array, piece: np.ndarray) -> Series:
        """The pose's numbers (ORDER + 1, 2 N, 12) over τ ∈ [−1, 1] from `first` to `last`, the
        pieces' own s (N,).

        The first N rows about each middle, the last N over the whole cell, for the remainder.
        """
        middle, half = (first + last) / 2, (last - first) / 2
        slack = 2 * EPS * (np.abs(first) + np.abs(last))
        ends = np.stack([np.concatenate([middle, middle]), np.concatenate([half, half])])
        spread = np.stack(
            [np.concatenate([slack, np.abs(half) + 2 * slack]), np.concatenate([slack, slack])]
        )
        both = np.concatenate([piece, piece])
        local = Series(ends[..., None], spread[..., None], ORDER)
        found = Series.zeros(ORDER, (len(both), 12))
        for k, (shape, table) in enumerate(self._groups):
            chosen = np.flatnonzero(self._kind[both] == k)
            if not len(chosen):
                continue
            constants = Series.constant(table[self._row[both[chosen]], 1:], ORDER)
            found.put(chosen, pose_map(shape).enclose_columns(local[chosen], constants))
        return found


@dataclass(frozen=True, slots=True)
class Closeness:
    """What is proved of N cells of two paths, and where the ends of the second path's pieces have
    their like.

    s            (N + 1,) ends of the cells along the first path; u: likewise along the second
    position     (N,) m, and angle (N,) rad: bounds of how far they are apart
    places       s (P + 1,) along the first that belongs to the ends of the second's pieces
    """

    s: Array
    u: Array
    position: Array
    angle: Array
    places: Array

    @property
    def worst(self) -> tuple[float, float]:
        """Bounds of the distance in position (m) and in angle (rad)."""
        return float(self.position.max()), float(self.angle.max())


@dataclass(frozen=True, slots=True)
class _Cells:
    """From s[0] to s[1] on pieces of one path, from u[0] to u[1] on those of the other: all (…,
    N).
    """

    s: Array
    u: Array
    piece: np.ndarray
    link: np.ndarray

    def __getitem__(self, chosen: np.ndarray) -> "_Cells":
        return _Cells(self.s[:, chosen], self.u[:, chosen], self.piece[chosen], self.link[chosen])


def bound_distance(
    curve: Sequence[Piece], given: Sequence[Piece], tolerance: float, angle: float
) -> Closeness:
    """How far apart two paths that begin and end together are: bounds that are tight to TIGHTNESS
    of the largest.

    Both parameters go by about the same places: where they do not, the bound is larger than the
    distance, never smaller. tolerance (m) and angle (rad) weigh the two against each other.
    """
    one, other = Track(curve), Track(given)
    places = _corresponding_places(one, other, DRIFT * tolerance)
    cells = _first_cells(one, other, places)
    while len(cells.piece) < MIN_CELLS:  # so many take as long as one
        cells = _halve(one, other, cells)
    done: list[tuple[_Cells, Array, Array]] = []
    met = 0.0
    for halving in range(MAX_HALVINGS + 1):
        (position, turned), least = _bound_cells(one, other, cells)
        use = np.maximum(position / tolerance, turned / angle)
        met = max(met, float(np.maximum(least[0] / tolerance, least[1] / angle).max()))
        open_ = use > max(met * (1 + TIGHTNESS), ENOUGH_SHARE)
        if halving == MAX_HALVINGS:
            open_[:] = False
        done.append((cells[~open_], position[~open_], turned[~open_]))
        if not open_.any():
            break
        cells = _halve(one, other, cells[open_])
    s, u = (np.concatenate([getattr(part, name) for part, _, _ in done], 1) for name in "su")
    position, turned = (np.concatenate([part[k] for part in done]) for k in (1, 2))
    order = np.lexsort((s[0] + s[1], u[0] + u[1]))
    along, beside = (np.append(values[0, order], values[1, order[-1]]) for values in (s, u))
    return Closeness(along, beside, position[order], turned[order], places)


def _corresponding_places(one: Track, other: Track, drift: float) -> Array:
    """s (P + 1,) on the first path next to the ends of the second's pieces, in their order.

    drift: m by which one may run ahead of the other at least, be its pieces ever so short.
    """
    if len(other.pieces) == 1:
        return np.array([0.0, one.breaks[-1]])
    ratio = one.breaks[-1] / other.breaks[-1]
    inner, links = other.breaks[1:-1], np.arange(1, len(other.pieces))
    x = other.positions(inner, links)[0]
    reach = np.maximum(ratio * np.minimum(other.length[:-1], other.length[1:]), drift)
    s = ratio * inner
    low, high = np.maximum(s - reach, 0.0), np.minimum(s + reach, one.breaks[-1])
    for _ in range(NEAREST_STEPS):
        y, y1, _ = one.positions(s, one.find_piece(s))
        s = np.clip(s + ((x - y) * y1).sum(1) / np.maximum((y1 * y1).sum(1), 1e-12), low, high)
    return np.concatenate([[0.0], np.maximum.accumulate(s), [one.breaks[-1]]])


def _first_cells(one: Track, other: Track, places: Array) -> _Cells:
    """Between all ends of pieces, of the one path and of the other."""
    cuts = one.breaks[1:-1]
    link = np.clip(np.searchsorted(places, cuts, side="right") - 1, 0, len(other.pieces) - 1)
    low, high = other.breaks[link], other.breaks[link + 1]
    span = places[link + 1] - places[link]
    share = (cuts - places[link]) / np.where(span > 0, span, 1.0)
    guess = low + np.clip(share, 0.0, 1.0) * (high - low)
    x = one.positions(cuts, np.arange(1, len(one.pieces)))[0]
    u = other.nearest(x, guess, link, low, high)
    s = np.concatenate([places, cuts])
    both = np.concatenate([other.breaks, u])
    is_place = np.concatenate([np.ones(len(places), bool), np.zeros(len(cuts), bool)])
    order = np.lexsort((both, s))
    s, both, is_place = s[order], np.maximum.accumulate(both[order]), is_place[order]
    link = np.cumsum(is_place)[:-1] - 1
    piece = np.cumsum(~is_place)[:-1]
    cells = _Cells(np.stack([s[:-1], s[1:]]), np.stack([both[:-1], both[1:]]), piece, link)
    return cells[(np.diff(s) > 0) | (np.diff(both) > 0)]


def _halve(one: Track, other: Track, cells: _Cells) -> _Cells:
    """Each cell in two, at the middle of the first path's part and what of the other's is nearest
    to that.
    """
    s = cells.s.mean(0)
    x = one.positions(s, cells.piece)[0]
    u = other.nearest(x, cells.u.mean(0), cells.link, cells.u[0], cells.u[1])
    u = np.where(
        (s > cells.s[0]) & (s < cells.s[1]), u, cells.u.mean(0)
    )  # of no length: the other's half
    return _Cells(
        np.concatenate([np.stack([cells.s[0], s]), np.stack([s, cells.s[1]])], 1),
        np.concatenate([np.stack([cells.u[0], u]), np.stack([u, cells.u[1]])], 1),
        np.tile(cells.piece, 2),
        np.tile(cells.link, 2),
    )


def _bound_cells(
    one: Track, other: Track, cells: _Cells
) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Bounds over each cell (N,) of the distance in position and in angle; and what was met at its
    ends and middle.
    """
    count = len(cells.piece)
    first, second = (
        track.enclose(track.local(ends[0], piece), track.local(ends[1], piece), piece)
        for track, ends, piece in ((one, cells.s, cells.piece), (other, cells.u, cells.link))
    )
    apart = (first - second).pad(ORDER)
    polynomial = apart.mid[:-1, :count]
    error = apart.rad[:-1, :count].sum(0) + np.abs(apart.mid[-1, count:]) + apart.rad[-1, count:]
    error = error * (1 + 64 * EPS) + 64 * EPS * np.abs(polynomial).sum(0)
    control = np.tensordot(_bernstein_matrix(), polynomial, 1)
    seen = np.stack([polynomial[0], polynomial.sum(0), (polynomial * _SIGNS).sum(0)])
    bounds, least = [], []
    for part in (slice(0, 3), slice(3, 12)):
        size = np.linalg.norm(control[..., part], axis=2).max(0) + np.linalg.norm(
            error[:, part], axis=1
        )
        bounds.append(np.where(np.isfinite(size), size * (1 + 16 * EPS), np.inf))
        least.append(np.linalg.norm(seen[..., part], axis=2).max(0))
    chord = np.minimum(np.stack([bounds[1], least[1]]) / np.sqrt(8), 1.0)  # |ΔR| = √8 sin(angle/2)
    turned = 2 * np.arcsin(chord) * (1 + 16 * EPS)
    return (bounds[0], np.where(np.isfinite(bounds[1]), turned[0], np.inf)), (least[0], turned[1])


_SIGNS = ((-1.0) ** np.arange(ORDER))[:, None, None]


@cache
def _bernstein_matrix() -> Array:
    """(n+1, ORDER): τ^k on [−1, 1] has coefficients Σ_i (−1)^{k−i} C(j, i) C(n−j, k−i) / C(n, k) of
    degree n.
    """
    n = BERNSTEIN_DEGREE
    return freeze_array(
        [
            [
                sum(
                    (-1) ** (k - i) * comb(j, i) * comb(n - j, k - i)
                    for i in range(max(0, k - n + j), min(j, k) + 1)
                )
                / comb(n, k)
                for k in range(ORDER)
            ]
            for j in range(n + 1)
        ]
    )
