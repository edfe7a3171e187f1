"""A motion of a stated duration: the smoothest that there is within it, certified.

It has the least integral of squared actuator jerk. The stages are those of planner.timing.order3.solve with
another cost:

    minimise ∫ Σ_i (q⃛_i/w_i)² dt
    such that Σ h = T, the next state follows, and every row is kept

with q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³ at both ends of every interval, weighed half each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, inf

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis, directional_bounds
from planner.limits.limit import Limit
from planner.parallel import Progress
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.timing.certified_run import MAX_TRIES, Timing, tighten_block
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.discretization import grade_problem
from planner.timing.order3.pose import pose_smoothest
from planner.timing.order3.solve import minimise_posed
from planner.timing.pacing import Pacer
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile, RunSolution, close_profile

HALVINGS = 60


def solve_smoothest(path: ActuatorPath, problem: Problem, weights: Array, guess: Array) -> RunSolution:
    """The smoothest motion from rest to rest, s̈ zero at both ends, that takes as long as the guess.

    weights (n,): w of each axis, ∞ for one that does not count. guess (4, N): ṡ, s̈, s⃛, h to start from.
    """
    # the fastest motion without jerk limits is so far from smooth that the nearer start often jams
    columns = minimise_posed(pose_smoothest(problem, guess, jerk_slopes(path, problem, weights)), ("farther", "far"))
    profile = columns if isinstance(columns, MotionError) else close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile.slowed(guess[3].sum() / profile.duration), maker=SMOOTHEST, problem=problem)


def jerk_slopes(path: ActuatorPath, problem: Problem, weights: Array) -> Array:
    """(N, 2, n, 3) of q′, q″, q‴ over w at each interval's start and end."""
    sides = [np.stack(path.derivatives(s, problem.piece)[1:], axis=-1) for s in (problem.s[:-1], problem.s[1:])]
    return np.stack(sides, axis=1) / weights[:, None]


def quintic_motion(s: Array, duration: float) -> Array:
    """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) of 10 τ³ − 15 τ⁴ + 6 τ⁵: the smoothest straight motion without limits."""
    share = (s - s[0]) / (s[-1] - s[0])
    low, high = np.zeros(len(s)), np.ones(len(s))
    for _ in range(HALVINGS):
        tau = (low + high) / 2
        early = tau**3 * (10 - 15 * tau + 6 * tau**2) < share
        low, high = np.where(early, tau, low), np.where(early, high, tau)
    tau[0], tau[-1] = 0.0, 1.0
    length, h = s[-1] - s[0], np.diff(tau)
    v, a = 30 * (tau * (1 - tau)) ** 2, 60 * tau * (1 - tau) * (1 - 2 * tau)
    scale = length / duration ** np.arange(1, 4)
    return np.stack([v[:-1] * scale[0], a[:-1] * scale[1], np.diff(a) / h * scale[2], h * duration])


def even_time_shares(intervals: int) -> Array:
    """Where a grid's points lie, as shares of the way (intervals+1,), for the quintic to take as long over each."""
    tau = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(tau**3 * (10 - 15 * tau + 6 * tau**2))


# A duration so little above the shortest leaves no choice of motion.
MIN_SLACK_SHARE = 1e-6
# Points of a piece at which the ranges of the axes are looked at.
RANGE_POINTS = 17
SHORT_DURATION = "duration"
"""The kind of a refusal of less than the shortest."""
SMOOTHEST, SLOWED, PACED = "smoothest", "slowed", "paced"


def solve_stated(
    path: ActuatorPath,
    limits: Sequence[Limit],
    axes: Sequence[Axis],
    order: int,
    duration: float,
    progress: Progress | None = None,
) -> Solution:
    """The smoothest motion that takes `duration` (s), dwells included: least ∫ Σ_i (q⃛_i/w_i)² dt, within all limits.

    w_i is the jerk limit of axis i where it states one (the smaller of two), else its range over the path per s³. Every
    run from rest to rest takes as much longer than its shortest as the whole does, dwells aside: on short moves, whose
    shortest time goes with the cube root of their length, that is also how the total becomes least. Where an axis would
    stay in a resonance band too long, a run is the smoother of two: below all bands, or gentle but fast enough.
    Raises Infeasible, with the shortest, for less than that, and where nothing was found that crosses the bands in
    time; MotionError where the path asks for speeds.
    """
    _refuse(path)
    best = certified_solve(path, limits, order, progress)
    shortest = best.trajectory.duration
    if not duration >= shortest:
        raise short_duration_error(duration, shortest)
    if duration <= shortest * (1 + MIN_SLACK_SHARE):
        return best
    rests = float(path.dwells.sum())
    slower = (duration - rests) / (shortest - rests)
    smooth = SmoothTiming(order, tuple(axes), _axis_weights(path, axes), slower, cut_runs(path, best, order))
    timing = Timing(smooth.solve, smooth.tighten)
    found = certified_solve(path, best.limits, order, progress, timing=timing)
    return replace(found, lower_estimate=best.lower_estimate)


def short_duration_error(duration: float, shortest: float) -> Infeasible:
    """Of a stated duration (s) below that of the fastest motion found; what it says to state is rounded up."""
    least = ceil(shortest * 1e6) / 1e6
    remedy = f"the fastest motion found within the limits takes {least:.6f} s: state that or more"
    return Infeasible(SHORT_DURATION, "", None, duration, least, "s", remedy)


def _refuse(path: ActuatorPath) -> None:
    """Raise MotionError for a path that asks for speeds, which a motion of another duration would not have."""
    pieces = range(len(path.breaks) - 1)
    asked = next((piece for piece in pieces if path.constant(piece) is not None), None)
    if asked is not None:
        place = path.place(float(path.breaks[asked]), asked)
        error = MotionError(f"{place}: a constant speed fixes the duration: omit one of the two")
        raise error.in_segment(place.segment)
    if max(path.end_speeds) > 0:
        raise MotionError(
            f"a stated duration goes from rest to rest, and this motion begins and ends at {path.end_speeds} along the "
            "path: omit the duration, or start_speed and end_speed"
        )


def cut_runs(path: ActuatorPath, best: Solution, order: int) -> dict[int, Profile]:
    """The fastest motion of each run, out of the whole, by the run's first piece."""
    motion = best.trajectory
    moves = (motion.v != 0) | (motion.a != 0) | (motion.j != 0)
    h, found = np.diff(motion.knots), {}
    for a, b in pairwise(np.flatnonzero(path.stops(order))):
        k = np.flatnonzero(moves & (motion.piece >= a) & (motion.piece < b))
        found[int(a)] = Profile(motion.s[k], motion.v[k], motion.a[k], motion.j[k], h[k], motion.piece[k])
    return found


def _axis_weights(path: ActuatorPath, axes: Sequence[Axis]) -> Array:
    breaks, pieces = path.breaks, np.arange(len(path.breaks) - 1)
    s = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, RANGE_POINTS)
    ranges = np.ptp(path.derivatives(s.ravel(), np.repeat(pieces, RANGE_POINTS))[0], axis=0)
    ranges = np.where(ranges > 1e-9 * ranges.max(), ranges, np.inf)
    bounds = [min(directional_bounds(axis.max_jerk)) for axis in axes]
    return np.where(np.isfinite(bounds), bounds, ranges)


@dataclass(frozen=True, slots=True)
class SmoothTiming:
    """The smoothest motion along a run: what `planner.timing.certified_solve.certified_solve` asks of a timing.

    slower   how many times as long as its fastest motion it shall take
    fastest  these motions, by the runs' first pieces
    """

    order: int
    axes: tuple[Axis, ...]
    weights: Array
    slower: float
    fastest: Mapping[int, Profile]

    def solve(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> RunSolution:
        slowed = self.fastest[run.first].slowed(self.slower)
        pacer = Pacer(path, tuple(limits), self.axes, run, self.order)
        first = self._smooth(path, grade_problem(path, limits, run, even_time_shares), slowed)
        if not pacer.late(first.profile):
            return first
        # below all bands, or through them fast: the smoother of the two
        tried, duration = [], slowed.duration
        paced = pacer.paced(duration)
        if paced is not None:
            tried.append(replace(first, fallback=paced, profile=paced, maker=PACED, tries=MAX_TRIES))
        below = pacer.fastest(pacer.below())
        if below is not None and below.duration <= duration:
            gentle = below.slowed(duration / below.duration)
            tried.append(self._smooth(path, grade_problem(path, pacer.below(), run, even_time_shares), gentle))
        kept = [one for one in tried if not pacer.late(one.profile)]
        if not kept:
            return RunSolution.refused(_stays_error(pacer, first.profile, duration, below))
        return min(kept, key=lambda one: self._roughness(path, one.profile))

    def tighten(
        self, path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
    ) -> RunSolution:
        """Solved with less room where a limit was exceeded; tried often enough, the motion that holds."""
        problem, slowed = solution.problem, solution.fallback
        if problem is None or slowed is None:  # none of ours
            return solution
        if solution.tries >= MAX_TRIES:
            return replace(solution, profile=slowed, maker=SLOWED)
        own = solution.aimed(use)
        blocks = tuple(tighten_block(block, own[block.name], solution.tries) for block in problem.blocks)
        return self._smooth(path, replace(problem, blocks=blocks), slowed, solution.tries)

    def _smooth(self, path: ActuatorPath, problem: Problem, slowed: Profile, tries: int = 0) -> RunSolution:
        """Solved within the rooms that are left; `slowed`, the fastest motion slowed, where there is no answer, or a
        rougher one.

        First from that one, which holds: from a motion outside the limits the solver often does not get inside.
        """
        most = self._roughness(path, slowed)
        for guess in (slowed.on(problem.s), quintic_motion(problem.s, slowed.duration)):
            found = solve_smoothest(path, problem, self.weights, guess)
            if found.solved and self._roughness(path, found.profile) <= most:
                return replace(found, fallback=slowed, tries=tries + 1)
        return RunSolution("solved", slowed, maker=SLOWED, problem=problem, tries=MAX_TRIES, fallback=slowed)

    def _roughness(self, path: ActuatorPath, profile: Profile) -> float:
        """∫ Σ_i (q⃛_i/w_i)² dt, by Simpson's rule on every time piece; ∞ where s̈ only steps, as without jerk limits."""
        if not profile.j.any():
            return inf
        motion, h, k = profile.along(path), profile.h, np.arange(len(profile.h))
        at = [((motion.within(k, share * h).qddd / self.weights) ** 2).sum(1) for share in (0.0, 0.5, 1.0)]
        return float((h / 6 * (at[0] + 4 * at[1] + at[2])).sum())


def _stays_error(pacer: Pacer, profile: Profile, duration: float, below: Profile | None) -> Infeasible:
    """What to say where axes stay in resonance bands too long, however the run is timed."""
    worst = max(pacer.late(profile), key=lambda stay: stay.use)
    axis = pacer.axes[worst.band.axis]
    scale, unit = (1e3, "mm/s") if axis.kind == "linear" else (180 / np.pi, "deg/s")
    band = f"{worst.band.low * scale:.6g} to {worst.band.high * scale:.6g} {unit}"
    where = profile.along(pacer.path).at(np.array([worst.start]))
    place = pacer.path.place(float(where.along[0]), int(where.piece[0]), None, axis.name)
    longer = inf if below is None else below.duration / duration
    more = f"state one {ceil(longer * 1000) / 1000:.3f} times as long, below all bands, or" if longer < inf else "state"
    remedy = (
        f"no motion of the stated duration was found that crosses the band from {band} in time: {more} a shorter one"
    )
    return Infeasible("resonance crossing", axis.name, place, worst.use * worst.band.time, worst.band.time, "s", remedy)
