"""Range of x(σ(τ)) and its time derivatives over cells: a compiled loop over polynomials.

x(σ) = Σ p_i σ^i + remainder is a Taylor series with guaranteed error over an interval of the path,
|σ| ≤ 1. σ(τ) = s₀ + s₁τ + s₂τ² + s₃τ³ is the motion over a cell of time, |τ| ≤ 1. Horner's scheme
gives x(σ(τ)) = Σ a_k τ^k. The same sums with the sizes of their factors, and with the sizes
enlarged by the errors, bound everything neglected:

    |∏(x + e) − ∏x| ≤ ∏(|x| + |e|) − ∏|x|.

The first of these sums also bounds rounding; the difference includes the powers beyond a_k.

Scratch arrays end in CELLS: the innermost loops run over cells, so that they fill the vector
registers of the processor.
"""

import numpy as np

from kinematics.foundation.kernels import (
    Floats1,
    Floats2,
    Floats4,
    Ints1,
    Strided2,
    kernel,
)
from kinematics.foundation.taylor_model import EPS

# Cells computed together: their scratch arrays stay in the processor's cache.
CELLS = 128
# Powers of τ beyond the highest derivative. More are tighter and take longer.
EXTRA_POWERS = 4
# Ratio of a cubic coefficient to the lower ones below which the cubic is bounded as a parabola.
SMALL_CUBIC = 2.0**-26
# Bound of the roundings of any one product in the sums.
ROUNDINGS = 64 * EPS


@kernel
def bound_motion(
    series: Floats4,
    interval: Ints1,
    motion: Floats2,
    out: Floats4,
) -> None:
    """Bound x and its derivatives by time over N cells.

    series    (2, D+1, G, m) coefficients of x over G intervals of the path, and their errors; the
              last coefficient, times σ^D, is the remainder
    interval  (N,) of each cell
    motion    (9, N) s₀ … s₃, their errors, and the rate dτ/dt in 1/s
    out       (2 or 4, highest+1, N, m) middle and radius of each range, and if wanted two values
              between which the function surely attains all: no less than its minimum and no more
              than its maximum; 0 where the cell leaves its interval
    """
    degree = series.shape[1] - 1
    powers = out.shape[1] - 1 + EXTRA_POWERS
    cells = np.zeros((9, CELLS))
    reach = np.zeros((4, CELLS))
    p = np.zeros((degree, CELLS))
    size = np.zeros((degree, CELLS))
    a = np.zeros((powers + 1, CELLS))
    large = np.zeros((powers + 1, CELLS))
    majorant = np.zeros((4, CELLS))
    e = np.zeros((powers + 6, CELLS))
    cubic = np.zeros((4, CELLS))
    slack = np.zeros((2, CELLS))
    bounds = np.zeros((4, CELLS))
    places = np.zeros((4, CELLS))
    places[0] = -1.0
    places[1] = 1.0
    scale = np.zeros(CELLS)
    for first in range(0, len(interval), CELLS):
        rows = interval[first : first + CELLS]
        _load_motion(motion[:, first : first + CELLS], cells, reach)
        for c in range(series.shape[3]):
            _load_series(series, rows, c, p, size)
            _bound_sizes(series, rows, c, reach[0], majorant)
            _compose(p, cells[:4], a)
            _compose(size, cells[4:8], large)
            scale[:] = 1.0
            for m in range(out.shape[1]):
                _bound_neglected(majorant, reach, m, slack[0])
                _differentiate(a, large, m, e, slack[0])
                _reduce_to_cubic(e, powers - m, cubic, slack)
                _find_peaks(cubic, places, slack[0])
                _bound_values(cubic, places, slack[0], 1.0, bounds[:2])
                if len(out) == 4:
                    _bound_values(
                        e[: powers - m + 1],
                        places,
                        slack[1],
                        -1.0,
                        bounds[2:],
                    )
                _store(bounds, reach[0], scale, out[:, m, first : first + len(rows), c])
                for n in range(len(rows)):
                    scale[n] *= cells[8, n]


@kernel
def _load_series(
    series: Floats4,
    rows: Ints1,
    c: int,
    p: Floats2,
    size: Floats2,
) -> None:
    """Fill p and size (D, CELLS): the coefficients of channel c for each cell, and their sizes."""
    for i in range(len(p)):
        for n in range(len(rows)):
            p[i, n] = series[0, i, rows[n], c]
            size[i, n] = abs(p[i, n])


@kernel
def _load_motion(motion: Strided2, cells: Floats2, reach: Floats2) -> None:
    """Fill cells (9, CELLS) and reach (4, CELLS).

    cells: s₀ … s₃, |s₀| … |s₃| and the rate; reach: max |σ|, |σ′|, |σ″|, |σ‴|
    """
    for n in range(motion.shape[1]):
        for i in range(4):
            cells[i, n] = motion[i, n]
            cells[4 + i, n] = abs(motion[i, n])
        cells[8, n] = motion[8, n]
        w0 = cells[4, n] + motion[4, n]
        w1 = cells[5, n] + motion[5, n]
        w2 = cells[6, n] + motion[6, n]
        w3 = cells[7, n] + motion[7, n]
        reach[0, n] = (w0 + w1 + w2 + w3) * (1 + ROUNDINGS)
        reach[1, n] = w1 + 2 * w2 + 3 * w3
        reach[2, n] = 2 * w2 + 6 * w3
        reach[3, n] = 6 * w3


@kernel
def _bound_sizes(
    series: Floats4,
    rows: Ints1,
    c: int,
    reach: Floats1,
    majorant: Floats2,
) -> None:
    """Fill majorant (4, CELLS): Σ (|p_i| + error) σ^i and its derivatives by σ at σ = reach.

    Horner's scheme.
    """
    count = len(rows)
    majorant[:] = 0.0
    for i in range(series.shape[1] - 1, -1, -1):
        for n in range(count):
            size = abs(series[0, i, rows[n], c]) + series[1, i, rows[n], c]
            x = reach[n]
            majorant[3, n] = majorant[3, n] * x + 3 * majorant[2, n]
            majorant[2, n] = majorant[2, n] * x + 2 * majorant[1, n]
            majorant[1, n] = majorant[1, n] * x + majorant[0, n]
            majorant[0, n] = majorant[0, n] * x + size


@kernel
def _compose(p: Floats2, s: Floats2, a: Floats2) -> None:
    """Fill a (powers+1, CELLS): the coefficients of Σ p_i σ(τ)^i. Overwrites p with those about
    s₀.
    """
    powers = len(a) - 1
    # p about s₀ times (σ − s₀)^i has no power of τ below the i-th
    top = min(powers, len(p) - 1)
    for i in range(top + 1):
        for k in range(len(p) - 2, i - 1, -1):
            for n in range(CELLS):
                p[k, n] += s[0, n] * p[k + 1, n]
    for n in range(CELLS):
        a[0, n] = p[top, n]
    for k in range(1, powers + 1):
        for n in range(CELLS):
            a[k, n] = 0.0
    for i in range(top - 1, -1, -1):
        for k in range(min(powers, 3 * (top - i)), 2, -1):
            for n in range(CELLS):
                a[k, n] = s[1, n] * a[k - 1, n]
                a[k, n] += s[2, n] * a[k - 2, n]
                a[k, n] += s[3, n] * a[k - 3, n]
        for n in range(CELLS):
            a[2, n] = s[1, n] * a[1, n] + s[2, n] * a[0, n]
            a[1, n] = s[1, n] * a[0, n]
            a[0, n] = p[i, n]


@kernel
def _bound_neglected(
    majorant: Floats2,
    reach: Floats2,
    m: int,
    slack: Floats1,
) -> None:
    """Fill slack (CELLS,): the m-th derivative of the majorant by τ, by the chain rule."""
    for n in range(CELLS):
        z1 = reach[1, n]
        z2 = reach[2, n]
        if m == 0:
            slack[n] = majorant[0, n]
        elif m == 1:
            slack[n] = majorant[1, n] * z1
        elif m == 2:
            slack[n] = majorant[2, n] * z1 * z1 + majorant[1, n] * z2
        else:
            slack[n] = majorant[3, n] * z1 * z1 * z1
            slack[n] += 3 * majorant[2, n] * z1 * z2 + majorant[1, n] * reach[3, n]
        slack[n] *= 1 + ROUNDINGS


@kernel
def _differentiate(
    a: Floats2,
    large: Floats2,
    m: int,
    e: Floats2,
    slack: Floats1,
) -> None:
    """Fill e with the coefficients of the m-th derivative of Σ a_k τ^k, and 0 beyond.

    Takes the sizes of its terms from the slack, which leaves errors, rounding and neglected powers.
    """
    for k in range(m, len(a)):
        factor = 1.0
        for i in range(m):
            factor *= k - i
        for n in range(CELLS):
            e[k - m, n] = factor * a[k, n]
            slack[n] -= factor * large[k, n] * (1 - 2 * ROUNDINGS)
    for k in range(len(a) - m, len(e)):
        for n in range(CELLS):
            e[k, n] = 0.0


@kernel
def _reduce_to_cubic(
    e: Floats2,
    degree: int,
    cubic: Floats2,
    slack: Floats2,
) -> None:
    """Fill cubic (4, CELLS) by Chebyshev economization: e₄ and e₅ are spread over lower powers.

    slack[0] grows by the neglected powers; slack[1] is the slack of the full polynomial.
    """
    for n in range(CELLS):
        e4 = e[4, n]
        e5 = e[5, n]
        slack[1, n] = slack[0, n]
        slack[0, n] += abs(e4) / 8 + abs(e5) / 16
        cubic[0, n] = e[0, n] - e4 / 8
        cubic[1, n] = e[1, n] - 0.3125 * e5
        cubic[2, n] = e[2, n] + e4
        cubic[3, n] = e[3, n] + 1.25 * e5
    for k in range(6, degree + 1):
        for n in range(CELLS):
            slack[0, n] += abs(e[k, n])


@kernel
def _find_peaks(cubic: Floats2, places: Floats2, slack: Floats1) -> None:
    """Fill places[2:] with the τ in [−1, 1] where the cubic's slope is zero, else 0.

    A small cubic coefficient is dropped, which costs slack: the roots would lose all digits.
    """
    for n in range(CELLS):
        a1 = cubic[1, n]
        a2 = cubic[2, n]
        a3 = cubic[3, n]
        places[2, n] = 0.0
        places[3, n] = 0.0
        lower = abs(cubic[0, n]) + abs(a1) + abs(a2)
        if abs(a3) <= SMALL_CUBIC * lower:
            slack[n] += abs(a3) / 4
            a1 += 0.75 * a3
            cubic[1, n] = a1
            cubic[3, n] = 0.0
            if abs(a1) < 2 * abs(a2):
                places[2, n] = -a1 / (2 * a2)
            continue
        # scaled, so that squares neither underflow nor overflow
        unit = abs(a1) + abs(a2) + abs(a3)
        b1 = a1 / unit
        b2 = a2 / unit
        b3 = 3 * a3 / unit
        square = b2 * b2 - b1 * b3
        if square > 0:
            root = -b2 - np.copysign(np.sqrt(square), b2)
            if abs(root) < abs(b3):
                places[2, n] = root / b3
            if abs(b1) < abs(root):
                places[3, n] = b1 / root


@kernel
def _bound_values(
    e: Floats2,
    places: Floats2,
    slack: Floats1,
    sign: float,
    out: Floats2,
) -> None:
    """Fill out (2, CELLS) with the least and the most of Σ e_k τ^k at the places.

    sign 1: enlarged by the slack, which bounds the range from outside. −1: reduced by the slack.
    Then the function surely attains all values in between.
    """
    out[0] = np.inf
    out[1] = -np.inf
    value = np.zeros(CELLS)
    for i in range(4):
        value[:] = 0.0
        for k in range(len(e) - 1, -1, -1):
            for n in range(CELLS):
                value[n] = e[k, n] + places[i, n] * value[n]
        for n in range(CELLS):
            out[0, n] = min(out[0, n], value[n])
            out[1, n] = max(out[1, n], value[n])
    for k in range(len(e)):
        for n in range(CELLS):
            slack[n] += ROUNDINGS * abs(e[k, n])
    for n in range(CELLS):
        beyond = sign * slack[n] * (1 + ROUNDINGS)
        out[0, n] -= beyond
        out[1, n] += beyond


@kernel
def _store(
    bounds: Floats2,
    reach: Floats1,
    scale: Floats1,
    out: Strided2,
) -> None:
    """Write bounds of cells to out (2 or 4, N): middle and radius, least and most attained.

    Nothing is known of a cell that leaves its interval.
    """
    for n in range(out.shape[1]):
        low = bounds[0, n]
        high = bounds[1, n]
        middle = (low + high) / 2 * scale[n]
        largest = max(abs(low), abs(high))
        radius = (high - low) / 2 * (1 + 4 * EPS) + 16 * EPS * largest
        radius *= scale[n]
        good = reach[n] <= 1 and np.isfinite(middle) and np.isfinite(radius)
        out[0, n] = middle if good else 0.0
        out[1, n] = radius if good else np.inf
        for i in range(2, len(out)):
            out[i, n] = bounds[i, n] * scale[n] if good else 0.0
