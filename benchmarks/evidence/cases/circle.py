"""The bare circle, certified, against legs computed by hand at many instants.

On a circle of radius r about the z axis, with a level platform, the squared length of a leg between
base joint b and platform joint a is D = A + B cos φ + C sin φ: with c = centre + a − b, A = r² +
c·c, B = 2 r c_x, C = 2 r c_y. Lengths and their derivatives follow by hand; only s(t) is taken from
the plan, with φ = s/r.
"""

from collections.abc import Iterator
from typing import cast

import numpy as np
from scipy.interpolate import PPoly

from benchmarks.evidence.table import Row, Table
from kinematics import Hexapod, load_machine
from kinematics.foundation.arrays import Array
from planner import Plan, load_program, plan

RADIUS, HEIGHT = 0.015, 0.025
LIMITS = {"speed": 0.020, "acceleration": 0.225, "jerk": 4.0}


def measure(instants: int = 100_000) -> Iterator[Table]:
    """Yield the uses of limits, proved and by hand, and the error of the pulses, at orders 2 and
    3.
    """
    machine = cast(Hexapod, load_machine("hexapod"))
    program = load_program("bare-circle")
    for order in (2, 3):
        planned = plan(program, machine, order=order)
        by_hand = largest_use(planned, machine, instants)
        rows: list[Row] = [
            [name, f"{proved:.9f}", f"{by_hand[name]:.9f}" if name in by_hand else None]
            for name, proved in planned.certificate.worst.items()
        ]
        yield Table(
            f"Order {order}",
            ("value/limit", "proved at most", f"largest of {instants} instants, by hand"),
            rows,
            f"{planned.trajectory.duration:.6f} s, {planned.pulses.total} pulses. At random "
            f"instants, counts are at most half a pulse and {pulse_error(planned, instants):.2f} "
            "ticks' travel from the motion.",
        )


def leg_derivatives(machine: Hexapod, phi: Array) -> tuple[Array, Array, Array, Array]:
    """Return the legs' lengths (6, N) at angles phi (N,) and their first three derivatives."""
    centre = machine.home.translation + np.array([0, 0, HEIGHT])
    c = (centre + machine.platform - machine.base)[:, :, None]
    b, a = 2 * RADIUS * c[:, 0], 2 * RADIUS * c[:, 1]
    cos, sin = np.cos(phi), np.sin(phi)
    d0 = RADIUS**2 + (c**2).sum(1) + b * cos + a * sin
    d1 = a * cos - b * sin
    d2 = -b * cos - a * sin
    d3 = -d1
    # l² = D, so 2 l l′ = D′, 2 (l′² + l l″) = D″, 2 (3 l′ l″ + l l‴) = D‴
    l0 = np.sqrt(d0)
    l1 = d1 / (2 * l0)
    l2 = (d2 / 2 - l1**2) / l0
    l3 = (d3 / 2 - 3 * l1 * l2) / l0
    return l0, l1, l2, l3


def largest_use(planned: Plan, machine: Hexapod, instants: int) -> dict[str, float]:
    """Return the largest value/limit of the legs by hand, once their lengths are those of the
    plan.
    """
    motion = planned.trajectory
    t = np.linspace(0.0, motion.duration, instants)
    pieces = np.array([motion.j / 6, motion.a / 2, motion.v, motion.s])
    angle = PPoly(pieces / RADIUS, motion.knots)
    phi, v, a, j = (angle(t, order) for order in range(4))
    l0, l1, l2, l3 = leg_derivatives(machine, phi)
    np.testing.assert_allclose(l0.T, motion.at(t).q, rtol=0, atol=1e-12)
    values = {
        "speed": l1 * v,
        "acceleration": l1 * a + l2 * v**2,
        "jerk": l1 * j + 3 * l2 * v * a + l3 * v**3,
    }
    return {name: float(np.abs(value).max() / LIMITS[name]) for name, value in values.items()}


def pulse_error(planned: Plan, instants: int) -> float:
    """Return the largest |counts·pulse − (q − home)| beyond half a pulse, in travel of one tick."""
    motion, pulses = planned.trajectory, planned.pulses
    t = np.random.default_rng(1).uniform(0.0, motion.duration, instants)
    state = motion.at(t)
    pulse, home = np.array([(axis.pulse, axis.home) for axis in pulses.axes]).T
    beyond = np.abs(pulses.counts(t) * pulse - (state.q - home)) - pulse / 2
    tick_travel = np.abs(state.qd).max(0) / pulses.clock_hz
    return float((beyond / tick_travel).max())
