"""A lower bound of the duration of every motion along a run that keeps the limits on speed, acceleration and jerk.

With a = ṡ², b = s̈, c = db/ds: a′ = 2b, b′ = c and T = ∫ ds/√a. For any λa, λb without jumps

    T ≥ ∫ φ ds − [λa a + λb b],   φ(s) ≤ 1/√a + λa′ a + (2λa + λb′) b + λb c  for all (a, b, c) allowed at s,

and for any multipliers μ, ν, σ ≥ 0 of the rows at s whose sum with the above leaves nothing of b and c,

    φ = min over a of g/√a + P a + K,   g = 1 − Σ |μ| J,   P = λa′ + Σ μ q‴ + Σ ν q″ + σ y,   K = −Σ |ν| A − σ.

Here λ is what a solver says, or anything; the rest is proved, cell by cell: docs/theory/lower_bound.md.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from kinematics.foundation.taylor_model import EPS, Series
from planner.certificate.enclosure import PLACE_ROUNDING, Enclosure
from planner.limits.axis import Acceleration, Jerk, PulseRate, Speed
from planner.limits.limit import AxisLimit, Limit
from planner.limits.tool import AngularSpeed, ToolLimit, ToolSpeed
from planner.path.actuation import ActuatorPath

AXIS_ROWS = (Acceleration, Jerk)  # limits with rows of their own for each axis
SPEED_LIMITS = (Speed, PulseRate, ToolSpeed, AngularSpeed)

PATH_ORDER = 6  # of the series of q over a cell: q‴ keeps its slope
LEAST_STRETCH = 2.0**-8  # share of a piece that is enclosed around a cell at least, as half of a stretch
ROUNDINGS = 256 * EPS  # of any one sum or product below: fewer


class RowCells(NamedTuple):
    """Rows over M cells of a path, as values at both ends of a cell and how far from their chord it may be.

    width (M,) m, between nodes (M+1,)
    ends (M, 2, 3, n) of q′, q″, q‴; off (M, 3, n): that and the error of the ends
    speed (M, 2): y of ya ≤ 1 from speeds, 0 where there is none; speed_off (M,)
    acceleration, jerk (2, n): bounds towards greater and smaller values, ∞ where there is none
    """

    nodes: Array
    width: Array
    ends: Array
    off: Array
    speed: Array
    speed_off: Array
    acceleration: Array
    jerk: Array


class Trial(NamedTuple):
    """Multipliers for which cells are bounded; of rows in S sets, each for a part of the range of a. Any will do.

    nodes (M+1, 2), bulge (M,): λ, and by how much λb′ differs at a cell's ends from its mean
    rows (M, S, 2, 2, n), speed (M, S, 2): at both ends of each cell, those of acceleration (ν) and of jerk (μ); σ
    about (M,)  m²/s², a at which the least is thought to be
    """

    nodes: Array
    bulge: Array
    rows: Array
    speed: Array
    about: Array


class CellTrial(NamedTuple):
    """One set of these for one cell: λ at both ends (2,), the bulge, ν and μ (2, 2, n), σ (2,)."""

    lambda_a: Array
    lambda_b: Array
    bulge: float
    rows: Array
    speed: Array


def enclose_rows(path: ActuatorPath, limits: Sequence[Limit], nodes: Array, piece: np.ndarray) -> RowCells:
    """Enclose the rows over the cells between nodes (M+1,), which lie in pieces (M,)."""
    count, axes = len(piece), len(path.names)
    # of stretches of path that are not too short beside their piece for rounding to tell derivatives
    first, last = path.breaks[piece], path.breaks[piece + 1]
    half = np.maximum((nodes[1:] - nodes[:-1]) / 2, (last - first) * LEAST_STRETCH) * (1 + 8 * EPS)
    centre = np.clip((nodes[1:] + nodes[:-1]) / 2, first + half, np.maximum(last - half, first + half))
    mid = np.tile(np.stack([centre, half]), 2)
    rad = np.zeros((2, 2 * count))
    rad[0, count:] = half * (1 + 16 * EPS)
    # equal runs elsewhere on the path share the bound, and their breaks are rounded differently
    rad[0] += PLACE_ROUNDING * np.abs(path.breaks[[0, -1]]).max()
    along = Enclosure(path, Series(mid, rad, PATH_ORDER), np.tile(1 / half, 2)[:, None], piece)
    within = (nodes[:-1] - centre) / half, (nodes[1:] - centre) / half
    derivatives = [_end_values(each, within) for each in (along.qd, along.qdd, along.qddd)]
    ends = np.stack([values for values, _ in derivatives], 2).transpose(1, 0, 2, 3)
    off = np.stack([error for _, error in derivatives], 1)
    bounds = np.full((2, 2, axes), np.inf)
    speed, speed_off = np.zeros((count, 2)), np.zeros(count)
    for limit in limits:
        if isinstance(limit, (Acceleration, Jerk)):
            own = bounds[int(isinstance(limit, Jerk))]
            np.minimum(own, np.stack([limit.bounds, limit.below]), out=own)
        elif isinstance(limit, SPEED_LIMITS):
            _add_speed(limit, along, within, speed, speed_off)
    return RowCells(nodes, np.diff(nodes), np.ascontiguousarray(ends), off, speed, speed_off, *bounds)


def _end_values(series: Series, within: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return values (2, M, m) at both ends of cells, τ (M,) each, and the error of them and of their chord."""
    count = len(within[0])
    full = series.pad(series.order)
    polynomial, radii = full.mid[:-1, :count], full.rad[:-1, :count]
    low, high = (tau[:, None] for tau in within)
    reach = np.maximum(np.abs(low), np.abs(high))
    ends, error = np.zeros((2, *polynomial.shape[1:])), np.abs(full.mid[-1, count:]) + full.rad[-1, count:]
    size, bend = 0.0, 0.0
    for k in range(len(polynomial) - 1, -1, -1):
        ends[0], ends[1] = ends[0] * low + polynomial[k], ends[1] * high + polynomial[k]
        error = error * reach + radii[k]
        size = size * reach + np.abs(polynomial[k])
        bend = bend * reach + (k + 2) * (k + 1) * np.abs(polynomial[k + 2]) if k + 2 < len(polynomial) else bend
    # beyond its chord a function goes by an eighth of its bend at most; what stands for higher powers is off at the
    # ends and in between
    off = (2 * error + bend * (high - low) ** 2 / 8 + ROUNDINGS * size) * (1 + ROUNDINGS)
    return ends, np.where(np.isfinite(off), off, np.inf)


def find_left_out(path: ActuatorPath, limits: Sequence[Limit]) -> tuple[str, ...]:
    """List what costs time and the bound does not account for: it may lie below the least time by as much."""
    known = (Acceleration, Jerk, *SPEED_LIMITS)
    found = [limit.name for limit in limits if not limit.geometric and not isinstance(limit, known)]
    if any(path.constant(piece) is not None for piece in range(len(path.breaks) - 1)):
        found.append("constant speed")
    return tuple(found)


def _add_speed(limit: Limit, along: Enclosure, within: tuple[Array, Array], speed: Array, speed_off: Array) -> None:
    """Add the rows y a ≤ 1 of a limit on speeds where they ask for more than those there are."""
    count = len(speed)
    value = limit.value(along)
    channels = value.mid.shape[2]
    if isinstance(limit, AxisLimit):
        ends, error = _end_values(value, within)
        forwards = (ends.sum(0) >= 0) | ~np.isfinite(ends.sum(0))
        definite = np.where(forwards, np.minimum(*ends) - error > 0, np.maximum(*ends) + error < 0)
        own = np.where(forwards, limit.bounds, limit.below)
        own = np.where(definite, own, np.maximum(limit.bounds, limit.below))
        square = value * value
    else:
        assert isinstance(limit, ToolLimit)
        own, square = np.broadcast_to(limit.caps[along.piece][:, None], (count, channels)), value
    ends, error = _end_values(square, within)
    with np.errstate(invalid="ignore"):
        ends, error = ends / own**2, error / own**2 * (1 + ROUNDINGS) + ROUNDINGS * np.abs(ends / own**2).max(0)
    middle = np.where(np.isfinite(ends.sum(0) + error), ends.sum(0), -1.0)
    best = middle.argmax(1)
    every = np.arange(count)
    more = np.flatnonzero(middle[every, best] > speed.sum(1))
    speed[more] = ends[:, more, best[more]].T
    speed_off[more] = error[more, best[more]]


@kernel
def least_over(g: float, p: float, low: float, high: float) -> float:
    """Return the least of g/√a + p a over low ≤ a ≤ high, low > 0 or 0, high maybe ∞."""
    best = np.inf
    if low > 0:
        best = g / np.sqrt(low) + p * low - ROUNDINGS * (abs(g) / np.sqrt(low) + abs(p) * low)
    elif g < 0:
        return -np.inf
    elif g == 0:
        best = 0.0
    if high < np.inf:
        best = min(best, g / np.sqrt(high) + p * high - ROUNDINGS * (abs(g) / np.sqrt(high) + abs(p) * high))
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
def add_below(one: float, other: float) -> float:
    """Return a sum that rounding does not raise; −∞ where it is no number."""
    total = one + other - ROUNDINGS * (abs(one) + abs(other))
    return total if total > -np.inf and total < np.inf else -np.inf


@kernel
def find_movers(rows: RowCells, k: int) -> tuple[int, int]:
    """Return the axes that surely move most beside their limit of acceleration, and of jerk; −1 for none."""
    first = second = -1
    most_first = most_second = 0.0
    for i in range(rows.ends.shape[3]):
        one, two = rows.ends[k, 0, 0, i], rows.ends[k, 1, 0, i]
        least = min(abs(one), abs(two)) - rows.off[k, 0, i]
        if one * two <= 0 or not least > 0:
            continue
        use = least / max(rows.acceleration[0, i], rows.acceleration[1, i])
        if use > most_first:
            first, most_first = i, use
        use = least / max(rows.jerk[0, i], rows.jerk[1, i])
        if use > most_second:
            second, most_second = i, use
    return first, second


@kernel
def add_products(factor: float, m: Array, q: Array, off: Array, out: Array) -> None:
    """Add factor · Σ m q over a cell to out (5,): at both ends, its bend, its error, and the size of all summands.

    m (2, n) are linear along the cell, q (2, n) up to off (n,). A product of two chords leaves its own chord by a
    quarter of what the two changes make.
    """
    for i in range(q.shape[1]):
        most = factor * max(abs(m[0, i]), abs(m[1, i]))
        out[0] += factor * m[0, i] * q[0, i]
        out[1] += factor * m[1, i] * q[1, i]
        out[2] += factor * (m[1, i] - m[0, i]) * (q[1, i] - q[0, i]) / 4
        out[3] += most * off[i]
        out[4] += most * max(abs(q[0, i]), abs(q[1, i]))


@kernel
def bound_size(total: Array) -> float:
    """Return the most that a sum of `add_products` can be over its cell."""
    most = max(abs(total[0]), abs(total[1])) + abs(total[2]) + total[3]
    size: float = (most + ROUNDINGS * (total[4] + abs(total[2]))) * (1 + ROUNDINGS)
    return size


@kernel
def sum_rows(rows: RowCells, k: int, cell: CellTrial, movers: tuple[int, int], out: Array) -> None:
    """Fill out (2, 3): g, P and K at both ends of cell k, surely. A mover of jerk of −1 stands for order 2.

    What the given multipliers leave of R and Q at an end is taken by the mover's rows; what then is left in between,
    |R| ≤ r and |Q| ≤ ρ, by one row more of each kind.
    """
    first, second = movers
    n, h = rows.ends.shape[3], rows.width[k]
    q, off = rows.ends[k], rows.off[k]
    lambda_a, lambda_b, bulge = cell.lambda_a, cell.lambda_b, cell.bulge
    mu, nu = np.zeros((2, n)), np.zeros((2, n))
    for e in range(2):
        for i in range(n):
            if max(rows.acceleration[0, i], rows.acceleration[1, i]) < np.inf:
                nu[e, i] = cell.rows[e, 0, i]
            if second >= 0 and max(rows.jerk[0, i], rows.jerk[1, i]) < np.inf:
                mu[e, i] = cell.rows[e, 1, i]

    slope_a, slope_b = (lambda_a[1] - lambda_a[0]) / h, (lambda_b[1] - lambda_b[0]) / h
    size_a = (abs(lambda_a[0]) + abs(lambda_a[1])) / h
    size_b = 2 * max(abs(lambda_a[0]), abs(lambda_a[1])) + (abs(lambda_b[0]) + abs(lambda_b[1])) / h + abs(bulge)
    # R = λb + Σ μ q′, of which λb bends
    r, rho, p = np.zeros(5), np.zeros(5), np.zeros(5)
    r[0], r[1], r[2] = lambda_b[0], lambda_b[1], -bulge * h / 4
    r[4] = max(abs(lambda_b[0]), abs(lambda_b[1])) + abs(r[2])
    if second >= 0:
        for e in range(2):
            mu[e, second] -= (lambda_b[e] + (mu[e] * q[e, 0]).sum()) / q[e, 0, second]
        add_products(1.0, mu, q[:, 0], off[0], r)
    # Q = 2 λa + λb′ + 3 Σ μ q″ + Σ ν q′
    for e in range(2):
        rho[e] = 2 * lambda_a[e] + slope_b + (1.0 - 2.0 * e) * bulge
    rho[4] = size_b
    add_products(3.0, mu, q[:, 1], off[1], rho)
    for e in range(2):
        nu[e, first] -= (rho[e] + (nu[e] * q[e, 0]).sum()) / q[e, 0, first]
    add_products(1.0, nu, q[:, 0], off[0], rho)
    # P = λa′ + Σ μ q‴ + Σ ν q″ + σ y
    p[0] = p[1] = slope_a
    p[4] = size_a
    add_products(1.0, mu, q[:, 2], off[2], p)
    add_products(1.0, nu, q[:, 1], off[1], p)
    sigma = cell.speed.reshape(2, 1)
    # strided views as q and off are: other memory layouts would compile the kernel again
    y = rows.speed.T[:, k : k + 1]
    add_products(1.0, sigma, y, rows.speed_off[k : k + 1 : 1], p)

    # one row more of each kind: |μ| ≤ r / min |q′|, |ν| ≤ ρ / min |q′|
    more_mu, left = 0.0, bound_size(rho)
    if second >= 0:
        near = min(abs(q[0, 0, second]), abs(q[1, 0, second])) - off[0, second]
        more_mu = bound_size(r) / near * (1 + ROUNDINGS)
        left += 3 * more_mu * (max(abs(q[0, 1, second]), abs(q[1, 1, second])) + off[1, second])
    near = min(abs(q[0, 0, first]), abs(q[1, 0, first])) - off[0, first]
    more_nu = left / near * (1 + ROUNDINGS)
    least_p = -abs(p[2]) - p[3] - more_nu * (max(abs(q[0, 1, first]), abs(q[1, 1, first])) + off[1, first])
    if second >= 0:
        least_p -= more_mu * (max(abs(q[0, 2, second]), abs(q[1, 2, second])) + off[2, second])

    for e in range(2):
        g = 1.0 - (more_mu * max(rows.jerk[0, second], rows.jerk[1, second]) if second >= 0 else 0.0)
        c = -sigma[e, 0] - more_nu * max(rows.acceleration[0, first], rows.acceleration[1, first])
        for i in range(n):
            if mu[e, i] != 0.0:
                g -= abs(mu[e, i]) * rows.jerk[0 if mu[e, i] > 0 else 1, i]
            if nu[e, i] != 0.0:
                c -= abs(nu[e, i]) * rows.acceleration[0 if nu[e, i] > 0 else 1, i]
        out[e, 0] = g - ROUNDINGS * (1 + abs(1 - g))
        out[e, 1] = p[e] + least_p - ROUNDINGS * (p[4] + abs(p[e]) + abs(least_p))
        out[e, 2] = c - ROUNDINGS * abs(c)
    if not np.isfinite(out).all():
        out[:] = -np.inf


# Beside a that the least is thought to be at, where one set of multipliers may give way to the next.
CUTS = np.concatenate([np.geomspace(1e-4, 0.7, 25), np.linspace(0.72, 1.3, 59), np.geomspace(1.35, 8, 12)])


@kernel
def bound_cell(sums: Array, about: float, cap: float, out: Array) -> None:
    """Fill out (2,): lower bounds at both ends, of sums (S, 2, 3) of any of several sets of multipliers.

    Each part of the range of a has a set that serves it, the same all over the cell: so each bound is the least of
    linear functions, concave along the cell, and above its chord.
    """
    out[:] = np.inf
    low = 0.0
    for cut in range(CUTS.size + 1):
        high = min(about * CUTS[cut], cap) if cut < CUTS.size else cap
        if not low < high:
            break
        best, first, second = -np.inf, -np.inf, -np.inf
        for n in range(len(sums)):
            one = add_below(least_over(sums[n, 0, 0], sums[n, 0, 1], low, high), sums[n, 0, 2])
            two = add_below(least_over(sums[n, 1, 0], sums[n, 1, 1], low, high), sums[n, 1, 2])
            if one + two > best:
                best, first, second = one + two, one, two
        out[0], out[1] = min(out[0], first), min(out[1], second)
        low = high
    if not low >= cap:
        out[:] = -np.inf


@kernel
def bound_cells(rows: RowCells, third: bool, trial: Trial, out: Array) -> None:
    """Fill out (M,): the least time of each cell (s) with the terms of λ, proved; −∞ where nothing is proved.

    third: at order 3. At order 2 nothing is known of c, and λb has to be 0.
    """
    sets = trial.rows.shape[1]
    sums, ends = np.empty((sets, 2, 3)), np.empty(2)
    for k in range(len(out)):
        low, high = rows.speed[k, 0] - rows.speed_off[k], rows.speed[k, 1] - rows.speed_off[k]
        y = min(low, high)  # speeds let no more than 1/y pass
        cap = 1 / y * (1 + ROUNDINGS) if y > 0 else np.inf
        lambda_a, lambda_b, bulge = trial.nodes[k : k + 2, 0], trial.nodes[k : k + 2, 1], trial.bulge[k]
        without_c = lambda_b[0] == 0 and lambda_b[1] == 0 and bulge == 0
        if without_c and lambda_a[0] == 0 and lambda_a[1] == 0:
            # y lies above its chord, and the square root of a chord lies above the chord of the square root
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
            ends[e] = add_below(least_over(sums[0, e, 0], sums[0, e, 1], 0.0, cap), sums[0, e, 2])
        if sums[0, 0, 0] < 0 or sums[0, 1, 0] < 0:
            for n in range(1, sets):
                cell = CellTrial(lambda_a, lambda_b, bulge, trial.rows[k, n], trial.speed[k, n])
                sum_rows(rows, k, cell, movers, sums[n])
            bound_cell(sums, trial.about[k], cap, ends)
        total = add_below(ends[0], ends[1]) * rows.width[k] / 2
        out[k] = total - ROUNDINGS * abs(total) if total > -np.inf else total
