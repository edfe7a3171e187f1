"""Compensation: what an axis has to count so that behind its screw's errors and its play it is where it should be."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array, frozen
from kinematics.axis import Axis, sides
from kinematics.errors import MotionError
from planner.pulses.crossing import solve
from planner.pulses.motion import Motion, MotionState
from planner.pulses.pieces import fit
from planner.pulses.schedule import Compensation
from planner.pulses.stretches import Stretches, monotone

# Share of a pulse within which pieces meet the motion, and of a stretch to which a time on it is found.
FINE, NEAR = 1e-6, 1e-12
# s that the play takes where the axis states no limits.
TAKE_UP = 0.01
# Peak speed and acceleration (10/√3) of the smooth step 10 u³ - 15 u⁴ + 6 u⁵, whose ends are at rest to acceleration.
STEEP, CURVED = 1.875, 10 / np.sqrt(3)


@dataclass(frozen=True, slots=True)
class Compensated:
    """A motion in the motors' coordinates: q → home + c(q - home) + take-up of the play.

    parts    (intervals between knots, n) the part of its table that each axis is on
    c        inverts r = c + error(c), the lead errors (m or rad) between whose points it is linear
    take-up  the play is on the side that the last move left: at the start, as after one towards greater q (an
             ASSUMPTION, how the axes were homed). Towards smaller q the motor is the play behind, and it crosses over
             in a smooth step about the instant at which the axis turns, or while it rests there
    """

    motion: Motion
    home: Array
    knots: Array
    tables: tuple[Array | None, ...]
    parts: NDArray[np.intp]
    steps: tuple[Array, ...]
    costs: tuple[Compensation, ...]

    @property
    def duration(self) -> float:
        return self.motion.duration

    def at(self, t: Array, /) -> MotionState:
        t = np.atleast_1d(np.asarray(t, float))
        state = self.motion.at(t)
        values = np.stack([state.q, state.qd, state.qdd, state.qddd])
        here = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.knots) - 2)
        for k, (table, steps) in enumerate(zip(self.tables, self.steps, strict=True)):
            if table is not None:
                values[:, :, k] = _screwed(values[:, :, k], float(self.home[k]), table, self.parts[here, k])
            if len(steps):
                values[:, :, k] += _taken_up(steps, t)
        return _State(state.s, *values)


@dataclass(frozen=True, slots=True)
class _State:
    s: Array
    q: Array
    qd: Array
    qdd: Array
    qddd: Array


def compensated(motion: Motion, axes: Sequence[Axis], home: Array) -> Compensated | None:
    """The motion as the motors have to make it, where some axis asks for compensation; None where none does.

    Raises MotionError where a lead error runs back as fast as the screw forwards.
    """
    if not any(axis.compensate for axis in axes):
        return None
    pieces = fit(motion, FINE * np.array([axis.pulse for axis in axes]))
    tables, steps, costs, knots = [], [], [], [np.asarray(motion.knots)]
    for k, axis in enumerate(axes):
        counted = pieces.coefficients[k].copy()
        counted[0] -= home[k]
        stretches = monotone(pieces.start, pieces.length, counted, float(pieces.noise[k]))
        table = _table(axis) if "lead" in axis.compensate else None
        taken = np.empty((0, 3))
        if "backlash" in axis.compensate and axis.backlash > 0:
            taken = _take_up(stretches, axis, float(motion.duration))
        if table is not None:
            knots.append(_crossings(stretches, table[0]))
        knots.append(np.clip((taken[:, :1] + taken[:, 1:2] * [0, 1]).ravel(), 0.0, motion.duration))
        costs.append(_cost(motion, k, axis, taken))
        tables.append(table)
        steps.append(frozen(taken))
    times = np.sort(np.concatenate(knots))
    # between two knots an axis stays on one part of its table; at a knot only the time tells on which
    middle = motion.at((times[:-1] + times[1:]) / 2).q - home
    parts = np.zeros(middle.shape, np.intp)
    for k, table in enumerate(tables):
        if table is not None:
            parts[:, k] = np.searchsorted(table[0], middle[:, k], side="right")
    return Compensated(motion, frozen(home), frozen(times), tuple(tables), parts, tuple(steps), tuple(costs))


def _table(axis: Axis) -> Array | None:
    """(2, N) true positions from home, and what is counted there."""
    if axis.lead_error is None:
        return None
    counted, error = np.array(axis.lead_error).T
    true = counted + error
    if not (np.diff(true) > 0).all():
        raise MotionError(
            f"axis {axis.name}: its lead error falls by more than the way between two points: "
            "nothing that it counts leads through there; mend the table"
        )
    return frozen(np.stack([true, counted]))


def _screwed(values: Array, home: float, table: Array, part: NDArray[np.intp]) -> Array:
    """q and its derivatives (4, N) -> the same of what is counted; past either end the error stays as it is there.

    part (N,): 0 before the first point of the table, n behind its n-th.
    """
    true, counted = table
    slope = np.concatenate([[1.0], np.diff(counted) / np.diff(true), [1.0]])
    start = np.maximum(part - 1, 0)
    out: Array = values * slope[part]
    out[0] = home + counted[start] + (values[0] - home - true[start]) * slope[part]
    return out


def _crossings(stretches: Stretches, points: Array) -> Array:
    """Every time at which a motion comes by one of the points."""
    ends = stretches.ends
    low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
    index, which = np.nonzero((low[:, None] <= points) & (points <= high[:, None]) & (low < high)[:, None])
    sign = np.where(ends[1:] > ends[:-1], 1.0, -1.0)
    height = (points[which] - ends[index]) * sign[index]
    share, _ = solve(stretches.coefficients[1:] * sign, index, height, np.full(len(sign), NEAR))
    found: Array = stretches.start[index] + share * stretches.length[index]
    return found


def _take_up(stretches: Stretches, axis: Axis, duration: float) -> Array:
    """(R, 3) start (s), time (s) and way (m or rad) of every crossing of the play, none over another."""
    needed = max(
        STEEP * axis.backlash / min(sides(axis.max_speed)),
        np.sqrt(CURVED * axis.backlash / min(sides(axis.max_acceleration))),
    )
    turns = _turns(stretches, axis.pulse / 2)
    steps = []
    for n, (arrives, leaves, way) in enumerate(turns):
        before = (arrives + turns[n - 1][1]) / 2 if n else 0.0
        after = (leaves + turns[n + 1][0]) / 2 if n + 1 < len(turns) else duration
        time = min(needed or TAKE_UP, after - before)
        first = arrives if leaves - arrives >= time else (arrives + leaves - time) / 2
        steps.append((min(max(first, before), after - time), time, way * axis.backlash))
    return np.array(steps).reshape(-1, 3)


def _turns(stretches: Stretches, least: float) -> list[tuple[float, float, float]]:
    """When an axis comes to a turn, when it leaves it, and which way; runs shorter than `least` turn nothing."""
    ends, start = stretches.ends, stretches.start
    stop = start + stretches.length
    turns: list[tuple[float, float, float]] = []
    way, extreme, reached, left = 1.0, float(ends[0]), float(start[0]), float(start[0])
    for k in np.flatnonzero(np.diff(ends)).tolist():
        x = float(ends[k + 1])
        if (x - extreme) * way > 0:
            extreme, reached, left = x, float(stop[k]), float(stop[k])
            continue
        if left == reached:  # the first stretch away from the extreme
            left = max(left, float(start[k]))
        if (extreme - x) * way >= least:
            way = -way
            turns.append((reached, left, way))
            extreme, reached, left = x, float(stop[k]), float(stop[k])
    return turns


def _taken_up(steps: Array, t: Array) -> Array:
    """(4, N) the play that is taken up at instants t and its first three derivatives."""
    start, time, way = steps.T
    n = np.searchsorted(start, t, side="right") - 1
    known = np.maximum(n, 0)
    u = np.where(n < 0, 0.0, np.clip((t - start[known]) / time[known], 0.0, 1.0))
    moving = (n >= 0) & (t < start[known] + time[known])
    h = time[known]
    before = np.concatenate([[0.0], np.cumsum(way)])[known]
    out = np.stack(
        [
            u**3 * (10 - 15 * u + 6 * u**2),
            30 * u**2 * (1 - u) ** 2 / h,
            60 * u * (1 - u) * (1 - 2 * u) / h**2,
            60 * (1 - 6 * u + 6 * u**2) / h**3,
        ]
    )
    out *= np.where(moving | (np.arange(4) == 0)[:, None], way[known], 0.0)
    out[0] += before
    return np.asarray(np.where(n < 0, 0.0, out))


def _cost(motion: Motion, k: int, axis: Axis, steps: Array) -> Compensation:
    """By how far the axis is off while its motor crosses the play, and what that asks of the motor besides."""
    if not len(steps):
        return Compensation(axis.name, axis.compensate, 0, 0.0, 0.0, 0.0)
    start, time = steps[:, 0], steps[:, 1]
    t = start[:, None] + time[:, None] * np.linspace(0, 1, 17)
    q = motion.at(t.ravel()).q[:, k].reshape(t.shape)
    off = float(np.ptp(q, axis=1).max())
    return Compensation(
        axis.name,
        axis.compensate,
        len(steps),
        off,
        float((STEEP * axis.backlash / time).max()),
        float((CURVED * axis.backlash / time**2).max()),
    )
