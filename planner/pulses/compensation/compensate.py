"""Compensation: what an axis has to count so that behind its screw's errors and its play it is where it should be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.polynomials import solve_heights
from kinematics.machine.axis import Axis
from planner.pulses.compensation.take_up import take_up, taken_up
from planner.pulses.generation.pieces import FIT_TOLERANCE, Stretches, cut_monotone, fit
from planner.pulses.motion import AxesMotion, MotionState
from planner.pulses.schedule import Compensation

# Share of a stretch to which a time on it is found.
TIME_TOLERANCE = 1e-12


@dataclass(frozen=True, slots=True)
class CompensatedMotion:
    """A motion in the motors' coordinates: q → home + c(q - home) + take-up of the play.

    parts    (intervals between knots, n) the part of its table that each axis is on
    c        inverts r = c + error(c), the lead errors (m or rad) between whose points it is linear
    take-up  the play is on the side that the last move left, at the start on the one that the axis' `pushed` states.
             At every turn the motor crosses it in a smooth step about the instant at which the axis turns, or while
             it rests there (`planner.pulses.compensation.take_up`)
    """

    planned: AxesMotion
    home: Array
    knots: Array
    tables: tuple[Array | None, ...]
    parts: NDArray[np.intp]
    steps: tuple[Array, ...]
    costs: tuple[Compensation, ...]

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
                values[:, :, k] = _apply_screw(values[:, :, k], float(self.home[k]), table, self.parts[here, k])
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


def compensate_motion(motion: AxesMotion, axes: Sequence[Axis], home: Array) -> CompensatedMotion | None:
    """The motion as the motors have to make it, where some axis asks for compensation; None where none does.

    Raises Infeasible where the motion leaves a motor no room to take up its play.
    """
    if not any(axis.compensate for axis in axes):
        return None
    pieces = fit(motion, FIT_TOLERANCE * np.array([axis.pulse for axis in axes]))
    tables, steps, costs, knots = [], [], [], [np.asarray(motion.knots)]
    for k, axis in enumerate(axes):
        counted = pieces.coefficients[k].copy()
        counted[0] -= home[k]
        stretches = cut_monotone(pieces.start, pieces.length, counted, float(pieces.noise[k]))
        table = _table(axis) if "lead" in axis.compensate else None
        taken, cost = np.empty((0, 3)), Compensation(axis.name, axis.compensate)
        if "backlash" in axis.compensate and axis.backlash > 0:
            taken, cost = take_up(motion, k, axis, stretches)
        if table is not None:
            knots.append(_find_crossings(stretches, table[0]))
        knots.append(np.clip((taken[:, :1] + taken[:, 1:2] * [0, 1]).ravel(), 0.0, motion.duration))
        costs.append(cost)
        tables.append(table)
        steps.append(freeze_array(taken))
    times = np.sort(np.concatenate(knots))
    # between two knots an axis stays on one part of its table; at a knot only the time tells on which
    middle = motion.at((times[:-1] + times[1:]) / 2).q - home
    parts = np.zeros(middle.shape, np.intp)
    for k, table in enumerate(tables):
        if table is not None:
            parts[:, k] = np.searchsorted(table[0], middle[:, k], side="right")
    return CompensatedMotion(
        motion, freeze_array(home), freeze_array(times), tuple(tables), parts, tuple(steps), tuple(costs)
    )


def counted_motion(motion: AxesMotion, axes: Sequence[Axis], home: Array) -> AxesMotion:
    """What the pulses count: the motion, or where axes ask for compensation what their motors make of it.

    Raises as `compensate_motion` does.
    """
    return compensate_motion(motion, axes, home) or motion


def _table(axis: Axis) -> Array | None:
    """(2, N) true positions from home, rising, and what is counted there."""
    if axis.lead_error is None:
        return None
    counted, error = np.array(axis.lead_error).T
    return freeze_array(np.stack([counted + error, counted]))


def _apply_screw(values: Array, home: float, table: Array, part: NDArray[np.intp]) -> Array:
    """q and its derivatives (4, N) -> the same of what is counted; past either end the error stays as it is there.

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
    index, which = np.nonzero((low[:, None] <= points) & (points <= high[:, None]) & (low < high)[:, None])
    sign = np.where(ends[1:] > ends[:-1], 1.0, -1.0)
    height = (points[which] - ends[index]) * sign[index]
    share, _ = solve_heights(stretches.coefficients[1:] * sign, index, height, np.full(len(sign), TIME_TOLERANCE))
    found: Array = stretches.start[index] + share * stretches.length[index]
    return found
