"""The worth of each limit of a motion: the seconds that one per cent more of it saves, in all and along the path.

To first order, by the multipliers of the lower bound's proof (docs/theory/limit_worth.md). What a larger change saves
is found by planning again.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.facts import Fact
from kinematics.foundation.names import count_noun, nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from planner.bounds.duration_bound import DurationBound
from planner.bounds.lower_bound import AXIS_ROWS, SPEED_LIMITS
from planner.bounds.worth import PER_CENT
from planner.certificate.certify import Certificate
from planner.limits.limit import Limit, Term
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath, make_points
from planner.timing.certified_solve import Solution, certified_solve
from planner.trajectory import Trajectory

ALL = "all"
"""Name of all axes of a limit together."""
# Uses of a limit, relative to the largest, up to which channels are the same.
TIE = 1e-6
# Use up to which a limit that the multipliers do not know surely saves nothing.
BINDING = 0.99
# Share of the duration that one per cent of a limit saves at least to count: less is the multipliers' own error.
LEAST_SHARE = 1e-6
# How much more all axes have to save than the best of them to be told beside it.
LITTLE_MORE = 1.02
# Share of the duration that the multipliers may leave without a limit before that is said.
MOST_UNEXPLAINED = 0.02

# Cosine between two ways, below minus which the path runs back into itself.
RUN_BACK = 0.999


@dataclass(frozen=True, slots=True)
class LimitChange(Result):
    """A motion planned again with a limit changed by a share: +0.2 is 20 % more.

    saved      s, how much shorter it is than the motion before; negative where it is longer
    predicted  s, the same to first order, which a large change does not reach; NaN where that is not known
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
        return f"{call(self.limit, self.axis)} {change} {kind} {_tell_ms(abs(self.saved))} ms, planned again"

    def tables(self) -> tuple[Table, ...]:
        """Return the saving, next to its prediction."""
        after = self.solution.trajectory.duration
        times = [after + self.saved, after, self.saved, self.predicted]
        what = ["duration", "duration, changed", "saved", "saved, predicted to first order"]
        title = f"{call(self.limit, self.axis)}, {100 * self.by:+g} %"
        return (Table(title, (Column("what", what), Column("time", times, "s", form=".6f"))),)


@dataclass(frozen=True, slots=True)
class Worth(Result):
    """Seconds that are saved by one per cent more of each limit, in both of its directions, to first order.

    limits, axes (R,)  names; axis "all": every axis of that limit at once
    saved (R,)     s, where nothing else is raised: up to where another limit binds instead
    together (R,)  s, where all that binds beside it is raised as well
    along (R, M)   s, `together` on each of M cells along the path; `ends` (M+1,) m, where they begin and end
    unknown        limits that bind somewhere and that the multipliers do not know: not among the rows, and the rows
                   count what these hold back as their own
    explained      share of the duration that the rows make up; 1 but for the gap of the bound
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
    kept: tuple[Limit, ...] = field(repr=False)
    order: int = field(repr=False)

    @property
    def best(self) -> tuple[str, str] | None:
        """The limit and the axis, or all axes, that save most; None where nothing is saved.

        All axes are that only where they save more than the best of them.
        """
        one, every = self._find_most()
        k = every if every is not None else one
        return None if k is None else (self.limits[k], self.axes[k])

    @check_arguments()
    def of(self, limit: str, axis: str = ALL) -> float:
        """s that one per cent more of a limit saves; NaN where that is not known. Raises MotionError for no such."""
        *_, axis = self._find(limit, axis)
        rows = [k for k, row in enumerate(zip(self.limits, self.axes, strict=True)) if row == (limit, axis)]
        return float(self.saved[rows[0]]) if rows else np.nan

    @check_arguments()
    def replan(self, limit: str, axis: str = ALL, by: float = 0.2) -> LimitChange:
        """Plan again with a limit of an axis, or of all axes, changed by a share.

        A speed is the limit's own: a pulse rate that holds the same axis stays. Raises MotionError for a limit or an
        axis that is not there, for what no number scales, and as `planner.plan`.
        """
        if not -1 < by < np.inf:
            raise MotionError(f"by {by:g} must be above -1, as 0.2 for 20 % more")
        found, channel, axis = self._find(limit, axis)
        path = self.trajectory.path
        if isinstance(found, ToolSpeed) and any(path.constant(k) is not None for k in range(len(path.breaks) - 1)):
            raise MotionError("a constant speed is what the program asks for: change it there")
        changed = tuple(each.scale(1 + by, channel) if each is found else each for each in self.kept)
        solution = certified_solve(path, changed, self.order)
        saved = self.trajectory.duration - solution.trajectory.duration
        return LimitChange(limit, axis, by, saved, self.of(limit, axis) * by / PER_CENT, solution)

    def _find(self, limit: str, axis: str) -> tuple[Limit, int | None, str]:
        """Return the limit, the channel of an axis, None for all of them, and the axis name of its rows."""
        timed = {each.name: each for each in self.kept if not each.geometric}
        if limit not in timed:
            known = f"{nearest(limit, timed)}; there are {', '.join(timed)}"
            raise MotionError(f"no limit {limit!r} holds this motion{known}")
        found = timed[limit]
        if len(found.channels) == 1 and axis in (ALL, *found.channels):
            return found, None, found.channels[0]
        if axis == ALL:
            return found, None, ALL
        if axis not in found.channels:
            names = (ALL, *found.channels)
            raise MotionError(f"{limit} has no axis {axis!r}{nearest(axis, names)}; there are {', '.join(names)}")
        return found, found.channels.index(axis), axis

    @property
    def corner_stops(self) -> tuple[int, float]:
        """How many corners the motion stops at, and about how long (s) that takes.

        Around each stop the speed falls from a local maximum and rises to the next. The estimate is the time of both
        ramps, less what their ways take at those maxima: what a corner that costs no speed at all would save. Stops for
        dwells, at the ends and where the path runs back into itself, which no blend spares, do not count.
        """
        motion, lost, count = self.trajectory, 0.0, 0
        t, s, v = motion.knots, np.append(motion.s, motion.path.breaks[-1]), np.append(motion.v, 0.0)
        for k in _find_corner_stops(motion):
            low, high = k, k
            while low > 0 and v[low - 1] > v[low]:
                low -= 1
            while high < len(v) - 1 and v[high + 1] > v[high]:
                high += 1
            count += 1
            lost += float(t[high] - t[low] - (s[k] - s[low]) / v[low] - (s[high] - s[k]) / v[high])
        return count, lost

    def rank(self) -> list[int]:
        """Return the rows that save time, the most valuable first."""
        order = np.lexsort((-self.together, -self.saved)).tolist()
        return [k for k in order if self.together[k] > self._least]

    def describe(self) -> str:
        """Return the most valuable change in one line: of all axes where that is more than of one, then of one axis."""
        one, every = self._find_most()
        told = [
            f"{call(self.limits[k], self.axes[k])}, {_tell_ms(self.saved[k])} ms" for k in (every, one) if k is not None
        ]
        if len(told) > 1:
            told[1] = f"of one axis alone, {told[1]}"
        return "; ".join(told) or "no limit whose worth is known saves time"

    def _find_most(self) -> tuple[int | None, int | None]:
        """Return the rows of the one axis that saves most, and of all axes of a limit where that is more."""
        rows = [k for k in self.rank() if self.saved[k] > self._least]
        one = next((k for k in rows if self.axes[k] != ALL), None)
        every = next((k for k in rows if self.axes[k] == ALL), None)
        more = every is not None and (one is None or self.saved[every] > self.saved[one] * LITTLE_MORE)
        return one, every if more else None

    def tables(self) -> tuple[Table, ...]:
        """Return the saving of each limit, the most valuable first.

        Notes name the limits that save nothing, and those that are not known.

        Axes of a limit that save the same share a row, and what saves nothing by itself has no number.
        """
        groups: dict[tuple[str, ...], list[int]] = {}
        for k in self.rank():
            own = (f"{1e3 * value:.4f}" for value in (self.saved[k], self.together[k]))
            groups.setdefault((self.limits[k], "" if self.axes[k] != ALL else ALL, *own), []).append(k)
        first = [rows[0] for rows in groups.values()]
        columns = (
            Column("limit", [self.limits[k] for k in first]),
            Column("axis", [", ".join(self.axes[k] for k in sorted(rows)) for rows in groups.values()]),
            Column(
                "saved",
                [value if value > self._least else None for value in self.saved[first].tolist()],
                "s",
                "milli",
                form=".4f",
            ),
            Column("with all active limits raised", self.together[first], "s", "milli", form=".4f"),
        )
        return (Table("time saved by raising a limit by 1 %, to first order", columns, tuple(self._notes())),)

    @property
    def _least(self) -> float:
        return LEAST_SHARE * self.trajectory.duration

    def _notes(self) -> Iterator[str]:
        of = np.array(self.limits)
        idle = [name for name in dict.fromkeys(self.limits) if not (self.together[of == name] > self._least).any()]
        if idle:
            yield f"no time is saved by raising {', '.join(idle)}"
        count, lost = self.corner_stops
        if count:
            share = f"{lost:.3g} s, {100 * lost / self.trajectory.duration:.1f} %"
            told = f"{count_noun(count, 'stop')} at corners: decelerating and accelerating again costs about {share}"
            yield f"{told}; blends or fits of these joins save part of it"
        if self.unknown:
            yield f"not known: {', '.join(self.unknown)}, counted with the others; replan(limit) finds out"
        if abs(self.explained - 1) > MOST_UNEXPLAINED:
            yield f"rough: the limits make up {100 * self.explained:.1f} % of the duration"
        if (self.saved[self.rank()] < self.together[self.rank()] * (1 - TIE)).any():
            yield (
                "with all active limits raised: where others hold the motion back at the same place, one alone saves "
                "little; this is its part in what is saved there if all that bind there are raised"
            )


def _find_corner_stops(motion: Trajectory) -> list[int]:
    """Return the knots at which it rests between two pieces that meet at a corner, without a dwell."""
    path, found = motion.path, []
    for k in (np.flatnonzero(np.diff(motion.piece)) + 1).tolist():
        if motion.v[k] > 0 or path.dwells[motion.piece[k]] > 0:
            continue
        s, pieces = np.repeat(motion.s[k], 2), motion.piece[[k - 1, k]]
        before, after = np.asarray(path.derivatives(s, pieces, 1)[1])
        sizes = float(np.linalg.norm(before) * np.linalg.norm(after))
        if sizes > 0 and float(before @ after) > -RUN_BACK * sizes:
            found.append(k)
    return found


def _tell_ms(time: float) -> str:
    """ms of a time (s), with three digits or all before the point."""
    return f"{1e3 * time:.3g}" if abs(time) < 0.9995 else f"{1e3 * time:.0f}"


def call(limit: str, axis: str) -> str:
    """Return the name of a limit of an axis in a sentence."""
    return f"the {limit} of {'all axes' if axis == ALL else axis}" if axis != "tool" else f"the {limit}"


def find_worth(
    trajectory: Trajectory, limits: Sequence[Limit], order: int, certificate: Certificate, bound: DurationBound
) -> Worth:
    """Return the worth of each limit of the fastest motion within them, from its lower bound."""
    path = trajectory.path
    ends = np.append(bound.s, path.breaks[-1])
    rows: list[tuple[str, str, Array, Array]] = []
    unknown = []
    speeds = [limit for limit in limits if isinstance(limit, SPEED_LIMITS)]
    by_speed = dict(zip(speeds, _share_speeds(path, speeds, ends, bound), strict=True))
    for limit in limits:
        if isinstance(limit, AXIS_ROWS):
            kind = AXIS_ROWS.index(type(limit))
            together, alone = bound.worth[:, kind].T, bound.alone[:, kind].T
            whole = together.sum(0)
        elif limit in by_speed:
            together, alone, whole = by_speed[limit]
        elif not limit.geometric:
            if certificate.worst[limit.name] >= BINDING:
                unknown.append(limit.name)
                continue
            together = alone = np.zeros((len(limit.channels), len(bound.s)))
            whole = together.sum(0)
        else:
            continue
        if len(limit.channels) > 1:
            rows.append((limit.name, ALL, whole, together.sum(0)))
        rows += [
            (limit.name, name, alone[k], together[k])
            for k, name in enumerate(limit.channels)
            if np.isfinite(limit.bounds[k])
        ]
    if "constant speed" in bound.left_out:
        unknown.append("constant speed")
    names, axes = tuple(row[0] for row in rows), tuple(row[1] for row in rows)
    saved, along = (PER_CENT * np.array([row[k] for row in rows]).reshape(len(rows), len(bound.s)) for k in (2, 3))
    moving = trajectory.duration - float(path.dwells.sum())
    explained = float(bound.worth.sum((0, 2)) @ [2.0, 3.0, 1.0]) / moving if moving > 0 else 1.0
    if max(path.end_speeds) > 0:  # these scale too, but are given
        explained = 1.0
    return Worth(
        names,
        axes,
        saved.sum(1),
        along.sum(1),
        tuple(unknown),
        explained,
        along,
        ends,
        trajectory,
        tuple(limits),
        order,
    )


def _share_speeds(
    path: ActuatorPath, limits: Sequence[Limit], ends: Array, bound: DurationBound
) -> Iterator[tuple[Array, Array, Array]]:
    """Yield the worth of speeds on each cell, shared by the channels that bind.

    Each is together (m, M), alone (m, M), and alone of all channels of the limit (M,).
    Alone, a channel saves up to where the next one binds.
    """
    worth = bound.worth[:, 2, 0]
    points = make_points(path, (ends[1:] + ends[:-1]) / 2, bound.piece, 2)
    uses = []
    for limit in limits:
        rows = limit.rows(points)
        with np.errstate(invalid="ignore"):
            uses.append(np.nan_to_num(np.abs(rows.coefficients[Term.SD]) / rows.bound).T)
    if not uses:
        return
    every = np.concatenate(uses)
    most = every.max(0)
    tied = every >= most * (1 - TIE)
    share = np.where(most > 0, tied / tied.sum(0), 0.0)
    first = 0
    for use in uses:
        own = slice(first, first + len(use))
        first += len(use)
        alone = np.empty_like(use)
        for k in range(len(use)):
            alone[k] = share[own][k] * _find_room(most, np.delete(every, own.start + k, 0))
        yield share[own] * worth, alone * worth, share[own].sum(0) * worth * _find_room(most, np.delete(every, own, 0))


def _find_room(most: Array, others: Array) -> Array:
    """Return the share of one per cent by which the most used channel may grow until another binds."""
    if not len(others):
        return np.ones_like(most)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.where(others.max(0) > 0, most / others.max(0) - 1, np.inf)
    return np.clip(growth / PER_CENT, 0.0, 1.0)
