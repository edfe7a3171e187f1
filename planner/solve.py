"""The fastest certified motion along an actuator path: solve every run, prove the whole, tighten what fails, again."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certify import CROSSING, TOLERANCE, Certificate, Known, certify
from planner.limits.limit import Limit
from planner.limits.resonance import Held, Resonance
from planner.standing import refusal, standing
from planner.stays import stays
from planner.steady import Steady, steady
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.timing.run import Attempt, attempt
from planner.trajectory import Trajectory

ROUNDS = 8
# Rounds after which an axis that still stays in a resonance band too long is held below it over its whole run.
STRETCHES = 3


@dataclass(frozen=True, slots=True)
class Solution:
    """A trajectory and the proof that it respects every limit.

    order; rounds: how often it was solved until the proof held; methods: the solver that gave each run's motion
    lower_estimate: s, about the least that any motion within the limits on speed and acceleration takes
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

    def __str__(self) -> str:
        solvers = ", ".join(sorted(set(self.methods)))
        return f"{self.trajectory.duration:.6f} s at order {self.order}, by {solvers}; {self.certificate}"


def fastest(path: ActuatorPath, limits: Sequence[Limit], order: int) -> Solution:
    """Solve and certify. Raises Infeasible where a geometric limit is broken, MotionError where no round holds."""
    for worst in standing(path, limits).violations:
        raise worst
    stops = np.flatnonzero(path.stops(order))
    runs = _runs(path, stops)
    attempts = [_started(path, limits, run, order) for run in runs]
    trajectory, owner = assemble(path, [attempt.profile for attempt in attempts], stops)
    certificate = certify(trajectory, limits)
    rounds = 1
    while not certificate.holds:
        _refuse(trajectory, limits, certificate)
        if rounds == ROUNDS:
            raise MotionError(f"no motion could be proved within {ROUNDS} rounds; what remained:\n{certificate}")
        failed = set()
        limits = _held(trajectory, limits, runs if rounds >= STRETCHES else ())
        for n, tried in enumerate(attempts):
            use = {name: values[owner == n] for name, values in certificate.use.items()}
            if CROSSING in use and use[CROSSING].max() > 1 + TOLERANCE:
                attempts[n] = _started(path, limits, runs[n], order)
                failed.add(n)
            elif any(values.max() > 1 + TOLERANCE for values in use.values()):
                slowness = max(limit.slowness(float(use[limit.name].max())) for limit in limits)
                attempts[n] = tried.tightened(use, slowness)
                failed.add(n)
        before = owner
        trajectory, owner = assemble(path, [attempt.profile for attempt in attempts], stops)
        certificate = certify(trajectory, limits, _known(certificate, before, owner, failed))
        rounds += 1
    methods, least = tuple(a.method for a in attempts), sum(a.floor for a in attempts) + float(path.dwells.sum())
    return Solution(trajectory, certificate, tuple(limits), order, rounds, methods, least)


def _held(trajectory: Trajectory, limits: Sequence[Limit], whole: Sequence[Run]) -> Sequence[Limit]:
    """The limits, with axes held below the bands in which they stay too long: there, or over one of the whole runs."""

    def held(limit: Resonance) -> Resonance:
        more = []
        for stay in stays(trajectory, limit):
            if stay.use > 1 + TOLERANCE:
                first, last = trajectory.at(np.array([stay.start, stay.end])).s
                piece = trajectory.piece[stay.first]
                for run in whole:
                    if run.first <= piece <= run.last:
                        first, last = trajectory.path.breaks[[run.first, run.last + 1]]
                more.append(Held(stay.band, float(first), float(last)))
        return limit.holding(more) if more else limit

    return [held(limit) if isinstance(limit, Resonance) else limit for limit in limits]


def _runs(path: ActuatorPath, stops: np.ndarray) -> list[Run]:
    """From stop to stop, the first and the last with the speeds that the path states for its ends."""
    runs = [Run(int(a), int(b) - 1) for a, b in pairwise(stops)]
    runs[0] = replace(runs[0], start_speed=path.end_speeds[0])
    runs[-1] = replace(runs[-1], end_speed=path.end_speeds[1])
    return runs


def _started(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Attempt | Steady:
    """The first solve of a run, at constant speed where its segment asks for one."""
    speeds = {path.constant(piece) for piece in range(run.first, run.last + 1)}
    speed = speeds.pop()
    if speeds:
        raise MotionError(
            f"{path.place(float(path.breaks[run.first]), run.first)}: a constant speed needs stops at the ends of its "
            'segment: write join = "stop" there and on the segment before it'
        )
    return attempt(path, limits, run, order) if speed is None else steady(path, limits, run, order, speed)


def assemble(path: ActuatorPath, profiles: Sequence[Profile], stops: np.ndarray) -> tuple[Trajectory, np.ndarray]:
    """The runs one after the other, the rests between, and whose each time piece is: run n, or −1 − n at stop n."""
    parts: list[tuple[Profile, int]] = []
    for n, stop in enumerate(stops):
        if path.dwells[stop] > 0:
            parts.append((_rest(path, int(stop)), -1 - n))
        if n < len(profiles):
            parts.append((profiles[n], n))
    joined = Profile(
        *(np.concatenate([getattr(part, name) for part, _ in parts]) for name in ("s", "v", "a", "j", "h", "piece"))
    )
    knots = np.concatenate([[0.0], np.cumsum(joined.h)])
    owner = np.concatenate([np.full(len(part.h), n) for part, n in parts])
    return Trajectory(path, knots, joined.s, joined.v, joined.a, joined.j, joined.piece), owner


def _known(certificate: Certificate, before: np.ndarray, after: np.ndarray, failed: set[int]) -> Known:
    """What stays proved of the parts that were not solved again, laid out as the new trajectory has them."""

    def carried(values: Array) -> Array:
        laid = np.full(len(after), np.nan)
        for part in set(after.tolist()) - failed:
            laid[after == part] = values[before == part]
        return laid

    return Known(
        {name: carried(values) for name, values in certificate.use.items()},
        {name: carried(values) for name, values in certificate.attained.items()},
    )


def _rest(path: ActuatorPath, stop: int) -> Profile:
    nothing = np.zeros(1)
    return Profile(path.breaks[[stop]], nothing, nothing, nothing, path.dwells[[stop]], np.array([max(stop - 1, 0)]))


def _refuse(trajectory: Trajectory, limits: Sequence[Limit], certificate: Certificate) -> None:
    """Faults that no tightening mends."""
    for limit in limits:
        if limit.geometric and certificate.worst[limit.name] > 1 + TOLERANCE:
            place = certificate.where[limit.name]
            channel = limit.channels.index(place.axis)
            value = limit.value(trajectory.at(place.t if place.t is not None else 0.0))
            raise refusal(limit, float(value[0, channel]), channel, place)
    unproved = [name for name, worst in certificate.worst.items() if not np.isfinite(worst)]
    if unproved:
        raise MotionError(
            f"the motion could not be proved: {unproved[0]} at {certificate.where[unproved[0]]} has no bound; "
            "this is a fault of the planner: report it"
        )
