"""The fastest certified motion along an actuator path: discretize, solve, certify, tighten what fails, run by run."""

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
from planner.path.actuation import ActuatorPath
from planner.path.stands import count_zero_derivatives
from planner.timing.certified_run import (
    MAX_CERTIFY_ROUNDS,
    CertifiedRun,
    RunCertifier,
    Timing,
    find_first_equals,
    hold_axes,
    move_run,
    tighten_run,
)
from planner.timing.parts import solve_in_parts, tighten_in_parts
from planner.timing.problem import Continuation, Run, Solver
from planner.timing.profile import Profile
from planner.timing.run import solve_run
from planner.trajectory import Trajectory

# Runs that are solved and proved together: what one of them takes is more than handing it to another process. Of many,
# more, which takes less time each; parts that are left for each process to be through at about the same time.
PART_RUNS, MANY_PARTS = 8, 32


@dataclass(frozen=True, slots=True)
class Solution(Result):
    """A trajectory with the proof that it respects every limit.

    order; rounds: how often it was solved until the proof held; methods: the solver that gave each run's motion
    lower_estimate: s, about the least that any motion within the limits on speed and acceleration takes, with the
    constant speeds that are asked for; of a stated duration too, which need not be near it
    last_room: of its last run, by limit what it was left on each of its intervals (K,); None where those are no more
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
        """What is proved of the least time; worked out when first asked for, in some times the time of solving."""
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    @property
    def lower_bound(self) -> float:
        """s; no motion within the limits takes less, proved, whatever `bound.left_out` names."""
        return self.bound.value

    @property
    def gap(self) -> float:
        """How far the duration is above the proven lower bound, as a share of that."""
        return self.bound.gap

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, and how long about it must; its certificate."""
        title = f"motion at order {self.order}, by {', '.join(sorted(set(self.methods)))}"
        bound = self.known[0] if self.known else None
        return timing_table(title, self.trajectory.duration, self.lower_estimate, bound), *self.certificate.tables()

    def data(self) -> Table:
        """The motion over time."""
        return self.trajectory.data()


BEFORE_SHAPERS = "before the input shapers"
"""What tables call the duration of the motion that is shaped."""


def timing_table(
    title: str,
    duration: float,
    least: float | None = None,
    bound: DurationBound | None = None,
    note: str | None = None,
    *,
    shaped: float | None = None,
) -> Table:
    """What a motion takes, and what is proved or else estimated of the least that any would.

    note: of the first; shaped: s that it takes behind its input shapers, of which the bounds know nothing
    """
    what, times, notes = ["duration"], [duration], [note]
    if shaped is not None:
        what, times, notes = [*what, BEFORE_SHAPERS], [shaped, duration], [note, "the rows below refer to this"]
    if bound is not None:
        what.append("lower bound, proved")
        times.append(bound.value)
        notes.append(bound.describe())
    elif least is not None:
        what.append("lower bound, estimated")
        times.append(least)
        notes.append(f"the duration is {100 * (duration / least - 1):.2f} % above it")
    return Table(title, (Column("what", what), Column("time", times, "s", form=".6f"), Column("note", notes)))


def certified_solve(
    path: ActuatorPath,
    limits: Sequence[Limit],
    order: int,
    progress: Progress | None = None,
    *,
    timing: Timing | None = None,
    solver: Solver = "passes",
    proving: bool = True,
    continuation: Continuation | None = None,
    fineness: int = 1,
    cruising: bool = True,
) -> Solution:
    """The motion of every run between stops, discretized, solved, certified and tightened until it holds, as a whole.

    Runs go in parts of PART_RUNS or more to whichever process is free; each part is solved and proved by itself, so
    that what becomes of it does not depend on who does it. Here refusals are raised that were values so far: Infeasible
    where a limit is broken, MotionError where no round holds.

    progress  called with the number of different runs that are solved, and their number in all
    timing    what is asked of the motion; None: that it is the fastest, along a path that is checked first
    solver    of order 2
    proving   else a motion of which no round holds is returned, its certificate as it is
    continuation  what the first run goes on with
    fineness  times as many intervals as usual
    cruising  whether cruises at the capped tool speed are in closed form (planner.timing.feed_limited)
    """
    if timing is None:
        for worst in prove_feasibility(path, limits).violations:
            raise worst
        timing = _fastest_timing(path, order)
    stops = np.flatnonzero(path.stops(order))
    runs = [replace(run, solver=solver, fineness=fineness, whole=not cruising) for run in _split_runs(path, stops)]
    runs[0] = replace(runs[0], continuation=continuation)
    firsts = find_first_equals(path, limits, runs) if timing.uniform else list(range(len(runs)))
    different = sorted(set(firsts))
    size = max(PART_RUNS, -(-len(different) // MANY_PARTS))
    parts = [[runs[n] for n in different[first : first + size]] for first in range(0, len(different), size)]
    found: list[CertifiedRun] = []

    def finish_part(part: Sequence[Run], outcome: list[CertifiedRun] | MotionError) -> None:
        if isinstance(outcome, MotionError):
            raise outcome
        found.extend(outcome)
        if progress is not None:
            progress(len(found), len(different))

    spread(RunCertifier(path, tuple(limits), order, timing), parts, finish_part)
    solved = dict(zip(different, found, strict=True))
    certified = [solved[n] if first == n else move_run(path, solved[first], runs[n]) for n, first in enumerate(firsts)]
    limits = hold_axes(limits, [cap for one in certified for cap in one.held])
    trajectory, known = _join_runs(path, limits, certified, stops)
    rounds, methods = max(one.rounds for one in certified), tuple(one.solution.method for one in certified)
    least = sum(one.solution.bound for one in certified) + float(path.dwells.sum())
    room = certified[-1].room
    for each in (found, solved, certified):
        each.clear()  # as much again as what was joined of it
    certificate = certify(trajectory, limits, known)
    if proving and not certificate.holds:
        raise _unproved_error(trajectory, limits, certificate)
    return Solution(trajectory, certificate, limits, order, rounds, methods, least, room)


def solve_within(
    path: ActuatorPath,
    limits: Sequence[Limit],
    order: int,
    gap: float,
    effort: int,
    progress: Progress | None = None,
    *,
    solver: Solver = "passes",
) -> Solution:
    """The fastest motion, proved to be within a share (gap) of the least time, or as near as so many rounds come.

    In each round the cells of the bound are made finer where they lose most; then the motion's grid is. A bound is one
    of all motions: the best of all rounds counts. Raises as `certified_solve`.
    """
    best = certified_solve(path, limits, order, progress, solver=solver)
    bound: DurationBound | None = None
    for n in range(effort + 1):
        found = bound_duration(best.trajectory, limits, order, gap=gap)
        bound = found if bound is None or found.value > bound.value else bound
        bound = replace(bound, duration=best.trajectory.duration)
        if bound.gap <= gap or n == effort:
            break
        finer = attempt(partial(certified_solve, path, limits, order, solver=solver, fineness=2 ** (n + 1)))
        if not isinstance(finer, MotionError) and finer.trajectory.duration < best.trajectory.duration:
            best = finer
    return replace(best, known=[bound] if bound is not None else [])


def _fastest_timing(path: ActuatorPath, order: int) -> Timing:
    """The fastest motion, at the constant speeds that segments ask for."""
    if all(path.constant(piece) is None for piece in range(len(path.breaks) - 1)):
        return Timing(partial(solve_run, order=order), tighten_run, uniform=True)
    return Timing(partial(solve_in_parts, order=order), tighten_in_parts, uniform=True)


def _split_runs(path: ActuatorPath, stops: np.ndarray) -> list[Run]:
    """From stop to stop, the first and the last with the speeds that the path states for its ends."""
    still = count_zero_derivatives(path) % 3  # where q‴ is nothing too, nothing is free
    runs = [Run(int(a), int(b) - 1, stands=(int(still[0, a]), int(still[1, b - 1]))) for a, b in pairwise(stops)]
    runs[0] = replace(runs[0], start_speed=path.end_speeds[0])
    runs[-1] = replace(runs[-1], end_speed=path.end_speeds[1], end_acceleration=path.end_accelerations[1])
    return runs


def _join_runs(
    path: ActuatorPath, limits: Sequence[Limit], found: Sequence[CertifiedRun], stops: np.ndarray
) -> tuple[Trajectory, ProvedUse]:
    """The runs one after the other with the rests between, and what is proved of them: of the rests, nothing yet."""
    parts: list[tuple[Profile, ProvedUse]] = []
    still = np.zeros(1)
    for n, stop in enumerate(stops):
        if path.dwells[stop] > 0:
            s, h, piece = path.breaks[[stop]], path.dwells[[stop]], np.array([max(stop - 1, 0)])
            rest = Profile(s, still, still, still, h, piece)
            parts.append((rest, ProvedUse.make_empty(limits, 1)))
        if n < len(found):
            parts.append((found[n].solution.profile, found[n].known))
    joined = Profile.joined([profile for profile, _ in parts])
    return joined.along(path), ProvedUse.join([known for _, known in parts])


def _unproved_error(trajectory: Trajectory, limits: Sequence[Limit], certificate: Certificate) -> MotionError:
    """Why there is no proof."""
    for limit in limits:
        if limit.geometric and certificate.worst[limit.name] > 1:
            place = certificate.where[limit.name]
            channel = limit.channels.index(place.axis)
            state = trajectory.at(place.t if place.t is not None else 0.0)
            return limit_violation(limit, float(limit.value(state)[0, channel]), channel, int(state.piece[0]), place)
    unproved = [name for name, worst in certificate.worst.items() if not np.isfinite(worst)]
    if unproved:
        place = certificate.where[unproved[0]]
        return MotionError(
            f"the motion could not be proved: {unproved[0]} at {place} has no bound; "
            "this is a bug in the planner: please report it"
        ).in_segment(place.segment)
    worst = max(certificate.worst, key=certificate.worst.__getitem__)
    return MotionError(
        f"no motion could be proved within {MAX_CERTIFY_ROUNDS} rounds; what remained:\n{certificate}"
    ).in_segment(certificate.where[worst].segment)
