"""Triggers of a motion that comes in parts: each is given with the part whose pulses settle its
counts.

Where they are on the path is known from its steps alone, before any of it is timed: a segment that
ends in one part may have its trigger in the part before.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.errors import MotionError, attempt, take_items
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose, from_numbers
from planner.path.actuation import MachinePath
from planner.path.join_and_blend import ALWAYS_REST, PathStep
from planner.place import Place
from planner.program.model import Program
from planner.program.modifiers import Trigger
from planner.pulses.schedule import PulseSchedule
from planner.pulses.triggers import (
    ListedTrigger,
    Triggered,
    find_passing,
    holds_triggers,
    list_triggers,
    place_share,
)
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Mark:
    """A trigger on the steps of a path: so many m along one of them, from 1; None: at its end, for
    0 where all begins.

    segment, repetition  whose it is; repetition None: the program runs once
    before               s before the motion goes on along that step from a rest; None: on arrival
    last                 nothing moves behind it: before the rest for good ends
    """

    name: str
    step: int
    along: float | None
    segment: int
    repetition: int | None
    before: float | None = None
    last: bool = False


@dataclass(frozen=True, slots=True)
class Crossing:
    """A trigger that the motion passes, whose counts are not known yet."""

    name: str
    where: Place
    pose: Pose


MarkedStep = tuple[PathStep, tuple[Mark, ...]]


def mark_steps(
    steps: Iterator[PathStep], program: Program, machine: Machine
) -> Iterator[MarkedStep]:
    """The steps of a program's path, each with the triggers on it; those at the start of a step are
    on the one before.

    They are read a segment ahead, in programs with triggers. Raises as the steps do, behind the
    same ones.
    """
    if not holds_triggers(program):
        yield from ((step, ()) for step in steps)
        return
    events, done, own = _Events(program), 0, list[PathStep]()
    event, resting = None, list[Mark]()  # those of dwells are where the next step begins
    while True:
        more, steps = take_items(steps, 1)
        if own and not (more and _whose(more[0]) == _whose(own[0])):
            marks = [
                *resting,
                *([] if event is None else _place_marks(own, done, event, program, machine)),
            ]
            done += len(own)
            event, rests = events.find(more[0] if more else None)
            resting = [_mark_rest(one, done, program.repeat, last=not more) for one in rests]
            if event is not None and event.at == 0 and not event.after_rest:
                marks.append(_mark(event, more[0], done, None))
            yield from _distribute(own, done - len(own), marks if more else [*marks, *resting])
            own = []
        elif not own and more:
            event, rests = events.find(more[0])
            resting = [_mark_rest(one, done, program.repeat, last=False) for one in rests]
        if not more:
            yield from ((step, ()) for step in steps)  # none, or a refusal
            return
        own += more


class _Events:
    """The triggers of a program, asked for in the order of its path."""

    def __init__(self, program: Program) -> None:
        self._coming = list_triggers(program)
        self._next = next(self._coming, None)

    def find(self, step: PathStep | None) -> tuple[Trigger | None, list[ListedTrigger]]:
        """That of the segment to which a step belongs, and those of dwells before it; None: behind
        the last step.
        """
        here, rests = None if step is None else _whose(step), list[ListedTrigger]()
        while self._next is not None and (here is None or self._next[:2] < here):
            rests += [self._next] if self._next.rests else []
            self._next = next(self._coming, None)
        return self._next.event if self._next is not None and self._next[
            :2
        ] == here else None, rests


def _whose(step: PathStep) -> tuple[int, int]:
    return step.piece.repetition or 1, step.piece.segment


def _mark(event: Trigger, step: PathStep, number: int, along: float | None) -> Mark:
    return Mark(event.name, number, along, step.piece.segment, step.piece.repetition)


def _mark_rest(one: ListedTrigger, done: int, repeat: int, *, last: bool) -> Mark:
    """A dwell's, behind so many steps."""
    step, along = (done, None) if last else (done + 1, 0.0)
    repetition = one.repetition if repeat > 1 else None
    return Mark(one.event.name, step, along, one.number, repetition, one.before, last)


def _place_marks(
    own: Sequence[PathStep], done: int, event: Trigger, program: Program, machine: Machine
) -> list[Mark]:
    """The trigger of a segment whose steps these are, behind others: none that is at its start, but
    of the first.
    """
    if event.after_rest:
        return [replace(_mark(event, own[0], done + 1, 0.0), before=0.0)]
    if event.at == 0:
        return [] if done else [_mark(event, own[0], 0, None)]
    if event.at == 1:
        return [_mark(event, own[-1], done + len(own), None)]
    rests = np.array([ALWAYS_REST, *(0 for _ in own[:-1]), ALWAYS_REST])
    path = attempt(
        lambda: MachinePath(
            machine, [step.piece for step in own], rests, np.zeros(len(rests)), tool=program.tool
        )
    )
    if isinstance(path, MotionError):
        return []  # as will planning of these steps
    s = place_share(path, 0, len(path.pieces) - 1, event.at)
    ends = path.breaks[path.ends]
    k = max(1, int(np.searchsorted(ends, s, side="left")))
    along = None if s == ends[k] else s - float(ends[k - 1])
    return [_mark(event, own[0], done + k, along)]


def _distribute(own: Sequence[PathStep], done: int, marks: Sequence[Mark]) -> Iterator[MarkedStep]:
    for number, step in enumerate(own, done + 1):
        yield step, tuple(mark for mark in marks if max(1, mark.step) == number)


def find_crossings(motion: Trajectory, begun: int, marks: Sequence[Mark]) -> tuple[Crossing, ...]:
    """When a motion comes by marks on its own steps, which follow so many others, and where it is
    then.
    """
    path = motion.path
    if not marks:
        return ()
    assert isinstance(path, MachinePath)  # as every plan's
    ends = path.breaks[path.ends]
    along = [float(ends[mark.step - begun]) for mark in marks]
    for n, mark in enumerate(marks):
        if mark.along is not None:
            along[n] = min(float(ends[mark.step - begun - 1]) + mark.along, along[n])
    t = [
        find_passing(motion, s, 0.0, 0.0, mark.before, last=mark.last)[0]
        for mark, s in zip(marks, along, strict=True)
    ]
    state = motion.at(np.array(t))
    poses = from_numbers(path.pose_numbers(state.along, state.piece))
    crossings = []
    for n, (mark, s) in enumerate(zip(marks, along, strict=True)):
        place = replace(path.place(s, 0, t[n]), segment=mark.segment, repetition=mark.repetition)
        crossings.append(Crossing(mark.name, place, poses[n]))
    return tuple(crossings)


def count_crossings(
    crossings: Sequence[Crossing], pulses: PulseSchedule, until: int | None
) -> tuple[tuple[Triggered, ...], tuple[Crossing, ...]]:
    """Those before a tick with their counts, and those that wait for the pulses behind it; None:
    all have counts.
    """
    if not crossings:
        return (), ()
    t = np.array([crossing.where.t for crossing in crossings], float)
    known = np.full(len(t), True) if until is None else pulses.find_ticks(t) < until
    counts = pulses.counts(t)
    given = tuple(
        Triggered(crossing.name, crossing.where, crossing.pose, freeze_array(counts[n], np.int64))
        for n, crossing in enumerate(crossings)
        if known[n]
    )
    return given, tuple(crossing for n, crossing in enumerate(crossings) if not known[n])
