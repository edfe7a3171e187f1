"""The active limit of a plan at each time, the segment of the program, and a table of both."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from kinematics.foundation.table import Column, Table
from planner.limits.limit import Limit, order_of
from planner.limits.lowered import Shares
from planner.path.actuation import MachinePath
from planner.path.arc_length import find_travel_rates
from planner.plan import Plan
from planner.program.model import Dwell, Segment
from planner.timing.profile import Profile
from planner.timing.sampling import sample_limit_use
from planner.trajectory import Trajectory

ACTIVE_SHARE = 0.99
"""Share of a limit above which it is active. Below it, solver tolerances hide active limits."""
FILE_LINE = "file line"
"""Name of a line of the program's file: a straight segment is a line too."""
NUMBER, TIME, WAY, IDLE = range(4)
"""Columns of a measured segment: its number, s, m, and s without active limit; those of limits
follow.
"""
NOT_LOWERED: Mapping[str, Shares] = MappingProxyType({})
"""Shares for a plan that used each limit in full."""


def limit_shares(plan: Plan) -> dict[str, Array]:
    """Return the largest sampled share (M,) of each limit in each time piece.

    For limits that do not depend on timing it is the proven share. The proven shares of the others
    are close bounds only where these limits are used most.
    """
    use = plan.certificate.use
    geometric = {limit.name: use[limit.name] for limit in plan.limits if limit.geometric}
    return geometric | _sample(plan.trajectory, plan.limits)


def _sample(motion: Trajectory, limits: Sequence[Limit]) -> dict[str, Array]:
    profile = Profile(motion.s, motion.v, motion.a, motion.j, np.diff(motion.knots), motion.piece)
    return sample_limit_use(motion.path, limits, profile)


def active_limits(plan: Plan) -> np.ndarray:
    """Return for each time piece (M,) the index in `plan.limits` of its active limit; −1: none.

    Of the limits used by 99 % or more, the active one is used most in the middle of the piece: a
    ramp at the largest acceleration ends at the largest speed. Geometric limits are never active,
    as they do not depend on timing. For a limit that was lowered so that it holds after shaping,
    the share refers to the lowered limit.
    """
    cost = None if plan.shaped is None else plan.shaped.cost
    return find_active(plan.trajectory, plan.limits, {} if cost is None else cost.lowered)[1]


def find_active(
    motion: Trajectory, limits: Sequence[Limit], lowered: Mapping[str, Shares] = NOT_LOWERED
) -> tuple[Array, np.ndarray]:
    """Return the sampled share of each limit in each time piece (limits, M), and the active one.

    Geometric limits have share 0. The active limit is an index in `limits`, as in `active_limits`.
    lowered: by name, the shares of limits that the plan used, if lower than 1.
    """
    count = len(motion.piece)
    use = np.zeros((len(limits), count))
    middle = np.zeros((len(limits), count))
    shares = _sample(motion, limits)
    half = np.diff(motion.knots) / 2
    state = motion.within(np.arange(count), half, jerk=order_of(limits) == 3)
    for n, limit in enumerate(limits):
        if limit.geometric:
            continue
        use[n] = shares[limit.name]
        if limit.name in lowered:
            use[n] /= lowered[limit.name].at(state.along)
        value = limit.value(state)
        middle[n] = largest_in_rows(limit.use(value, value, motion.piece))
    most = np.where(use >= ACTIVE_SHARE, middle, -1.0).argmax(0)
    return use, np.where(use.max(0) >= ACTIVE_SHARE, most, -1)


def find_segments(plan: Plan) -> list[tuple[int, int]]:
    """List the first time piece of each segment, and its number in the program, from 1.

    Dwells are segments too.
    """
    motion = plan.trajectory
    program = plan.program.segments
    rests = motion.resting & (np.diff(motion.knots) > 0)
    begins = np.flatnonzero(np.diff(motion.piece, prepend=-1) | np.diff(rests, prepend=False))
    segments: list[tuple[int, int]] = []
    for k in begins:
        number = motion.path.segment(int(motion.piece[k]))
        if number is None:
            continue
        # a rest lies on the path piece of the segment before it; one at the start, on the first
        after = 0 if k == 0 else number % len(program)
        if rests[k] and isinstance(program[after], Dwell):
            number = after + 1
        if not segments or segments[-1][1] != number:
            segments.append((int(k), number))
    return segments


def name_segment(number: int, segment: Segment) -> str:
    """Name a segment by its number in the program (from 1), its kind and any line of its file."""
    line = "" if segment.line_number is None else f", {FILE_LINE} {segment.line_number}"
    return f"segment {number} ({name_kind(segment)}){line}"


def tabulate_segments(plan: Plan) -> Table:
    """Tabulate each segment of the program, over all repetitions, and its longest active limit.

    Its line is that of the file that was read. Its length is the distance travelled in its time,
    which blends and fitted curves make shorter than the programmed one. The length of a turn is its
    angle times the characteristic length.
    """
    motion = plan.trajectory
    first, numbers = zip(*find_segments(plan), strict=True)
    owner = np.repeat(numbers, np.diff((*first, len(motion.piece))))
    ways = np.diff(motion.s, append=plan.path.breaks[-1])
    rows = measure_segments(motion, ways, owner, active_limits(plan), len(plan.limits))
    measured = rows[:, NUMBER].astype(int)
    program = list(plan.program.segments)
    segments = [program[number - 1] for number in measured]
    names = [limit.name for limit in plan.limits]
    columns = (Column("segment", measured), *segment_columns(rows, segments, names))
    notes = ("each part of a fitted curve counts as the segment beside it",)
    return Table("segments", columns, () if plan.path.fit is None else notes)


def measure_segments(
    motion: Trajectory,
    ways: Array,
    owner: np.ndarray,
    active: np.ndarray,
    limits: int,
) -> Array:
    """Return a row (N, IDLE + 1 + limits) of each segment that takes any time, by rising number.

    ways    (M,) path length (m) of each time piece
    owner   (M,) number of the segment of each time piece
    active  (M,) index of the active limit of each time piece; −1: none
    limits  number of limits
    """
    numbers, row = np.unique(owner, return_inverse=True)
    times = np.diff(motion.knots)
    pieces, place = np.unique(motion.piece, return_inverse=True)
    assert isinstance(motion.path, MachinePath)
    rates = find_travel_rates([motion.path.pieces[piece] for piece in pieces])[place]
    rows = np.zeros((len(numbers), IDLE + 1 + limits))
    rows[:, NUMBER] = numbers
    np.add.at(rows[:, TIME], row, times)
    np.add.at(rows[:, WAY], row, ways * rates)
    np.add.at(rows, (row, IDLE + 1 + active), times)
    return np.asarray(rows[rows[:, TIME] > 0])


def name_kind(segment: Segment) -> str:
    """Name the kind of a segment, as "line"."""
    return type(segment).__name__.lower()


def line_columns(segments: Iterable[Segment | None]) -> list[Column]:
    """Return the column of the lines of segments in the program's file, if any has one."""
    lines = [None if segment is None else segment.line_number for segment in segments]
    return [Column(FILE_LINE, lines)] if any(lines) else []


def segment_columns(rows: Array, segments: Sequence[Segment], names: Sequence[str]) -> list[Column]:
    """Return the columns of segments and their rows of `measure_segments`; names: of the limits."""
    time = rows[:, TIME]
    active = rows[:, IDLE + 1 :]
    shares = (active.max(1, initial=0.0) / time).tolist()
    longest = active.argmax(1) if names else np.zeros(len(rows), int)
    limits = [names[k] if share > 0 else None for k, share in zip(longest, shares, strict=True)]
    return [
        *line_columns(segments),
        Column("kind", [name_kind(segment) for segment in segments]),
        Column("length", rows[:, WAY], "m", "human", ".3f"),
        Column("time", time, "s", form=".4f"),
        Column("mean speed", rows[:, WAY] / time, "m/s", "human", ".4g"),
        Column("held back by", limits),
        Column("for", [100 * share if share > 0 else None for share in shares], "%", form=".0f"),
    ]
