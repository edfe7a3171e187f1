"""The largest speeds that rows on s̈ and ṡ² allow, by one pass from the end and one from the start.

The reachability analysis of Pham and Pham, IEEE T-RO 34 (2018), 645, in plain form: the x = ṡ² from which the end can
be reached are an interval at each grid point, from 0 where the end is at rest, since standing still keeps every row.
"""

import numpy as np

from kinematics.array import Array

# A row whose share of s̈ is this small beside the largest at its point bounds ṡ² alone.
NEGLIGIBLE = 1e-12
# x from which the search for the highest starts where nothing else bounds it, in a problem scaled to about one.
FAR = 1e12
# Share of x up to which a given one may lie beyond what can be: rounding.
ROUNDING = 1e-9


def largest_speeds(rows: list[Array], ceiling: Array, step: Array, ends: tuple[float, float] = (0.0, 0.0)) -> Array:
    """x (N+1,), given at both ends, pointwise largest under |a u + b x + c| ≤ 1 and x ≤ ceiling; x grows by 2 u Δs.

    rows: a, b, c, each (N+1, m), kept at the start of every interval. Zeros say that nothing gets through.
    """
    first, last = ends
    slope, upper, lower, ceiling = _lines(rows, ceiling, step)
    lowest, highest = _reach(slope, upper, lower, ceiling, step, last, last)
    x = np.zeros(len(step) + 1)
    if last > ceiling[-1] * (1 + ROUNDING) or not _within(first, lowest[0], highest[0]):
        return x
    _climb(x, first, slope, upper, lowest, step)
    x[-1] = last
    return x


def largest_ends(rows: list[Array], ceiling: Array, step: Array, ends: tuple[float, float]) -> tuple[float, float]:
    """The ends, but with the largest x in place of one that is too large: the start's on the way to the given end.

    Where no start leads to the given end, the largest end that can be had from the given start, or from a slower one.
    """
    first, last = ends
    slope, upper, lower, ceiling = _lines(rows, ceiling, step)
    lowest, highest = _reach(slope, upper, lower, ceiling, step, last, last)
    if first > highest[0] >= lowest[0] and last <= ceiling[-1]:
        return float(highest[0]), last
    lowest, highest = _reach(slope, upper, lower, ceiling, step, 0.0, ceiling[-1])
    x = np.zeros(len(step) + 1)
    _climb(x, min(first, float(highest[0])), slope, upper, lowest, step)
    return first, min(last, float(x[-1]))


def _reach(
    slope: Array, upper: Array, lower: Array, ceiling: Array, step: Array, low: float, high: float
) -> tuple[Array, Array]:
    """At every grid point, the lowest and highest x from which one between low and high is reached at the end.

    The last lines of `upper` and `lower`, which keep the next x within its own bounds, are filled in on the way.
    """
    lowest, highest = np.full(len(step) + 1, low), np.full(len(step) + 1, high)
    for i in reversed(range(len(step))):
        upper[i, -1], lower[i, -1] = highest[i + 1] / (2 * step[i]), lowest[i + 1] / (2 * step[i])
        highest[i] = _highest(slope[i], upper[i], lower[i], ceiling[i])
        lowest[i] = _lowest(slope[i], upper[i], lower[i]) if lowest[i + 1] > 0 else 0.0
        if lowest[i] > highest[i]:
            lowest[: i + 1], highest[: i + 1] = np.inf, -np.inf
            break
    return lowest, highest


def _climb(x: Array, first: float, slope: Array, upper: Array, lowest: Array, step: Array) -> None:
    """x from the start on, as fast as the lines allow."""
    x[0] = first
    for i in range(len(step)):
        x[i + 1] = max(lowest[i + 1], x[i] + 2 * step[i] * (slope[i] * x[i] + upper[i]).min())


def _within(x: float, low: float, high: float) -> bool:
    return low * (1 - ROUNDING) <= x <= high * (1 + ROUNDING)


def _lines(rows: list[Array], ceiling: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """lower + slope x ≤ u ≤ upper + slope x, each (N, m+1), and what is left for x alone (N+1,).

    The last line keeps the next x within its bounds, which are filled in on the way.
    """
    a, b, c = (part[:-1] for part in rows) if rows else (np.zeros((len(step), 0)),) * 3
    size = np.abs(a)
    idle = size <= NEGLIGIBLE * size.max(1, initial=0.0, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = np.where(idle & (b != 0), (1 - np.sign(b) * c) / np.abs(b), np.inf)
        slope, middle, half = (
            np.where(idle, free, part) for part, free in ((-b / a, 0.0), (-c / a, 0.0), (1 / size, np.inf))
        )
    last = np.zeros((len(step), 1))
    return (
        np.concatenate([slope, last - 1 / (2 * step[:, None])], 1),
        np.concatenate([middle + half, last], 1),
        np.concatenate([middle - half, last], 1),
        np.minimum(np.minimum(ceiling, np.append(alone.min(1, initial=np.inf), np.inf)), FAR),
    )


def _highest(slope: Array, upper: Array, lower: Array, x: float) -> float:
    """The largest x, at most the given one, at which some u lies between all lines.

    The room between the lines is concave in x: Newton steps from above never pass the answer, if there is one.
    """
    while x > 0:
        lines = slope * x
        least, most = int(np.argmin(upper + lines)), int(np.argmax(lower + lines))
        room = upper[least] - lower[most] + (lines[least] - lines[most])
        if room >= 0:
            break
        nearer = (upper[least] - lower[most]) / (slope[most] - slope[least])
        if not nearer < x:
            break
        x = float(nearer)
    return max(x, 0.0)


def _lowest(slope: Array, upper: Array, lower: Array) -> float:
    """The least x at which some u lies between all lines, by the same steps from 0 up; ∞ where there is none."""
    x = 0.0
    while True:
        lines = slope * x
        least, most = int(np.argmin(upper + lines)), int(np.argmax(lower + lines))
        if upper[least] - lower[most] + (lines[least] - lines[most]) >= 0:
            return x
        rise = slope[least] - slope[most]
        if not rise > 0:
            return float("inf")
        nearer = float((lower[most] - upper[least]) / rise)
        if not nearer > x:
            return x
        x = nearer
