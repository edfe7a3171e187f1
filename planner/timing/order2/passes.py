"""The largest speeds that rows on s̈ and ṡ² allow, by one pass from the end and one from the start.

The reachability analysis of Pham and Pham, IEEE T-RO 34 (2018), 645, in plain form: the x = ṡ² from which the end can
be reached are an interval at each grid point, from 0 where the end is at rest, since standing still keeps every row.

Of the interval, what a point's own rows say is found for all points at once. What reaching the next one says is, with
u taken out of each pair of lines (Fourier and Motzkin), the least of straight lines in the next point's bound; so the
passes go from point to point by nothing but x ← min(cap, min aₖ x + bₖ).
"""

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel

# A row whose share of s̈ is this small beside the largest at its point bounds ṡ² alone.
NEGLIGIBLE_SHARE = 1e-12
# x from which the search for the highest starts where nothing else bounds it, in a problem scaled to about one.
FAR_SQUARED_SPEED = 1e12
# Share of x up to which a given one may lie beyond what can be: rounding.
ROUNDING = 1e-9
# The least growth along a line: rounding.
MIN_GROWTH = 1e-30


def largest_speeds(
    rows: list[Array],
    ceiling: Array,
    step: Array,
    ends: tuple[float, float] = (0.0, 0.0),
    free: tuple[bool, bool] = (False, False),
) -> Array:
    """x (N+1,), given at both ends, pointwise largest under |a u + b x + c| ≤ 1 and x ≤ ceiling; x grows by 2 u Δs.

    free: the ends at which x is not given but as large as can be, and does not change beside them: there rows may
        vanish, and of an x that falls or rises over an interval by any share nothing would be held in its middle

    rows: a, b, c, each (N+1, m), kept at the start of every interval. Zeros say that nothing gets through.
    """
    first, last = ends
    if any(free):
        return _solve_free_ends(rows, ceiling, step, ends, free)
    lines = _lines(rows, ceiling, step)
    slope, upper, _, ceiling = lines
    lowest, highest = _backward_pass(*lines, step, last, last)
    if last > ceiling[-1] * (1 + ROUNDING) or not _is_within(first, lowest[0], highest[0]):
        return np.zeros(len(step) + 1)
    x = _forward_pass(first, slope, upper, lowest, highest, step)
    x[-1] = last
    return x


def _solve_free_ends(
    rows: list[Array], ceiling: Array, step: Array, ends: tuple[float, float], free: tuple[bool, bool]
) -> Array:
    """The same with free ends: x is constant on the interval beside one, and between these as large as can be."""
    first, after = int(free[0]), len(step) - int(free[1])
    own = ceiling.copy()
    for end, interval, beside in ((0, 0, 1), (1, len(step) - 1, len(step) - 1)):
        if free[end] and rows:
            _, b, c = (part[interval] for part in rows)
            size = np.abs(np.where(b == 0, 1.0, b))
            alone = np.where(b == 0, np.inf, (1 - np.sign(b) * c) / size).min()
            own[beside] = min(own[beside], own[beside - 1 + 2 * end], alone)
    lines = _lines([part[first : after + 1] for part in rows], own[first : after + 1], step[first:after])
    slope, upper, _, most = lines
    lowest, highest = _backward_pass(
        *lines, step[first:after], *((0.0, float(most[-1])) if free[1] else (ends[1],) * 2)
    )
    begin = float(highest[0]) if free[0] else ends[0]
    if not _is_within(begin, lowest[0], highest[0]) or ends[1] > most[-1] * (1 + ROUNDING):
        return np.zeros(len(step) + 1)
    x = _forward_pass(begin, slope, upper, lowest, highest, step[first:after])
    if not free[1]:
        x[-1] = ends[1]
    return np.concatenate([x[:1]] * first + [x] + [x[-1:]] * (len(step) - after))


def largest_ends(rows: list[Array], ceiling: Array, step: Array, ends: tuple[float, float]) -> tuple[float, float]:
    """The ends, but with the largest x in place of one that is too large: the start's on the way to the given end.

    Where no start leads to the given end, the largest end that can be had from the given start, or from a slower one.
    """
    first, last = ends
    lines = _lines(rows, ceiling, step)
    slope, upper, _, ceiling = lines
    lowest, highest = _backward_pass(*lines, step, last, last)
    if first > highest[0] >= lowest[0] and last <= ceiling[-1]:
        return float(highest[0]), last
    lowest, highest = _backward_pass(*lines, step, 0.0, float(ceiling[-1]))
    x = _forward_pass(min(first, float(highest[0])), slope, upper, lowest, highest, step)
    return first, min(last, float(x[-1]))


def _backward_pass(
    slope: Array, upper: Array, lower: Array, ceiling: Array, step: Array, low: float, high: float
) -> tuple[Array, Array]:
    """At every grid point, the lowest and highest x from which one between low and high is reached at the end.

    With u on a line, the next x is gain x + 2 Δs (upper or lower). On a lower line it may not pass the next highest, on
    an upper one not fall below the next lowest.
    """
    gain = _line_gain(slope, step)
    onward = np.where(gain > 0, 1 / gain, 0.0)
    most, least = 2 * step[:, None] * upper, 2 * step[:, None] * lower
    lowest, cap = np.zeros(len(step) + 1), ceiling[:-1]
    if low > 0:
        down = np.where(gain > 0, most / gain, np.inf)
        free = np.full(len(step), 2 * FAR_SQUARED_SPEED)
        lowest = -_sweep(-low, onward[::-1], down[::-1], -free, 0 * free)[::-1]
    turned = np.where(gain < 0, (lowest[1:, None] - most) / gain, np.inf)
    up = np.where(gain > 0, -least / gain, np.inf)
    cap = np.minimum(cap, turned.min(1))[::-1]
    highest = _sweep(high, onward[::-1], up[::-1], np.zeros(len(step)), cap)[::-1]
    closed = np.flatnonzero(lowest > highest)
    if len(closed):
        lowest[: closed[-1] + 1], highest[: closed[-1] + 1] = np.inf, -np.inf
    return lowest, highest


def _forward_pass(first: float, slope: Array, upper: Array, lowest: Array, highest: Array, step: Array) -> Array:
    """x (N+1,) from the start on, as fast as the lines allow."""
    return _sweep(first, _line_gain(slope, step), 2 * step[:, None] * upper, lowest[1:], highest[1:])


def _line_gain(slope: Array, step: Array) -> Array:
    """How much the next x grows with x along each line; never quite nothing."""
    gain = 1 + 2 * step[:, None] * slope
    return np.where(np.abs(gain) < MIN_GROWTH, MIN_GROWTH, gain)


def _sweep(first: float, gain: Array, offset: Array, floor: Array, cap: Array) -> Array:
    """x (N+1,) with x ← the least of gain x + offset (N, m), held between floor and cap (N,), one after the other."""
    found = np.empty(len(cap) + 1)
    found[0] = first
    follow_lines(found, *(np.ascontiguousarray(each) for each in (gain, offset, floor, cap)))
    return found


@kernel
def follow_lines(x: Array, gain: Array, offset: Array, floor: Array, cap: Array) -> None:
    """Every x (N+1,) after the first, as `_sweep` has them."""
    for n in range(len(cap)):
        least = np.inf
        for k in range(gain.shape[1]):
            value = gain[n, k] * x[n] + offset[n, k]
            if value < least or np.isnan(value):
                least = value
        x[n + 1] = floor[n] if least < floor[n] else cap[n] if least > cap[n] else least


def _is_within(x: float, low: float, high: float) -> bool:
    return low * (1 - ROUNDING) <= x <= high * (1 + ROUNDING)


def _lines(rows: list[Array], ceiling: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """lower + slope x ≤ u ≤ upper + slope x, each (N, m), and the largest x (N+1,) at which some u is left."""
    a, b, c = (part[:-1] for part in rows) if rows else (np.zeros((len(step), 1)),) * 3
    size = np.abs(a)
    idle = size <= NEGLIGIBLE_SHARE * size.max(1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.where(idle & (b != 0), (1 - np.sign(b) * c) / np.abs(b), np.inf)
        slope, middle, half = (
            np.where(idle, free, part) for part, free in ((-b / a, 0.0), (-c / a, 0.0), (1 / size, np.inf))
        )
    upper, lower = middle + half, middle - half
    most = np.minimum(np.minimum(ceiling, np.append(alone.min(1), np.inf)), FAR_SQUARED_SPEED)
    return slope, upper, lower, np.append(_highest(slope, upper, lower, most[:-1]), most[-1])


def _highest(slope: Array, upper: Array, lower: Array, most: Array) -> Array:
    """The largest x (N,), at most the given one, at which some u lies between all lines."""
    x = most.copy()
    lower_to_room(x, slope, upper, lower)
    return x


@kernel
def lower_to_room(x: Array, slope: Array, upper: Array, lower: Array) -> None:
    """Lower x (N,) as `_highest` has them.

    The room between the lines is concave in x: Newton steps from above never pass the answer, if there is one.
    """
    for n in range(len(x)):
        while x[n] > 0:
            above, below = 0, 0  # the least of the upper lines, and the largest of the lower
            for k in range(1, slope.shape[1]):
                way = slope[n, k] * x[n]
                if upper[n, k] + way < upper[n, above] + slope[n, above] * x[n]:
                    above = k
                if lower[n, k] + way > lower[n, below] + slope[n, below] * x[n]:
                    below = k
            fall = slope[n, below] - slope[n, above]
            if not fall > 0:
                break
            nearer = (upper[n, above] - lower[n, below]) / fall
            if not nearer < x[n]:
                break
            x[n] = max(nearer, 0.0)
