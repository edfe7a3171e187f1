"""The main job, top to bottom: program -> path -> limits -> certified motion -> pulses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import nan
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.errors import OutOfReach
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.avoidable_stops import AvoidableStops, find_avoidable_stops
from planner.bounds.duration_bound import DurationBound, bound_duration
from planner.bounds.lower_bound import find_left_out
from planner.certificate.certify import Certificate
from planner.certificate.conditioning import Conditioning, find_poorest
from planner.certificate.constant_speed import CONSTANT_SPEED, Stretch, find_stretches
from planner.geometric_check import add_advice
from planner.interruption.interruptible import Interruptible
from planner.interruption.section import Whole
from planner.limits import Limit, OwnLimit, limits_of
from planner.limits.registry import tabulate_axis_bounds
from planner.orientation.orient import orient_open
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath, actuate
from planner.path.outcome import blend_tables, fit_tables
from planner.path.overshoot import overshoot_tables
from planner.path.point_to_point import Departure, departure_tables, departures
from planner.place import Infeasible
from planner.plan_source import MadePlan, PlanSource
from planner.program.model import Program
from planner.program.program_file import ProgramSource, load_program
from planner.pulses import (
    AxesMotion,
    PulseSchedule,
    RealisedPath,
    Rule,
    generate,
    pace_axes,
    realised,
)
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.schedule import schedule_tables
from planner.pulses.triggers import Triggered, find_triggers, holds_triggers, trigger_tables
from planner.request import EFFORT, PlanRequest, Requested
from planner.shaping.keep_limits import Solve, solve_shaped
from planner.shaping.shaped_motion import find_delays, shorten_duration
from planner.shaping.shaped_proof import ShapedProof, describe_exceeded
from planner.timing.certified_solve import Solution, certified_solve, solve_within, timing_table
from planner.timing.goals.heat import solve_objective
from planner.timing.goals.objective import TIME, Objective
from planner.timing.goals.stated_duration import solve_stated
from planner.timing.problem import Settings, Solver
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from planner.bounds.limit_worth import Worth


@dataclass(frozen=True, slots=True)
class Plan(Result, Interruptible, Requested):
    """A program on a machine: path in actuator coordinates, fastest motion, certificate and pulses.

    `plan` makes one, `pulsepath.load_plan` reads one from its folder.

    request          what the caller asked for, with order, duration and objective filled in
    source           motion, proof and pulses
    rounds, methods  rounds of solving until the proof held; solver of each run
    lower_estimate   s, approximate least duration within the limits on speed and acceleration, and
                     at the constant speeds of segments; NaN: unknown, as for a plan made in parts
    known            lower bound, once it was computed
    doubts           why the plan may differ from the one that was proved; only for `unverified`
                     ones
    """

    request: PlanRequest
    program: Program
    machine: Machine
    source: PlanSource = field(repr=False)
    rounds: int
    methods: tuple[str, ...]
    lower_estimate: float = nan
    known: list[DurationBound] = field(default_factory=list, repr=False, compare=False)
    doubts: tuple[str, ...] = ()

    def __repr__(self) -> str:
        schedule = self.source.schedule
        pulses = f"{schedule.rule} pulses at {schedule.clock_hz} Hz"
        name = f"{self.program.name} on {self.machine.name}"
        proof = "not proved" if self.doubts else "proved"
        return f"<Plan {name}: {self.duration:.6g} s, order {self.order}, {proof}, {pulses}>"

    @property
    def trajectory(self) -> Trajectory:
        """Whole motion, before any input shapers."""
        return self.source.trajectory

    @property
    def path(self) -> MachinePath:
        """Path in actuator coordinates."""
        path = self.trajectory.path
        assert isinstance(path, MachinePath)  # as every plan's
        return path

    @property
    def limits(self) -> tuple[Limit, ...]:
        """Limits that the motion is proved to keep."""
        return self.source.limits

    @property
    def certificate(self) -> Certificate:
        """Proof of the motion. A loaded plan is proved again."""
        return self.source.certificate

    @property
    def shaped(self) -> ShapedProof | None:
        """Motion after the input shapers, and its proof."""
        return self.source.shaped

    @property
    def counted(self) -> AxesMotion:
        """Motion that the pulses count: after the shapers, with any compensation of the motors."""
        return self.source.counted

    @property
    def pulses(self) -> PulseSchedule:
        """Exact pulse times of every axis. Raises MotionError if those of a folder were changed."""
        return self.source.read_pulses(ignore_progress)

    @property
    def duration(self) -> float:
        """Time (s) for which the machine moves, after any input shapers."""
        return self.source.duration

    def follow(self) -> Iterator[Trajectory]:
        """Yield the motion part by part, each on its own path, with a time from 0."""
        return self.source.follow()

    @property
    def bound(self) -> DurationBound:
        """Proved lower bound of the duration, computed at its first use, which takes a few times as
        long as solving.
        """
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    @property
    def lower_bound(self) -> float:
        """Proved lower bound (s) of all motions along this path within the limits, apart from
        `left_out`.
        """
        return self.bound.value

    @property
    def gap(self) -> float | None:
        """Excess of the duration over the lower bound, as a share. None: another goal than time."""
        return self.bound.gap if self.fastest else None

    @property
    def worth(self) -> "Worth | None":
        """Time that one per cent more of each limit saves, to first order, by the bound's
        multipliers.

        None: another goal than time.
        """
        if not self.fastest:
            return None
        from planner.bounds.limit_worth import find_worth

        return find_worth(self.trajectory, self.limits, self.order, self.certificate, self.bound)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Limits that the lower bound leaves out. The least time may be longer by their cost."""
        return find_left_out(self.path, self.limits)

    @property
    def exceeded(self) -> str:
        """Warning about a blend or fit tolerance that is not proved after the input shapers; or
        "".
        """
        return "" if self.shaped is None else describe_exceeded(self.path, self.shaped)

    @property
    def conditioning(self) -> Conditioning:
        """Poorest conditioning of the Jacobian along the path.

        Near 0, the pose is nearly singular.
        """
        return find_poorest(self.path)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """Events that the program marks by `trigger`: time, place and counts."""
        if not holds_triggers(self.program):
            return ()
        delays = find_delays(self.machine.axes)
        return find_triggers(self.program, self.path, self.trajectory, self.pulses, *delays)

    @property
    def avoidable_stops(self) -> AvoidableStops:
        """Stops at joins that do not ask for one, with an estimate of their cost and the remedy."""
        return find_avoidable_stops(self.program, self.path, self.limits, self.order)

    @property
    def departures(self) -> tuple[Departure, ...]:
        """Distance of the tool from the straight line in each synchronised move."""
        return departures(self.path)

    @property
    def constant_speeds(self) -> tuple[Stretch, ...]:
        """Stretches at exactly the speeds that segments with `speed_constant` ask for, to one part
        in 10⁹.
        """
        return find_stretches(
            self.trajectory,
            self.certificate.use.get(CONSTANT_SPEED, np.zeros(len(self.trajectory.s))),
        )

    @check_arguments()
    def realised(self, *, stride: int = 1) -> RealisedPath:
        """Compare the pose that the pulses stand for with the planned one, at every stride-th
        interval.
        """
        return realised(self, stride=stride)

    @property
    def axis_bounds(self) -> Table:
        """Largest values of each axis by the limits of this plan, and the limit that sets each."""
        return tabulate_axis_bounds(self.machine.axes, self.limits, self.order)

    def tables(self) -> tuple[Table, ...]:
        """Return tables of duration, proof, axis bounds, joins, pulses and triggers."""
        stated = None if self.fastest else self.describe_objective()
        least = None if np.isnan(self.lower_estimate) else self.lower_estimate
        title = f"{self.program.name} on {self.machine.name}, order {self.order}"
        units = {axis.name: axis.unit for axis in self.machine.axes}
        return (
            timing_table(
                title,
                self.trajectory.duration,
                least,
                self.known[0] if self.known else None,
                stated,
                shaped=None if self.shaped is None else self.duration,
            ),
            *self.certificate.tables(),
            self.axis_bounds,
            *(() if self.shaped is None else self.shaped.tables()),
            *fit_tables(self.path.fit),
            *blend_tables(self.path.blends),
            *departure_tables(self.departures),
            *overshoot_tables(self.path.overshoots),
            *schedule_tables(self.pulses, units),
            *trigger_tables(self.triggers, self.path.names),
        )

    def whole(self, progress: Progress = ignore_progress) -> Whole:
        """Return the data that sections of the plan are made from (`planner.interruption`)."""
        pulses = self.source.read_pulses(progress)
        return Whole(
            self.program.name,
            self.machine,
            self.path,
            self.trajectory,
            self.certificate,
            pulses,
            self.order,
            self.program.tool,
            self.own_limits,
            self.fastest,
            self.triggers,
        )

    def data(self) -> Table:
        """Return the motion over time. `certificate` and `pulses` have data of their own."""
        return self.trajectory.data()


@check_arguments("program", "machine", "limits")
def plan(
    program: ProgramSource,
    machine: MachineSource,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    duration: float | None = None,
    objective: str | Objective = TIME,
    gap: float | None = None,
    effort: int = EFFORT,
    rule: str | Rule = "nearest",
    solver: Solver = "passes",
    limits: Sequence[OwnLimit] = (),
    progress: Progress | None = None,
) -> Plan:
    """Plan the fastest motion of a machine along a program, proved to respect every limit, and its
    pulses.

    Parameters
    ----------
    program, machine
        A program and a machine, names of bundled ones, or paths of files.
    order
        2 limits speed and acceleration, 3 limits jerk too. None: 3 if the machine limits jerk.
    clock_hz
        Ticks per second of the pulses' clock. The motion keeps the pulse rates that are possible
        with whole ticks and the rule (`planner.pulses.pace_axes`).
    duration
        Duration (s) of the smoothest motion that is planned instead (`solve_stated`). None: the
        duration that the program states, if any.
    objective
        "time", or a weighted sum with heat, as "time + 0.2 heat"
        (`planner.timing.goals.objective`).
    gap, effort
        Largest share by which the motion may be longer than its proved lower bound, and the largest
        number of rounds that refine bound and grid for it (`solve_within`). `Plan.gap` is the share
        that is proved.
    rule
        Firing rule, or its name and options ("sampled:period=50us").
    solver
        For order 2: "passes" (our own) or "toppra". A motion of toppra is solved again or slowed
        down like ours until its proof holds.
    limits
        Limits of your own, which this call keeps and proves in addition to the others: instances of
        `planner.limits.Limit`, or functions of the machine and the path that return one. A free
        orientation is chosen without them.
    progress
        Called with the number of different runs between stops that are solved, and the number of
        all; then with the progress of the pulses.

    Returns
    -------
    Plan
        Motion, certificate and pulses.

    Raises
    ------
    Infeasible
        The message names limit, place, excess and remedy.
    OutOfReach
        No axis position leads to a pose.
    MotionError
        The request is invalid.
    """
    request = PlanRequest(
        order=order,
        clock_hz=clock_hz,
        duration=duration,
        objective=objective,
        gap=gap,
        effort=effort,
        rule=rule,
        solver=solver,
        limits=limits,
    )
    return make_plan(request, load_program(program), load_machine(machine), progress)


def make_plan(
    request: PlanRequest,
    program: Program,
    machine: Machine,
    progress: Progress | None = None,
) -> Plan:
    """Plan what a request asks for. Raises as `plan`."""
    request = request.resolve(program, machine)
    order = request.resolved_order
    axes = machine.axes
    clock_hz = int(request.clock_hz)
    paced_axes = pace_axes(axes, clock_hz, request.rule)
    program = orient_open(program, machine, order)
    try:
        path = actuate(program, machine)
        limits = limits_of(path, paced_axes, order, request.limits)
        solve, fastest = _choose_solvers(request, path, machine, progress)
        shaped = None
        if any(axis.shaper for axis in axes):
            solution, certificate, shaped, first = solve_shaped(solve, path, limits, axes, fastest)
        else:
            first = solution = solve(limits)
            certificate = solution.certificate
    except (Infeasible, OutOfReach) as error:
        raise add_advice(error, program, machine, order) from None

    motion = solution.trajectory
    motors = counted_motion(motion, axes, machine.home_q)
    try:
        tell = progress or ignore_progress
        pulses = generate(motors, axes, machine.home_q, clock_hz, request.rule, tell)
    except Infeasible as error:
        raise _name_segment(error, motion) from None
    return Plan(
        replace(request, limits=tuple(request.limits)),
        program,
        machine,
        MadePlan(motion, limits, certificate, shaped, motors, pulses),
        solution.rounds,
        solution.methods,
        first.lower_estimate,
        known=solution.known if first is solution else [],
    )


def _choose_solvers(
    request: PlanRequest,
    path: MachinePath,
    machine: Machine,
    progress: Progress | None,
) -> tuple[Solve[Solution], Solve[Solution]]:
    """Return the solver for the goal of a request, and the one of the fastest motion."""
    axes = machine.axes
    settings = Settings(solver=request.solver)
    # Shaping examines each time piece: those of a grid show where a limit is exceeded.
    gridded = replace(settings, whole=any(axis.shaper for axis in axes))
    solve = partial(
        certified_solve,
        path,
        order=request.resolved_order,
        progress=progress,
        settings=settings,
    )
    fastest = partial(solve, settings=gridded)
    if request.heat > 0:
        objective = Objective(request.heat)
        return lambda limits: solve_objective(solve(limits), axes, objective, progress), fastest
    if request.gap is not None:
        gap = request.gap
        return lambda limits: solve_within(solve(limits), gap, request.effort, settings), fastest
    if request.duration is not None:
        before = shorten_duration(request.duration, axes)
        return lambda limits: solve_stated(solve(limits), axes, before, progress), fastest
    return fastest, fastest


def _name_segment(error: Infeasible, motion: Trajectory) -> Infeasible:
    """Add the segment to a refusal of the pulses, which know only the time."""
    if error.place is None or error.place.t is None:
        return error
    piece = int(motion.at(error.place.t).piece[0])
    place = motion.path.place(error.place.s, piece, error.place.t, error.place.axis)
    return replace(error, place=place)
