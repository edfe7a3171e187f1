"""A plan at less of its speed, as a whole or from an instant on, and the way on from a rest."""

from functools import partial

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.certificate.certify import certify
from planner.interruption.hold import refuse_instant, shape_section
from planner.interruption.instant import (
    Instant,
    Running,
    cut_motion,
    find_passage,
    find_piece,
    find_rest,
    find_running,
    join_motions,
    look,
    next_rest,
    rest_time,
    shift_motion,
    slow_motion,
)
from planner.interruption.ramp import Proved, find_ramps
from planner.interruption.section import SAME_PLACE, Section, Whole, make_section
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
    if not 0 < share <= 1:
        raise MotionError(f"override {share:g}: must be above 0 and at most 1, which is the plan's own speed")
    if at is None:
        if during is not None:
            raise MotionError("override during a section: give the instant (s) at which the speed is to change")
        return _slow_whole(whole, share)
    running = find_running(whole, during)
    refuse_instant(f"override {share:g}", at, running, during)
    t, sent = running.round_to_tick(at)
    now = look(running.trajectory, running.since + t)
    made, copies = _change_speed(whole, running, now, share), find_copies(whole.machine.axes)
    if copies is not None:
        made = shape_section(whole, running, now, made, copies)
    return make_section(whole, "override", *made[:5], sent, t, made.shaped)


def _slow_whole(whole: Whole, share: float) -> Section:
    path = whole.draw(0.0, float(whole.path.breaks[-1]))
    slower, limits = slow_motion(whole.trajectory, share, path), whole.limits(path)
    certificate = certify(slower, limits)
    if not certificate.holds:
        raise MotionError(f"override {share:g}: the slower motion does not keep every limit:\n{certificate}")
    axes = whole.machine.axes
    moves = shape_motion(slower, axes)
    shaped = None if moves is None else prove_shaped(moves, slower, axes, limits, certificate)
    return make_section(whole, "override", path, limits, slower, certificate, 0.0, shaped=shaped)


def _change_speed(whole: Whole, running: Running, now: Instant, share: float) -> Proved:
    """From an instant on, before any shapers: by the soonest ramp, or behind the next rest where there is none."""
    motion, plan, length = running.trajectory, whole.trajectory, float(whole.path.breaks[-1])
    rest, push = find_rest(motion, now), float(np.abs(plan.a).max())
    still = (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    if rest is not None and rest.t <= now.t and rest.t < motion.duration and not still[now.knot]:
        rest = None  # it has begun to move
    path = whole.draw(now.s, length, now.v, now.a, now.t, now.q, rested=0.0 if rest is None else rest_time(motion, now))
    limits, first = whole.limits(path), find_piece(whole.path, now.s)

    def take_up(before: Trajectory | None, there: Instant) -> Proved | None:
        """What was run until an instant of the plan, and that from there on at its share; None: not proved."""
        after = slow_motion(cut_motion(plan, there, None, len(plan.s)), share, path)
        after = shift_motion(after, there.s - now.s, -first)
        joined = after if before is None else join_motions(path, before, after)
        certificate = certify(joined, limits)
        return Proved(path, limits, joined, certificate, now.s) if certificate.holds else None

    def reach(place: float) -> tuple[float, float]:
        there = find_passage(plan, place)
        return share * there.v, share**2 * there.a

    here = find_passage(plan, now.s)
    if rest is not None:
        later = np.flatnonzero(~still & (np.arange(len(still)) >= max(now.knot, rest.knot)))
        if len(later) == 0 or rest.t >= motion.duration:
            raise MotionError(
                f"override {share:g} at {now.t:.6f} s: the motion rests there to its end; resume from there"
            )
        made = take_up(shift_motion(cut_motion(motion, now, None, int(later[0])), 0.0, -first), here)
    elif abs(now.v - share * here.v) <= SAME_SHARE * now.v and abs(now.a - share**2 * here.a) <= SAME_SHARE * push:
        made = take_up(None, here)
    else:
        last = next_rest(plan, here)
        end = float(plan.s[last]) if last < len(plan.s) else length
        made = None
        for ramp in find_ramps(whole, motion, now, end, reach, plan.s):
            made = take_up(ramp.trajectory, find_passage(plan, now.s + float(ramp.path.breaks[-1])))
            if made is not None:
                return made
        stop = next_rest(motion, now)
        if abs((float(motion.s[stop]) if stop < len(motion.s) else length) - end) <= SAME_PLACE * length:
            before = shift_motion(cut_motion(motion, now, None, stop), 0.0, -first)  # both rest there
            made = take_up(before, look(plan, float(plan.knots[last])))
    if made is None:
        raise MotionError(
            f"override {share:g} at {now.t:.6f} s: no motion was found that takes up the plan's speed before its "
            "next rest and keeps every limit; choose another instant or share, or hold and resume"
        )
    return made


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
