"""Largest x = ṡ² under linear rows on u = s̈ and x: reachability analysis in two passes (TOPP-RA).

Pham and Pham, IEEE T-RO 34 (2018), 645. From stage i of a grid to the next, x_{i+1} = x_i + 2 Δ_i
u.
The paper solves linear programmes in (u, x) at each stage. Here u is eliminated from the rows
|a u + b x + c| ≤ 1 once (Fourier and Motzkin): each row bounds the next x by two lines,

    lower + gain x_i ≤ x_{i+1} ≤ upper + gain x_i,  gain = 1 − 2 Δ_i b/a,

so that both passes only compare straight lines.

| here                     | in the paper                                                  |
| ------------------------ | ------------------------------------------------------------- |
| ceiling                  | bound of x, lowered to the maximum velocity curve             |
| controllable set         | K_i, an interval [least, most]: from there the end is reached |
| `find_controllable_sets` | backward pass                                                 |
| `take_largest`           | forward pass, the greedy choice of u                          |
"""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import Floats1, Floats3, kernel

LOWER, UPPER, GAIN = range(3)
# A row bounds x alone if its a is at most this share of the largest at its stage.
NEGLIGIBLE_SHARE = 1e-12
# Ceiling where no row bounds x, in problems that are scaled to about one: Newton steps start there.
UNBOUNDED = 1e12
# Share by which rounding may take a stated x out of its set.
ROUNDING = 1e-9


def largest_speeds(
    rows: Sequence[Array] | Array,
    ceiling: Array,
    step: Array,
    ends: tuple[float, float] = (0.0, 0.0),
    free: tuple[bool, bool] = (False, False),
) -> Array:
    """Return the largest x (N+1,) at every stage; zeros where no motion reaches the end.

    rows     a, b, c, each (N+1, m), of |a u + b x + c| ≤ 1
    ceiling  (N+1,) the largest x that is allowed
    step     (N,) Δ
    ends     x at the start and at the end
    free     ends at which x is free: there it is as large as possible. It is constant over the
             interval next to such an end, where rows vanish and would not bound x in between.
    """
    first = int(free[0])
    last = len(step) - int(free[1])
    rows = np.asarray(rows, float)
    if any(free):
        ceiling = _lower_next_to_free_ends(rows, ceiling, free)
    lines, ceiling = draw_lines(
        np.ascontiguousarray(rows[:, first : last + 1]),
        ceiling[first : last + 1],
        step[first:last],
    )
    start, end = ends
    target = (0.0, float(ceiling[-1])) if free[1] else (end, end)
    least, most = find_controllable_sets(lines, ceiling, target)
    if free[0]:
        start = float(most[0])
    if not least[0] * (1 - ROUNDING) <= start <= most[0] * (1 + ROUNDING):
        return np.zeros(len(step) + 1)
    if end > ceiling[-1] * (1 + ROUNDING):
        return np.zeros(len(step) + 1)
    x = take_largest(lines, least, most, start)
    if not free[1]:
        x[-1] = end
    if any(free):
        x = np.pad(x, (first, len(step) - last), mode="edge")
    return np.asarray(x)


def largest_ends(
    rows: Sequence[Array] | Array,
    ceiling: Array,
    step: Array,
    ends: tuple[float, float],
) -> tuple[float, float]:
    """Return the ends, with the largest possible x in place of one that is too large.

    The start is lowered until it leads to the stated end. If no start does, the end is lowered to
    the largest that the stated start, or a slower one, leads to.
    """
    start, end = ends
    lines, ceiling = draw_lines(np.asarray(rows, float), ceiling, step)
    least, most = find_controllable_sets(lines, ceiling, (end, end))
    if start > most[0] >= least[0] and end <= ceiling[-1]:
        return float(most[0]), end
    anywhere = (0.0, float(ceiling[-1]))
    least, most = find_controllable_sets(lines, ceiling, anywhere)
    x = take_largest(lines, least, most, min(start, float(most[0])))
    return start, min(end, float(x[-1]))


def _lower_next_to_free_ends(rows: Array, ceiling: Array, free: tuple[bool, bool]) -> Array:
    """Return the ceiling of an x that is constant over the interval next to a free end."""
    ceiling = ceiling.copy()
    last = len(ceiling) - 1
    for end, inner, interval in ((0, 1, 0), (last, last - 1, last - 1)):
        if not free[min(end, 1)]:
            continue
        _, b, c = rows[:, interval, rows[1, interval] != 0]
        largest = (1 - np.sign(b) * c) / np.abs(b)
        ceiling[inner] = min(ceiling[inner], ceiling[end], largest.min(initial=np.inf))
    return ceiling


@kernel
def draw_lines(rows: Floats3, ceiling: Floats1, step: Floats1) -> tuple[Array, Array]:
    """Return the LOWER, UPPER and GAIN (3, N, m) of each row, and the velocity curve (N+1,)."""
    lines = np.empty((3, len(step), rows.shape[2]))
    x = np.minimum(ceiling, UNBOUNDED)
    for i in range(len(step)):
        largest = 0.0
        for k in range(rows.shape[2]):
            largest = max(largest, abs(rows[0, i, k]))
        for k in range(rows.shape[2]):
            a, b, c = rows[:, i, k]
            if abs(a) > NEGLIGIBLE_SHARE * largest:
                middle = -c / a
                half = 1 / abs(a)
                lines[LOWER, i, k] = 2 * step[i] * (middle - half)
                lines[UPPER, i, k] = 2 * step[i] * (middle + half)
                lines[GAIN, i, k] = 1 - 2 * step[i] * b / a
                continue
            lines[LOWER, i, k] = -np.inf
            lines[UPPER, i, k] = np.inf
            lines[GAIN, i, k] = 1.0
            if b != 0:
                x[i] = min(x[i], (1 - np.sign(b) * c) / abs(b))
    lower_to_velocity_curve(lines, x)
    return lines, x


@kernel
def lower_to_velocity_curve(lines: Floats3, x: Floats1) -> None:
    """Lower x (N+1,) to the largest at which a next x lies between all lines.

    The gap between the lines is concave in x: Newton steps from above never pass its zero.
    """
    lower, upper, gain = lines
    for i in range(lines.shape[1]):
        while x[i] > 0:
            above = 0  # the least of the upper lines
            below = 0  # the largest of the lower lines
            least = upper[i, 0] + gain[i, 0] * x[i]
            largest = lower[i, 0] + gain[i, 0] * x[i]
            for k in range(1, lines.shape[2]):
                way = gain[i, k] * x[i]
                if upper[i, k] + way < least:
                    above = k
                    least = upper[i, k] + way
                if lower[i, k] + way > largest:
                    below = k
                    largest = lower[i, k] + way
            closing = gain[i, below] - gain[i, above]
            if not closing > 0:
                break
            nearer = (upper[i, above] - lower[i, below]) / closing
            if not nearer < x[i]:
                break
            x[i] = max(nearer, 0.0)


@kernel
def find_controllable_sets(
    lines: Floats3,
    ceiling: Floats1,
    target: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the least and the largest x (N+1,) at each stage from which the target is reached.

    Sets from which the target cannot be reached are empty: [∞, −∞].
    """
    lower, upper, gain = lines
    least = np.full(len(ceiling), np.inf)
    most = np.full(len(ceiling), -np.inf)
    least[-1], most[-1] = target
    for i in range(len(ceiling) - 2, -1, -1):
        low = 0.0
        high = ceiling[i]
        for k in range(lines.shape[2]):
            slope = gain[i, k]
            to_least = least[i + 1] - upper[i, k]
            to_most = most[i + 1] - lower[i, k]
            if slope > 0:
                low = max(low, to_least / slope)
                high = min(high, to_most / slope)
            elif slope < 0:
                high = min(high, to_least / slope)
        high = max(high, 0.0)
        if low > high:
            break
        least[i] = low
        most[i] = high
    return least, most


@kernel
def take_largest(lines: Floats3, least: Floats1, most: Floats1, start: float) -> Array:
    """Return x (N+1,) from the start on: at each stage the largest that is allowed."""
    _, upper, gain = lines
    x = np.empty(len(least))
    x[0] = start
    for i in range(lines.shape[1]):
        largest = most[i + 1]
        for k in range(lines.shape[2]):
            following = upper[i, k] + gain[i, k] * x[i]
            largest = min(largest, following)
        x[i + 1] = max(largest, least[i + 1])
    return x
