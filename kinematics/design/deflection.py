"""The deflection of a beam that carries the platform, with its Abbe lever: a source of the accuracy
budget.

The beam is simply supported, and sinks and tilts under a load that travels along it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.design.accuracy import UNIFORM, Effect, require_nonnegative
from kinematics.foundation.arrays import Array, finite_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.pose import Pose

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine


@dataclass(frozen=True, slots=True)
class Beam:
    """A beam on two supports: span m between them, modulus Pa of its material, second moment m⁴ of
    its section.

    Euler and Bernoulli, small deflections: E I y″ = M, no shear. Sources: [Sasidhar 1981, Appendix
    D], Timoshenko.
    """

    span: float
    modulus: float
    second_moment: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not finite_array(value, f"beam: {field.name}", ()) > 0:
                raise MotionError(
                    f"beam: {field.name} {value} must be positive and finite (m, Pa, m⁴)"
                )

    def deflection(self, load: float, place: ArrayLike) -> Array:
        """m downwards under a load W (N) at c (m) from the first support: W c² (l − c)² / (3 E I
        l).
        """
        c = self._check_place(place)
        return np.asarray(
            _check_load(load) * c**2 * (self.span - c) ** 2 / (3 * self._stiffness * self.span)
        )

    def slope(self, load: float, place: ArrayLike) -> Array:
        """rad under a load W (N) at c (m), downwards along the beam positive: W c (l − c)(l − 2c) /
        (3 E I l).
        """
        c = self._check_place(place)
        return np.asarray(
            _check_load(load)
            * c
            * (self.span - c)
            * (self.span - 2 * c)
            / (3 * self._stiffness * self.span)
        )

    def largest_deflection(self, load: float) -> float:
        """m under the load at mid-span: W l³ / (48 E I)."""
        return _check_load(load) * self.span**3 / (48 * self._stiffness)

    def largest_slope(self, load: float) -> float:
        """rad under the load where it is steepest, at l (3 ± √3)/6: √3 W l² / (54 E I)."""
        return sqrt(3) * _check_load(load) * self.span**2 / (54 * self._stiffness)

    @property
    def _stiffness(self) -> float:
        return self.modulus * self.second_moment

    def _check_place(self, place: ArrayLike) -> Array:
        c = finite_array(place, "beam: the load's place", unit="m")
        if not ((c >= 0) & (c <= self.span)).all():
            raise MotionError(
                f"beam: a load at {c[~((c >= 0) & (c <= self.span))].flat[0]} m is off its {self.span} m"
            )
        return c


def _check_load(load: float) -> float:
    return float(finite_array(load, "beam: the load", (), unit="N"))


# Share of a beam by which a pose may be past its end: rounding.
_END_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Deflection:
    """Deflection of a beam that carries the platform: it sinks and tilts.

    load, load_error  N of all that rides on the beam, and what it may differ by, ±
    start, along      (3,) m the beam's first support, and its direction; base frame
    down              (3,) the direction of the load
    spans             equal spans one after the other, each on its own two supports

    At c along a span: shift = δ(c) down, turn ω = δ′(c) along × down; the platform, at h from the
    beam, shifts by ω × h more, which is the Abbe error. Source: [Sasidhar 1981, Appendix D].
    """

    beam: Beam
    load: float
    start: tuple[float, float, float]
    along: tuple[float, float, float]
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    load_error: float = 0.0
    spans: int = 1
    name: str = "deflection"

    def __post_init__(self) -> None:
        if not isinstance(self.beam, Beam):
            raise MotionError(f"{self.name}: beam must be a Beam, not {self.beam!r}")
        require_nonnegative(self, skip=("beam", "start", "along", "down"))
        if self.spans < 1 or self.spans != int(self.spans):
            raise MotionError(
                f"{self.name}: {self.spans} spans; a beam has 1, 2 or another whole number"
            )
        _, along, down = (
            finite_array(getattr(self, what), f"{self.name}: {what}", (3,))
            for what in ("start", "along", "down")
        )
        if not along.any() or not down.any():
            raise MotionError(f"{self.name}: along and down are directions, which must not be zero")
        along, down = along / np.linalg.norm(along), down / np.linalg.norm(down)
        if abs(along @ down) > 1e-9:
            raise MotionError(
                f"{self.name}: the load acts along `down`, which must be square to `along`"
            )

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        spread = self.twist(pose.translation, self.load_error)
        return Effect(
            np.full(1, UNIFORM),
            pose=spread[:, :, None],
            bias=self.twist(pose.translation, self.load),
        )

    def twist(self, position: Array, load: float) -> Array:
        """(N, 6) [shift, turn] of a platform with its origin at position (N, 3).

        Raises MotionError off the beam.
        """
        along, down = (np.array(v, float) / np.linalg.norm(v) for v in (self.along, self.down))
        offset = position - np.array(self.start)
        place = offset @ along
        length = self.spans * self.beam.span
        off = ~((place >= -_END_TOLERANCE * length) & (place <= length * (1 + _END_TOLERANCE)))
        if off.any():
            k = int(np.argmax(off))
            raise MotionError(
                f"{self.name}: pose {k} is {place[k] * 1e3:.6g} mm along a beam of {length * 1e3:.6g} mm; "
                "check start, along and spans"
            )
        place = np.clip(place, 0.0, length)
        within = np.clip(
            place - self.beam.span * np.minimum(place // self.beam.span, self.spans - 1),
            0,
            self.beam.span,
        )
        turn = np.outer(self.beam.slope(load, within), np.cross(along, down))
        lever = offset - np.outer(place, along)
        shift = np.outer(self.beam.deflection(load, within), down) + np.cross(turn, lever)
        return np.concatenate([shift, turn], 1)
