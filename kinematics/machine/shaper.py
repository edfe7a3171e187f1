"""Input shapers: the impulses that a command is convolved with so that a vibration of the load
cancels itself.

q_s(t) = Σ Aᵢ q(t − tᵢ) with Aᵢ > 0 and Σ Aᵢ = 1. A mode of frequency f and damping ζ that is driven
by q_s is left with

    V(f, ζ) = e^(−ζ ω tₙ) √(C² + S²),   C + i S = Σ Aᵢ e^(ζ ω tᵢ) e^(i ω √(1 − ζ²) tᵢ),   ω = 2π f

times the amplitude of an impulse that is not shaped [Singer and Seering 1990]. With K = e^(−ζ π/√(1
− ζ²)) and the damped period T = 1/(f √(1 − ζ²)), the impulses are (`IMPULSES`):

    zv    1, K                                     at 0, T/2          V = 0 at f           [Singer
          and Seering 1990]
    zvd   1, 2 K, K²                               at 0, T/2, T       V and ∂V/∂f = 0 at f [Singer
          and Seering 1990]
    mzv   1 − 1/√2, (√2 − 1) k, (1 − 1/√2) k²      at 0, 3T/8, 3T/4   V = 0 at f, k = K^(3/4), as
          Klipper defines it
    ei    (1 + V)/4, (1 − V) K/2, (1 + V) K²/4     at 0, T/2, T       V ≤ the tolerance about f
          [Singhose et al. 1994],
                                                   whose undamped impulses are damped here as those
                                                   of zvd are

Against several vibrations a command is convolved with a shaper for each, in turn: amplitudes
multiply, times add, and V of the whole is the product of theirs, so that each keeps its zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from functools import reduce
from math import exp, pi, prod, sqrt
from typing import Literal, get_args

import numpy as np

from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest

ShaperKind = Literal["zv", "zvd", "mzv", "ei"]
LEAST_FREQUENCY, MOST_FREQUENCY = 0.1, 1e5
"""Hz. Below, a shaper lasts longer than most motions; above, no clock tells its impulses apart."""
MOST_DAMPING = 0.9
DEFAULT_TOLERANCE, MOST_TOLERANCE = 0.05, 0.5
MOST_IMPULSES = 64
"""Of shapers one after the other: each is a copy of the motion that every proof looks at."""
SAME_TIME = 1e-12
"""s: impulses no farther apart than that are one."""


def _zv(k: float, tolerance: float) -> tuple[list[float], list[float]]:
    return [1.0, k], [0.0, 0.5]


def _zvd(k: float, tolerance: float) -> tuple[list[float], list[float]]:
    return [1.0, 2 * k, k * k], [0.0, 0.5, 1.0]


def _mzv(k: float, tolerance: float) -> tuple[list[float], list[float]]:
    outer, step = 1 - sqrt(0.5), k**0.75
    return [outer, (sqrt(2) - 1) * step, outer * step * step], [0.0, 0.375, 0.75]


def _ei(k: float, tolerance: float) -> tuple[list[float], list[float]]:
    outer = (1 + tolerance) / 4
    return [outer, (1 - tolerance) / 2 * k, outer * k * k], [0.0, 0.5, 1.0]


IMPULSES: dict[ShaperKind, Callable[[float, float], tuple[list[float], list[float]]]] = {
    "zv": _zv,
    "zvd": _zvd,
    "mzv": _mzv,
    "ei": _ei,
}
"""By kind: K and the tolerance -> amplitudes, whose sum is not 1 yet, and times in damped
periods.
"""


@dataclass(frozen=True, slots=True)
class Shaper:
    """A shaper of an axis, for a mode of a frequency (Hz) and a damping ratio.

    tolerance  of "ei": the share of the unshaped vibration that is left at the frequency itself,
               undamped
    Raises MotionError for a kind that is none, and numbers out of range.
    """

    kind: ShaperKind
    frequency: float
    damping: float = 0.0
    tolerance: float = DEFAULT_TOLERANCE

    def __post_init__(self) -> None:
        kinds = get_args(ShaperKind)
        if not isinstance(self.kind, str) or self.kind not in kinds:
            known = f"{', '.join(kinds)}{nearest(str(self.kind)[:60], kinds)}"
            raise MotionError(f"shaper: kind {self.kind!r:.60} is none of {known}")
        for name, least, most, unit in (
            ("frequency", LEAST_FREQUENCY, MOST_FREQUENCY, " Hz"),
            ("damping", 0.0, MOST_DAMPING, ""),
            ("tolerance", 0.0, MOST_TOLERANCE, ""),
        ):
            value = float(
                finite_array(
                    getattr(self, name), f"shaper {self.kind}: {name}", (), unit=unit.strip()
                )
            )
            if not least <= value <= most:
                raise MotionError(
                    f"shaper {self.kind}: {name} {value:g}{unit} must be from {least:g} to {most:g}{unit}"
                )
            object.__setattr__(self, name, value)
        if self.kind != "ei" and self.tolerance != DEFAULT_TOLERANCE:
            raise MotionError(
                f'shaper {self.kind}: tolerance {self.tolerance:g} is of the shaper ei alone: omit it, or use kind "ei"'
            )

    @property
    def impulses(self) -> tuple[Array, Array]:
        """Amplitudes (n,), whose sum is 1, and times (n,) s from 0."""
        root = sqrt(1 - self.damping**2)
        amplitudes, times = (
            np.array(each)
            for each in IMPULSES[self.kind](exp(-self.damping * pi / root), self.tolerance)
        )
        return freeze_array(amplitudes / amplitudes.sum()), freeze_array(
            times / (self.frequency * root)
        )

    @property
    def parts(self) -> "tuple[Shaper, ...]":
        """Itself alone."""
        return (self,)

    @property
    def delay(self) -> float:
        """s: Σ Aᵢ tᵢ, by which the shaped motion is late on average."""
        amplitudes, times = self.impulses
        return float(amplitudes @ times)

    def vibration(self, frequency: float, damping: float) -> float:
        """V of a mode: the share of the vibration of an impulse that is not shaped."""
        amplitudes, times = self.impulses
        omega = 2 * pi * frequency
        turning = complex(damping * omega, omega * sqrt(1 - damping**2))
        left = abs(amplitudes @ np.exp(turning * times))
        return float(exp(-damping * omega * times[-1]) * left)

    def __str__(self) -> str:
        return f"{self.kind} {self.frequency:g} Hz" + (
            f", damping {self.damping:g}" if self.damping else ""
        )


@dataclass(frozen=True, slots=True)
class ShaperSeries:
    """Several shapers of an axis, one after the other: one for each vibration that it drives.

    parts  two or more; in which order does not matter
    Raises MotionError for fewer, and for more impulses in all than `MOST_IMPULSES`.
    """

    parts: tuple[Shaper, ...]

    def __post_init__(self) -> None:
        given: object = self.parts
        parts = tuple(given) if isinstance(given, list | tuple) else ()
        if len(parts) < 2 or not all(isinstance(part, Shaper) for part in parts):
            raise MotionError(
                f"shapers one after the other must be two or more of Shaper, not {given!r:.100}"
            )
        object.__setattr__(self, "parts", tuple(sorted(parts, key=astuple)))
        count = prod(len(part.impulses[1]) for part in self.parts)
        if count > MOST_IMPULSES:
            raise MotionError(
                f"shapers {self}: {count} impulses in all, and at most {MOST_IMPULSES} are taken; use fewer shapers, "
                "or zv, which has the fewest"
            )

    @property
    def impulses(self) -> tuple[Array, Array]:
        """Amplitudes (n,), whose sum is 1, and times (n,) s from 0: the convolution of those of its
        parts.
        """
        amplitudes, times = reduce(_convolve, (part.impulses for part in self.parts))
        return freeze_array(amplitudes), freeze_array(times)

    @property
    def delay(self) -> float:
        """s: Σ Aᵢ tᵢ, by which the shaped motion is late on average."""
        return sum(part.delay for part in self.parts)

    def vibration(self, frequency: float, damping: float) -> float:
        """V of a mode: the product of those of its parts."""
        return prod(part.vibration(frequency, damping) for part in self.parts)

    def __str__(self) -> str:
        return " and ".join(map(str, self.parts))


def _convolve(one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
    """Amplitudes and rising times of impulses after impulses; those at one time are one."""
    times = np.add.outer(one[1], other[1]).ravel()
    order = np.argsort(times, kind="stable")
    times, amplitudes = times[order], np.multiply.outer(one[0], other[0]).ravel()[order]
    first = np.flatnonzero(np.diff(times, prepend=-np.inf) > SAME_TIME)
    return np.add.reduceat(amplitudes, first), times[first]


def join_shapers(shapers: Sequence[Shaper]) -> Shaper | ShaperSeries | None:
    """What convolves with all of them: None of none, one itself, a series of several."""
    return ShaperSeries(tuple(shapers)) if len(shapers) > 1 else next(iter(shapers), None)
