"""Sources of the results of a plan: memory, or the files of its folder, read at their first use."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from planner.certificate.certify import Certificate
from planner.limits import Limit
from planner.parallel import Progress
from planner.pulses import AxesMotion, PulseSchedule
from planner.shaping.shaped_proof import ShapedProof
from planner.trajectory import Trajectory


class PlanSource(Protocol):
    """The results of planning. Each is read or computed at its first use."""

    @property
    def trajectory(self) -> Trajectory:
        """Whole motion, before any input shapers."""

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Limits that the motion was planned and proved with."""

    @property
    def certificate(self) -> Certificate:
        """Proof that the motion keeps every limit."""

    @property
    def shaped(self) -> ShapedProof | None:
        """Motion after the input shapers, and its proof. None: no axis has a shaper."""

    @property
    def counted(self) -> AxesMotion:
        """Motion that the pulses count: after the shapers, with any compensation of the motors."""

    @property
    def schedule(self) -> PulseSchedule:
        """Clock, rule and duration of the pulses; the pulses themselves only if they are in
        memory.
        """

    @property
    def duration(self) -> float:
        """Time (s) for which the machine moves, after any input shapers."""

    @property
    def in_parts(self) -> bool:
        """True if the plan was made in parts."""

    @property
    def pulse_file(self) -> Path | None:
        """File of the pulses, if they are in one."""

    def follow(self) -> Iterator[Trajectory]:
        """Yield the motion part by part, each on its own path, with a time from 0."""

    def read_pulses(self, progress: Progress) -> PulseSchedule:
        """Return the pulses."""


@dataclass(frozen=True, slots=True)
class MadePlan:
    """The results of a plan that was just made, in memory."""

    trajectory: Trajectory
    limits: tuple[Limit, ...]
    certificate: Certificate
    shaped: ShapedProof | None
    counted: AxesMotion
    schedule: PulseSchedule
    in_parts: bool = False
    pulse_file: Path | None = None

    @property
    def duration(self) -> float:
        """Time (s) for which the machine moves, after any input shapers."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration

    def follow(self) -> Iterator[Trajectory]:
        """Yield the motion, which is one part."""
        yield self.trajectory

    def read_pulses(self, progress: Progress) -> PulseSchedule:
        """Return the pulses."""
        return self.schedule
