"""The certified motion along a path: every run solved, proved and tightened, then joined."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.bounds.duration_bound import DurationBound, bound_duration
from planner.certificate.certify import Certificate, certify
from planner.certificate.feasibility import limit_violation, prove_feasibility
from planner.certificate.limit_use import ProvedUse
from planner.limits.limit import Limit
from planner.parallel import Progress, spread
from planner.path.actuation import ActuatorPath, has_constant_speed
from planner.timing.certify_loop import CertifiedRun, RunCertifier, hold_axes
from planner.timing.goals.constant_speed import ConstantSpeed
from planner.timing.goals.fastest import Fastest
from planner.timing.goals.goal import Goal
from planner.timing.problem import USUAL, Run, Settings, split_runs
from planner.timing.profile import Profile
from planner.timing.repetition import find_first_equals, move_run
from planner.trajectory import Trajectory

# Runs that are solved and proved together: handing a run to another process takes longer than
# solving it. Many runs are split into MANY_PARTS: larger parts take less time for each run, smaller
# ones let all processes end at about the same time.
PART_RUNS = 8
MANY_PARTS = 32
BEFORE_SHAPERS = "before the input shapers"
"""Name in tables of the duration of the motion that is shaped."""


@dataclass(frozen=True, slots=True)
class Solution(Result):
    """A trajectory with the proof that it respects every limit.

    rounds          largest number of times that a run was timed until its proof held
    methods         solver of each run's motion
    lower_estimate  estimate (s) of the least duration within the limits on speed and acceleration
                    and the stated constant speeds; a stated duration need not be near it
    last_room       room (K,) of each limit on the intervals of the last run, if these still exist
    known           the bound, once it has been computed
    """

    trajectory: Trajectory = field(repr=False)
    certificate: Certificate = field(repr=False)
    limits: tuple[Limit, ...] = field(repr=False)
    order: int
    rounds: int
    methods: tuple[str, ...]
    lower_estimate: float
    last_room: Mapping[str, Array] | None = field(default=None, repr=False)
    known: list[DurationBound] = field(default_factory=list, repr=False, compare=False)

    @property
    def bound(self) -> DurationBound:
        """Proved bound of the least duration; computed once, in some times the solving time."""
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    def require_proof(self) -> "Solution":
        """Return the solution. Raises the reason instead, if the certificate does not hold."""
        if not self.certificate.holds:
            raise _unproved_error(self)
        return self

    @property
    def lower_bound(self) -> float:
        """Proved lower bound (s) of any motion within the limits; see `bound.left_out`."""
        return self.bound.value

    @property
    def gap(self) -> float:
        """Share by which the duration is above the proved lower bound."""
        return self.bound.gap

    def tables(self) -> tuple[Table, ...]:
        """Return the durations and the certificate as tables."""
        methods = ", ".join(sorted(set(self.methods)))
        title = f"motion at order {self.order}, by {methods}"
        bound = self.known[0] if self.known else None
        timing = timing_table(title, self.trajectory.duration, self.lower_estimate, bound)
        return timing, *self.certificate.tables()

    def data(self) -> Table:
        """Return the motion over time."""
        return self.trajectory.data()


def timing_table(
    title: str,
    duration: float,
    least: float | None = None,
    bound: DurationBound | None = None,
    note: str | None = None,
    *,
    shaped: float | None = None,
) -> Table:
    """Return a table of a duration and of its proved bound, or else its estimated least.

    note    remark on the duration
    shaped  duration (s) after the input shapers, to which the bounds do not refer
    """
    rows: list[tuple[str, float, str | None]] = [("duration", duration, note)]
    if shaped is not None:
        rows = [
            ("duration", shaped, note),
            (BEFORE_SHAPERS, duration, "the rows below refer to this"),
        ]
    if bound is not None:
        rows.append(("lower bound, proved", bound.value, bound.describe()))
    elif least is not None:
        remark = f"the duration is {100 * (duration / least - 1):.2f} % above it"
        rows.append(("lower bound, estimated", least, remark))
    names, times, notes = (list(column) for column in zip(*rows, strict=True))
    columns = Column("what", names), Column("time", times, "s", form=".6f"), Column("note", notes)
    return Table(title, columns)


def certified_solve(
    path: ActuatorPath,
    limits: Sequence[Limit],
    order: int,
    progress: Progress | None = None,
    settings: Settings = USUAL,
) -> Solution:
    """Return the fastest motion along a path with the proof that it respects every limit.

    It has the constant speeds that segments state. Arguments as for `solve_goal`.

    Raises Infeasible where a limit cannot be respected, MotionError where no proof was found.
    """
    for violation in prove_feasibility(path, limits).violations:
        raise violation
    certifier = RunCertifier(path, tuple(limits), order, choose_goal(path))
    return solve_goal(certifier, progress, settings).require_proof()


def choose_goal(path: ActuatorPath) -> Goal:
    """Return the goal of the fastest motion at the constant speeds that segments state."""
    return ConstantSpeed() if has_constant_speed(path) else Fastest()


def solve_goal(
    certifier: RunCertifier,
    progress: Progress | None = None,
    settings: Settings = USUAL,
) -> Solution:
    """Return the motion for a goal along a path that was checked, with its certificate.

    Runs go in parts to whichever process is free. Each part is solved and proved by itself, so that
    the result does not depend on the number of processes.

    progress  called with the number of different runs that are solved, and their number in all
    settings  of all runs

    Raises Infeasible where a limit cannot be respected.
    """
    path = certifier.path
    limits = certifier.limits
    stops = np.flatnonzero(path.stops(certifier.order))
    runs = split_runs(path, stops, certifier.order, settings)
    uniform = certifier.goal.uniform
    firsts = find_first_equals(path, limits, runs) if uniform else list(range(len(runs)))
    different = sorted(set(firsts))
    size = max(PART_RUNS, -(-len(different) // MANY_PARTS))
    starts = range(0, len(different), size)
    parts = [[runs[n] for n in different[k : k + size]] for k in starts]
    solved: list[CertifiedRun] = []

    def finish_part(part: Sequence[Run], outcome: list[CertifiedRun] | MotionError) -> None:
        if isinstance(outcome, MotionError):
            raise outcome
        solved.extend(outcome)
        if progress is not None:
            progress(len(solved), len(different))

    spread(certifier, parts, finish_part)
    by_index = dict(zip(different, solved, strict=True))
    certified = []
    for n, first in enumerate(firsts):
        one = by_index[first]
        certified.append(one if first == n else move_run(path, one, runs[n]))
    limits = hold_axes(limits, [cap for one in certified for cap in one.caps])
    trajectory, known = _join_runs(path, limits, certified, stops)
    methods = tuple(one.solution.method for one in certified)
    rounds = max(one.rounds for one in certified)
    least = sum(one.solution.lower_estimate for one in certified) + float(path.dwells.sum())
    room = certified[-1].room
    # the runs take as much memory as the trajectory that is joined of them
    solved.clear()
    by_index.clear()
    certified.clear()
    certificate = certify(trajectory, limits, known)
    return Solution(trajectory, certificate, limits, certifier.order, rounds, methods, least, room)


def solve_within(
    best: Solution,
    gap: float,
    effort: int,
    settings: Settings = USUAL,
) -> Solution:
    """Return the fastest motion, proved to be within a share (gap) of the least duration.

    In each of at most `effort` rounds the cells of the bound are refined where they lose most, then
    the motion's grid. The best bound of all rounds counts, as each is one of all motions.

    best      fastest motion yet
    settings  with which it was solved
    """
    path = best.trajectory.path
    bound: DurationBound | None = None
    for n in range(effort + 1):
        latest = bound_duration(best.trajectory, best.limits, best.order, gap=gap)
        if bound is None or latest.value > bound.value:
            bound = latest
        bound = replace(bound, duration=best.trajectory.duration)
        if bound.gap <= gap or n == effort:
            break
        finely = replace(settings, fineness=2 ** (n + 1))
        solve = partial(certified_solve, path, best.limits, best.order, settings=finely)
        finer = attempt(solve)
        if isinstance(finer, MotionError):
            continue
        if finer.trajectory.duration < best.trajectory.duration:
            best = finer
    return replace(best, known=[bound] if bound is not None else [])


def improve_goal(best: Solution, goal: Goal, progress: Progress | None = None) -> Solution:
    """Return the motion for a goal that the fastest motion is known for; raises as
    `certified_solve`.
    """
    certifier = RunCertifier(best.trajectory.path, best.limits, best.order, goal)
    solution = solve_goal(certifier, progress).require_proof()
    return replace(solution, lower_estimate=best.lower_estimate)


def cut_runs(solution: Solution) -> dict[int, Profile]:
    """Cut a motion into its runs, without rests. Return them by their first pieces."""
    motion = solution.trajectory
    moves = (motion.v != 0) | (motion.a != 0) | (motion.j != 0)
    h = np.diff(motion.knots)
    profiles = {}
    for first, after in pairwise(np.flatnonzero(motion.path.stops(solution.order))):
        inside = moves & (motion.piece >= first) & (motion.piece < after)
        k = np.flatnonzero(inside)
        profiles[int(first)] = Profile(
            motion.s[k],
            motion.v[k],
            motion.a[k],
            motion.j[k],
            h[k],
            motion.piece[k],
        )
    return profiles


def _join_runs(
    path: ActuatorPath,
    limits: Sequence[Limit],
    certified: Sequence[CertifiedRun],
    stops: np.ndarray,
) -> tuple[Trajectory, ProvedUse]:
    """Join the runs with the dwells between them. Of the dwells nothing is proved yet."""
    profiles: list[Profile] = []
    proofs: list[ProvedUse] = []
    zero = np.zeros(1)
    for n, stop in enumerate(stops):
        if path.dwells[stop] > 0:
            piece = np.array([max(stop - 1, 0)])
            dwell = Profile(path.breaks[[stop]], zero, zero, zero, path.dwells[[stop]], piece)
            profiles.append(dwell)
            proofs.append(ProvedUse.make_empty(limits, 1))
        if n < len(certified):
            profiles.append(certified[n].solution.profile)
            proofs.append(certified[n].known)
    return Profile.joined(profiles).along(path), ProvedUse.join(proofs)


def _unproved_error(solution: Solution) -> MotionError:
    """Return the reason why there is no proof."""
    certificate = solution.certificate
    for limit in solution.limits:
        if limit.geometric and certificate.worst[limit.name] > 1:
            place = certificate.where[limit.name]
            channel = limit.channels.index(place.axis)
            state = solution.trajectory.at(place.t if place.t is not None else 0.0)
            value = float(limit.value(state)[0, channel])
            return limit_violation(limit, value, channel, int(state.piece[0]), place)
    name = max(certificate.worst, key=certificate.worst.__getitem__)
    place = certificate.where[name]
    if np.isfinite(certificate.worst[name]):
        remains = f"within {solution.rounds} rounds; what remained:\n{certificate}"
        return MotionError(f"no motion could be proved {remains}").in_segment(place.segment)
    return MotionError(
        f"the motion could not be proved: {name} at {place} has no bound; "
        "this is a bug in the planner: please report it"
    ).in_segment(place.segment)
