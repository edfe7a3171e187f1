"""Chaining: what ends where another begins is one contour, turned round where it has to be."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.program import SAME
from planner.sources.stroke import Chain, headings, reverse

CROWD = 40
"""Ends that are near one end, on average, above which a tolerance is too wide for its drawing."""
FORK = 64
"""Ends that may meet; where more do, as in the middle of a star, all end there."""


def chained(chains: Sequence[Chain], tolerance: float) -> tuple[list[Chain], int]:
    """Chains joined where their ends are within `tolerance` (m), in the order of their first; and how many forks.

    At a fork, where more than two end, the way goes on where it bends least. The direction of a result is that of most
    of its parts. Raises MotionError for a tolerance that is wider than the drawing's own details.
    """
    if not chains:
        return [], 0
    ends = np.array([[chain[0].start, chain[-1].end] for chain in chains]).reshape(-1, 3)
    groups = _groups(ends, tolerance)
    partner = np.full(len(ends), -1)
    forks = 0
    for group in groups:
        if len(group) > 2:
            forks += 1
            if len(group) <= FORK:
                _pair(group, chains, partner)
        elif len(group) == 2:
            a, b = group
            partner[a], partner[b] = b, a
    return _walks(chains, partner), forks


def _away(chains: Sequence[Chain], end: int) -> Array:
    """Unit vector along which a chain is entered from one of its two ends."""
    chain = chains[end // 2]
    return -headings(chain[-1])[1] if end % 2 else headings(chain[0])[0]


def _groups(ends: Array, tolerance: float) -> list[list[int]]:
    """Numbers of the ends that are near each other, each group in order: single ones left out."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # first those that are the same, which may be any number: pairs are counted among the others
    _, first, same = np.unique(np.rint(ends / SAME), axis=0, return_index=True, return_inverse=True)
    tree = cKDTree(ends[first])
    if tree.count_neighbors(tree, tolerance) > CROWD * len(first):
        raise MotionError(
            f"tolerance {tolerance * 1e3:g} mm: too many ends lie within it of each other; give one that is smaller "
            "than the drawing's details"
        )
    pairs = tree.query_pairs(tolerance, output_type="ndarray")
    near = coo_array((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), shape=(len(first), len(first)))
    label = np.asarray(connected_components(near, directed=False)[1])[same.ravel()]
    order = np.argsort(label, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return [part.tolist() for part in parts if len(part) > 1]


def _pair(group: list[int], chains: Sequence[Chain], partner: NDArray[np.intp]) -> None:
    """Pairs of a fork, the straightest first."""
    away = np.array([_away(chains, end) for end in group])
    bend = away @ away.T
    for at in np.argsort(bend, axis=None, kind="stable"):
        a, b = (group[k] for k in divmod(int(at), len(group)))
        if a != b and partner[a] < 0 and partner[b] < 0:
            partner[a], partner[b] = b, a


def _walks(chains: Sequence[Chain], partner: NDArray[np.intp]) -> list[Chain]:
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
        strokes = [chains[end // 2] if end % 2 == 0 else reverse(chains[end // 2]) for end in parts]
        found.append((min(parts) // 2, tuple(stroke for chain in strokes for stroke in chain)))
    return [chain for _, chain in sorted(found, key=lambda pair: pair[0])]
