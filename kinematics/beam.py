"""How far a simply supported beam sinks and tilts under a load that travels along it."""

from dataclasses import dataclass, fields
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite
from kinematics.errors import MotionError


@dataclass(frozen=True, slots=True)
class Beam:
    """A beam on two supports: span m between them, modulus Pa of its material, second moment m⁴ of its section.

    Euler and Bernoulli, small deflections: E I y″ = M, no shear. Sources: [Sasidhar 1981, Appendix D], Timoshenko.
    """

    span: float
    modulus: float
    second_moment: float

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not finite(value, f"beam: {field.name}", ()) > 0:
                raise MotionError(f"beam: {field.name} {value} must be positive and finite (m, Pa, m⁴)")

    def deflection(self, load: float, place: ArrayLike) -> Array:
        """m downwards under a load W (N) at c (m) from the first support: W c² (l − c)² / (3 E I l)."""
        c = self._inside(place)
        return np.asarray(_weight(load) * c**2 * (self.span - c) ** 2 / (3 * self._stiffness * self.span))

    def slope(self, load: float, place: ArrayLike) -> Array:
        """rad under a load W (N) at c (m), downwards along the beam positive: W c (l − c)(l − 2c) / (3 E I l)."""
        c = self._inside(place)
        return np.asarray(_weight(load) * c * (self.span - c) * (self.span - 2 * c) / (3 * self._stiffness * self.span))

    def largest_deflection(self, load: float) -> float:
        """m under the load at mid-span: W l³ / (48 E I)."""
        return _weight(load) * self.span**3 / (48 * self._stiffness)

    def largest_slope(self, load: float) -> float:
        """rad under the load where it is steepest, at l (3 ± √3)/6: √3 W l² / (54 E I)."""
        return sqrt(3) * _weight(load) * self.span**2 / (54 * self._stiffness)

    @property
    def _stiffness(self) -> float:
        return self.modulus * self.second_moment

    def _inside(self, place: ArrayLike) -> Array:
        c = finite(place, "beam: the load's place", unit="m")
        if not ((c >= 0) & (c <= self.span)).all():
            raise MotionError(f"beam: a load at {c[~((c >= 0) & (c <= self.span))].flat[0]} m is off its {self.span} m")
        return c


def _weight(load: float) -> float:
    return float(finite(load, "beam: the load", (), unit="N"))
