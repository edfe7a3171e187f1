"""A plan at less of its speed, as a whole or from an instant on, and the way on from a rest."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import chain

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.certificate.certify import Certificate, certify
from planner.interruption.hold import refuse_instant, shape_section
from planner.interruption.instant import (
    Instant,
    Running,
    cut_motion,
    find_begun,
    find_passage,
    find_piece,
    find_rest,
    find_rest_left,
    find_rest_place,
    find_running,
    join_motions,
    look,
    next_rest,
    shift_motion,
    slow_motion,
)
from planner.interruption.ramp import Proved, find_ramps
from planner.interruption.section import SAME_PLACE, Section, Sent, Whole, make_section, refuse_other
from planner.limits import Limit
from planner.path.actuation import MachinePath
from planner.shaping.keep_limits import solve_shaped
from planner.shaping.shaped_motion import find_copies, shape_motion
from planner.shaping.shaped_proof import prove_shaped
from planner.timing.certified_solve import certified_solve
from planner.trajectory import Trajectory

# Share up to which two speeds, and accelerations, are the same.
SAME_SHARE = 1e-9


def override(whole: Whole, share: float, at: float | None = None, during: Section | None = None) -> Section:
    """The motion at a share of the plan's speed: q̇ goes with it, q̈ with its square, q⃛ with its cube. Dwells stay.

    at: an instant (s), on a whole tick of the clock, from which on the speed is changed as soon as the limits allow;
    None: the whole motion. during: a section of the plan that runs instead, from whose start on the instant counts.

    Raises MotionError for a share that is not above 0 and up to 1, for an instant that is none of the motion's, and
    where the slower motion breaks a limit, as one on a band of speeds or of the torque that friction takes may be.
    """
    _check_share("override", share)
    if at is None:
        if during is not None:
            raise MotionError("override during a section: give the instant (s) at which the speed is to change")
        return _slow_whole(whole, share)
    running = find_running(whole, during)
    refuse_instant(f"override {share:g}", at, running, during)
    t, sent = running.round_to_tick(at)
    now = look(running.trajectory, running.since + t)
    made = _change_speed(whole, running, now, share, f"override {share:g} at {t:.6f} s")
    copies = find_copies(whole.machine.axes)
    if copies is not None:
        made = shape_section(whole, running, now, made, copies)
    return make_section(whole, "override", *made[:5], sent, t, made.shaped)


def _check_share(what: str, share: float) -> float:
    """The share of the plan's speed; MotionError for one that is not above 0 and up to 1."""
    if not 0 < share <= 1:
        raise MotionError(f"{what} {share}: must be above 0 and at most 1, which is the plan's own speed")
    return share


def _slow_whole(whole: Whole, share: float) -> Section:
    path = whole.draw(0.0, float(whole.path.breaks[-1]))
    slower, limits = slow_motion(whole.trajectory, share, path), whole.limits(path)
    certificate = certify(slower, limits)
    if not certificate.holds:
        raise MotionError(f"override {share:g}: the slower motion does not keep every limit:\n{certificate}")
    return _make_from_rest(whole, "override", Proved(path, limits, slower, certificate, 0.0), Sent.before(whole, 0.0))


def _make_from_rest(whole: Whole, what: str, made: Proved, sent: Sent) -> Section:
    """A section that begins at rest: behind shapers no copies of what was before it are under way."""
    moves, axes = shape_motion(made.trajectory, whole.machine.axes), whole.machine.axes
    shaped = None if moves is None else prove_shaped(moves, made.trajectory, axes, made.limits, made.certificate)
    return make_section(whole, what, *made[:5], sent, shaped=shaped)


@dataclass(frozen=True, slots=True)
class _Change:
    """From an instant of a motion to the plan at a share of its speed, to its end: what that goes along."""

    whole: Whole
    now: Instant
    share: float
    path: MachinePath
    limits: tuple[Limit, ...]

    @classmethod
    def begin(cls, whole: Whole, now: Instant, share: float, rests: float | None = None) -> "_Change":
        """rests: s that are left of a dwell there; None: all that is stated."""
        path = whole.draw(now.s, float(whole.path.breaks[-1]), now.v, now.a, now.t, now.q, rests=rests)
        return cls(whole, now, share, path, whole.limits(path))

    def reach(self, place: float) -> tuple[float, float]:
        """ṡ and s̈ of the plan at its share, at a place (m)."""
        there = find_passage(self.whole.trajectory, place)
        return self.share * there.v, self.share**2 * there.a

    def follow(self, before: Trajectory | None, there: Instant) -> Proved | None:
        """What is run until an instant of the plan, and that from there on at its share; None: not proved."""
        plan, first = self.whole.trajectory, find_piece(self.whole.path, self.now.s)
        after = slow_motion(cut_motion(plan, there, None, len(plan.s)), self.share, self.path)
        joined = after = shift_motion(after, there.s - self.now.s, -first)
        if before is not None:
            joined = join_motions(self.path, before, after)
        certificate = certify(joined, self.limits)
        return Proved(self.path, self.limits, joined, certificate, self.now.s) if certificate.holds else None

    def go_on(self, motion: Trajectory, last: int, certificate: Certificate) -> Proved:
        """What is run, to before its time piece `last`: proved with all of it already."""
        own = shift_motion(cut_motion(motion, self.now, None, last), 0.0, -find_piece(self.whole.path, self.now.s))
        return Proved(self.path, self.limits, replace(own, path=self.path), certificate, self.now.s)

    def join(self, before: Trajectory, after: Trajectory, at: float) -> Proved | None:
        """What is run until a place (m), and a motion along the path from there; None: not proved."""
        first, there = find_piece(self.whole.path, self.now.s), find_piece(self.whole.path, at)
        before = shift_motion(before, 0.0, -first)
        joined = join_motions(self.path, before, shift_motion(after, at - self.now.s, there - first))
        certificate = certify(joined, self.limits)
        return Proved(self.path, self.limits, joined, certificate, self.now.s) if certificate.holds else None

    def ramp(self, motion: Trajectory | None, end: float) -> Proved | None:
        """The soonest way from the motion, or from rest, to the plan at its share, before a place (m)."""
        knots = self.whole.trajectory.s
        for ramp in chain.from_iterable(find_ramps(self.whole, motion, self.now, end, self.reach, knots)):
            there = find_passage(self.whole.trajectory, self.now.s + float(ramp.path.breaks[-1]))
            made = self.follow(ramp.trajectory, there)
            if made is not None:
                return made
        return None


def _change_speed(whole: Whole, running: Running, now: Instant, share: float, what: str) -> Proved:
    """From an instant on, before any shapers: by the soonest ramp, or behind the next rest where there is none.

    what: it is, in refusals
    """
    motion, plan = running.trajectory, whole.trajectory
    rest, push = find_rest(motion, now), float(np.abs(plan.a).max())
    still = (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    if rest is not None and rest.t <= now.t and rest.t < motion.duration and not still[now.knot]:
        rest = None  # it has begun to move
    change = _Change.begin(whole, now, share, find_rest_left(motion, now))
    here, first = find_passage(plan, now.s), find_piece(whole.path, now.s)
    if rest is not None:
        later = np.flatnonzero(~still & (np.arange(len(still)) >= max(now.knot, rest.knot)))
        if len(later) == 0 or rest.t >= motion.duration:
            raise _refuse_end(whole, what, motion)
        before = shift_motion(cut_motion(motion, now, None, int(later[0])), 0.0, -first)
        made = change.follow(before, find_passage(plan, max(now.s, rest.s)))
    elif find_rest_place(motion, len(motion.s)) - now.s <= SAME_PLACE * float(whole.path.breaks[-1]):
        raise _refuse_end(whole, what, motion)
    elif now.v == 0 and here.v == 0:  # it begins to move, as the plan does there
        made = change.follow(None, here)
    elif motion is plan and share == 1:
        made = change.follow(None, now) or change.go_on(motion, len(motion.s), running.certificate)
    elif (begun := find_begun(motion, now)) is not None:
        onward = _change_speed(whole, running, begun, share, what)
        made = change.join(cut_motion(motion, now, begun), onward.trajectory, begun.s)
    elif abs(now.v - share * here.v) <= SAME_SHARE * now.v and abs(now.a - share**2 * here.a) <= SAME_SHARE * push:
        made = change.follow(None, here)
    else:
        last, end = _find_next_rest(whole, here)
        made = change.ramp(motion if now.v > 0 else None, end)
        stop = next_rest(motion, now)
        rests_at = find_rest_place(motion, stop)
        if made is None and abs(rests_at - end) <= SAME_PLACE * float(whole.path.breaks[-1]):  # where the plan does
            if last == len(plan.s):  # there is no more of either
                return change.go_on(motion, stop, running.certificate)
            before = shift_motion(cut_motion(motion, now, None, stop), 0.0, -first)
            made = change.follow(before, look(plan, float(plan.knots[last])))
        elif made is None and rests_at < end:  # a stop: it comes to its rest, from where the plan is taken up
            made = _rest_first(change, motion, now, stop, rests_at, end)
    if made is None:
        raise MotionError(
            f"{what}: no motion was found that takes up the plan's speed before its next rest and keeps every limit; "
            "choose another instant or share, or hold and resume"
        )
    return made


def _refuse_end(whole: Whole, what: str, motion: Trajectory) -> MotionError:
    """Of a change of speed where a motion has come to its end, or as good as that."""
    left = float(whole.path.breaks[-1]) - find_rest_place(motion, len(motion.s))
    ended = left <= SAME_PLACE * float(whole.path.breaks[-1])
    remedy = "the program ends there, and nothing is left to slow" if ended else "resume from there"
    return MotionError(f"{what}: the motion rests there to its end; {remedy}")


def _find_next_rest(whole: Whole, now: Instant) -> tuple[int, float]:
    """The time piece of the plan before which it comes to rest next, and the place (m) of that."""
    last = next_rest(whole.trajectory, now)
    return last, find_rest_place(whole.trajectory, last)


def _rest_first(
    change: _Change, motion: Trajectory, now: Instant, stop: int, rests_at: float, end: float
) -> Proved | None:
    """The motion to the rest before its time piece `stop`, at a place (m), and the way from there to the plan."""
    whole = change.whole
    here = find_passage(whole.trajectory, rests_at)
    onward = _Change.begin(whole, replace(here, v=0.0, a=0.0), change.share).ramp(None, end)
    if onward is None:
        return None
    return change.join(cut_motion(motion, now, None, stop), onward.trajectory, rests_at)


def resume(whole: Whole, stop: Section | float, share: float | None = None) -> Section:
    """The motion from a stop, whose pulses it goes on with, or from rest at a place (m) of the path, to its end.

    share: of the plan's speed, which is taken up as soon as the limits allow. None: the fastest motion, of a plan that
    is the fastest; of one with a stated duration or another objective, its own speed. Raises as `certified_solve`.
    """
    length = float(whole.path.breaks[-1])
    if isinstance(stop, Section):
        refuse_other(whole, stop)
        since, sent = stop.until, find_running(whole, stop).find_sent()
    else:
        since, sent = stop, Sent.before(whole, stop)
    if since == length:
        raise MotionError(f"resume from {since:g} m: the path ends there, so there is nothing to resume")
    if not 0 <= since < length:
        raise MotionError(f"resume from {since:g} m: the path goes from 0 to {length:.6g} m; give a place on it")
    if share is not None or not whole.fastest:
        return _resume_at(whole, since, 1.0 if share is None else _check_share("resume", share), sent)
    path = whole.draw(since, length)
    limits = whole.limits(path)
    solve = partial(certified_solve, path, order=whole.order)
    found, certificate, shaped, _ = solve_shaped(solve, path, limits, whole.machine.axes)
    return make_section(whole, "resume", path, limits, found.trajectory, certificate, since, sent, shaped=shaped)


def _resume_at(whole: Whole, since: float, share: float, sent: Sent) -> Section:
    """From rest to the plan at a share of its speed: by the soonest ramp, or behind its next rest."""
    here = find_passage(whole.trajectory, since)
    change = _Change.begin(whole, replace(here, v=0.0, a=0.0), share)
    last, end = _find_next_rest(whole, here)
    # where the plan rests too, with the dwell there
    made = change.follow(None, find_rest(whole.trajectory, here) or here) if here.v == 0 else change.ramp(None, end)
    if made is None:
        path = whole.draw(since, end)
        before = certified_solve(path, whole.limits(path), whole.order).trajectory
        made = change.follow(before, look(whole.trajectory, float(whole.trajectory.knots[last])))
    if made is None:
        raise MotionError(f"resume from {since:g} m at {share:g} of the plan's speed: no motion keeps every limit")
    return _make_from_rest(whole, "resume", made, sent)
