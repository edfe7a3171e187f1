"""Lower bound of the duration of motions along a run, by limits on speed, acceleration and jerk.

With a = ṡ², b = s̈, c = db/ds: a′ = 2b, b′ = c and T = ∫ ds/√a. For all continuous λa, λb

    T ≥ ∫ φ ds − [λa a + λb b],
    φ(s) ≤ 1/√a + λa′ a + (2λa + λb′) b + λb c  for all (a, b, c) allowed at s,

and for all multipliers μ, ν, σ ≥ 0 of the rows at s that cancel b and c in this sum,

    φ = min over a of g/√a + P a + K,
    g = 1 − Σ |μ| J,   P = λa′ + Σ μ q‴ + Σ ν q″ + σ y,   K = −Σ |ν| A − σ.

A solver proposes λ; any λ is valid. The rest is proved, cell by cell: docs/theory/lower_bound.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import (
    Floats1,
    Floats2,
    Floats3,
    Floats4,
    Floats5,
    Strided1,
    Strided2,
    kernel,
)
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.enclosure import PLACE_ROUNDING, Enclosure
from planner.limits.axis import Acceleration, Jerk, PulseRate, Speed
from planner.limits.limit import AxisLimit, Limit, select_timed
from planner.limits.tool import AngularSpeed, ToolLimit, ToolSpeed
from planner.path.actuation import ActuatorPath, has_constant_speed

# Limits with a row for each axis.
AXIS_ROWS = (Acceleration, Jerk)
SPEED_LIMITS = (Speed, PulseRate, ToolSpeed, AngularSpeed)

# Order of the series of q over a cell: q‴ keeps its slope.
PATH_ORDER = 6
# Least half width of an enclosure, as a share of its piece: rounding spoils derivatives over less.
LEAST_HALF = 2.0**-8
# Rounding error of each sum or product below, which has fewer operations.
ROUNDINGS = 256 * EPS


class RowCells(NamedTuple):
    """Rows over M cells of a path: values at both ends of a cell, and distances from their chord.

    nodes (M+1,)       m, ends of the cells
    width (M,)         m
    ends (M, 2, 3, n)  q′, q″, q‴ at both ends
    off (M, 3, n)      their greatest distance from the chord, with the error of the ends
    speed (M, 2)       y of the speed row ya ≤ 1, 0 without a row
    speed_off (M,)     its greatest distance from the chord
    acceleration, jerk (2, n)  bounds towards greater and smaller values, ∞ without a bound
    """

    nodes: Floats1
    width: Floats1
    ends: Floats4
    off: Floats3
    speed: Floats2
    speed_off: Floats1
    acceleration: Floats2
    jerk: Floats2


class Trial(NamedTuple):
    """Multipliers of M cells, in S sets for the rows, each for a part of the range of a.

    All values are valid.

    nodes (M+1, 2)        λa, λb
    bulge (M,)            difference of λb′ at a cell's ends from its mean
    rows (M, S, 2, 2, n)  ν (acceleration) and μ (jerk) at both ends of each cell
    speed (M, S, 2)       σ at both ends
    about (M,)            m²/s², estimate of the minimising a
    """

    nodes: Floats2
    bulge: Floats1
    rows: Floats5
    speed: Floats3
    about: Floats1


class CellTrial(NamedTuple):
    """One set of multipliers of a cell: λ at both ends (2,), bulge, ν and μ (2, 2, n), σ (2,)."""

    lambda_a: Strided1
    lambda_b: Strided1
    bulge: float
    rows: Floats3
    speed: Floats1


def enclose_rows(
    path: ActuatorPath,
    limits: Sequence[Limit],
    nodes: Array,
    piece: np.ndarray,
) -> RowCells:
    """Enclose the rows over the cells between nodes (M+1,), which lie in pieces (M,)."""
    count = len(piece)
    first, last = path.breaks[piece], path.breaks[piece + 1]
    width = np.diff(nodes)
    half = np.maximum(width / 2, (last - first) * LEAST_HALF) * (1 + 8 * EPS)
    highest = np.maximum(last - half, first + half)
    centre = np.clip((nodes[1:] + nodes[:-1]) / 2, first + half, highest)
    mid = np.tile(np.stack([centre, half]), 2)
    rad = np.zeros((2, 2 * count))
    rad[0, count:] = half * (1 + 16 * EPS)
    # equal runs share a bound, and the breaks of each are rounded differently
    rad[0] += PLACE_ROUNDING * np.abs(path.breaks[[0, -1]]).max()
    along = Enclosure(path, Series(mid, rad, PATH_ORDER), np.tile(1 / half, 2)[:, None], piece)
    within = (nodes[:-1] - centre) / half, (nodes[1:] - centre) / half
    derivatives = [_end_values(each, within) for each in (along.qd, along.qdd, along.qddd)]
    ends = np.stack([values for values, _ in derivatives], 2).transpose(1, 0, 2, 3)
    bounds = np.full((2, 2, len(path.names)), np.inf)
    rows = RowCells(
        nodes=nodes,
        width=width,
        ends=np.ascontiguousarray(ends),
        off=np.ascontiguousarray(np.stack([error for _, error in derivatives], 1)),
        speed=np.zeros((count, 2)),
        speed_off=np.zeros(count),
        acceleration=bounds[0],
        jerk=bounds[1],
    )
    for limit in limits:
        if isinstance(limit, AXIS_ROWS):
            bound = bounds[AXIS_ROWS.index(type(limit))]
            np.minimum(bound, np.stack([limit.bounds, limit.below]), out=bound)
        elif isinstance(limit, SPEED_LIMITS):
            _add_speed(limit, along, within, rows)
    return rows


def _end_values(series: Series, within: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return values (2, M, m) at both ends of cells, τ (M,) each, and the error of their chord."""
    count = len(within[0])
    full = series.pad(series.order)
    polynomial, radii = full.mid[:-1, :count], full.rad[:-1, :count]
    low, high = (tau[:, None] for tau in within)
    reach = np.maximum(np.abs(low), np.abs(high))
    ends = np.zeros((2, *polynomial.shape[1:]))
    error = np.abs(full.mid[-1, count:]) + full.rad[-1, count:]
    size = 0.0
    curvature = 0.0
    for k in range(len(polynomial) - 1, -1, -1):
        ends[0] = ends[0] * low + polynomial[k]
        ends[1] = ends[1] * high + polynomial[k]
        error = error * reach + radii[k]
        size = size * reach + np.abs(polynomial[k])
        if k + 2 < len(polynomial):
            curvature = curvature * reach + (k + 2) * (k + 1) * np.abs(polynomial[k + 2])
    # a function leaves its chord by at most h²/8 |f″|; the error counts at the ends and in between
    chord = curvature * (high - low) ** 2 / 8
    off = (2 * error + chord + ROUNDINGS * size) * (1 + ROUNDINGS)
    return ends, np.where(np.isfinite(off), off, np.inf)


def find_left_out(path: ActuatorPath, limits: Sequence[Limit]) -> tuple[str, ...]:
    """List the limits that the bound leaves out. It is too low by the time that these cost."""
    known = (*AXIS_ROWS, *SPEED_LIMITS)
    names = [limit.name for limit in select_timed(limits) if not isinstance(limit, known)]
    if has_constant_speed(path):
        names.append("constant speed")
    return tuple(names)


def _add_speed(
    limit: Limit,
    along: Enclosure,
    within: tuple[Array, Array],
    rows: RowCells,
) -> None:
    """Replace the speed rows y a ≤ 1 of the cells where this limit's rows are tighter."""
    count = len(rows.width)
    value = limit.value(along)
    if isinstance(limit, AxisLimit):
        ends, error = _end_values(value, within)
        forwards = (ends.sum(0) >= 0) | ~np.isfinite(ends.sum(0))
        definite = np.where(forwards, np.minimum(*ends) - error > 0, np.maximum(*ends) + error < 0)
        cap = np.where(forwards, limit.bounds, limit.below)
        cap = np.where(definite, cap, np.maximum(limit.bounds, limit.below))
        square = value * value
    else:
        assert isinstance(limit, ToolLimit)
        cap = limit.caps[along.piece][:, None]
        square = value
    ends, error = _end_values(square, within)
    with np.errstate(invalid="ignore"):
        ends = ends / cap**2
        error = error / cap**2 * (1 + ROUNDINGS) + ROUNDINGS * np.abs(ends).max(0)
    total = ends.sum(0)
    total = np.where(np.isfinite(total + error), total, -1.0)
    best = total.argmax(1)
    tighter = np.flatnonzero(total[np.arange(count), best] > rows.speed.sum(1))
    rows.speed[tighter] = ends[:, tighter, best[tighter]].T
    rows.speed_off[tighter] = error[tighter, best[tighter]]


@kernel
def add_below(one: float, other: float) -> float:
    """Return a sum, rounded down, or −∞ if it is not finite."""
    total = one + other - ROUNDINGS * (abs(one) + abs(other))
    return total if total > -np.inf and total < np.inf else -np.inf


@kernel
def least_over(g: float, p: float, low: float, high: float) -> float:
    """Return the minimum of g/√a + p a over low ≤ a ≤ high, for 0 ≤ low and high up to ∞."""
    best = np.inf
    if low > 0:
        best = add_below(g / np.sqrt(low), p * low)
    elif g < 0:
        return -np.inf
    elif g == 0:
        best = 0.0
    if high < np.inf:
        best = min(best, add_below(g / np.sqrt(high), p * high))
    elif p < 0:
        return -np.inf
    elif p == 0:
        best = min(best, 0.0)
    if g > 0 and p > 0:
        a = (g / (2 * p)) ** (2 / 3)
        if low < a < high:
            best = min(best, 3 * (g / 2) ** (2 / 3) * p ** (1 / 3) * (1 - ROUNDINGS))
    return best


@kernel
def find_movers(rows: RowCells, k: int) -> tuple[int, int]:
    """Return the axes with the largest proved q′ relative to their acceleration and jerk limits.

    −1 if no axis with such a limit surely moves.
    """
    first = second = -1
    most_first = most_second = 0.0
    for i in range(rows.ends.shape[3]):
        one = rows.ends[k, 0, 0, i]
        two = rows.ends[k, 1, 0, i]
        least = min(abs(one), abs(two)) - rows.off[k, 0, i]
        if one * two <= 0 or not least > 0:
            continue
        use = least / max(rows.acceleration[0, i], rows.acceleration[1, i])
        if use > most_first:
            first = i
            most_first = use
        use = least / max(rows.jerk[0, i], rows.jerk[1, i])
        if use > most_second:
            second = i
            most_second = use
    return first, second


@kernel
def add_products(factor: float, m: Floats2, q: Strided2, off: Floats1, out: Floats1) -> None:
    """Add factor · Σ m q over a cell to out (5,): both ends, bulge, error, and size of summands.

    m (2, n) is linear along the cell, and q (2, n) is up to off (n,). The product of two chords
    leaves its chord by at most a quarter of the product of their changes.
    """
    for i in range(q.shape[1]):
        most = factor * max(abs(m[0, i]), abs(m[1, i]))
        out[0] += factor * m[0, i] * q[0, i]
        out[1] += factor * m[1, i] * q[1, i]
        out[2] += factor * (m[1, i] - m[0, i]) * (q[1, i] - q[0, i]) / 4
        out[3] += most * off[i]
        out[4] += most * max(abs(q[0, i]), abs(q[1, i]))


@kernel
def bound_size(total: Floats1) -> float:
    """Return the largest absolute value over a cell of a sum of `add_products`."""
    most = max(abs(total[0]), abs(total[1])) + abs(total[2]) + total[3]
    size: float = (most + ROUNDINGS * (total[4] + abs(total[2]))) * (1 + ROUNDINGS)
    return size


@kernel
def sum_rows(rows: RowCells, k: int, cell: CellTrial, movers: tuple[int, int], out: Floats2) -> None:
    """Fill out (2, 3) with proved g, P and K at both ends of cell k.

    movers: axes as of `find_movers`; that of jerk is −1 at order 2.
    The rows of the movers cancel the coefficients R of c and Q of b at both ends. One more row of
    each kind cancels their rests |R| ≤ r and |Q| ≤ ρ in between.
    """
    first, second = movers
    n = rows.ends.shape[3]
    h = rows.width[k]
    q = rows.ends[k]
    off = rows.off[k]
    lambda_a, lambda_b, bulge = cell.lambda_a, cell.lambda_b, cell.bulge
    mu = np.zeros((2, n))
    nu = np.zeros((2, n))
    for e in range(2):
        for i in range(n):
            if max(rows.acceleration[0, i], rows.acceleration[1, i]) < np.inf:
                nu[e, i] = cell.rows[e, 0, i]
            if second >= 0 and max(rows.jerk[0, i], rows.jerk[1, i]) < np.inf:
                mu[e, i] = cell.rows[e, 1, i]

    # R = λb + Σ μ q′, where λb is quadratic
    r = np.zeros(5)
    r[0] = lambda_b[0]
    r[1] = lambda_b[1]
    r[2] = -bulge * h / 4
    r[4] = max(abs(lambda_b[0]), abs(lambda_b[1])) + abs(r[2])
    if second >= 0:
        for e in range(2):
            total = 0.0
            for i in range(n):
                total += mu[e, i] * q[e, 0, i]
            mu[e, second] -= (lambda_b[e] + total) / q[e, 0, second]
        add_products(1.0, mu, q[:, 0], off[0], r)

    # Q = 2 λa + λb′ + 3 Σ μ q″ + Σ ν q′
    rho = np.zeros(5)
    slope_b = (lambda_b[1] - lambda_b[0]) / h
    for e in range(2):
        rho[e] = 2 * lambda_a[e] + slope_b + (1.0 - 2.0 * e) * bulge
    rho[4] = 2 * max(abs(lambda_a[0]), abs(lambda_a[1])) + abs(bulge)
    rho[4] += (abs(lambda_b[0]) + abs(lambda_b[1])) / h
    add_products(3.0, mu, q[:, 1], off[1], rho)
    for e in range(2):
        total = 0.0
        for i in range(n):
            total += nu[e, i] * q[e, 0, i]
        nu[e, first] -= (rho[e] + total) / q[e, 0, first]
    add_products(1.0, nu, q[:, 0], off[0], rho)

    # P = λa′ + Σ μ q‴ + Σ ν q″ + σ y
    p = np.zeros(5)
    p[0] = (lambda_a[1] - lambda_a[0]) / h
    p[1] = p[0]
    p[4] = (abs(lambda_a[0]) + abs(lambda_a[1])) / h
    add_products(1.0, mu, q[:, 2], off[2], p)
    add_products(1.0, nu, q[:, 1], off[1], p)
    sigma = cell.speed
    y = rows.speed[k]
    most = max(abs(sigma[0]), abs(sigma[1]))
    p[0] += sigma[0] * y[0]
    p[1] += sigma[1] * y[1]
    p[2] += (sigma[1] - sigma[0]) * (y[1] - y[0]) / 4
    p[3] += most * rows.speed_off[k]
    p[4] += most * max(abs(y[0]), abs(y[1]))

    # one more row of each kind: |μ| ≤ r / min |q′|, |ν| ≤ ρ / min |q′|
    more_mu = 0.0
    left = bound_size(rho)
    if second >= 0:
        near = min(abs(q[0, 0, second]), abs(q[1, 0, second])) - off[0, second]
        more_mu = bound_size(r) / near * (1 + ROUNDINGS)
        curvature = max(abs(q[0, 1, second]), abs(q[1, 1, second])) + off[1, second]
        left += 3 * more_mu * curvature
    near = min(abs(q[0, 0, first]), abs(q[1, 0, first])) - off[0, first]
    more_nu = left / near * (1 + ROUNDINGS)
    curvature = max(abs(q[0, 1, first]), abs(q[1, 1, first])) + off[1, first]
    least_p = -abs(p[2]) - p[3] - more_nu * curvature
    if second >= 0:
        third = max(abs(q[0, 2, second]), abs(q[1, 2, second])) + off[2, second]
        least_p -= more_mu * third

    for e in range(2):
        g = 1.0
        if second >= 0:
            g -= more_mu * max(rows.jerk[0, second], rows.jerk[1, second])
        c = -sigma[e] - more_nu * max(rows.acceleration[0, first], rows.acceleration[1, first])
        for i in range(n):
            if mu[e, i] != 0.0:
                g -= abs(mu[e, i]) * rows.jerk[0 if mu[e, i] > 0 else 1, i]
            if nu[e, i] != 0.0:
                c -= abs(nu[e, i]) * rows.acceleration[0 if nu[e, i] > 0 else 1, i]
        out[e, 0] = g - ROUNDINGS * (1 + abs(1 - g))
        out[e, 1] = p[e] + least_p - ROUNDINGS * (p[4] + abs(p[e]) + abs(least_p))
        out[e, 2] = c - ROUNDINGS * abs(c)
    is_finite = True
    for e in range(2):
        for i in range(3):
            is_finite = is_finite and np.isfinite(out[e, i])
    if not is_finite:
        out[:] = -np.inf


# Ends of the parts of the range of a, relative to the estimate of the minimising a.
CUTS = np.concatenate(
    [np.geomspace(1e-4, 0.7, 25), np.linspace(0.72, 1.3, 59), np.geomspace(1.35, 8, 12)],
)


@kernel
def bound_cell(sums: Floats3, about: float, cap: float, out: Floats1) -> None:
    """Fill out (2,) with lower bounds at both ends, from the sums (S, 2, 3) of S sets.

    Each part of the range of a uses one set all over the cell. So the bound is a minimum of linear
    functions: it is concave along the cell and lies above its chord.
    """
    out[:] = np.inf
    low = 0.0
    for cut in range(CUTS.size + 1):
        high = min(about * CUTS[cut], cap) if cut < CUTS.size else cap
        if not low < high:
            break
        best = first = second = -np.inf
        for n in range(len(sums)):
            one = add_below(least_over(sums[n, 0, 0], sums[n, 0, 1], low, high), sums[n, 0, 2])
            two = add_below(least_over(sums[n, 1, 0], sums[n, 1, 1], low, high), sums[n, 1, 2])
            if one + two > best:
                best = one + two
                first = one
                second = two
        out[0] = min(out[0], first)
        out[1] = min(out[1], second)
        low = high
    if not low >= cap:
        out[:] = -np.inf


@kernel
def bound_cells(rows: RowCells, third: bool, trial: Trial, out: Floats1) -> None:
    """Fill out (M,) with the proved least time (s) of each cell with the terms of λ, or −∞.

    third: whether the order is 3. At order 2 c is unbounded, and λb has to be 0.
    """
    sets = trial.rows.shape[1]
    sums = np.empty((sets, 2, 3))
    ends = np.empty(2)
    for k in range(len(out)):
        low = rows.speed[k, 0] - rows.speed_off[k]
        high = rows.speed[k, 1] - rows.speed_off[k]
        y = min(low, high)
        cap = 1 / y * (1 + ROUNDINGS) if y > 0 else np.inf  # of a, by the speed row
        lambda_a = trial.nodes[k : k + 2, 0]
        lambda_b = trial.nodes[k : k + 2, 1]
        bulge = trial.bulge[k]
        without_c = lambda_b[0] == 0 and lambda_b[1] == 0 and bulge == 0
        if without_c and lambda_a[0] == 0 and lambda_a[1] == 0:
            # y lies above its chord, and √y of the chord above the chord of √y
            slowness = (np.sqrt(low) + np.sqrt(high)) / 2 if y > 0 else 0.0
            out[k] = rows.width[k] * slowness * (1 - ROUNDINGS)
            continue
        first, second = find_movers(rows, k)
        out[k] = -np.inf
        if first < 0 or (third and second < 0) or not (third or without_c):
            continue
        movers = (first, second if third else -1)
        cell = CellTrial(lambda_a, lambda_b, bulge, trial.rows[k, 0], trial.speed[k, 0])
        sum_rows(rows, k, cell, movers, sums[0])
        for e in range(2):
            least = least_over(sums[0, e, 0], sums[0, e, 1], 0.0, cap)
            ends[e] = add_below(least, sums[0, e, 2])
        if sums[0, 0, 0] < 0 or sums[0, 1, 0] < 0:
            for n in range(1, sets):
                cell = CellTrial(lambda_a, lambda_b, bulge, trial.rows[k, n], trial.speed[k, n])
                sum_rows(rows, k, cell, movers, sums[n])
            bound_cell(sums, trial.about[k], cap, ends)
        total = add_below(ends[0], ends[1]) * rows.width[k] / 2
        out[k] = total - ROUNDINGS * abs(total) if total > -np.inf else total
