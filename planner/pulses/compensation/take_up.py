"""Taking up play: where an axis turns round, when its motor crosses the play, and how gently, so
that it keeps to what its axis' limits leave.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import round_up_digits
from kinematics.machine.axis import Axis, Magnitude, directional_bounds
from planner.place import Infeasible, Place
from planner.pulses.compensation.play import Play, TurnSearch
from planner.pulses.generation.pieces import Stretches
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import Compensation

# s that the play takes where the axis states no limits.
DEFAULT_TAKE_UP_TIME = 0.01
# Peak speed, acceleration (10/√3, at the places PEAK_SHARES) and jerk of the smooth step 10 u³ - 15
# u⁴ + 6 u⁵, whose ends are at rest to acceleration.
PEAK_SPEED, PEAK_ACCELERATION, PEAK_JERK = 1.875, 10 / np.sqrt(3), 60.0
PEAK_SHARES = (0.5 - np.sqrt(3) / 6, 0.5, 0.5 + np.sqrt(3) / 6)
# Where a step is looked at, beside the knots of the motion.
STEP_SHARES = np.union1d(np.linspace(0, 1, 65), PEAK_SHARES)
# Instants looked at together: a state holds far more than what is kept of it.
BLOCK_INSTANTS = 1 << 14
# Factor by which a step that asks too much is made longer, while there is room.
STEP_GROWTH = 1.1
# What an advised rest is longer by than the least: its ends are known to rounding.
REST_MARGIN = 1e-9
# Times as long as a step may be for an axis' limits alone waits what the motors do, where the
# motion goes on.
HELD_STEPS = 8
# Where an acceleration that suffices is looked for: up to so many times what is stated, and to what
# share.
MAX_ACCELERATION_FACTOR, ACCELERATION_TOLERANCE = 1000, 1e-4
# Halvings of a stretch in which an axis comes back to a place: its time is then known to rounding.
RETURN_HALVINGS = 40
# Stretches that are looked at together for that: nearly always the first contains the place.
RETURN_BLOCK = 16
# A limit holds up to here, as in the certificate.
LIMIT_SLACK = 1 + 1e-6


def take_up(
    motion: AxesMotion,
    k: int,
    axis: Axis,
    stretches: Stretches,
    noise: float,
    play: Play,
    since: float,
    last: bool,
) -> tuple[Play, float, Compensation]:
    """Axis k in its play at the end of a motion that goes on from `play`, what is final of that,
    and what it costs.

    since: s, up to which `play` has looked. Its steps are those of the motion; before the time (s)
    given with them nothing will change; where the motion goes on, some time before its end, or
    before where the axis left an extreme to which it may come back. last: the motion ends.

    Motion and take-up together keep max_speed, the pulse rate and take_up_acceleration (None:
    max_acceleration), as seen at `STEP_SHARES` and at the knots of the motion. In a rest a step
    takes the least time in which it keeps them, and jerk where there is time, right before the axis
    leaves. Where the axis turns without a rest it is made longer until it fits, as long as the axis
    is off by less than the play meanwhile (not to make up for it costs no more), and at most
    half-way to the next turn: jerk is told there, not kept, for the time that it needs would leave
    the axis off by more. A screw's table is in the speed, not in the acceleration. Raises
    Infeasible where a step fits at no length: a motion that is at its limit while it turns has no
    room for any.
    """
    found, search = play.search.find(stretches, axis, noise, since)
    turns = [*play.waiting, *found]
    none = Compensation(
        axis.name, axis.compensate, unturned=search.unturned if not last else _unturned(search)
    )
    play = replace(play, search=search, waiting=())
    hold = HELD_STEPS * max(_unloaded_step_time(axis) or DEFAULT_TAKE_UP_TIME, _gentle_time(axis))
    until = motion.duration if last else (search.left if search.gone else motion.duration) - hold
    if not turns:
        return play, max(0.0, until), none
    turning = np.array(turns)
    arrives, leaves, _ = turning.T
    first = max((start + span for start, span, _ in play.steps), default=0.0)
    first = first if play.left is None else max(first, (arrives[0] + play.left) / 2)
    before = np.append(first, (arrives[1:] + leaves[:-1]) / 2)
    after = np.append(before[1:], motion.duration if last else (motion.duration + leaves[-1]) / 2)
    steps, best = _fit_steps(motion, k, axis, turning, before, after)
    returns = _find_returns(motion, k, steps, stretches)
    if not last:
        is_known = best[-1] <= LIMIT_SLACK and steps[-1, :2].sum() < after[-1]
        # From the first of the other steps on, the axis is not yet back where the step began.
        known = min(len(steps) - (not is_known), int(np.searchsorted(returns, motion.duration)))
        if known < len(steps):
            play = replace(play, waiting=tuple(turns[known:]))
            until = min(until, leaves[known] - hold)
        turning, steps, best, returns = (
            turning[:known],
            steps[:known],
            best[:known],
            returns[:known],
        )
    if not len(steps):
        return play, max(0.0, until), none
    seen = _sample_steps(motion, k, axis, steps, turning[:, 0])
    if best.max() > LIMIT_SLACK:
        _refuse(motion, k, axis, turning, seen, (before, after))
    (speed, most_speed, _), (acceleration, most, _) = seen.largest(axis)
    most_off = float(seen.step_travel(len(steps)).max())
    jerk = float(PEAK_JERK * axis.backlash / steps[:, 1].min() ** 3)
    figures = most_off, none.unturned, speed, most_speed, acceleration, most, jerk
    windows = tuple(zip(steps[:, 0].tolist(), returns.tolist(), strict=True))
    cost = Compensation(axis.name, axis.compensate, len(steps), *figures, windows)
    made = (*play.steps, *((start, span, way) for start, span, way in steps.tolist()))
    return replace(play, steps=made, left=float(turning[-1, 1])), max(0.0, until), cost


def refuse_carried(motion: AxesMotion, k: int, axis: Axis, play: Play) -> None:
    """Raise MotionError where a step that another motion began does not keep the limits of axis k
    in this one, or is not over with it.
    """
    if not play.steps:
        return
    over = max(start + span for start, span, _ in play.steps)
    seen = _sample_steps(motion, k, axis, np.array(play.steps), np.zeros(len(play.steps)))
    share = float(seen.share(axis, len(play.steps)).max())
    if over > motion.duration or share > LIMIT_SLACK:
        why = "would not keep its limits" if share > LIMIT_SLACK else "would not be over"
        raise MotionError(
            f"axis {axis.name}: its motor is in the midst of crossing the play, and {why} in the motion that goes on: "
            f"choose an instant {over:.6f} s later"
        )


def _unturned(search: TurnSearch) -> float:
    return max(search.unturned, search.farthest)


def _gentle_time(axis: Axis) -> float:
    """s in which a step keeps the axis' jerk."""
    return float(np.cbrt(PEAK_JERK * axis.backlash / min(directional_bounds(axis.max_jerk))))


def _fit_steps(
    motion: AxesMotion, k: int, axis: Axis, turns: Array, before: Array, after: Array
) -> tuple[Array, Array]:
    """(R, 3) the steps about turns (R, 3), each from `before` to `after` (R,) at most, and the
    largest share (R,) of its limits that each takes.
    """
    arrives, leaves, way = turns.T
    gentle = _gentle_time(axis)
    time = np.minimum(_unloaded_step_time(axis) or DEFAULT_TAKE_UP_TIME, after - before)
    time = np.maximum(time, np.where(leaves - arrives >= gentle, gentle, 0.0))
    steps, best = np.empty((len(turns), 3)), np.full(len(turns), np.inf)
    todo = np.arange(len(turns))
    while len(todo):
        span = time[todo]
        middle = (arrives[todo] + leaves[todo] - span) / 2
        start = np.where(leaves[todo] - arrives[todo] >= span, leaves[todo] - span, middle)
        start = np.minimum(np.maximum(start, before[todo]), after[todo] - span)
        tried = np.stack([start, span, way[todo] * axis.backlash], 1)
        seen = _sample_steps(motion, k, axis, tried, arrives[todo])
        share, off = seen.share(axis, len(todo)), seen.step_travel(len(todo))
        better = (share < best[todo]) & ((off <= axis.backlash) | np.isinf(best[todo]))
        steps[todo[better]], best[todo[better]] = tried[better], share[better]
        todo = todo[
            (best[todo] > LIMIT_SLACK) & (off < axis.backlash) & (span < after[todo] - before[todo])
        ]
        time[todo] = np.minimum(time[todo] * STEP_GROWTH, after[todo] - before[todo])
    return steps, best


def _find_returns(motion: AxesMotion, k: int, steps: Array, stretches: Stretches) -> Array:
    """Return the time (R,) s from which on each step (R, 3) leaves axis k where it should be.

    The motor pushes the axis until the step begins, and from its end on. The axis stays at the
    place of the beginning until it comes back there, which may be after the end of the step.
    """
    begin, span, way = steps.T
    ends = begin + span
    places = motion.at(np.concatenate([begin, ends])).q[:, k]
    level, end_places = np.split(places, 2)
    stops = np.append(stretches.start + stretches.length, motion.duration)

    def is_back(n: int, t: Array) -> NDArray[np.bool_]:
        return np.asarray((motion.at(t).q[:, k] - level[n]) * way[n] >= 0)

    for n in np.flatnonzero((end_places - level) * way < 0).tolist():
        low = high = float(ends[n])
        first = int(np.searchsorted(stops, low, side="right"))
        for m in range(first, len(stops), RETURN_BLOCK):
            later = stops[m : m + RETURN_BLOCK]
            back = is_back(n, later)
            if back.any():
                last = m + int(back.argmax())
                if last > first:
                    low = float(stops[last - 1])
                high = float(stops[last])
                break
        else:
            ends[n] = motion.duration
            continue
        for _ in range(RETURN_HALVINGS):  # the axis goes one way between two stops
            middle = (low + high) / 2
            if is_back(n, np.array([middle]))[0]:
                high = middle
            else:
                low = middle
        ends[n] = high
    return np.asarray(np.maximum.accumulate(ends))


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
    below, above = (min(side, pulses) for side in directional_bounds(axis.max_speed))
    speed = None if np.isinf([below, above]).all() else (below, above)
    return speed, axis.max_acceleration if unloaded is None else unloaded


def _unloaded_step_time(axis: Axis) -> float:
    """s in which a step from rest to rest keeps the limits of speed and acceleration; 0 where there
    are none.
    """
    speed, acceleration = _bounds(axis)
    return max(
        PEAK_SPEED * axis.backlash / min(directional_bounds(speed)),
        float(np.sqrt(PEAK_ACCELERATION * axis.backlash / min(directional_bounds(acceleration)))),
    )


@dataclass(frozen=True, slots=True)
class _StepSamples:
    """Where steps were looked at: which step (M,), when, the axis' place, and its motor's speed and
    acceleration.
    """

    step: NDArray[np.intp]
    t: Array
    q: Array
    rates: tuple[Array, Array]

    def share(self, axis: Axis, count: int) -> Array:
        """(count,) the largest share of its limits that each step takes."""
        share = np.zeros(count)
        for rate, bound in zip(self.rates, _bounds(axis), strict=True):
            np.maximum.at(share, self.step, abs(rate) / _side_bound(rate, bound))
        return share

    def step_travel(self, count: int) -> Array:
        """(count,) m or rad of the axis' way during each step: it stays within that of where it
        should be.
        """
        low, high = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(low, self.step, self.q)
        np.maximum.at(high, self.step, self.q)
        return np.asarray(high - low)

    def largest(self, axis: Axis) -> list[tuple[float, float | None, float]]:
        """Of speed and acceleration: the one nearest to its limit (the largest where it has none),
        that, and when.
        """
        found = []
        for rate, bound in zip(self.rates, _bounds(axis), strict=True):
            limit = _side_bound(rate, bound)
            n = int(np.argmax(abs(rate) if bound is None else abs(rate) / limit))
            found.append(
                (float(abs(rate[n])), None if bound is None else float(limit[n]), float(self.t[n]))
            )
        return found


def _side_bound(rate: Array, bound: Magnitude | None) -> Array:
    below, above = directional_bounds(bound)
    return np.where(rate > 0, above, below)


def _sample_steps(
    motion: AxesMotion, k: int, axis: Axis, steps: Array, turn: Array
) -> _StepSamples:
    """Steps as `STEP_SHARES` at, when the axis turns, and on both sides of the knots that lie in
    them: there q̈ may jump.
    """
    knots = np.asarray(motion.knots)
    start, time, way = steps.T
    first, last = np.searchsorted(knots, start), np.searchsorted(knots, start + time, side="right")
    inside = np.repeat(np.arange(len(steps)), last - first)
    ordinal = np.arange(len(inside)) - np.repeat(
        np.cumsum(last - first) - (last - first), last - first
    )
    at = knots[first[inside] + ordinal]
    every, turns = np.arange(len(steps)), np.clip(turn, start, start + time)
    step = np.concatenate([np.repeat(every, len(STEP_SHARES)), every, inside, inside])
    t = np.concatenate(
        [
            (start[:, None] + time[:, None] * STEP_SHARES).ravel(),
            turns,
            at,
            np.nextafter(at, -np.inf),
        ]
    )
    t = np.clip(t, 0.0, motion.duration)
    q, qd, qdd = np.concatenate(
        [
            _axis_state(motion, k, t[i : i + BLOCK_INSTANTS])
            for i in range(0, len(t), BLOCK_INSTANTS)
        ],
        axis=1,
    )
    u = np.clip((t - start[step]) / time[step], 0.0, 1.0)
    made = _step(u, time[step]) * way[step]
    # the motor's speed on the steepest and the gentlest part of its screw's table, whichever is
    # faster
    steep, gentle = qd * axis.motor_ratio + made[1], qd / axis.axis_ratio + made[1]
    return _StepSamples(
        step, t, q, (np.where(abs(steep) > abs(gentle), steep, gentle), qdd + made[2])
    )


def _axis_state(motion: AxesMotion, k: int, t: Array) -> Array:
    state = motion.at(t)
    return np.stack([state.q[:, k], state.qd[:, k], state.qdd[:, k]])


def _refuse(
    motion: AxesMotion,
    k: int,
    axis: Axis,
    turns: Array,
    seen: _StepSamples,
    room: tuple[Array, Array],
) -> None:
    """Raise Infeasible for the larger excess of speed and acceleration."""
    names = ("speed", f"{axis.unit}/s"), ("acceleration", f"{axis.unit}/s^2")
    found = zip(seen.largest(axis), names, strict=True)
    told = [(value / limit, value, limit, t, *name) for (value, limit, t), name in found if limit]
    _, value, limit, t, name, unit = max(told)
    place = Place(float(motion.at(np.array([t])).s[0]), t=t, axis=axis.name)
    rest = round_up_digits(_unloaded_step_time(axis) * (1 + REST_MARGIN))
    arrives, _, way = turns[np.argmin(abs(turns[:, 0] - t))]
    if arrives == 0:  # the play is on the other side before anything moves
        side = "-" if way < 0 else "+"
        where = f'before {axis.name} first moves: start the program with a dwell of {rest} s, state pushed = "{side}"'
        where += " if that is the side on which it was homed"
    else:
        where = f"where {axis.name} turns: let it rest there for {rest} s (a dwell)"
    enough = _find_acceleration(motion, k, axis, turns, room)
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


def _find_acceleration(
    motion: AxesMotion, k: int, axis: Axis, turns: Array, room: tuple[Array, Array]
) -> str | None:
    """The least acceleration of the unloaded motor, to four digits, with which every step fits;
    None: none helps.
    """

    spans = tuple(side[: len(turns)] for side in room)

    def fits(acceleration: float) -> bool:
        _, best = _fit_steps(
            motion, k, replace(axis, take_up_acceleration=acceleration), turns, *spans
        )
        return bool(best.max() <= LIMIT_SLACK)

    stated = low = high = min(directional_bounds(_bounds(axis)[1]))
    if np.isinf(stated):
        return None
    while not fits(high := 2 * high):
        low = high
        if high > MAX_ACCELERATION_FACTOR * stated:
            return None
    while high > low * (1 + ACCELERATION_TOLERANCE):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if fits(middle) else (middle, high)
    while not fits(
        float(round_up_digits(high))
    ):  # what suffices need not suffice rounded up: steps are tried at some lengths
        high *= 1 + ACCELERATION_TOLERANCE
    return round_up_digits(high)
