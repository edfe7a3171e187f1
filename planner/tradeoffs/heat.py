"""Time against heat: the motion with the least weighed sum of its duration and what its motors' coils turn into heat.

    minimise T/T₀ + w H/H₀,   H = Σ_i ∫ (q̈_i/A_i)² dt

with T₀ and H₀ of the fastest motion, dwells aside. A motor's torque goes with q̈ where its own inertia outweighs the
rest, its current with the torque, and the loss in its coils with the square of that. Both are sums over the runs
between stops, so that each run is solved by itself, with one price w T₀/H₀ of heat: by the stages of
planner.timing.order3.solve with another cost, q̈ taken at both ends of each interval and weighed half each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, directional_bounds
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.parallel import Progress
from planner.path.actuation import ActuatorPath
from planner.timing.certified_run import MAX_TRIES, Timing, tighten_block
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.discretization import place_problem
from planner.timing.order3.pose import pose_weighted
from planner.timing.order3.solve import minimise_posed
from planner.timing.problem import Problem, Run, fix_passed_ends, pose_problem
from planner.timing.profile import Profile, RunSolution, close_profile
from planner.timing.stated_duration import SLOWED, cut_runs
from planner.tradeoffs.objective import Objective
from planner.trajectory import Trajectory

WEIGHED = "weighed"


def weigh_axes(axes: Sequence[Axis]) -> Array:
    """(n,) A of each axis: its limit of acceleration, the smaller of two; ∞ where none is stated, which counts for
    nothing.
    """
    return np.array([min(directional_bounds(axis.max_acceleration)) for axis in axes])


def measure_heat(trajectory: Trajectory, weights: Array) -> float:
    """H, s: ∫ Σ (q̈/A)² dt, by Simpson's rule on every time piece."""
    h, k = np.diff(trajectory.knots), np.arange(len(trajectory.s))
    at = [((trajectory.within(k, share * h).qdd / weights) ** 2).sum(1) for share in (0.0, 0.5, 1.0)]
    return float((h / 6 * (at[0] + 4 * at[1] + at[2])).sum())


def solve_objective(
    path: ActuatorPath,
    limits: Sequence[Limit],
    axes: Sequence[Axis],
    order: int,
    objective: Objective,
    progress: Progress | None = None,
) -> Solution:
    """The motion with the least of an objective, dwells aside, proved as ever.

    Raises MotionError at order 2, for constant speeds, speeds at the ends, bands of resonance, and machines that state
    no limit of acceleration; and as `planner.timing.certified_solve.certified_solve`.
    """
    best = certified_solve(path, limits, order, progress)
    if objective.heat == 0:
        return best
    weights = weigh_axes(axes)
    _refuse(path, limits, order, objective, weights)
    rests = float(path.dwells.sum())
    time, heat = best.trajectory.duration - rests, measure_heat(best.trajectory, weights)
    if heat == 0:
        return best
    slower = max(1.0, (3 * objective.heat) ** 0.25)
    timing = HeatTiming(weights, objective.heat * time / heat, slower, cut_runs(path, best, order))
    found = certified_solve(path, best.limits, order, progress, timing=Timing(timing.solve, timing.tighten))
    return replace(found, lower_estimate=best.lower_estimate)


def _refuse(path: ActuatorPath, limits: Sequence[Limit], order: int, objective: Objective, weights: Array) -> None:
    """Raise MotionError for what an objective with heat is not for."""
    told = f'objective "{objective}"'
    if order != 3:
        raise MotionError(f"{told} needs limits of jerk: plan at order 3, with max_jerk stated of the axes, or omit it")
    if any(path.constant(piece) is not None for piece in range(len(path.breaks) - 1)):
        raise MotionError(f"{told}: a constant speed leaves no choice of motion: omit one of the two")
    if max(path.end_speeds) > 0:
        raise MotionError(f"{told} is of motions from rest to rest: omit it, or start_speed and end_speed")
    if any(isinstance(limit, Resonance) and limit.bands for limit in limits):
        raise MotionError(f"{told} may linger in a resonance band: omit it, or the axes' resonance_time")
    if not np.isfinite(weights).any():
        raise MotionError(f"{told} counts heat in limits of acceleration: state max_acceleration of some axis")


@dataclass(frozen=True, slots=True)
class HeatTiming:
    """What `certified_solve` asks of a timing: the motion along a run with the least T + price · H.

    slower   how many times as long as the fastest motion what is there to fall back on takes: of all such motions, the
             one with the least of the objective
    fastest  these motions, by the runs' first pieces
    """

    weights: Array = field(repr=False)
    price: float
    slower: float
    fastest: Mapping[int, Profile] = field(repr=False)

    def solve(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
        fastest = self.fastest[run.first]
        resting = replace(run, ends=fix_passed_ends(run.ends))
        problem = place_problem(path, limits, resting, fastest, fastest.h)
        if 2 * len(fastest.h) >= problem.intervals:  # its grid is fine where it loses time
            grid = np.append(fastest.s, problem.s[-1])
            problem = pose_problem(path, limits, grid, fastest.piece, resting.ends)
        return self._weigh(path, problem, fastest.slowed(self.slower))

    def tighten(
        self, path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
    ) -> RunSolution:
        """Solved with less room where a limit was exceeded; tried often enough, the fastest motion slowed."""
        problem, slowed = solution.problem, solution.fallback
        if problem is None or slowed is None:
            return solution
        if solution.tries >= MAX_TRIES:
            return replace(solution, profile=slowed, maker=SLOWED)
        own = solution.aimed(use)
        blocks = tuple(
            tighten_block(block, own[block.name], solution.tries) if block.name in own else block
            for block in problem.blocks
        )
        return self._weigh(path, replace(problem, blocks=blocks), slowed, solution.tries)

    def _weigh(self, path: ActuatorPath, problem: Problem, slowed: Profile, tries: int = 0) -> RunSolution:
        """Solved within the rooms that are left; `slowed` where there is no answer, or a worse one."""
        guess = slowed.on(problem.s)
        posed = pose_weighted(problem, guess, self._push_slopes(path, problem), self.price)
        columns = minimise_posed(posed, ("far", "farther"))
        profile = columns if isinstance(columns, MotionError) else close_profile(problem, columns)
        if isinstance(profile, MotionError) or self._cost(path, profile) > self._cost(path, slowed):
            return RunSolution("solved", slowed, maker=SLOWED, problem=problem, tries=MAX_TRIES, fallback=slowed)
        return RunSolution("solved", profile, maker=WEIGHED, problem=problem, tries=tries + 1, fallback=slowed)

    def _push_slopes(self, path: ActuatorPath, problem: Problem) -> Array:
        """(N, 2, n, 2) of q′ and q″ over A at each interval's start and end."""
        sides = [np.stack(path.derivatives(s, problem.piece, 2)[1:], axis=-1) for s in (problem.s[:-1], problem.s[1:])]
        return np.stack(sides, axis=1) / self.weights[:, None]

    def _cost(self, path: ActuatorPath, profile: Profile) -> float:
        return profile.duration + self.price * measure_heat(profile.along(path), self.weights)
