"""A skeleton as cylinders: where each lies, how it is turned and sized, and whose limits colour it, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.array import Array
from kinematics.skeleton import Bar, Sort

RADII: dict[Sort, float] = {"frame": 0.005, "actuator": 0.006, "link": 0.010, "platform": 0.007}
"""Of bars, as shares of the size of all that is drawn."""
BARREL, REACH = 0.011, 0.6
"""An actuator's outer tube: its radius as such a share, and its length as a share of the least that the bar has."""
NOTHING = 1e-12
"""m: shorter bars have no direction."""


@dataclass(frozen=True, slots=True)
class Solids:
    """Cylinders along z of unit length and radius in N frames: centres (N, k, 3), quaternions wxyz (N, k, 4), scales
    (N, k, 3); owners (k,): the axis of each, or none.
    """

    centres: Array
    turns: Array
    scales: Array
    owners: tuple[str, ...]


def solids(bars: Sequence[Bar], ends: Array, size: float) -> Solids:
    """Of bars with their ends (N, bars, 2, 3): an actuator is a rod in a tube of constant length."""
    parts = [part for k, bar in enumerate(bars) for part in _parts(bar, ends[:, k], size)]
    start, end = (np.stack([part[n] for part in parts], 1) for n in (0, 1))
    radius = np.broadcast_to([part[2] for part in parts], start.shape[:2])
    way = end - start
    length = np.linalg.norm(way, axis=2)
    scales = np.stack([radius, radius, length], 2)
    return Solids((start + end) / 2, _turns(way, length), scales, tuple(part[3] for part in parts))


def _parts(bar: Bar, ends: Array, size: float) -> Iterator[tuple[Array, Array, float, str]]:
    """Start and end (N, 3), radius and axis of what a bar is drawn as."""
    start, end = ends[:, 0], ends[:, 1]
    yield start, end, RADII[bar.sort] * size, bar.axis
    if bar.sort == "actuator":
        way = end - start
        length = np.linalg.norm(way, axis=1, keepdims=True)
        yield start, start + way * (REACH * length.min() / np.maximum(length, NOTHING)), BARREL * size, bar.axis


def _turns(way: Array, length: Array) -> Array:
    """(N, k, 4) the shortest turns of z to ways (N, k, 3): (1 + z·d, z × d), normalised; about x where d is −z."""
    x, y, z = np.moveaxis(way / np.maximum(length, NOTHING)[..., None], 2, 0)
    turn = np.stack([1 + z, -y, x, np.zeros_like(z)], -1)
    turn[1 + z < NOTHING] = [0.0, 1.0, 0.0, 0.0]
    return np.asarray(turn / np.linalg.norm(turn, axis=-1, keepdims=True))
