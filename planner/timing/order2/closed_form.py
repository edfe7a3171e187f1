"""Runs that are straight in the actuators: their fastest motion in closed form, seven pieces of constant jerk.

Where q′ is constant for every axis, the limits on speed, acceleration and jerk are constants of ṡ, s̈, s⃛ (∞ where there
is none): ṡ ≤ V, −B ≤ s̈ ≤ A, −K ≤ s⃛ ≤ J. A ramp up by D, s̈ = 0 at its ends, has jerk J until s̈ = A, then none, then −K;
that takes D/A + (A/J + A/K)/2, or √(2 D (1/J + 1/K)) where A is not reached. A ramp down is one up with B for A, run
backwards. The fastest motion ramps to the largest speed that the length allows, at most V, and back. Where even the
ramp from one end's speed to the other's is too long, one that slows down first may be shorter: it ramps down to the
largest speed that the length allows, and up from there.
Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots (2008), 3.4, for A = B and J = K.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Term
from planner.timing.problem import EXACT_AIM, SOLVER_AIM, Problem
from planner.timing.profile import STRAIGHT, Profile, RunSolution, TooFast

# Share of a limit that rows may vary by, or that curvature may use, and still count as straight: what is left of the
# axes' ways where a synchronised move is drawn by a polynomial. What is aimed at is less than the limits by it.
STRAIGHTNESS_SHARE = 1e-8
# Share by which a speed at an end may be beyond what its run allows: rounding.
ROUNDING = 1e-11
# Halvings that bring a bracket of one order of magnitude down to rounding, and doublings that may bracket at all.
MAX_HALVINGS, MAX_DOUBLINGS = 60, 2000
# Share of the duration that ramps of ṡ and s̈ take at least: briefer ones are lost in the rounding
# of instants, and longer ones would lengthen the motion by as much.
MIN_RAMP_SHARE = 1e-9
# Roundings of path lengths that a ramp between cruises takes at least: the proof of the tool's speed
# is off by about the inverse. A ramp to 10 µm/s at 60 mm takes 1.3 nm and 0.3 ms for it.
MIN_RAMP_ROUNDINGS = 1e8
# Share of the duration below which a piece of the motion is none.
MIN_PIECE_SHARE = 1e-20


@dataclass(frozen=True, slots=True)
class _Limits:
    """Of the motion along a straight run: ṡ, s̈ on ramps up and down, s⃛ upwards and downwards."""

    speed: float
    up: float
    down: float
    jerk: float
    back: float

    def ramp(self, change: float, most: float) -> tuple[float, float, float]:
        """How long s̈ rises, stays and falls on a ramp up by a change of speed, with s̈ at most `most`."""
        if change <= 0:
            return 0.0, 0.0, 0.0
        slowness = (1 / self.jerk + 1 / self.back) / 2
        if change >= most**2 * slowness:
            return most / self.jerk, change / most - most * slowness, most / self.back
        push = float(np.sqrt(change / slowness))
        return push / self.jerk, 0.0, push / self.back

    def lengthen_ramps(self, length: float) -> "_Limits":
        """Lower s̈ and s⃛ where their ramps are too short for instants to tell them apart.

        A motion takes T ≥ L/V, √(L/A) and ∛(L/J). Ramps of s̈ and of ṡ each take MIN_RAMP_SHARE of
        that at least, and lengthen the motion by as little.
        """
        push, sharp = max(self.up, self.down), max(self.jerk, self.back)
        least = max(length / self.speed, np.sqrt(length / push), np.cbrt(length / sharp))
        brief = MIN_RAMP_SHARE * least
        most = self.speed / brief
        up, down = min(self.up, most), min(self.down, most)
        if sharp == np.inf:
            return _Limits(self.speed, up, down, sharp, sharp)
        sharpest = max(up, down) / brief
        return _Limits(self.speed, up, down, min(self.jerk, sharpest), min(self.back, sharpest))

    def stretch_ramp(self, speeds: tuple[float, float], least: float) -> "_Limits":
        """Lower s̈ and s⃛ so that the ramp between two speeds takes at least some length.

        With s̈ k times and s⃛ k² times as large, a ramp is 1/k times as long.
        """
        low, high = min(speeds), max(speeds)
        length = self.way(low, high, self.up if speeds[1] > speeds[0] else self.down)
        if length >= least or length == 0:
            return self
        k = length / least
        jerk, back = k**2 * self.jerk, k**2 * self.back
        return _Limits(self.speed, k * self.up, k * self.down, jerk, back)

    def way(self, low: float, high: float, most: float) -> float:
        """How far a ramp up goes."""
        rise, held, fall = self.ramp(high - low, most)
        if rise + held == 0:
            return 0.0
        push = (high - low) / (rise / 2 + held + fall / 2)
        more = rise**2 / 6 + held * (rise + held) / 2 + fall * (rise / 2 + held + fall / 3)
        return low * (rise + held + fall) + push * more


def straight(problem: Problem) -> RunSolution | None:
    """The fastest motion of a run with constant rows, exact to rounding; None where the run is not straight.

    Too fast is a speed at an end that is beyond its limit, or from which the way to the other end is too short.
    """
    if any(end.acceleration != 0 for end in problem.ends):
        return None
    limits = _aimed_limits(problem)
    if limits is None:
        return None
    if max(problem.speeds) == 0:
        limits = limits.lengthen_ramps(float(problem.s[-1] - problem.s[0]))
    return _find_fastest(problem, limits)


def least_ramp(place: float) -> float:
    """Return the length (m) of a ramp at a path length that the rounding of path lengths spares.

    Along a shorter one the proof cannot tell the path's direction, nor so the tool's speed.
    """
    return MIN_RAMP_ROUNDINGS * float(np.finfo(float).eps) * abs(place)


def straight_ramp(problem: Problem, share: float) -> RunSolution | None:
    """Find a ramp between the problem's speeds that is at most about a share longer than the fastest.

    Along a short ramp the rows hardly vary and the curvature hardly matters: as much as both can
    take is left unused. The speeds themselves, the higher of which caps the ramp, are given.
    None where that would leave more than the share unused, or the ramp does not fit.
    """
    limits = _aimed_limits(problem, share, max(problem.speeds))
    if limits is None:
        return None
    limits = limits.stretch_ramp(problem.speeds, least_ramp(float(np.abs(problem.s).max())))
    ramp = _find_fastest(problem, limits)
    return ramp if ramp.solved else None


def _find_fastest(problem: Problem, limits: _Limits) -> RunSolution:
    """Find the fastest motion under constant limits of ṡ, s̈ and s⃛."""
    length, (first, last) = float(problem.s[-1] - problem.s[0]), problem.speeds
    low, high, most = min(first, last), max(first, last), limits.up if last > first else limits.down
    # a speed that is given may be the limit itself
    too_fast = high * EXACT_AIM > limits.speed * (1 + STRAIGHTNESS_SHARE)
    if too_fast or limits.way(low, high, most) > length * (1 + ROUNDING):
        stopping = limits.way(0.0, low, limits.down if last > first else limits.up)
        if too_fast or stopping + limits.way(0.0, high, most) > length:
            reach = _find_root(lambda v: limits.way(low, v, most) - length, low)
            if stopping < length:
                reach = max(reach, _find_root(lambda v: stopping + limits.way(0.0, v, most) - length, 0.0))
            return RunSolution.refused(TooFast(int(last > first), high, min(limits.speed / EXACT_AIM, reach)))
        return _dip(problem, limits, low)

    def ramps(top: float) -> float:
        return limits.way(first, top, limits.up) + limits.way(last, top, limits.down)

    top = max(high, min(_find_root(lambda v: ramps(v) - length, high), limits.speed))
    cruise = (0.0, 0.0, max(0.0, length - ramps(top)) / top)
    parts = [
        *_ramp(limits, top - first, limits.up),
        cruise,
        *_ramp(limits, top - last, -limits.down),
    ]
    profile = _profile(problem, parts)
    return RunSolution("solved", profile, EXACT_AIM * profile.duration, STRAIGHT, problem)


def _aimed_limits(problem: Problem, share: float = STRAIGHTNESS_SHARE, given: float | None = None) -> _Limits | None:
    """Return the limits that the motion aims at, less what varying rows and curvature may use.

    share  of the limits that these may use; None is returned where they may use more
    given  ṡ that is known to keep the rows of speed, which then need not be constant
    """
    if not problem.is_unconditional:
        return None
    forwards, backwards = (dict.fromkeys((Term.SD, Term.SDD, Term.SDDD), 0.0) for _ in range(2))
    others: list[tuple[Term, float]] = []
    varies = 0.0
    for block in problem.blocks:
        mixed = sum(bool(np.any(block.start[term])) for term in block.start if term in forwards) > 1
        if ((block.room != SOLVER_AIM) & (block.room != 1)).any() or mixed:
            return None
        for term in block.start:
            values = np.concatenate([block.start[term], block.end[term]])
            if term not in forwards:
                others.append((term, float(np.abs(values).max(initial=0.0))))
                continue
            one, size = values[0], float(np.abs(values).max(initial=0.0))
            if size and not (term is Term.SD and given is not None):
                varies = max(varies, float(np.abs(values - one).max()) / size)
            for most, way in ((forwards, one), (backwards, -one)):
                most[term] = max(most[term], float(block.share(way).max(initial=0.0)))
    if not forwards[Term.SDDD] and not forwards[Term.SDD]:
        return None
    (speed, up, jerk), (_, down, back) = (
        (1 / size if size else float("inf") for size in side.values()) for side in (forwards, backwards)
    )
    speed = speed if given is None else given / EXACT_AIM
    length = problem.s[-1] - problem.s[0]
    # what speed and acceleration can come to within the length, where no limit says so
    sharp = max(jerk, back)
    fast = min(speed, np.sqrt(2 * max(up, down) * length), np.cbrt(sharp * length**2) * 2)
    hard = min(max(up, down), np.cbrt(sharp**2 * length) * 2)
    used = {Term.SD2: fast**2, Term.SD3: fast**3, Term.SDSDD: fast * hard, Term.ONE: np.inf}
    beside = sum(size * used[term] for term, size in others if size)
    if max(varies, beside) > share:
        return None
    aim = EXACT_AIM - 2 * varies - beside
    speed_aim = aim if given is None else EXACT_AIM
    return _Limits(speed_aim * speed, *(aim * most for most in (up, down, jerk, back)))


def _find_root(rising: Callable[[float], float], low: float) -> float:
    """Where a rising function is zero, from a place where it is not above; ∞ where it never is."""
    step = low if low > 0 else 1.0
    while step > 0 and rising(low + step) > 0:
        step /= 2
    high = low + 2 * step
    for _ in range(MAX_DOUBLINGS):
        if rising(high) > 0:
            break
        low, high = high, 2 * high
    else:
        return float("inf")
    for _ in range(MAX_HALVINGS):
        middle = (low + high) / 2
        low, high = (low, middle) if rising(middle) > 0 else (middle, high)
    return low


def _dip(problem: Problem, limits: _Limits, low: float) -> RunSolution:
    """Down from the first speed and up to the last, over a way shorter than the ramp between them, the lower being low.

    Over how much it slows down, the way is concave, and too long without: where it is as long as asked is one place.
    """
    length, (first, last) = float(problem.s[-1] - problem.s[0]), problem.speeds

    def excess(bottom: float) -> float:
        return limits.way(bottom, first, limits.down) + limits.way(bottom, last, limits.up) - length

    bottom = _find_root(lambda v: excess(v) if v < low else np.inf, 0.0)
    profile = _profile(
        problem,
        [*_ramp(limits, first - bottom, -limits.down), *_ramp(limits, last - bottom, limits.up)],
    )
    return RunSolution("solved", profile, EXACT_AIM * profile.duration, STRAIGHT, problem)


def _profile(problem: Problem, parts: Sequence[tuple[float, float, float]]) -> Profile:
    """Pieces of s⃛, s̈ at the start and duration, one after the other; cut where the path's own pieces end."""
    j, a, h = np.array(parts).T
    j, a, h = (values[h > MIN_PIECE_SHARE * h.sum()] for values in (j, a, h))
    v = problem.speeds[0] + np.append(0.0, np.cumsum(h * (a + h * j / 2)))[:-1]
    s = problem.s[0] + np.append(0.0, np.cumsum(h * (v + h * (a / 2 + h * j / 6))))[:-1]
    knots = np.append(0.0, np.cumsum(h))

    def at(t: Array) -> tuple[Array, Array, Array, Array]:
        k = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(h) - 1)
        tau = t - knots[k]
        return (
            s[k] + tau * (v[k] + tau * (a[k] / 2 + tau * j[k] / 6)),
            v[k] + tau * (a[k] + tau * j[k] / 2),
            a[k] + tau * j[k],
            j[k],
        )

    breaks = problem.s[1:-1][np.diff(problem.piece) > 0]
    low, high = np.zeros(len(breaks)), np.full(len(breaks), knots[-1])
    for _ in range(MAX_HALVINGS):
        middle = (low + high) / 2
        early = at(middle)[0] < breaks
        low, high = np.where(early, middle, low), np.where(early, high, middle)
    apart = np.abs(high[:, None] - knots).min(1, initial=np.inf) > MIN_PIECE_SHARE * knots[-1]
    cuts = np.union1d(knots, high[apart])
    piece = problem.piece[0] + np.searchsorted(breaks, at((cuts[1:] + cuts[:-1]) / 2)[0], side="right")
    return Profile(*at(cuts[:-1]), np.diff(cuts), piece)


def _ramp(limits: _Limits, change: float, most: float) -> list[tuple[float, float, float]]:
    """s⃛, s̈ at the start and duration of the three pieces of a ramp up; down, and so backwards, where most < 0."""
    rise, held, fall = limits.ramp(change, abs(most))
    if rise + held == 0:
        return []
    push = change / (rise / 2 + held + fall / 2)
    sharp, soft = (push / time if time > 0 else 0.0 for time in (rise, fall))
    if most < 0:
        return [(-soft, 0.0, fall), (0.0, -push, held), (sharp, -push, rise)]
    return [(sharp, 0.0, rise), (0.0, push, held), (-soft, push, fall)]
