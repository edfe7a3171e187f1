"""A plan loaded from its directory, as `pulsepath.load_plan` returns it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinematics import Machine, MotionError
from kinematics.files.chunk_file import holds_chunks
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from planner import Plan, Program, Trajectory
from planner.avoidable_stops import AvoidableStops
from planner.certificate.certify import Certificate
from planner.certificate.conditioning import Conditioning, find_poorest
from planner.certificate.constant_speed import Stretch
from planner.certificate.lower_bound import find_left_out
from planner.interruption.interruptible import Interruptible
from planner.interruption.section import Whole
from planner.limits import Limit, limits_of
from planner.limits.registry import tabulate_axis_bounds
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.path.point_to_point import Departure, departures
from planner.pulses import (
    PulseCheck,
    PulseFile,
    PulseSchedule,
    RealisedPath,
    check,
    check_file,
    generate,
    open_pulses,
    pace_axes,
)
from planner.pulses.checking.edge_reader import check_file_parts
from planner.pulses.checking.pulse_reader import list_statements
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.motion import AxesMotion
from planner.pulses.triggers import Triggered, find_triggers, holds_triggers
from planner.request import PlanRequest, Requested
from planner.shaping.shaped_motion import find_delays
from planner.shaping.shaped_proof import ShapedProof
from planner.timing.duration_bound import DurationBound, bound_duration
from pulsepath.output.directory import MOTION
from pulsepath.output.verification import digest_pulses, prove_motion, refuse

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from planner.tradeoffs.limit_worth import Worth

Proofs = tuple[Certificate, ShapedProof | None]
"""The certificate of a motion, and the proof behind input shapers."""


@dataclass(frozen=True, slots=True)
class StatedSolution:
    """The solution as plan.json states it.

    rounds, methods  of solving, as a `Plan` has them
    lower_estimate   s; NaN: none is stated, as of a plan that was made in parts
    """

    rounds: int
    methods: tuple[str, ...]
    lower_estimate: float = nan


@Plan.register  # so that whatever takes a plan takes this one
@dataclass(frozen=True, slots=True)
class StoredPlan(Result, Interruptible, Requested):
    """A loaded plan: its motion, exactly as proved; clock and rule of its pulses; the request.

    It has all that a `Plan` has. What takes long is worked out when it is first asked for.

    load: its whole motion, once it is asked for; follow: the same part by part, where it was planned so
    stated: what was stated of its pulses, without them; pulse_file: where they are; solution: how it was found
    known: its lower bound, once that was worked out; made: the plan, once it was asked for
    doubts: why it is not known to be what was proved; nothing but where that was asked for
    """

    program: Program
    machine: Machine
    load: Callable[[], Trajectory]
    clock_hz: int
    rule: str
    request: PlanRequest
    follow: Callable[[], Iterator[Trajectory]] | None = None
    pulse_digest: str | None = None
    stated: PulseSchedule | None = None
    pulse_file: Path | None = None
    doubts: tuple[str, ...] = ()
    solution: StatedSolution = field(default=StatedSolution(0, ()), repr=False)
    known: list[DurationBound] = field(default_factory=list, repr=False, compare=False)
    held: list[PulseSchedule] = field(default_factory=list, init=False, repr=False, compare=False)
    proofs: list[Proofs] = field(default_factory=list, init=False, repr=False, compare=False)
    made: list[Plan] = field(default_factory=list, init=False, repr=False, compare=False)

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
    def plan(self) -> Plan:
        """The plan as `planner.plan` returns it, with its pulses in memory."""
        if not self.made:
            axes, motion = self.machine.axes, self.trajectory
            solution = self.solution
            self.made.append(
                Plan(
                    self.request,
                    self.program,
                    self.machine,
                    self.path,
                    self.limits,
                    motion,
                    self.certificate,
                    counted_motion(motion, axes, self.machine.home_q),
                    self.pulses,
                    solution.rounds,
                    solution.methods,
                    solution.lower_estimate,
                    known=self.known,
                    shaped=self.shaped,
                )
            )
        return self.made[0]

    @property
    def path(self) -> MachinePath:
        """The path in actuator coordinates."""
        path = self.trajectory.path
        assert isinstance(path, MachinePath)  # as every plan's
        return path

    @property
    def certificate(self) -> Certificate:
        """The proof that the motion keeps every limit, made again when first asked for."""
        return self._prove()[0]

    @property
    def shaped(self) -> ShapedProof | None:
        """The motion after the input shapers and its proof, as of a `Plan`."""
        return self._prove()[1]

    def _prove(self) -> Proofs:
        if not self.proofs:
            self.proofs.append(prove_motion(self.trajectory, self.limits, self.machine.axes))
        return self.proofs[0]

    @property
    def counted(self) -> AxesMotion:
        """The motion that the pulses count, as of a `Plan`."""
        return self.plan.counted

    @property
    def rounds(self) -> int:
        """The rounds of solving until the proof held."""
        return self.solution.rounds

    @property
    def methods(self) -> tuple[str, ...]:
        """The solver of each run."""
        return self.solution.methods

    @property
    def lower_estimate(self) -> float:
        """s, as of a `Plan`; NaN for one that was made in parts."""
        return self.solution.lower_estimate

    @property
    def bound(self) -> DurationBound:
        """The proved lower bound of the duration, as of a `Plan`: worked out when first asked for.

        Raises MotionError for a plan that was made in parts.
        """
        if self.follow is not None:
            raise MotionError(f"{self.program.name} was planned in parts, without a lower bound: use --whole")
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    @property
    def lower_bound(self) -> float:
        """s; no motion along this path that keeps the limits takes less. Raises as `bound`."""
        return self.bound.value

    @property
    def gap(self) -> float | None:
        """How far the duration is above the proven lower bound, as of a `Plan`. Raises as `bound`."""
        return self.bound.gap if self.fastest else None

    @property
    def worth(self) -> "Worth | None":
        """The time that one per cent more of each limit saves, as `Plan.worth`: computed when asked for.

        None if the plan was not to be the fastest, or was made in parts.
        """
        if not self.fastest or self.follow is not None:
            return None
        from planner.tradeoffs.limit_worth import find_worth

        return find_worth(self.trajectory, self.limits, self.order, self.certificate, self.bound)

    @property
    def left_out(self) -> tuple[str, ...]:
        """The limits that the lower bound leaves out, as of a `Plan`."""
        return find_left_out(self.path, self.limits)

    @property
    def exceeded(self) -> str:
        """The warning about a tolerance that is not proved after the input shapers, as of a `Plan`; else ""."""
        return self.plan.exceeded

    @property
    def conditioning(self) -> Conditioning:
        """The poorest of the Jacobian along the path, as of a `Plan`."""
        return find_poorest(self.path)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """The events that the program marks by `trigger`, as of a `Plan`."""
        return self.plan.triggers

    @property
    def avoidable_stops(self) -> AvoidableStops:
        """Stops that nobody asked for, and their approximate cost."""
        return self.plan.avoidable_stops

    @property
    def departures(self) -> tuple[Departure, ...]:
        """How far the tool leaves the straight line in each synchronised move, as of a `Plan`."""
        return departures(self.path)

    @property
    def constant_speeds(self) -> tuple[Stretch, ...]:
        """Where the tool runs at exactly the speeds that segments ask for, as of a `Plan`."""
        return self.plan.constant_speeds

    @property
    def axis_bounds(self) -> Table:
        """The bounds of each axis, as of a `Plan`."""
        return tabulate_axis_bounds(self.machine.axes, self.limits, self.order)

    def realised(self, *, stride: int = 1) -> RealisedPath:
        """Compare the pose that the pulses stand for with the planned one, as `Plan.realised`."""
        return self.plan.realised(stride=stride)

    def tables(self) -> tuple[Table, ...]:
        """Return the tables of a `Plan`."""
        return self.plan.tables()

    def data(self) -> Table:
        """Return the motion over time, as a `Plan`."""
        return self.trajectory.data()

    def plot(self, ax: "Axes | None" = None, *args: Any, **options: Any) -> "Axes":
        """Draw the path in space, as a `Plan`."""
        return self.plan.plot(ax, *args, **options)

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
        if not self.held:
            self.held.append(self.read_pulses(progress))
        motion, pulses = self.trajectory, self.pulses
        proof, path, tool = self.certificate, self.path, self.program.tool
        fired = self.find_triggers(pulses)
        own = path, motion, proof, pulses, self.order, tool, (), self.fastest, fired
        return Whole(self.program.name, self.machine, *own)

    def find_triggers(self, pulses: PulseSchedule) -> tuple[Triggered, ...]:
        """Return the program's triggers, with the counts of these pulses."""
        if not holds_triggers(self.program):
            return ()
        delays = find_delays(self.machine.axes)
        return find_triggers(self.program, self.path, self.trajectory, pulses, *delays)

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
