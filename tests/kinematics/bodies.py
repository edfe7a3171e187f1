"""Bodies of the tests: the plate and a leg of a hexapod, and several bodies as one."""

import numpy as np

from kinematics.machine.load import Body, Leg, cylinder

ALUMINIUM = 2700.0  # kg/m³

# about the middle of its thickness, the origin of the platform
PLATE = cylinder(ALUMINIUM * np.pi * 0.125**2 * 0.010, 0.125, -0.005, 0.005, "plate")

# the motor is as wide as its square of 43 mm has area; screw and tip are a steel rod of 41 g
LEG = Leg(
    barrel=cylinder(0.200, 0.043 / np.sqrt(np.pi), 0.010, 0.110, "motor"),
    rod=cylinder(0.041, 0.003, -0.162, -0.010, "screw"),
)


def combine_bodies(*bodies):
    """Return several bodies in one frame as one, by Steiner: I = Σ Iₖ + mₖ (|dₖ|² 1 − dₖ dₖᵀ).

    dₖ is the distance of a body's centre from the common one.
    """
    mass = sum(body.mass for body in bodies)
    centre = sum((body.mass * body.centre for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        off = body.centre - centre
        inertia += body.inertia + body.mass * (off @ off * np.eye(3) - np.outer(off, off))
    return Body(mass, centre, inertia)
