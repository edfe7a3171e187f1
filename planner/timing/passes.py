"""The largest speeds that rows on s̈ and ṡ² allow, by one pass from the end and one from the start.

The reachability analysis of Pham and Pham, IEEE T-RO 34 (2018), 645, in plain form: standing still keeps every row, so
the x = ṡ² from which the end can be reached are, at each grid point, all from 0 to some highest.
"""

import numpy as np

from kinematics.array import Array

# A row whose share of s̈ is this small beside the largest at its point bounds ṡ² alone.
NEGLIGIBLE = 1e-12
# x from which the search for the highest starts where nothing else bounds it, in a problem scaled to about one.
FAR = 1e12


def largest_speeds(rows: list[Array], ceiling: Array, step: Array) -> Array:
    """x (N+1,), 0 at both ends, pointwise largest under |a u + b x + c| ≤ 1 and x ≤ ceiling; x grows by 2 u Δs.

    rows: a, b, c, each (N+1, m), kept at the start of every interval. Zeros inside say that nothing gets through.
    """
    slope, upper, lower, ceiling = _lines(rows, ceiling, step)
    highest = np.zeros(len(step) + 1)
    for i in reversed(range(1, len(step))):
        upper[i, -1] = highest[i + 1] / (2 * step[i])
        highest[i] = _highest(slope[i], upper[i], lower[i], ceiling[i])
    upper[0, -1] = highest[1] / (2 * step[0])
    x = np.zeros(len(step) + 1)
    for i in range(len(step) - 1):
        x[i + 1] = max(0.0, x[i] + 2 * step[i] * (slope[i] * x[i] + upper[i]).min())
    return x


def _lines(rows: list[Array], ceiling: Array, step: Array) -> tuple[Array, Array, Array, Array]:
    """lower + slope x ≤ u ≤ upper + slope x, each (N, m+1), and what is left for x alone (N,).

    The last line keeps the next x between 0 and its highest, which is filled in on the way.
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
        np.minimum(np.minimum(ceiling[:-1], alone.min(1, initial=np.inf)), FAR),
    )


def _highest(slope: Array, upper: Array, lower: Array, x: float) -> float:
    """The largest x, at most the given one, at which some u lies between all lines.

    The room between the lines is concave in x and not negative at 0: Newton steps from above never pass the answer.
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
