"""From contours to a program: the way between them, down to them and up again, and into closed
ones.

What ends where another begins is one contour, turned round where it has to be. Their order shortens
the way between them: nearest neighbour, then 2-opt.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import dist, pi

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.program.model import MIN_MOVE, Line, Segment
from planner.program.modifiers import Join, Stop
from planner.sources.stroke import (
    Chain,
    arc,
    begin_at_vertex,
    cross_product,
    end_directions,
    find_vertices,
    line,
    max_height,
    move_start,
    reverse_chain,
    signed_area,
)

NEIGHBOUR_COUNT = 7
"""Ends that are looked at from each end."""
MAX_ROUNDS = 40
MIN_GAIN = 1e-9
"""m that a change has to gain."""

Numbers = NDArray[np.intp]


def find_tour(
    start: Array, entries: Sequence[Array], closed: Sequence[bool]
) -> list[tuple[int, int]]:
    """Which to run after which, and by which of its entries, so that the way between them is short.

    start    (3,) from where
    entries  of each the points (N, 3) by which it can be entered: of an open one its two ends,
             which leaves by the other; a closed one leaves where it was entered
    From the nearest to the nearest, then with parts turned round as long as that shortens the way
    (2-opt, among the
    nearest ends); in the end closed ones take the vertex that lies best between their neighbours.
    """
    if not entries:
        return []
    order, by = _nearest(start, entries, closed)
    ends = np.array(
        [
            [points[b], points[b if loop else 1 - b]]
            for points, b, loop in zip(entries, by, closed, strict=True)
        ]
    )
    order, turned = _improve_order(start, order, ends)
    by = np.where(turned & ~np.asarray(closed), 1 - by, by)
    before = start
    for at, k in enumerate(order.tolist()):
        if closed[k]:
            way = np.linalg.norm(entries[k] - before, axis=1)
            if at + 1 < len(order):
                after = order[at + 1]
                way += np.linalg.norm(entries[k] - entries[after][by[after]], axis=1)
            by[k] = int(way.argmin())
        before = entries[k][by[k] if closed[k] else 1 - by[k]]
    return [(int(k), int(by[k])) for k in order]


def _nearest(
    start: Array, entries: Sequence[Array], closed: Sequence[bool]
) -> tuple[Numbers, Numbers]:
    """The order from nearest to nearest, and the entry of each."""
    from scipy.spatial import cKDTree

    points = np.concatenate(entries)
    sizes = np.array([len(part) for part in entries])
    owner, first = np.repeat(np.arange(len(entries)), sizes), np.cumsum(sizes) - sizes
    by, order = np.zeros(len(entries), np.intp), np.zeros(len(entries), np.intp)
    left = np.ones(len(entries), bool)
    alive, remain = np.arange(len(points)), len(points)
    tree, here = cKDTree(points), start
    for step in range(len(entries)):
        if len(alive) > 2 * remain:  # else more and more of those found are done
            alive = np.flatnonzero(left[owner])
            tree = cKDTree(points[alive])
        count, found = 1, np.zeros(0, np.intp)
        while not len(found):
            count = min(4 * count, len(alive))
            found = alive[np.atleast_1d(tree.query(here, count)[1])]
            found = found[left[owner[found]]]
        k = int(owner[found[0]])
        order[step], by[k], left[k] = k, found[0] - first[k], False
        remain -= sizes[k]
        here = entries[k][by[k] if closed[k] else 1 - by[k]]
    return order, by


def _improve_order(start: Array, order: Numbers, ends: Array) -> tuple[Numbers, NDArray[np.bool_]]:
    """2-opt of an order of ways between ends (n, 2, 3); which of them run from their second end in
    the end.

    Turning round what stands from place i + 1 to j takes the gaps behind i and j away, and makes
    one from exit to exit and one from entry to entry. The start counts as a way that stays first.
    """
    from scipy.spatial import cKDTree

    points = np.concatenate([[[start, start]], ends])
    order = np.concatenate([[0], order + 1])
    n = len(order)
    flat = points.reshape(-1, 3)
    near = cKDTree(flat).query(flat, min(NEIGHBOUR_COUNT + 1, len(flat)))[1]
    a, b = np.repeat(np.arange(len(flat)), near.shape[1]), near.ravel()
    a, b = a[a // 2 < b // 2], b[a // 2 < b // 2]
    if n < 3 or not len(a):
        return order[1:] - 1, np.zeros(n - 1, bool)
    turned = np.zeros(n, bool)
    at_ends = [tuple(map(tuple, way)) for way in points.tolist()]
    for _ in range(MAX_ROUNDS):
        place = np.argsort(order)
        exits = (a % 2 == 1) != turned[a // 2]
        alike = exits == ((b % 2 == 1) != turned[b // 2])
        i, j = (place[end[alike] // 2] - ~exits[alike] for end in (a, b))
        i, j = np.minimum(i, j), np.maximum(i, j)
        i, j = i[i >= 0], j[i >= 0]
        gain = _gain(
            points[order[:, None], np.stack([turned, ~turned], 1)[order].astype(int)], i, j
        )
        likely = np.argsort(-gain, kind="stable")[: int((gain > MIN_GAIN).sum())]
        changed = False
        for at, to in zip(i[likely].tolist(), j[likely].tolist(), strict=True):
            # what has been turned before may have left nothing to gain
            corners = [
                at_ends[order[k]][turned[order[k]] ^ end]
                for k, end in ((at, 1), (at + 1, 0), (to, 1))
            ]
            gains = dist(corners[0], corners[1]) - dist(corners[0], corners[2])
            if to + 1 < n:
                last = at_ends[order[to + 1]][int(turned[order[to + 1]])]
                gains += dist(corners[2], last) - dist(corners[1], last)
            if gains > MIN_GAIN:
                part = order[at + 1 : to + 1][::-1].copy()
                order[at + 1 : to + 1] = part
                turned[part] = ~turned[part]
                changed = True
        if not changed:
            break
    return order[1:] - 1, turned[1:]


def _gain(ways: Array, i: Numbers, j: Numbers) -> Array:
    """m by which turning round what stands from place i + 1 to j shortens ways (n, 2, 3) in their
    order.
    """
    entry, leave = ways[:, 0], ways[:, 1]
    after, behind = (
        np.minimum(j + 1, len(ways) - 1),
        j + 1 < len(ways),
    )  # there is no gap behind the last
    gone = _distances(leave[i], entry[i + 1]) + behind * _distances(leave[j], entry[after])
    made = _distances(leave[i], leave[j]) + behind * _distances(entry[i + 1], entry[after])
    return np.asarray(gone - made)


def _distances(a: Array, b: Array) -> Array:
    return np.asarray(np.sqrt(((a - b) ** 2).sum(-1)))


@dataclass(frozen=True, slots=True)
class Cutting:
    """How contours are run: heights above the plane z = 0 of their coordinates (m), speeds (m/s),
    and joins.

    retract   height of the way between contours; None: straight from one to the next
    approach  height above a contour's start from which it is gone down to at `speed`
    rapid     cap of the way between; speed: cap along contours; None: none
    lead_in   m of the way into a closed contour, tangential: straight or, where lead is "arc", a
              quarter circle
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


def make_segments(
    chains: Sequence[Chain], closed: Sequence[bool], how: Cutting, start: Array
) -> tuple[Segment, ...]:
    """Segments through all chains, from a start (3,).

    Raises MotionError for a retract height that is in the way.
    """
    if how.retract is not None:
        top = max(max_height(stroke) for chain in chains for stroke in chain)
        if how.retract < top + how.approach:
            raise MotionError(
                f"retract {how.retract * 1e3:g} mm must be at least {(top + how.approach) * 1e3:g} mm: the drawing's "
                "highest point and the approach above it"
            )
    segments: list[Segment] = []
    here = start
    for chain, loop in zip(*_order_chains(chains, closed, how, start), strict=True):
        own = _lead_in(chain, how) if loop and how.lead_in is not None else chain
        here = _move_to_contour(segments, here, own[0].start, how)
        for nth, stroke in enumerate(own):
            fitting = move_start(stroke, here)
            join = how.join if nth + 1 < len(own) else Stop()
            segments.append(replace(fitting.segment, speed=how.speed, join=join))
            here = fitting.end
        if how.retract is not None:
            here = _append_line(
                segments, here, np.array([here[0], here[1], how.retract]), how.rapid
            )
    return tuple(segments)


def _order_chains(
    chains: Sequence[Chain], closed: Sequence[bool], how: Cutting, start: Array
) -> tuple[list[Chain], list[bool]]:
    if not how.nearest:
        return list(chains), list(closed)
    entries = [
        find_vertices(chain) if loop else np.array([chain[0].start, chain[-1].end])
        for chain, loop in zip(chains, closed, strict=True)
    ]
    found: list[Chain] = []
    order = find_tour(start, entries, closed)
    for k, by in order:
        chain = chains[k]
        found.append(
            begin_at_vertex(chain, by) if closed[k] else reverse_chain(chain) if by else chain
        )
    return found, [closed[k] for k, _ in order]


def _move_to_contour(segments: list[Segment], here: Array, there: Array, how: Cutting) -> Array:
    """To where a contour starts: up, across, down at rapid speed, and the rest at that of the
    contour.
    """
    if np.linalg.norm(there - here) <= MIN_MOVE:
        return here
    if how.retract is None:
        return _append_line(segments, here, there, how.rapid)
    if here[2] < how.retract:
        here = _append_line(segments, here, np.array([here[0], here[1], how.retract]), how.rapid)
    here = _append_line(segments, here, np.array([there[0], there[1], how.retract]), how.rapid)
    here = _append_line(segments, here, there + np.array([0.0, 0.0, how.approach]), how.rapid)
    return _append_line(segments, here, there, how.speed)


def _append_line(segments: list[Segment], here: Array, there: Array, speed: float | None) -> Array:
    if np.linalg.norm(there - here) <= MIN_MOVE:
        return here
    segments.append(Line(there, None, speed, Stop()))
    return there


def _lead_in(chain: Chain, how: Cutting) -> Chain:
    """A closed chain with its way in: along its first direction, or a quarter circle onto that from
    a side.
    """
    length, start = how.lead_in or 0.0, chain[0].start
    ahead = end_directions(chain[0])[0]
    if how.lead == "line":
        return (line(start - length * ahead, start), *chain)
    radius = length / (pi / 2)
    outward = cross_product(
        ahead, np.array([0.0, 0.0, 1.0])
    )  # on the right, as outside is where it runs against the clock
    left = (signed_area(chain) < 0) != (how.side == "inside")
    size = float(np.linalg.norm(outward))
    if size < 1e-6:
        raise MotionError(
            "lead arc: a contour starts along the plane's normal; take a straight lead-in"
        )
    aside = outward / size * (-1 if left else 1)
    centre = start + radius * aside
    normal = cross_product(ahead, aside)  # turning about it ends along ahead
    first = arc(centre - radius * ahead, centre, normal, pi / 2, start)
    return (first, *chain)


MAX_NEIGHBOURS = 40
"""Ends that are near one end, on average, above which a tolerance is too wide for its drawing."""
MAX_FORK_ENDS = 64
"""Ends that may meet; where more do, as in the middle of a star, all end there."""


def chain_strokes(chains: Sequence[Chain], tolerance: float) -> tuple[list[Chain], int]:
    """Chains joined where their ends are within `tolerance` (m), in the order of their first; and
    how many forks.

    At a fork, where more than two end, the way goes on where it bends least. The direction of a
    result is that of most of its parts. Raises MotionError for a tolerance that is wider than the
    drawing's own details.
    """
    if not chains:
        return [], 0
    ends = np.array([[chain[0].start, chain[-1].end] for chain in chains]).reshape(-1, 3)
    groups = _group_ends(ends, tolerance)
    partner = np.full(len(ends), -1)
    forks = 0
    for group in groups:
        if len(group) > 2:
            forks += 1
            if len(group) <= MAX_FORK_ENDS:
                _pair_ends(group, chains, partner)
        elif len(group) == 2:
            a, b = group
            partner[a], partner[b] = b, a
    return _follow_chains(chains, partner), forks


def _entry_direction(chains: Sequence[Chain], end: int) -> Array:
    """Unit vector along which a chain is entered from one of its two ends."""
    chain = chains[end // 2]
    return -end_directions(chain[-1])[1] if end % 2 else end_directions(chain[0])[0]


def _group_ends(ends: Array, tolerance: float) -> list[list[int]]:
    """Numbers of the ends that are near each other, each group in order: single ones left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # first those that are the same, which may be any number: pairs are counted among the others
    _, first, same = np.unique(
        np.rint(ends / MIN_MOVE), axis=0, return_index=True, return_inverse=True
    )
    tree = cKDTree(ends[first])
    if tree.count_neighbors(tree, tolerance) > MAX_NEIGHBOURS * len(first):
        raise MotionError(
            f"tolerance {tolerance * 1e3:g} mm: too many ends lie within it of each other; give one that is smaller "
            "than the drawing's details"
        )
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    near = coo_array(
        (np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first))
    )
    label = np.asarray(connected_components(near, directed=False)[1])[same.ravel()]
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [part.tolist() for part in parts if len(part) > 1]


def _pair_ends(group: list[int], chains: Sequence[Chain], partner: NDArray[np.intp]) -> None:
    """Pairs of a fork, the straightest first."""
    away = np.array([_entry_direction(chains, end) for end in group])
    bend = away @ away.T
    for at in np.argsort(bend, axis=None, kind="stable"):
        a, b = (group[k] for k in divmod(int(at), len(group)))
        if a != b and partner[a] < 0 and partner[b] < 0:
            partner[a], partner[b] = b, a


def _follow_chains(chains: Sequence[Chain], partner: NDArray[np.intp]) -> list[Chain]:
    """End 2k is the start of chain k, end 2k + 1 where it ends."""
    found: list[tuple[int, Chain]] = []
    done = np.zeros(len(chains), bool)
    loose = np.flatnonzero(partner < 0).tolist()
    for enter in [*loose, *range(0, 2 * len(chains), 2)]:  # what has no loose end is closed
        end, parts = enter, []
        while end >= 0 and not done[end // 2]:
            done[end // 2] = True
            parts.append(end)
            end = int(partner[end ^ 1])
        if not parts:
            continue
        if sum(end % 2 for end in parts) * 2 > len(parts):
            parts = [end ^ 1 for end in reversed(parts)]
        strokes = [
            chains[end // 2] if end % 2 == 0 else reverse_chain(chains[end // 2]) for end in parts
        ]
        found.append((min(parts) // 2, tuple(stroke for chain in strokes for stroke in chain)))
    return [chain for _, chain in sorted(found, key=lambda pair: pair[0])]
