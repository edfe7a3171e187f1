"""From contours to a program: the way between them, down to them and up again, and into closed ones."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.program import SAME, Join, Line, Segment, Stop
from planner.sources.stroke import Chain, arc, area, begun, cross, headings, height, line, moved, reverse, vertices
from planner.sources.tour import tour


@dataclass(frozen=True, slots=True)
class Cutting:
    """How contours are run: heights above the plane z = 0 of their coordinates (m), speeds (m/s), and joins.

    retract   height of the way between contours; None: straight from one to the next
    approach  height above a contour's start from which it is gone down to at `speed`
    rapid     cap of the way between; speed: cap along contours; None: none
    lead_in   m of the way into a closed contour, tangential: straight or, where lead is "arc", a quarter circle
    side      where a quarter circle comes from
    nearest   whether their order is chosen so that the way between is short; else it is as given
    """

    join: Join
    rapid: float | None
    speed: float | None
    retract: float | None
    approach: float
    lead_in: float | None
    lead: str
    side: str
    nearest: bool


def program_of(chains: Sequence[Chain], closed: Sequence[bool], how: Cutting, start: Array) -> tuple[Segment, ...]:
    """Segments through all chains, from a start (3,). Raises MotionError for a retract height that is in the way."""
    if how.retract is not None:
        top = max(height(stroke) for chain in chains for stroke in chain)
        if how.retract < top + how.approach:
            raise MotionError(
                f"retract {how.retract * 1e3:g} mm must be at least {(top + how.approach) * 1e3:g} mm: the drawing's "
                "highest point and the approach above it"
            )
    segments: list[Segment] = []
    here = start
    for chain, loop in zip(*_ordered(chains, closed, how, start), strict=True):
        own = _led_in(chain, how) if loop and how.lead_in is not None else chain
        here = _go(segments, here, own[0].start, how)
        for nth, stroke in enumerate(own):
            fitting = moved(stroke, here)
            join = how.join if nth + 1 < len(own) else Stop()
            segments.append(replace(fitting.segment, speed=how.speed, join=join))
            here = fitting.end
        if how.retract is not None:
            here = _to(segments, here, np.array([here[0], here[1], how.retract]), how.rapid)
    return tuple(segments)


def _ordered(
    chains: Sequence[Chain], closed: Sequence[bool], how: Cutting, start: Array
) -> tuple[list[Chain], list[bool]]:
    if not how.nearest:
        return list(chains), list(closed)
    entries = [
        vertices(chain) if loop else np.array([chain[0].start, chain[-1].end])
        for chain, loop in zip(chains, closed, strict=True)
    ]
    found: list[Chain] = []
    order = tour(start, entries, closed)
    for k, by in order:
        chain = chains[k]
        found.append(begun(chain, by) if closed[k] else reverse(chain) if by else chain)
    return found, [closed[k] for k, _ in order]


def _go(segments: list[Segment], here: Array, there: Array, how: Cutting) -> Array:
    """To where a contour starts: up, across, down at rapid speed, and the rest at that of the contour."""
    if np.linalg.norm(there - here) <= SAME:
        return here
    if how.retract is None:
        return _to(segments, here, there, how.rapid)
    if here[2] < how.retract:
        here = _to(segments, here, np.array([here[0], here[1], how.retract]), how.rapid)
    here = _to(segments, here, np.array([there[0], there[1], how.retract]), how.rapid)
    here = _to(segments, here, there + np.array([0.0, 0.0, how.approach]), how.rapid)
    return _to(segments, here, there, how.speed)


def _to(segments: list[Segment], here: Array, there: Array, speed: float | None) -> Array:
    if np.linalg.norm(there - here) <= SAME:
        return here
    segments.append(Line(there, None, speed))
    return there


def _led_in(chain: Chain, how: Cutting) -> Chain:
    """A closed chain with its way in: along its first direction, or a quarter circle onto that from a side."""
    length, start = how.lead_in or 0.0, chain[0].start
    ahead = headings(chain[0])[0]
    if how.lead == "line":
        return (line(start - length * ahead, start), *chain)
    radius = length / (pi / 2)
    outward = cross(ahead, np.array([0.0, 0.0, 1.0]))  # on the right, as outside is where it runs against the clock
    left = (area(chain) < 0) != (how.side == "inside")
    size = float(np.linalg.norm(outward))
    if size < 1e-6:
        raise MotionError("lead arc: a contour starts along the plane's normal; take a straight lead-in")
    aside = outward / size * (-1 if left else 1)
    centre = start + radius * aside
    normal = cross(ahead, aside)  # turning about it ends along ahead
    first = arc(centre - radius * ahead, centre, normal, pi / 2, start)
    return (first, *chain)
