"""How a motion ends: when it is there for good, and how far it went beyond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array

BAND = 10.0
"""Pulses about the last planned position within which an axis counts as being there. Assumed: no source states one; it
is 0.024° of an output turn on the thesis' servo rig, 7.5 µm on its hexapod."""
BLOCK = 256
"""Samples looked at together, from the last one back."""


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one run, to a sample of its record.

    band       pulses
    end_time   s, from which all axes stay within the band to the end of the record; inf if they are not in it then
    late       s, end_time − planned duration
    settling   (n,) s of each axis after the planned duration, 0 or more
    overshoot  (n,) m or rad, 0 or more: beyond the last position, seen in the direction in which the plan came to it
    """

    band: float
    end_time: float
    late: float
    settling: Array
    overshoot: Array


def endings(
    t: Array, actual: Array, planned: Array, duration: float, pulse: Array, band: float = BAND
) -> tuple[Ending, ...]:
    """Of B runs: actual (N, B, n) and planned (N, n) positions in pulses at t (N,), s; pulse (n,), m or rad.

    A run is within the band where |q − q_end| ≤ band on every axis.
    """
    end = planned[-1]
    since = _settling_instants(t, actual, end, band)
    way = end - planned
    last = len(way) - 1 - np.argmax(way[::-1] != 0, axis=0)
    # a step has no way of its own: the axes tell where they came from
    way = np.where((way != 0).any(0), np.take_along_axis(way, last[None], 0)[0], end - actual[0])
    after = actual[t >= min(duration, t[-1])]
    beyond = np.where(way > 0, after.max(0) - end, np.where(way < 0, end - after.min(0), 0.0))
    overshoot = np.maximum(beyond, 0.0) * pulse
    ends = since.max(1)
    return tuple(
        Ending(
            band, float(ends[b]), float(ends[b] - duration), *map(freeze_array, (np.maximum(of - duration, 0.0), over))
        )
        for b, (of, over) in enumerate(zip(since, overshoot, strict=True))
    )


def _settling_instants(t: Array, actual: Array, end: Array, band: float) -> Array:
    """(B, n) instants from which each axis stays within the band; looked for from the end back, where they are."""
    since = np.full(actual.shape[1:], t[0])
    open_ = np.ones(actual.shape[1:], bool)
    for stop in range(len(t), 0, -BLOCK):
        start = max(stop - BLOCK, 0)
        out = ~(np.abs(actual[start:stop] - end) <= band)
        found = open_ & out.any(0)
        first_in = stop - np.argmax(out[::-1], axis=0)
        since[found] = np.append(t, np.inf)[first_in[found]]
        open_ &= ~found
        if not open_.any():
            break
    return since
