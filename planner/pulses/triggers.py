"""Triggers: when a motion comes by the positions that its program marks, and what every axis has
counted by then.
"""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.table import Column, Table
from kinematics.machine.pose import Pose
from planner.path.actuation import MachinePath, make_points
from planner.path.arc_length import measure_length
from planner.place import Place
from planner.program.model import MIN_MOVE, Dwell, Program, SegmentStream
from planner.program.modifiers import Trigger
from planner.pulses import PulseSchedule
from planner.trajectory import Trajectory

# Halvings of an interval of time after which nothing of it is left to floats.
BISECTIONS_OF_TIME = 64


@dataclass(frozen=True, slots=True)
class Triggered:
    """A trigger's name, place (segment, repetition, s and t), platform pose and axis counts (n,).

    At a rest the time is that of the arrival; or so many s before the motion goes on, or rests for
    good.
    """

    name: str
    where: Place
    pose: Pose
    counts: np.ndarray
    before: float | None = None

    @property
    def time(self) -> float:
        """s from the start of the motion."""
        assert self.where.t is not None  # every trigger has one
        return self.where.t


class ListedTrigger(NamedTuple):
    """A trigger of a segment of a program, by its number from 1, in one of its repetitions.

    before  s before the motion goes on from a rest there; None: on arrival, or in motion
    rests   whether the segment is a dwell
    """

    repetition: int
    number: int
    event: Trigger
    before: float | None = None
    rests: bool = False


def list_triggers(program: Program) -> Iterator[ListedTrigger]:
    """The triggers of a program, in the order of its segments, repetition after repetition."""
    if isinstance(program.segments, SegmentStream) and not program.segments.marked:
        return
    waiting: list[ListedTrigger] = []  # of dwells, behind which no segment has moved yet
    for repetition in range(1, program.repeat + 1):
        for number, segment in enumerate(program.segments, 1):
            if isinstance(segment, Dwell):
                waiting = [
                    one._replace(before=(one.before or 0.0) + segment.duration) for one in waiting
                ]
                if segment.trigger is not None:
                    left = (1 - segment.trigger.at) * segment.duration
                    waiting.append(
                        ListedTrigger(repetition, number, segment.trigger, left, rests=True)
                    )
                continue
            yield from waiting
            waiting = []
            if segment.trigger is not None:
                before = 0.0 if segment.trigger.after_rest else None
                yield ListedTrigger(repetition, number, segment.trigger, before)
    yield from waiting


def holds_triggers(program: Program) -> bool:
    """Whether any segment of a program has one."""
    return next(list_triggers(program), None) is not None


def trigger_tables(events: "Sequence[Triggered]", axes: Sequence[str]) -> tuple[Table, ...]:
    """When and where each event is, and the counts of the axes by then; no table where there is
    none.
    """
    if not events:
        return ()
    counts = (
        Column(f"count {name}", [int(event.counts[k]) for event in events])
        for k, name in enumerate(axes)
    )
    name, time = Column("name", [event.name for event in events]), [event.time for event in events]
    where = (
        column for column in Place.columns([event.where for event in events]) if column.name != "t"
    )
    return (Table("triggers", (name, *where, Column("t", time, "s", form=".7f"), *counts)),)


def find_triggers(
    program: Program,
    path: MachinePath,
    trajectory: Trajectory,
    pulses: PulseSchedule,
    delay: float = 0.0,
    length: float = 0.0,
) -> tuple[Triggered, ...]:
    """Every trigger of a program, in the order of its segments, repetition after repetition.

    delay, length: s, by which the pulses are behind the trajectory in motion, and before they rest
    where it does, as input shapers put them
    """
    own = [
        (path.pieces[first].repetition or 1, path.segment(first), first, last)
        for first, last in _segments(path)
    ]
    whose, found = {(repetition, number): pieces for repetition, number, *pieces in own}, []
    keys = [*whose]
    end = float(path.breaks[-1])
    for repetition, number, event, before, rests in list_triggers(program):
        if rests:  # before the next segment that moves
            k = bisect_right(keys, (repetition, number))
            s, first = (
                (float(path.breaks[own[k][2]]), own[k][2])
                if k < len(own)
                else (end, len(path.pieces) - 1)
            )
        elif (repetition, number) in whose:
            first, last = whose[repetition, number]
            s = place_share(path, first, last, event.at)
        else:
            continue
        t, late = find_passing(trajectory, s, delay, length, before, last=s == end)
        state, counts = trajectory.at(t), pulses.counts(np.array([t + late]))[0]
        assert state.pose is not None  # a machine's path has one
        where = replace(path.place(s, first, t + late), segment=number)
        if program.repeat > 1:
            where = replace(where, repetition=repetition)
        found.append(
            Triggered(event.name, where, state.pose[0], freeze_array(counts, np.int64), before)
        )
    return tuple(found)


def find_passing(
    trajectory: Trajectory,
    s: float,
    delay: float,
    length: float,
    before: float | None,
    *,
    last: bool = False,
) -> tuple[float, float]:
    """When a motion comes by path length s, and by how much later its pulses do (s); as
    `find_triggers` has it.

    before: so many s before it goes on from there, or with `last` before the end of its rest for
    good; behind shapers, once all has come to rest, as it begins to.
    """
    t = arrival_time(trajectory, s)
    if before is not None:
        left = departure_time(trajectory, s)
        left = trajectory.duration if last and left == np.inf else left
        moment = max(left - before, t)
        return moment, 0.0 if length and (left == 0 or moment - t >= length) else delay
    return t, length if length and _find_rest(trajectory, t) >= length else delay


def _find_rest(trajectory: Trajectory, t: float) -> float:
    """s for which a motion rests from t on; ∞ at its end."""
    if t >= trajectory.duration:
        return np.inf
    k = int(trajectory.locate(np.array([t]))[0])
    moving = np.flatnonzero(
        (trajectory.v[k:] != 0) | (trajectory.a[k:] != 0) | (trajectory.j[k:] != 0)
    )
    return float(trajectory.knots[k + moving[0]]) - t if len(moving) else np.inf


def place_share(path: MachinePath, first: int, last: int, share: float) -> float:
    """s at which a share of the tool's way on pieces first … last is made; of the angle, where they
    only turn it.
    """
    low, high = float(path.breaks[first]), float(path.breaks[last + 1])
    ways = [
        measure_length(
            partial(_tool_speed, path, piece),
            float(path.breaks[piece]),
            float(path.breaks[piece + 1]),
        )
        for piece in (range(first, last + 1) if 0 < share < 1 else ())
    ]
    done = np.cumsum([0.0, *(each.length for each in ways)])
    if done[-1] <= MIN_MOVE:
        return high if share == 1 else low + share * (high - low)
    k = int(np.clip(np.searchsorted(done, share * done[-1], side="right") - 1, 0, len(ways) - 1))
    return float(ways[k].place(np.array([share * done[-1] - done[k]]))[0])


def _tool_speed(path: MachinePath, piece: int, s: Array) -> Array:
    """|dp/ds| (N,) of the tool on a piece."""
    along = make_points(path, s, np.full(len(s), piece)).tool_derivatives[1]
    return np.asarray(np.linalg.norm(along[:, :3], axis=1))


def arrival_time(trajectory: Trajectory, s: float) -> float:
    """The first time (s) at which the motion is at path length s, to rounding: s(t) never falls."""
    breaks = trajectory.path.breaks
    piece = int(np.searchsorted(breaks, s, side="left")) - 1
    if piece < 0:
        return 0.0
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    there = np.flatnonzero(moving & (trajectory.piece == piece))
    if s == breaks[piece + 1]:  # exactly its end, whatever rounding says of s there
        return float(trajectory.knots[there[-1] + 1])
    k = int(there[max(int(np.searchsorted(trajectory.s[there], s, side="right")) - 1, 0)])
    low, high = 0.0, float(trajectory.knots[k + 1] - trajectory.knots[k])
    for _ in range(BISECTIONS_OF_TIME):
        middle = (low + high) / 2
        low, high = (middle, high) if _path_length_at(trajectory, k, middle) < s else (low, middle)
    return float(trajectory.knots[k]) + high


def departure_time(trajectory: Trajectory, s: float) -> float:
    """The last time (s) at which the motion is at the start s of a piece of path; ∞ where it ends
    there.
    """
    moving = (trajectory.v != 0) | (trajectory.a != 0) | (trajectory.j != 0)
    piece = int(np.searchsorted(trajectory.path.breaks, s, side="right")) - 1
    after = np.flatnonzero(moving & (trajectory.piece >= piece))
    return float(trajectory.knots[after[0]]) if len(after) else np.inf


def _path_length_at(trajectory: Trajectory, k: int, tau: float) -> float:
    s, v, a, j = (
        float(values[k]) for values in (trajectory.s, trajectory.v, trajectory.a, trajectory.j)
    )
    return s + tau * (v + tau * (a / 2 + tau * j / 6))


def _segments(path: MachinePath) -> list[tuple[int, int]]:
    """First and last piece of every segment of every repetition."""
    whose = np.array([(piece.segment, piece.repetition or 1) for piece in path.pieces])
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(whose, axis=0) != 0).any(1)]))
    return list(zip(starts.tolist(), [*(starts[1:] - 1).tolist(), len(whose) - 1], strict=True))
