"""A move of the card as a value: its position as a piecewise quadratic of time, and the pulses that it fires."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class Profile:
    """One move of channels in lanes: p(t) = start + σ Σᵢ (vᵢ τᵢ + aᵢ τᵢ²/2), τᵢ = clip(t − begin − Tᵢ, 0, lengthᵢ).

    Tᵢ is the sum of the lengths before piece i, σ = ±1 the direction. p is held before the first and after the last
    piece, where it is `target` exactly.

    Lanes (…) are channels (n,), or runs by channels (B, n): all arithmetic is lane by lane.

    begin    (…) s, when each channel starts (channels of a queued move may start apart)
    start    (…) pulses, the command position then, with its share of a pulse
    count    (…) int64 pulses, the position counter then
    target   (…) int64 pulses
    lengths  (pieces, …) s
    speeds   (pieces, …) pulses/s ≥ 0 at the start of each piece
    rates    (pieces, …) pulses/s², constant in each piece
    """

    begin: Array
    start: Array
    count: np.ndarray
    target: np.ndarray
    lengths: Array
    speeds: Array
    rates: Array

    def __post_init__(self) -> None:
        for name in ("begin", "start", "lengths", "speeds", "rates"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))
        for name in ("count", "target"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.int64))

    @property
    def direction(self) -> Array:
        """(…) sign of target − start; +1 where there is nothing to move."""
        return np.where(self.target < self.start, -1.0, 1.0)

    @property
    def end(self) -> Array:
        """(…) s, when each channel stands on its target."""
        return np.asarray(self.begin + self.lengths.sum(0))

    def position(self, t: Array) -> Array:
        """Command position (N, …), pulses, at instants t (N,)."""
        t = t.reshape(t.shape + (1,) * self.begin.ndim)
        rest = t - self.begin
        travelled = np.zeros(rest.shape)
        for length, speed, rate in zip(self.lengths, self.speeds, self.rates, strict=True):
            tau = np.minimum(np.maximum(rest, 0.0), length)
            travelled += tau * (speed + tau * rate / 2)
            rest = rest - length
        return np.where(t >= self.end, self.target, self.start + self.direction * travelled)

    def counter(self, t: Array) -> np.ndarray:
        """Position counter (N, …), int64: a pulse fires when the command position is half a pulse ahead of it.

        So the counter is the nearest whole number to the command position, and equals the target when the move ends.
        """
        sign = self.direction
        ahead = np.floor(sign * (self.position(t) - self.count) + 0.5)
        return np.asarray(self.count + (sign * np.maximum(ahead, 0.0)).astype(np.int64))

    def pulse_times(self, lane: int | tuple[int, ...]) -> Array:
        """Instants (pulses,), s, at which a lane's pulses fire: p passes count ± ½, ± 3/2, … in closed form.

        A level δ into piece i is reached after τ = 2δ / (vᵢ + √(vᵢ² + 2 aᵢ δ)), the root that stays exact as aᵢ → 0.
        """
        i = lane if isinstance(lane, tuple) else (lane,)
        length, speed, rate = (np.moveaxis(of, 0, -1)[i] for of in (self.lengths, self.speeds, self.rates))
        passed = np.concatenate([[0.0], np.cumsum(length * (speed + length * rate / 2))])
        elapsed = np.concatenate([[0.0], np.cumsum(length)])
        pulses = abs(int(self.target[i]) - int(self.count[i]))
        levels = self.direction[i] * (self.count[i] - self.start[i]) + np.arange(pulses) + 0.5
        # the first level may lie a rounding behind the start, the last a rounding beyond the end
        levels = np.clip(levels, 0.0, passed[-1])
        piece = np.clip(np.searchsorted(passed, levels, side="right") - 1, 0, len(length) - 1)
        v, a, delta = speed[piece], rate[piece], levels - passed[piece]
        root = v + np.sqrt(np.maximum(v * v + 2 * a * delta, 0.0))
        return np.asarray(self.begin[i] + elapsed[piece] + 2 * delta / np.where(root > 0, root, 1.0))


def standstill(count: np.ndarray) -> Profile:
    """The move that is none: channels that stand on whole counts."""
    none = np.zeros((1, *count.shape))
    return Profile(np.zeros(count.shape), count, count, count, none, none, none)


def trapezoid(
    begin: Array, start: Array, count: np.ndarray, target: np.ndarray, v0: Array, v1: Array, tacc: float, tdec: float
) -> Profile:
    """Speed from v0 to v1 linearly within tacc, held, and back to v0 within tdec before the target; there it stops.

    Over the distance D = |target − start| the ramps take d = (v0 + v1)/2 · (tacc + tdec). If D < d, the rates are kept
    and the top speed is what can be reached, vp² = v0² + 2 D (v1 − v0)/(tacc + tdec), each ramp being shortened by the
    factor λ = (vp − v0)/(v1 − v0) = 2 D/((tacc + tdec)(v0 + vp)). All of it holds for v1 < v0 too, where the ramp leads
    downwards.

    v0, v1  (…) pulses/s > 0;  tacc, tdec  s ≥ 0;  the others as in `Profile`
    """
    distance, ramps = np.abs(target - start), tacc + tdec
    needed = (v0 + v1) / 2 * ramps
    short = distance < needed
    # without ramps no move is short: any divisor serves
    time = ramps if ramps > 0 else 1.0
    top = np.where(short, np.sqrt(np.maximum(v0 * v0 + 2 * distance * (v1 - v0) / time, 0.0)), v1)
    share = np.where(short, 2 * distance / (time * (v0 + top)), 1.0)
    held = np.where(short, 0.0, (distance - needed) / v1)
    up, down = share * tacc, share * tdec
    rate_up, rate_down = (v1 - v0) / (tacc or 1.0), (v0 - v1) / (tdec or 1.0)
    lengths, speeds, rates = (up, held, down), (v0, top, top), (rate_up, np.zeros_like(held), rate_down)
    return Profile(begin, start, count, target, np.stack(lengths), np.stack(speeds), np.stack(rates))
