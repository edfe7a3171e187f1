"""The goal "time + heat": the least weighted sum of the duration and of the heat of the motors.

    minimise T/T₀ + w H/H₀,   H = Σ_i ∫ (q̈_i/A_i)² dt

with T₀ and H₀ of the fastest motion, dwells aside. A motor's torque goes with q̈ where its own
inertia outweighs the rest, its current with the torque, and the loss in its coils with the square
of the current. Both are sums over the runs between stops, so that each run is solved by itself with
the cost T + p H, p = w T₀/H₀: by the stages of order 3 with another cost, q̈ taken at both ends of
each interval and weighted half each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, directional_bounds
from planner.limits.resonance import Resonance
from planner.parallel import Progress
from planner.path.actuation import ActuatorPath, has_constant_speed
from planner.timing.certified_solve import Solution, cut_runs, improve_goal
from planner.timing.goals.fallback import (
    FallbackGoal,
    integrate_squares,
    solve_posed,
    weigh_slopes,
)
from planner.timing.goals.objective import Objective
from planner.timing.grid import Task, place_problem
from planner.timing.order3.pose import pose_weighted
from planner.timing.problem import Problem
from planner.timing.profile import Profile
from planner.timing.rows import pose_problem
from planner.timing.solution import RunSolution
from planner.trajectory import Trajectory

WEIGHED = "weighed"


def weigh_axes(axes: Sequence[Axis]) -> Array:
    """Return (n,) A of each axis: the smaller of its two limits on acceleration; ∞ without one.

    An axis with A = ∞ does not count.
    """
    return np.array([min(directional_bounds(axis.max_acceleration)) for axis in axes])


def measure_heat(trajectory: Trajectory, weights: Array) -> float:
    """Return H (s) = ∫ Σ (q̈/A)² dt. weights (n,): A."""
    return integrate_squares(trajectory, 2, weights)


def solve_objective(
    best: Solution,
    axes: Sequence[Axis],
    objective: Objective,
    progress: Progress | None = None,
) -> Solution:
    """Return the certified motion with the least of an objective, dwells aside.

    best  fastest motion

    Raises MotionError at order 2, for constant speeds, speeds at the ends, bands of resonance, and
    machines that state no limit of acceleration; and as `solve_goal` does.
    """
    if objective.heat == 0:
        return best
    weights = weigh_axes(axes)
    _refuse(best, objective, weights)
    path = best.trajectory.path
    time = best.trajectory.duration - float(path.dwells.sum())
    heat = measure_heat(best.trajectory, weights)
    if heat == 0:
        return best
    goal = TimeAndHeat(
        cut_runs(best),
        weights=weights,
        price=objective.heat * time / heat,
        slower=max(1.0, (3 * objective.heat) ** 0.25),
    )
    return improve_goal(best, goal, progress)


def _refuse(best: Solution, objective: Objective, weights: Array) -> None:
    """Raise MotionError for a motion that an objective with heat does not apply to."""
    name = f'objective "{objective}"'
    path = best.trajectory.path
    if best.order != 3:
        raise MotionError(
            f"{name} needs limits of jerk: plan at order 3, with max_jerk stated of the axes, or omit it"
        )
    if has_constant_speed(path):
        raise MotionError(
            f"{name}: a constant speed leaves no choice of motion: omit one of the two"
        )
    if max(path.end_speeds) > 0:
        raise MotionError(
            f"{name} is of motions from rest to rest: omit it, or start_speed and end_speed"
        )
    if any(isinstance(limit, Resonance) and limit.bands for limit in best.limits):
        raise MotionError(
            f"{name} may linger in a resonance band: omit it, or the axes' resonance_time"
        )
    if not np.isfinite(weights).any():
        raise MotionError(
            f"{name} counts heat in limits of acceleration: state max_acceleration of some axis"
        )


@dataclass(frozen=True, slots=True)
class TimeAndHeat(FallbackGoal):
    """The least T + price · H along each run.

    weights  (n,) A of each axis
    price    s per unit of H
    slower   duration of the fallback as a multiple of the fastest motion's: the multiple with the
             least of the objective
    """

    weights: Array = field(default_factory=lambda: np.empty(0), repr=False)
    price: float = 0.0
    slower: float = 1.0

    def solve(self, task: Task) -> RunSolution:
        """Solve on a grid that is fine where the fastest motion's is."""
        path = task.path
        fastest = self.fastest[task.run.first]
        resting = task.resting.run
        problem = place_problem(path, task.limits, resting, fastest, fastest.h)
        if 2 * len(fastest.h) >= problem.intervals:
            # the fastest motion's own grid is fine where that loses time
            grid = np.append(fastest.s, problem.s[-1])
            problem = pose_problem(path, task.limits, grid, fastest.piece, resting.ends)
        return self.improve_or_fall_back(path, problem, fastest.slowed(self.slower))

    def minimise(self, path: ActuatorPath, problem: Problem, guess: Array) -> RunSolution:
        """Return the motion with the least T + price · H."""
        slopes = weigh_slopes(path, problem, 2, self.weights)
        posed = pose_weighted(problem, guess, slopes, self.price)
        return solve_posed(problem, posed, ("far", "farther"), WEIGHED)

    def find_cost(self, path: ActuatorPath, profile: Profile) -> float:
        """Return T + price · H."""
        return profile.duration + self.price * measure_heat(profile.along(path), self.weights)
