"""The main job, top to bottom: program -> path -> limits -> certified motion -> pulses.

And what holds a motion back when.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, NotFree, OutOfReach
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.machine.machine import Machine
from planner.certificate.certify import Certificate
from planner.certificate.constant_speed import CONSTANT_SPEED, Stretch, find_stretches
from planner.certificate.feasibility import Standing, prove_feasibility
from planner.limits import Limit, limits_of, usual_order
from planner.limits.force import TorqueSpeed
from planner.limits.limit import order_of
from planner.limits.registry import geometric_limits
from planner.limits.resonance import Resonance
from planner.orientation.orient import orient_open
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath, actuate
from planner.path.outcome import blend_tables, fit_tables
from planner.path.point_to_point import Departure, departure_tables, departures
from planner.place import Infeasible, LostPath
from planner.program.model import Program
from planner.pulses import (
    AxesMotion,
    PulseSchedule,
    RealisedPath,
    Rule,
    find_rule,
    generate,
    pace_axes,
    realised,
)
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.schedule import schedule_tables
from planner.pulses.triggers import Triggered, find_triggers, trigger_tables
from planner.timing.certified_solve import certified_solve, timing_table
from planner.timing.problem import Solver
from planner.timing.profile import Profile, sample_limit_use
from planner.timing.solvers.toppra_ import require
from planner.timing.stated_duration import solve_stated
from planner.trajectory import Trajectory

if TYPE_CHECKING:
    from planner.export.format import Exported


@dataclass(frozen=True, slots=True)
class Plan(Result):
    """A program on a machine: the path in actuator coordinates, the fastest motion, its certificate and pulses.

    counted          the motion, or where axes ask for compensation what their motors make of it, which the pulses count
    order            2: to acceleration, 3: to jerk
    rounds, methods  of solving until the proof held; the solver of each run
    lower_estimate   s, about the least that any motion within the limits on speed and acceleration takes, with the
                     constant speeds that are asked for
    stated_duration  s, what was asked for instead of the fastest, if anything
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

    @property
    def gap(self) -> float | None:
        """How far the duration is above the estimate of its lower bound, as a share of that; None if it was stated."""
        return None if self.stated_duration is not None else self.trajectory.duration / self.lower_estimate - 1

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the estimate of the lower bound leaves out: it may lie below the least time by what that costs."""
        found = ["jerk"] if order_of(self.limits) == 3 else []
        for limit in self.limits:
            if isinstance(limit, TorqueSpeed):
                found.append("of torque-speed curves, what is not concave")
            if isinstance(limit, Resonance) and limit.bands:
                found.append("how long an axis may stay in a resonance band")
        return tuple(found)

    @property
    def triggers(self) -> tuple[Triggered, ...]:
        """What the program marks by `trigger`: when, where, and the counts by then."""
        return find_triggers(self.program, self.path, self.trajectory, self.pulses)

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

    def realised(self, *, stride: int = 1) -> RealisedPath:
        """How far the pose that the pulses stand for is from the planned one; stride k looks at every k-th interval."""
        return realised(self, stride=stride)

    def export(self, format: str, path: str | PathLike[str], *, force: bool = False, **options: Any) -> "Exported":
        """Write it in a format of `planner.export.format`, and tell how far what the file holds is from the plan.

        options: the fields of the format's dataclass, in SI units. force: replace a file that is there.
        Raises MotionError for an unknown format or option, a file that is there, and what the format cannot hold.
        """
        from planner.export.format import ExportSource, write_export

        source = ExportSource(self.program.name, self.machine, self.trajectory, self.pulses)
        return write_export(source, format, path, force, options)

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, what is proved of it, its blends, its pulses and its triggers."""
        stated = None if self.stated_duration is None else "as stated"
        title = f"{self.program.name} on {self.machine.name}, order {self.order}"
        units = {axis.name: axis.unit for axis in self.machine.axes}
        return (
            timing_table(title, self.trajectory.duration, self.lower_estimate, stated),
            *self.certificate.tables(),
            *fit_tables(self.path.fit),
            *blend_tables(self.path.blends),
            *departure_tables(self.departures),
            *schedule_tables(self.pulses, units),
            *trigger_tables(self.triggers, self.path.names),
        )

    def data(self) -> Table:
        """The motion over time; `certificate` and `pulses` have data of their own."""
        return self.trajectory.data()


def plan(
    program: Program,
    machine: Machine,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    duration: float | None = None,
    rule: str | Rule = "nearest",
    solver: Solver = "passes",
    progress: Progress | None = None,
) -> Plan:
    """Plan the fastest motion of a machine along a program, proved to respect every limit, and its pulses.

    order 2 keeps speed and acceleration, 3 jerk as well; None: 3 where the machine states jerk limits. The pulse rates
    that it keeps are those that the clock's whole ticks and the rule can hold (`planner.pulses.pace_axes`).
    duration (s): the smoothest motion that takes so long instead (`planner.timing.stated_duration.solve_stated`);
    None: what the program states, if it does. solver: of order 2, "passes" (our own) or "toppra", whose motion is
    solved anew or slowed like ours until its proof holds. rule: of firing, or its name and options
    ("sampled:period=50us"). progress is told how many of the runs between stops are solved, and of how many, and then
    how far the pulses are. Raises Infeasible (what, where, by how much, remedy), OutOfReach, or MotionError.
    """
    if order is None:
        order = usual_order(machine.axes)
    if order not in (2, 3):
        raise MotionError(f"order {order} is not known; 2 limits speed and acceleration, 3 jerk too")
    if isinstance(clock_hz, bool) or not isinstance(clock_hz, (int, np.integer)) or clock_hz <= 0:
        raise MotionError(f"clock_hz {clock_hz} must be a positive whole number of ticks per second")
    duration = program.duration if duration is None else duration
    if duration is not None and not 0 < duration < np.inf:
        raise MotionError(f"duration {duration} s must be positive and finite")
    rule = find_rule(rule) if isinstance(rule, str) else rule
    if solver != "passes":
        _refuse_solver(solver, order, duration)
    program = orient_open(program, machine, order)
    try:
        path = actuate(program, machine)
        limits = limits_of(path, pace_axes(machine.axes, int(clock_hz), rule), order)
        if duration is None:
            solution = certified_solve(path, limits, order, progress, solver=solver)
        else:
            solution = solve_stated(path, limits, machine.axes, order, duration, progress)
    except (Infeasible, OutOfReach) as no:
        raise _add_advice(no, program, machine, order) from None
    motors, pulses = _generate_pulses(solution.trajectory, machine, int(clock_hz), rule, progress or ignore_progress)
    return Plan(
        program,
        machine,
        path,
        limits,
        solution.trajectory,
        solution.certificate,
        motors,
        pulses,
        order,
        solution.rounds,
        solution.methods,
        solution.lower_estimate,
        duration,
    )


def _refuse_solver(solver: str, order: int, duration: float | None) -> None:
    """Raise MotionError for a solver that is unknown, not there, or not for what is asked of it."""
    if solver != "toppra":
        raise MotionError(f"solver {solver!r} is not known; solvers: passes (our own) and toppra")
    if order != 2:
        raise MotionError("solver toppra has no jerk limits: give order=2, or omit the solver for order 3")
    if duration is not None:
        raise MotionError(
            f"solver toppra finds the fastest motion, not one of {duration:g} s: omit the solver or the duration"
        )
    require("solver toppra")


def _generate_pulses(
    trajectory: Trajectory, machine: Machine, clock_hz: int, rule: Rule, progress: Progress
) -> tuple[AxesMotion, PulseSchedule]:
    """What is counted, and its pulses; a refusal names the segment, which pulses alone do not know."""
    try:
        motors = counted_motion(trajectory, machine.axes, machine.home_q)
        return motors, generate(motors, machine.axes, machine.home_q, clock_hz, rule, progress)
    except Infeasible as no:
        if no.place is None or no.place.t is None:
            raise
        piece = int(trajectory.at(no.place.t).piece[0])
        place = trajectory.path.place(no.place.s, piece, no.place.t, no.place.axis)
        raise Infeasible(no.kind, no.axis, place, no.value, no.limit, no.unit, no.remedy) from None


def check(program: Program, machine: Machine) -> Standing:
    """Limits that slowing down cannot fix, proved over a program's path: violations, the worst first, and margins.

    Raises MotionError for a path that cannot be drawn.
    """
    program = orient_open(program, machine, usual_order(machine.axes))
    try:
        path = actuate(program, machine)
    except OutOfReach as no:
        raise _add_advice(no, program, machine, 2) from None
    found = prove_feasibility(path, limits_of(path, machine.axes, 2))
    worst = tuple(_add_advice(no, program, machine, 2) for no in found.violations[:1])
    violations = (*worst, *found.violations[1:])
    return replace(found, violations=violations, blends=path.blends, fit=path.fit, departures=departures(path))


def _add_advice(no: MotionError, program: Program, machine: Machine, order: int) -> MotionError:
    """Geometric violations, with how far the path must shrink or move; other refusals unchanged."""
    from planner.certificate.advice import find_remedy

    if isinstance(no, NotFree):
        return no
    more = partial(find_remedy, program, machine, order)
    if isinstance(no, Infeasible):
        return no.add_advice(more) if no.kind in geometric_limits() else no
    return LostPath(str(no), more)


ACTIVE_SHARE = 0.99
"""The share of a limit from which on it holds the motion back."""


def limit_shares(plan: Plan) -> dict[str, Array]:
    """(M,) the largest share of each limit that the motion is seen to use in each time piece.

    Of limits that do not depend on timing, the proven share. What is proved of the others is as close only where they
    are used most: elsewhere a bound need not be.
    """
    motion = plan.trajectory
    profile = Profile(motion.s, motion.v, motion.a, motion.j, np.diff(motion.knots), motion.piece)
    standing = {limit.name: plan.certificate.use[limit.name] for limit in plan.limits if limit.geometric}
    return standing | sample_limit_use(motion.path, plan.limits, profile)


def active_limits(plan: Plan) -> np.ndarray:
    """(M,) for each time piece the index in `plan.limits` of the limit that holds the motion back; −1 where none does.

    It is the most used one from 99 % on. Geometric limits never do: they do not depend on timing.
    """
    seen = limit_shares(plan)
    use = np.stack([seen[limit.name] * (not limit.geometric) for limit in plan.limits])
    return np.where(use.max(0) >= ACTIVE_SHARE, use.argmax(0), -1)
