"""A motion behind input shapers as the checker works it out: each copy asked at its own time, and
the copies summed.

It shares no code with what pulses are made from, but the motion that is shaped and the impulses
that state the shapers.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from planner.pulses.motion import AxesMotion, MotionState, ShapedAxesMotion, SingleAxisMotion


@dataclass(frozen=True, slots=True)
class ConvolvedState:
    """q_s, q̇_s, q̈_s, q⃛_s (N, n), and the mean path length s (N,) of the copies."""

    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


@dataclass(frozen=True, slots=True)
class Convolution:
    """q_s(t) = ∫ q(t − τ) dA(τ) of impulses A: a motion for the checker."""

    base: AxesMotion
    delays: Array
    weights: Array

    @property
    def knots(self) -> Array:
        return np.unique(np.add.outer(self.delays, np.asarray(self.base.knots)))

    @property
    def duration(self) -> float:
        return float(self.base.duration + self.delays.max())

    def at(self, t: Array, /) -> MotionState:
        return self._sum(t, None)

    def axis_at(self, t: Array, axis: int, /) -> MotionState:
        return self._sum(t, axis)

    def _sum(self, t: Array, axis: int | None) -> ConvolvedState:
        weights = self.weights if axis is None else self.weights[:, axis : axis + 1]
        parts, along = np.zeros((4, len(t), weights.shape[1])), np.zeros(len(t))
        for delay, weight in zip(self.delays, weights, strict=True):
            if not weight.any():
                continue
            own, moving = self._own_time(t, float(delay))
            state = self._ask(own, axis)
            along += float(weight.mean()) * state.s
            parts[0] += state.q * weight
            for part, rate in zip(parts[1:], (state.qd, state.qdd, state.qddd), strict=True):
                part += np.where(moving[:, None], rate, 0.0) * weight
        return ConvolvedState(along, *parts)

    def _ask(self, own: Array, axis: int | None) -> MotionState:
        if axis is None:
            return self.base.at(own)
        if isinstance(self.base, SingleAxisMotion):
            return self.base.axis_at(own, axis)
        state = self.base.at(own)
        return ConvolvedState(
            state.s,
            *(each[:, axis : axis + 1] for each in (state.q, state.qd, state.qdd, state.qddd)),
        )

    def _own_time(self, t: Array, delay: float) -> tuple[Array, np.ndarray]:
        """(N,) instants of a copy, on the right side of its knots; and whether it moves."""
        knots = np.asarray(self.base.knots, float)
        # as the sum of both is rounded, so are the knots of the whole: the side of one is told by
        # comparing these
        k = np.searchsorted(knots + delay, t, side="right") - 1
        moving = (k >= 0) & (k < len(knots) - 1)
        inside = np.clip(k, 0, len(knots) - 2)
        own = np.clip(t - delay, knots[inside], np.nextafter(knots[inside + 1], -np.inf))
        return np.where(moving, own, np.where(k < 0, knots[0], knots[-1])), moving


def rebuild_motion(motion: AxesMotion) -> AxesMotion:
    """The same motion, worked out here where it is one behind shapers."""
    if isinstance(motion, ShapedAxesMotion):
        return Convolution(motion.base, motion.copies.delays, motion.copies.weights)
    return motion
