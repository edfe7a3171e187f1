"""The bare circle, held against a few lines of its own: `python -m benchmarks.evidence.published.circle_evidence`.

On a circle of radius r about the z axis, with the platform level, the squared length of a leg between base joint b
and platform joint a is A + B cos φ + C sin φ: with c = centre + a − b, A = r² + c·c, B = 2 r c_x, C = 2 r c_y. Lengths
and their derivatives follow by hand; only s(t) is taken from the plan, with φ = s/r.
"""

import numpy as np

from kinematics import load_machine
from kinematics.foundation.arrays import Array
from planner import Plan, load_program, plan
from planner.pulses import check

RADIUS, INSTANTS = 0.015, 100_000
# [Sahbaz 2007, chapter 5], written out again on purpose: radius, angle between the closest joints, height (m, deg).
LOWER, UPPER, HOME = (0.149, 30.0, 0.0115), (0.100, 60.0, -0.011), 0.2336362
LIMITS = {"speed": 0.020, "acceleration": 0.225, "jerk": 4.0}


def joints(radius: float, gap: float, height: float) -> Array:
    azimuth = np.deg2rad([gap / 2, 120 - gap / 2, 120 + gap / 2, 240 - gap / 2, 240 + gap / 2, -gap / 2])
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.full(6, height)], 1)


def leg_derivatives(phi: Array) -> tuple[Array, Array, Array, Array]:
    """Leg lengths (N, 6) at angles phi (N,), and their first three derivatives with respect to it."""
    c = np.array([0.0, 0.0, HOME + 0.025]) + joints(*UPPER) - joints(*LOWER)
    cos, sin = np.cos(phi)[:, None], np.sin(phi)[:, None]
    b, a = 2 * RADIUS * c[:, 0], 2 * RADIUS * c[:, 1]
    square = RADIUS**2 + (c**2).sum(1) + b * cos + a * sin
    d1, d2 = -b * sin + a * cos, -b * cos - a * sin
    d3 = -d1
    # l² = D, so 2 l l′ = D′,  2 (l′² + l l″) = D″,  2 (3 l′ l″ + l l‴) = D‴
    l0 = np.sqrt(square)
    l1 = d1 / (2 * l0)
    l2 = (d2 / 2 - l1**2) / l0
    return l0, l1, l2, (d3 / 2 - 3 * l1 * l2) / l0


def largest_use(planned: Plan) -> dict[str, float]:
    """The largest value/limit of every leg at many instants, from s(t) and the lines above."""
    motion = planned.trajectory
    t = np.linspace(0.0, motion.duration, INSTANTS)
    k = np.clip(np.searchsorted(motion.knots, t, side="right") - 1, 0, len(motion.s) - 1)
    tau, j = t - motion.knots[k], motion.j[k] / RADIUS
    a = motion.a[k] / RADIUS + j * tau
    v = (motion.v[k] + tau * (motion.a[k] + tau * motion.j[k] / 2)) / RADIUS
    phi = (motion.s[k] + tau * (motion.v[k] + tau * (motion.a[k] / 2 + tau * motion.j[k] / 6))) / RADIUS
    length, l1, l2, l3 = leg_derivatives(phi)
    assert np.abs(length - motion.at(t).q).max() < 1e-12
    v, a, j = v[:, None], a[:, None], j[:, None]
    values = {"speed": l1 * v, "acceleration": l1 * a + l2 * v**2, "jerk": l1 * j + 3 * l2 * v * a + l3 * v**3}
    return {name: float(np.abs(value).max() / LIMITS[name]) for name, value in values.items()}


def pulse_error(planned: Plan) -> float:
    """Largest |counts·pulse − (q − home)| at random instants beyond half a pulse, in travel of one tick."""
    t = np.random.default_rng(1).uniform(0.0, planned.trajectory.duration, INSTANTS)
    state, pulses = planned.trajectory.at(t), planned.pulses
    pulse = np.array([axis.pulse for axis in pulses.axes])
    home = np.array([axis.home for axis in pulses.axes])
    beyond = np.abs(pulses.counts(t) * pulse - (state.q - home)) - pulse / 2
    return float((beyond / (np.abs(state.qd).max(0) / pulses.clock_hz)).max())


def main() -> None:
    machine, program = load_machine("hexapod"), load_program("bare-circle")
    for order in (2, 3):
        planned = plan(program, machine, order=order)
        seen = largest_use(planned)
        verdict = check(planned.pulses, planned.trajectory)
        print(f"order {order}: {planned.trajectory.duration:.6f} s")
        for name, value in planned.certificate.worst.items():
            beside = f", by hand at {INSTANTS} instants {seen[name]:.9f}" if name in seen else ""
            print(f"    {name:<13} proved ≤ {value:.9f}{beside}")
        beyond = pulse_error(planned)
        print(f"    pulses        {planned.pulses.total}, at most {beyond:.3f} ticks' travel beyond half a pulse")
        print(
            f"    the checker   {'agrees' if verdict.holds else 'DISAGREES'}, final count error {verdict.final_error}"
        )


if __name__ == "__main__":
    main()
