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
from planner.limits.limit import Limit
from planner.parallel import Progress
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.timing.certified_solve import Solution, certified_solve, cut_runs
from planner.timing.goals.fallback import FallbackGoal, integrate
from planner.timing.goals.pacing import Pacer
from planner.timing.grid import grade_problem
from planner.timing.order3.pose import pose_smoothest
from planner.timing.order3.solve import minimise_posed
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile, close_profile
from planner.timing.solution import RunSolution
from planner.timing.tighten import MAX_TRIES

# Halvings that invert the quintic: down to rounding.
HALVINGS = 60
# Share of the shortest duration by which a stated one must exceed it to leave a choice of motion.
MIN_SLACK_SHARE = 1e-6
# Points of a piece at which the ranges of the axes are sampled.
RANGE_POINTS = 17
SHORT_DURATION = "duration"
"""Kind of the refusal of less than the shortest duration."""
SMOOTHEST, PACED = "smoothest", "paced"


def solve_stated(
    path: ActuatorPath,
    limits: Sequence[Limit],
    axes: Sequence[Axis],
    order: int,
    duration: float,
    progress: Progress | None = None,
) -> Solution:
    """Return the smoothest motion that takes `duration` (s) with dwells: least ∫ Σ_i (q⃛_i/w_i)² dt.

    w_i is the jerk limit of axis i (the smaller of two), or else its range over the path per s³.
    Every run from rest to rest takes as much longer than its shortest time as the whole does,
    dwells aside: on short moves, whose shortest time goes with the cube root of their length, that
    also makes the total least. Where an axis would stay in a resonance band too long, a run is the
    smoother of two: below all bands, or gentle but fast enough.

    Raises Infeasible, with the shortest duration, for less than that, and where no motion was found
    that crosses the bands in time; MotionError where the path states speeds.
    """
    _refuse_speeds(path)
    best = certified_solve(path, limits, order, progress)
    shortest = best.trajectory.duration
    if not duration >= shortest:
        raise short_duration_error(duration, shortest)
    if duration <= shortest * (1 + MIN_SLACK_SHARE):
        return best
    rests = float(path.dwells.sum())
    goal = Smoothest(
        cut_runs(path, best, order),
        order=order,
        axes=tuple(axes),
        weights=_weigh_axes(path, axes),
        slower=(duration - rests) / (shortest - rests),
    )
    solution = certified_solve(path, best.limits, order, progress, goal=goal)
    return replace(solution, lower_estimate=best.lower_estimate)


def short_duration_error(duration: float, shortest: float) -> Infeasible:
    """Return the refusal of a duration (s) below the shortest; the remedy rounds that up."""
    least = ceil(shortest * 1e6) / 1e6
    remedy = f"the fastest motion found within the limits takes {least:.6f} s: state that or more"
    return Infeasible(SHORT_DURATION, "", None, duration, least, "s", remedy)


def _refuse_speeds(path: ActuatorPath) -> None:
    """Raise MotionError for a path that states speeds: they would fix the duration."""
    for piece in range(len(path.breaks) - 1):
        if path.constant(piece) is not None:
            place = path.place(float(path.breaks[piece]), piece)
            error = MotionError(f"{place}: a constant speed fixes the duration: omit one of the two")
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


def jerk_slopes(path: ActuatorPath, problem: Problem, weights: Array) -> Array:
    """Return (N, 2, n, 3) of q′, q″, q‴ over w at each interval's start and end."""
    sides = [np.stack(path.derivatives(s, problem.piece)[1:], axis=-1) for s in (problem.s[:-1], problem.s[1:])]
    return np.stack(sides, axis=1) / weights[:, None]


def quintic_motion(s: Array, duration: float) -> Array:
    """Return (4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) of 10 τ³ − 15 τ⁴ + 6 τ⁵.

    That is the smoothest straight motion without limits.
    """
    share = (s - s[0]) / (s[-1] - s[0])
    low = np.zeros(len(s))
    high = np.ones(len(s))
    for _ in range(HALVINGS):
        tau = (low + high) / 2
        early = tau**3 * (10 - 15 * tau + 6 * tau**2) < share
        low = np.where(early, tau, low)
        high = np.where(early, high, tau)
    tau[0] = 0.0
    tau[-1] = 1.0
    length = s[-1] - s[0]
    h = np.diff(tau)
    v = 30 * (tau * (1 - tau)) ** 2 * length / duration
    a = 60 * tau * (1 - tau) * (1 - 2 * tau)
    j = np.diff(a) / h * length / duration**3
    return np.stack([v[:-1], a[:-1] * length / duration**2, j, h * duration])


def even_time_shares(intervals: int) -> Array:
    """Return the shares of the way (intervals+1,) at even times of the quintic."""
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
    posed = pose_smoothest(problem, guess, jerk_slopes(path, problem, weights))
    # the fastest motion without jerk limits is so far from smooth that the nearer start often jams
    columns = minimise_posed(posed, ("farther", "far"))
    profile = columns if isinstance(columns, MotionError) else close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    profile = profile.slowed(guess[3].sum() / profile.duration)
    return RunSolution("solved", profile, maker=SMOOTHEST, problem=problem)


@dataclass(frozen=True, slots=True)
class Smoothest(FallbackGoal):
    """The smoothest motion along each run, `slower` times as long as its fastest motion."""

    order: int = 3
    axes: tuple[Axis, ...] = ()
    weights: Array = field(default_factory=lambda: np.empty(0))
    slower: float = 1.0

    def solve(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
        """Return the smoothest motion that crosses every resonance band in time."""
        slowed = self.fastest[run.first].slowed(self.slower)
        pacer = Pacer(path, tuple(limits), self.axes, run, self.order)
        smoothest = self._smooth(path, limits, run, slowed)
        if not pacer.find_late(smoothest.profile):
            return smoothest
        # below all bands, or through them fast: the smoother of the two
        candidates = []
        paced = pacer.pace(slowed.duration)
        if paced is not None:
            candidates.append(replace(smoothest, fallback=paced, profile=paced, maker=PACED, tries=MAX_TRIES))
        below = pacer.solve_fastest(pacer.hold_below())
        if below is not None and below.duration <= slowed.duration:
            gentle = below.slowed(slowed.duration / below.duration)
            candidates.append(self._smooth(path, pacer.hold_below(), run, gentle))
        in_time = [one for one in candidates if not pacer.find_late(one.profile)]
        if not in_time:
            return RunSolution.refused(_stays_error(pacer, smoothest.profile, below))
        return min(in_time, key=lambda one: self._roughness(path, one.profile))

    def _smooth(
        self,
        path: ActuatorPath,
        limits: Sequence[Limit],
        run: Run,
        slowed: Profile,
    ) -> RunSolution:
        problem = grade_problem(path, limits, run, even_time_shares)
        return self.improve_or_fall_back(path, problem, slowed)

    def improve(self, path: ActuatorPath, problem: Problem, slowed: Profile) -> RunSolution | None:
        """Solve from the fastest motion slowed, or else from a quintic.

        The first respects the limits: from a motion that does not, the solver often fails.
        """
        most = self._roughness(path, slowed)
        for guess in (slowed.on(problem.s), quintic_motion(problem.s, slowed.duration)):
            solution = solve_smoothest(path, problem, self.weights, guess)
            if solution.solved and self._roughness(path, solution.profile) <= most:
                return solution
        return None

    def _roughness(self, path: ActuatorPath, profile: Profile) -> float:
        """Return ∫ Σ_i (q⃛_i/w_i)² dt; ∞ where s̈ steps, as without jerk limits."""
        if not profile.j.any():
            return inf
        motion = profile.along(path)
        pieces = np.arange(len(profile.h))
        values = [
            ((motion.within(pieces, share * profile.h).qddd / self.weights) ** 2).sum(1) for share in (0.0, 0.5, 1.0)
        ]
        return integrate(values, profile.h)


def _stays_error(pacer: Pacer, profile: Profile, below: Profile | None) -> Infeasible:
    """Return the refusal where axes stay in resonance bands too long, however the run is timed."""
    worst = max(pacer.find_late(profile), key=lambda stay: stay.use)
    axis = pacer.axes[worst.band.axis]
    scale, unit = (1e3, "mm/s") if axis.kind == "linear" else (180 / np.pi, "deg/s")
    at_start = profile.along(pacer.path).at(np.array([worst.start]))
    place = pacer.path.place(
        float(at_start.along[0]),
        int(at_start.piece[0]),
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
