"""Motions from which a jerk-limited solve starts.

**Averaged.** Usually the acceleration-limited motion, averaged in time over a window w:

    s̃(t) = 1/w ∫ s dt over [t − w, t],  with s⃛ = (s̈(t) − s̈(t − w))/w.

It takes w longer. A step of s̈ becomes a ramp; with w = A/J the average is within a percent of the
optimum where acceleration binds, and s̈ = 0 at both its ends.

**Past slow breaks.** On a piece with q‴, constant ṡ causes a jerk q‴ ṡ³, so that no more than
ṡ = (J/|q‴|)^⅓ gets through. The order-2 motion passes at √(A/|q″|): through a blend of reach d,
that is
d^(1/2) instead of d^(2/3), too fast by ever more in smaller blends. From there solvers find no
motion, and from rest at such breaks only one of many slow ones. There the start has ramps of
constant
jerk from break to break.

**Brief ramps.** If 4w is below a thousandth of the motion, no solver can tell ramps of s̈ from
steps.
The average is then the answer: the order-2 motion is at least as short as the fastest jerk-limited
one, so that the average takes at most 4w longer than that.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array, bisect, largest_in_rows
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import Floats1, kernel
from planner.limits.limit import Term
from planner.timing.order2.second_order import TERMS as ORDER_2_TERMS
from planner.timing.order2.second_order import second_order
from planner.timing.problem import Block, Problem
from planner.timing.profile import Profile

# Two instants are the same if they differ by this share of the duration: rounding.
SAME_INSTANT = 1e-12
# Share of the largest jerk from which a piece counts as one of a ramp.
ACTING_SHARE = 0.02
# Least step of a grid as a share of an even one's: a step of 0 would divide by zero.
MIN_STEP_SHARE = 1e-6
# Least interval at the ends of a run that is shortened, as a share of the run.
MIN_INTERVAL_SHARE = 1e-9
# Speed at a slow break as a share of the largest that the jerk allows. With 1, polylines with
# blends of 1e-8 to 2e-4 m take up to 5e-4 longer; single corners take the same time with 0.3 to 1.
SPEED_SHARE = 0.7
# A break that the averaged motion passes this many times too fast is slow, whatever its other side
# allows: from there a solver takes hundreds of iterations, or finds no motion.
TOO_FAST = 2.0
# Newton steps from above, and halvings, that reach rounding.
NEWTON_STEPS = 30
HALVINGS = 40
# Share by which rounding may take a ramp beyond the length that there is.
REACH_ROUNDING = 1e-9
# A window is brief up to this share of the motion; below MIN_WINDOW_SHARE the rounding of instants
# would show. It is longer than ramps need, as s̈ may step from one limit to the opposite one.
MAX_BRIEF_SHARE = 1e-3
MIN_WINDOW_SHARE = 1e-9
WINDOW_GROWTH = 4.0
# Window between two speeds, as a share of the largest, where a gentle start finds no way.
START_WINDOW_SHARE = 1e-2
START_GRID = "start"
"""Name of the rows that bound s̈ to values that the jerk lets a motion reach: no limit's."""


def average(
    motion: Profile,
    window: float,
    speeds: tuple[float, float] = (0.0, 0.0),
) -> Profile:
    """Return the moving average in time of a motion of order 2, which takes a window longer.

    speeds  ṡ at the motion's ends, which it keeps before and after: the average begins and ends
            ṡ w/2 beyond them
    """
    knots = np.concatenate([[0.0], np.cumsum(motion.h)])
    h = motion.h[-1]
    end = motion.s[-1] + h * (motion.v[-1] + h * motion.a[-1] / 2)
    # the motion with a piece of constant speed before and after it
    start = motion.s[0] - speeds[0] * window
    s = np.array([start, *motion.s, end])
    v = np.array([speeds[0], *motion.v, speeds[1]])
    a = np.array([0.0, *motion.a, 0.0])
    longer = np.array([-window, *knots, knots[-1] + window])

    t = np.union1d(knots, knots + window)
    differs = np.diff(t) > SAME_INSTANT * t[-1]
    t = t[np.append(differs, True)]
    states = average_states(longer, s, v, a, t)
    h = np.diff(t)
    places, rates, accelerations = states[:, :-1]
    jerk = np.diff(states[2]) / h
    piece = np.full(len(h), motion.piece[0])
    return Profile(places, rates, accelerations, jerk, h, piece)


@kernel
def average_states(knots: Floats1, s: Floats1, v: Floats1, a: Floats1, t: Floats1) -> Array:
    """Return s, ṡ, s̈ (3, K), averaged over the window before rising instants t (K,).

    knots, s, v, a  of a motion of order 2 that begins one window before t = 0

    Each window is summed by itself. Differences of integrals from the start on would lose as many
    digits as the window is shorter than the motion.
    """
    window = -knots[0]
    states = np.empty((3, len(t)))
    first = 0
    for n in range(len(t)):
        begin = t[n] - window
        while first < len(s) - 1 and knots[first + 1] <= begin:
            first += 1
        width, way, rise, moment = 0.0, 0.0, 0.0, 0.0
        place = s[first]
        for k in range(first, len(s)):
            low = max(knots[k], begin)
            h = min(knots[k + 1], t[n]) - low
            if not h > 0:
                break
            speed = v[k] + a[k] * (low - knots[k])
            piece = h * (speed + h * a[k] / 2)
            width += h
            way += piece
            rise += h * a[k]
            moment += (low - begin) * piece
            moment += h * h * (speed / 2 + h * a[k] / 3)
            tau = low + h - knots[k]
            place = s[k] + tau * (v[k] + tau * a[k] / 2)
        states[0, n] = place - moment / width
        states[1, n] = way / width
        states[2, n] = rise / width
    return states


def spread_points(start: Profile, intervals: int) -> Array:
    """Return points s (intervals+1,): half even in time, half even over the time of ramps of s̈.

    Even in time, points are ever denser towards rest, where ṡ goes with t²; the other half resolves
    short ramps of a long motion.
    """
    size = np.abs(start.j)
    ramps = start.h * (size >= ACTING_SHARE * size.max())
    weight = start.h / start.h.sum() + ramps / ramps.sum()
    passed = np.concatenate([[0.0], np.cumsum(weight)])
    even = np.linspace(0.0, 1.0, intervals + 1)
    passing = even * passed[-1]
    k = np.searchsorted(passed, passing, side="right") - 1
    k = k.clip(0, len(weight) - 1)
    tau = (passing - passed[k]) / weight[k] * start.h[k]
    s, *_ = start.at(k, tau)
    s = np.maximum.accumulate(s)
    line = s[0] + (s[-1] - s[0]) * even
    return np.asarray((1 - MIN_STEP_SHARE) * s + MIN_STEP_SHARE * line)


def average_run(coarse: Problem) -> Profile | MotionError:
    """Return the averaged order-2 motion of a run, or the refusal of the order-2 motion."""
    gentle, window = relax_jerk(coarse)
    speeds = sum(coarse.speeds)
    if speeds == 0:
        return _average_solution(gentle, window)
    # at a speed it begins and ends outside a shorter run, by half a window of each speed
    whole = (coarse.s[-1] - coarse.s[0]) / speeds
    start = _average_solution(gentle, min(window, whole))
    if isinstance(start, MotionError):
        # gentle accelerations leave no way from speed to speed
        sharp = select_order_2(coarse.with_fixed_ends())
        start = _average_solution(sharp, START_WINDOW_SHARE * whole)
    return start


def _average_solution(problem: Problem, window: float) -> Profile | MotionError:
    """Average the order-2 motion over as much of a run as makes the average fill the run."""
    low = problem.s[0] + problem.speeds[0] * window / 2
    high = problem.s[-1] - problem.speeds[1] * window / 2
    sliver = MIN_INTERVAL_SHARE * (high - low)
    first = np.searchsorted(problem.s[1:], low + sliver, side="right")
    last = np.searchsorted(problem.s[:-1], high - sliver)
    part = problem.part(slice(int(first), int(last)))
    s = np.array([low, *part.s[1:-1], high])
    sharp = second_order(replace(part, s=s))
    return sharp.refusal or average(sharp.profile, window, problem.speeds)


def relax_jerk(problem: Problem) -> tuple[Problem, float]:
    """Return an order-2 problem with fixed ends, and the window A/J to average its motion over.

    A is the limit on s̈, or less where the jerk J does not let the motion reach it before full
    speed, √(V J), or halfway, (J² L/2)^⅓. V, A and J are averages along the run. This shapes the
    start only, never the answer.
    """
    jerk = _mean_bound(problem, Term.SDDD)
    speed = _mean_bound(problem, Term.SD)
    acceleration = _mean_bound(problem, Term.SDD)
    length = problem.s[-1] - problem.s[0]
    by_speed = np.sqrt(speed * jerk)
    by_length = np.cbrt(jerk**2 * length / 2)
    attainable = min(by_speed, by_length)
    sharp = select_order_2(problem.with_fixed_ends())
    if attainable >= acceleration:
        return sharp, acceleration / jerk
    count = problem.intervals
    side = {Term.SDD: np.full((count, 1), 1 / attainable)}
    gentle = Block(START_GRID, side, side, np.ones(count), np.zeros(1))
    return replace(sharp, blocks=(*sharp.blocks, gentle)), attainable / jerk


def select_order_2(problem: Problem) -> Problem:
    """Return the problem without its jerk limits."""
    blocks = tuple(block for block in problem.blocks if set(block.start) <= ORDER_2_TERMS)
    return replace(problem, blocks=blocks)


def add_brief_ramps(
    motion: Profile,
    window: float,
    breaks: Array,
    first: int,
) -> Profile | None:
    """Return the order-2 motion from rest to rest with ramps of s̈ that are brief, or None.

    breaks (P+1,) of its run, whose pieces begin with number `first`. Ramps may not overlap.
    """
    window = max(WINDOW_GROWTH * window, MIN_WINDOW_SHARE * motion.duration)
    longest = min(MAX_BRIEF_SHARE * motion.duration, float(motion.h.min()))
    if not window <= longest:
        return None
    return average(motion, window).cut(breaks, first)


@dataclass(frozen=True, slots=True)
class _Ramps:
    """Changes of ṡ with s̈ = 0 at both ends, under bounds of |s̈| and |s⃛| (P,)."""

    acceleration: Array
    jerk: Array

    def phases(self, change: Array) -> list[tuple[Array, Array]]:
        """Return s⃛ and duration of the three phases of a change of ṡ."""
        size = np.abs(change)
        full_rise = self.acceleration / self.jerk
        rise = np.minimum(np.sqrt(size / self.jerk), full_rise)
        with np.errstate(invalid="ignore"):
            reaches = size * self.jerk > self.acceleration**2
            hold = np.where(reaches, size / self.acceleration - full_rise, 0.0)
        jerk = np.sign(change) * self.jerk
        return [(jerk, rise), (0 * jerk, hold), (-jerk, rise)]

    def length(self, *speeds: Array) -> Array:
        """Return the path length of the changes from speed to speed."""
        total = np.zeros(len(self.jerk))
        for before, after in pairwise(speeds):
            duration = sum(h for _, h in self.phases(after - before))
            total = total + (before + after) / 2 * duration
        return total


def pass_breaks(problem: Problem, at: np.ndarray, speeds: Array) -> Profile | None:
    """Return ramps of constant jerk from each grid point `at` (P+1,) to the next, or None.

    There it has `speeds` and s̈ = 0. In between it rises to a largest speed and falls again, under
    the rows' own bounds of ṡ, s̈ and s⃛ on average. Where that of s̈ leaves no way from speed to
    speed, that of s⃛ alone may; None where it does not, or where s⃛ has no bound.
    """
    step = np.diff(problem.s)
    size = np.diff(problem.s[at])

    def average_bound(bound: Array) -> Array:
        return np.asarray(np.add.reduceat(step * bound, at[:-1]) / size)

    speed = np.full(problem.intervals, np.inf)
    for term in (Term.SD, Term.SD2, Term.SD3):
        speed = np.minimum(speed, bound_term(problem, term) ** (1 / term.per_time))
    fastest = average_bound(speed)
    acceleration = average_bound(bound_term(problem, Term.SDD))
    jerk = average_bound(bound_term(problem, Term.SDDD))
    if not np.isfinite(jerk).all():
        return None
    before, after = speeds[:-1], speeds[1:]
    low = np.maximum(before, after)
    too_long = _Ramps(acceleration, jerk).length(before, low, after) > size
    ramps = _Ramps(np.where(too_long, np.inf, acceleration), jerk)
    if (ramps.length(before, low, after) > size * (1 + REACH_ROUNDING)).any():
        return None
    high = np.minimum(fastest, low + np.cbrt(jerk * size**2))
    high = np.maximum(low, high)
    low = bisect(lambda top: ramps.length(before, top, after) <= size, low, high, HALVINGS)
    left = size - ramps.length(before, low, after)
    phases = [
        *ramps.phases(low - before),
        (0 * jerk, np.maximum(left, 0.0) / low),
        *ramps.phases(after - low),
    ]
    j = np.stack([jerk for jerk, _ in phases])
    h = np.stack([duration for _, duration in phases])
    a = _sum_before(h * j)
    v = before + _sum_before(h * (a + h * j / 2))
    s = problem.s[at[:-1]] + _sum_before(h * (v + h * (a / 2 + h * j / 6)))
    lasting = (h > 0).T
    s, v, a, j, h = (values.T[lasting] for values in (s, v, a, j, h))
    return Profile(s, v, a, j, h, np.full(len(s), problem.piece[0]))


def _sum_before(values: Array) -> Array:
    """Return the sum of all rows before each row."""
    total = np.zeros_like(values)
    np.cumsum(values[:-1], axis=0, out=total[1:])
    return total


def slow_breaks(problem: Problem, start: Profile, breaks: Array) -> tuple[np.ndarray, Array]:
    """Return the inner breaks (K,) that `start` passes faster than the jerk allows, and speeds.

    breaks (P+1,) of the run. Along a piece with q‴ a steady ṡ has the jerk q‴ ṡ³: no more than
    c = (J/|q‴|)^⅓ gets through, and at its ends no more than can be reached from c within its
    length. The speeds (K+2,) are those of the run's start, of the slow breaks and of its end. Each
    can be reached from the one before and the one after, under the jerk alone.
    """
    length = np.diff(breaks)
    with np.errstate(divide="ignore"):
        steady = np.cbrt(1 / _largest_on_pieces(problem, Term.SD3))
        jerk = 1 / _largest_on_pieces(problem, Term.SDDD)
    at_ends = np.full(len(length), np.inf)
    for k in np.flatnonzero(np.isfinite(steady)):
        at_ends[k] = _reachable_speed(float(steady[k]), float(jerk[k]), float(length[k]))
    passing, *_ = start.on(breaks)
    # the motion may change its speed on the side that allows more
    allowed = np.maximum(steady[:-1], steady[1:])
    # but not where it is far too fast on the other side
    both = np.minimum(at_ends[:-1], at_ends[1:])
    allowed = np.where(passing[1:] > TOO_FAST * both, np.minimum(allowed, both), allowed)
    slow = 1 + np.flatnonzero(passing[1:] > allowed)
    first, last = problem.speeds
    speeds = np.array([first, *SPEED_SHARE * allowed[slow - 1], last])
    at = np.array([0, *slow, len(breaks) - 1])
    least_jerk = np.minimum.reduceat(jerk, at[:-1])
    way = np.diff(breaks[at])
    for n in range(len(slow)):
        reachable = _reachable_speed(speeds[n], least_jerk[n], way[n])
        speeds[n + 1] = min(speeds[n + 1], reachable)
    for n in reversed(range(len(slow))):
        reachable = _reachable_speed(speeds[n + 2], least_jerk[n + 1], way[n + 1])
        speeds[n + 1] = min(speeds[n + 1], reachable)
    _raise_speeds(speeds, least_jerk, way)
    _raise_speeds(speeds[::-1], least_jerk[::-1], way[::-1])
    return slow, speeds


def _raise_speeds(speeds: Array, jerk: Array, way: Array) -> None:
    """Raise inner speeds that are too low to be reached from the first, which is stated.

    jerk, way  (K,) from each speed to the next, speeds (K+1,)
    """
    for n in range(len(way) - 1):
        least = _least_speed(speeds[n], jerk[n], way[n])
        if speeds[n + 1] >= least:
            return
        speeds[n + 1] = least


def _reachable_speed(v: float, jerk: float, length: float) -> float:
    """Return w of a ramp from v with s̈ = 0 at both ends: (v + w) √((w − v)/J) = length."""
    if not np.isfinite(jerk):
        return float("inf")
    square = jerk * length**2
    gain = np.cbrt(square)
    for _ in range(NEWTON_STEPS):
        total = 2 * v + gain
        residual = total**2 * gain - square
        gain -= residual / (total * (total + 2 * gain))
    return float(v + gain)


def _least_speed(v: float, jerk: float, length: float) -> float:
    """Return w so that a ramp from each speed in [w, v] to v fits, with s̈ = 0 at both ends.

    The ramp from v/3 is the longest: (v + w) √((v − w)/J) grows up to there, and falls beyond.
    """
    low, high = v / 3, v
    if _reachable_speed(low, jerk, length) >= v:
        return 0.0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        if _reachable_speed(middle, jerk, length) >= v:
            high = middle
        else:
            low = middle
    return high


def bound_term(problem: Problem, term: Term) -> Array:
    """Return how large a term may be by itself on each interval (N,); ∞ where no row bounds it."""
    with np.errstate(divide="ignore"):
        return np.asarray(1 / _largest_coefficients(problem, term)[0])


def _mean_bound(problem: Problem, term: Term) -> float:
    """Return how large a term may be by itself on average; ∞ where no row bounds it."""
    mean = float(_largest_coefficients(problem, term)[0].mean())
    return 1 / mean if mean else float("inf")


def _largest_coefficients(problem: Problem, term: Term) -> Array:
    """Return the largest coefficient of a term (2, N) at each interval's start and end."""
    largest = np.zeros((2, problem.intervals))
    for block in problem.blocks:
        for side, rows in enumerate(block.sides):
            if term in rows:
                size = largest_in_rows(np.abs(rows[term]))
                largest[side] = np.maximum(largest[side], size)
    return largest


def _largest_on_pieces(problem: Problem, term: Term) -> Array:
    """Return the largest coefficient of a term on each piece (P,)."""
    largest = _largest_coefficients(problem, term).max(0)
    return reduce_pieces(np.maximum, largest, problem.piece - problem.piece[0])


def reduce_pieces(operation: np.ufunc, values: Array, pieces: np.ndarray) -> Array:
    """Return np.maximum or np.minimum of values (N,) on each piece (P,).

    pieces  (N,) rising from 0 to P − 1: the piece of each value
    """
    first = np.searchsorted(pieces, np.arange(pieces[-1] + 1))
    return np.asarray(operation.reduceat(values, first))
