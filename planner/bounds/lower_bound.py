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
from numpy.polynomial.polynomial import polyder, polyval

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
from planner.certificate.enclosure import PLACE_ROUNDING, Enclosure, cover_places, split_series
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

    width (M,)         m
    ends (M, 2, 3, n)  q′, q″, q‴ at both ends
    off (M, 3, n)      their greatest distance from the chord, with the error of the ends
    speed (M, 2, 1)    y of the speed row ya ≤ 1, 0 without a row
    speed_off (M, 1)   its greatest distance from the chord
    acceleration, jerk (2, n)  bounds towards greater and smaller values, ∞ without a bound
    """

    width: Floats1
    ends: Floats4
    off: Floats3
    speed: Floats3
    speed_off: Floats2
    acceleration: Floats2
    jerk: Floats2

    def cut(self, cells: slice) -> "RowCells":
        """Return some of the cells."""
        return self._replace(
            width=self.width[cells],
            ends=self.ends[cells],
            off=self.off[cells],
            speed=self.speed[cells],
            speed_off=self.speed_off[cells],
        )


class Trial(NamedTuple):
    """Multipliers of M cells, in S sets for the rows, each for a part of the range of a.

    All values are valid.

    nodes (M+1, 2)        λa, λb
    bulge (M,)            difference of λb′ at a cell's ends from its mean
    rows (M, S, 2, 2, n)  ν (acceleration) and μ (jerk) at both ends of each cell
    speed (M, S, 2, 1)    σ at both ends
    about (M,)            m²/s², estimate of the minimising a
    """

    nodes: Floats2
    bulge: Floats1
    rows: Floats5
    speed: Floats4
    about: Floats1


def enclose_rows(
    path: ActuatorPath,
    limits: Sequence[Limit],
    nodes: Array,
    piece: np.ndarray,
) -> RowCells:
    """Enclose the rows over the cells between nodes (M+1,), which lie in pieces (M,)."""
    count = len(piece)
    first = path.breaks[piece]
    last = path.breaks[piece + 1]
    width = np.diff(nodes)
    least = (last - first) * LEAST_HALF
    half = np.maximum(width / 2, least) * (1 + 8 * EPS)
    lowest = first + half
    middle = (nodes[1:] + nodes[:-1]) / 2
    centre = np.clip(middle, lowest, np.maximum(last - half, lowest))
    places = cover_places(centre, half, PATH_ORDER)
    # equal runs share a bound, and the breaks of each are rounded differently
    places.rad[0] += PLACE_ROUNDING * np.abs(path.breaks[[0, -1]]).max()
    along = Enclosure(
        path,
        places,
        np.tile(1 / half, 2)[:, None],
        piece,
    )
    within = (np.stack([nodes[:-1], nodes[1:]]) - centre) / half
    derivatives = (along.qd, along.qdd, along.qddd)
    values = [_end_values(each, within) for each in derivatives]
    ends = np.stack([each for each, _ in values], -2)
    off = np.stack([each for _, each in values], -2)
    bounds = np.full((2, 2, len(path.names)), np.inf)
    rows = RowCells(
        width=width,
        ends=np.ascontiguousarray(ends.swapaxes(0, 1)),
        off=np.ascontiguousarray(off),
        speed=np.zeros((count, 2, 1)),
        speed_off=np.zeros((count, 1)),
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


def _end_values(series: Series, within: Array) -> tuple[Array, Array]:
    """Return values (2, M, m) at both ends of cells, τ (2, M), and the error of their chord."""
    polynomial, errors = split_series(series, within.shape[1])
    sizes = np.abs(polynomial)
    low, high = within[..., None]
    reach = np.maximum(np.abs(low), np.abs(high))
    error = polyval(reach, errors, tensor=False)
    size = polyval(reach, sizes, tensor=False)
    # a function leaves its chord by at most h²/8 |f″|; the error counts at the ends and in between
    curvature = polyval(reach, polyder(sizes, 2), tensor=False)
    chord = curvature * (high - low) ** 2 / 8
    off = (2 * error + chord + ROUNDINGS * size) * (1 + ROUNDINGS)
    ends = np.stack([polyval(tau, polynomial, tensor=False) for tau in (low, high)])
    return ends, np.where(np.isfinite(off), off, np.inf)


def find_left_out(
    path: ActuatorPath,
    limits: Sequence[Limit],
) -> tuple[str, ...]:
    """List the limits that the bound leaves out. It is too low by the time that these cost."""
    known = (*AXIS_ROWS, *SPEED_LIMITS)
    names = [limit.name for limit in select_timed(limits) if not isinstance(limit, known)]
    if has_constant_speed(path):
        names.append("constant speed")
    return tuple(names)


def _add_speed(
    limit: Limit,
    along: Enclosure,
    within: Array,
    rows: RowCells,
) -> None:
    """Replace the speed rows y a ≤ 1 of the cells where this limit's rows are tighter."""
    count = len(rows.width)
    value = limit.value(along)
    if isinstance(limit, AxisLimit):
        ends, error = _end_values(value, within)
        total = ends.sum(0)
        forwards = (total >= 0) | ~np.isfinite(total)
        definite = np.where(
            forwards,
            np.minimum(*ends) - error > 0,
            np.maximum(*ends) + error < 0,
        )
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
        rounding = ROUNDINGS * np.abs(ends).max(0)
        error = error / cap**2 * (1 + ROUNDINGS) + rounding
    total = ends.sum(0)
    total = np.where(np.isfinite(total + error), total, -1.0)
    best = total.argmax(1)
    earlier = rows.speed[:, :, 0].sum(1)
    tighter = np.flatnonzero(total[np.arange(count), best] > earlier)
    rows.speed[tighter, :, 0] = ends[:, tighter, best[tighter]].T
    rows.speed_off[tighter, 0] = error[tighter, best[tighter]]


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
            best = min(
                best,
                3 * (g / 2) ** (2 / 3) * p ** (1 / 3) * (1 - ROUNDINGS),
            )
    return best


@kernel
def larger(q: Strided2, i: int) -> float:
    """Return the larger size of two numbers q (2, n) of axis i, as at both ends of a cell."""
    size: float = max(abs(q[0, i]), abs(q[1, i]))
    return size


@kernel
def add_products(
    factor: float,
    m: Floats2,
    q: Strided2,
    off: Floats1,
    out: Floats1,
) -> None:
    """Add factor · Σ m q over a cell to out (5,): both ends, bulge, error, and size of summands.

    m (2, n) is linear along the cell, and q (2, n) is up to off (n,). The product of two chords
    leaves its chord by at most a quarter of the product of their changes.
    """
    for i in range(q.shape[1]):
        most = factor * larger(m, i)
        out[0] += factor * m[0, i] * q[0, i]
        out[1] += factor * m[1, i] * q[1, i]
        change = (m[1, i] - m[0, i]) * (q[1, i] - q[0, i])
        out[2] += factor * change / 4
        out[3] += most * off[i]
        out[4] += most * larger(q, i)


@kernel
def copy_to(source: Strided2, out: Floats2) -> None:
    """Copy an array (2, n): a loop, since an assignment compiles code for errors of shapes."""
    for m in range(2):
        for i in range(out.shape[1]):
            out[m, i] = source[m, i]


@kernel
def bound_product(size: float, bound: float) -> float:
    """Return size · bound; 0 for a row that is not used, whatever its bound is."""
    return size * bound if size != 0.0 else 0.0


@kernel
def sum_costs(m: Strided1, bounds: Floats2) -> float:
    """Return Σ |m| times the bound of the side that the sign of m says."""
    total = 0.0
    for i in range(m.size):
        side = 0 if m[i] > 0 else 1
        total += bound_product(abs(m[i]), bounds[side, i])
    return total


@kernel
def cancel(
    m: Floats2,
    q: Strided2,
    off: Floats1,
    bounds: Floats2,
    out: Floats1,
) -> tuple[int, float]:
    """Add Σ m q′ to the sum `out` of `add_products`, with m of one axis such that both ends are 0.

    The axis is the one with the largest proved q′ relative to its bounds. One more of its rows
    cancels the rest r in between: |m| ≤ r / min |q′|. Return the axis and the bound of this |m|;
    ∞ if no axis surely moves.
    """
    mover = -1
    most = near = 0.0
    for i in range(q.shape[1]):
        least = min(abs(q[0, i]), abs(q[1, i])) - off[i]
        use = least / larger(bounds, i)
        if q[0, i] * q[1, i] > 0 and use > most:
            mover = i
            most = use
            near = least
    if mover >= 0:
        for e in range(2):
            total = out[e]
            for i in range(q.shape[1]):
                total += m[e, i] * q[e, i]
            m[e, mover] -= total / q[e, mover]
    add_products(1.0, m, q, off, out)
    bulge = abs(out[2])
    rest = max(abs(out[0]), abs(out[1])) + bulge + out[3]
    rest = (rest + ROUNDINGS * (out[4] + bulge)) * (1 + ROUNDINGS)
    if rest == 0.0:
        return 0, 0.0
    if mover < 0:
        return 0, np.inf
    return mover, rest / near * (1 + ROUNDINGS)


@kernel
def sum_rows(rows: RowCells, trial: Trial, k: int, n: int, out: Floats2) -> None:
    """Fill out (2, 3) with proved g, P and K at both ends of cell k by the n-th set, or −∞."""
    h = rows.width[k]
    q = rows.ends[k]
    off = rows.off[k]
    lambda_a = trial.nodes[k : k + 2, 0]
    lambda_b = trial.nodes[k : k + 2, 1]
    bulge = trial.bulge[k]
    slope_a = (lambda_a[1] - lambda_a[0]) / h
    slope_b = (lambda_b[1] - lambda_b[0]) / h
    nu = np.zeros((2, q.shape[2]))
    mu = np.zeros((2, q.shape[2]))
    copy_to(trial.rows[k, n, :, 0], nu)
    copy_to(trial.rows[k, n, :, 1], mu)
    r = np.zeros(5)
    rho = np.zeros(5)
    p = np.zeros(5)
    for e in range(2):
        r[e] = lambda_b[e]
        rho[e] = 2 * lambda_a[e] + slope_b + (1.0 - 2.0 * e) * bulge
        p[e] = slope_a
    size_a = max(abs(lambda_a[0]), abs(lambda_a[1]))
    size_b = max(abs(lambda_b[0]), abs(lambda_b[1]))

    # R = λb + Σ μ q′, where λb is quadratic
    r[2] = -bulge * h / 4
    r[4] = size_b + abs(r[2])
    mover, more_mu = cancel(mu, q[:, 0], off[0], rows.jerk, r)

    # Q = 2 λa + λb′ + 3 Σ μ q″ + Σ ν q′
    add_products(3.0, mu, q[:, 1], off[1], rho)
    rho[3] += 3 * more_mu * (larger(q[:, 1], mover) + off[1, mover])
    rho[4] += 2 * size_a + abs(bulge) + 2 * size_b / h
    first, more_nu = cancel(nu, q[:, 0], off[0], rows.acceleration, rho)

    # P = λa′ + Σ μ q‴ + Σ ν q″ + σ y
    p[4] = 2 * size_a / h
    add_products(1.0, mu, q[:, 2], off[2], p)
    add_products(1.0, nu, q[:, 1], off[1], p)
    add_products(1.0, trial.speed[k, n], rows.speed[k], rows.speed_off[k], p)
    least = -abs(p[2]) - p[3]
    least -= more_nu * (larger(q[:, 1], first) + off[1, first])
    least -= more_mu * (larger(q[:, 2], mover) + off[2, mover])

    jerk = bound_product(more_mu, larger(rows.jerk, mover))
    acceleration = more_nu * larger(rows.acceleration, first)
    is_finite = True
    for e in range(2):
        g = 1 - jerk - sum_costs(mu[e], rows.jerk)
        c = -acceleration - sum_costs(nu[e], rows.acceleration)
        c -= trial.speed[k, n, e, 0]
        size = p[4] + abs(p[e]) + abs(least)
        out[e, 0] = g - ROUNDINGS * (1 + abs(1 - g))
        out[e, 1] = p[e] + least - ROUNDINGS * size
        out[e, 2] = c - ROUNDINGS * abs(c)
        for i in range(3):
            is_finite = is_finite and np.isfinite(out[e, i])
    if not is_finite:
        out[:] = -np.inf


# Ends of the parts of the range of a, relative to the estimate of the minimising a.
CUTS = np.concatenate(
    [
        np.geomspace(1e-4, 0.7, 25),
        np.linspace(0.72, 1.3, 59),
        np.geomspace(1.35, 8, 12),
    ],
)


@kernel
def bound_cell(
    sums: Floats3,
    about: float,
    cap: float,
    out: Floats1,
) -> None:
    """Fill out (2,) with lower bounds at both ends, from the sums (S, 2, 3) of S sets.

    A single set serves all a up to the cap. Of several, each part of the range of a uses one set
    all over the cell. So the bound is a minimum of linear functions: it is concave along the cell
    and lies above its chord.
    """
    out[:] = np.inf
    low = 0.0
    cuts = CUTS.size if len(sums) > 1 else 0
    for cut in range(cuts + 1):
        high = min(about * CUTS[cut], cap) if cut < cuts else cap
        if not low < high:
            break
        best = first = second = -np.inf
        for n in range(len(sums)):
            one = add_below(
                least_over(sums[n, 0, 0], sums[n, 0, 1], low, high),
                sums[n, 0, 2],
            )
            two = add_below(
                least_over(sums[n, 1, 0], sums[n, 1, 1], low, high),
                sums[n, 1, 2],
            )
            if one + two > best:
                best = one + two
                first = one
                second = two
        out[0] = min(out[0], first)
        out[1] = min(out[1], second)
        low = high
    if not low >= cap:
        out[:] = -np.inf


def bound_by_speed(rows: RowCells) -> Array:
    """Return the least time (M,) s of each cell by the limits on speed alone: λ = 0."""
    ends = rows.speed[:, :, 0] - rows.speed_off
    # y lies above its chord, and √y of the chord above the chord of √y
    slowness = np.sqrt(np.maximum(ends, 0.0)).mean(1)
    slowness = np.where(ends.min(1) > 0, slowness, 0.0)
    return np.asarray(rows.width * slowness * (1 - ROUNDINGS))


@kernel
def bound_cells(rows: RowCells, trial: Trial, out: Floats1) -> None:
    """Fill out (M,) with the proved least time (s) of each cell with the terms of λ, or −∞.

    Cells with λ = 0 keep their value, the result of `bound_by_speed`. Without a jerk limit c is
    unbounded, and only λb = 0 has a bound.
    """
    sets = trial.rows.shape[1]
    sums = np.empty((sets, 2, 3))
    ends = np.empty(2)
    for k in range(len(out)):
        size = abs(trial.bulge[k])
        for i in range(2):
            size += abs(trial.nodes[k, i]) + abs(trial.nodes[k + 1, i])
        if size == 0.0:
            continue
        sum_rows(rows, trial, k, 0, sums[0])
        used = 1
        if min(sums[0, 0, 0], sums[0, 1, 0]) < 0:
            for n in range(1, sets):
                sum_rows(rows, trial, k, n, sums[n])
            used = sets
        y = min(rows.speed[k, 0, 0], rows.speed[k, 1, 0]) - rows.speed_off[k, 0]
        cap = 1 / y * (1 + ROUNDINGS) if y > 0 else np.inf  # of a, by the speed row
        bound_cell(sums[:used], trial.about[k], cap, ends)
        total = add_below(ends[0], ends[1]) * rows.width[k] / 2
        out[k] = total - ROUNDINGS * abs(total) if total > -np.inf else total
