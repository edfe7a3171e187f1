"""Parts of a motion, whose pulses are made one part after the other: where one begins, and its
pulses.

The end of a part, which the next one may still need, is stored as polynomials, so that the part
itself can be dropped.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from math import ceil, floor, frexp, log2

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.machine.axis import Axis
from planner.parallel import Progress, ignore_progress
from planner.place import Infeasible
from planner.pulses.generation.pieces import fit
from planner.pulses.motion import AxesMotion, MotionState
from planner.pulses.schedule import AxisPulses

TICK_BITS = 52
"""Bits of a float64, 53, but for the one that tells halves of a tick apart."""


@dataclass(frozen=True, slots=True)
class MotionPart:
    """A part of the motion of axes, whose time begins at 0 again, and what was counted and fired
    before it.

    home      (n,) axis positions from which pulses count
    tick      ticks since the start of the whole, exact: parts begin at no whole tick
    counts    of the axes; ways: of the last pulse of each, 0 for none. Empty for the first part
    noise     (n,) m or rad: the largest that rounding made of the motion before it
    slip      pulses by which the counts may be farther from its start than the rule leaves them:
              some were moved
    last      the motion ends with the part
    tell      how far the pulses are
    """

    motion: AxesMotion
    axes: Sequence[Axis]
    home: Array
    clock_hz: int
    tick: Fraction = Fraction(0)
    counts: tuple[int, ...] = ()
    ways: tuple[int, ...] = ()
    noise: tuple[float, ...] = ()
    slip: float = 0.0
    last: bool = True
    tell: Progress = ignore_progress

    @property
    def is_whole(self) -> bool:
        """The part is all of the motion."""
        return self.last and not self.counts

    @property
    def end_tick(self) -> Fraction:
        """Ticks from the start of the whole to the end of the part, exact."""
        return self.tick + Fraction(self.motion.duration) * self.clock_hz

    def split_tick(self) -> tuple[int, float]:
        """`tick` as an even number and the rest of it: even, so that halves are rounded as in the
        whole.
        """
        whole = 2 * floor(self.tick / 2)
        return whole, float(self.tick - whole)


def refuse_long(duration: float, clock_hz: int) -> None:
    """Raise Infeasible for a motion (s) so long that float64 instants of it no longer tell the
    clock's ticks apart.

    Below 2ᵉ s instants lie 2^(e − 53) s apart. A pulse is due within half a tick of its crossing,
    so that has to be half a tick at most: 2ᵉ ≤ 2⁵² / clock. Whole ticks, below 2⁵² then, are exact
    in float64 and int64.
    """
    longest = 2.0 ** (frexp(2.0**TICK_BITS / clock_hz)[1] - 1)
    if duration <= longest:
        return
    slower = 2.0**TICK_BITS / 2.0 ** ceil(log2(duration))
    other = f", or a clock of {floor(slower)} Hz or less" if slower >= 1 else ""
    remedy = f"on a clock of {clock_hz} Hz no longer motion has its instants within half a tick: make it shorter{other}"
    raise Infeasible("duration", "", None, duration, longest, "s", remedy)


@dataclass(frozen=True, slots=True)
class Fired:
    """The pulses of a part, their ticks on the clock of the whole, and which way each axis went
    last, 0 for neither.

    noise (n,) m or rad: the largest that rounding has made of the motion up to its end
    rule  as the schedule states it, where it has options that the rule chose
    """

    axes: tuple[AxisPulses, ...]
    ways: tuple[int, ...]
    noise: tuple[float, ...] = ()
    rule: str = ""


@dataclass(frozen=True, slots=True)
class MotionSpan:
    """What a motion does from `since` to `until` (s of its own time); s: path length to be added to
    its own.
    """

    motion: AxesMotion
    since: float
    until: float
    s: float = 0.0


@dataclass(frozen=True, slots=True)
class JoinedMotion:
    """Spans of motions one after the other; its time begins at 0.

    knots  (M+1,) s; of each interval between them: whose (M,) span it is of, and its ends (2, M) in
           that one's time
    """

    spans: tuple[MotionSpan, ...]
    knots: Array
    whose: NDArray[np.intp]
    ends: Array

    @classmethod
    def of(cls, *spans: MotionSpan) -> "JoinedMotion":
        knots, whose, ends, begin = [np.zeros(1)], [], [], 0.0
        for n, span in enumerate(spans):
            own = np.asarray(span.motion.knots)
            inside = own[(own > span.since) & (own < span.until)]
            own = np.unique(np.concatenate(([span.since], inside, [span.until])))
            knots.append(begin + (own[1:] - span.since))
            whose.append(np.full(len(own) - 1, n))
            ends.append(np.stack([own[:-1], own[1:]]))
            begin = float(knots[-1][-1]) if len(own) > 1 else begin
        return cls(
            spans,
            freeze_array(np.concatenate(knots)),
            np.concatenate(whose),
            np.concatenate(ends, axis=1),
        )

    @property
    def duration(self) -> float:
        return float(self.knots[-1])

    def at(self, t: Array, /) -> MotionState:
        t = np.atleast_1d(t)
        k = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.whose) - 1)
        low, high = self.ends[:, k]
        # the last instant before a knot stays before it: there a state belongs to the interval on
        # its right
        most = np.where(t < self.knots[k + 1], np.nextafter(high, low), high)
        own = np.clip(low + (t - self.knots[k]), low, most)
        found = []
        for n, span in enumerate(self.spans):
            here = np.flatnonzero(self.whose[k] == n)
            if len(here) or not len(
                own
            ):  # of no instants, any motion tells how many axes there are
                found.append((here, span.motion.at(own[here]), span.s))
        return _JoinedState(len(own), found)


class _JoinedState:
    """States of several motions as one: each is asked only for what is wanted."""

    def __init__(
        self, size: int, found: Sequence[tuple[NDArray[np.intp], MotionState, float]]
    ) -> None:
        self._size, self._found = size, found

    def _gather(self, value: Callable[[MotionState, float], Array]) -> Array:
        parts = [(here, np.asarray(value(state, s))) for here, state, s in self._found]
        out = np.empty((self._size, *parts[0][1].shape[1:]))
        for here, values in parts:
            out[here] = values
        return out

    @property
    def s(self) -> Array:
        return self._gather(lambda state, s: state.s + s)

    @property
    def q(self) -> Array:
        return self._gather(lambda state, _: state.q)

    @property
    def qd(self) -> Array:
        return self._gather(lambda state, _: state.qd)

    @property
    def qdd(self) -> Array:
        return self._gather(lambda state, _: state.qdd)

    @property
    def qddd(self) -> Array:
        return self._gather(lambda state, _: state.qddd)


@dataclass(frozen=True, slots=True)
class PieceMotion:
    """A motion of quintic pieces q(t) = Σ c_i uⁱ, u = (t - knots[p]) / length of piece p; linear in
    path length s.

    knots (P+1,) s, from 0; coefficients (n, 6, P); path (P+1,) path length at the knots
    """

    knots: Array
    coefficients: Array
    path: Array

    def __post_init__(self) -> None:
        freeze_fields(self, "knots", "coefficients", "path")

    @classmethod
    def of(cls, motion: AxesMotion, tolerance: Array) -> "PieceMotion":
        """The same motion, to rounding; tolerance (n,) as in
        `planner.pulses.generation.pieces.fit`, and it raises.
        """
        pieces = fit(motion, tolerance)
        knots = np.append(pieces.start, pieces.start[-1] + pieces.length[-1])
        return cls(knots, pieces.coefficients, np.asarray(motion.at(knots).s, float))

    @property
    def duration(self) -> float:
        return float(self.knots[-1])

    def at(self, t: Array, /) -> MotionState:
        t = np.clip(np.atleast_1d(np.asarray(t, float)), 0.0, self.duration)
        k = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        return _PieceState(self, t, k)


class _PieceState:
    def __init__(self, motion: PieceMotion, t: Array, k: NDArray[np.intp]) -> None:
        self._motion, self._k, self._t = motion, k, t

    @property
    def s(self) -> Array:
        return np.asarray(np.interp(self._t, self._motion.knots, self._motion.path))

    def _rate(self, times: int) -> Array:
        motion, k = self._motion, self._k
        length = np.diff(motion.knots)[k]
        u, values = (self._t - motion.knots[k]) / length, motion.coefficients[:, :, k]
        for _ in range(times):
            values = values[:, 1:] * np.arange(1, values.shape[1])[:, None]
        out = values[:, -1].copy()
        for power in range(values.shape[1] - 2, -1, -1):
            out = out * u + values[:, power]
        return np.asarray((out / length**times).T)

    q = property(partial(_rate, times=0))
    qd = property(partial(_rate, times=1))
    qdd = property(partial(_rate, times=2))
    qddd = property(partial(_rate, times=3))
