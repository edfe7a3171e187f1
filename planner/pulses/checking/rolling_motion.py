"""A motion that comes in parts, as the check of its pulses goes through it: a few parts at a time
are held.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.pulses.motion import AxesMotion, MotionState, SingleAxisMotion


@dataclass(frozen=True, slots=True)
class PlacedMotion:
    """A part of a motion from `begin` to `end`, s since the start of the whole; knots: its own,
    since that start.
    """

    motion: AxesMotion
    begin: float
    end: float
    knots: Array

    def find_own_time(self, t: Array) -> Array:
        """(N,) s since the part began; the last instant before a knot stays before it."""
        own = np.asarray(self.motion.knots)
        k = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(own) - 2)
        most = np.where(t < self.knots[k + 1], np.nextafter(own[k + 1], own[k]), own[k + 1])
        return np.asarray(np.clip(own[k] + (t - self.knots[k]), own[k], np.maximum(most, own[k])))


class RollingMotion:
    """The parts of a motion, each with a time that begins at 0, one after the other on the time of
    the whole.

    duration  s, as the schedule states it: that of all parts
    The sum of the parts' durations is kept exactly. What was forgotten, or has not come yet, cannot
    be asked for.
    """

    def __init__(self, parts: Iterable[AxesMotion], duration: float) -> None:
        self.duration = duration
        self._coming: Iterator[AxesMotion] = iter(parts)
        self._end, self._all = Fraction(0), False
        self._held: list[PlacedMotion] = []

    @property
    def knots(self) -> Array:
        return np.unique(np.concatenate([part.knots for part in self._held]))

    @property
    def end(self) -> float:
        """s: of the last part that has come."""
        return float(self._end)

    def load(self) -> PlacedMotion | None:
        """The next part; None where there is none."""
        motion = next(self._coming, None)
        if motion is None:
            self._all = True
            return None
        begin, own = float(self._end), np.asarray(motion.knots)
        self._end += Fraction(float(motion.duration))
        knots = begin + own
        knots[-1] = self.end
        self._held.append(PlacedMotion(motion, begin, self.end, np.maximum.accumulate(knots)))
        return self._held[-1]

    def forget(self, before: float) -> None:
        """Let go of the parts that end before a time (s), but for the last."""
        self._held = [part for part in self._held[:-1] if part.end >= before] + self._held[-1:]

    def at(self, t: Array, /) -> MotionState:
        return self._ask(t, None)

    def axis_at(self, t: Array, axis: int, /) -> MotionState:
        return self._ask(t, axis)

    def _ask(self, asked: Array, axis: int | None) -> MotionState:
        t = np.atleast_1d(np.asarray(asked, float))
        known = self._held[0].begin if self._held else np.inf, np.inf if self._all else self.end
        if len(t) and not (known[0] <= t.min() and t.max() <= known[1]):
            raise MotionError(
                "a motion is checked part by part: what was asked for is not held any more, or not yet"
            )
        whose = np.searchsorted([part.begin for part in self._held], t, side="right") - 1
        found: list[tuple[NDArray[np.intp], MotionState, int | None]] = []
        for n in np.unique(whose):
            here, part = np.flatnonzero(whose == n), self._held[n]
            own = part.find_own_time(t[here])
            if axis is None:
                found.append((here, part.motion.at(own), None))
            elif isinstance(part.motion, SingleAxisMotion):
                found.append((here, part.motion.axis_at(own, axis), None))
            else:
                found.append((here, part.motion.at(own), axis))
        return _RollingState(len(t), found)


class _RollingState:
    def __init__(
        self, size: int, found: list[tuple[NDArray[np.intp], MotionState, int | None]]
    ) -> None:
        self._size, self._found = size, found

    def _gather(self, name: str) -> Array:
        out = None
        for here, state, axis in self._found:
            values = np.asarray(getattr(state, name), float)
            values = values if axis is None or values.ndim == 1 else values[:, axis : axis + 1]
            out = np.empty((self._size, *values.shape[1:])) if out is None else out
            out[here] = values
        return np.empty((0, 1)) if out is None else out

    @property
    def s(self) -> Array:
        return self._gather("s")

    @property
    def q(self) -> Array:
        return self._gather("q")

    @property
    def qd(self) -> Array:
        return self._gather("qd")

    @property
    def qdd(self) -> Array:
        return self._gather("qdd")

    @property
    def qddd(self) -> Array:
        return self._gather("qddd")
