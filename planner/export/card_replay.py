"""Calls of the motion cards replayed in closed form, and the largest by which they are from the motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from planner.export.format import ExportSource
from planner.pulses.generation.pieces import FIT_TOLERANCE, UNSEEN_FACTOR, Pieces, cut_monotone, fit, shift_polynomials


@dataclass(frozen=True, slots=True)
class Call:
    """One call: at `time` (s) `function`(axis, position, start, top, tacc, tdec), in pulses, pulses/s and s."""

    time: float
    name: str
    function: str
    axis: int
    position: int
    start: float
    top: float
    tacc: float
    tdec: float = 0.0


def wired_counts(source: ExportSource, k: int, t: Array) -> tuple[Array, Array]:
    """Position (pulses) and speed (pulses/s) of an axis at instants t (N,), in the counts of its wiring."""
    axis, state = source.machine.axes[k], source.counted.at(t)
    scale = axis.direction / axis.pulse
    return (state.q[:, k] - source.machine.home_q[k]) * scale, state.qd[:, k] * scale


def replay_error(source: ExportSource, calls: Sequence[Call]) -> float:
    """Pulses by which command positions of the calls are from the motion at most, over continuous time.

    p(τ) = p₀ ± min(D, start τ + (max - start) τ²/(2 tacc)), then waiting. Between all instants at which either changes
    its piece, p - x is a quintic: it is cut where it turns round, and largest at one of the cuts. The motion's own
    quintics are true to some 1e-6 pulse, which is added, as `planner.pulses.generation.levels` does.
    """
    pieces = fit(source.counted, FIT_TOLERANCE * np.array([axis.pulse for axis in source.machine.axes]))
    return max((_axis_replay_error(source, pieces, k, calls) for k in range(len(source.machine.axes))), default=0.0)


def _axis_replay_error(source: ExportSource, pieces: Pieces, k: int, calls: Sequence[Call]) -> float:
    axis, duration = source.machine.axes[k], source.trajectory.duration
    own = [call for call in calls if call.name == axis.name]
    moves = _moves(own, float(source.pulses.axes[k].start * axis.direction))
    cuts = np.concatenate([pieces.start, [duration], moves.begin, moves.begin + moves.ramp, moves.end])
    cuts = np.unique(np.maximum(cuts, 0.0))
    lo, span = cuts[:-1], np.diff(cuts)
    middle = lo + span / 2
    of = np.searchsorted(pieces.start, middle, side="right") - 1
    x = shift_polynomials(
        pieces.coefficients[k][:, of], (lo - pieces.start[of]) / pieces.length[of], span / pieces.length[of]
    )
    rests = middle > duration
    x[0, rests], x[1:, rests] = pieces.coefficients[k][:, -1].sum(), 0.0
    x[0] -= source.machine.home_q[k]
    away = x * (-axis.direction / axis.pulse)
    away[:3] += moves.at(lo, span, middle)
    slack = (pieces.noise[k] + UNSEEN_FACTOR * pieces.error[k]) / axis.pulse
    turns = cut_monotone(lo, span, away, slack).coefficients
    return float(max(abs(turns[0]).max(), abs(turns.sum(axis=0)).max()) + 2 * slack)


@dataclass(frozen=True, slots=True)
class _Moves:
    """The moves of one axis: when each begins (s), how long its ramp is, when it has arrived, and from where to where.

    In front of them stands one that goes nowhere, from before the start on.
    """

    begin: Array
    ramp: Array
    end: Array
    before: Array
    target: Array
    start: Array
    top: Array

    def at(self, lo: Array, span: Array, middle: Array) -> Array:
        """Coefficients (3, S) in v of p(lo + span v), v in [0, 1], of intervals inside which nothing changes."""
        nth: NDArray[np.intp] = np.searchsorted(self.begin, middle, side="right") - 1
        begin, ramp, u, w = (each[nth] for each in (self.begin, self.ramp, self.start, self.top))
        gain = (w - u) / ramp
        tau, ramping = lo - begin, middle < begin + ramp
        way = np.where(ramping, tau * (u + gain * tau / 2), ramp * (u + w) / 2 + w * (tau - ramp))
        speed, bend = np.where(ramping, u + gain * tau, w), np.where(ramping, gain, 0.0)
        run: Array = np.sign(self.target - self.before)[nth] * np.stack((way, speed * span, bend * span**2 / 2))
        run[0] += self.before[nth]
        waits = middle >= self.end[nth]
        run[0, waits], run[1:, waits] = self.target[nth[waits]], 0.0
        return run


def _moves(own: Sequence[Call], at_first: float) -> _Moves:
    numbers = [(call.time, call.tacc, call.position, call.start, call.top) for call in own]
    begin, ramp, target, u, w = np.array([(-1.0, 1.0, at_first, 0.0, 1.0), *numbers]).T
    before = np.concatenate([[at_first], target[:-1]])
    far, ramped, gain = abs(target - before), ramp * (u + w) / 2, (w - u) / ramp
    # The smaller root of u τ + gain τ²/2 = D, in the form that loses no digits.
    root = np.sqrt(np.maximum(u**2 + 2 * gain * far, 0.0))
    within = 2 * far / np.maximum(u + root, np.finfo(float).tiny)
    end = begin + np.where(far <= ramped, np.minimum(within, ramp), ramp + (far - ramped) / w)
    return _Moves(begin, ramp, end, before, target, u, w)
