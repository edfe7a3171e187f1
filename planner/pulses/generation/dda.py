"""The firing rule `dda`: counts of many pulses between listed points, spread by a digital
differential analyser.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import option
from kinematics.foundation.units import format_distinct, round_up_digits
from kinematics.machine.axis import Axis
from planner.place import Infeasible
from planner.pulses.generation.firing_rule import Rule, describe_rule, require_whole
from planner.pulses.generation.motion_parts import Fired, MotionPart
from planner.pulses.generation.pieces import (
    FIT_TOLERANCE,
    Pieces,
    bound_rate,
    find_rate_jumps,
    fit,
    rate_error,
)
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, Signs, Ticks

DEFAULT_RATE = 1e5
"""1/s: the rate of bursts where no axis states what it takes."""


@dataclass(frozen=True, slots=True)
class Dda(Rule):
    """DDA between listed points: the axis with the most counts steps evenly, the others follow
    [KMITL 2005, Module2].

    - The motion is listed at even times, no further apart than `spacing`; a point is the nearest
      whole count from the start. Its DDA steps share the time to the next point evenly, each
      sending its counts at once.
    - A count is sent as a burst of `pulses_per_count` pulses at `rate`. The source has 500 counts
      to a unit of length and 50 pulses to a count, so 25 000 pulses to a unit; here a pulse is the
      axis', and so a count 50 of them.
    - |count - x| ≤ 1.5·pulses_per_count + ½ + max|ẍ|·spacing²/8, + one tick's travel: one count of
      the DDA, half a count of the points, half a pulse of the start, and the chord between the
      points (of which speeds that jump, as where the error of a screw bends, take a quarter of the
      spacing). So is the final count off, but where the motion ends a whole number of counts from
      its start.
    Assumption: the source prints no burst rate (its loops take what they take). Unless one is given
    it is the highest
    that all axes take, and axes that state one are planned 2·pulses_per_count/spacing slower:
    rounded to whole counts,
    a move between two points may ask for up to that much more.
    """

    name: ClassVar[str] = "dda"
    spacing: float = option(1e-2, "longest time between two listed points", "s")
    pulses_per_count: int = option(50, "pulses sent for each count")
    rate: float | None = option(
        None,
        "rate of the pulses of a count. Default: the highest that all axes accept, else 100 kHz",
        "1/s",
    )

    @property
    def whole_reason(self) -> str:
        return "it shares the time of the whole evenly among the points that it lists"

    def __post_init__(self) -> None:
        whole = isinstance(self.pulses_per_count, int) and self.pulses_per_count >= 1
        if not (
            0 < self.spacing < np.inf and (self.rate is None or 0 < self.rate < np.inf) and whole
        ):
            raise MotionError(
                f"spacing {self.spacing!r} s, rate {self.rate!r} 1/s and {self.pulses_per_count!r} pulses per count "
                "must be positive, the last a whole number, e.g. 10 ms, 100 kHz and 50"
            )

    def rates(self, axes: Sequence[Axis], clock_hz: int) -> list[float]:
        held = Rule.rates(self, axes, clock_hz)
        if self.rate is not None:
            return held
        most = self._burst_rate(axes, clock_hz) - 2 * self.pulses_per_count / self.spacing
        if most <= 0 and min(held) < np.inf:
            slowest = axes[int(np.argmin(held))]
            raise MotionError(
                f"axis {slowest.name} takes {slowest.pulse_rate:.6g} pulses/s: not the two counts of "
                f"{self.pulses_per_count} pulses that may fall between two points {self.spacing:g} s apart; give rule "
                f"dda a spacing above {2e3 * self.pulses_per_count / slowest.pulse_rate:.4g} ms, as in "
                f'"dda:spacing={round_up_digits(8e3 * self.pulses_per_count / slowest.pulse_rate)} ms", or fewer '
                "pulses_per_count"
            )
        return [rate if rate == np.inf else min(rate, most) for rate in held]

    def fire(self, part: MotionPart) -> Fired:
        """Raises Infeasible for bursts that no step has time for or no axis takes, MotionError
        where no clock does, and for a part of a motion.
        """
        require_whole(self, part)
        motion, axes, home, clock_hz = part.motion, part.axes, part.home, part.clock_hz
        rate = self._burst_rate(axes, clock_hz)
        if rate > clock_hz:
            given, most = format_distinct(rate, clock_hz)
            raise MotionError(f"rate {given} 1/s must be at most the clock's {most} Hz")
        pulse = np.array([axis.pulse for axis in axes])
        moves = max(1, int(np.ceil(motion.duration / self.spacing)))
        gap = motion.duration / moves
        x = (motion.at(np.minimum(np.arange(moves + 1) * gap, motion.duration)).q - home) / pulse
        start = np.ceil(x[0] - 0.5).astype(np.int64)
        vectors = np.diff(np.rint((x - x[0]) / self.pulses_per_count).astype(np.int64), axis=0)
        most = abs(vectors).max(axis=1)
        self._refuse(motion, axes, vectors, gap, rate, clock_hz)
        nth = np.arange(most.sum()) - np.repeat(np.cumsum(most) - most, most)
        began = (np.repeat(np.arange(moves), most) + nth / np.repeat(most, most)) * gap
        steps = spread_counts(vectors)
        pieces = fit(motion, FIT_TOLERANCE * pulse)
        fired = []
        for k, axis in enumerate(axes):
            bound = 1.5 * self.pulses_per_count + 0.5 + _sagitta(pieces, k, gap) / axis.pulse
            ticks, sign = self._bursts(began, steps[:, k], rate, clock_hz)
            fired.append(
                AxisPulses(axis.name, ticks, sign, int(start[k]), axis.pulse, float(home[k]), bound)
            )
            part.tell(k + 1, len(axes))
        return Fired(tuple(fired), (0,) * len(fired), rule=describe_rule(replace(self, rate=rate)))

    def _burst_rate(self, axes: Sequence[Axis], clock_hz: int) -> float:
        """1/s: the rate given, or the highest that all axes take, or where none states one the
        usual.
        """
        held = self.rate or min(Rule.rates(self, axes, clock_hz), default=np.inf)
        return held if held < np.inf else min(DEFAULT_RATE, clock_hz)

    def _refuse(
        self,
        motion: AxesMotion,
        axes: Sequence[Axis],
        vectors: Ticks,
        gap: float,
        rate: float,
        clock_hz: int,
    ) -> None:
        rates = abs(vectors) * self.pulses_per_count / gap
        for axis in axes:
            if rate > axis.pulse_rate:
                slower = axis.held_rate(clock_hz)
                remedy = f"send the pulses of a count at {slower:.10g} 1/s or less{self._describe_variant(rate=slower)}"
                raise Infeasible(
                    "pulse rate", axis.name, None, rate, axis.pulse_rate, "1/s", remedy
                )
        worst, k = map(int, np.unravel_index(rates.argmax(), rates.shape))
        highest = float(rates[worst, k])
        if highest > rate:
            faster, wider = ceil(highest), 4 * self.spacing
            help_ = (
                f"send a count's pulses at {faster} 1/s or more{self._describe_variant(rate=float(faster))}"
                if faster <= min(axis.pulse_rate for axis in axes)
                else f"list points {1e3 * wider:g} ms apart{self._describe_variant(spacing=wider)}"
            )
            raise rate_error(
                motion,
                axes[k],
                worst * gap,
                highest,
                rate,
                f"slow the motion, {help_}, or fewer of them for a count",
            )

    def _describe_variant(self, **changed: Any) -> str:
        """This rule with other options, as the command line and `find_rule` take it."""
        return f' (rule "{describe_rule(replace(self, **changed))}")'

    def _bursts(
        self, began: Array, steps: Signs, rate: float, clock_hz: int
    ) -> tuple[Ticks, Signs]:
        """Ticks and directions of one axis from when its steps began (s)."""
        counted = np.flatnonzero(steps)
        within = np.arange(self.pulses_per_count) / rate
        ticks = np.floor((began[counted, None] + within) * clock_hz + 0.5).astype(np.int64)
        return ticks.ravel(), np.repeat(steps[counted], self.pulses_per_count)


def _sagitta(pieces: Pieces, axis: int, apart: float) -> float:
    """By how much (m or rad) the motion of an axis may leave the chords between points that are so
    far apart (s).
    """
    bend, _ = bound_rate(pieces, axis, 2)
    t, jump = find_rate_jumps(pieces, axis)
    together = np.bincount((t / apart).astype(np.intp), weights=jump, minlength=1)
    return bend * apart**2 / 8 + float(together.max()) * apart / 4


def spread_counts(vectors: ArrayLike) -> Signs:
    """What each axis counts (+1, 0, -1) at each step (K, n), from the counts (M, n) of moves one
    after the other.

    A move of at most k counts on any axis takes k steps. Each step adds an axis' counts to its sum;
    where that reaches k - 1, the axis counts and k is taken away [KMITL 2005, Module2]: f =
    ⌊(i·|counts| + 1)/k⌋ after i steps.
    """
    moves = np.asarray(vectors, np.int64)
    parts = [np.zeros((0, moves.shape[1]), np.int8)]
    for move in moves[moves.any(axis=1)]:
        k = int(abs(move).max())
        sums = np.arange(k + 1)[:, None] * abs(move) + min(1, k - 1)
        parts.append((np.diff(sums // k, axis=0) * np.sign(move)).astype(np.int8))
    return np.concatenate(parts)
