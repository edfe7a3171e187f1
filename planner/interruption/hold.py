"""The soonest stop along a path from any instant of a motion, and the way on from there.

From the state (s, ṡ, s̈) at an instant the engine's own problem is solved again, to rest at an end that is sought: the
nearest to which a motion is found that keeps every limit. There is always one: the motion goes on to a rest of its own.
A motion to a nearer rest takes less time, but for what limits change along the path: docs/theory/hold.md.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.certificate.certify import Certificate, certify
from planner.interruption.section import Section, Whole, make_section, measure_way
from planner.limits import Limit
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.shaping.keep_limits import refuse_unkept, solve_shaped
from planner.shaping.shaped_motion import Copies, ShapedMotion, find_copies, shape_motion, shaper_length
from planner.shaping.shaped_proof import ShapedProof, prove_shaped
from planner.timing.certified_solve import certified_solve
from planner.timing.discretization import coarse_jerk_problem
from planner.timing.jerk_limited import place_by_loss
from planner.timing.problem import Continuation, Run
from planner.timing.run import solve_run
from planner.trajectory import Trajectory

# Share of its way by which a stop may be longer than the nearest that is found; and how often it is halved at most.
NEAR_SHARE, HALVINGS = 0.02, 24
# By how much farther it is tried to stop in turn, where what a solve was promised is not proved.
FARTHER = (1.0, 1.02, 1.1, 1.3)
# Share of the largest ṡ up to which a motion rests at a knot, and up to which there is nothing to stop.
REST_SHARE, RESTING_SHARE = 1e-12, 1e-6
# The nearest stop is sought from a share of the way to the plan's own rest on: along short ways grids are fine, and a
# grid that is not may show none where there is one. Times so much farther in turn.
TRIED_SHARE, DOUBLING = 1e-4, 2.0
# One with jerk limits is sought from so many times the way of the nearest without them on, which begins with this share
# of the speed, as that may be the largest; and so many times farther in turn.
TRIED_FROM, TRIED_SPEED, GROWTH = 1.05, 0.99, 1.3


@dataclass(frozen=True, slots=True)
class _Instant:
    """The state of a motion in its midst: time and time piece, s and its rates, the coordinates."""

    t: float
    knot: int
    s: float
    v: float
    a: float
    q: Array


class _Stop(NamedTuple):
    """The path to a rest, its limits, the motion, its proof, where it begins (m), and the proof behind shapers."""

    path: MachinePath
    limits: tuple[Limit, ...]
    trajectory: Trajectory
    certificate: Certificate
    since: float
    shaped: ShapedProof | None = None


def hold(whole: Whole, at: float) -> Section:
    """The soonest stop along the path from an instant (s) of a plan, on a whole tick of its clock.

    Behind input shapers the motion may rest while copies of it still move: the stop is then to let these run out.
    Constant speeds that segments ask for are left. Raises MotionError for an instant that is none of the plan's, and
    for one at which it rests.
    """
    clock, duration = whole.pulses.clock_hz, _shaped_duration(whole)
    if not 0 <= at <= duration:
        raise MotionError(f"hold at {at:g} s: the plan lasts from 0 to {duration:.6f} s; give an instant of it")
    tick = min(round(at * clock), int(duration * clock))
    t = tick / clock
    stop = _stop(whole, t)
    if stop is None:
        raise MotionError(f"hold at {t:.6f} s: the plan rests there, and nothing is to stop; resume from there")
    sent = [int(axis.counts([tick - 1])[0]) for axis in whole.pulses.axes]
    return make_section(whole, "hold", *stop[:5], sent, t, stop.shaped)


def _shaped_duration(whole: Whole) -> float:
    return whole.trajectory.duration + shaper_length(whole.machine.axes)


def _stop(whole: Whole, t: float) -> _Stop | None:
    """The soonest from an instant on; None where nothing moves."""
    motion, copies = whole.trajectory, find_copies(whole.machine.axes)
    now = _look(motion, min(t, motion.duration))
    rest = _find_rest(motion, now)
    if rest is None:
        stop = _solve_stop(whole, now)
        return stop if copies is None else _shape(whole, now, stop, copies)
    return None if copies is None else _run_out(whole, t, rest, copies)


def _shape(whole: Whole, now: _Instant, stop: _Stop, copies: Copies) -> _Stop:
    """A stop and what is proved of it behind shapers, of which copies are still on the plan."""
    behind = _look(whole.trajectory, max(now.t - copies.length, 0.0))
    path = _draw_from(whole, behind, now.s + float(stop.path.breaks[-1]))
    before, rest = _cut(whole.trajectory, behind, now), stop.trajectory
    first, here = (int(k) for k in np.searchsorted(whole.path.breaks, [behind.s, now.s], "right") - 1)
    v, a, j = (np.concatenate(both) for both in ((before.v, rest.v), (before.a, rest.a), (before.j, rest.j)))
    knots = np.concatenate([before.knots, before.knots[-1] + rest.knots[1:]])
    s = np.concatenate([before.s, rest.s + (now.s - behind.s)])
    piece = np.concatenate([np.maximum(before.piece - first, 0), rest.piece + (here - first)])
    joined, since = Trajectory(path, knots, s, v, a, j, piece), float(before.knots[-1])
    motion, limits = ShapedMotion.of(joined, copies), whole.limits(path)
    certificates = whole.certificate, stop.certificate
    return stop._replace(shaped=prove_shaped(motion, joined, whole.machine.axes, limits, *certificates, since=since))


def _run_out(whole: Whole, t: float, rest: _Instant, copies: Copies) -> _Stop | None:
    """What copies still do from t on of a motion that rests already; None where they rest too."""
    motion = whole.trajectory
    behind = _look(motion, max(t - copies.length, 0.0))
    begun = _find_rest(motion, behind)
    if begun is not None and begun.t == rest.t:
        return None
    path = _draw_from(whole, behind, rest.s)
    limits = whole.limits(path)
    before = _cut(motion, behind, rest)
    first = int(np.searchsorted(whole.path.breaks, behind.s, "right")) - 1
    before = replace(before, path=path, piece=np.maximum(before.piece - first, 0))
    proof = prove_shaped(
        ShapedMotion.of(before, copies),
        before,
        whole.machine.axes,
        limits,
        whole.certificate,
        since=min(t, copies.length),  # which is a knot, or in the motion from its start on
    )
    still = np.zeros(1)
    end, piece = path.breaks[-1:], np.array([len(path.pieces) - 1])
    rests = Trajectory(path, np.array([0.0, proof.duration]), end, still, still, still, piece)
    return _Stop(path, limits, rests, whole.certificate, behind.s, proof)


def _draw_from(whole: Whole, now: _Instant, until: float) -> MachinePath:
    return whole.draw(now.s, until, now.v, now.a, now.t, now.q)


def _solve_stop(whole: Whole, now: _Instant) -> _Stop:
    """The soonest before any shapers: the plan's, where it goes on to a rest of its own."""
    motion, last = whole.trajectory, _next_rest(whole.trajectory, now)
    end = float(motion.s[last]) if last < len(motion.s) else float(whole.path.breaks[-1])
    ahead = _draw_from(whole, now, end)
    limits = whole.limits(ahead)
    way = _find_way(whole, ahead, limits, now)
    for farther in FARTHER:
        until = now.s + farther * way
        if until >= end:
            break
        path = _draw_from(whole, now, until)
        own = whole.limits(path)
        found = attempt(partial(certified_solve, path, own, whole.order, continuation=_leave(motion, now)))
        if not isinstance(found, MotionError):
            return _Stop(path, own, found.trajectory, found.certificate, now.s)
    return _Stop(ahead, limits, _keep_on(motion, ahead, now, last), whole.certificate, now.s)


@dataclass(frozen=True, slots=True)
class Stops(Result):
    """The soonest stop along a plan's path from each of some instants, each proved.

    t (N,) s; place (N,) m along the path, of the motion before any shapers; time (N,) s to rest and distance (N,) m to
    it, as those of a `Section`; 0 where nothing moves
    """

    name: str
    t: Array
    place: Array
    time: Array
    distance: Array

    def tables(self) -> tuple[Table, ...]:
        """The longest, and what holds of half of them."""
        columns = (
            Column("what", ["time to rest", "distance to rest"]),
            Column("median", [f"{np.median(self.time):.4f} s", f"{1e3 * np.median(self.distance):.3f} mm"]),
            Column("largest", [f"{self.time.max():.4f} s", f"{1e3 * self.distance.max():.3f} mm"]),
            Column("at", [f"{self.t[np.argmax(each)]:.4f} s" for each in (self.time, self.distance)]),
        )
        return (Table(f"stops of {self.name}, from {len(self.t)} instants", columns),)

    def data(self) -> Table:
        """Each of them."""
        columns = (
            Column("t", self.t, "s"),
            Column("s", self.place, "m"),
            Column("time to rest", self.time, "s"),
            Column("distance to rest", self.distance, "m"),
        )
        return Table(f"stops of {self.name}", columns)


def find_stops(whole: Whole, count: int, progress: Progress = ignore_progress) -> Stops:
    """From `count` instants at even distances, the first at the start of the plan."""
    if count < 1:
        raise MotionError(f"{count} stops: ask for 1 at least")
    motion, found = whole.trajectory, []
    for n, t in enumerate((np.arange(count) * _shaped_duration(whole) / count).tolist()):
        place, stop = _look(motion, min(t, motion.duration)).s, _stop(whole, t)
        if stop is None:
            found.append((t, place, 0.0, 0.0))
        else:
            refuse_unkept(stop.limits, stop.shaped)
            duration = stop.trajectory.duration if stop.shaped is None else stop.shaped.duration
            found.append((t, place, duration, measure_way(stop.path, stop.shaped)))
        progress(n + 1, count)
    return Stops(whole.name, *(np.array(each) for each in zip(*found, strict=True)))


def override(whole: Whole, share: float) -> Section:
    """The whole motion at a share of its speed: q̇ goes with it, q̈ with its square, q⃛ with its cube. Dwells stay.

    Raises MotionError for a share that is not above 0 and up to 1, and where the slower motion breaks a limit, as one
    on a band of speeds or of the torque that friction takes may be.
    """
    if not 0 < share <= 1:
        raise MotionError(f"override {share:g}: must be above 0 and at most 1, which is the plan's own speed")
    motion = whole.trajectory
    path = whole.draw(0.0, float(whole.path.breaks[-1]))
    h = np.diff(motion.knots)
    rests = (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    knots = np.concatenate([[0.0], np.cumsum(np.where(rests, h, h / share))])
    slower = Trajectory(path, knots, motion.s, share * motion.v, share**2 * motion.a, share**3 * motion.j, motion.piece)
    limits = whole.limits(path)
    certificate = certify(slower, limits)
    if not certificate.holds:
        raise MotionError(f"override {share:g}: the slower motion does not keep every limit:\n{certificate}")
    axes = whole.machine.axes
    moves = shape_motion(slower, axes)
    shaped = None if moves is None else prove_shaped(moves, slower, axes, limits, certificate)
    return make_section(whole, "override", path, limits, slower, certificate, 0.0, shaped=shaped)


def resume(whole: Whole, since: float) -> Section:
    """The fastest motion from rest at a place (m) of the path to its end. Raises as `certified_solve`."""
    length = float(whole.path.breaks[-1])
    if since == length:
        raise MotionError(f"resume from {since:g} m: the path ends there, so there is nothing to resume")
    if not 0 <= since < length:
        raise MotionError(f"resume from {since:g} m: the path goes from 0 to {length:.6g} m; give a place on it")
    path = whole.draw(since, length)
    limits = whole.limits(path)
    solve = partial(certified_solve, path, order=whole.order)
    found, certificate, shaped, _ = solve_shaped(solve, path, limits, whole.machine.axes)
    return make_section(whole, "resume", path, limits, found.trajectory, certificate, since, shaped=shaped)


def _look(motion: Trajectory, t: float) -> _Instant:
    state = motion.at(t)
    knot = int(motion.locate(np.array([t]))[0])
    return _Instant(t, knot, float(state.along[0]), float(state.sd[0]), float(state.sdd[0]), state.q[0])


def _find_rest(motion: Trajectory, now: _Instant) -> _Instant | None:
    """Where a rest begins that the motion is in, or within rounding of; None where it moves."""
    most = motion.v.max()
    if now.v > RESTING_SHARE * most:
        return None
    still = (motion.v <= REST_SHARE * most) & (motion.a == 0) & (motion.j == 0)
    rests = np.flatnonzero(np.append(motion.v <= REST_SHARE * most, True))
    k = now.knot if still[now.knot] else int(rests[np.argmin(np.abs(motion.knots[rests] - now.t))])
    while k > 0 and still[k - 1]:
        k -= 1
    return _look(motion, float(motion.knots[k]))


def _next_rest(motion: Trajectory, now: _Instant) -> int:
    """The time piece before which the motion comes to rest next."""
    later = np.flatnonzero(motion.v[now.knot + 1 :] <= REST_SHARE * motion.v.max())
    return now.knot + 1 + int(later[0]) if len(later) else len(motion.s)


def _leave(motion: Trajectory, now: _Instant) -> Continuation:
    """A run that begins in the state of a motion, on a grid on which it may go on with it as long as it likes."""
    knots = motion.s[now.knot + 1 :] - now.s
    return Continuation(np.zeros(1), np.zeros((4, 0)), {}, now.a, knots)


def _find_way(whole: Whole, ahead: MachinePath, limits: tuple[Limit, ...], now: _Instant) -> float:
    """m to the nearest rest to which a motion is found; all there is ahead where none is nearer."""
    whole_way, left = float(ahead.breaks[-1]), _leave(whole.trajectory, now)

    def stops(order: int, way: float) -> bool:
        last = int(np.clip(np.searchsorted(ahead.breaks, way, "left") - 1, 0, len(ahead.pieces) - 1))
        if order == 2:
            run = Run(0, last, start_speed=now.v if whole.order == 2 else TRIED_SPEED * now.v, until=way)
            return solve_run(ahead, limits, run, order, probing=True).solved
        run = Run(0, last, start_speed=now.v, until=way, continuation=left)
        found = place_by_loss(ahead, limits, run, coarse_jerk_problem(ahead, limits, run))
        return found is not None and not isinstance(found, MotionError)

    def narrow(order: int, low: float, high: float) -> float:
        for _ in range(HALVINGS):
            if high - low <= NEAR_SHARE * high:
                break
            middle = float(np.sqrt(low * high)) if low > 0.1 * high else (low + high) / 2
            low, high = (low, middle) if stops(order, middle) else (middle, high)
        return high

    def seek(order: int, high: float, growth: float) -> float:
        low = 0.0
        while high < whole_way and not stops(order, high):
            low, high = high, growth * high
        return narrow(order, low, min(high, whole_way))

    sharp = seek(2, TRIED_SHARE * whole_way, DOUBLING)
    return sharp if whole.order == 2 else seek(3, TRIED_FROM * sharp, GROWTH)


def _keep_on(motion: Trajectory, ahead: MachinePath, now: _Instant, last: int) -> Trajectory:
    """The motion as it is, up to its next rest, before time piece `last`."""
    found = _cut(motion, now, None, last)
    return replace(found, path=ahead, piece=found.piece - found.piece[0])


def _cut(motion: Trajectory, since: _Instant, until: _Instant | None, last: int = 0) -> Trajectory:
    """What it does from an instant to another, or to before time piece `last`: time and path length begin at 0."""
    if until is not None:  # a knot at which it is there begins nothing
        last = until.knot + (until.t > motion.knots[until.knot])
    knots = np.concatenate([[since.t], motion.knots[since.knot + 1 : last + 1]])
    if until is not None:
        knots[-1] = until.t
    within = slice(since.knot + 1, last)
    s, v, a = (
        np.append(here, each[within]) for here, each in ((since.s, motion.s), (since.v, motion.v), (since.a, motion.a))
    )
    here = slice(since.knot, last)
    return Trajectory(motion.path, knots - since.t, s - since.s, v, a, motion.j[here], motion.piece[here])
