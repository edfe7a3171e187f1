"""Plan a program of any length part by part, as it is read: the motion of each part, its proof and
its pulses.

Each part comes with a stop. The parts up to any of them, together with its stop, are a certified
motion that ends at rest. The next part takes the place of that stop.
"""

from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import takewhile

import numpy as np

from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.avoidable_stops import AvoidableStops, cost_first_stops, state_stops
from planner.certificate.certify import Certificate
from planner.certificate.summary import join_certificates, summarise_part
from planner.limits import Limit, OwnLimit, limits_of
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS, PLACELESS
from planner.needs_whole import find_whole_reason
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.path.chain import walk_path
from planner.path.join_and_blend import PathStep
from planner.path.outcome import FitSummary, fit_tables, merge_fits, summarise_fits
from planner.plan import Plan, make_plan
from planner.program.model import Program
from planner.program.program_file import ProgramSource, load_program
from planner.pulses import PulseSchedule, Rule, find_rule, pace_axes
from planner.pulses.generation.stream import PulseStream
from planner.pulses.schedule import schedule_tables
from planner.pulses.trigger_stream import (
    Crossing,
    Mark,
    count_crossings,
    find_crossings,
    mark_steps,
)
from planner.pulses.triggers import Triggered
from planner.request import PIECES, PlanRequest, Requested
from planner.timing.certified_solve import timing_table
from planner.trajectory import Trajectory
from planner.windows import Helpers, Start, Window, WindowPlanner


@dataclass(frozen=True, slots=True)
class PlanStanding(Result, Requested):
    """A plan up to the end of one of its parts, with the fields of `Plan` that can be known there.

    request          what the caller asked for, with order, duration and objective filled in
    start            start of the next part: its time is the duration so far, its length that of the
                     path
    segment          number of the last planned segment, from 1
    windows          number of windows
    certificate      of the whole motion; `use` and `attained` have one entry per window, or per
                     several windows
    blends           joins that ask for a blend or a curve and have one; stops: joins where the
                     motion stops instead
    pulses           the schedule so far, without its pulses
    counted          for each axis, its number of pulses, and its last count minus its first
    methods          solvers, with the number of runs of each
    triggers         number of triggers that the pulses have passed
    avoidable_stops  stops at joins that do not ask for one, and an estimate of their cost
    """

    request: PlanRequest
    program: Program
    machine: Machine
    start: Start
    segment: int
    windows: int
    certificate: Certificate
    fit: FitSummary | None
    blends: int
    stops: int
    pulses: PulseSchedule
    counted: tuple[tuple[int, int], ...]
    rounds: int
    methods: Mapping[str, int]
    triggers: int = 0
    avoidable_stops: AvoidableStops | None = None

    @property
    def duration(self) -> float:
        """Duration (s) of the motion so far."""
        return self.start.begin

    def tables(self) -> tuple[Table, ...]:
        """Duration, proof, fit and pulses as tables."""
        windows = count_noun(self.windows, "window")
        title = f"{self.program.name} on {self.machine.name}, order {self.order}, in {windows}"
        units = {axis.name: axis.unit for axis in self.machine.axes}
        return (
            timing_table(title, self.duration),
            *self.certificate.tables(),
            *fit_tables(self.fit),
            *schedule_tables(self.pulses, units, self.counted),
        )


@dataclass(frozen=True, slots=True)
class PlanPart:
    """The part of a window that stays, and the stop that ends the motion if nothing follows.

    start, steps   start of the window, and its number of steps of the path
    motion         trajectory of the part, on the path of the window; before any input shapers,
                   after which the machine moves for the standing's duration
    rest           trajectory of the stop, on the same path; None: the motion rests at the end of
                   the part
    pulses         final pulses of the part
    rest_pulses    pulses of the part that the next one may change, and those of the stop
    until          tick before which all pulses are final
    limits         of the window
    rest_proof     certificate of the stop
    triggers       triggers that the pulses of the part pass
    rest_triggers  triggers that the pulses of the stop pass
    standing       the plan up to the end of the part
    """

    start: Start
    steps: int
    motion: Trajectory
    rest: Trajectory | None
    pulses: PulseSchedule
    rest_pulses: PulseSchedule | None
    until: int
    limits: tuple[Limit, ...]
    rest_proof: Certificate | None
    triggers: tuple[Triggered, ...]
    rest_triggers: tuple[Triggered, ...]
    standing: PlanStanding


def plan_parts(
    program: ProgramSource,
    machine: MachineSource,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    rule: str | Rule = "nearest",
    limits: Sequence[OwnLimit] = (),
    pieces: int = PIECES,
    helpers: Helpers | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[PlanPart]:
    """Plan a program as it is read: the fastest motion, its proof and its pulses, in constant
    memory.

    The motion takes up to 0.1 % longer than if the whole were planned at once, as each window looks
    ahead only as far as it reaches (`planner.windows`). If a stage needs the whole motion
    (`planner.needs_whole`), there is one part, which is that of `plan`.

    Parameters
    ----------
    program, machine, order, clock_hz, rule, limits
        As of `plan`.
    pieces
        Pieces of path in the first window.
    helpers
        Other processes that solve windows; None: no others. An only part is solved without them.
    progress
        Called with the number of segments read so far, and their number in all repetitions; for an
        only part as by `plan`.

    Raises
    ------
    MotionError
        As `plan`, after the parts before the refusal.
    """
    request = PlanRequest(
        order=order,
        clock_hz=clock_hz,
        rule=rule,
        limits=limits,
        pieces=pieces,
    )
    return make_parts(request, load_program(program), load_machine(machine), helpers, progress)


def make_parts(
    request: PlanRequest,
    program: Program,
    machine: Machine,
    helpers: Helpers | None = None,
    progress: Progress = ignore_progress,
) -> Iterator[PlanPart]:
    """Plan what a request asks for part by part. Raises as `plan_parts`."""
    request = request.resolve(program, machine)
    if find_whole_reason(request, program, machine) is not None:
        yield _make_only_part(make_plan(request, program, machine, progress))
        return
    steps = _Steps(program, machine, progress)
    maker = _PartMaker(request, program, machine, steps)
    for window in _make_planner(request, program, machine)(steps, helpers):
        yield maker.add(window)


def _make_planner(request: PlanRequest, program: Program, machine: Machine) -> WindowPlanner:
    """Return the planner of windows for a request."""
    order = request.resolved_order
    paced = pace_axes(machine.axes, int(request.clock_hz), request.rule)
    find_limits = partial(limits_of, axes=paced, order=order, own=request.limits)
    # A caller's own limit may depend on the place, so that equal stretches differ.
    copying = not request.limits and {*AXIS_LIMITS, *MACHINE_LIMITS} <= PLACELESS
    return WindowPlanner(
        machine,
        find_limits,
        order,
        program.tool,
        request.pieces,
        copying=copying,
    )


class _PartMaker:
    """Makes the parts of a plan from its windows: pulses, triggers and the standing."""

    def __init__(
        self,
        request: PlanRequest,
        program: Program,
        machine: Machine,
        steps: "_Steps",
    ) -> None:
        rule = find_rule(request.rule) if isinstance(request.rule, str) else request.rule
        self._request = request
        self._program = program
        self._machine = machine
        self._steps = steps
        self._stream = PulseStream(machine, int(request.clock_hz), rule)
        self._standing: PlanStanding | None = None
        # Triggers that the motion has passed, but not its pulses.
        self._waiting: tuple[Crossing, ...] = ()

    def add(self, window: Window) -> PlanPart:
        """Return the part that a window adds to the plan."""
        before = self._stream
        stream = before.copy()
        solution = window.solution
        motion = solution.trajectory
        end = len(motion.s)
        part = motion.cut(0, window.kept)
        last = window.kept == end and self._is_last(window)
        pulses = stream.add(part, last)

        # The way to rest if nothing follows. A part that ends at a stop of the path needs none, but
        # its last pulses may still be held back.
        rest: Trajectory | None = None
        rest_pulses: PulseSchedule | None = None
        rest_proof: Certificate | None = None
        if window.kept < end:
            rest = motion.cut(window.kept, end)
            rest_pulses = stream.copy().add(rest, last=True)
            rest_proof = summarise_part(
                solution.certificate,
                motion,
                solution.limits,
                slice(window.kept, end),
            )
        elif not last:
            rest_pulses = _end_pulses(before, part, stream.until)

        until = None if last else stream.until
        triggers, rest_triggers = self._count_triggers(window, pulses, rest_pulses, until)
        here = self._describe(window, part, pulses, len(triggers))
        self._standing = here if self._standing is None else _join(self._standing, here)
        self._stream = stream
        return PlanPart(
            window.start,
            window.steps,
            part,
            rest,
            pulses,
            rest_pulses,
            stream.until,
            solution.limits,
            rest_proof,
            triggers,
            rest_triggers,
            self._standing,
        )

    def _is_last(self, window: Window) -> bool:
        """Return whether a window has the last step.

        Otherwise the motion continues, maybe from rest.
        """
        return self._steps.ended and window.next.steps == self._steps.taken

    def _count_triggers(
        self,
        window: Window,
        pulses: PulseSchedule,
        rest_pulses: PulseSchedule | None,
        until: int | None,
    ) -> tuple[tuple[Triggered, ...], tuple[Triggered, ...]]:
        """Return the triggers that the pulses of a part pass, and the triggers of the stop."""
        motion = window.solution.trajectory
        marks = self._steps.find_marks(window.start.steps + window.steps)
        ahead = find_crossings(motion, window.start.steps, marks)
        passed = len(self._steps.pop_marks(window.next.steps))
        arrived = (*self._waiting, *ahead[:passed])
        triggers, self._waiting = count_crossings(arrived, pulses, until)
        stopping = (*self._waiting, *ahead[passed:])
        rest_triggers = count_crossings(stopping, rest_pulses or pulses, None)[0]
        return triggers, rest_triggers

    def _describe(
        self,
        window: Window,
        part: Trajectory,
        pulses: PulseSchedule,
        triggers: int,
    ) -> PlanStanding:
        """Return the standing of a plan that consists of this window alone."""
        solution = window.solution
        order = solution.order
        path = solution.trajectory.path
        assert isinstance(path, MachinePath)  # as every plan's
        joins = self._steps.pop(window.next.steps)
        blends = [step.blend for step in joins if step.blend is not None]
        fits = [step.fitted for step in joins if step.fitted is not None]
        unasked = sum(step.avoidable and step.stop <= order for step in joins)
        last_piece = int(part.piece[-1])
        first = pulses if self._standing is None else self._standing.pulses
        return PlanStanding(
            self._request,
            self._program,
            self._machine,
            window.next,
            segment=part.path.place(0.0, last_piece).segment or 0,
            windows=1,
            certificate=summarise_part(
                solution.certificate,
                solution.trajectory,
                solution.limits,
                slice(0, window.kept),
            ),
            fit=summarise_fits(fits, blends),
            blends=len(blends),
            stops=sum(bool(blend.stop) for blend in blends),
            pulses=_without_pulses(pulses, first),
            counted=tuple((len(axis), axis.final - axis.start) for axis in pulses.axes),
            rounds=solution.rounds,
            methods=Counter(solution.methods),
            triggers=triggers,
            avoidable_stops=cost_first_stops(
                state_stops(self._program, unasked),
                path,
                solution.limits,
                order,
                last_piece + 1,
            ),
        )


def _join(before: PlanStanding, here: PlanStanding) -> PlanStanding:
    """Return the standing of a plan after one more window, whose own standing is `here`."""
    counted = tuple(
        (number + added, net + change)
        for (number, net), (added, change) in zip(before.counted, here.counted, strict=True)
    )
    avoidable = here.avoidable_stops
    if before.avoidable_stops is not None and avoidable is not None:
        avoidable = before.avoidable_stops + avoidable
    return replace(
        here,
        windows=before.windows + here.windows,
        certificate=join_certificates(before.certificate, here.certificate),
        fit=merge_fits(before.fit, here.fit),
        blends=before.blends + here.blends,
        stops=before.stops + here.stops,
        pulses=_append_crossings(before.pulses, here.pulses),
        counted=counted,
        rounds=max(before.rounds, here.rounds),
        methods=Counter(before.methods) + Counter(here.methods),
        triggers=before.triggers + here.triggers,
        avoidable_stops=avoidable,
    )


def _make_only_part(plan: Plan) -> PlanPart:
    """Return the part of a plan that was made as a whole."""
    path = plan.path
    blends = path.blends
    pulses = plan.pulses
    last_ticks = [int(axis.ticks[-1]) for axis in pulses.axes if len(axis)]
    until = 1 + max(last_ticks, default=0)
    # The machine moves for longer than its trajectory if axes have input shapers.
    steps = len(path.ends) - 1
    end = Start(Fraction(plan.duration), float(path.breaks[-1]), steps)
    standing = PlanStanding(
        plan.request,
        plan.program,
        plan.machine,
        end,
        segment=len(plan.program.segments),
        windows=1,
        certificate=plan.certificate,
        fit=path.fit,
        blends=len(blends),
        stops=sum(bool(blend.stop) for blend in blends),
        pulses=_without_pulses(pulses, pulses),
        counted=tuple((len(axis), axis.final - axis.start) for axis in pulses.axes),
        rounds=plan.rounds,
        methods=Counter(plan.methods),
        triggers=len(plan.triggers),
        avoidable_stops=plan.avoidable_stops,
    )
    return PlanPart(
        Start(),
        steps,
        plan.trajectory,
        rest=None,
        pulses=pulses,
        rest_pulses=None,
        until=until,
        limits=plan.limits,
        rest_proof=None,
        triggers=plan.triggers,
        rest_triggers=(),
        standing=standing,
    )


def come_to_rest(part: PlanPart) -> PlanStanding:
    """Return the standing of a plan that ends with the stop after a part."""
    standing, pulses = part.standing, part.rest_pulses
    if pulses is None:
        return standing
    counted = tuple(
        (number + len(axis), net + axis.final - axis.start)
        for (number, net), axis in zip(standing.counted, pulses.axes, strict=True)
    )
    start, segment, proof = standing.start, standing.segment, standing.certificate
    if part.rest is not None and part.rest_proof is not None:
        segment = part.rest.path.place(0.0, int(part.rest.piece[-1])).segment or segment
        proof = join_certificates(proof, part.rest_proof)
        length = part.start.length + float(part.rest.path.breaks[-1])
        start = Start(
            start.elapsed + Fraction(part.rest.duration), length, part.start.steps + part.steps
        )
    stated = _append_crossings(standing.pulses, _without_pulses(pulses, standing.pulses))
    triggers = standing.triggers + len(part.rest_triggers)
    return replace(
        standing,
        start=start,
        segment=segment,
        certificate=proof,
        pulses=stated,
        counted=counted,
        triggers=triggers,
    )


def _without_pulses(pulses: PulseSchedule, first: PulseSchedule) -> PulseSchedule:
    """Return a schedule without its pulses, with the start counts of the first part."""
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    axes = zip(pulses.axes, first.axes, strict=True)
    bare = tuple(
        replace(axis, ticks=none[0], direction=none[1], start=one.start) for axis, one in axes
    )
    return replace(pulses, axes=bare)


def _append_crossings(before: PulseSchedule, here: PulseSchedule) -> PulseSchedule:
    """Return the schedule of a later part with the windows of all crossings of the play so far."""
    pairs = zip(before.compensations, here.compensations, strict=True)
    return replace(
        here,
        compensations=tuple(
            replace(after, windows=(*earlier.windows, *after.windows)) for earlier, after in pairs
        ),
    )


class _Steps:
    """The steps of a path in order, and the joins, chains and triggers that are still to be
    planned.
    """

    def __init__(self, program: Program, machine: Machine, progress: Progress) -> None:
        """progress: called with the number of segments read, and of all."""
        self._segments = len(program.segments)
        self._total = program.repeat * self._segments
        self._tell = progress
        self._steps = mark_steps(walk_path(program, machine), program, machine)
        self._joins = deque[tuple[int, PathStep]]()
        self._marks = deque[Mark]()
        self._next = next(self._steps, None)
        self.taken = 0

    @property
    def ended(self) -> bool:
        """True after the last step."""
        return self._next is None

    def __iter__(self) -> Iterator[PathStep]:
        while self._next is not None:
            step, marks = self._next
            self._next = next(self._steps, None)
            self.taken += 1
            self._marks.extend(marks)
            self._tell(
                ((step.piece.repetition or 1) - 1) * self._segments + step.piece.segment,
                self._total,
            )
            if step.blend is not None or step.fitted is not None or step.avoidable:
                self._joins.append((self.taken, step))
            yield step

    def pop(self, until: int) -> list[PathStep]:
        """Remove and return the joins up to a number of steps from the first."""
        joins: list[PathStep] = []
        while self._joins and self._joins[0][0] <= until:
            joins.append(self._joins.popleft()[1])
        return joins

    def find_marks(self, until: int) -> list[Mark]:
        """Return the triggers up to a number of steps from the first."""
        return [*takewhile(lambda mark: mark.step <= until, self._marks)]

    def pop_marks(self, until: int) -> list[Mark]:
        """Remove and return them."""
        marks = self.find_marks(until)
        for _ in marks:
            self._marks.popleft()
        return marks


def _end_pulses(before: PulseStream, motion: Trajectory, until: int) -> PulseSchedule:
    """Return the pulses of a part from a tick on, as if the motion ended with the part."""
    every = before.copy().add(motion, last=True)
    axes = []
    for axis in every.axes:
        first = int(np.searchsorted(axis.ticks, until))
        start = axis.start + int(axis.direction[:first].sum(dtype=np.int64))
        axes.append(
            replace(
                axis,
                ticks=axis.ticks[first:],
                direction=axis.direction[first:],
                start=start,
            )
        )
    return replace(every, axes=tuple(axes))
