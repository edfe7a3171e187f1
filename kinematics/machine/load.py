"""What a machine moves: rigid bodies (mass, centre of mass, inertia), gravity, and what pushes on
its platform.
"""

from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import MAX_DISTANCE, Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments, check_fields
from kinematics.foundation.short_repr import short_repr

# Rounding, as a share of the largest moment, that an inertia may be off what a rigid body can have.
INERTIA_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body, in the frame of its part.

    mass     kg; 0 for what weighs nothing
    centre   (3,) m, its centre of mass
    inertia  (3, 3) kg·m² about the centre of mass, along the axes of the frame
    name     what an error calls it

    Raises MotionError for what no rigid body has: principal moments must be ≥ 0, none above the sum
    of the others.
    """

    __repr__ = short_repr
    mass: float = 0.0
    centre: Array = field(default_factory=lambda: np.zeros(3))
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    name: str = "body"

    def __post_init__(self) -> None:
        check_fields(self, "mass", "centre", "inertia")
        if finite_array(self.mass, f"{self.name}: mass", (), unit="kg") < 0:
            raise MotionError(f"{self.name}: mass {self.mass} kg must be finite and not below 0")
        centre = finite_array(self.centre, f"{self.name}: centre", (3,), unit="m")
        inertia = finite_array(self.inertia, f"{self.name}: inertia", (3, 3), unit="kg·m²")
        slack = INERTIA_ROUNDING * float(np.abs(inertia).max())
        if np.abs(inertia - inertia.T).max() > slack:
            raise MotionError(f"{self.name}: inertia {inertia.tolist()} kg·m² must be symmetric")
        low, middle, high = np.linalg.eigvalsh(inertia)
        if low < -slack or high > low + middle + slack:
            raise MotionError(
                f"{self.name}: principal moments {low:.6g}, {middle:.6g}, {high:.6g} kg·m² are no rigid body's: "
                "each must be at least 0 and at most the sum of the other two"
            )
        if self.mass == 0 and inertia.any():
            raise MotionError(f"{self.name}: inertia without mass; state the mass")
        object.__setattr__(self, "centre", freeze_array(centre))
        object.__setattr__(self, "inertia", freeze_array(inertia))


@check_arguments()
def cylinder(mass: float, radius: float, low: float, high: float, name: str = "cylinder") -> Body:
    """A solid cylinder along z: I_z = m r²/2, I_x = I_y = m (3 r² + h²)/12.

    Parameters
    ----------
    mass
        kg.
    radius
        m.
    low, high
        m, z of its two ends.
    name
        What messages call it.

    Returns
    -------
    Body
        In the frame in which z is given.

    Raises
    ------
    MotionError
        The radius is negative, or low is not below high.
    """
    if not 0 <= radius <= MAX_DISTANCE:
        raise MotionError(f"{name}: radius {radius} m must be from 0 to {MAX_DISTANCE:g} m")
    if not -MAX_DISTANCE <= low < high <= MAX_DISTANCE:
        raise MotionError(
            f"{name}: low {low} m must lie below high {high} m, both within {MAX_DISTANCE:g} m"
        )
    across, along = mass * (3 * radius**2 + (high - low) ** 2) / 12, mass * radius**2 / 2
    return Body(
        mass,
        freeze_array([0, 0, (low + high) / 2]),
        freeze_array(np.diag([across, across, along])),
        name,
    )


@dataclass(frozen=True, slots=True)
class Leg:
    """The two parts of a linear actuator between a universal joint on the base and a spherical one
    on the platform.

    barrel      what turns about the base joint: in a frame at that joint's centre, z along the leg
                to the platform
    rod         what also slides: in a frame at the platform joint's centre, its axes parallel to
                the barrel's
    first_axis  (3,) axis of the universal joint that stands still in the base frame; its part along
                the leg at home does not count. None: the axis of the base that lies most across the
                leg at home

    At home, x of both frames is the first axis made perpendicular to the leg.
    """

    __repr__ = short_repr
    barrel: Body
    rod: Body
    first_axis: Array | None = None

    def __post_init__(self) -> None:
        for part in ("barrel", "rod"):
            if not isinstance(getattr(self, part), Body):
                raise MotionError(f"leg: {part} must be a Body, not {getattr(self, part)!r}")
        if self.first_axis is None:
            return
        axis = finite_array(self.first_axis, "leg: first_axis", (3,))
        if not axis.any():
            raise MotionError("leg: first_axis is a direction, which must not be zero")
        object.__setattr__(self, "first_axis", freeze_array(axis))


STANDARD_GRAVITY = 9.80665
"""m/s²."""
GRAVITY = (0.0, 0.0, -STANDARD_GRAVITY)
"""m/s², where z of the base is up."""


@dataclass(frozen=True, slots=True)
class Load:
    """Masses and outside forces of a machine; nothing by default.

    platform  what moves with the platform's (tool's) frame, in that frame
    legs      of machines with legs: one for each, or one for all; none: legs without mass
    gravity   (3,) m/s² in the base frame; None: down the vertical of the machine that carries it
              (`Kind.vertical`)
    wrench    (6,) N and N·m that act on the platform from outside at its origin, in the base frame

    What an axis carries by itself (`friction`, `reflected`) is the axis' own.
    """

    __repr__ = short_repr
    platform: Body = field(default_factory=Body)
    legs: tuple[Leg, ...] = ()
    gravity: Array | None = None
    wrench: Array = field(default_factory=lambda: freeze_array(np.zeros(6)))

    def __post_init__(self) -> None:
        legs = (self.legs,) if isinstance(self.legs, Leg) else self.legs
        if not isinstance(legs, tuple | list) or not all(isinstance(leg, Leg) for leg in legs):
            raise MotionError(f"load: legs must be a Leg, or one for each leg, not {legs!r:.100}")
        if not isinstance(self.platform, Body):
            raise MotionError(f"load: platform must be a Body, not {self.platform!r:.100}")
        legs = tuple(legs)
        object.__setattr__(self, "legs", legs)
        for name, size, unit in (("gravity", 3, "m/s²"), ("wrench", 6, "N and N·m")):
            if name == "gravity" and self.gravity is None:
                continue
            values = finite_array(getattr(self, name), f"load: {name}", (size,), unit=unit)
            object.__setattr__(self, name, freeze_array(values))
