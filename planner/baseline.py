"""What the classical timing would take on the same path: the baseline of every saving that is quoted."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.errors import MotionError
from planner.certify import Certificate, certify
from planner.limits import limits_of
from planner.plan import Plan
from planner.solve import ROUNDS, assemble
from planner.timing.problem import Run, grid, pose_problem
from planner.timing.trapezoid import trapezoid
from planner.trajectory import Trajectory

# Intervals of a run at least, and for each radian that it turns; the certificate finds what lies between.
INTERVALS, PER_RADIAN = 3000, 200
MARGIN = 2e-7


@dataclass(frozen=True, slots=True)
class Classical:
    """The trapezoidal motion, and its own proof at order 2 (its acceleration steps, so no jerk limit could hold)."""

    trajectory: Trajectory
    certificate: Certificate

    @property
    def duration(self) -> float:
        return self.trajectory.duration


def classical(plan: Plan) -> Classical:
    """On each segment a trapezoid in arc length, as fast as its certificate allows at order 2.

    Speed and acceleration along the path are constant over the segment, the largest that keep every limit.
    """
    # a trapezoid knows no way round a resonance band: what a timed crossing would cost it is left out
    axes = [
        replace(axis, resonance=None, resonance_time=None) if axis.resonance_time else axis
        for axis in plan.machine.axes
    ]
    limits = limits_of(plan.path, axes, 2)
    stops = np.flatnonzero(plan.path.stops(2))
    problems = []
    for a, b in pairwise(stops):
        intervals = max(INTERVALS, int(PER_RADIAN * plan.path.turns[a:b].sum()))
        problems.append(pose_problem(plan.path, limits, *grid(plan.path, Run(int(a), int(b) - 1), intervals)))
    profiles = [trapezoid(problem) for problem in problems]
    for _ in range(ROUNDS):
        trajectory, owner = assemble(plan.path, profiles, stops)
        certificate = certify(trajectory, limits)
        if certificate.holds:
            return Classical(trajectory, certificate)
        for n, profile in enumerate(profiles):
            k = max(limit.slowness(float(certificate.use[limit.name][owner == n].max())) for limit in limits)
            if k > 1:
                profiles[n] = profile.slowed(k * (1 + MARGIN))
    raise MotionError(f"the classical timing could not be proved within {ROUNDS} rounds; what remained:\n{certificate}")
