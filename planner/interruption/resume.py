"""The way on from a stop or a place: the fastest, or at a share of the plan's speed."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kinematics.foundation.errors import MotionError
from planner.certificate.certify import certify
from planner.interruption.instant import (
    Instant,
    cut_motion,
    find_next_rest,
    find_passage,
    find_piece,
    find_rest,
    join_motions,
    look,
    shift_motion,
)
from planner.interruption.ramp import find_ramps
from planner.interruption.running import find_running
from planner.interruption.section import ProvedMotion, Section, Sent, Whole, make_section, snap
from planner.limits import Limit
from planner.path.actuation import MachinePath
from planner.shaping.keep_limits import solve_shaped
from planner.shaping.shaped_motion import shape_motion
from planner.shaping.shaped_proof import prove_shaped
from planner.timing.certified_solve import certified_solve
from planner.trajectory import Trajectory


def resume(whole: Whole, stop: Section | float, share: float | None = None) -> Section:
    """Compute the motion to the end of the path from a stop, or from rest at a place (m).

    After a stop the pulses continue those of the stop.

    share: of the plan's speed, above 0 and at most 1, which is taken up as soon as the limits
    allow. Dwells last as long as in the plan. None: the fastest motion if the plan is the fastest;
    for a plan with a stated duration or another objective, its own speed.

    Raises MotionError for a place outside the path and for a share out of range; where the slower
    motion breaks a limit, as one on a band of speeds may; and as `certified_solve` does.
    """
    since, sent = _find_begin(whole, stop)
    breaks = whole.path.breaks
    here = find_passage(whole.trajectory, snap(breaks, since, float(breaks[-1])))
    if share is None and whole.fastest:
        return make_section(whole, "resume", _solve_fastest(whole, here), sent)
    share = 1.0 if share is None else share
    if not 0 < share <= 1:
        raise MotionError(
            f"resume at {share} of the plan's speed: must be above 0 and at most 1; give a share, as 0.5"
        )
    return make_section(whole, "resume", _shape(whole, _take_up_plan(whole, here, share)), sent)


def _find_begin(whole: Whole, stop: Section | float) -> tuple[float, Sent]:
    """Return the place (m) at which the way on begins, and the state sent before it."""
    length = float(whole.path.breaks[-1])
    if isinstance(stop, Section):
        since = stop.until
        sent = find_running(whole, stop).find_sent()
    else:
        since = stop
        sent = Sent.before(whole, stop)
    if since == length:
        raise MotionError(
            f"resume from {since:g} m: the path ends there, so there is nothing to resume"
        )
    if not 0 <= since < length:
        raise MotionError(
            f"resume from {since:g} m: the path goes from 0 to {length:.6g} m; give a place on it"
        )
    return since, sent


def _draw_from_rest(whole: Whole, here: Instant, until: float) -> MachinePath:
    """Return the path from the place of an instant of the plan, at rest, to another place (m)."""
    return whole.draw(replace(here, t=0.0, v=0.0, a=0.0), until)


def _solve_fastest(whole: Whole, here: Instant) -> ProvedMotion:
    """Solve for the fastest motion to the end from an instant's place, after any input shaping."""
    path = _draw_from_rest(whole, here, float(whole.path.breaks[-1]))
    limits = whole.limits(path)
    solve = partial(certified_solve, path, order=whole.order)
    solution, certificate, shaped, _ = solve_shaped(solve, path, limits, whole.machine.axes)
    return ProvedMotion(path, limits, solution.trajectory, certificate, here.s, shaped)


def _shape(whole: Whole, proved: ProvedMotion) -> ProvedMotion:
    """Shape a motion that begins at rest, and prove it; unchanged without shapers."""
    axes = whole.machine.axes
    motion = shape_motion(proved.trajectory, axes)
    if motion is None:
        return proved
    return replace(
        proved,
        shaped=prove_shaped(motion, proved.trajectory, axes, proved.limits, proved.certificate),
    )


def _take_up_plan(whole: Whole, here: Instant, share: float) -> ProvedMotion:
    """Compute the motion from rest at an instant's place to the plan at a share of its speed.

    Any input shaping comes later. The ramp is the soonest that is found. Without one before the
    plan's next rest, the fastest motion leads to that rest, and the plan is slower from there on.
    """
    plan = whole.trajectory
    path = _draw_from_rest(whole, here, float(whole.path.breaks[-1]))
    slowed = _SlowedPlan(whole, here, share, path, whole.limits(path))
    proved = slowed.begin()
    if proved is None:
        rest = find_next_rest(plan, here)
        path = _draw_from_rest(whole, here, rest.s)
        to_rest = certified_solve(path, whole.limits(path), whole.order).trajectory
        proved = slowed.prove(rest, to_rest)
    if proved is None:
        raise MotionError(
            f"resume from {here.s:g} m at {share:g} of the plan's speed: "
            "no motion keeps every limit; choose another share"
        )
    return proved


@dataclass(frozen=True, slots=True)
class _SlowedPlan:
    """A plan's motion at a share of its speed, from a place on.

    here    instant of the plan at that place
    path    from there to the end, begun at rest
    limits  of that path
    """

    whole: Whole
    here: Instant
    share: float
    path: MachinePath
    limits: tuple[Limit, ...]

    def begin(self) -> ProvedMotion | None:
        """Begin with the dwell if the plan rests there, else by a ramp; None: not proved."""
        if self.here.v == 0:
            rest = find_rest(self.whole.trajectory, self.here)
            return self.prove(rest or self.here)
        return self.ramp()

    def rates(self, place: float) -> tuple[float, float]:
        """Return ṡ and s̈ at a place (m)."""
        there = find_passage(self.whole.trajectory, place)
        return self.share * there.v, self.share**2 * there.a

    def ramp(self) -> ProvedMotion | None:
        """Find the soonest ramp to the slowed plan, and the plan after it; None: not proved."""
        plan = self.whole.trajectory
        end = find_next_rest(plan, self.here).s
        begin = replace(self.here, v=0.0, a=0.0)
        for ramp in find_ramps(self.whole, begin, end, self.rates, plan):
            there = find_passage(plan, begin.s + float(ramp.path.breaks[-1]))
            proved = self.prove(there, ramp.trajectory)
            if proved is not None:
                return proved
        return None

    def prove(self, there: Instant, before: Trajectory | None = None) -> ProvedMotion | None:
        """Prove the slowed plan from an instant on, after a motion to there; None: not proved."""
        plan = self.whole.trajectory
        rest_of_plan = cut_motion(plan, there, look(plan, plan.duration))
        first = find_piece(self.whole.path, self.here.s)
        slow = slow_motion(rest_of_plan, self.share, self.path)
        motion = shift_motion(slow, there.s - self.here.s, -first)
        if before is not None:
            motion = join_motions(self.path, before, motion)
        certificate = certify(motion, self.limits)
        if not certificate.holds:
            return None
        return ProvedMotion(self.path, self.limits, motion, certificate, self.here.s)


def slow_motion(motion: Trajectory, share: float, path: MachinePath) -> Trajectory:
    """Run a motion at a share of its speed along a path of the same pieces; rests stay as long.

    ṡ goes with the share, s̈ with its square, s⃛ with its cube.
    """
    h = np.diff(motion.knots)
    durations = np.where(motion.resting, h, h / share)
    knots = np.concatenate([[0.0], np.cumsum(durations)])
    v = share * motion.v
    a = share**2 * motion.a
    j = share**3 * motion.j
    return Trajectory(path, knots, motion.s, v, a, j, motion.piece)
