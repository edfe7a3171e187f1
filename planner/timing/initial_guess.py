"""Motions to start a jerk-limited solve from.

The usual one is the acceleration-limited motion's moving average in time. Two others serve where it does not.

Where the jerk lets a run by only slowly, as in small blends, the start has to be slow enough there. Along a piece with
q‴ a steady ṡ has the jerk q‴ ṡ³, so that no more than ṡ = (J/|q‴|)^⅓ gets through, while the order-2 motion that starts
a solve goes by √(A/|q″|): through a blend of reach d, d^(2/3) against d^(1/2), ever farther off the smaller the blend.
From there solvers find no answer, and from rest at such places (which s̈ = 0 makes a motion too) the slowest of many.

Ramps of jerk may be brief beside their motion, of hours to decades or under a jerk limit next to none. No solver tells
a ramp of s̈ that takes a billionth of the motion from none, and an average over it cancels digits. But an order-2
motion is no longer than one with jerk limits too, so that its own average over a window w, longer than it by w, is
within w of the fastest. Each step of s̈ becomes a ramp over w. With the motion's s, ṡ, s̈ at a step, and s̈₀ before,
the ramp begins at

    s − ṡ w/2 + s̈₀ w²/6,  ṡ − s̈₀ w/2,  s̈₀,  and has s⃛ = (s̈ − s̈₀)/w

which holds wherever no interval of the motion is shorter than w.
"""

from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.limits.limit import Term
from planner.timing.problem import Problem
from planner.timing.profile import Profile

# Share of the largest jerk from which it counts as acting.
ACTING_SHARE = 0.02
# Least step of a grid, as a share of an even one's: a step of no length would divide by zero.
MIN_STEP_SHARE = 1e-6
# How often the instant at which the motion comes by is enclosed more narrowly: s goes with its cube near rest.
BISECTIONS_OF_INSTANT = 40
# Windows below this share of a motion are averaged piece by piece, where they have no more than so many: differences of
# what was integrated from the start on lose as many digits as the window is shorter.
SHORT_WINDOW_SHARE, MAX_PIECES = 1e-4, 8


class Smoothed:
    """s̃(t) = 1/w ∫ s over [t − w, t]: as long as the motion plus w, its s⃛ is Δs̈/w.

    Averaging over w = A/J turns steps of acceleration 2A into ramps of jerk 2A/w; it is within a percent of the optimum
    where acceleration binds, and has s̈ = 0 at both ends. Before its start and after its end the motion goes on at the
    speed that it has there, so the average reaches ṡ w/2 beyond both.
    """

    def __init__(self, motion: Profile, window: float, speeds: tuple[float, float] = (0.0, 0.0)) -> None:
        self.motion, self.window, self.speeds = motion, window, speeds
        h, s, v, a = motion.h, motion.s, motion.v, motion.a
        self.knots = np.concatenate([[0.0], np.cumsum(h)])
        self.area = np.concatenate([[0.0], np.cumsum(h * (s + h * (v / 2 + h * a / 6)))])
        self.end = float(s[-1] + h[-1] * (v[-1] + h[-1] * a[-1] / 2))

    @property
    def duration(self) -> float:
        return float(self.knots[-1]) + self.window

    def at(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """s, ṡ, s̈, s⃛ of the average."""
        now, before = self._motion(t), self._motion(t - self.window)
        s, v, a, j = ((x - y) / self.window for x, y in zip(now, before, strict=True))
        if self.window > SHORT_WINDOW_SHARE * self.duration:
            return s, v, a, j
        first, last = (np.searchsorted(self.knots, instants, side="right") for instants in (t - self.window, t))
        few = np.flatnonzero((last - first < MAX_PIECES) & (t - self.window < t))
        s[few], v[few], a[few] = self._of_few(t[few], now[1][few], first[few], last[few])
        return s, v, a, j

    def _of_few(self, t: Array, place: Array, first: np.ndarray, last: np.ndarray) -> tuple[Array, Array, Array]:
        """s, ṡ, s̈ of the average where a window has few pieces: 1/w ∫ of ṡ and s̈, and s(t) − 1/w ∫ (τ − t + w) ṡ dτ.

        The pieces are numbered from 1: 0 is what goes on before the start, and the last what goes on after the end.
        """
        m, begin = self.motion, t - self.window
        edges = np.concatenate([[-np.inf], self.knots, [np.inf]])
        since = np.concatenate([self.knots[:1], self.knots])
        speeds = np.concatenate([self.speeds[:1], m.v, self.speeds[1:]])
        slopes = np.concatenate([[0.0], m.a, [0.0]])
        whole, way, rise, short = np.zeros((4, len(t)))
        for n in range(MAX_PIECES):
            k = np.minimum(first + n, last)
            low, high = np.maximum(edges[k], begin), np.minimum(edges[k + 1], t)
            h = np.where(first + n <= last, np.maximum(high - low, 0.0), 0.0)
            a = slopes[k]
            v = speeds[k] + a * (low - since[k])
            whole, way, rise = whole + h, way + h * (v + h * a / 2), rise + h * a
            short = short + h * ((low - begin) * (v + h * a / 2) + h * (v / 2 + h * a / 3))
        return place - short / whole, way / whole, rise / whole

    def on(self, s: Array) -> Array:
        """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,), consistent with each other."""
        dense = self._instants(len(s))
        after = np.searchsorted(np.maximum.accumulate(self.at(dense)[0]), s).clip(1, len(dense) - 1)
        t = self._find_passage(s, dense[after - 1], dense[after])
        t[0], t[-1] = 0.0, self.duration
        h = np.maximum(np.diff(t), 1e-6 * self.duration / len(s))
        _, v, a, _ = self.at(t)
        return np.stack([v[:-1], a[:-1], np.diff(a) / h, h])

    def _find_passage(self, s: Array, low: Array, high: Array) -> Array:
        """The instants (N,) between low and high at which the average comes by s (N,)."""
        if self.window > SHORT_WINDOW_SHARE * self.duration:
            t, m, ends = np.empty(len(s)), self.motion, (float(self.motion.s[0]), self.end)
            find_passage(self.knots, self.area, m.s, m.v, m.a, ends, self.speeds, self.window, s, low, high, t)
            return t
        for _ in range(BISECTIONS_OF_INSTANT):
            t = (low + high) / 2
            early = self.at(t)[0] < s
            low, high = np.where(early, t, low), np.where(early, high, t)
        return np.asarray((low + high) / 2)

    def spread(self, intervals: int) -> Array:
        """Points s (intervals+1,) for a grid: half even in time, half even over the time in which the jerk acts.

        Even in time, they lie ever denser towards rest, where ṡ goes with the square of time; the other half sees short
        ramps of a long motion.
        """
        t = self._instants(intervals)
        step = np.diff(t)
        jerk = np.abs(self.at((t[1:] + t[:-1]) / 2)[3])
        acts = step * (jerk >= ACTING_SHARE * jerk.max())
        passed = np.concatenate([[0.0], np.cumsum(step / step.sum() + acts / acts.sum())])
        even = np.linspace(0.0, 1.0, intervals + 1)
        first = self.motion.s[0] - self.speeds[0] * self.window / 2
        last = self.end + self.speeds[1] * self.window / 2
        s = np.clip(np.maximum.accumulate(self.at(np.interp(even * passed[-1], passed, t))[0]), first, last)
        return np.asarray((1 - MIN_STEP_SHARE) * s + MIN_STEP_SHARE * (first + (last - first) * even))

    def _instants(self, count: int) -> Array:
        """Rising instants from start to end: some for every interval, and every one at which s⃛ changes."""
        even = np.linspace(0.0, self.duration, 20 * count + 1)
        return _separate(np.concatenate([even, self.knots, self.knots + self.window]), self.duration)

    def profile(self, problem: Problem) -> Profile:
        """The average itself as a motion, cut where its s⃛ changes and at the problem's grid."""
        grid = np.concatenate([[0.0], np.cumsum(self.on(problem.s)[3])])
        knots = _separate(np.concatenate([self.knots, self.knots + self.window, grid]), self.duration)
        s, v, a, _ = self.at(knots)
        middle = (knots[1:] + knots[:-1]) / 2
        place, _, _, j = self.at(middle)
        interval = np.searchsorted(problem.s, place, side="right").clip(1, problem.intervals) - 1
        return Profile(s[:-1], v[:-1], a[:-1], j, np.diff(knots), problem.piece[interval])

    def _motion(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """∫ s, s, ṡ, s̈ of the motion itself, with constant speed before 0 and after its end."""
        m, last = self.motion, self.knots[-1]
        early, late = np.minimum(t, 0.0), np.maximum(t - last, 0.0)
        before, after = self.speeds
        k = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(m.h) - 1)
        tau = np.clip(t, 0.0, last) - self.knots[k]
        s, v, a = m.s[k], m.v[k], m.a[k]
        area = self.area[k] + tau * (s + tau * (v / 2 + tau * a / 6))
        area = area + early * (m.s[0] + before * early / 2) + late * (self.end + after * late / 2)
        place = s + tau * (v + tau * a / 2) + before * early + after * late
        speed = np.where(t < 0, before, np.where(t >= last, after, v + tau * a))
        return area, place, speed, np.where((t < 0) | (t >= last), 0.0, a)


@kernel
def find_passage(
    knots: Array,
    area: Array,
    s: Array,
    v: Array,
    a: Array,
    ends: tuple[float, float],
    speeds: tuple[float, float],
    window: float,
    wanted: Array,
    first: Array,
    last: Array,
    out: Array,
) -> None:
    """Fill out (N,): instants between first and last at which an average over a window comes by what is wanted (N,).

    knots (M+1,), area (M+1,) ∫ s up to each, s, v, a (M,) of the motion, its ends and the speeds beyond them.
    """
    for n in range(len(wanted)):
        low, high = first[n], last[n]
        for _ in range(BISECTIONS_OF_INSTANT):
            t = (low + high) / 2
            if (
                integrate_place(knots, area, s, v, a, ends, speeds, t)
                - integrate_place(knots, area, s, v, a, ends, speeds, t - window)
            ) / window < wanted[n]:
                low = t
            else:
                high = t
        out[n] = (low + high) / 2


@kernel
def integrate_place(
    knots: Array,
    area: Array,
    s: Array,
    v: Array,
    a: Array,
    ends: tuple[float, float],
    speeds: tuple[float, float],
    t: float,
) -> float:
    """∫ s of a motion up to t, with constant speed before 0 and after its end."""
    early, late = min(t, 0.0), max(t - knots[-1], 0.0)
    below, above = 0, len(s)
    while above - below > 1:
        middle = (below + above) // 2
        if knots[middle] <= t:
            below = middle
        else:
            above = middle
    tau = min(max(t, 0.0), knots[-1]) - knots[below]
    found = area[below] + tau * (s[below] + tau * (v[below] / 2 + tau * a[below] / 6))
    beyond = early * (ends[0] + speeds[0] * early / 2) + late * (ends[1] + speeds[1] * late / 2)
    return float(found + beyond)


def _separate(instants: Array, duration: float) -> Array:
    """In order, and no two nearer to each other than rounding."""
    t: Array = np.unique(instants)
    return np.asarray(t[np.append(np.diff(t) > 1e-12 * duration, True)])


# A start passes a slow break with this share of the speed that the jerk leaves; measured on corners with blends of 1e-9
# to 1e-3 m: 0.3 to 1 lead to the same answers.
SPEED_SHARE = 0.7
# Newton steps to what a ramp can reach, from above: to rounding.
NEWTON_STEPS = 30
# Share by which rounding may take a way beyond what there is.
REACH_ROUNDING = 1e-9


def pass_breaks(problem: Problem, at: np.ndarray, speeds: Array) -> Profile | None:
    """Ramps of constant jerk from each point `at` (P+1,) of a grid to the next, where it has `speeds` and s̈ = 0.

    Each goes up to a largest speed and down again, under bounds of ṡ, s̈ and s⃛ that are the rows' own on average:
    (v + w)/2 · t of way takes it from v to w, in t = 2 √(|w − v|/J), or |w − v|/A + A/J where that reaches A.
    None where the jerk does not let one of the speeds be reached, or a part has no limit of it somewhere.
    """
    size, step = np.diff(problem.s[at]), np.diff(problem.s)
    speed = np.min([bound_term(problem, term) ** (1 / term.per_time) for term in (Term.SD, Term.SD2, Term.SD3)], axis=0)
    jerk, push, fastest = (
        np.add.reduceat(step * bound, at[:-1]) / size
        for bound in (bound_term(problem, Term.SDDD), bound_term(problem, Term.SDD), speed)
    )
    before, after = speeds[:-1], speeds[1:]
    least = np.maximum(before, after)
    if not np.isfinite(jerk).all():
        return None
    # what leads nowhere within the acceleration does so by the jerk alone, if at all
    push = np.where(_way(before, least, push, jerk) + _way(after, least, push, jerk) > size, np.inf, push)
    alone = _way(before, least, np.inf, jerk) + _way(after, least, np.inf, jerk)
    if not (alone <= size * (1 + REACH_ROUNDING)).all():
        return None
    low, high = least, np.maximum(np.minimum(fastest, least + np.cbrt(jerk * size**2)), least)
    for _ in range(BISECTIONS_OF_INSTANT):
        top = (low + high) / 2
        fits = _way(before, top, push, jerk) + _way(after, top, push, jerk) <= size
        low, high = np.where(fits, top, low), np.where(fits, high, top)
    on = np.maximum(size - _way(before, low, push, jerk) - _way(after, low, push, jerk), 0.0) / low
    phases = [*_ramp(low - before, push, jerk), (np.zeros(len(low)), on), *_ramp(after - low, push, jerk)]
    j, h = (np.stack(each) for each in zip(*phases, strict=True))
    s, v, a = np.empty((3, *j.shape))
    s[0], v[0], a[0] = problem.s[at[:-1]], before, 0.0
    for k in range(len(j) - 1):
        s[k + 1] = s[k] + h[k] * (v[k] + h[k] * (a[k] / 2 + h[k] * j[k] / 6))
        v[k + 1], a[k + 1] = v[k] + h[k] * (a[k] + h[k] * j[k] / 2), a[k] + h[k] * j[k]
    lasts = (h > 0).T
    s, v, a, j, h = (part.T[lasts] for part in (s, v, a, j, h))
    return Profile(s, v, a, j, h, np.full(len(s), problem.piece[0]))


def _way(v: Array, w: Array, push: Array | float, jerk: Array) -> Array:
    return np.asarray((v + w) / 2 * sum(h for _, h in _ramp(w - v, push, jerk)))


def _ramp(change: Array, push: Array | float, jerk: Array) -> list[tuple[Array, Array]]:
    """s⃛ and duration of the three phases of a ramp of ṡ."""
    size, sharp = np.abs(change), np.sign(change) * jerk
    brief = np.minimum(np.sqrt(size / jerk), push / jerk)
    with np.errstate(invalid="ignore"):
        steady = np.where(size * jerk > push**2, size / push - push / jerk, 0.0)
    return [(sharp, brief), (np.zeros(len(size)), steady), (-sharp, brief)]


def bound_term(problem: Problem, term: Term) -> Array:
    """(N,) how large a term may be by itself on each interval, from its start; ∞ where no row holds it."""
    size = np.zeros(problem.intervals)
    for block in problem.blocks:
        if term in block.start:
            np.maximum(size, np.abs(block.start[term]).max(1), out=size)
    with np.errstate(divide="ignore"):
        return np.asarray(1 / size)


def slow_breaks(problem: Problem, start: Smoothed, breaks: Array) -> tuple[np.ndarray, Array]:
    """The inner breaks of a run that `start` passes faster than the jerk lets, and a speed for each.

    breaks (P+1,) of the run. A speed can be reached from the one before and the one after, under the jerk alone.
    """
    count = len(breaks) - 1
    bent, push = _largest_coefficients(problem, Term.SD3, count), _largest_coefficients(problem, Term.SDDD, count)
    with np.errstate(divide="ignore"):
        allowed, jerk = np.cbrt(1 / bent), 1 / push
    allowed = np.maximum(allowed[:-1], allowed[1:])  # the easier side leads on to the other as slowly as it must
    now = start.on(np.concatenate([problem.s[:1], breaks[1:-1], problem.s[-1:]]))[0, 1:]
    slow = np.flatnonzero(now > allowed)
    at = np.concatenate([[0], slow + 1, [count]])
    speeds = np.concatenate([problem.speeds[:1], SPEED_SHARE * allowed[slow], problem.speeds[1:]])
    between = [(float(jerk[a:b].min()), float(breaks[b] - breaks[a])) for a, b in pairwise(at)]
    for k, (least, way) in enumerate(between[:-1]):
        speeds[k + 1] = min(speeds[k + 1], _reachable_speed(speeds[k], least, way))
    for k, (least, way) in reversed(list(enumerate(between[1:], 1))):
        speeds[k] = min(speeds[k], _reachable_speed(speeds[k + 1], least, way))
    return slow + 1, speeds[1:-1]


def _largest_coefficients(problem: Problem, term: Term, count: int) -> Array:
    """(count,) the largest coefficient of a term on each piece."""
    size, first = np.zeros(count), problem.piece[0]
    for block in problem.blocks:
        for side in (block.start, block.end):
            if term in side:
                np.maximum.at(size, problem.piece - first, np.abs(side[term]).max(1))
    return size


def _reachable_speed(speed: float, jerk: float, way: float) -> float:
    """w of a ramp from a speed v, s̈ = 0 at both ends, over some way: (v + w) √((w − v)/J) = way."""
    if not np.isfinite(jerk):
        return float("inf")
    square = jerk * way**2
    more = np.cbrt(square)
    for _ in range(NEWTON_STEPS):
        total = 2 * speed + more
        more -= (total**2 * more - square) / (total * (total + 2 * more))
    return float(speed + more)


# A window up to this share of the motion is brief, and one of at least MIN_WINDOW_SHARE of it is told from the rounding
# of instants; it is so many times as long as ramps need at least, as s̈ may step from its limit to that the other way.
MAX_BRIEF_SHARE, MIN_WINDOW_SHARE, WINDOW_GROWTH = 1e-3, 1e-9, 4.0


def ramped(motion: Profile, window: float, breaks: Array, first: int) -> Profile | None:
    """The average of an order-2 motion from rest to rest over a window about `window`, as long and as much longer.

    breaks (P+1,) of its run, whose pieces begin with number `first`. None where ramps are not brief, or overlap.
    """
    window = max(WINDOW_GROWTH * window, MIN_WINDOW_SHARE * motion.duration)
    if not window <= min(MAX_BRIEF_SHARE * motion.duration, float(motion.h.min())):
        return None
    s, v = np.append(motion.s, breaks[-1]), np.append(motion.v, 0.0)
    before, after = np.append(0.0, motion.a), np.append(motion.a, 0.0)
    j = (after - before) / window
    begun = s - v * window / 2 + before * window**2 / 6, v - before * window / 2, before, j, np.full(len(s), window)
    begun[0][0], begun[1][-1] = breaks[0], -before[-1] * window / 2
    # after each ramp but the last s̈ stays until the next one begins
    held = (
        s[:-1] + motion.v * window / 2 + motion.a * window**2 / 6,
        motion.v + motion.a * window / 2,
        motion.a,
        np.zeros(len(motion.h)),
        motion.h - window,
    )
    columns = [np.insert(ramp, np.arange(1, len(ramp)), hold) for ramp, hold in zip(begun, held, strict=True)]
    lasting = columns[4] > 0
    s, v, a, j, h = (column[lasting] for column in columns)
    return Profile(s, v, a, j, h, np.full(len(h), first)).cut(breaks, first)
