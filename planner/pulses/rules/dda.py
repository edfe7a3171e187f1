"""The firing rule `dda`: counts of many pulses between listed points, spread by a digital differential analyser."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.units import apart
from planner.option import option
from planner.parallel import Progress
from planner.place import Infeasible
from planner.pulses.motion import Motion
from planner.pulses.pieces import FINE, Pieces, fit
from planner.pulses.rates import jumps, largest, too_fast
from planner.pulses.rules.rule import told
from planner.pulses.schedule import AxisPulses, PulseSchedule, Signs, Ticks


@dataclass(frozen=True, slots=True)
class Dda:
    """Between listed points the axis with the most counts steps evenly, the others with it [KMITL 2005, Module2].

    - The motion is listed at even times, no further apart than `spacing`; a point is the nearest whole count from the
      start. Its DDA steps share the time to the next point evenly, each sending its counts at once.
    - A count is sent as a burst of `pulses_per_count` pulses at `rate`. The source has 500 counts to a unit of length
      and 50 pulses to a count, so 25 000 pulses to a unit; here a pulse is the axis', and so a count 50 of them.
    - |count - x| ≤ 1.5·pulses_per_count + ½ + max|ẍ|·spacing²/8, + one tick's travel: one count of the DDA, half a
      count of the points, half a pulse of the start, and the chord between the points (of which speeds that jump, as
      where the error of a screw bends, take a quarter of the spacing). So is the final count off, but where the motion
      ends a whole number of counts from its start.
    Assumption: the source prints no burst rate (its loops take what they take); no axis may need a faster one.
    """

    name: ClassVar[str] = "dda"
    spacing: float = option(1e-2, "the longest time between two listed points", "s")
    pulses_per_count: int = option(50, "pulses that are sent for each count")
    rate: float = option(1e5, "of the pulses of a count", "1/s")

    def __post_init__(self) -> None:
        whole = isinstance(self.pulses_per_count, int) and self.pulses_per_count >= 1
        if not (0 < self.spacing < np.inf and 0 < self.rate < np.inf and whole):
            raise MotionError(
                f"spacing {self.spacing!r} s, rate {self.rate!r} 1/s and {self.pulses_per_count!r} pulses per count "
                "must be positive, the last a whole number, e.g. 10 ms, 100 kHz and 50"
            )

    def fire(self, motion: Motion, axes: Sequence[Axis], home: Array, clock_hz: int, tell: Progress) -> PulseSchedule:
        """Raises Infeasible for bursts that no step has time for or no axis takes, MotionError where no clock does."""
        if self.rate > clock_hz:
            rate, most = apart(self.rate, clock_hz)
            raise MotionError(f"rate {rate} 1/s must be at most the clock's {most} Hz")
        pulse = np.array([axis.pulse for axis in axes])
        moves = max(1, int(np.ceil(motion.duration / self.spacing)))
        gap = motion.duration / moves
        x = (motion.at(np.minimum(np.arange(moves + 1) * gap, motion.duration)).q - home) / pulse
        start = np.ceil(x[0] - 0.5).astype(np.int64)
        vectors = np.diff(np.rint((x - x[0]) / self.pulses_per_count).astype(np.int64), axis=0)
        most = abs(vectors).max(axis=1)
        self._refuse(motion, axes, vectors, gap)
        nth = np.arange(most.sum()) - np.repeat(np.cumsum(most) - most, most)
        began = (np.repeat(np.arange(moves), most) + nth / np.repeat(most, most)) * gap
        steps = dda(vectors)
        pieces = fit(motion, FINE * pulse)
        fired = []
        for k, axis in enumerate(axes):
            bound = 1.5 * self.pulses_per_count + 0.5 + _sagitta(pieces, k, gap) / axis.pulse
            ticks, sign = self._bursts(began, steps[:, k], clock_hz)
            fired.append(AxisPulses(axis.name, ticks, sign, int(start[k]), axis.pulse, float(home[k]), bound))
            tell(k + 1, len(axes))
        return PulseSchedule(clock_hz, tuple(fired), motion.duration, told(self))

    def _refuse(self, motion: Motion, axes: Sequence[Axis], vectors: Ticks, apart: float) -> None:
        rates = abs(vectors) * self.pulses_per_count / apart
        for axis in axes:
            if axis.max_pulse_rate is not None and self.rate > axis.max_pulse_rate:
                remedy = f"send the pulses of a count at {axis.max_pulse_rate:.10g} 1/s or less"
                raise Infeasible("pulse rate", axis.name, None, self.rate, axis.max_pulse_rate, "1/s", remedy)
        worst, k = map(int, np.unravel_index(rates.argmax(), rates.shape))
        highest = float(rates[worst, k])
        if highest > self.rate:
            remedy = f"slow the motion, send a count's pulses at {ceil(highest)} 1/s or more, or fewer of them"
            raise too_fast(motion, axes[k], worst * apart, highest, self.rate, remedy)

    def _bursts(self, began: Array, steps: Signs, clock_hz: int) -> tuple[Ticks, Signs]:
        """Ticks and directions of one axis from when its steps began (s)."""
        counted = np.flatnonzero(steps)
        within = np.arange(self.pulses_per_count) / self.rate
        ticks = np.floor((began[counted, None] + within) * clock_hz + 0.5).astype(np.int64)
        return ticks.ravel(), np.repeat(steps[counted], self.pulses_per_count)


def _sagitta(pieces: Pieces, axis: int, apart: float) -> float:
    """By how much (m or rad) the motion of an axis may leave the chords between points that are so far apart (s)."""
    bend, _ = largest(pieces, axis, 2)
    t, jump = jumps(pieces, axis)
    together = np.bincount((t / apart).astype(np.intp), weights=jump, minlength=1)
    return bend * apart**2 / 8 + float(together.max()) * apart / 4


def dda(vectors: ArrayLike) -> Signs:
    """What each axis counts (+1, 0, -1) at each step (K, n), from the counts (M, n) of moves one after the other.

    A move of at most k counts on any axis takes k steps. Each step adds an axis' counts to its sum; where that reaches
    k - 1, the axis counts and k is taken away [KMITL 2005, Module2]: f = ⌊(i·|counts| + 1)/k⌋ after i steps.
    """
    moves = np.asarray(vectors, np.int64)
    parts = [np.zeros((0, moves.shape[1]), np.int8)]
    for move in moves[moves.any(axis=1)]:
        k = int(abs(move).max())
        sums = np.arange(k + 1)[:, None] * abs(move) + min(1, k - 1)
        parts.append((np.diff(sums // k, axis=0) * np.sign(move)).astype(np.int8))
    return np.concatenate(parts)
