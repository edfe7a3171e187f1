"""Fastest motion of a run that is straight in the actuators: seven pieces of constant jerk.

Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008), 3.4, in its
symbols, with bounds of its own for each direction (∞ without a limit). Where q′ is constant for
every axis, all limits are constant along the path:

    ṡ ≤ v_max,  −a_min ≤ s̈ ≤ a_max,  −j_min ≤ s⃛ ≤ j_max   (all positive here).

The motion accelerates to the largest speed that the length allows, at most v_max, cruises, and
decelerates. Where even the direct change from v_0 to v_1 is too long, it decelerates first, to the
largest speed from which it still reaches v_1. A deceleration is an acceleration run backwards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Term
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Block, Problem
from planner.timing.profile import Profile
from planner.timing.solution import STRAIGHT, RunSolution, TooFast

# Share of a limit by which rows may vary, or that curvature may use, on a straight run: a
# synchronised move that is drawn by a polynomial has so much. The motion leaves it unused.
STRAIGHTNESS_SHARE = 1e-8
# Share by which rounding may make a speed too high, or a length too short.
ROUNDING = 1e-11
# Halvings that narrow a bracket of one octave to rounding, and doublings that find it.
HALVINGS = 60
MAX_DOUBLINGS = 2000
# Ramps of ṡ and s̈ take at least this share of the duration. Shorter ones would vanish in the
# rounding of instants; longer ones would lengthen the motion by as much.
MIN_RAMP_SHARE = 1e-9
# Ramps between cruises take at least this many roundings of a path length: the proof of the tool's
# speed is off by about the inverse. A ramp to 10 µm/s at 60 mm takes 1.3 nm and 0.3 ms for it.
MIN_RAMP_ROUNDINGS = 1e8
# Share of the largest speed that limits allow along a ramp from which an end's speed counts as
# capped: cruises that follow a cap are slower than it by up to 5e-5.
MIN_CAPPED_SHARE = 1 - 1e-4
TANGENTIAL = (Term.SD, Term.SDD, Term.SDDD)

Piece = tuple[float, float, float]
"""s⃛, s̈ at the start, and duration."""


@dataclass(frozen=True, slots=True)
class _Ramp:
    """Change of ṡ with s̈ = 0 at both ends: |s̈| rises to its peak, stays there and falls."""

    peak: float
    rise: float
    hold: float
    fall: float

    def length(self, low: float) -> float:
        """Return the path length from or to its lower speed."""
        rise = self.rise
        hold = self.hold
        fall = self.fall
        gained = rise * rise / 6
        gained += hold * (rise + hold) / 2
        gained += fall * (rise / 2 + hold + fall / 3)
        return low * (rise + hold + fall) + self.peak * gained

    def pieces(self, sign: int) -> list[Piece]:
        """Return the pieces of an acceleration; sign −1: of a deceleration, which runs
        backwards.
        """
        if self.peak == 0:
            return []
        j_rise = self.peak / self.rise if self.rise > 0 else 0.0
        j_fall = self.peak / self.fall if self.fall > 0 else 0.0
        if sign > 0:
            return [
                (j_rise, 0.0, self.rise),
                (0.0, self.peak, self.hold),
                (-j_fall, self.peak, self.fall),
            ]
        return [
            (-j_fall, 0.0, self.fall),
            (0.0, -self.peak, self.hold),
            (j_rise, -self.peak, self.rise),
        ]


NO_RAMP = _Ramp(0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class _Bounds:
    """Constant bounds of ṡ, s̈ and s⃛ along a straight run."""

    v_max: float
    a_max: float
    a_min: float
    j_max: float
    j_min: float

    def ramp(self, change: float, sign: int) -> _Ramp:
        """Return the fastest acceleration by a change of ṡ; sign −1: deceleration."""
        if change <= 0:
            return NO_RAMP
        a = self.a_max if sign > 0 else self.a_min
        slowness = (1 / self.j_max + 1 / self.j_min) / 2
        if change >= a**2 * slowness:
            hold = change / a - a * slowness
        else:  # a is not reached
            a = float(np.sqrt(change / slowness))
            hold = 0.0
        rise = a / self.j_max
        fall = a / self.j_min
        if rise + hold == 0:  # too short for its duration to differ from zero
            return NO_RAMP
        peak = change / (rise / 2 + hold + fall / 2)
        return _Ramp(peak, rise, hold, fall)

    def change(self, start: float, end: float) -> tuple[float, list[Piece]]:
        """Return length and pieces of the fastest change from one speed to another."""
        sign = 1 if end > start else -1
        ramp = self.ramp(abs(end - start), sign)
        return ramp.length(min(start, end)), ramp.pieces(sign)

    def length(self, *speeds: float) -> float:
        """Return the path length of the fastest changes from speed to speed."""
        return sum(self.change(a, b)[0] for a, b in pairwise(speeds))

    def lengthen_ramps(self, length: float) -> "_Bounds":
        """Lower s̈ and s⃛ so that no ramp vanishes in the rounding of instants.

        A motion takes T ≥ L/v_max, √(L/a) and ∛(L/j); see MIN_RAMP_SHARE.
        """
        a = max(self.a_max, self.a_min)
        j = max(self.j_max, self.j_min)
        least = max(
            length / self.v_max,
            np.sqrt(length / a),
            np.cbrt(length / j),
        )
        shortest = MIN_RAMP_SHARE * least
        a = self.v_max / shortest
        lower = replace(self, a_max=min(self.a_max, a), a_min=min(self.a_min, a))
        if j == np.inf:
            return lower
        j = max(lower.a_max, lower.a_min) / shortest
        return replace(lower, j_max=min(self.j_max, j), j_min=min(self.j_min, j))

    def stretch_ramp(self, speeds: tuple[float, float], least: float) -> "_Bounds":
        """Lower s̈ and s⃛ so that the change between two speeds takes at least some length.

        With s̈ k times and s⃛ k² times as large, a ramp is 1/k times as long.
        """
        length = self.length(*speeds)
        if length >= least or length == 0:
            return self
        return self.scale(1.0, length / least, (length / least) ** 2)

    def scale(self, v: float, a: float, j: float) -> "_Bounds":
        """Return the bounds of ṡ, s̈ and s⃛ times factors."""
        return _Bounds(
            v * self.v_max,
            a * self.a_max,
            a * self.a_min,
            j * self.j_max,
            j * self.j_min,
        )


def straight(problem: Problem) -> RunSolution | None:
    """Find the fastest motion of a straight run, exact to rounding; None where it is not straight.

    A speed at an end is too fast if it is beyond v_max, or if the run is too short for it. The
    closed form has s̈ = 0 at both ends.
    """
    if any(end.acceleration != 0 for end in problem.ends):
        return None
    bounded = _bound_run(problem)
    if bounded is None:
        return None
    limits, unused = bounded
    aim = EXACT_AIM - unused
    bounds = limits.scale(aim, aim, aim)
    if max(problem.speeds) == 0:
        bounds = bounds.lengthen_ramps(_length(problem))
    return _find_fastest(problem, bounds)


def nearly_straight_ramp(problem: Problem, share: float) -> RunSolution | None:
    """Find a ramp from or to the capped speed that is nearly the fastest.

    Rows hardly vary along a short ramp, and curvature uses little: limits are lowered by twice the
    variation and by the use of curvature. The lower estimate is the time that the ramp would take
    within the full limits. None where variation or curvature are above the share, where a motion
    might be faster than the speeds at the ends, or where these have no such motion.
    """
    top_speed = max(problem.speeds)
    if top_speed == 0 or problem.piece[0] != problem.piece[-1]:
        return None
    if any(end.acceleration != 0 or end.zero_derivatives for end in problem.ends):
        return None
    bounded = _bound_run(problem, share, capped=True)
    if bounded is None:
        return None
    limits, unused = bounded
    if top_speed < MIN_CAPPED_SHARE * limits.v_max:
        return None
    aim = EXACT_AIM - unused
    farthest = float(np.abs(problem.s).max())
    bounds = replace(limits.scale(1.0, aim, aim), v_max=top_speed)
    used_speed = min(top_speed / limits.v_max, 1.0)
    bounds = bounds.stretch_ramp(problem.speeds, least_ramp(farthest))
    motion = _find_fastest(problem, bounds)
    if not motion.solved:
        return None
    return replace(motion, lower_estimate=aim * used_speed * motion.duration)


def least_ramp(s: float) -> float:
    """Return the least length (m) of a ramp at a path length, for the sake of its rounding.

    Along a shorter one the proof could not bound the path's direction, nor the tool's speed.
    """
    return MIN_RAMP_ROUNDINGS * float(np.finfo(float).eps) * abs(s)


def _find_fastest(problem: Problem, bounds: _Bounds) -> RunSolution:
    """Find the fastest motion under constant bounds."""
    length = _length(problem)
    v_0, v_1 = problem.speeds

    def excess(v: float) -> float:
        return bounds.length(v_0, v, v_1) - length

    too_fast = _check_ends(bounds, length, (v_0, v_1))
    if too_fast is not None:
        return RunSolution.refused(too_fast)
    high = max(v_0, v_1)
    if bounds.length(v_0, v_1) > length * (1 + ROUNDING):
        low = min(v_0, v_1)
        v = _find_root(lambda bottom: excess(bottom) if bottom < low else np.inf, 0.0)
    elif high >= bounds.v_max:
        v = high
    else:
        v = max(high, min(_find_root(excess, high), bounds.v_max))
    before, first = bounds.change(v_0, v)
    after, last = bounds.change(v, v_1)
    cruise = max(0.0, length - before - after) / v if v > 0 else 0.0
    profile = _join_pieces(problem, [*first, (0.0, 0.0, cruise), *last])
    return RunSolution("solved", profile, EXACT_AIM * profile.duration, STRAIGHT, problem)


def _check_ends(
    bounds: _Bounds,
    length: float,
    speeds: tuple[float, float],
) -> TooFast | None:
    """Return that the higher speed is too fast, with the largest that is possible, or None."""
    low = min(speeds)
    high = max(speeds)
    rises = speeds[1] > speeds[0]
    exceeds = high * EXACT_AIM > bounds.v_max * (1 + STRAIGHTNESS_SHARE)

    def between(start: float, end: float) -> float:
        """Return the length of a change on the way from the lower speed to the higher one."""
        return bounds.length(start, end) if rises else bounds.length(end, start)

    # the shortest motion stops first, or changes speed directly
    stop = between(low, 0.0)
    shortest = min(between(low, high), stop + between(0.0, high))
    if not exceeds and shortest <= length * (1 + ROUNDING):
        return None
    largest = _find_root(lambda v: between(low, v) - length, low)
    if stop < length:
        largest = max(largest, _find_root(lambda v: stop + between(0.0, v) - length, 0.0))
    return TooFast(int(rises), high, min(bounds.v_max / EXACT_AIM, largest))


def _bound_run(
    problem: Problem,
    share: float = STRAIGHTNESS_SHARE,
    capped: bool = False,
) -> tuple[_Bounds, float] | None:
    """Return constant limits, and the share of them that curvature and variation may use.

    share      largest share by which rows may vary, or that curvature may use; None beyond it
    capped     limits on speed may vary: the widest counts all along the run
    """
    if not problem.is_unconditional or not all(map(_is_plain, problem.blocks)):
        return None
    forwards = dict.fromkeys(TANGENTIAL, 0.0)
    backwards = dict.fromkeys(TANGENTIAL, 0.0)
    curving: list[tuple[Term, float]] = []
    variation = 0.0
    for block in problem.blocks:
        for term in block.start:
            values = np.concatenate([block.start[term], block.end[term]])
            size = float(np.abs(values).max(initial=0.0))
            if term not in TANGENTIAL:
                curving.append((term, size))
                continue
            if not (capped and term is Term.SD):
                difference = float(np.abs(values - values[0]).max(initial=0.0))
                variation = max(variation, difference / size if size else 0.0)
                values = values[:1]
            if variation > share:
                return None
            for use, sign in ((forwards, 1), (backwards, -1)):
                largest = block.share(sign * values).max(1, initial=0.0)
                use[term] = max(use[term], float(largest.min()))
    if not forwards[Term.SDDD] and not forwards[Term.SDD]:
        return None

    v_max, a_max, j_max = (_invert(forwards[term]) for term in TANGENTIAL)
    _, a_min, j_min = (_invert(backwards[term]) for term in TANGENTIAL)
    limits = _Bounds(v_max, a_max, a_min, j_max, j_min)
    curvature = _bound_curvature(limits, _length(problem), curving)
    if curvature > share:
        return None
    return limits, 2 * variation + curvature


def _is_plain(block: Block) -> bool:
    """Return whether rows have their usual room, and bound ṡ, s̈ and s⃛ each by itself."""
    usual = (block.room == SOLVER_AIM) | (block.room == 1)
    bounded = [term for term in TANGENTIAL if np.any(block.start.get(term))]
    return bool(usual.all()) and len(bounded) < 2


def _invert(use: float) -> float:
    return 1 / use if use else float("inf")


def _bound_curvature(
    bounds: _Bounds,
    length: float,
    curving: Sequence[tuple[Term, float]],
) -> float:
    """Return the largest use of limits by terms that a straight run does not have."""
    # ṡ and s̈ that can be reached within the length, where no limit bounds them
    a = max(bounds.a_max, bounds.a_min)
    j = max(bounds.j_max, bounds.j_min)
    v = min(
        bounds.v_max,
        np.sqrt(2 * a * length),
        2 * np.cbrt(j * length**2),
    )
    a = min(a, 2 * np.cbrt(j**2 * length))
    most = {
        Term.ONE: np.inf,
        Term.SD2: v**2,
        Term.SD3: v**3,
        Term.SDSDD: v * a,
    }
    return float(sum(size * most[term] for term, size in curving if size))


def _length(problem: Problem) -> float:
    return float(problem.s[-1] - problem.s[0])


def _find_root(rising: Callable[[float], float], low: float) -> float:
    """Return the zero of a rising function that is not above 0 at `low`; ∞ without one."""
    step = low if low > 0 else 1.0
    while step > 0 and rising(low + step) > 0:
        step /= 2
    high = low + 2 * step
    for _ in range(MAX_DOUBLINGS):
        if rising(high) > 0:
            break
        low = high
        high = 2 * high
    else:
        return float("inf")
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if rising(middle) > 0:
            high = middle
        else:
            low = middle
    return low


def _join_pieces(problem: Problem, pieces: Sequence[Piece]) -> Profile:
    """Return the pieces one after the other, cut where the path's own pieces end."""
    lasting = [piece for piece in pieces if piece[2] > 0]
    j, a, h = np.array(lasting).T
    v = problem.speeds[0] + _sum_before(h * (a + h * j / 2))
    s = problem.s[0] + _sum_before(h * (v + h * (a / 2 + h * j / 6)))
    first = int(problem.piece[0])
    profile = Profile(s, v, a, j, h, np.full(len(h), first))
    is_break = np.diff(problem.piece, prepend=-1, append=-1) != 0
    return profile.cut(problem.s[is_break], first)


def _sum_before(values: Array) -> Array:
    return np.append(0.0, np.cumsum(values)[:-1])
