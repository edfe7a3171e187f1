"""The order of contours that shortens the way between them: nearest neighbour, then 2-opt."""

from collections.abc import Sequence
from math import dist

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array

NEAR = 7
"""Ends that are looked at from each end."""
ROUNDS = 40
LEAST = 1e-9
"""m that a change has to gain."""

Numbers = NDArray[np.intp]


def tour(start: Array, entries: Sequence[Array], closed: Sequence[bool]) -> list[tuple[int, int]]:
    """Which to run after which, and by which of its entries, so that the way between them is short.

    start    (3,) from where
    entries  of each the points (N, 3) by which it can be entered: of an open one its two ends, which leaves by the
             other; a closed one leaves where it was entered
    From the nearest to the nearest, then with parts turned round as long as that shortens the way (2-opt, among the
    nearest ends); in the end closed ones take the vertex that lies best between their neighbours.
    """
    if not entries:
        return []
    order, by = _nearest(start, entries, closed)
    ends = np.array(
        [[points[b], points[b if loop else 1 - b]] for points, b, loop in zip(entries, by, closed, strict=True)]
    )
    order, turned = _improved(start, order, ends)
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


def _nearest(start: Array, entries: Sequence[Array], closed: Sequence[bool]) -> tuple[Numbers, Numbers]:
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


def _improved(start: Array, order: Numbers, ends: Array) -> tuple[Numbers, NDArray[np.bool_]]:
    """2-opt of an order of ways between ends (n, 2, 3); which of them run from their second end in the end.

    Turning round what stands from place i + 1 to j takes the gaps behind i and j away, and makes one from exit to exit
    and one from entry to entry. The start counts as a way that stays first.
    """
    from scipy.spatial import cKDTree

    points = np.concatenate([[[start, start]], ends])
    order = np.concatenate([[0], order + 1])
    n = len(order)
    flat = points.reshape(-1, 3)
    near = cKDTree(flat).query(flat, min(NEAR + 1, len(flat)))[1]
    a, b = np.repeat(np.arange(len(flat)), near.shape[1]), near.ravel()
    a, b = a[a // 2 < b // 2], b[a // 2 < b // 2]
    if n < 3 or not len(a):
        return order[1:] - 1, np.zeros(n - 1, bool)
    turned = np.zeros(n, bool)
    at_ends = [tuple(map(tuple, way)) for way in points.tolist()]
    for _ in range(ROUNDS):
        place = np.argsort(order)
        exits = (a % 2 == 1) != turned[a // 2]
        alike = exits == ((b % 2 == 1) != turned[b // 2])
        i, j = (place[end[alike] // 2] - ~exits[alike] for end in (a, b))
        i, j = np.minimum(i, j), np.maximum(i, j)
        i, j = i[i >= 0], j[i >= 0]
        gain = _gain(points[order[:, None], np.stack([turned, ~turned], 1)[order].astype(int)], i, j)
        likely = np.argsort(-gain, kind="stable")[: int((gain > LEAST).sum())]
        changed = False
        for at, to in zip(i[likely].tolist(), j[likely].tolist(), strict=True):
            # what has been turned before may have left nothing to gain
            corners = [at_ends[order[k]][turned[order[k]] ^ end] for k, end in ((at, 1), (at + 1, 0), (to, 1))]
            gains = dist(corners[0], corners[1]) - dist(corners[0], corners[2])
            if to + 1 < n:
                last = at_ends[order[to + 1]][int(turned[order[to + 1]])]
                gains += dist(corners[2], last) - dist(corners[1], last)
            if gains > LEAST:
                part = order[at + 1 : to + 1][::-1].copy()
                order[at + 1 : to + 1] = part
                turned[part] = ~turned[part]
                changed = True
        if not changed:
            break
    return order[1:] - 1, turned[1:]


def _gain(ways: Array, i: Numbers, j: Numbers) -> Array:
    """m by which turning round what stands from place i + 1 to j shortens ways (n, 2, 3) in their order."""
    entry, leave = ways[:, 0], ways[:, 1]
    after, behind = np.minimum(j + 1, len(ways) - 1), j + 1 < len(ways)  # there is no gap behind the last
    gone = _apart(leave[i], entry[i + 1]) + behind * _apart(leave[j], entry[after])
    made = _apart(leave[i], leave[j]) + behind * _apart(entry[i + 1], entry[after])
    return np.asarray(gone - made)


def _apart(a: Array, b: Array) -> Array:
    return np.asarray(np.sqrt(((a - b) ** 2).sum(-1)))
