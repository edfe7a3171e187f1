"""The path of a motion as a curve, with what a projection onto it needs."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from kinematics.foundation.arrays import Array
from planner.actuation import MachinePath
from planner.pulses.motion import AxesMotion

INSTANTS_PER_PIECE, HALVINGS = 64, 52
"""Instants of a piece between which axes may turn back once; halvings until the instant is found to its rounding."""
INSIDE_SHARE = 1e-4
"""Share of a piece by which one goes inside it for the direction at an end where the curve stands still."""


class ReferenceCurve(Protocol):
    """A path r(s) in d dimensions, smooth in each of the pieces between `breaks` (P + 1,)."""

    @property
    def breaks(self) -> Array: ...
    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """r and r′, each (N, d), at s (N,) seen from inside the given pieces (N,)."""


@dataclass(frozen=True, slots=True)
class PathCurve:
    """The platform's origin along a planned path."""

    path: MachinePath

    @property
    def breaks(self) -> Array:
        return self.path.breaks

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        return self.path.position_derivatives(s, piece)


@dataclass(frozen=True)
class MotionCurve:
    """The axes along a motion that has no path in space: r = q (n,), and s is the time.

    Where the axes turn back on their way a piece ends, so that what is there and what is back are told apart.
    """

    motion: AxesMotion

    @cached_property
    def breaks(self) -> Array:
        knots = np.unique(self.motion.knots)
        share = np.arange(INSTANTS_PER_PIECE) / INSTANTS_PER_PIECE
        t = np.append((knots[:-1, None] + np.diff(knots)[:, None] * share).ravel(), knots[-1])
        speed = self.motion.at(t).qd
        back = (speed[:-1] * speed[1:]).sum(1) < 0
        low, high, forth = t[:-1][back], t[1:][back], speed[:-1][back]
        for _ in range(HALVINGS if back.any() else 0):
            middle = (low + high) / 2
            beyond = (self.motion.at(middle).qd * forth).sum(1) < 0
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return np.union1d(knots, high)

    def at(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        # q and q̇ are continuous across knots
        state = self.motion.at(s)
        return state.q, state.qd


def piece_of(curve: ReferenceCurve, s: Array) -> np.ndarray:
    """The piece (N,) that each s (N,) is in; a break belongs to the one that it starts."""
    return np.clip(np.searchsorted(curve.breaks, s, side="right") - 1, 0, len(curve.breaks) - 2)


def directions(curve: ReferenceCurve, s: Array, piece: np.ndarray) -> Array:
    """Unit tangents t̂ (N, d); zero where the curve stands still throughout, as in a turn on the spot."""
    low, high = curve.breaks[piece], curve.breaks[piece + 1]
    slope = curve.at(s, piece)[1]
    size = np.linalg.norm(slope, axis=1)
    inner = curve.at(np.clip(s, low + INSIDE_SHARE * (high - low), high - INSIDE_SHARE * (high - low)), piece)[1]
    inner_size = np.linalg.norm(inner, axis=1)
    resting = size < INSIDE_SHARE * inner_size
    slope, size = np.where(resting[:, None], inner, slope), np.where(resting, inner_size, size)
    return np.asarray(slope / np.where(size > 0, size, 1.0)[:, None])
