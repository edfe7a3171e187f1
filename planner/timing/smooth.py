"""A jerk-limited start from an acceleration-limited motion: its moving average in time."""

import numpy as np

from kinematics.array import Array
from planner.timing.problem import Problem
from planner.timing.profile import Profile

# Share of the largest jerk from which it counts as acting.
ACTS = 0.02
# Least step of a grid, as a share of an even one's: a step of no length would divide by zero.
LEAST = 1e-6
# How often the instant at which the motion comes by is enclosed more narrowly: s goes with its cube near rest.
HALVINGS = 40
# Windows below this share of a motion are averaged piece by piece, where they have no more than so many: differences of
# what was integrated from the start on lose as many digits as the window is shorter.
SHORT, FEW = 1e-4, 8


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
        if self.window > SHORT * self.duration:
            return s, v, a, j
        first, last = (np.searchsorted(self.knots, instants, side="right") for instants in (t - self.window, t))
        few = np.flatnonzero((last - first < FEW) & (t - self.window < t))
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
        for n in range(FEW):
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
        low, high = dense[after - 1], dense[after]
        for _ in range(HALVINGS):
            t = (low + high) / 2
            early = self.at(t)[0] < s
            low, high = np.where(early, t, low), np.where(early, high, t)
        t = (low + high) / 2
        t[0], t[-1] = 0.0, self.duration
        h = np.maximum(np.diff(t), 1e-6 * self.duration / len(s))
        _, v, a, _ = self.at(t)
        return np.stack([v[:-1], a[:-1], np.diff(a) / h, h])

    def spread(self, intervals: int) -> Array:
        """Points s (intervals+1,) for a grid: half even in time, half even over the time in which the jerk acts.

        Even in time, they lie ever denser towards rest, where ṡ goes with the square of time; the other half sees short
        ramps of a long motion.
        """
        t = self._instants(intervals)
        step = np.diff(t)
        jerk = np.abs(self.at((t[1:] + t[:-1]) / 2)[3])
        acts = step * (jerk >= ACTS * jerk.max())
        passed = np.concatenate([[0.0], np.cumsum(step / step.sum() + acts / acts.sum())])
        even = np.linspace(0.0, 1.0, intervals + 1)
        first = self.motion.s[0] - self.speeds[0] * self.window / 2
        last = self.end + self.speeds[1] * self.window / 2
        s = np.clip(np.maximum.accumulate(self.at(np.interp(even * passed[-1], passed, t))[0]), first, last)
        return np.asarray((1 - LEAST) * s + LEAST * (first + (last - first) * even))

    def _instants(self, count: int) -> Array:
        """Rising instants from start to end: some for every interval, and every one at which s⃛ changes."""
        even = np.linspace(0.0, self.duration, 20 * count + 1)
        return _apart(np.concatenate([even, self.knots, self.knots + self.window]), self.duration)

    def profile(self, problem: Problem) -> Profile:
        """The average itself as a motion, cut where its s⃛ changes and at the problem's grid."""
        grid = np.concatenate([[0.0], np.cumsum(self.on(problem.s)[3])])
        knots = _apart(np.concatenate([self.knots, self.knots + self.window, grid]), self.duration)
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


def _apart(instants: Array, duration: float) -> Array:
    """In order, and no two nearer to each other than rounding."""
    t: Array = np.unique(instants)
    return np.asarray(t[np.append(np.diff(t) > 1e-12 * duration, True)])
