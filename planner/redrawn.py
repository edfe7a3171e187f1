"""A piecewise polynomial drawn for timing: cut where it stands, and straight stretches drawn by their way.

What the axes pass is the same, and `PolynomialPath.parameter` tells the given parameter of every place. A stretch that
is straight in the axes, q = q₀ + g(s) d with rising g, may be timed as q = q₀ + σ d: its fastest motion is known in
closed form, and neither where g′ = 0 nor where g bends does anything happen in space. Elsewhere the path keeps its
parameter, and rests where it stands (planner.stands): at order 2 that costs nothing, as no motion along a parameter has
a speed there. At order 3 a motion that passes such a place has an acceleration there, q̈ = q″ ṡ², and a rest has none:
either may be the faster, so both are given.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kinematics.array import Array
from planner.polynomial import PolynomialPath
from planner.stands import cut, standing_ends

# Share of an axis' extent by which a stretch may leave its chord and be straight, and of its values: rounding.
STRAIGHT, ROUNDING = 1e-12, 4e-16


@dataclass(frozen=True, slots=True)
class Section:
    """Pieces between two places at which every motion rests: resting inside where the path stands, or passing that.

    passing: None where nothing is to be passed
    """

    resting: PolynomialPath
    passing: PolynomialPath | None


def sections(path: PolynomialPath, order: int) -> list[Section]:
    """The path in sections, one after the other, drawn for a motion of an order."""
    drawn = PolynomialPath(*cut(path.breaks, path.coefficients), path.names, path.end_speeds, origin=path)
    still = standing_ends(drawn)
    both = np.concatenate([[0], np.minimum(still[1, :-1], still[0, 1:]), [0]])
    corner = drawn.stops(order)
    ends = corner.copy()
    ends[1:-1] |= (still[1, :-1] > 0) | (still[0, 1:] > 0)
    stretches = [*_stretches(drawn, ends)]
    inner = {k for first, last in stretches for k in range(first + 1, last)}
    corners = [k for k in np.flatnonzero(corner).tolist() if k not in inner]
    found = []
    for first, last in pairwise(corners):
        own = [(a, b) for a, b in stretches if first <= a and b <= last]
        covered = {k for a, b in own for k in range(a, b)}
        parts = sorted([*own, *((k, k + 1) for k in range(first, last) if k not in covered)])
        resting = _drawn(drawn, parts, {a for a, b in own}, both > 0)
        turns = any(both[k] == 1 for k in range(first + 1, last) if k not in inner)
        alike = [(k, k + 1) for k in range(first, last)]
        passing = _drawn(drawn, alike, set(), both > 1) if turns and order == 3 else None
        found.append(Section(resting, passing))
    return found


def joined(parts: Sequence[PolynomialPath]) -> PolynomialPath:
    """Sections one after the other."""
    speeds = parts[0].end_speeds[0], parts[-1].end_speeds[1]
    breaks = np.concatenate([parts[0].breaks[:1], *(part.breaks[1:] for part in parts)])
    rests = np.concatenate([[True], *(np.append(part.rests[1:-1], True) for part in parts)])
    coefficients = np.concatenate([part.coefficients for part in parts], 1)
    lines = np.concatenate([part.lines for part in parts])
    origin = parts[0].origin
    return PolynomialPath(breaks, coefficients, parts[0].names, speeds, rests=rests, lines=lines, origin=origin)


def _drawn(
    path: PolynomialPath, parts: Sequence[tuple[int, int]], lines: set[int], rests: np.ndarray
) -> PolynomialPath:
    """Parts (first piece, the one after the last) of a path, those that begin with one of `lines` as such."""
    at = [first for first, _ in parts]
    after = parts[-1][1]
    coefficients = path.coefficients[:, at].copy()
    values = path.coefficients[-1]
    whole = len(path.breaks) - 1
    for n, (first, last) in enumerate(parts):
        if first in lines:
            end = values[last] if last < whole else path.derivatives(path.breaks[-1:], np.array([whole - 1]), 0)[0][0]
            coefficients[:-2, n] = 0.0
            coefficients[-2, n] = (end - values[first]) / (path.breaks[last] - path.breaks[first])
    speeds = (path.end_speeds[0] if at[0] == 0 else 0.0), (path.end_speeds[1] if after == whole else 0.0)
    return PolynomialPath(
        path.breaks[[*at, after]],
        coefficients,
        path.names,
        speeds,
        rests=rests[[*at, after]],
        lines=np.array([first in lines for first in at]),
        origin=path.origin,
    )


def _stretches(path: PolynomialPath, ends: np.ndarray) -> Iterator[tuple[int, int]]:
    """First piece and the one after the last of every longest straight stretch from an end to an end (P+1,).

    ends: where a motion rests, or the path stands on one side. Not those that are lines by their way already, nor what
    begins or ends at a speed: that is one of the parameter given.
    """
    count = path.coefficients.shape[1]
    straight, extent = _straight(path)
    values = np.concatenate([path.coefficients[-1], path.derivatives(path.breaks[-1:], np.array([count - 1]), 0)[0]])
    first = 0
    while first < count:
        last = first + 1
        if straight[first]:
            while last < count and straight[last] and _onward(values[first : last + 2], extent[first : last + 1]):
                last += 1
            moving = (first == 0 and path.end_speeds[0] > 0) or (last == count and path.end_speeds[1] > 0)
            done = not path.coefficients[:-2, first:last].any() and not ends[first + 1 : last].any()
            if ends[first] and ends[last] and not moving and not done:
                yield first, last
        first = last


def _straight(path: PolynomialPath) -> tuple[np.ndarray, Array]:
    """Whether each piece (P,) runs along its chord, and by how much each axis changes over it (P, n).

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
    small = away <= STRAIGHT * size + ROUNDING * np.abs(path.coefficients[-1])
    return np.asarray(small.all(1) & (unit != 0).any(1)), size


def _onward(points: Array, extent: Array) -> bool:
    """Whether points (K, n) follow each other along one straight line."""
    chord = points[-1] - points[0]
    most = np.abs(chord).argmax()
    if chord[most] == 0:
        return False
    share = (points[:, most] - points[0, most]) / chord[most]
    away = np.abs(points - points[0] - share[:, None] * chord)
    within = away <= STRAIGHT * extent.sum(0) + 4 * ROUNDING * np.abs(points)
    return bool((np.diff(share) > 0).all() and within.all())
