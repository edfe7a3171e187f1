"""Feed-limited runs: cruise at the capped tool speed, and solve the ramps between cruises only.

Most runs of a mill, a router or a laser reach the programmed feed within micrometres and keep it
almost to their end. Where the cap c on the tool's speed is the only limit that binds, the fastest
motion follows it. It passes every place of such a stretch in one known state, so the run falls
into parts whose shortest times add up exactly:

    ramp to c, cruise at c, ramp from c to the next cap or to rest, …

A ramp lies at each end of the run, at each change of the cap, and around each stretch on which
another limit does not allow the cap. A grid over the whole run would have to resolve ramps of
microseconds next to cruises of minutes; each ramp by itself is an ordinary problem.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Term
from planner.limits.resonance import Resonance
from planner.timing.cruise import Caps, find_caps, follow_cap
from planner.timing.grid import Task
from planner.timing.initial_guess import bound_term, reduce_pieces
from planner.timing.order2.closed_form import least_ramp
from planner.timing.order2.second_order import is_of_speed
from planner.timing.problem import POWERS, EndCondition, Problem, Run
from planner.timing.solution import FEED_LIMITED, RunSolution

# Largest use of the other limits at which the tool may cruise: the rest is for peaks between the
# samples.
MAX_CRUISING_USE = 0.95
# Ramps are given the room that they need at these shares of the allowed acceleration and jerk, one
# after the other: the first leaves the longest cruises, but too little room for some ramps.
RAMP_SHARES = (0.5, 0.05)
# Share by which rounding may make a cap differ from the same cap in the window before.
SPEED_ROUNDING = 1e-13
# Share of a ramp's largest speed and acceleration by which its ends may differ from the cruise's.
SAME_STATE = 1e-9
# Share of the duration of a run's cruises that each of its ramps may lose.
NEGLIGIBLE_SHARE = 5e-7


Stretch = tuple[float, float]
"""Path lengths between which a part of a run lies."""


@dataclass(frozen=True, slots=True)
class Part:
    """Part of a run, and its motion if it is a cruise."""

    run: Run
    cruise: RunSolution | None = None


@dataclass(frozen=True, slots=True)
class FeedLimitedRun:
    """Run whose tool may cruise at its cap."""

    task: Task

    def solve(self, solve: Callable[[Task], RunSolution]) -> RunSolution | None:
        """Join the cruises of the run and the fastest motions between them.

        solve  finds the fastest motion of a part of the run, from and to given speeds

        None where no stretch of the run is feed-limited, or a part has no solution.
        """
        if any(isinstance(limit, Resonance) and limit.bands for limit in self.task.limits):
            return None  # an axis may have to cross a band elsewhere than at the cap
        caps = find_caps(self.task)
        if caps is None:
            return None
        for share in RAMP_SHARES:
            parts = self._cut_into_parts(caps, share)
            solution = self._join_parts(parts, solve)
            if solution is not None or not parts:
                return solution
        return None

    def _join_parts(
        self,
        parts: Sequence[Part],
        solve: Callable[[Task], RunSolution],
    ) -> RunSolution | None:
        """Join cruises and solved ramps; None without parts, or where a ramp has no solution."""
        if not parts:
            return None
        cruising = sum(part.cruise.duration for part in parts if part.cruise is not None)
        tolerant = replace(self.task, negligible=NEGLIGIBLE_SHARE * cruising)
        solutions: list[RunSolution] = []
        for number, part in enumerate(parts):
            solution = part.cruise
            if solution is None:
                ramp = self._meet_cruises(parts, number)
                solution = solve(tolerant.with_run(ramp))
                if not solution.solved or not self._is_joined(solution, ramp):
                    return None
            solutions.append(solution)
        return RunSolution.joined(solutions, FEED_LIMITED)

    def _cut_into_parts(self, caps: Caps, share: float) -> list[Part]:
        """Cut the run into cruises and the ramps between them; no parts without a cruise.

        share  of the allowed acceleration and jerk for which ramps have room
        """
        path = self.task.path
        whole = replace(self.task.run, whole=True)
        breaks = whole.breaks(path)
        parts: list[Part] = []
        place = float(breaks[0])
        for first, last in self._find_cruises(caps, breaks, share):
            stretch = whole.cut(path, first, last)
            cruise = follow_cap(self.task.with_run(stretch), caps)
            if cruise is None:
                continue
            if first > place:
                parts.append(Part(whole.cut(path, place, first)))
            parts.append(Part(stretch, cruise))
            place = last
        end = float(breaks[-1])
        if parts and place < end:
            parts.append(Part(whole.cut(path, place, end)))
        return parts

    def _find_cruises(self, caps: Caps, breaks: Array, share: float) -> list[Stretch]:
        """List the stretches of the run on which the fastest motion keeps the capped speed.

        A ramp to or from a cap lies within the stretch of path that has this cap.
        """
        sketch = self.task.sketch
        pieces = sketch.piece - self.task.run.first
        acceleration = reduce_pieces(np.minimum, bound_term(sketch, Term.SDD), pieces)
        jerk = reduce_pieces(np.minimum, bound_term(sketch, Term.SDDD), pieces)
        ramps = _bound_ramps(caps.fastest, share * acceleration, share * jerk)
        ramps = np.maximum(ramps, 2 * least_ramp(float(breaks[-1])))
        busy = np.flatnonzero(_find_cruising_use(sketch, caps) > MAX_CRUISING_USE)
        changes = caps.find_changes(breaks, self.task.order, acceleration)
        start, end = self.task.run.ends
        cruises: list[Stretch] = []
        for first, after in pairwise([0, *changes.tolist(), len(breaks) - 1]):
            if not caps.capped[first]:
                continue
            ramp = float(ramps[first:after].max())
            begins = first == 0 and _cruises_at(start, caps.along[0])
            ends = after == len(breaks) - 1 and _cruises_at(end, caps.along[-1])
            since = float(breaks[first])
            until = float(breaks[after])
            blocked = [
                (since, since if begins else since + ramp),
                (until if ends else until - ramp, until),
            ]
            low, high = np.searchsorted(pieces[busy], [first, after])
            for k in busy[low:high]:
                blocked.append((float(sketch.s[k]) - ramp, float(sketch.s[k + 1]) + ramp))
            for (_, since), (until, _) in pairwise(_join_overlapping(blocked)):
                if until - since > ramp:
                    cruises.append((since, until))
        return cruises

    def _meet_cruises(self, parts: Sequence[Part], number: int) -> Run:
        """Return a part that is a ramp, in the states of the cruises next to it at its ends."""
        ramp = parts[number].run
        start, end = ramp.ends
        if number > 0 and (cruise := parts[number - 1].cruise) is not None:
            profile = cruise.profile
            start = EndCondition(profile.last_speed, profile.last_acceleration)
        if number + 1 < len(parts) and (cruise := parts[number + 1].cruise) is not None:
            profile = cruise.profile
            end = EndCondition(float(profile.v[0]), float(profile.a[0]))
        if self.task.order == 2:
            start = replace(start, acceleration=0.0)
            end = replace(end, acceleration=0.0)
        return replace(ramp, ends=(start, end))

    def _is_joined(self, solution: RunSolution, ramp: Run) -> bool:
        """Return whether a ramp meets its cruises. One that was slowed as a whole does not."""
        profile = solution.profile
        largest_v = SAME_STATE * float(profile.v.max())
        largest_a = SAME_STATE * float(np.abs(profile.a).max())
        start, end = ramp.ends
        states = (
            (start, float(profile.v[0]), float(profile.a[0])),
            (end, profile.last_speed, profile.last_acceleration),
        )
        for condition, v, a in states:
            if condition.speed == 0:  # at rest, no cruise is next to it
                continue
            if abs(v - condition.speed) > largest_v:
                return False
            if self.task.order == 3 and abs(a - condition.acceleration) > largest_a:
                return False
        return True


def _cruises_at(end: EndCondition, cap: float) -> bool:
    """Return whether a run begins or ends at its cap already."""
    if end.acceleration != 0 or cap == np.inf:
        return False
    return abs(end.speed - cap) <= SPEED_ROUNDING * cap


def _bound_ramps(speed: Array, acceleration: Array, jerk: Array) -> Array:
    """Return the lengths (P,) within which each piece's cap is surely reached from rest.

    With s̈ ≤ A and s⃛ ≤ J a ramp to c takes c²/2A, and with jerk (c/2)(c/A + A/J), or c √(c/J)
    where A is not reached.
    """
    with np.errstate(invalid="ignore"):
        peak = np.minimum(acceleration, np.sqrt(speed * jerk))
        length = speed / 2 * (speed / peak + np.where(jerk < np.inf, peak / jerk, 0.0))
    return np.where(np.isnan(length), np.inf, length)


def _find_cruising_use(sketch: Problem, caps: Caps) -> Array:
    """Return the largest use (N,) of any limit but those on speed, at the capped speed."""
    largest = np.full(sketch.intervals, np.inf)
    capped = np.flatnonzero(caps.capped[sketch.piece - caps.first])
    largest[capped] = 0.0
    for side, places in (("start", sketch.s[:-1]), ("end", sketch.s[1:])):
        v, a = caps.at(places[capped], sketch.piece[capped])
        terms = {term: v**power for term, power in POWERS.items()}
        terms |= {Term.SDD: a, Term.SDSDD: v * a}
        for block in sketch.blocks:
            if is_of_speed(block):
                continue
            values = np.zeros((sketch.intervals, len(block.middle)))
            for term, coefficients in getattr(block, side).items():
                if term in terms:
                    values[capped] += coefficients[capped] * terms[term][:, None]
            largest = np.maximum(largest, block.share(values).max(1, initial=0.0))
    return largest


def _join_overlapping(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Join the stretches that overlap, and put them in order."""
    joined: list[Stretch] = []
    for first, last in sorted(stretches):
        if joined and first <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], last)
        else:
            joined.append((first, last))
    return joined
