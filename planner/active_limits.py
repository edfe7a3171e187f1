"""The limit that holds a plan's motion back at each time, the segment of the program, and both together."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.table import Column, Table
from planner.limits.limit import Limit, order_of
from planner.limits.lowered import Shares
from planner.path.arc_length import find_travel_rates
from planner.plan import Plan
from planner.program.model import Dwell, Segment
from planner.timing.profile import Profile, sample_limit_use
from planner.trajectory import Trajectory

ACTIVE_SHARE = 0.99
"""The share of a limit from which on it holds the motion back."""
FILE_LINE = "file line"
"""What a line of the program's file is called: a straight segment is a line too."""
NOT_LOWERED: Mapping[str, Shares] = MappingProxyType({})
"""Where all of each limit was planned with."""


def limit_shares(plan: Plan) -> dict[str, Array]:
    """(M,) the largest share of each limit that the motion is seen to use in each time piece.

    Of limits that do not depend on timing, the proven share. What is proved of the others is as close only where they
    are used most: elsewhere a bound need not be.
    """
    standing = {limit.name: plan.certificate.use[limit.name] for limit in plan.limits if limit.geometric}
    return standing | _sample(plan.trajectory, plan.limits)


def _sample(motion: Trajectory, limits: Sequence[Limit]) -> dict[str, Array]:
    profile = Profile(motion.s, motion.v, motion.a, motion.j, np.diff(motion.knots), motion.piece)
    return sample_limit_use(motion.path, limits, profile)


def active_limits(plan: Plan) -> np.ndarray:
    """(M,) for each time piece the index in `plan.limits` of the limit that holds the motion back; −1 where none does.

    Of those used by 99 % or more it is the one most used in the middle of the piece: a ramp at the largest acceleration
    ends at the largest speed. Geometric limits never do: they do not depend on timing. Of a limit that was lowered so
    that it holds behind input shapers, the share is that of what was planned with.
    """
    cost = None if plan.shaped is None else plan.shaped.cost
    return find_active(plan.trajectory, plan.limits, {} if cost is None else cost.lowered)[1]


def find_active(
    motion: Trajectory, limits: Sequence[Limit], lowered: Mapping[str, Shares] = NOT_LOWERED
) -> tuple[Array, np.ndarray]:
    """(limits, M) the largest share of each that is met in each time piece, 0 of geometric ones; which is active (M,).

    That one is an index in `limits`, as `active_limits` tells it of a plan. lowered: the shares of limits by name that
    were planned with, where these were less than all.
    """
    seen, middle = _sample(motion, limits), np.zeros((len(limits), len(motion.piece)))
    use = np.stack([np.zeros(len(motion.piece)) if limit.geometric else seen[limit.name] for limit in limits])
    state = motion.within(np.arange(len(motion.piece)), np.diff(motion.knots) / 2, jerk=order_of(limits) == 3)
    for n, limit in enumerate(limits):
        if limit.name in lowered:
            use[n] /= lowered[limit.name].at(state.along)
    for n, limit in enumerate(limits):
        if not limit.geometric:
            value = limit.value(state)
            middle[n] = largest_in_rows(limit.use(value, value, motion.piece))
    most = np.where(use >= ACTIVE_SHARE, middle, -1.0).argmax(0)
    return use, np.where(use.max(0) >= ACTIVE_SHARE, most, -1)


def find_segments(plan: Plan) -> list[tuple[int, int]]:
    """The time piece with which each segment begins, and its number in the program, from 1; dwells are segments too."""
    motion, program = plan.trajectory, plan.program.segments
    rests = (motion.v == 0) & (motion.a == 0) & (motion.j == 0) & (np.diff(motion.knots) > 0)
    begins = np.flatnonzero(np.diff(motion.piece, prepend=-1) | np.diff(rests, prepend=False))
    found: list[tuple[int, int]] = []
    for k in begins:
        number = motion.path.segment(int(motion.piece[k]))
        if number is None:
            continue
        after = 0 if k == 0 else number % len(program)  # what rests belongs to the piece before, or to the first
        number = after + 1 if rests[k] and isinstance(program[after], Dwell) else number
        if not found or found[-1][1] != number or k == begins[0]:
            found.append((int(k), number))
    return found


def name_segment(number: int, segment: Segment) -> str:
    """A segment by its number in the program, from 1, what it is, and the line of its file where that is known."""
    line = "" if segment.line_number is None else f", {FILE_LINE} {segment.line_number}"
    return f"segment {number} ({type(segment).__name__.lower()}){line}"


def tabulate_segments(plan: Plan) -> Table:
    """Each segment of the program, all its repetitions together, and the limit that is active longest in it.

    Its line is that of the file that was read. The length is the way that is travelled in its time, which blends and
    fitted curves make shorter than the programmed one; that of a turn is its angle times the characteristic length.
    """
    motion, segments = plan.trajectory, list(plan.program.segments)
    begins, numbers = zip(*find_segments(plan), strict=True)
    times = np.diff(motion.knots)
    ways = np.diff(np.append(motion.s, motion.path.breaks[-1])) * find_travel_rates(plan.path.pieces)[motion.piece]
    owner = np.repeat(numbers, np.diff((*begins, len(times)))) - 1
    taken, way = (np.bincount(owner, each, len(segments)) for each in (times, ways))
    held = np.zeros((len(segments), len(plan.limits) + 1))  # s for which each limit is active; last: for which none is
    np.add.at(held, (owner, active_limits(plan)), times)
    longest = held[:, :-1].argmax(1)
    rows = np.flatnonzero(taken > 0)
    share = held[rows, longest[rows]] / taken[rows]
    lines = [segments[k].line_number for k in rows]
    columns = (
        Column("segment", rows + 1),
        *([Column(FILE_LINE, lines)] if any(lines) else []),
        Column("kind", [type(segments[k]).__name__.lower() for k in rows]),
        Column("length", way[rows], "m", "human", ".3f"),
        Column("time", taken[rows], "s", form=".4f"),
        Column("mean speed", way[rows] / taken[rows], "m/s", "human", ".4g"),
        Column("held back by", [plan.limits[longest[k]].name if held[k, longest[k]] > 0 else None for k in rows]),
        Column("for", [100 * each if each > 0 else None for each in share.tolist()], "%", form=".0f"),
    )
    fitted = () if plan.path.fit is None else ("each part of a fitted curve counts as the segment beside it",)
    return Table("segments", columns, fitted)
