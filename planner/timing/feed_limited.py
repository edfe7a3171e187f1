"""Feed-limited runs: cruise at the capped tool speed, and solve only what lies between cruises.

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
from dataclasses import replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Limit, Term
from planner.limits.resonance import Resonance
from planner.path.actuation import ActuatorPath
from planner.timing.cruise import Caps, find_caps, follow_cap, is_of_speed, spread_points
from planner.timing.initial_guess import bound_term
from planner.timing.order2.closed_form import least_ramp, straight_ramp
from planner.timing.problem import POWERS, EndCondition, Problem, Run
from planner.timing.rows import pose_problem
from planner.timing.solution import FEED_LIMITED, RunSolution

# Intervals of a piece, and for each radian that it turns, at whose ends the limits are evaluated.
# Too few would miss a peak of a limit's use; the proof finds such a peak, and the run is then
# solved as a whole.
SAMPLES_PER_PIECE, SAMPLES_PER_RADIAN = 8, 8
# Largest use of the other limits at which the tool may cruise: the rest is for what lies between
# the samples.
MAX_CRUISING_USE = 0.95
# Ramps are given the room that they need at this share of the allowed acceleration and jerk.
# More could leave too little room for a ramp, less would lengthen the parts that are solved.
RAMP_SHARE = 0.5
# Share by which rounding may tell a cap from the same cap in the window before.
SPEED_ROUNDING = 1e-13
# Share of a ramp's largest speed and acceleration up to which those at its ends are as they should
# be.
SAME_STATE = 1e-9
# A closed form may lengthen a run by this share of its duration, and leave unused up to this share
# of the limits on its ramps.
CLOSED_FORM_LOSS, MAX_UNUSED_SHARE = 1e-7, 0.02


def sketch_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Problem:
    """Pose a run's rows at a few places of each piece: enough to see where limits bind."""
    turns = path.turns[run.first : run.last + 1]
    count = SAMPLES_PER_PIECE + np.ceil(SAMPLES_PER_RADIAN * turns).astype(int)
    s, piece = spread_points(run.breaks(path), count, run.first)
    return pose_problem(path, limits, s, piece, run.ends)


def solve_feed_limited(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    sketch: Problem,
    solve: Callable[[Run], RunSolution],
    *,
    order: int,
) -> RunSolution | None:
    """Join the cruises of a run and the fastest motions between them.

    sketch  rows of the run at a few places (`sketch_problem`)
    solve   finds the fastest motion of a part of the run, from and to given speeds

    None where no stretch of the run is feed-limited, or a part has no solution.
    """
    if any(isinstance(limit, Resonance) and limit.bands for limit in limits):
        return None  # an axis may have to cross a band elsewhere than at the cap
    caps = find_caps(path, limits, run, sketch)
    if caps is None:
        return None
    parts: list[tuple[Run, RunSolution | None]] = []
    breaks = run.breaks(path)
    place = float(breaks[0])
    whole = replace(run, whole=True)
    for first, last in _find_cruises(run, sketch, caps, breaks, order):
        stretch = whole.cut(path, first, last)
        cruise = follow_cap(path, limits, caps, stretch, order)
        if cruise is None:
            continue
        if first > place:
            parts.append((whole.cut(path, place, first), None))
        parts.append((stretch, cruise))
        place = last
    if not parts:
        return None
    if place < breaks[-1]:
        parts.append((whole.cut(path, place, float(breaks[-1])), None))
    return _solve_ramps(path, limits, parts, solve, order)


def _find_cruises(
    run: Run,
    sketch: Problem,
    caps: Caps,
    breaks: Array,
    order: int,
) -> list[tuple[float, float]]:
    """List the stretches of a run on which the fastest motion keeps the capped speed.

    A ramp to or from a cap lies within the stretch of path that has this cap.
    """
    pieces = sketch.piece - run.first
    acceleration = _least_on_pieces(bound_term(sketch, Term.SDD), pieces)
    jerk = _least_on_pieces(bound_term(sketch, Term.SDDD), pieces)
    ramps = _bound_ramps(caps.fastest, RAMP_SHARE * acceleration, RAMP_SHARE * jerk)
    ramps = np.maximum(ramps, 2 * least_ramp(float(breaks[-1])))
    busy = np.flatnonzero(_find_cruising_use(sketch, caps) > MAX_CRUISING_USE)
    changes = caps.find_changes(breaks, order, acceleration)
    cruises = []
    for first, after in pairwise([0, *changes.tolist(), len(breaks) - 1]):
        if not caps.capped[first]:
            continue
        ramp = float(ramps[first:after].max())
        begin, end = float(breaks[first]), float(breaks[after])
        ends = first == 0, after == len(breaks) - 1
        continues = ends[0] and _cruises_at(run.ends[0], caps.along[0])
        blocked = [(begin, begin if continues else begin + ramp)]
        low, high = np.searchsorted(pieces[busy], [first, after])
        for interval in busy[low:high]:
            blocked.append((float(sketch.s[interval]) - ramp, float(sketch.s[interval + 1]) + ramp))
        continues = ends[1] and _cruises_at(run.ends[1], caps.along[-1])
        blocked.append((end if continues else end - ramp, end))
        for (_, since), (until, _) in pairwise(_join_overlapping(blocked)):
            if until - since > ramp:
                cruises.append((since, until))
    return cruises


def _cruises_at(end: EndCondition, cap: float) -> bool:
    """Return whether a run begins or ends at its cap already."""
    if end.acceleration != 0 or cap == np.inf:
        return False
    return abs(end.speed - cap) <= SPEED_ROUNDING * cap


def _least_on_pieces(values: Array, pieces: np.ndarray) -> Array:
    """Return the least of values (N,) on each of some pieces, which are given for each value (N,)."""
    least = np.full(pieces[-1] + 1, np.inf)
    np.minimum.at(least, pieces, values)
    return least


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
    for name, places in (("start", sketch.s[:-1]), ("end", sketch.s[1:])):
        v, a = caps.at(places[capped], sketch.piece[capped])
        terms = {term: v**power for term, power in POWERS.items()}
        terms |= {Term.SDD: a, Term.SDSDD: v * a}
        for block in sketch.blocks:
            if is_of_speed(block):
                continue
            values = np.zeros((sketch.intervals, len(block.middle)))
            for term, coefficients in getattr(block, name).items():
                if term in terms:
                    values[capped] += coefficients[capped] * terms[term][:, None]
            largest = np.maximum(largest, block.share(values).max(1, initial=0.0))
    return largest


def _join_overlapping(stretches: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Join the stretches that overlap, and put them in order."""
    joined: list[tuple[float, float]] = []
    for first, last in sorted(stretches):
        if joined and first <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], last)
        else:
            joined.append((first, last))
    return joined


def _solve_ramps(
    path: ActuatorPath,
    limits: Sequence[Limit],
    parts: Sequence[tuple[Run, RunSolution | None]],
    solve: Callable[[Run], RunSolution],
    order: int,
) -> RunSolution | None:
    """Join cruises and the ramps between them, which begin and end at the cruises' speeds.

    None where a ramp has no solution.
    """
    cruising = sum(cruise.duration for _, cruise in parts if cruise is not None)
    solutions: list[RunSolution] = []
    for k, (part, cruise) in enumerate(parts):
        if cruise is None:
            before = parts[k - 1][1] if k > 0 else None
            after = parts[k + 1][1] if k + 1 < len(parts) else None
            start, end = part.ends
            if before is not None:
                a = before.profile.last_acceleration if order == 3 else 0.0
                start = EndCondition(before.profile.last_speed, a)
            if after is not None:
                a = float(after.profile.a[0]) if order == 3 else 0.0
                end = EndCondition(float(after.profile.v[0]), a)
            part = replace(part, ends=(start, end))
            cruise = _solve_ramp(path, limits, part, cruising, solve)
            if not cruise.solved:
                return None
            for side, neighbour in enumerate((before, after)):
                if neighbour is not None and not _meets(cruise, part, side, order):
                    return None
        solutions.append(cruise)
    return RunSolution.joined(solutions, FEED_LIMITED)


def _meets(ramp: RunSolution, part: Run, end: int, order: int) -> bool:
    """Return whether a ramp has the speed and acceleration of the cruise at its start or end.

    end  0 for the start, 1 for the end. A solution that was slowed as a whole does not.
    """
    profile = ramp.profile
    v = profile.last_speed if end else float(profile.v[0])
    a = profile.last_acceleration if end else float(profile.a[0])
    acceleration = part.ends[end].acceleration
    if abs(v - part.speeds[end]) > SAME_STATE * float(profile.v.max()):
        return False
    return order == 2 or abs(a - acceleration) <= SAME_STATE * float(np.abs(profile.a).max())


def _solve_ramp(
    path: ActuatorPath,
    limits: Sequence[Limit],
    part: Run,
    cruising: float,
    solve: Callable[[Run], RunSolution],
) -> RunSolution:
    """Find the fastest motion of one part: in closed form where that costs next to nothing."""
    plain = all(end.acceleration == 0 and end.zero_derivatives == 0 for end in part.ends)
    if part.first == part.last and plain and max(part.speeds) > 0:
        sketch = sketch_problem(path, limits, part)
        length = float(sketch.s[-1] - sketch.s[0])
        share = CLOSED_FORM_LOSS * cruising * max(part.speeds) / length
        ramp = straight_ramp(sketch, min(share, MAX_UNUSED_SHARE))
        if ramp is not None:
            return ramp
    return solve(part)
