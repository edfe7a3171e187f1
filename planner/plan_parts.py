"""Plan a program of any length part by part, as it is read: the motion of each part, its proof and its pulses.

Each part comes with a stop. The parts up to any of them, together with its stop, are a certified motion that ends at
rest. The next part takes the place of that stop.
"""

from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from itertools import takewhile

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.avoidable_stops import AvoidableStops, find_stops_of_part
from planner.certificate.certify import Certificate
from planner.certificate.summary import join_certificates, summarise_part
from planner.limits import Limit, OwnLimit, limits_of
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS, PLACELESS
from planner.limits.resonance import Resonance
from planner.parallel import Progress, ignore_progress
from planner.path.actuation import MachinePath
from planner.path.chain import walk_path
from planner.path.join_and_blend import PathStep
from planner.path.outcome import FitSummary, fit_tables, merge_fits, summarise_fits
from planner.program.model import Dwell, Program, SegmentStream, Synchronised
from planner.program.program_file import ProgramSource, load_program
from planner.pulses import PulseSchedule, Rule, find_rule, pace_axes
from planner.pulses.generation.stream import PulseStream
from planner.pulses.schedule import schedule_tables
from planner.pulses.trigger_stream import Crossing, Mark, MarkedStep, count_crossings, find_crossings, mark_steps
from planner.pulses.triggers import Triggered
from planner.request import PIECES, PlanRequest, Requested
from planner.timing.certified_solve import timing_table
from planner.trajectory import Trajectory
from planner.windows import Helpers, Start, Window, WindowPlanner


@dataclass(frozen=True, slots=True)
class PlanStanding(Result, Requested):
    """A plan up to the end of one of its parts, with the fields of `Plan` that can be known there.

    request      what the caller asked for, with order, duration and objective filled in
    start        start of the next part: its time is the duration so far, its length that of the path
    segment      number of the last planned segment, from 1
    windows      number of windows
    certificate  of the whole motion; `use` and `attained` have one entry per window, or per several windows
    blends       joins that ask for a blend or a curve and have one; stops: joins where the motion stops instead
    pulses       the schedule so far, without its pulses
    counted      for each axis, its number of pulses, and its last count minus its first
    methods      solvers, with the number of runs of each
    triggers     number of triggers that the pulses have passed
    avoidable    stops at joins that do not ask for one, and an estimate of their cost
    """

    request: PlanRequest
    program: str
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
    avoidable: AvoidableStops | None = None

    @property
    def duration(self) -> float:
        """Duration (s) of the motion so far."""
        return self.start.begin

    def tables(self) -> tuple[Table, ...]:
        """Duration, proof, fit and pulses as tables."""
        title = f"{self.program} on {self.machine.name}, order {self.order}, in {count_noun(self.windows, 'window')}"
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
    motion         trajectory of the part, on the path of the window
    rest           trajectory of the stop, on the same path; None: the motion rests at the end of the part
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
    """Plan a program as it is read: the fastest motion, its proof and its pulses, in constant memory.

    The motion takes up to 0.1 % longer than if the whole were planned at once, as each window looks ahead only as far
    as it reaches (`planner.windows`).

    Parameters
    ----------
    program, machine, order, clock_hz, rule, limits
        As of `plan`.
    pieces
        Pieces of path in the first window.
    helpers
        Other processes that solve windows; None: no others.
    progress
        Called with the number of segments read so far, and their number in all repetitions.

    Raises
    ------
    MotionError
        The program can only be planned as a whole; or as `plan`, after the parts before the refusal.
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
    rule, clock_hz = request.rule, request.clock_hz
    rule = find_rule(rule) if isinstance(rule, str) else rule
    if (reason := find_whole_reason(program, machine, rule)) is not None:
        job = f"program {program.name} on {machine.name}"
        raise MotionError(f"{job} is planned as a whole only, because {reason}, or call plan")
    request = request.resolve(program, machine)
    order = request.resolved_order
    paced = pace_axes(machine.axes, clock_hz, rule)
    find_limits = partial(limits_of, axes=paced, order=order, own=request.limits)
    copying = not request.limits and {*AXIS_LIMITS, *MACHINE_LIMITS} <= PLACELESS
    planner = WindowPlanner(
        machine,
        find_limits,
        order,
        program.tool,
        request.pieces,
        copying=copying,
    )
    steps = _Steps(
        mark_steps(walk_path(program, machine), program, machine), len(program.segments), program.repeat, progress
    )
    stream = PulseStream(machine, clock_hz, rule)
    standing: PlanStanding | None = None
    waiting: tuple[Crossing, ...] = ()  # triggers that the motion has passed, but not its pulses
    for window in planner(steps, helpers):
        before, stream = stream, stream.copy()
        motion = window.solution.trajectory
        kept, rest = motion.cut(0, window.kept), None
        # The motion ends with a window only if that has the last step; else it continues, possibly from rest.
        last = window.kept == len(motion.s) and steps.ended and window.next.steps == steps.taken
        pulses, rest_pulses, rest_proof = stream.add(kept, last), None, None
        if window.kept < len(motion.s):
            rest = motion.cut(window.kept, len(motion.s))
            rest_pulses = stream.copy().add(rest, last=True)
            rest_proof = summarise_part(
                window.solution.certificate, motion, window.solution.limits, slice(window.kept, len(motion.s))
            )
        elif not last:
            rest_pulses = _end_pulses(before, kept, stream.until)
        ahead = find_crossings(motion, window.start.steps, steps.find_marks(window.start.steps + window.steps))
        passed = len(steps.pop_marks(window.next.steps))
        triggers, waiting = count_crossings((*waiting, *ahead[:passed]), pulses, None if last else stream.until)
        rest_triggers = count_crossings((*waiting, *ahead[passed:]), rest_pulses or pulses, None)[0]
        standing = _add_window(standing, request, program, machine, window, kept, steps, pulses, len(triggers))
        yield PlanPart(
            window.start,
            window.steps,
            kept,
            rest,
            pulses,
            rest_pulses,
            stream.until,
            window.solution.limits,
            rest_proof,
            triggers,
            rest_triggers,
            standing,
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
        start = Start(start.elapsed + Fraction(part.rest.duration), length, part.start.steps + part.steps)
    stated = _without_pulses(pulses, standing.pulses)
    triggers = standing.triggers + len(part.rest_triggers)
    return replace(
        standing, start=start, segment=segment, certificate=proof, pulses=stated, counted=counted, triggers=triggers
    )


def _without_pulses(pulses: PulseSchedule, first: PulseSchedule) -> PulseSchedule:
    """Return a schedule without its pulses, with the start counts of the first part."""
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    axes = zip(pulses.axes, first.axes, strict=True)
    bare = tuple(replace(axis, ticks=none[0], direction=none[1], start=one.start) for axis, one in axes)
    return replace(pulses, axes=bare)


def find_whole_reason(program: Program, machine: Machine, rule: Rule) -> str | None:
    """Return why a program can only be planned as a whole, with a remedy; None if it can be planned in parts."""
    if rule.whole_reason:
        return f"rule {rule.name} needs the whole motion, as {rule.whole_reason}: choose rule nearest"
    if program.duration is not None:
        return "it states a duration, which is that of the whole: omit the duration"
    if program.start_speed or program.end_speed:
        return "it begins or ends in motion: let it begin and end at rest"
    if Resonance(machine.axes).bands:
        return "the machine may cross bands of resonance, proved of the whole only: take resonance_time out of its file"
    if any(axis.compensate for axis in machine.axes):
        return "the machine makes up for play or lead error, which looks ahead: take compensate out of its file"
    if any(axis.shaper for axis in machine.axes):
        return "the machine has input shapers, which reach from each part into the next: take them out of its file"
    if isinstance(program.segments, SegmentStream):
        return None
    for number, segment in enumerate(program.segments, 1):
        if isinstance(segment, Dwell):
            continue
        for is_whole, reason in (
            (isinstance(segment, Synchronised), "is a synchronised move"),
            (getattr(segment, "speed_constant", False), "asks for a constant speed"),
            (getattr(segment, "free", None) is not None, "leaves orientation free"),
        ):
            if is_whole:
                return f"segment {number} {reason}: plan that segment by itself"
    return None


class _Steps:
    """The steps of a path in order, and the joins, chains and triggers that are still to be planned."""

    def __init__(self, steps: Iterator[MarkedStep], segments: int, repeat: int, progress: Progress) -> None:
        """segments: of the program, which runs `repeat` times. progress: called with those read, and with all."""
        self._segments, self._total, self._tell = segments, repeat * segments, progress
        self._steps = steps
        self._joins = deque[tuple[int, PathStep]]()
        self._marks = deque[Mark]()
        self._next = next(steps, None)
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
            self._tell(((step.piece.repetition or 1) - 1) * self._segments + step.piece.segment, self._total)
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


def _add_window(
    before: PlanStanding | None,
    request: PlanRequest,
    program: Program,
    machine: Machine,
    window: Window,
    kept: Trajectory,
    steps: _Steps,
    pulses: PulseSchedule,
    triggers: int,
) -> PlanStanding:
    """Return the standing of a plan after a window."""
    solution, joins, order = window.solution, steps.pop(window.next.steps), window.solution.order
    blends = [step.blend for step in joins if step.blend is not None]
    fit = summarise_fits([step.fitted for step in joins if step.fitted is not None], blends)
    segment = kept.path.place(0.0, int(kept.piece[-1])).segment or 0
    proved = summarise_part(solution.certificate, solution.trajectory, solution.limits, slice(0, window.kept))
    counted = [(len(axis), axis.final - axis.start) for axis in pulses.axes]
    stops = sum(bool(blend.stop) for blend in blends)
    unasked = sum(step.avoidable and step.stop <= order for step in joins)
    path, limits = solution.trajectory.path, solution.limits
    assert isinstance(path, MachinePath)
    avoidable = find_stops_of_part(program, path, limits, order, int(kept.piece[-1]) + 1, unasked)
    here = PlanStanding(
        request,
        program.name,
        machine,
        window.next,
        segment,
        1,
        proved,
        fit,
        len(blends),
        stops,
        _without_pulses(pulses, pulses if before is None else before.pulses),
        tuple(counted),
        solution.rounds,
        Counter(solution.methods),
        triggers,
        avoidable,
    )
    if before is None:
        return here
    return replace(
        here,
        windows=before.windows + 1,
        certificate=join_certificates(before.certificate, proved),
        fit=merge_fits(before.fit, fit),
        blends=before.blends + here.blends,
        stops=before.stops + stops,
        counted=tuple((n + m, a + b) for (n, a), (m, b) in zip(before.counted, counted, strict=True)),
        rounds=max(before.rounds, here.rounds),
        methods=Counter(before.methods) + Counter(here.methods),
        triggers=before.triggers + triggers,
        avoidable=avoidable if before.avoidable is None else before.avoidable + avoidable,
    )
