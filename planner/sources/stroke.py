"""Strokes: segments that know where they start, so that they can be turned round and put one after
the other.
"""

from dataclasses import dataclass, replace
from math import cos, hypot, pi, sin
from typing import cast

import numpy as np

from kinematics.foundation.arrays import Array
from planner.path.spline import sample_splines
from planner.program.model import MIN_MOVE, Arc, Line, Spline

MIN_CHORD_RADII = 0.5
"""Chord of an arc, in radii, above which it can be led through an end that is a little off."""


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """A segment, and the points (3,) where it starts and ends, m."""

    start: Array
    end: Array
    segment: Line | Arc | Spline


Chain = tuple[Stroke, ...]
"""Strokes, each from where the one before it ends."""


def line(start: Array, end: Array) -> Stroke:
    return Stroke(start, end, Line(end))


def arc(
    start: Array, centre: Array, normal: Array, angle: float, end: Array | None = None
) -> Stroke:
    """By a signed angle about a unit normal; end: where that is known better than turning the start
    tells it.
    """
    end = centre + _rotate(start - centre, normal, angle) if end is None else end
    return Stroke(start, end, Arc(centre, normal, angle))


def curve(points: Array) -> Stroke:
    """Through points (N, 3), from the first."""
    return Stroke(points[0], points[-1], Spline(points[1:]))


def reverse_chain(chain: Chain) -> Chain:
    """The same way from its end to its start."""
    return tuple(_reverse_stroke(stroke) for stroke in reversed(chain))


def _reverse_stroke(stroke: Stroke) -> Stroke:
    match stroke.segment:
        case Line():
            return line(stroke.end, stroke.start)
        case Arc() as own:
            return Stroke(stroke.end, stroke.start, replace(own, angle=-own.angle, rise=-own.rise))
        case Spline() as own:
            return curve(np.concatenate([own.through[::-1], stroke.start[None]]))


def end_directions(stroke: Stroke) -> tuple[Array, Array]:
    """Unit vectors (3,) along which it leaves its start, and arrives at its end."""
    match stroke.segment:
        case Line():
            first = last = stroke.end - stroke.start
        case Arc() as own:
            way, rise = (
                cross_product(own.normal, stroke.start - own.centre) * own.angle,
                own.rise * own.normal,
            )
            first, last = way + rise, _rotate(way, own.normal, own.angle) + rise
        case Spline() as own:
            slopes = sample_splines(
                np.concatenate([stroke.start[None], own.through]), np.array([0.0, 1.0])
            )[1]
            first, last = slopes[0, 0], slopes[-1, 1]
    return first / np.linalg.norm(first), last / np.linalg.norm(last)


def move_start(stroke: Stroke, start: Array) -> Stroke:
    """The same from a start that is a little off; its end stays where it can.

    An arc keeps its angle: it leaves where it was by no more than the start does. One of nearly a
    whole number of turns is moved as it is, and so is its end.
    """
    off = start - stroke.start
    if np.linalg.norm(off) <= MIN_MOVE:
        return stroke
    match stroke.segment:
        case Line():
            return line(start, stroke.end)
        case Spline() as own:
            return curve(np.concatenate([start[None], own.through]))
        case Arc() as own:
            chord = stroke.end - start
            rise = float(chord @ own.normal)
            flat = chord - rise * own.normal
            length, radius = np.linalg.norm(flat), np.linalg.norm(stroke.start - own.centre)
            if length < MIN_CHORD_RADII * radius:
                return Stroke(start, stroke.end + off, replace(own, centre=own.centre + off))
            # half the chord and the centre beside its middle: tan of half the angle between them
            aside = cross_product(own.normal, flat) / 2 * (cos(own.angle / 2) / sin(own.angle / 2))
            return Stroke(
                start,
                stroke.end,
                replace(own, centre=start + flat / 2 + aside, rise=own.rise + rise),
            )


def max_height(stroke: Stroke) -> float:
    """The largest z of its points; of an arc, at least of those of its circle."""
    top = float(max(stroke.start[2], stroke.end[2]))
    match stroke.segment:
        case Arc() as own:
            radius = np.linalg.norm(stroke.start - own.centre)
            return float(max(top, own.centre[2] + radius * hypot(own.normal[0], own.normal[1])))
        case Spline() as own:
            return float(max(top, own.through[:, 2].max()))
        case _:
            return top


def is_full_circle(chain: Chain) -> bool:
    """Whether it is one full turn of a circle."""
    segment = chain[0].segment
    return (
        len(chain) == 1 and isinstance(segment, Arc) and abs(abs(segment.angle) - 2 * pi) < MIN_MOVE
    )


def find_vertices(chain: Chain) -> Array:
    """Points (N, 3) where a closed chain may begin: starts of its strokes; of a full circle, of its
    quarters.
    """
    if not is_full_circle(chain):
        return np.array([stroke.start for stroke in chain])
    own = cast(Arc, chain[0].segment)
    u = chain[0].start - own.centre
    v = cross_product(own.normal, u)
    return np.asarray(own.centre + np.array([u, v, -u, -v]))


def begin_at_vertex(chain: Chain, nth: int) -> Chain:
    """A closed chain from its nth vertex on."""
    if not is_full_circle(chain):
        return chain[nth:] + chain[:nth]
    own, start = cast(Arc, chain[0].segment), find_vertices(chain)[nth]
    return (Stroke(start, start, own),)


def signed_area(chain: Chain) -> float:
    """m² that a closed chain surrounds, seen from +z: positive where it runs against the clock."""
    found = 0.0
    for stroke in chain:
        corners = np.array([stroke.start, stroke.end])
        match stroke.segment:
            case Arc() as own:
                radius = hypot(*(stroke.start - own.centre))
                found += radius**2 * (own.angle - sin(own.angle)) * own.normal[2] / 2
            case Spline() as own:
                corners = np.concatenate([stroke.start[None], own.through])
        x, y = corners[:, 0], corners[:, 1]
        found += float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum()) / 2
    return found


def cross_product(a: Array, b: Array) -> Array:
    """a × b of two (3,): numpy's own is made for many, and ten times slower for two."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _rotate(vector: Array, normal: Array, angle: float) -> Array:
    """Right hand about a unit normal."""
    along = (vector @ normal) * normal
    flat = vector - along
    return np.asarray(along + cos(angle) * flat + sin(angle) * cross_product(normal, flat))
