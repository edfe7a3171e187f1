"""A plan taken up again from its directory, as `pulsepath.load_plan` gives it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from kinematics import Machine, MotionError
from kinematics.files.chunk_file import holds_chunks
from planner import Program, Trajectory
from planner.certificate.certify import certify
from planner.interruption.interruptible import Interruptible
from planner.interruption.section import Whole
from planner.limits import Limit, limits_of
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.pulses import PulseCheck, PulseFile, PulseSchedule, check, check_file, generate, open_pulses, pace_axes
from planner.pulses.checking.edge_reader import check_file_parts
from planner.pulses.checking.pulse_reader import list_statements
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.motion import AxesMotion
from planner.pulses.triggers import Triggered, find_triggers, holds_triggers
from planner.shaping.shaped_motion import find_delays
from planner.timing.duration_bound import DurationBound, bound_duration
from pulsepath.output.directory import MOTION
from pulsepath.output.verification import digest_pulses, refuse

if TYPE_CHECKING:
    from planner.tradeoffs.limit_worth import Worth


@dataclass(frozen=True, slots=True)
class StoredPlan(Interruptible):
    """A plan taken up again: its motion, exactly as proved; clock and rule of its pulses, order of its limits.

    load: its whole motion, once it is asked for; follow: the same part by part, where it was planned so
    stated: what was stated of its pulses, without them; pulse_file: where they are; fastest: as `Whole` has it
    known: its lower bound, once that was worked out; held: its pulses, once they were asked for
    doubts: why it is not known to be what was proved; nothing but where that was asked for
    """

    program: Program
    machine: Machine
    load: Callable[[], Trajectory]
    clock_hz: int
    rule: str
    order: int
    follow: Callable[[], Iterator[Trajectory]] | None = None
    pulse_digest: str | None = None
    stated: PulseSchedule | None = None
    pulse_file: Path | None = None
    doubts: tuple[str, ...] = ()
    fastest: bool = True
    known: list[DurationBound] = field(default_factory=list, repr=False, compare=False)
    held: list[PulseSchedule] = field(default_factory=list, init=False, repr=False, compare=False)

    def __repr__(self) -> str:
        lasts = "" if self.stated is None else f"{self.stated.duration:.6g} s, "  # the motion is not read for this
        doubt = ", not proved" if self.doubts else ""
        made = f"order {self.order}, {self.rule} pulses at {self.clock_hz} Hz"
        return f"<StoredPlan {self.program.name} on {self.machine.name}: {lasts}{made}{doubt}>"

    @property
    def trajectory(self) -> Trajectory:
        """Its whole motion."""
        return self.load()

    @property
    def duration(self) -> float:
        """s, of its motion."""
        return self.trajectory.duration if self.stated is None else self.stated.duration

    @property
    def bound(self) -> DurationBound:
        """What is proved of the least time, as `Plan.bound`: worked out when first asked for.

        Raises MotionError for a plan that was made in parts.
        """
        if self.follow is not None:
            raise MotionError(f"{self.program.name} was planned in parts, without a lower bound: use --whole")
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    @property
    def worth(self) -> "Worth | None":
        """What one per cent more of each limit saves, as `Plan.worth`: worked out when asked for.

        None if it was not to be the fastest, or was planned in parts.
        """
        if not self.fastest or self.follow is not None:
            return None
        from planner.tradeoffs.limit_worth import find_worth

        motion, limits = self.trajectory, self.limits
        return find_worth(motion, limits, self.order, certify(motion, limits), self.bound)

    def parts(self) -> Iterator[Trajectory]:
        """The same part by part, each on its own path, with a time from 0."""
        return iter([self.trajectory]) if self.follow is None else self.follow()

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Those that the motion was proved to keep."""
        return self.find_limits(self.trajectory)

    def find_limits(self, motion: Trajectory) -> tuple[Limit, ...]:
        """The same of a part of it, on its own path."""
        return limits_of(motion.path, pace_axes(self.machine.axes, self.clock_hz, self.rule), self.order)

    def whole(self, progress: Progress = ignore_progress) -> Whole:
        """What sections of it are made of, with its pulses, and its motion proved once more."""
        motion, pulses = self.trajectory, self.read_pulses(progress)
        proof, path, tool = certify(motion, self.limits), motion.path, self.program.tool
        assert isinstance(path, MachinePath)  # as every plan's
        triggers = self.find_triggers(pulses)
        parts = path, motion, proof, pulses, self.order, tool, (), self.fastest, triggers
        return Whole(self.program.name, self.machine, *parts)

    def find_triggers(self, pulses: PulseSchedule) -> tuple[Triggered, ...]:
        """Return the program's triggers, with the counts of these pulses."""
        if not holds_triggers(self.program):
            return ()
        motion = self.trajectory
        assert isinstance(motion.path, MachinePath)  # as every plan's
        return find_triggers(self.program, motion.path, motion, pulses, *find_delays(self.machine.axes))

    def open_pulses(self) -> PulseFile | None:
        """Their binary file, to be read part by part; None where there is none that has and states what was proved."""
        if self.stated is None or self.pulse_file is None or not holds_chunks(self.pulse_file):
            return None
        held = open_pulses(self.pulse_file)
        same = _states_same(held.stated, self.stated) and digest_pulses(held.parts()) == self.pulse_digest
        return held if same else None

    @property
    def pulses(self) -> PulseSchedule:
        """The pulses, as of a `Plan`: read, as `read_pulses` has it, when first asked for."""
        if not self.held:
            self.held.append(self.read_pulses())
        return self.held[0]

    def read_pulses(self, progress: Progress = ignore_progress) -> PulseSchedule:
        """The pulses: from their file, or made again from the motion.

        Raises MotionError where they are not as they were, nor right.
        """
        if (file := self.open_pulses()) is not None:
            return file.read(progress)
        axes, home_q = self.machine.axes, self.machine.home_q
        made = generate(self.trajectory, axes, home_q, self.clock_hz, self.rule, progress)
        if not self.doubts and digest_pulses([made]) != self.pulse_digest:  # as by the arithmetic of another processor
            verdict = check(made, counted_motion(self.trajectory, axes, home_q), axes, home_q)
            refuse([f"pulses made again from {MOTION}: {fault}" for fault in verdict.faults[:1]])
        return made


@dataclass(frozen=True, slots=True)
class StatedPulses:
    """What the pulses of a file are held to: a schedule without any, of a motion."""

    machine: Machine
    counted: AxesMotion
    pulses: PulseSchedule


def _states_same(held: PulseSchedule, stated: PulseSchedule) -> bool:
    axes = range(len(stated.axes))
    return len(held.axes) == len(axes) and all(list_statements(held, k) == list_statements(stated, k) for k in axes)


def check_pulses(file: Path, taken: StoredPlan, progress: Progress = ignore_progress) -> PulseCheck:
    """The check of a file of pulses in the folder of a plan, part by part. Raises MotionError where they fail it."""
    stated, machine = taken.stated or taken.read_pulses(progress), taken.machine
    if taken.follow is not None and holds_chunks(file):
        found = check_file_parts(file, stated, machine, taken.follow(), progress)
    else:
        counted = counted_motion(taken.trajectory, machine.axes, machine.home_q)
        found = check_file(file, StatedPulses(machine, counted, stated), progress)
    refuse([f"{file}: {fault}" for fault in found.faults[:1]])
    return found
