"""Taking up play: when a motor crosses it, and how gently, so that it keeps to what its axis' limits leave."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinematics.array import Array, frozen
from kinematics.axis import Axis, Magnitude, sides
from kinematics.units import at_least
from planner.place import Infeasible, Place
from planner.pulses.motion import Motion
from planner.pulses.schedule import Compensation
from planner.pulses.stretches import Stretches
from planner.pulses.turns import turning_points

# s that the play takes where the axis states no limits.
TAKE_UP = 0.01
# Peak speed, acceleration (10/√3, at the places PEAKS) and jerk of the smooth step 10 u³ - 15 u⁴ + 6 u⁵, whose ends are
# at rest to acceleration.
STEEP, CURVED, JERKED = 1.875, 10 / np.sqrt(3), 60.0
PEAKS = (0.5 - np.sqrt(3) / 6, 0.5, 0.5 + np.sqrt(3) / 6)
# Where a step is looked at, beside the knots of the motion.
LOOKED = np.union1d(np.linspace(0, 1, 65), PEAKS)
# Instants looked at together: a state holds far more than what is kept of it.
BLOCK = 1 << 14
# Factor by which a step that asks too much is made longer, while there is room.
LONGER = 1.1
# What an advised rest is longer by than the least: its ends are known to rounding.
SAFE = 1e-9
# Where an acceleration that suffices is looked for: up to so many times what is stated, and to what share.
MOST, CLOSE = 1000, 1e-4
# A limit holds up to here, as in the certificate.
SLACK = 1 + 1e-6


def take_up(motion: Motion, k: int, axis: Axis, stretches: Stretches) -> tuple[Array, Compensation]:
    """(R, 3) start (s), time (s) and way (m or rad) of every crossing of the play of axis k, and what that costs.

    Motion and take-up together keep max_speed, the pulse rate and take_up_acceleration (None: max_acceleration), as
    `LOOKED` at and at the knots of the motion. In a rest a step takes the least time in which it keeps them, and jerk
    where there is time. Where the axis turns without a rest it is made longer until it fits, as long as the axis is off
    by less than the play meanwhile (not to make up for it costs no more), and at most half-way to the next turn: jerk
    is told there, not kept, for the time that it needs would leave the axis off by more. A screw's table is in the
    speed, not in the acceleration.
    Raises Infeasible where a step fits at no length: a motion that is at its limit while it turns has no room for any.
    """
    turns, unturned = turning_points(stretches, axis)
    if not turns:
        none = Compensation(axis.name, axis.compensate, unturned=unturned)
        return frozen(np.empty((0, 3))), none
    turning = np.array(turns)
    steps, best = _fitted(motion, k, axis, turning)
    seen = _seen(motion, k, axis, steps, turning[:, 0])
    if best.max() > SLACK:
        _refuse(motion, k, axis, turning, seen)
    (speed, most_speed, _), (acceleration, most, _) = seen.largest(axis)
    most_off = float(seen.off(len(steps)).max())
    jerk = float(JERKED * axis.backlash / steps[:, 1].min() ** 3)
    figures = most_off, unturned, speed, most_speed, acceleration, most, jerk
    windows = tuple((begin, begin + span) for begin, span, _ in steps.tolist())
    return frozen(steps), Compensation(axis.name, axis.compensate, len(steps), *figures, windows)


def _fitted(motion: Motion, k: int, axis: Axis, turns: Array) -> tuple[Array, Array]:
    """(R, 3) the steps about turns (R, 3), and the largest share (R,) of its limits that each takes."""
    arrives, leaves, way = turns.T
    before = np.append(0.0, (arrives[1:] + leaves[:-1]) / 2)
    after = np.append(before[1:], motion.duration)
    gentle = float(np.cbrt(JERKED * axis.backlash / min(sides(axis.max_jerk))))
    time = np.minimum(_alone(axis) or TAKE_UP, after - before)
    time = np.maximum(time, np.where(leaves - arrives >= gentle, gentle, 0.0))
    steps, best = np.empty((len(turns), 3)), np.full(len(turns), np.inf)
    todo = np.arange(len(turns))
    while len(todo):
        span = time[todo]
        middle = (arrives[todo] + leaves[todo] - span) / 2
        start = np.where(leaves[todo] - arrives[todo] >= span, arrives[todo], middle)
        start = np.minimum(np.maximum(start, before[todo]), after[todo] - span)
        tried = np.stack([start, span, way[todo] * axis.backlash], 1)
        seen = _seen(motion, k, axis, tried, arrives[todo])
        share, off = seen.share(axis, len(todo)), seen.off(len(todo))
        better = (share < best[todo]) & ((off <= axis.backlash) | np.isinf(best[todo]))
        steps[todo[better]], best[todo[better]] = tried[better], share[better]
        todo = todo[(best[todo] > SLACK) & (off < axis.backlash) & (span < after[todo] - before[todo])]
        time[todo] = np.minimum(time[todo] * LONGER, after[todo] - before[todo])
    return steps, best


def taken_up(steps: Array, t: Array) -> Array:
    """(4, N) the play that is taken up at instants t and its first three derivatives."""
    start, time, way = steps.T
    n = np.searchsorted(start, t, side="right") - 1
    known = np.maximum(n, 0)
    u = np.where(n < 0, 0.0, np.clip((t - start[known]) / time[known], 0.0, 1.0))
    moving = (n >= 0) & (t < start[known] + time[known])
    out = _step(u, time[known])
    out *= np.where(moving | (np.arange(4) == 0)[:, None], way[known], 0.0)
    out[0] += np.concatenate([[0.0], np.cumsum(way)])[known]
    return np.asarray(np.where(n < 0, 0.0, out))


def _step(u: Array, h: Array) -> Array:
    """(4, N) the smooth step from 0 to 1 in time h, at u of it, and its first three derivatives."""
    return np.stack(
        [
            u**3 * (10 - 15 * u + 6 * u**2),
            30 * u**2 * (1 - u) ** 2 / h,
            60 * u * (1 - u) * (1 - 2 * u) / h**2,
            60 * (1 - 6 * u + 6 * u**2) / h**3,
        ]
    )


def _bounds(axis: Axis) -> tuple[Magnitude | None, Magnitude | None]:
    """Of the motor's speed and acceleration while it crosses the play."""
    unloaded, pulses = axis.take_up_acceleration, axis.pulse_rate * axis.pulse
    below, above = (min(side, pulses) for side in sides(axis.max_speed))
    speed = None if np.isinf([below, above]).all() else (below, above)
    return speed, axis.max_acceleration if unloaded is None else unloaded


def _alone(axis: Axis) -> float:
    """s in which a step from rest to rest keeps the limits of speed and acceleration; 0 where there are none."""
    speed, acceleration = _bounds(axis)
    return max(
        STEEP * axis.backlash / min(sides(speed)),
        float(np.sqrt(CURVED * axis.backlash / min(sides(acceleration)))),
    )


@dataclass(frozen=True, slots=True)
class _Seen:
    """Where steps were looked at: which step (M,), when, the axis' place, and its motor's speed and acceleration."""

    step: NDArray[np.intp]
    t: Array
    q: Array
    rates: tuple[Array, Array]

    def share(self, axis: Axis, count: int) -> Array:
        """(count,) the largest share of its limits that each step takes."""
        share = np.zeros(count)
        for rate, bound in zip(self.rates, _bounds(axis), strict=True):
            np.maximum.at(share, self.step, abs(rate) / _side(rate, bound))
        return share

    def off(self, count: int) -> Array:
        """(count,) m or rad of the axis' way during each step: it stays within that of where it should be."""
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, self.step, self.q)
        np.maximum.at(high, self.step, self.q)
        return np.asarray(high - low)

    def largest(self, axis: Axis) -> list[tuple[float, float | None, float]]:
        """Of speed and acceleration: the one nearest to its limit (the largest where it has none), that, and when."""
        found = []
        for rate, bound in zip(self.rates, _bounds(axis), strict=True):
            limit = _side(rate, bound)
            n = int(np.argmax(abs(rate) if bound is None else abs(rate) / limit))
            found.append((float(abs(rate[n])), None if bound is None else float(limit[n]), float(self.t[n])))
        return found


def _side(rate: Array, bound: Magnitude | None) -> Array:
    below, above = sides(bound)
    return np.where(rate > 0, above, below)


def _seen(motion: Motion, k: int, axis: Axis, steps: Array, turn: Array) -> _Seen:
    """Steps as `LOOKED` at, when the axis turns, and on both sides of the knots that lie in them: there q̈ may jump."""
    knots = np.asarray(motion.knots)
    start, time, way = steps.T
    first, last = np.searchsorted(knots, start), np.searchsorted(knots, start + time, side="right")
    inside = np.repeat(np.arange(len(steps)), last - first)
    ordinal = np.arange(len(inside)) - np.repeat(np.cumsum(last - first) - (last - first), last - first)
    at = knots[first[inside] + ordinal]
    every, turns = np.arange(len(steps)), np.clip(turn, start, start + time)
    step = np.concatenate([np.repeat(every, len(LOOKED)), every, inside, inside])
    t = np.concatenate([(start[:, None] + time[:, None] * LOOKED).ravel(), turns, at, np.nextafter(at, -np.inf)])
    t = np.clip(t, 0.0, motion.duration)
    q, qd, qdd = np.concatenate([_of_axis(motion, k, t[i : i + BLOCK]) for i in range(0, len(t), BLOCK)], axis=1)
    u = np.clip((t - start[step]) / time[step], 0.0, 1.0)
    made = _step(u, time[step]) * way[step]
    # the motor's speed on the steepest and the gentlest part of its screw's table, whichever is faster
    steep, gentle = qd * axis.motor_ratio + made[1], qd / axis.axis_ratio + made[1]
    return _Seen(step, t, q, (np.where(abs(steep) > abs(gentle), steep, gentle), qdd + made[2]))


def _of_axis(motion: Motion, k: int, t: Array) -> Array:
    state = motion.at(t)
    return np.stack([state.q[:, k], state.qd[:, k], state.qdd[:, k]])


def _refuse(motion: Motion, k: int, axis: Axis, turns: Array, seen: _Seen) -> None:
    """Raise Infeasible for the larger excess of speed and acceleration."""
    names = ("speed", f"{axis.unit}/s"), ("acceleration", f"{axis.unit}/s^2")
    found = zip(seen.largest(axis), names, strict=True)
    told = [(value / limit, value, limit, t, *name) for (value, limit, t), name in found if limit]
    _, value, limit, t, name, unit = max(told)
    place = Place(float(motion.at(np.array([t])).s[0]), t=t, axis=axis.name)
    rest = at_least(_alone(axis) * (1 + SAFE))
    arrives, _, way = turns[np.argmin(abs(turns[:, 0] - t))]
    if arrives == 0:  # the play is on the other side before anything moves
        side = "-" if way < 0 else "+"
        where = (
            f'before {axis.name} first moves: let the program begin with a dwell of {rest} s, state pushed = "{side}"'
        )
        where += " if that is the side on which it was homed"
    else:
        where = f"where {axis.name} turns: let it rest there for {rest} s (a dwell)"
    enough = _enough(motion, k, axis, turns)
    state = (
        ""
        if enough is None
        else f", or state a take_up_acceleration of {enough} {axis.unit}/s^2 or more if its motor does that unloaded"
    )
    remedy = (
        f"the motion leaves too little for the {1e6 * axis.backlash:.4g} µ{axis.unit} of play {where}, or go slower "
        f"there{state}"
    )
    raise Infeasible(f"{name} with play taken up", axis.name, place, value, limit, unit, remedy)


def _enough(motion: Motion, k: int, axis: Axis, turns: Array) -> str | None:
    """The least acceleration of the unloaded motor, to four digits, with which every step fits; None: none helps."""

    def fits(acceleration: float) -> bool:
        _, best = _fitted(motion, k, replace(axis, take_up_acceleration=acceleration), turns)
        return bool(best.max() <= SLACK)

    stated = low = high = min(sides(_bounds(axis)[1]))
    if np.isinf(stated):
        return None
    while not fits(high := 2 * high):
        low = high
        if high > MOST * stated:
            return None
    while high > low * (1 + CLOSE):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if fits(middle) else (middle, high)
    while not fits(float(at_least(high))):  # what suffices need not suffice rounded up: steps are tried at some lengths
        high *= 1 + CLOSE
    return at_least(high)
