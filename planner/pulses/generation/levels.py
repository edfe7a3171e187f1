"""Pulses where a motion crosses evenly spaced levels, at the true crossing times rounded to whole
ticks.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import ceil

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.polynomials import derivative, solve_heights
from kinematics.foundation.units import format_distinct
from kinematics.machine.axis import Axis
from planner.parallel import Progress, share_progress
from planner.place import Infeasible, Place
from planner.pulses.generation.motion_parts import Fired, MotionPart
from planner.pulses.generation.pieces import (
    FIT_TOLERANCE,
    UNSEEN_FACTOR,
    X_ROUNDING,
    Stretches,
    cut_monotone,
    fit,
)
from planner.pulses.motion import AxesMotion
from planner.pulses.schedule import AxisPulses, Signs, Ticks

BLOCK_PULSES = 1 << 14  # pulses solved together: their arrays stay in the processor's cache
BLOCK_INDICES = freeze_array(np.arange(BLOCK_PULSES, dtype=float))
TICK_ERROR = 1e-4  # of a crossing time before it is rounded to a whole tick
MAX_COUNT_BLUR = 1e-3  # of a pulse: rounding may not blur a count by more
NEWTON_STEPS = 5  # looks at the motion itself, each a Newton step from the one before
POLISHED_TICKS = 1e-6  # ticks: a step that no longer matters

REAL_JUMP = 1e-3  # pulses: more is no rounding where a part goes on from another

Refuse = Callable[[], Infeasible]
Exact = Callable[[Array, Array], Array]


@dataclass(frozen=True, slots=True)
class Levels:
    """One level between each two counts k and k+1, k + above pulses from home.

    hysteresis  pulses: the first pulse after one the other way, and the very first, fires so much
                beyond its level
    """

    above: float
    hysteresis: float = 0.0

    @property
    def bound(self) -> float:
        """Pulses by which x may be from the count before a pulse fires."""
        return max(self.above, 1 - self.above) + self.hysteresis


def find_crossings(part: MotionPart, levels: Levels) -> Fired:
    """A pulse of every axis wherever x = (q(t) - home)/pulse crosses a level, on the nearest tick.

    - A level counts as crossed once the motion is beyond it by more than rounding noise (some 1e-9
      pulse); a motion that only touches a level, or rests or ends on it, does not fire. One that
      starts on a level has the lower count.
    - Two opposite pulses whose crossings round to the same tick cancel: both are left out.
    - A part goes on with the count of the one before: what rounding makes of x where they meet
      fires nothing. Where it begins beyond a level, as behind pulses that were moved, its start is
      the count behind that.
    The part is told the pulses that are made of an axis, each a share of the whole.
    Raises Infeasible where an axis needs more than one pulse per tick, MotionError where rounding
    drowns one.
    """
    motion, axes, home, clock_hz = part.motion, part.axes, part.home, part.clock_hz
    begin, rest = part.split_tick()
    pulse = np.array([axis.pulse for axis in axes])
    pieces = fit(motion, FIT_TOLERANCE * pulse)
    noise = np.maximum(pieces.noise, part.noise) if part.noise else pieces.noise
    slack = (noise + X_ROUNDING * abs(home)) / pulse
    fired, ways = [], []
    for k, axis in enumerate(axes):
        if slack[k] > MAX_COUNT_BLUR:
            blur, most = format_distinct(slack[k], MAX_COUNT_BLUR, digits=2)
            raise MotionError(
                f"axis {axis.name}: pulse {axis.pulse:.3g} {axis.unit} is blurred by {blur} pulse of "
                f"rounding, limit {most}; use a longer pulse or count from nearer than "
                f"{abs(home[k]):.3g} {axis.unit}"
            )
        counted = pieces.coefficients[k].copy()
        counted[0] -= home[k]
        if part.counts:
            _refuse_jump(part, k, float(counted[0, 0]) / axis.pulse, levels)
        stretches = cut_monotone(
            rest + pieces.start * clock_hz, pieces.length * clock_hz, counted / pulse[k], slack[k]
        )
        count, way = (part.counts[k], part.ways[k]) if part.counts else (None, 0)
        if count is not None:
            count, way = _settle(float(stretches.ends[0]), slack[k], levels, count, way)
        counts = _follow_levels(stretches.ends, slack[k], levels, count, way)
        refuse = partial(_rate_error, motion, axis, stretches, clock_hz)
        exact = partial(_polish_crossings, part, k)
        blur = UNSEEN_FACTOR * pieces.error[k] / pulse[k] + slack[k]
        made = _fire_pulses(
            stretches,
            counts,
            levels,
            way,
            refuse,
            exact,
            blur,
            share_progress(part.tell, k, len(axes)),
        )
        ways.append(int(made[1][-1]) if len(made[1]) else way)
        ticks, direction = cancel_pairs(*made, refuse)
        ticks += begin
        ticks.flags.writeable = direction.flags.writeable = False
        fired.append(
            AxisPulses(
                axis.name,
                ticks,
                direction,
                int(counts[0]),
                axis.pulse,
                float(home[k]),
                levels.bound,
            )
        )
    return Fired(tuple(fired), tuple(ways), tuple(noise.tolist()))


def _rate_error(
    trajectory: AxesMotion, axis: Axis, stretches: Stretches, clock_hz: int
) -> Infeasible:
    """More than one pulse per tick: named where the rate is highest."""
    v = np.linspace(0.0, 1.0, 33)
    rate = (
        abs(derivative(stretches.coefficients).T @ v ** np.arange(5)[:, None])
        / stretches.length[:, None]
    )
    worst, nth = np.unravel_index(rate.argmax(), rate.shape)
    t = (
        float(stretches.start[worst] + stretches.length[worst] * v[nth] - stretches.start[0])
        / clock_hz
    )
    highest = max(float(rate.max()), 1.0) * clock_hz
    place = Place(float(trajectory.at(np.array([t])).s[0]), t=t, axis=axis.name)
    remedy = f"slow the motion, use a longer pulse, or a clock above {ceil(highest)} Hz"
    return Infeasible("pulse rate", axis.name, place, highest, clock_hz, "1/s", remedy)


def _refuse_jump(part: MotionPart, k: int, x: float, levels: Levels) -> None:
    """Raise MotionError where an axis begins a part far from the count that the one before ended
    with.
    """
    off, most = x - part.counts[k], levels.bound + part.slip + REAL_JUMP
    if not abs(off) <= most:
        raise MotionError(
            f"axis {part.axes[k].name}: the part begins {off:.6g} pulses from its count {part.counts[k]}, limit "
            f"{most:.6g}; give the part that goes on from the one before"
        )


def _settle(x: float, slack: float, levels: Levels, count: int, way: int) -> tuple[int, int]:
    """The count at x of an axis that comes with another, and which way it went last then."""
    settled = int(_follow_levels(np.array([x, x]), slack, levels, count, way)[1])
    return settled, way if settled == count else int(np.sign(settled - count))


def _follow_levels(x: Array, slack: float, levels: Levels, count: int | None, way: int) -> Ticks:
    """The count at each end of the stretches: the one it came with, until x is beyond a level by
    more than `slack`.

    count, way: those it begins with, where it goes on from others.
    """
    low = np.ceil(x - levels.above - slack).astype(np.int64)
    high = np.floor(x + 1 - levels.above + slack).astype(np.int64)
    if count is not None:
        low[0] = high[0] = count
    if levels.hysteresis:
        return _follow_with_hysteresis(x, low, high, slack, levels, way)
    counts = low.copy()
    for i in np.flatnonzero(high > low):
        if i > 0 and counts[i - 1] > low[i]:
            counts[i] = high[i]
    return counts


def _follow_with_hysteresis(
    x: Array, low: Ticks, high: Ticks, slack: float, levels: Levels, way: int
) -> Ticks:
    """The same with hysteresis: the first pulse the other way waits until x is so much further
    beyond its level.
    """
    count, counts = int(low[0]), low.copy()
    late = levels.hysteresis + slack
    for i, (here, least, most) in enumerate(
        zip(x.tolist(), low.tolist(), high.tolist(), strict=True)
    ):
        if least > count and (way > 0 or here > count + levels.above + late):
            count, way = least, 1
        elif most < count and (way < 0 or here < count - 1 + levels.above - late):
            count, way = most, -1
        counts[i] = count
    return counts


def _polish_crossings(part: MotionPart, k: int, time: Array, level: Array) -> Array:
    """Crossing times (N,) in ticks by the motion itself, from times that are good but not to the
    tick.
    """
    motion, pulse, home, (_, rest_tick) = (
        part.motion,
        part.axes[k].pulse,
        float(part.home[k]),
        part.split_tick(),
    )
    nearest, least = time.copy(), np.full(len(time), np.inf)
    rest = np.arange(len(time))
    for _ in range(NEWTON_STEPS):
        state = motion.at(np.clip((time - rest_tick) / part.clock_hz, 0.0, motion.duration))
        off = (state.q[:, k] - home) / pulse - level[rest]
        nearer = abs(off) < least[rest]
        nearest[rest[nearer]], least[rest] = time[nearer], np.minimum(abs(off), least[rest])
        with np.errstate(divide="ignore", invalid="ignore"):
            step = off / (state.qd[:, k] / pulse / part.clock_hz)
        moves = (
            nearer & np.isfinite(step) & (abs(step) > POLISHED_TICKS)
        )  # at a turning point the nearest stays
        if not moves.any():
            break
        rest, time = rest[moves], (time - step)[moves]
    return nearest


def _fire_pulses(
    stretches: Stretches,
    counts: Ticks,
    levels: Levels,
    way: int,
    refuse: Refuse,
    exact: Exact,
    blur: float,
    tell: Progress,
) -> tuple[Ticks, Signs]:
    """Tick and direction of every level between the counts at both ends of each stretch; way: of
    the pulse before.

    Where the blur (pulses) of the stretches might turn the rounding to the other tick, `exact`
    decides.
    """
    change = np.diff(counts)
    sign: Ticks = np.sign(change)
    pulses: Ticks = abs(change)
    crowded = pulses > stretches.length + 1
    if crowded.any():  # known before room is made for them
        raise refuse()
    climb = stretches.coefficients[1:] * sign
    lead = np.where(sign > 0, levels.above, 1 - levels.above)  # from the count to its first level
    first = sign * (counts[:-1] - stretches.coefficients[0]) + lead
    late = levels.hysteresis * _find_reversals(sign, way)
    blurred = 2 * blur * stretches.length
    with np.errstate(divide="ignore"):
        tolerance = TICK_ERROR / stretches.length
    ticks = np.empty(pulses.sum(), np.int64)
    doubts: list[tuple[NDArray[np.intp], Array, Array]] = []
    for lo, hi, part, index, nth in _blocks(pulses):
        height = (first[part] + nth).take(index)
        height += BLOCK_INDICES[: hi - lo]
        if levels.hysteresis:
            opening = np.flatnonzero((nth <= 0) & (pulses[part] > 0))
            height[-nth[opening]] += late[part][opening]
        v, slope = solve_heights(climb[:, part], index, height, tolerance[part])
        v *= stretches.length[part].take(index)
        v += stretches.start[part].take(index)
        tick = np.rint(v)
        ticks[lo:hi] = tick
        tick -= v
        np.abs(tick, out=tick)
        np.subtract(0.5 - TICK_ERROR, tick, out=tick)
        tick *= slope
        unsure = np.flatnonzero(tick < blurred[part].take(index))
        if len(unsure):
            stretch = part.start + index[unsure]
            doubts.append(
                (
                    lo + unsure,
                    v[unsure],
                    stretches.coefficients[0, stretch] + sign[stretch] * height[unsure],
                )
            )
        tell(hi, len(ticks))
    if doubts:  # together: the motion tells of a few instants hardly faster than of many
        place, time, level = (np.concatenate(parts) for parts in zip(*doubts, strict=True))
        ticks[place] = np.rint(exact(time, level))
    return ticks, np.repeat(sign.astype(np.int8), pulses)


def _find_reversals(sign: Ticks, way: int) -> NDArray[np.bool_]:
    """(S,) the stretches whose first pulse is the very first of all (way 0), or follows one the
    other way.
    """
    turned = np.zeros(len(sign), bool)
    firing = np.flatnonzero(sign)
    turned[firing] = np.diff(sign[firing], prepend=way) != 0
    return turned


def _blocks(pulses: Ticks) -> Iterator[tuple[int, int, slice, NDArray[np.intp], Ticks]]:
    """Blocks lo to hi of the pulses: their stretches (S,), which of these each is on, and the
    number there of lo (S,).

    That number is negative for the stretches that begin later.
    """
    end = np.cumsum(pulses)
    begin, total = end - pulses, int(end[-1])
    for lo in range(0, total, BLOCK_PULSES):
        hi = min(lo + BLOCK_PULSES, total)
        part = slice(
            int(np.searchsorted(end, lo, side="right")),
            int(np.searchsorted(end, hi, side="left")) + 1,
        )
        inside = np.minimum(end[part], hi) - np.maximum(begin[part], lo)
        yield lo, hi, part, np.repeat(np.arange(len(inside)), inside), lo - begin[part]


def cancel_pairs(ticks: Ticks, direction: Signs, refuse: Refuse) -> tuple[Ticks, Signs]:
    """Leave out the pairs of opposite pulses in one tick: the excursion between them is below one
    tick's travel.
    """
    while True:
        same = np.flatnonzero(ticks[1:] <= ticks[:-1])
        if not len(same):
            return ticks, direction
        opposite = same[direction[same] != direction[same + 1]]
        if not len(opposite):
            raise refuse()
        first = opposite[np.diff(opposite, prepend=-2) > 1]
        kept = np.ones(len(ticks), bool)
        kept[first] = kept[first + 1] = False
        ticks, direction = ticks[kept], direction[kept]
