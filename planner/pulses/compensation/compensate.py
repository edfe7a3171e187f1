"""Compensation: what an axis has to count so that behind its screw's errors and its play it is
where it should be.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.polynomials import solve_heights
from kinematics.machine.axis import Axis
from planner.pulses.compensation.play import Play, Turn, TurnSearch
from planner.pulses.compensation.take_up import refuse_carried, take_up, taken_up
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan, PieceMotion
from planner.pulses.generation.pieces import FIT_TOLERANCE, Pieces, Stretches, cut_monotone, fit
from planner.pulses.motion import AxesMotion, MotionState
from planner.pulses.schedule import Compensation
from planner.shaping.shaped_motion import ShapedMotion, shape_motion

# Share of a stretch to which a time on it is found.
TIME_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class CompensatedMotion:
    """A motion in the motors' coordinates: q → home + c(q - home) + take-up of the play.

    parts    (intervals between knots, n) the part of its table that each axis is on
    c        inverts r = c + error(c), the lead errors (m or rad) between whose points it is linear
    take-up  the play is on the side that the last move left, at the start on the one that the axis'
             `pushed` states. At every turn the motor crosses it in a smooth step about the instant
             at which the axis turns, or while it rests there
             (`planner.pulses.compensation.take_up`)
    begun    the plays at its start
    """

    planned: AxesMotion
    home: Array
    knots: Array
    tables: tuple[Array | None, ...]
    parts: NDArray[np.intp]
    steps: tuple[Array, ...]
    costs: tuple[Compensation, ...]
    begun: tuple[Play, ...] = field(repr=False)

    @property
    def duration(self) -> float:
        return self.planned.duration

    def at(self, t: Array, /) -> MotionState:
        t = np.atleast_1d(np.asarray(t, float))
        state = self.planned.at(t)
        values = np.stack([state.q, state.qd, state.qdd, state.qddd])
        here = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        for k, (table, steps) in enumerate(zip(self.tables, self.steps, strict=True)):
            if table is not None:
                values[:, :, k] = _apply_screw(
                    values[:, :, k], float(self.home[k]), table, self.parts[here, k]
                )
            if len(steps):
                values[:, :, k] += taken_up(steps, t)
        return _State(state.s, *values)


@dataclass(frozen=True, slots=True)
class _State:
    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


def compensate_motion(
    motion: AxesMotion, axes: Sequence[Axis], home: Array, plays: Sequence[Play] = ()
) -> CompensatedMotion | None:
    """The motion as the motors have to make it, where some axis asks for compensation; None where
    none does.

    plays: those that another motion left the axes in, which this one goes on from. Raises
    Infeasible where the motion leaves a motor no room to take up its play.
    """
    if not any(axis.compensate for axis in axes):
        return None
    for k, play in enumerate(plays):
        refuse_carried(motion, k, axes[k], play)
    return compensate_part(motion, axes, home, plays or begin_plays(motion, axes, home), 0.0, True)[
        0
    ]


def begin_plays(motion: AxesMotion, axes: Sequence[Axis], home: Array) -> tuple[Play, ...]:
    """Where the axes stand in their play before a motion begins."""
    start = motion.at(np.zeros(1)).q[0] - home
    return tuple(Play.begin(axis, float(q)) for axis, q in zip(axes, start, strict=True))


def compensate_part(
    motion: AxesMotion,
    axes: Sequence[Axis],
    home: Array,
    plays: Sequence[Play],
    since: float,
    last: bool,
) -> tuple[CompensatedMotion, float, tuple[Play, ...]]:
    """A part of a motion as the motors have to make it, the time (s) up to which that is final, and
    the plays there.

    plays: at its start, which have been looked at up to a time since (s); last: the motion ends
    with it. Raises as `compensate_motion` does.
    """
    pieces = _fit(motion, axes)
    tables, costs, knots, reached, until = [], [], [np.asarray(motion.knots)], [], motion.duration
    for k, (axis, play) in enumerate(zip(axes, plays, strict=True)):
        noise, stretches = float(pieces.noise[k]), _cut(pieces, k, home)
        table, cost = (
            _table(axis) if "lead" in axis.compensate else None,
            Compensation(axis.name, axis.compensate),
        )
        if _takes_up(axis):
            play, final, cost = take_up(motion, k, axis, stretches, noise, play, since, last)
            until = min(until, final)
        if table is not None:
            knots.append(_find_crossings(stretches, table[0]))
        taken = play.list_steps()
        knots.append(np.clip((taken[:, :1] + taken[:, 1:2] * [0, 1]).ravel(), 0.0, motion.duration))
        costs.append(cost)
        tables.append(table)
        reached.append(play)
    times = np.sort(np.concatenate(knots))
    # between two knots an axis stays on one part of its table; at a knot only the time tells on
    # which
    middle = motion.at((times[:-1] + times[1:]) / 2).q - home
    parts = np.zeros(middle.shape, np.intp)
    for k, table in enumerate(tables):
        if table is not None:
            parts[:, k] = np.searchsorted(table[0], middle[:, k], side="right")
    steps = tuple(freeze_array(play.list_steps()) for play in reached)
    home = freeze_array(home)
    made = CompensatedMotion(
        motion, home, freeze_array(times), tuple(tables), parts, steps, tuple(costs), tuple(plays)
    )
    return made, until, tuple(play.shift(until) for play in reached)


def find_plays(made: CompensatedMotion, axes: Sequence[Axis], t: float) -> tuple[Play, ...]:
    """Where the axes stand in their play at an instant (s) of a motion, for another that leaves it
    there.

    Raises MotionError where a motor has begun to cross the play before the axis comes to its turn.
    """
    x = made.planned.at(np.array([t])).q[0] - made.home
    every, known = (_find_turns(made, axes, until) for until in (made.duration, t))
    found = []
    for k, (axis, begun) in enumerate(zip(axes, made.begun, strict=True)):
        steps = [
            (start, span, way)
            for start, span, way in made.steps[k][int(begun.taken != 0) :].tolist()
        ]
        (turns, _), (before, search) = every[k], known[k]
        found.append(begun.leave(t, axis.name, steps, turns, len(before), search, float(x[k])))
    return tuple(found)


def _find_turns(
    made: CompensatedMotion, axes: Sequence[Axis], until: float
) -> list[tuple[Sequence[Turn], TurnSearch]]:
    """The turns of each axis that are known at a time (s), and how far those behind them are."""
    found: list[tuple[Sequence[Turn], TurnSearch]] = [((), begun.search) for begun in made.begun]
    if until == 0:
        return found
    pieces = _fit(JoinedMotion.of(MotionSpan(made.planned, 0.0, until)), axes)
    for k, (axis, begun) in enumerate(zip(axes, made.begun, strict=True)):
        if _takes_up(axis):
            noise = float(pieces.noise[k])
            found[k] = begun.search.find(_cut(pieces, k, made.home), axis, noise, 0.0)
    return found


def _takes_up(axis: Axis) -> bool:
    return "backlash" in axis.compensate and axis.backlash > 0


def _fit(motion: AxesMotion, axes: Sequence[Axis]) -> Pieces:
    return fit(motion, FIT_TOLERANCE * np.array([axis.pulse for axis in axes]))


def _cut(pieces: Pieces, k: int, home: Array) -> Stretches:
    """Axis k from home, on stretches on which it goes one way."""
    counted = pieces.coefficients[k].copy()
    counted[0] -= home[k]
    return cut_monotone(pieces.start, pieces.length, counted, float(pieces.noise[k]))


@dataclass(frozen=True, slots=True)
class MotorsAhead:
    """What of a motion in parts has come and is not final yet in its motors: the next turn may
    change it.

    planned  it, with path lengths of the whole; None: nothing
    plays    of the axes where it begins; empty before the first part
    """

    planned: PieceMotion | None = None
    plays: tuple[Play, ...] = ()

    def add(
        self, motion: AxesMotion, s: float, axes: Sequence[Axis], home: Array, last: bool
    ) -> "tuple[AxesMotion | None, float, tuple[Compensation, ...], MotorsAhead]":
        """What the motors do up to where it is final; how long before the end of the part that
        begins (s); its cost.

        s: to be added to the path length of the part. None: nothing is final. Raises as
        `compensate_motion`, at times since the motors' motion begins.
        """
        here = MotionSpan(motion, 0.0, motion.duration, s)
        before = (
            () if self.planned is None else (MotionSpan(self.planned, 0.0, self.planned.duration),)
        )
        known = JoinedMotion.of(*before, here)
        since = 0.0 if self.planned is None else self.planned.duration
        plays = self.plays or begin_plays(known, axes, home)
        made, until, plays = compensate_part(known, axes, home, plays, since, last)
        if last:
            return made, known.duration, made.costs, MotorsAhead()
        rest = JoinedMotion.of(MotionSpan(known, until, known.duration))
        ahead = MotorsAhead(
            PieceMotion.of(rest, FIT_TOLERANCE * np.array([axis.pulse for axis in axes])), plays
        )
        final = JoinedMotion.of(MotionSpan(made, 0.0, until)) if until > 0 else None
        return final, known.duration, made.costs, ahead


def merge_costs(before: Compensation, after: Compensation) -> Compensation:
    """What two parts of a motion cost, one after the other; the windows are those of the second."""
    most = {
        name: max(getattr(before, name), getattr(after, name))
        for name in ("off", "unturned", "jerk")
    }
    nearest: dict[str, float | None] = {}
    for name in ("speed", "acceleration"):
        one, other = (
            (getattr(each, name), getattr(each, f"max_{name}")) for each in (before, after)
        )
        chosen = max(one, other, key=lambda pair: pair[0] / (pair[1] or 1.0))
        nearest |= {name: chosen[0], f"max_{name}": chosen[1]}
    every: dict[str, Any] = most | nearest
    return replace(after, crossings=before.crossings + after.crossings, **every)


def counted_motion(
    motion: AxesMotion, axes: Sequence[Axis], home: Array, plays: Sequence[Play] = ()
) -> AxesMotion:
    """What the pulses count: the motion, behind the shapers that axes have, and what motors that
    compensate make of it.

    One that is shaped already is not shaped again. plays as in `compensate_motion`, which it raises
    as.
    """
    if any(axis.shaper for axis in axes) and not isinstance(motion, ShapedMotion):
        motion = shape_motion(motion, axes) or motion
    return compensate_motion(motion, axes, home, plays) or motion


def _table(axis: Axis) -> Array | None:
    """(2, N) true positions from home, rising, and what is counted there."""
    if axis.lead_error is None:
        return None
    counted, error = np.array(axis.lead_error).T
    return freeze_array(np.stack([counted + error, counted]))


def _apply_screw(values: Array, home: float, table: Array, part: NDArray[np.intp]) -> Array:
    """q and its derivatives (4, N) -> the same of what is counted; past either end the error stays
    as it is there.

    part (N,): 0 before the first point of the table, n behind its n-th.
    """
    true, counted = table
    slope = np.concatenate([[1.0], np.diff(counted) / np.diff(true), [1.0]])
    start = np.maximum(part - 1, 0)
    out: Array = values * slope[part]
    out[0] = home + counted[start] + (values[0] - home - true[start]) * slope[part]
    return out


def _find_crossings(stretches: Stretches, points: Array) -> Array:
    """Every time at which a motion comes by one of the points."""
    ends = stretches.ends
    low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
    index, which = np.nonzero(
        (low[:, None] <= points) & (points <= high[:, None]) & (low < high)[:, None]
    )
    sign = np.where(ends[1:] > ends[:-1], 1.0, -1.0)
    height = (points[which] - ends[index]) * sign[index]
    share, _ = solve_heights(
        stretches.coefficients[1:] * sign, index, height, np.full(len(sign), TIME_TOLERANCE)
    )
    found: Array = stretches.start[index] + share * stretches.length[index]
    return found
