"""Classical profiles of speed from rest to rest, in units of the whole length and the whole
time.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from planner.timing.profile import Profile

# Parts of a quarter sine, each of constant jerk: s and ṡ are exact at their ends, and in between ṡ
# is off by at most (π/2/parts)³/124 of its largest, 2.3e-6.
SINE_PARTS = 24


@dataclass(frozen=True, slots=True)
class Shapes:
    """A family of profiles: draw(parameters) -> the one of duration 1 from 0 to 1.

    spans  of each parameter, the least and the largest value that make sense
    order  2 where its acceleration steps, so that no jerk limit could hold; 3 where it does not
    """

    name: str
    order: int
    draw: Callable[..., Profile]
    spans: tuple[tuple[float, float], ...]


def trapezoid(ramp: float) -> Profile:
    """Constant acceleration for the share `ramp` of the time, none, and the same down."""
    top = 1 / (1 - ramp)
    rate = top / ramp
    return _unit(np.array([ramp, 1 - 2 * ramp, ramp]), np.array([rate, 0.0, -rate]), np.zeros(3))


def s_curve(ramp: float, rounding: float) -> Profile:
    """Seven pieces of constant jerk; on each ramp the acceleration rises for the share `rounding`,
    holds, and falls.
    """
    rise, hold = ramp * rounding, ramp * (1 - 2 * rounding)
    rate = 1 / (1 - ramp) / (ramp * (1 - rounding))
    up = np.array([0.0, rate, rate])
    lengths = np.array([rise, hold, rise, 1 - 2 * ramp, rise, hold, rise])
    jerk = rate / rise * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    return _unit(lengths, np.concatenate([up, [0.0, 0.0], -up[1:]]), jerk)


def quarter_sine(ramp: float) -> Profile:
    """ṡ = V sin(ωt), constant, V cos(ω(t − t₂)), with ω = π/2/ramp and V = 1/(2/ω + 1 − 2 ramp).

    Source: [Sahbaz 2007, Appendix B].
    """
    omega = np.pi / 2 / ramp
    top = 1 / (2 / omega + 1 - 2 * ramp)
    angle = np.linspace(0.0, np.pi / 2, SINE_PARTS + 1)
    h = np.full(SINE_PARTS, ramp / SINE_PARTS)
    v, way = top * np.sin(angle), top / omega * -np.diff(np.cos(angle))
    # ṡ on a part: through its values at both ends, and as much way as the sine makes
    a = (6 * way / h - 4 * v[:-1] - 2 * v[1:]) / h
    j = 2 * (v[1:] - v[:-1] - a * h) / h**2
    lengths = np.concatenate([h, [1 - 2 * ramp], h])
    ends = a + j * h
    return _unit(
        lengths, np.concatenate([a, [0.0], -ends[::-1]]), np.concatenate([j, [0.0], j[::-1]])
    )


def _unit(h: Array, a: Array, j: Array) -> Profile:
    """From rest at 0: durations, and of each piece the acceleration at its start and the jerk."""
    keep = h > 1e-12
    h, a, j = h[keep], a[keep], j[keep]
    s, v = [0.0], [0.0]
    # in Python numbers: searches draw thousands of profiles of a few pieces, for which arrays take
    # longer
    for each_h, each_a, each_j in zip(h.tolist(), a.tolist(), j.tolist(), strict=True):
        s.append(s[-1] + each_h * (v[-1] + each_h * (each_a / 2 + each_h * each_j / 6)))
        v.append(v[-1] + each_h * (each_a + each_h * each_j / 2))
    return Profile(np.array(s[:-1]), np.array(v[:-1]), a, j, h, np.zeros(len(h), int))


# A ramp of a hundred-thousandth of the time, or half of it; a rounding of a hundredth of the ramp,
# or half of it.
RAMP_RANGE, ROUNDING_RANGE = (1e-5, 0.5), (1e-2, 0.5)
TRAPEZOID = Shapes("trapezoid", 2, trapezoid, (RAMP_RANGE,))
S_CURVE = Shapes("s-curve", 3, s_curve, (RAMP_RANGE, ROUNDING_RANGE))
QUARTER_SINE = Shapes("quarter-sine", 2, quarter_sine, (RAMP_RANGE,))
