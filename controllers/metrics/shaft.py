"""What a motion costs the drives: torque, and time at its limit.

How much the shafts shake: the jerk of a shaft, and what of its error is faster than the host.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from controllers.rig import Rig
from kinematics.foundation.arrays import Array, freeze_array

AT_LIMIT = 1 - 1e-9
"""Share of the limit from which a torque counts as being at it: rounding away from 1."""
BLOCK = 512
"""Samples looked at together: a few megabytes for a batch of a thousand runs."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Torque (or force) over its limit in one run: RMS and peak; saturation, the share of time at the limit; (n,)."""

    torque_rms: Array
    torque_peak: Array
    saturation: Array


def torque_limits(rigs: Sequence[Rig]) -> Array:
    """(B, n) N or N·m: of a servo its torque limit, of a stepper the largest of its curve, whatever its speed."""
    return np.array([[drive.torque_limit for drive in rig.drives] for rig in rigs])


def efforts(torque: Array, limit: Array) -> tuple[Effort, ...]:
    """Of B runs: torque (N, B, n) and its limit (B, n), N or N·m."""
    squares, at_limit, peak = np.zeros_like(limit), np.zeros_like(limit), np.zeros_like(limit)
    for start in range(0, len(torque), BLOCK):
        size = np.abs(torque[start : start + BLOCK])
        squares += np.einsum("tbn,tbn->bn", size, size)
        at_limit += np.count_nonzero(size >= AT_LIMIT * limit, axis=0)
        peak = np.maximum(peak, size.max(0))
    rms, peak, share = np.sqrt(squares / len(torque)) / limit, peak / limit, at_limit / len(torque)
    return tuple(Effort(*map(freeze_array, each)) for each in zip(rms, peak, share, strict=True))


CHUNK = 1 << 20
"""Samples transformed together: a few times what a processor's cache holds."""
LOBE = 2
"""Half the width of a Hann window's main lobe, in bins."""


@dataclass(frozen=True, slots=True)
class Vibration:
    """Of the shafts of one run, from its record of true positions (no encoder, no rounding).

    sample    s between the samples
    above     Hz, 1/dt of the host
    jerk_rms  (n,) m/s³ or rad/s³: third differences over sample³, which see a tone at f as
              (sin(π f sample)/(π f sample))³ of its jerk
    power     (n,) m² or rad²: mean square of actual − planned position at frequencies from `above` on; nan where the
              samples are too far apart to see any
    """

    sample: float
    above: float
    jerk_rms: Array
    power: Array


def vibrations(t: Array, actual: Array, planned: Array, pulse: Array, host_step: float) -> tuple[Vibration, ...]:
    """Of B runs: actual (N, B, n) and planned (N, n) positions in pulses at t (N,), s; pulse (n,), m or rad.

    Spectrum of the whole record, X = rfft(w (e − ē)) with Hann's window w: power = 2 Σ |X_k|² / (N Σ w²) over the bins
    with f_k ≥ 1/host_step, less the half width of the window's lobe: what repeats at every step of the host counts. A
    tone of amplitude A there has A²/2.
    """
    n, (runs, axes) = len(t), actual.shape[1:]
    sample, above = float(t[1] - t[0]), 1 / host_step
    first = int(np.ceil(above * n * sample - 1e-6)) - LOBE
    window = np.sin(np.pi * np.arange(n) / n) ** 2
    weight = np.full(n // 2 + 1, 2.0)
    weight[0], weight[-1] = 1.0, 1.0 if n % 2 == 0 else 2.0
    jerk, power = np.empty((runs, axes)), np.full((runs, axes), np.nan)
    at_once = max(1, CHUNK // (n * axes))
    for start in range(0, runs, at_once):
        some = slice(start, start + at_once)
        lanes = np.ascontiguousarray(np.moveaxis(actual[:, some], 0, -1))
        jerk[some] = np.sqrt(np.mean(np.diff(lanes, 3) ** 2, -1)) / sample**3 if n > 3 else np.nan
        if LOBE < first < len(weight) - 1:
            error = lanes - planned.T
            error -= error.mean(-1, keepdims=True)
            spectrum = np.fft.rfft(error * window)[..., first:]
            power[some] = (spectrum.real**2 + spectrum.imag**2) @ weight[first:] / (n * np.sum(window**2))
    jerk, power = jerk * pulse, power * pulse**2
    return tuple(Vibration(sample, above, freeze_array(j), freeze_array(p)) for j, p in zip(jerk, power, strict=True))
