"""The fastest certified motion along an actuator path: solve every run, prove the whole, tighten what fails, again."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE, Certificate, Known, certify
from planner.limits.limit import Limit
from planner.standing import refusal, standing
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.timing.run import attempt
from planner.trajectory import Trajectory

ROUNDS = 8


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
    attempts = [attempt(path, limits, Run(int(a), int(b) - 1), order) for a, b in pairwise(stops)]
    trajectory, owner = assemble(path, [attempt.profile for attempt in attempts], stops)
    certificate = certify(trajectory, limits)
    rounds = 1
    while not certificate.holds:
        _refuse(trajectory, limits, certificate)
        if rounds == ROUNDS:
            raise MotionError(f"no motion could be proved within {ROUNDS} rounds; what remained:\n{certificate}")
        failed = set()
        for n, tried in enumerate(attempts):
            use = {name: values[owner == n] for name, values in certificate.use.items()}
            if any(values.max() > 1 + TOLERANCE for values in use.values()):
                slowness = max(limit.slowness(float(use[limit.name].max())) for limit in limits)
                attempts[n] = tried.tightened(use, slowness)
                failed.add(n)
        before = owner
        trajectory, owner = assemble(path, [attempt.profile for attempt in attempts], stops)
        certificate = certify(trajectory, limits, _known(certificate, before, owner, failed))
        rounds += 1
    methods, least = tuple(a.method for a in attempts), sum(a.floor for a in attempts) + float(path.dwells.sum())
    return Solution(trajectory, certificate, tuple(limits), order, rounds, methods, least)


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
