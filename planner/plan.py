"""The main job, top to bottom: program -> path -> limits -> certified motion -> pulses."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.errors import MotionError, NotFree, OutOfReach
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.avoidable_stops import AvoidableStops, find_avoidable_stops
from planner.certificate.certify import Certificate
from planner.certificate.conditioning import Conditioning, find_poorest
from planner.certificate.constant_speed import CONSTANT_SPEED, Stretch, find_stretches
from planner.certificate.feasibility import Standing, prove_feasibility
from planner.certificate.lower_bound import find_left_out
from planner.interruption.interruptible import Interruptible
from planner.interruption.section import Whole
from planner.limits import Limit, OwnLimit, limits_of, usual_order
from planner.limits.registry import geometric_limits, make_own_limits, tabulate_axis_bounds
from planner.orientation.orient import orient_open
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath, actuate
from planner.path.outcome import blend_tables, fit_tables
from planner.path.overshoot import overshoot_tables
from planner.path.point_to_point import Departure, departure_tables, departures
from planner.place import Infeasible, LostPath
from planner.program.model import Program
from planner.program.program_file import ProgramSource, load_program
from planner.pulses import AxesMotion, PulseSchedule, RealisedPath, Rule, find_rule, generate, pace_axes, realised
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.generation.motion_parts import refuse_long
from planner.pulses.schedule import schedule_tables
from planner.pulses.triggers import Triggered, find_triggers, trigger_tables
from planner.shaping.keep_limits import Solve, solve_shaped
from planner.shaping.shaped_motion import find_delays, shorten_duration
from planner.shaping.shaped_proof import ShapedProof, describe_exceeded
from planner.timing.certified_solve import EFFORT, Solution, certified_solve, refuse_gap, solve_within, timing_table
from planner.timing.duration_bound import DurationBound, bound_duration
from planner.timing.problem import Solver
from planner.timing.solvers.toppra_ import refuse_solver
from planner.timing.stated_duration import solve_stated
from planner.tradeoffs.heat import solve_objective
from planner.tradeoffs.objective import TIME, Objective, read_objective
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from planner.tradeoffs.limit_worth import Worth

MAX_CLOCK_HZ = 10**18
"""Ticks per second: of a faster clock, ten seconds are more ticks than int64 holds."""


@dataclass(frozen=True, slots=True)
class Plan(Result, Interruptible):
    """A program on a machine: the path in actuator coordinates, the fastest motion, its certificate and pulses.

    counted          what the pulses count: the motion, behind its shapers, as motors that compensate make it
    order            2: to acceleration, 3: to jerk
    rounds, methods  of solving until the proof held; the solver of each run
    lower_estimate   s, about the least within the limits on speed and acceleration, and at constant speeds asked for;
                     NaN: not known, of a loaded plan that was made in parts
    stated_duration  s, what was asked for instead of the fastest, if anything
    objective        what it has least of: time, or a weighed sum with heat
    own_limits       what was asked for beside the machine's and the program's own limits
    shaped           the motion behind input shapers, and its proof; trajectory and certificate are those before them
    """

    program: Program
    machine: Machine
    path: MachinePath
    limits: tuple[Limit, ...] = field(repr=False)
    trajectory: Trajectory = field(repr=False)
    certificate: Certificate
    counted: AxesMotion = field(repr=False)
    pulses: PulseSchedule = field(repr=False)
    order: int
    rounds: int
    methods: tuple[str, ...]
    lower_estimate: float
    stated_duration: float | None = None
    objective: Objective = TIME
    own_limits: tuple[OwnLimit, ...] = field(default=(), repr=False)
    known: list[DurationBound] = field(default_factory=list, repr=False, compare=False)
    shaped: ShapedProof | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"<Plan {self.program.name} on {self.machine.name}: {self.trajectory!r}, {self.certificate!r}>"

    @property
    def duration(self) -> float:
        """s that the machine moves for: behind its input shapers, if it has any."""
        return self.trajectory.duration if self.shaped is None else self.shaped.duration

    @property
    def fastest(self) -> bool:
        """Whether it was to be as fast as it can, and nothing else."""
        return self.stated_duration is None and self.objective.heat == 0

    @property
    def bound(self) -> DurationBound:
        """What is proved of the least time; worked out when first asked for, in some times the time of solving."""
        if not self.known:
            self.known.append(bound_duration(self.trajectory, self.limits, self.order))
        return self.known[0]

    @property
    def lower_bound(self) -> float:
        """s; no motion along this path that keeps the limits takes less, proved, whatever `left_out` names."""
        return self.bound.value

    @property
    def gap(self) -> float | None:
        """How far the duration is above the proven lower bound, as a share; None if it was not to be the fastest."""
        return self.bound.gap if self.fastest else None

    @property
    def worth(self) -> "Worth | None":
        """What one per cent more of each limit saves, to first order, by the bound's multipliers.

        None if it was not to be the fastest.
        """
        if not self.fastest:
            return None
        from planner.tradeoffs.limit_worth import find_worth

        return find_worth(self.trajectory, self.limits, self.order, self.certificate, self.bound)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the lower bound leaves out: it may lie below the least time by what that costs."""
        return find_left_out(self.path, self.limits)

    @property
    def exceeded(self) -> str:
        """What is said where a blend or fit tolerance is not proved behind the input shapers; else ""."""
        return "" if self.shaped is None else describe_exceeded(self.path, self.shaped)

    @property
    def conditioning(self) -> Conditioning:
        """The poorest of the Jacobian along the path: near 0 it comes near a singular pose."""
        return find_poorest(self.path)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """What the program marks by `trigger`: when, where, and the counts by then."""
        return find_triggers(self.program, self.path, self.trajectory, self.pulses, *find_delays(self.machine.axes))

    @property
    def avoidable_stops(self) -> AvoidableStops:
        """Stops at joins that nobody asked for, with an estimate of their cost and the remedy."""
        return find_avoidable_stops(self.program, self.path, self.limits, self.order)

    @property
    def departures(self) -> tuple[Departure, ...]:
        """How far the tool leaves the straight line in each synchronised move."""
        return departures(self.path)

    @property
    def constant_speeds(self) -> tuple[Stretch, ...]:
        """Where the tool runs at exactly the speeds that segments with `speed_constant` ask for, to one part in 10⁹."""
        return find_stretches(
            self.trajectory, self.certificate.use.get(CONSTANT_SPEED, np.zeros(len(self.trajectory.s)))
        )

    @check_arguments()
    def realised(self, *, stride: int = 1) -> RealisedPath:
        """How far the pose that the pulses stand for is from the planned one; stride k looks at every k-th interval."""
        return realised(self, stride=stride)

    @property
    def axis_bounds(self) -> Table:
        """What each axis may do at most, by the limits as they were planned with, and what says so."""
        return tabulate_axis_bounds(self.machine.axes, self.limits, self.order)

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, what is proved of it, what its axes may do, its blends, its pulses and its triggers."""
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

    def describe_objective(self) -> str:
        """What it was to be instead of the fastest; nothing if it was."""
        if self.stated_duration is not None:
            return "as stated"
        return "" if self.fastest else f"with the least {self.objective}"

    def whole(self) -> Whole:
        """What sections of it are made of (`planner.interruption`)."""
        motion = self.path, self.trajectory, self.certificate, self.pulses
        own = self.program.tool, self.own_limits, self.fastest, self.triggers
        return Whole(self.program.name, self.machine, *motion, self.order, *own)

    def data(self) -> Table:
        """The motion over time; `certificate` and `pulses` have data of their own."""
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
    """Plan the fastest motion of a machine along a program, proved to respect every limit, and its pulses.

    Parameters
    ----------
    program, machine
        As they are, by the name of a bundled one, or by the path of a file.
    order
        2 keeps speed and acceleration, 3 jerk as well. None: 3 where the machine states jerk limits.
    clock_hz
        Ticks per second of the pulses' clock. The pulse rates that the motion keeps are those that whole ticks and the
        rule can hold (`planner.pulses.pace_axes`).
    duration
        s, of the smoothest motion that takes so long instead (`solve_stated`). None: what the program states, if any.
    objective
        "time", or the least of a weighed sum with heat, as "time + 0.2 heat" (`planner.tradeoffs.objective`).
    gap, effort
        The share of the least time that it is to be proved within (`solve_within`; `Plan.gap` says what is proved), and
        the rounds of finer bounds and grids for that, at most.
    rule
        Of firing, or its name and options ("sampled:period=50us").
    solver
        Of order 2: "passes" (our own) or "toppra", whose motion is solved anew or slowed like ours until its proof
        holds.
    limits
        Of your own, kept and proved beside the others by this call alone: instances of `planner.limits.Limit`, or
        functions of the machine and the path that return one. An orientation left free is chosen without them.
    progress
        Called with how many of the runs between stops are solved, and of how many; then with how far the pulses are.

    Returns
    -------
    Plan
        Motion, certificate and pulses.

    Raises
    ------
    Infeasible
        What breaks a limit, where, by how much, and the remedy.
    OutOfReach
        A pose that no axis position leads to.
    MotionError
        What is asked for cannot be.
    """
    program = program if isinstance(program, Program) else load_program(program)
    machine = machine if isinstance(machine, Machine) else load_machine(machine)
    if order is None:
        order = usual_order(machine.axes, program)
    if order not in (2, 3):
        raise MotionError(f"order {order} is not known; 2 limits speed and acceleration, 3 jerk too")
    if not 0 < clock_hz <= MAX_CLOCK_HZ:
        raise MotionError(f"clock_hz {clock_hz!r:.60} must be above 0, and at most {MAX_CLOCK_HZ:g} ticks per second")
    duration = program.duration if duration is None else duration
    if duration is not None and not 0 < duration < np.inf:
        raise MotionError(f"duration {duration:g} s must be positive and finite")
    if duration is not None:
        refuse_long(duration, int(clock_hz))
    objective = read_objective(objective) if isinstance(objective, str) else objective
    if duration is not None and objective.heat > 0:
        raise MotionError(f'objective "{objective}" finds a duration of its own: omit it, or the one of {duration:g} s')
    if gap is not None or effort != EFFORT:
        refuse_gap(gap, effort, duration is None and objective.heat == 0)
    rule = find_rule(rule) if isinstance(rule, str) else rule
    if solver != "passes":
        refuse_solver(solver, order, duration)
        if objective.heat > 0:
            raise MotionError(f'solver toppra finds the fastest motion: omit it, or objective "{objective}"')
    program = orient_open(program, machine, order)
    try:
        path = actuate(program, machine)
        kept = limits_of(path, pace_axes(machine.axes, int(clock_hz), rule), order, limits)
        axes = machine.axes
        # shaping looks at the motion piece by piece: those of a grid tell where a limit is exceeded
        shaped_axes = any(axis.shaper for axis in axes)
        fastest = partial(
            certified_solve,
            path,
            order=order,
            progress=progress,
            solver=solver,
            cruising=not shaped_axes,
        )
        solve: Solve[Solution] = fastest
        if objective.heat > 0:
            solve = partial(solve_objective, path, axes=axes, order=order, objective=objective, progress=progress)
        elif gap is not None:
            solve = partial(solve_within, path, order=order, gap=gap, effort=effort, progress=progress, solver=solver)
        elif duration is not None:
            before = shorten_duration(duration, axes)
            solve = partial(solve_stated, path, axes=axes, order=order, duration=before, progress=progress)
        if shaped_axes:
            solution, certificate, shaped, first = solve_shaped(solve, path, kept, axes, fastest)
        else:
            first = solution = solve(kept)
            certificate, shaped = solution.certificate, None
    except (Infeasible, OutOfReach) as no:
        raise _add_advice(no, program, machine, order) from None
    motion = solution.trajectory
    try:
        motors = counted_motion(motion, axes, machine.home_q)
        pulses = generate(motors, axes, machine.home_q, int(clock_hz), rule, progress or ignore_progress)
    except Infeasible as no:  # which names the segment here: pulses alone do not know it
        if no.place is None or no.place.t is None:
            raise
        piece = int(motion.at(no.place.t).piece[0])
        place = motion.path.place(no.place.s, piece, no.place.t, no.place.axis)
        raise Infeasible(no.kind, no.axis, place, no.value, no.limit, no.unit, no.remedy) from None
    return Plan(
        program,
        machine,
        path,
        kept,
        motion,
        certificate,
        motors,
        pulses,
        order,
        solution.rounds,
        solution.methods,
        first.lower_estimate,
        duration,
        objective,
        tuple(limits),
        solution.known if first is solution else [],
        shaped,
    )


@check_arguments("program", "machine", "limits")
def check(program: ProgramSource, machine: MachineSource, *, limits: Sequence[OwnLimit] = ()) -> Standing:
    """Limits that slowing down cannot fix, proved over a program's path.

    Parameters
    ----------
    program, machine
        Each as it is, by its name, or by the path of its file.
    limits
        Of your own, as of `plan`.

    Returns
    -------
    Standing
        Violations, the worst first, and margins.

    Raises
    ------
    MotionError
        The path cannot be drawn.
    """
    program, machine = load_program(program), load_machine(machine)
    program = orient_open(program, machine, usual_order(machine.axes, program))
    try:
        path = actuate(program, machine)
    except OutOfReach as error:
        raise _add_advice(error, program, machine, 2) from None
    own = (each for each in make_own_limits(path, limits) if each.geometric)
    standing = prove_feasibility(path, (*limits_of(path, machine.axes, 2), *own))
    worst = tuple(_add_advice(error, program, machine, 2) for error in standing.violations[:1])
    violations = (*worst, *standing.violations[1:])
    standing = replace(
        standing,
        violations=violations,
        blends=path.blends,
        fit=path.fit,
        departures=departures(path),
        overshoots=path.overshoots,
    )
    if violations:
        return standing
    kind = usual_order(machine.axes, program)
    stops = find_avoidable_stops(program, path, limits_of(path, machine.axes, kind, limits), kind)
    return replace(standing, conditioning=find_poorest(path), avoidable=stops)


def _add_advice(no: MotionError, program: Program, machine: Machine, order: int) -> MotionError:
    """Geometric violations, with how far the path must shrink or move; other refusals unchanged."""
    from planner.certificate.advice import find_remedy

    if isinstance(no, NotFree):
        return no
    more = partial(find_remedy, program, machine, order)
    if isinstance(no, Infeasible):
        return no.add_advice(more) if no.kind in geometric_limits() else no
    return LostPath(str(no), more).in_segment(no.segment)
