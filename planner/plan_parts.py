"""A plan of a program of any length, part by part as it is read: what stays of each window of it, proved, its pulses.

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
from planner.limits import Limit, OwnLimit, limits_of, usual_order
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
from planner.timing.certified_solve import timing_table
from planner.trajectory import Trajectory
from planner.windows import PIECES, Helpers, Start, Window, WindowPlanner

MOST_WHOLE = 1000
"""Segments up to which a program is planned as a whole, unless something else is asked for."""


@dataclass(frozen=True, slots=True)
class PlanStanding(Result):
    """What is known of a plan up to the end of some part of it, as `Plan` has it of a whole one.

    start        how the next part begins: its time is the duration so far, its length that of the path
    segment      number of the last one that is planned, from 1
    windows      how many it was planned in
    certificate  over all of it; of `use` and `attained` one entry for each window, or for a few where there are many
    blends, stops  joins that ask for a blend or a curve: where one is, and where the motion stops instead
    pulses       what is stated of the axes' pulses, without these
    counted      of each axis how many pulses it has, and where they lead: its count behind the last less that at first
    methods      solvers of the runs, with how many each
    triggers     how many of the program's triggers its pulses have come by
    avoidable    the stops at joins that nobody asked for, and an estimate of their cost
    """

    program: str
    machine: Machine
    order: int
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
        """s, of the motion so far."""
        return self.start.begin

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, what is proved of it, what was fitted, its pulses."""
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
    """What stays of a window of a plan, and how the motion comes to rest behind it where nothing follows.

    start, steps  how its window begins, and how many steps of the path that has
    motion, rest  trajectories on the window's path; rest None: the motion rests at the end of the part
    pulses        those of the part that are final; rest_pulses: the others, and those of the rest
    until         tick before which all pulses are given
    limits        of the window
    rest_proof    of the way to rest
    triggers      those that the pulses of the part come by; rest_triggers: likewise
    standing      of the plan up to the end of the part
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
    """Plan a program as it is read: the fastest motion, proved, and its pulses, in memory that does not grow with it.

    What a part's motion costs beside that of the whole planned at once is what it looks ahead too little: below 0.1 %
    (`planner.windows`).

    Parameters
    ----------
    program, machine, order, clock_hz, rule, limits
        As of `plan`.
    pieces
        Of path that a window has at first.
    helpers
        Processes that solve windows beside this one; None: none.
    progress
        Is told how many segments have been read ahead for the next window, of how many in all repetitions.

    Raises
    ------
    MotionError
        What can only be planned as a whole; and as `plan` does, when the parts before have been given.
    """
    program, machine = load_program(program), load_machine(machine)
    rule = find_rule(rule) if isinstance(rule, str) else rule
    if (why := find_whole_reason(program, machine, rule)) is not None:
        of = f"program {program.name} on {machine.name}"
        raise MotionError(f"{of} is planned as a whole only, because {why}, or call plan")
    order = usual_order(machine.axes, program) if order is None else order
    paced = pace_axes(machine.axes, clock_hz, rule)
    find_limits = partial(limits_of, axes=paced, order=order, own=limits)
    planner = WindowPlanner(machine, find_limits, order, program.tool, pieces)
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
        # the motion ends with a window only where that has the last of the path; else it goes on, be it from rest
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
        standing = _add_window(standing, program, machine, order, window, kept, steps, pulses, len(triggers))
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
    """The standing of a plan that ends with the stop behind a part."""
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
    """What is stated of pulses, from their first count."""
    none = np.empty(0, np.int64), np.empty(0, np.int8)
    axes = zip(pulses.axes, first.axes, strict=True)
    bare = tuple(replace(axis, ticks=none[0], direction=none[1], start=held.start) for axis, held in axes)
    return replace(pulses, axes=bare)


def find_whole_reason(program: Program, machine: Machine, rule: Rule) -> str | None:
    """Why a program can only be planned as a whole, and what to change about that; None where it can be in parts."""
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
        for held, what in (
            (isinstance(segment, Synchronised), "is a synchronised move"),
            (getattr(segment, "speed_constant", False), "asks for a constant speed"),
            (getattr(segment, "free", None) is not None, "leaves orientation free"),
        ):
            if held:
                return f"segment {number} {what}: plan that segment by itself"
    return None


class _Steps:
    """The steps of a path as they are taken, with what became of joins and chains, and triggers, held until planned."""

    def __init__(self, steps: Iterator[MarkedStep], segments: int, repeat: int, progress: Progress) -> None:
        """segments: of the program, which is run so often; progress: is told how many are read, and of how many."""
        self._segments, self._total, self._tell = segments, repeat * segments, progress
        self._steps, self._held, self._marks = steps, deque[tuple[int, PathStep]](), deque[Mark]()
        self._next = next(steps, None)
        self.taken = 0

    @property
    def ended(self) -> bool:
        """Whether all are taken."""
        return self._next is None

    def __iter__(self) -> Iterator[PathStep]:
        while self._next is not None:
            step, marks = self._next
            self._next = next(self._steps, None)
            self.taken += 1
            self._marks.extend(marks)
            self._tell(((step.piece.repetition or 1) - 1) * self._segments + step.piece.segment, self._total)
            if step.blend is not None or step.fitted is not None or step.avoidable:
                self._held.append((self.taken, step))
            yield step

    def pop(self, until: int) -> list[PathStep]:
        """Those that became something, up to a number of steps from the first."""
        found: list[PathStep] = []
        while self._held and self._held[0][0] <= until:
            found.append(self._held.popleft()[1])
        return found

    def find_marks(self, until: int) -> list[Mark]:
        """The triggers up to a number of steps from the first."""
        return [*takewhile(lambda mark: mark.step <= until, self._marks)]

    def pop_marks(self, until: int) -> list[Mark]:
        """The same, which are planned then."""
        found = self.find_marks(until)
        for _ in found:
            self._marks.popleft()
        return found


def _end_pulses(before: PulseStream, motion: Trajectory, until: int) -> PulseSchedule:
    """What a stream holds back of a part from a tick on, as if the motion ended with it."""
    every = before.copy().add(motion, last=True)
    held = []
    for axis in every.axes:
        given = int(np.searchsorted(axis.ticks, until))
        start = axis.start + int(axis.direction[:given].sum(dtype=np.int64))
        held.append(replace(axis, ticks=axis.ticks[given:], direction=axis.direction[given:], start=start))
    return replace(every, axes=tuple(held))


def _add_window(
    before: PlanStanding | None,
    program: Program,
    machine: Machine,
    order: int,
    window: Window,
    kept: Trajectory,
    steps: _Steps,
    pulses: PulseSchedule,
    triggers: int,
) -> PlanStanding:
    """What is known behind a window."""
    solution, became = window.solution, steps.pop(window.next.steps)
    blends = [step.blend for step in became if step.blend is not None]
    fit = summarise_fits([step.fitted for step in became if step.fitted is not None], blends)
    segment = kept.path.place(0.0, int(kept.piece[-1])).segment or 0
    proved = summarise_part(solution.certificate, solution.trajectory, solution.limits, slice(0, window.kept))
    counted = [(len(axis), axis.final - axis.start) for axis in pulses.axes]
    stops = sum(bool(blend.stop) for blend in blends)
    unasked = sum(step.avoidable and step.stop <= order for step in became)
    path, limits = solution.trajectory.path, solution.limits
    assert isinstance(path, MachinePath)
    avoidable = find_stops_of_part(program, path, limits, order, int(kept.piece[-1]) + 1, unasked)
    found = PlanStanding(
        program.name,
        machine,
        order,
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
        return found
    return replace(
        found,
        windows=before.windows + 1,
        certificate=join_certificates(before.certificate, proved),
        fit=merge_fits(before.fit, fit),
        blends=before.blends + found.blends,
        stops=before.stops + stops,
        counted=tuple((n + m, a + b) for (n, a), (m, b) in zip(before.counted, counted, strict=True)),
        rounds=max(before.rounds, found.rounds),
        methods=Counter(before.methods) + Counter(found.methods),
        triggers=before.triggers + triggers,
        avoidable=avoidable if before.avoidable is None else before.avoidable + avoidable,
    )
