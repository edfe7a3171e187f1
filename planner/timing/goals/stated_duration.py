"""The goal "stated duration": the smoothest certified motion of that duration.

It has the least integral of squared actuator jerk: the stages of order 3 with another cost,

    minimise ∫ Σ_i (q⃛_i/w_i)² dt
    such that Σ h = T, the next state follows, and every row is kept

with q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³ at both ends of every interval, weighted half each.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import ceil, inf

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, directional_bounds
from planner.parallel import Progress
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.timing.certified_solve import Solution, cut_runs, improve_goal
from planner.timing.goals.fallback import (
    FallbackGoal,
    integrate_squares,
    solve_posed,
    weigh_slopes,
)
from planner.timing.goals.pacing import Pacer
from planner.timing.grid import Task, grade_problem
from planner.timing.order3.pose import pose_smoothest
from planner.timing.problem import Problem
from planner.timing.profile import Profile
from planner.timing.solution import RunSolution
from planner.timing.tighten import MAX_TRIES

# Share of the shortest duration by which a stated one must exceed it to leave a choice of motion.
MIN_SLACK_SHARE = 1e-6
# Points of a piece at which the ranges of the axes are sampled.
RANGE_POINTS = 17
SHORT_DURATION = "duration"
"""Kind of the refusal of less than the shortest duration."""
SMOOTHEST = "smoothest"
PACED = "paced"


def solve_stated(
    best: Solution,
    axes: Sequence[Axis],
    duration: float,
    progress: Progress | None = None,
) -> Solution:
    """Return the smoothest motion that takes `duration` (s) with dwells: least ∫ Σ_i (q⃛_i/w_i)²
    dt.

    w_i is the jerk limit of axis i (the smaller of two), or else its range over the path per s³.
    Every run from rest to rest takes as much longer than its shortest time as the whole does,
    dwells aside: on short moves, whose shortest time goes with the cube root of their length, that
    also makes the total least. Where an axis would stay in a resonance band too long, a run is the
    smoother of two: below all bands, or gentle but fast enough.

    best  fastest motion

    Raises Infeasible, with the shortest duration, for less than that, and where no motion was found
    that crosses the bands in time; MotionError where the path states speeds.
    """
    path = best.trajectory.path
    _refuse_speeds(path)
    shortest = best.trajectory.duration
    if not duration >= shortest:
        raise short_duration_error(duration, shortest)
    if duration <= shortest * (1 + MIN_SLACK_SHARE):
        return best
    rests = float(path.dwells.sum())
    goal = Smoothest(
        cut_runs(best),
        axes=tuple(axes),
        weights=_weigh_axes(path, axes),
        slower=(duration - rests) / (shortest - rests),
    )
    return improve_goal(best, goal, progress)


def short_duration_error(duration: float, shortest: float) -> Infeasible:
    """Return the refusal of a duration (s) below the shortest; the remedy rounds that up."""
    least = ceil(shortest * 1e6) / 1e6
    remedy = f"the fastest motion found within the limits takes {least:.6f} s: state that or more"
    return Infeasible(SHORT_DURATION, "", None, duration, least, "s", remedy)


def _refuse_speeds(path: ActuatorPath) -> None:
    """Raise MotionError for a path that states speeds: they would fix the duration."""
    for piece in range(len(path.breaks) - 1):
        if path.constant(piece) is not None:
            place = path.place(path.breaks[piece], piece)
            error = MotionError(
                f"{place}: a constant speed fixes the duration: omit one of the two"
            )
            raise error.in_segment(place.segment)
    if max(path.end_speeds) > 0:
        raise MotionError(
            "a stated duration goes from rest to rest, and this motion begins and ends at "
            f"{path.end_speeds} along the path: omit the duration, or start_speed and end_speed"
        )


def _weigh_axes(path: ActuatorPath, axes: Sequence[Axis]) -> Array:
    """Return (n,) w of each axis: its jerk limit, or its range over the path per s³."""
    breaks = path.breaks
    share = np.linspace(0.0, 1.0, RANGE_POINTS)
    s = breaks[:-1, None] + np.diff(breaks)[:, None] * share
    piece = np.repeat(np.arange(len(breaks) - 1), RANGE_POINTS)
    ranges = np.ptp(path.derivatives(s.ravel(), piece)[0], axis=0)
    ranges = np.where(ranges > 1e-9 * ranges.max(), ranges, np.inf)
    bounds = [min(directional_bounds(axis.max_jerk)) for axis in axes]
    return np.where(np.isfinite(bounds), bounds, ranges)


def even_time_shares(intervals: int) -> Array:
    """Return the shares of the way (intervals+1,) at even times of 10 τ³ − 15 τ⁴ + 6 τ⁵.

    That is the smoothest straight motion without limits.
    """
    tau = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(tau**3 * (10 - 15 * tau + 6 * tau**2))


def solve_smoothest(
    path: ActuatorPath,
    problem: Problem,
    weights: Array,
    guess: Array,
) -> RunSolution:
    """Return the smoothest motion from rest to rest that takes as long as the guess.

    weights  (n,) w of each axis; ∞ for one that does not count
    guess    (4, N) ṡ, s̈, s⃛, h to start from
    """
    posed = pose_smoothest(problem, guess, weigh_slopes(path, problem, 3, weights))
    # the fastest motion without jerk limits is so far from smooth that the nearer starts often jam
    solution = solve_posed(problem, posed, ("farther", "far", "rough"), SMOOTHEST)
    if not solution.solved:
        return solution
    return replace(solution, profile=solution.profile.slowed(guess[3].sum() / solution.duration))


@dataclass(frozen=True, slots=True)
class Smoothest(FallbackGoal):
    """The smoothest motion along each run, `slower` times as long as its fastest motion."""

    axes: tuple[Axis, ...] = ()
    weights: Array = field(default_factory=lambda: np.empty(0))
    slower: float = 1.0

    def solve(self, task: Task) -> RunSolution:
        """Return the smoothest motion that crosses every resonance band in time."""
        slowed = self.fastest[task.run.first].slowed(self.slower)
        pacer = Pacer(task, self.axes)
        smoothest = self._smooth(task, slowed)
        if not pacer.find_late(smoothest.profile):
            return smoothest
        # below all bands, or through them fast: the smoother of the two
        candidates = []
        paced = pacer.pace(slowed.duration)
        if paced is not None:
            candidates.append(
                replace(
                    smoothest,
                    fallback=paced,
                    profile=paced,
                    maker=PACED,
                    tries=MAX_TRIES,
                )
            )
        below = pacer.solve_fastest(pacer.hold_below().limits)
        if below is not None and below.duration <= slowed.duration:
            gentle = below.slowed(slowed.duration / below.duration)
            candidates.append(self._smooth(pacer.hold_below(), gentle))
        in_time = [one for one in candidates if not pacer.find_late(one.profile)]
        if not in_time:
            return RunSolution.refused(_stays_error(pacer, smoothest.profile, below))
        return min(in_time, key=lambda one: self.find_cost(task.path, one.profile))

    def _smooth(self, task: Task, slowed: Profile) -> RunSolution:
        problem = grade_problem(task.path, task.limits, task.run, even_time_shares)
        return self.improve_or_fall_back(task.path, problem, slowed)

    def minimise(self, path: ActuatorPath, problem: Problem, guess: Array) -> RunSolution:
        """Return the smoothest motion that takes as long as the guess."""
        return solve_smoothest(path, problem, self.weights, guess)

    def find_cost(self, path: ActuatorPath, profile: Profile) -> float:
        """Return ∫ Σ_i (q⃛_i/w_i)² dt; ∞ where s̈ steps, as without jerk limits."""
        if not profile.j.any():
            return inf
        return integrate_squares(profile.along(path), 3, self.weights)


def _stays_error(pacer: Pacer, profile: Profile, below: Profile | None) -> Infeasible:
    """Return the refusal where axes stay in resonance bands too long, however the run is timed."""
    worst = max(pacer.find_late(profile), key=lambda stay: stay.use)
    axis = pacer.axes[worst.band.axis]
    scale, unit = (1e3, "mm/s") if axis.kind == "linear" else (180 / np.pi, "deg/s")
    at_start = profile.along(pacer.task.path).at(np.array([worst.start]))
    place = pacer.task.path.place(
        at_start.along[0],
        at_start.piece[0],
        None,
        axis.name,
    )
    longer = "state"
    if below is not None:
        times = ceil(below.duration / profile.duration * 1000) / 1000
        longer = f"state one {times:.3f} times as long, below all bands, or"
    remedy = (
        "no motion of the stated duration was found that crosses the band from "
        f"{worst.band.low * scale:.6g} to {worst.band.high * scale:.6g} {unit} in time: "
        f"{longer} a shorter one"
    )
    return Infeasible(
        "resonance crossing",
        axis.name,
        place,
        worst.use * worst.band.time,
        worst.band.time,
        "s",
        remedy,
    )
