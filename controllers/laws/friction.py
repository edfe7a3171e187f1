"""What the Coulomb friction of nominal axes does to their positions where a motion starts or turns."""

from __future__ import annotations

import numpy as np

from controllers.laws.nominal import NominalAxes
from controllers.laws.response import friction_response
from kinematics.array import Array, frozen

FINE = 25
"""Places in each step where friction may turn: 5 ms apart at the thesis' step, a sixth of the drives' integral time."""


class Friction:
    """x (…, n, M) by what the friction changes over H steps: Σⱼ −γ g(tᵢ − tⱼ) Δhⱼ at M instants tᵢ.

    h is the way an axis runs, ±1, and Δhⱼ its change at place tⱼ; g the response to a unit acceleration from outside.
    The friction at the start is in the drive's integral already.

    instants  (M,) steps from the start, whole multiples of 1/(2 FINE)
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, instants: Array) -> None:
        self.places = frozen(np.arange(steps * FINE + 1) / FINE)
        """(H · FINE + 1,) where h is to be told, in steps from the start."""
        # a change is seen at the end of the stretch in which it happened, so half a stretch late
        late = instants[:, None] - (self.places[1:] - 0.5 / FINE)
        ticks = np.maximum(np.rint(late * 2 * FINE), 0).astype(int)
        g = friction_response(axes, dt / (2 * FINE), int(ticks.max()))[:, ticks]
        self._effect = -np.broadcast_to(axes.coulomb, len(g))[:, None, None] * g

    def of(self, heading: Array) -> Array:
        """x (…, n, M) for h (H · FINE + 1, …, n)."""
        change = np.moveaxis(np.diff(heading, axis=0), 0, -1)
        return np.asarray((self._effect @ change[..., None])[..., 0])
