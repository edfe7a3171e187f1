"""The fastest certified motion along an actuator path: solve every run, prove the whole, tighten what fails, again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, pairwise
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.actuation import ActuatorPath
from planner.certificate.certify import Certificate, ProvedUse, certify
from planner.certificate.feasibility import limit_violation, prove_feasibility
from planner.limits.limit import Limit
from planner.parallel import Progress, spread
from planner.path.stands import count_zero_derivatives
from planner.timing.parts import solve_in_parts
from planner.timing.problem import Run, Solver
from planner.timing.profile import Profile
from planner.timing.prover import ROUNDS, ProvedRun, Prover, Timing, hold_axes
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Runs that are proved together: what one of them takes is more than handing it to another process.
PART = 8


@dataclass(frozen=True, slots=True)
class Solution(Result):
    """A trajectory and the proof that it respects every limit.

    order; rounds: how often it was solved until the proof held; methods: the solver that gave each run's motion
    lower_estimate: s, about the least that any motion within the limits on speed and acceleration takes, with the
    constant speeds that are asked for; of a stated duration too, which need not be near it
    """

    trajectory: Trajectory = field(repr=False)
    certificate: Certificate = field(repr=False)
    limits: tuple[Limit, ...] = field(repr=False)
    order: int
    rounds: int
    methods: tuple[str, ...]
    lower_estimate: float

    @property
    def gap(self) -> float:
        """How far the duration is above the estimate of its lower bound, as a share of that."""
        return self.trajectory.duration / self.lower_estimate - 1

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, and how long about it must; its certificate."""
        title = f"motion at order {self.order}, by {', '.join(sorted(set(self.methods)))}"
        return timing_table(title, self.trajectory.duration, self.lower_estimate), *self.certificate.tables()

    def data(self) -> Table:
        """The motion over time."""
        return self.trajectory.data()

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The speed along the path over time."""
        axes: Axes = self.trajectory.plot(ax)
        return axes


def timing_table(title: str, duration: float, least: float, note: str | None = None) -> Table:
    """What a motion takes, and the estimate of the least that any would; note: what there is to say of the first."""
    return Table(
        title,
        (
            Column("what", ["duration", "lower bound, estimated"]),
            Column("time", [duration, least], "s", form=".6f"),
            Column("note", [note, f"the duration is {100 * (duration / least - 1):.2f} % above it"]),
        ),
    )


def fastest(
    path: ActuatorPath,
    limits: Sequence[Limit],
    order: int,
    progress: Progress | None = None,
    *,
    solver: Solver = "passes",
    proving: bool = True,
) -> Solution:
    """Solve and certify. Raises Infeasible where a geometric limit is broken, MotionError where no round holds.

    progress is told how many of the runs between stops are solved, and of how many. solver: of order 2. proving: else a
    motion of which no round holds is returned, its certificate as it is.
    """
    for worst in prove_feasibility(path, limits).violations:
        raise worst
    return solve_certified(
        path, limits, order, partial(solve_in_parts, order=order), progress, solver=solver, proving=proving
    )


def solve_certified(
    path: ActuatorPath,
    limits: Sequence[Limit],
    order: int,
    timing: Timing,
    progress: Progress | None = None,
    *,
    solver: Solver = "passes",
    proving: bool = True,
) -> Solution:
    """The motion of every run as `timing` makes it, in several processes where that pays, and the proof of the whole.

    Runs go in parts of PART to whichever process is free; each part is solved and proved by itself, so that what
    becomes of it does not depend on who does it.
    """
    stops = np.flatnonzero(path.stops(order))
    runs = [replace(run, solver=solver) for run in _runs(path, stops)]
    parts = [runs[first : first + PART] for first in range(0, len(runs), PART)]
    solved = 0

    def done(part: Sequence[Run], _: object) -> None:
        nonlocal solved
        solved += len(part)
        if progress is not None:
            progress(solved, len(runs))

    found: list[ProvedRun] = [*chain(*spread(Prover(path, tuple(limits), order, timing), parts, done))]
    limits = hold_axes(limits, [held for one in found for held in one.held])
    trajectory, known = join_runs(path, limits, found, stops)
    certificate = certify(trajectory, limits, known)
    if proving and not certificate.holds:
        _refuse(trajectory, limits, certificate)
    rounds, methods = max(one.rounds for one in found), tuple(one.method for one in found)
    least = sum(one.floor for one in found) + float(path.dwells.sum())
    return Solution(trajectory, certificate, limits, order, rounds, methods, least)


def _runs(path: ActuatorPath, stops: np.ndarray) -> list[Run]:
    """From stop to stop, the first and the last with the speeds that the path states for its ends."""
    turning = count_zero_derivatives(path) == 1
    runs = [Run(int(a), int(b) - 1, stands=(bool(turning[0, a]), bool(turning[1, b - 1]))) for a, b in pairwise(stops)]
    runs[0] = replace(runs[0], start_speed=path.end_speeds[0])
    runs[-1] = replace(runs[-1], end_speed=path.end_speeds[1])
    return runs


def join_runs(
    path: ActuatorPath, limits: Sequence[Limit], found: Sequence[ProvedRun], stops: np.ndarray
) -> tuple[Trajectory, ProvedUse]:
    """The runs one after the other with the rests between, and what is proved of them: of the rests, nothing yet."""
    parts: list[tuple[Profile, ProvedUse]] = []
    for n, stop in enumerate(stops):
        if path.dwells[stop] > 0:
            parts.append((_rest(path, int(stop)), ProvedUse.nothing(limits, 1)))
        if n < len(found):
            parts.append((found[n].profile, found[n].known))
    joined = Profile.joined([profile for profile, _ in parts])
    return joined.along(path), ProvedUse.joined([known for _, known in parts])


def _rest(path: ActuatorPath, stop: int) -> Profile:
    nothing = np.zeros(1)
    return Profile(path.breaks[[stop]], nothing, nothing, nothing, path.dwells[[stop]], np.array([max(stop - 1, 0)]))


def _refuse(trajectory: Trajectory, limits: Sequence[Limit], certificate: Certificate) -> NoReturn:
    """Why there is no proof."""
    for limit in limits:
        if limit.geometric and certificate.worst[limit.name] > 1:
            place = certificate.where[limit.name]
            channel = limit.channels.index(place.axis)
            value = limit.value(trajectory.at(place.t if place.t is not None else 0.0))
            raise limit_violation(limit, float(value[0, channel]), channel, place)
    unproved = [name for name, worst in certificate.worst.items() if not np.isfinite(worst)]
    if unproved:
        raise MotionError(
            f"the motion could not be proved: {unproved[0]} at {certificate.where[unproved[0]]} has no bound; "
            "this is a fault of the planner: report it"
        )
    raise MotionError(f"no motion could be proved within {ROUNDS} rounds; what remained:\n{certificate}")
