"""Worth of each limit: the time that raising it by one per cent saves, in total and along the path.

The multipliers of the lower bound give it to first order: docs/theory/limit_worth.md.
For a larger change, `Worth.replan` plans again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.facts import Fact
from kinematics.foundation.names import nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.bounds.duration_bound import DurationBound
from planner.bounds.lower_bound import AXIS_ROWS, SPEED_LIMITS
from planner.bounds.worth import PER_CENT
from planner.certificate.certify import Certificate
from planner.limits.limit import Limit, Term, select_timed
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath, has_constant_speed, make_points
from planner.timing.certified_solve import Solution, certified_solve
from planner.trajectory import Trajectory

ALL = "all"
"""Name of all axes of a limit together."""
# Relative difference of two uses below which two channels bind together.
TIE = 1e-6
# Largest use below which a limit without multipliers is inactive.
BINDING = 0.99
# Smallest saving that counts, as a share of the duration: errors of the multipliers are smaller.
LEAST_SHARE = 1e-6
# Factor by which all axes must save more than the best axis to be named as well.
LITTLE_MORE = 1.02
# Share of the duration without a limit above which a note calls the result rough.
MOST_UNEXPLAINED = 0.02

# Limit and axis, and the savings (s) on each cell: of these alone, and together with all that bind.
Row = tuple[str, str, Array, Array]


@dataclass(frozen=True, slots=True)
class LimitChange(Result):
    """Motion planned again with a limit changed by the share `by`: +0.2 is 20 % more.

    saved      s, reduction of the duration, negative if it grew
    predicted  s, reduction to first order, too optimistic for a large change; NaN if unknown
    solution   the motion and its certificate
    """

    limit: Annotated[str, Fact("limit")]
    axis: Annotated[str, Fact("axis")]
    by: Annotated[float, Fact("by")]
    saved: Annotated[float, Fact("saved_s")]
    predicted: float
    solution: Solution = field(repr=False)

    def describe(self) -> str:
        """Return one sentence."""
        kind = "saves" if self.saved >= 0 else "costs"
        way = "higher" if self.by > 0 else "lower"
        change = f"{100 * abs(self.by):g} % {way}"
        time = _format_ms(abs(self.saved))
        return f"{call(self.limit, self.axis)} {change} {kind} {time} ms, planned again"

    def tables(self) -> tuple[Table, ...]:
        """Return the saving, next to its prediction."""
        after = self.solution.trajectory.duration
        times = [after + self.saved, after, self.saved, self.predicted]
        names = ["duration", "duration, changed", "saved", "saved, predicted to first order"]
        title = f"{call(self.limit, self.axis)}, {100 * self.by:+g} %"
        columns = (
            Column("what", names),
            Column("time", times, "s", form=".6f"),
        )
        return (Table(title, columns),)


@dataclass(frozen=True, slots=True)
class Worth(Result):
    """Time that raising each limit by one per cent in both directions saves, to first order.

    limits, axes (R,)  name of each row's limit and axis; axis "all": every axis of the limit
    saved (R,)     s, if only this limit is raised: it counts up to where another limit binds
    together (R,)  s, if all limits that bind at the same place are raised as well
    along (R, M)   s, `together` on each of M cells along the path
    ends (M+1,)    m, ends of the cells
    unknown        active limits without multipliers: the rows include what these limits cost
    explained      share of the duration that the rows explain: 1 up to the gap of the bound
    """

    limits: tuple[str, ...] = field(repr=False)
    axes: tuple[str, ...] = field(repr=False)
    saved: Array = field(repr=False)
    together: Array = field(repr=False)
    unknown: tuple[str, ...]
    explained: float
    along: Array = field(repr=False)
    ends: Array = field(repr=False)
    trajectory: Trajectory = field(repr=False)
    constraints: tuple[Limit, ...] = field(repr=False)
    order: int = field(repr=False)

    @property
    def best(self) -> tuple[str, str] | None:
        """Limit and axis that save most, or None if none saves time.

        The axis is "all" only if all axes save more than the best of them.
        """
        one, every = self._find_most()
        row = one if every is None else every
        return None if row is None else (self.limits[row], self.axes[row])

    @check_arguments()
    def of(self, limit: str, axis: str = ALL) -> float:
        """Return the saving (s) of a limit, NaN if unknown. Raise MotionError for a wrong name."""
        *_, axis = self._find(limit, axis)
        rows = zip(self.limits, self.axes, self.saved.tolist(), strict=True)
        return next((saved for *name, saved in rows if name == [limit, axis]), np.nan)

    @check_arguments()
    def replan(self, limit: str, axis: str = ALL, by: float = 0.2) -> LimitChange:
        """Plan again with a limit of one axis, or of all axes, changed by a share.

        A pulse rate that caps the speed of the same axis does not change with its speed limit.
        Raises MotionError for an unknown limit or axis, for a limit that no number scales, and
        as `planner.plan`.
        """
        if not -1 < by < np.inf:
            raise MotionError(f"by {by:g} must be above -1, as 0.2 for 20 % more")
        chosen, channel, axis = self._find(limit, axis)
        path = self.trajectory.path
        if isinstance(chosen, ToolSpeed) and has_constant_speed(path):
            raise MotionError("a constant speed is what the program asks for: change it there")
        scaled = chosen.scale(1 + by, channel)
        changed = tuple(scaled if each is chosen else each for each in self.constraints)
        solution = certified_solve(path, changed, self.order)
        saved = self.trajectory.duration - solution.trajectory.duration
        predicted = self.of(limit, axis) * by / PER_CENT
        return LimitChange(limit, axis, by, saved, predicted, solution)

    def _find(self, limit: str, axis: str) -> tuple[Limit, int | None, str]:
        """Return a limit, its channel (None: all channels), and the axis name of its row."""
        timed = {each.name: each for each in select_timed(self.constraints)}
        if limit not in timed:
            known = f"{nearest(limit, timed)}; there are {', '.join(timed)}"
            raise MotionError(f"no limit {limit!r} holds this motion{known}")
        chosen = timed[limit]
        channels = chosen.channels
        names = (ALL, *channels)
        if axis not in names:
            known = f"{nearest(axis, names)}; there are {', '.join(names)}"
            raise MotionError(f"{limit} has no axis {axis!r}{known}")
        if len(channels) == 1:
            return chosen, None, channels[0]
        return chosen, None if axis == ALL else channels.index(axis), axis

    def rank(self) -> list[int]:
        """Return the rows that save time, the most valuable first."""
        order = np.lexsort((-self.together, -self.saved)).tolist()
        return [k for k in order if self.together[k] > self._least]

    def describe(self) -> str:
        """Return the largest saving of all axes, if it is worth it, then of one axis."""
        one, every = self._find_most()
        if one is None and every is None:
            return "no limit whose worth is known saves time"
        texts = []
        if every is not None:
            texts.append(self._describe_row(every))
        if one is not None:
            texts.append(self._describe_row(one, " alone" if texts else ""))
        return f"saves {', '.join(texts)}"

    def _describe_row(self, row: int, alone: str = "") -> str:
        return f"{_format_ms(self.saved[row])} ms ({call(self.limits[row], self.axes[row])}{alone})"

    def _find_most(self) -> tuple[int | None, int | None]:
        """Return the row of the axis that saves most, and that of all axes if they save more."""
        rows = [k for k in self.rank() if self.saved[k] > self._least]
        one = next((k for k in rows if self.axes[k] != ALL), None)
        every = next((k for k in rows if self.axes[k] == ALL), None)
        if one is None or every is None:
            return one, every
        return one, every if self.saved[every] > self.saved[one] * LITTLE_MORE else None

    def tables(self) -> tuple[Table, ...]:
        """Return the saving of each limit, the most valuable first.

        Axes of a limit with equal savings share a row. A row that saves nothing alone has no number
        there. Notes name the limits that save nothing and the limits whose worth is unknown.
        """
        groups: dict[tuple[str, ...], list[int]] = {}
        for k in self.rank():
            every = ALL if self.axes[k] == ALL else ""
            savings = (f"{1e3 * value:.4f}" for value in (self.saved[k], self.together[k]))
            groups.setdefault((self.limits[k], every, *savings), []).append(k)
        first = [rows[0] for rows in groups.values()]
        axes = [", ".join(self.axes[k] for k in sorted(rows)) for rows in groups.values()]
        saved = [value if value > self._least else None for value in self.saved[first].tolist()]
        together = self.together[first]
        columns = (
            Column("limit", [self.limits[k] for k in first]),
            Column("axis", axes),
            Column("saved", saved, "s", "milli", form=".4f"),
            Column("with all active limits raised", together, "s", "milli", form=".4f"),
        )
        title = "time saved by raising a limit by 1 %, to first order"
        return (Table(title, columns, tuple(self._notes())),)

    @property
    def _least(self) -> float:
        return LEAST_SHARE * self.trajectory.duration

    def _notes(self) -> Iterator[str]:
        rows = self.rank()
        saving = {self.limits[k] for k in rows}
        idle = [name for name in dict.fromkeys(self.limits) if name not in saving]
        if idle:
            yield f"no time is saved by raising {', '.join(idle)}"
        if self.unknown:
            names = ", ".join(self.unknown)
            yield f"not known: {names}, counted with the others; replan(limit) finds out"
        if abs(self.explained - 1) > MOST_UNEXPLAINED:
            yield f"rough: the limits make up {100 * self.explained:.1f} % of the duration"
        if (self.saved[rows] < self.together[rows] * (1 - TIE)).any():
            yield (
                "with all active limits raised: where several limits are active at one place, "
                "raising one alone saves little; this is its share of the time that raising all "
                "of them saves"
            )


def _format_ms(time: float) -> str:
    """Return a time (s) in ms, with three digits or all digits before the point."""
    return f"{1e3 * time:.3g}" if abs(time) < 0.9995 else f"{1e3 * time:.0f}"


def call(limit: str, axis: str) -> str:
    """Return the name of a limit of an axis in a sentence."""
    if axis == "tool":
        return f"the {limit}"
    return f"the {limit} of {'all axes' if axis == ALL else axis}"


class Saving(NamedTuple):
    """Savings (s) of a limit per unit of relative change, on each of M cells.

    together (m, M)  of each channel, if all limits that bind are raised
    alone (m, M)     of each channel, if only it is raised
    whole (M,)       of all channels, if only this limit is raised
    """

    together: Array
    alone: Array
    whole: Array


def find_worth(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    certificate: Certificate,
    bound: DurationBound,
) -> Worth:
    """Return the worth of each limit of the fastest motion within them, from its lower bound."""
    path = trajectory.path
    ends = np.append(bound.s, path.breaks[-1])
    speeds = _share_speeds(path, limits, ends, bound)
    rows: list[Row] = []
    unknown = []
    for limit in select_timed(limits):
        if isinstance(limit, AXIS_ROWS):
            kind = AXIS_ROWS.index(type(limit))
            together = bound.worth[:, kind].T
            saving = Saving(together, bound.alone[:, kind].T, together.sum(0))
        elif limit in speeds:
            saving = speeds[limit]
        elif certificate.worst[limit.name] < BINDING:
            nothing = np.zeros((len(limit.channels), len(bound.s)))
            saving = Saving(nothing, nothing, nothing.sum(0))
        else:
            unknown.append(limit.name)
            continue
        rows += _make_rows(limit, saving)
    if "constant speed" in bound.left_out:
        unknown.append("constant speed")
    shape = (len(rows), len(bound.s))
    alone, along = (PER_CENT * np.array([row[k] for row in rows]).reshape(shape) for k in (2, 3))
    return Worth(
        limits=tuple(row[0] for row in rows),
        axes=tuple(row[1] for row in rows),
        saved=alone.sum(1),
        together=along.sum(1),
        unknown=tuple(unknown),
        explained=_explain(trajectory, bound),
        along=along,
        ends=ends,
        trajectory=trajectory,
        constraints=tuple(limits),
        order=order,
    )


def _make_rows(limit: Limit, saving: Saving) -> list[Row]:
    """Return a row for all axes of a limit, if it has several, and one for each limited axis."""
    rows: list[Row] = []
    if len(limit.channels) > 1:
        rows.append((limit.name, ALL, saving.whole, saving.together.sum(0)))
    for k, axis in enumerate(limit.channels):
        if np.isfinite(limit.bounds[k]):
            rows.append((limit.name, axis, saving.alone[k], saving.together[k]))
    return rows


def _explain(trajectory: Trajectory, bound: DurationBound) -> float:
    """Return the share of the moving time that the worths explain.

    If acceleration, jerk and speed limits grow by the factors k², k³ and k, the time falls by 1/k.
    """
    path = trajectory.path
    moving = trajectory.duration - float(path.dwells.sum())
    if moving <= 0 or max(path.end_speeds) > 0:  # given end speeds do not scale
        return 1.0
    return float(bound.worth.sum((0, 2)) @ [2.0, 3.0, 1.0]) / moving


def _share_speeds(
    path: ActuatorPath,
    limits: Sequence[Limit],
    ends: Array,
    bound: DurationBound,
) -> dict[Limit, Saving]:
    """Return the savings of each speed limit: channels that bind share the worth of a cell."""
    limits = [limit for limit in limits if isinstance(limit, SPEED_LIMITS)]
    if not limits:
        return {}
    points = make_points(path, (ends[1:] + ends[:-1]) / 2, bound.piece, 2)
    uses = []
    for limit in limits:
        rows = limit.rows(points)
        with np.errstate(invalid="ignore"):
            uses.append(np.nan_to_num(np.abs(rows.coefficients[Term.SD]) / rows.bound).T)
    every = np.concatenate(uses)
    most = every.max(0)
    tied = every >= most * (1 - TIE)
    share = np.where(most > 0, tied / tied.sum(0), 0.0)
    worth = share * bound.worth[:, 2, 0]
    rooms = np.stack([_find_room(most, np.delete(every, k, 0)) for k in range(len(every))])

    savings = {}
    first = 0
    for limit, use in zip(limits, uses, strict=True):
        channels = slice(first, first + len(use))
        first = channels.stop
        together = worth[channels]
        room = _find_room(most, np.delete(every, channels, 0))
        savings[limit] = Saving(
            together=together,
            alone=together * rooms[channels],
            whole=together.sum(0) * room,
        )
    return savings


def _find_room(most: Array, others: Array) -> Array:
    """Return the share of one per cent that the most used channel can grow before another binds."""
    if not len(others):
        return np.ones_like(most)
    next_most = others.max(0)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.where(next_most > 0, most / next_most - 1, np.inf)
    return np.clip(growth / PER_CENT, 0.0, 1.0)
