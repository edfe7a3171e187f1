"""A motion of a stated duration: the smoothest that there is within it, certified."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil, inf

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis, sides
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.pacing import Pacer
from planner.parallel import Progress
from planner.place import Infeasible
from planner.solve import Solution, fastest, proved
from planner.timing.leg import TRIES, tightened
from planner.timing.posing import graded
from planner.timing.problem import AIM, Problem, Run
from planner.timing.profile import Profile
from planner.timing.smoothest import even, quintic, smoothest

# A duration so little above the shortest leaves no choice of motion.
NO_CHOICE = 1e-6
# Points of a piece at which the ranges of the axes are looked at.
LOOKED = 17
SMOOTHEST, SLOWED, PACED = "smoothest", "slowed", "paced"


def within(
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
    best = fastest(path, limits, order, progress)
    shortest = best.trajectory.duration
    if not duration >= shortest:
        least = ceil(shortest * 1e6) / 1e6
        remedy = f"no motion within the limits is shorter than {least:.6f} s: state that, or more"
        raise Infeasible("duration", "", None, duration, least, "s", remedy)
    if duration <= shortest * (1 + NO_CHOICE):
        return best
    rests = float(path.dwells.sum())
    slower = (duration - rests) / (shortest - rests)
    smooth = Smooth(order, tuple(axes), _weights(path, axes), slower, _runs(path, best, order))
    return replace(proved(path, best.limits, order, smooth, progress), lower_estimate=best.lower_estimate)


def _refuse(path: ActuatorPath) -> None:
    """Raise MotionError for a path that asks for speeds, which a motion of another duration would not have."""
    pieces = range(len(path.breaks) - 1)
    asked = next((piece for piece in pieces if path.constant(piece) is not None), None)
    if asked is not None:
        where = path.place(float(path.breaks[asked]), asked)
        raise MotionError(f"{where}: a constant speed leaves no choice of duration: leave out one of the two")
    if max(path.end_speeds) > 0:
        raise MotionError(
            f"a stated duration goes from rest to rest, and this motion begins and ends at {path.end_speeds} along the "
            "path: leave out the duration, or start_speed and end_speed"
        )


def _runs(path: ActuatorPath, best: Solution, order: int) -> dict[int, Profile]:
    """The fastest motion of each run, out of the whole, by the run's first piece."""
    motion = best.trajectory
    moves = (motion.v != 0) | (motion.a != 0) | (motion.j != 0)
    h, found = np.diff(motion.knots), {}
    for a, b in pairwise(np.flatnonzero(path.stops(order))):
        k = np.flatnonzero(moves & (motion.piece >= a) & (motion.piece < b))
        found[int(a)] = Profile(motion.s[k], motion.v[k], motion.a[k], motion.j[k], h[k], motion.piece[k])
    return found


def _weights(path: ActuatorPath, axes: Sequence[Axis]) -> Array:
    breaks, pieces = path.breaks, np.arange(len(path.breaks) - 1)
    s = breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, LOOKED)
    ranges = np.ptp(path.derivatives(s.ravel(), np.repeat(pieces, LOOKED))[0], axis=0)
    ranges = np.where(ranges > 1e-9 * ranges.max(), ranges, np.inf)
    bounds = [min(sides(axis.max_jerk)) for axis in axes]
    return np.where(np.isfinite(bounds), bounds, ranges)


@dataclass(frozen=True, slots=True)
class Smooth:
    """The smoothest motion along a run: what `planner.solve.proved` asks of a timing.

    slower   how many times as long as its fastest motion it shall take
    fastest  these motions, by the runs' first pieces
    """

    order: int
    axes: tuple[Axis, ...]
    weights: Array
    slower: float
    fastest: Mapping[int, Profile]

    def __call__(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> "Smoothed":
        slowed = self.fastest[run.first].slowed(self.slower)
        pacer = Pacer(path, tuple(limits), self.axes, run, self.order)
        first = self._posed(path, limits, run, slowed).solved()
        if not pacer.late(first.profile):
            return first
        # below all bands, or through them fast: the smoother of the two
        tried, duration = [], slowed.duration
        paced = pacer.paced(duration)
        if paced is not None:
            tried.append(replace(first, slowed=paced, profile=paced, method=PACED, tries=TRIES))
        below = pacer.fastest(pacer.below())
        if below is not None and below.duration <= duration:
            gentle = below.slowed(duration / below.duration)
            tried.append(self._posed(path, pacer.below(), run, gentle).solved())
        kept = [one for one in tried if not pacer.late(one.profile)]
        if not kept:
            raise _stays(pacer, first.profile, duration, below)
        return min(kept, key=Smoothed.roughness)

    def _posed(self, path: ActuatorPath, limits: Sequence[Limit], run: Run, slowed: Profile) -> "Smoothed":
        return Smoothed(path, graded(path, limits, run, even), self.weights, slowed, slowed, SLOWED, 0)


def _stays(pacer: Pacer, profile: Profile, duration: float, below: Profile | None) -> Infeasible:
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


@dataclass(frozen=True, slots=True)
class Smoothed:
    """A motion that takes as long as `slowed`, the fastest one slowed, which holds whatever else does not."""

    path: ActuatorPath = field(repr=False)
    problem: Problem
    weights: Array
    slowed: Profile
    profile: Profile
    method: str
    tries: int

    @property
    def floor(self) -> float:
        """None of its own: the fastest motion has an estimate."""
        return 0.0

    def roughness(self) -> float:
        """∫ Σ_i (q⃛_i/w_i)² dt, by Simpson's rule on every time piece; ∞ where s̈ only steps, as without jerk limits."""
        if not self.profile.j.any():
            return inf
        motion, h, k = self.profile.along(self.path), self.profile.h, np.arange(len(self.profile.h))
        at = [((motion.within(k, share * h).qddd / self.weights) ** 2).sum(1) for share in (0.0, 0.5, 1.0)]
        return float((h / 6 * (at[0] + 4 * at[1] + at[2])).sum())

    def solved(self) -> "Smoothed":
        """Solved within the rooms that are left; the fastest motion slowed where there is no answer, or a rougher one.

        First from that one, which holds: from a motion outside the limits the solver often does not get inside.
        """
        slowed = replace(self, profile=self.slowed, method=SLOWED, tries=TRIES)
        s = self.problem.s
        for guess in (self.slowed.on(s), quintic(s, self.slowed.duration)):
            try:
                profile = smoothest(self.path, self.problem, self.weights, guess)
            except MotionError:
                continue
            found = replace(self, profile=profile, method=SMOOTHEST, tries=self.tries + 1)
            if found.roughness() <= slowed.roughness():
                return found
        return slowed

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Smoothed":
        if self.tries >= TRIES:
            return replace(self, profile=self.slowed, method=SLOWED, tries=TRIES)
        blocks = tuple(tightened(block, use[block.name] / AIM, self.tries) for block in self.problem.blocks)
        return replace(self, problem=replace(self.problem, blocks=blocks)).solved()
