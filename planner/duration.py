"""A motion of a stated duration: the smoothest that there is within it, certified."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import ceil

import numpy as np

from kinematics.array import Array
from kinematics.axis import Axis, sides
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE
from planner.hastened import CROSSING, Crossing, crossing, hastened
from planner.limits.limit import Limit
from planner.limits.resonance import Held, Resonance
from planner.parallel import Progress
from planner.place import Infeasible
from planner.proved import holding
from planner.solve import Solution, fastest, proved
from planner.stays import Stay, stays
from planner.timing.posing import graded
from planner.timing.problem import Problem, Run
from planner.timing.profile import Profile
from planner.timing.run import MARGIN, MORE, TRIES
from planner.timing.smoothest import even, quintic, smoothest

# A duration so little above the shortest leaves no choice of motion.
NO_CHOICE = 1e-6
# Points of a piece at which the ranges of the axes are looked at.
LOOKED = 17
# How often a run is solved for axes that stay in resonance bands too long to go through them faster.
CROSSINGS = 4
SMOOTHEST, SLOWED = "smoothest", "slowed"


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
    shortest time goes with the cube root of their length, that is also how the total becomes least. Raises Infeasible,
    with the shortest, for less than that; MotionError where the path asks for speeds.
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
    smooth = Smooth(order, _weights(path, axes), slower, _runs(path, best, order))
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
    weights: Array
    slower: float
    fastest: Mapping[int, Profile]

    def __call__(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> "Smoothed":
        slowed = self.fastest[run.first].slowed(self.slower)
        first = self._posed(path, limits, run, slowed).solved()
        bands = [limit for limit in limits if isinstance(limit, Resonance) and limit.bands]
        if not bands or not _too_long(path, bands[0], first.profile):
            return first
        # through the bands as fast as they ask for, or below all of them: the smoother of the two
        ends = run.breaks(path)[[0, -1]].tolist()
        below = holding(limits, [Held(band, *ends) for band in bands[0].bands])
        tried = [_crossing(first, bands[0]), self._posed(path, below, run, slowed).solved()]
        kept = [one for one in tried if one.method == SMOOTHEST and not _too_long(path, bands[0], one.profile)]
        return min(kept, key=Smoothed.roughness, default=first)

    def _posed(self, path: ActuatorPath, limits: Sequence[Limit], run: Run, slowed: Profile) -> "Smoothed":
        return Smoothed(path, graded(path, limits, run, even), self.weights, slowed, slowed, SLOWED, 0)


def _too_long(path: ActuatorPath, limit: Resonance, profile: Profile) -> list[Stay]:
    return [stay for stay in stays(profile.along(path), limit) if stay.use > 1 + TOLERANCE]


def _crossing(tried: "Smoothed", limit: Resonance) -> "Smoothed":
    """Solved again until no axis stays too long in a band that it goes through, or that does not help."""
    found: list[Crossing] = []
    for _ in range(CROSSINGS):
        motion = tried.profile.along(tried.path)
        new = [crossing(tried.path, motion, stay) for stay in _too_long(tried.path, limit, tried.profile)]
        if not new or tried.method != SMOOTHEST or None in new:
            break
        found += [each for each in new if each is not None]
        tried = replace(tried, problem=hastened(tried.path, tried.problem, found)).solved()
    return tried


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
        """∫ Σ_i (q⃛_i/w_i)² dt, by Simpson's rule on every time piece."""
        motion, k = self.profile.along(self.path), np.arange(len(self.profile.h))
        at = [((motion.within(k, share * self.profile.h).qddd / self.weights) ** 2).sum(1) for share in (0.0, 0.5, 1.0)]
        return float((self.profile.h / 6 * (at[0] + 4 * at[1] + at[2])).sum())

    def solved(self) -> "Smoothed":
        """Solved within the rooms that are left; the fastest motion slowed where there is no answer."""
        again = self.method == SMOOTHEST and len(self.profile.h) == self.problem.intervals
        guess = self.profile.columns() if again else quintic(self.problem.s, self.slowed.duration)
        try:
            found = smoothest(self.path, self.problem, self.weights, guess)
        except MotionError:
            return replace(self, profile=self.slowed, method=SLOWED, tries=TRIES)
        return replace(self, profile=found, method=SMOOTHEST, tries=self.tries + 1)

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Smoothed":
        if self.tries >= TRIES:
            return replace(self, profile=self.slowed, method=SLOWED, tries=TRIES)
        blocks = []
        for block in self.problem.blocks:
            if block.name == CROSSING:
                blocks.append(block)
                continue
            excess = use[block.name]
            less = block.room / (1 + MORE * self.tries * (excess - 1)) * (1 - MARGIN)
            blocks.append(replace(block, room=np.where(excess > 1, less, block.room)))
        return replace(self, problem=replace(self.problem, blocks=tuple(blocks))).solved()
