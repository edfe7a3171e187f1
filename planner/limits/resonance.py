"""Resonance of a stepper axis: bands of speed to keep below, or to cross within a stated time
[Sasidhar 1981].
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.limits.limit import AxisLimit, LimitState, Quantity, Rows, Term
from planner.path.actuation import Points

# Room below a band where an axis is held: what lies between grid points must not touch the band.
BAND_MARGIN = 1e-3


@dataclass(frozen=True, slots=True)
class Band:
    """low ≤ |q̇| ≤ high of axis number `axis`, in which no stay may last longer than `time` (s)."""

    axis: int
    low: float
    high: float
    time: float


@dataclass(frozen=True, slots=True)
class SpeedCap:
    """|q̇| < low of a band, by a share, from s = first to last, where the fastest motion stayed in
    the band too long.
    """

    band: Band
    first: float
    last: float
    share: float = BAND_MARGIN


class Resonance(AxisLimit):
    """An axis that states no time keeps |q̇| ≤ the lower edge of its first band: starting from
    rest, it stays below.

    One that does may cross: `bands` are proved by how long each stay in them lasts
    (planner.certificate.resonance_dwell), which no value at an instant tells. Where the fastest
    motion stays too long, the axis is `held` below the band.
    """

    name, dimension, convex = "resonance", "/s", True
    terms = frozenset({Term.SD})

    def __init__(self, axes: Sequence[Axis], held: Sequence[SpeedCap] = ()) -> None:
        below = [
            axis.resonance[0][0] if axis.resonance and axis.resonance_time is None else None
            for axis in axes
        ]
        super().__init__(axes, below)
        self.axes, self.held = tuple(axes), tuple(held)
        self.bands = tuple(
            Band(n, *edges, axis.resonance_time)
            for n, axis in enumerate(axes)
            if axis.resonance_time is not None
            for edges in axis.resonance or ()
        )

    @property
    def binds(self) -> bool:
        return super().binds or bool(self.bands)

    def hold_more(self, more: Sequence[SpeedCap]) -> "Resonance":
        """The same limit, held in more places."""
        return Resonance(self.axes, (*self.held, *more))

    def kept_below(self) -> "Resonance":
        """The limit of axes that state no time: |q̇| ≤ the lower edge of each one's first band."""
        return Resonance([replace(axis, resonance_time=None) for axis in self.axes])

    def first_band(self, channel: int) -> str:
        """What to say of the band that an axis has to stay below."""
        unit, scale = self.units[channel]
        low, high = (edge * scale for edge in (self.axes[channel].resonance or ((0.0, 0.0),))[0])
        return f"a resonance band from {low:.6g} to {high:.6g} {unit} without a crossing time, "

    def value(self, motion: LimitState) -> Quantity:
        return motion.qd

    def _scale(self, factors: Array) -> None:
        raise MotionError(
            f"{self.name} is a band, which no one number scales: state another in the machine's file"
        )

    def rows(self, points: Points) -> Rows:
        bound: Array = np.tile(self.bounds, (len(points.s), 1))
        for each in self.held:
            inside = (points.s >= each.first) & (points.s <= each.last)
            bound[inside, each.band.axis] = np.minimum(
                bound[inside, each.band.axis], each.band.low * (1 - each.share)
            )
        return Rows({Term.SD: points.derivatives[1]}, bound)
