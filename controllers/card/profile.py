"""A move of the card as a value: its position as piecewise polynomials of time, and the pulses that it fires."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class Profile:
    """One move of channels in lanes: p(t) = start + Σᵢ (vᵢ τᵢ + aᵢ τᵢ²/2), τᵢ = clip(t − begin − Tᵢ, 0, lengthᵢ).

    Tᵢ is the sum of the lengths before piece i. p is held before the first piece, and after the last, where it is
    `target` exactly. Within a piece p runs one way. The position counter is the whole number nearest to p: so a pulse
    fires where p passes half way between two counts, and a share of a pulse (the generator's phase) is never lost.

    Lanes (…) are channels (n,), or runs by channels (B, n): all arithmetic is lane by lane.

    begin    (…) s, when each channel starts (channels of a queued move may start apart)
    start    (…) pulses, the command position then, with its share of a pulse
    target   (…) pulses, where the channel stands in the end
    lengths  (pieces, …) s; the last may be endless
    speeds   (pieces, …) pulses/s, signed, at the start of each piece
    rates    (pieces, …) pulses/s², constant in each piece
    """

    begin: Array
    start: Array
    target: Array
    lengths: Array
    speeds: Array
    rates: Array

    def __post_init__(self) -> None:
        for name in ("begin", "start", "target", "lengths", "speeds", "rates"):
            object.__setattr__(self, name, frozen(getattr(self, name), np.float64))

    @property
    def end(self) -> Array:
        """(…) s, when each channel stands on its target; inf where it runs on."""
        return np.asarray(self.begin + self.lengths.sum(0))

    def position(self, t: Array) -> Array:
        """Command position (N, …), pulses, at instants t (N,)."""
        t = t.reshape(t.shape + (1,) * self.begin.ndim)
        rest = t - self.begin
        travelled = np.zeros(rest.shape)
        for length, speed, rate in zip(self.lengths, self.speeds, self.rates, strict=True):
            if not length.any():
                continue
            tau = np.minimum(np.maximum(rest, 0.0), length)
            travelled += tau * (speed + tau * (rate / 2))
            rest -= length
        return np.where(t >= self.end, self.target, self.start + travelled)

    def counter(self, t: Array) -> np.ndarray:
        """Position counter (N, …), int64."""
        return np.rint(self.position(t)).astype(np.int64)

    def speed(self, t: float) -> Array:
        """Speed (…), pulses/s, signed, just after t."""
        rest, found = t - self.begin, np.zeros(self.begin.shape)
        for length, speed, rate in zip(self.lengths, self.speeds, self.rates, strict=True):
            found = np.where((rest >= 0) & (rest < length), speed + rest * rate, found)
            rest = rest - length
        return found

    def pulses(self, t: float) -> np.ndarray:
        """Pulses (…) fired until t in either direction, int64."""
        rest, position = t - self.begin, self.start
        before, fired = np.rint(position), np.zeros(self.begin.shape)
        for length, speed, rate in zip(self.lengths, self.speeds, self.rates, strict=True):
            tau = np.minimum(np.maximum(rest, 0.0), length)
            position = position + tau * (speed + tau * rate / 2)
            after = np.rint(position)
            fired += np.abs(after - before)
            rest, before = rest - length, after
        # the last position is the target, that of the sum but for rounding
        return np.asarray(fired + np.where(t >= self.end, np.abs(np.rint(self.target) - before), 0.0), np.int64)

    def pulse_times(self, lane: int | tuple[int, ...], until: float = np.inf) -> Array:
        """Instants (pulses,), s, at which a lane's pulses fire, `until` not included: p passes k + ½, in closed form.

        A way δ into piece i is made after τ = 2δ / (vᵢ ± √(vᵢ² + 2 aᵢ δ)), the root that stays exact as aᵢ → 0.
        """
        i = lane if isinstance(lane, tuple) else (lane,)
        found, t, p = [], float(self.begin[i]), float(self.start[i])
        pieces = (np.moveaxis(of, 0, -1)[i] for of in (self.lengths, self.speeds, self.rates))
        for length, v, a in zip(*(piece.tolist() for piece in pieces), strict=True):
            tau = min(length, max(until - t, 0.0))
            if tau <= 0:
                continue
            way = v * tau + a * tau * tau / 2
            sign = np.copysign(1.0, way)
            delta = _halves(p, p + way) - p
            root = np.abs(v) + np.sqrt(np.maximum(v * v + 2 * a * delta, 0.0))
            found.append(t + np.minimum(2 * sign * delta / np.where(root > 0, root, 1.0), tau))
            t, p = t + tau, p + way
        return np.concatenate(found) if found else np.empty(0)


def _halves(p: float, q: float) -> Array:
    """The half counts that are passed on the way from p to q, in order: as many as the nearest whole numbers change."""
    low, high = np.rint(p), np.rint(q)
    step = 1.0 if high >= low else -1.0
    return np.asarray(low + step * (np.arange(abs(int(high - low))) + 0.5))


def standstill(count: np.ndarray) -> Profile:
    """The move that is none: channels that stand on whole counts."""
    none = np.zeros((1, *count.shape))
    return Profile(np.zeros(count.shape), count, count, none, none, none)
