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
    """What rows are over M cells of a path, as values at both ends of a cell and how far from their chord it may be.

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


def enclose_rows(path: ActuatorPath, limits: Sequence[Limit], nodes: Array, piece: np.ndarray) -> RowCells:
    """Over the cells between nodes (M+1,), which lie in pieces (M,)."""
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
    """Values (2, M, m) at both ends of cells, τ (M,) each, and how far they and their chord may be from the truth."""
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
    """What asks for time and the bound knows nothing of: it may lie below the least time by what that costs."""
    known = (Acceleration, Jerk, *SPEED_LIMITS)
    found = [limit.name for limit in limits if not limit.geometric and not isinstance(limit, known)]
    if any(path.constant(piece) is not None for piece in range(len(path.breaks) - 1)):
        found.append("constant speed")
    return tuple(found)


def _add_speed(limit: Limit, along: Enclosure, within: tuple[Array, Array], speed: Array, speed_off: Array) -> None:
    """The rows y a ≤ 1 of a limit on speeds where they ask for more than those there are."""
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
    """The least of g/√a + p a over low ≤ a ≤ high, low > 0 or 0, high maybe ∞."""
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
    """A sum, no rounding above; −∞ of what is no number."""
    total = one + other - ROUNDINGS * (abs(one) + abs(other))
    return total if total > -np.inf and total < np.inf else -np.inf


@kernel
def sum_rows(
    rows: RowCells, k: int, third: bool, nodes: Array, bulge: float, given: Array, sigma: Array, out: Array
) -> None:
    """out (2, 3): g, P and K at both ends of cell k, surely, for multipliers given (2, 2, n) and sigma (2,).

    given is balanced here: what its rows leave of b and c at an end is taken by one row more of each kind.
    """
    n = rows.ends.shape[3]
    h = rows.width[k]
    q, off = rows.ends[k], rows.off[k]
    m = np.empty((2, 2, n))
    # the rows that balance: of which the axis moves most beside its bound, at the end where it does least
    first, second, most_first, most_second = -1, -1, 0.0, 0.0
    for i in range(n):
        least = min(abs(q[0, 0, i]), abs(q[1, 0, i])) - off[0, i]
        if q[0, 0, i] * q[1, 0, i] <= 0 or not least > 0:
            continue
        bound = max(rows.acceleration[0, i], rows.acceleration[1, i])
        if least / bound > most_first:
            first, most_first = i, least / bound
        bound = max(rows.jerk[0, i], rows.jerk[1, i])
        if least / bound > most_second:
            second, most_second = i, least / bound
    out[:] = -np.inf
    if first < 0 or (third and second < 0):
        return
    push = (nodes[k + 1, 1] - nodes[k, 1]) / h
    bend = (nodes[k + 1, 0] - nodes[k, 0]) / h
    left_b = left_c = 0.0  # what is left at the ends, by rounding, and as the sums bend
    for e in range(2):
        balance_b = 2 * nodes[k + e, 0] + push + (1.0 - 2.0 * e) * bulge
        balance_c = nodes[k + e, 1]
        size = 0.0
        for i in range(n):
            m[e, 0, i], m[e, 1, i] = given[e, 0, i], given[e, 1, i] if third else 0.0
            if not max(rows.acceleration[0, i], rows.acceleration[1, i]) < np.inf:
                m[e, 0, i] = 0.0
            if not max(rows.jerk[0, i], rows.jerk[1, i]) < np.inf:
                m[e, 1, i] = 0.0
            balance_c += m[e, 1, i] * q[e, 0, i]
        if third:
            m[e, 1, second] -= balance_c / q[e, 0, second]
        balance_c, size_c = nodes[k + e, 1], abs(nodes[k + e, 1])
        size = abs(2 * nodes[k + e, 0]) + (abs(nodes[k + 1, 1]) + abs(nodes[k, 1])) / h + abs(bulge)
        for i in range(n):
            balance_c += m[e, 1, i] * q[e, 0, i]
            size_c += abs(m[e, 1, i] * q[e, 0, i])
            balance_b += 3 * m[e, 1, i] * q[e, 1, i] + m[e, 0, i] * q[e, 0, i]
            size += abs(3 * m[e, 1, i] * q[e, 1, i]) + abs(m[e, 0, i] * q[e, 0, i])
        extra = balance_b / q[e, 0, first]
        m[e, 0, first] -= extra
        left_b = max(left_b, ROUNDINGS * (size + abs(extra * q[e, 0, first])))
        left_c = max(left_c, abs(balance_c) + ROUNDINGS * size_c)
    bent_b, bent_c, bent_p = 0.0, -bulge * h / 4, 0.0
    rough_b, rough_c, rough_p = 0.0, abs(bent_c), 0.0  # what is summed, and so rounded, at most
    for i in range(n):
        d = (m[1, 0, i] - m[0, 0, i]) / 2
        j = (m[1, 1, i] - m[0, 1, i]) / 2
        big, large = max(abs(m[0, 0, i]), abs(m[1, 0, i])), max(abs(m[0, 1, i]), abs(m[1, 1, i]))
        s1, s2, s3 = (q[1, 0, i] - q[0, 0, i]) / 2, (q[1, 1, i] - q[0, 1, i]) / 2, (q[1, 2, i] - q[0, 2, i]) / 2
        bent_c += j * s1
        bent_b += 3 * j * s2 + d * s1
        bent_p += j * s3 + d * s2
        most = max(abs(q[0, 0, i]), abs(q[1, 0, i])), max(abs(q[0, 1, i]), abs(q[1, 1, i]))
        rough_c += large * most[0]
        rough_b += 3 * large * most[1] + big * most[0]
        rough_p += large * max(abs(q[0, 2, i]), abs(q[1, 2, i])) + big * most[1]
        left_c += large * off[0, i]
        left_b += 3 * large * off[1, i] + big * off[0, i]
    left_c += abs(bent_c) + ROUNDINGS * (rough_c + left_c)
    left_b += abs(bent_b) + ROUNDINGS * (rough_b + left_b)
    more_c = more_b = 0.0
    if third:
        near = min(abs(q[0, 0, second]), abs(q[1, 0, second])) - off[0, second]
        more_c = left_c / near * (1 + ROUNDINGS)
        left_b += 3 * more_c * (max(abs(q[0, 1, second]), abs(q[1, 1, second])) + off[1, second])
    near = min(abs(q[0, 0, first]), abs(q[1, 0, first])) - off[0, first]
    more_b = left_b / near * (1 + ROUNDINGS)
    for e in range(2):
        g, p, c = 1.0, bend, 0.0
        size = abs(nodes[k, 0]) / h + abs(nodes[k + 1, 0]) / h + rough_p
        size += (sigma[0] + sigma[1]) * max(abs(rows.speed[k, 0]), abs(rows.speed[k, 1]))
        for i in range(n):
            value, jerk = m[e, 0, i], m[e, 1, i]
            if jerk != 0.0:
                g -= abs(jerk) * rows.jerk[0 if jerk > 0 else 1, i]
                p += jerk * q[e, 2, i]
            if value != 0.0:
                c -= abs(value) * rows.acceleration[0 if value > 0 else 1, i]
                p += value * q[e, 1, i]
        for i in range(n):
            p -= max(abs(m[0, 1, i]), abs(m[1, 1, i])) * off[2, i] + max(abs(m[0, 0, i]), abs(m[1, 0, i])) * off[1, i]
        s_y = (rows.speed[k, 1] - rows.speed[k, 0]) / 2
        p += sigma[e] * rows.speed[k, e] - max(sigma[0], sigma[1]) * rows.speed_off[k]
        c -= sigma[e]
        p -= abs(bent_p + (sigma[1] - sigma[0]) / 2 * s_y)
        if third:
            g -= more_c * max(rows.jerk[0, second], rows.jerk[1, second])
            p -= more_c * (max(abs(q[0, 2, second]), abs(q[1, 2, second])) + off[2, second])
        p -= more_b * (max(abs(q[0, 1, first]), abs(q[1, 1, first])) + off[1, first])
        c -= more_b * max(rows.acceleration[0, first], rows.acceleration[1, first])
        out[e, 0] = g - ROUNDINGS * (1 + abs(1 - g))
        out[e, 1] = p - ROUNDINGS * (size + abs(p))
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
def bound_cells(
    rows: RowCells, third: bool, nodes: Array, bulge: Array, given: Array, sigma: Array, about: Array, out: Array
) -> None:
    """Fill out (M,): what each cell surely takes, s, with what λ adds; −∞ where nothing is proved.

    nodes (M+1, 2), bulge (M,) of λ; given (M, S, 2, 2, n), sigma (M, S, 2): of the rows, in several sets
    about (M,): a near which the least is thought to be
    """
    sets = given.shape[1]
    sums, ends = np.empty((sets, 2, 3)), np.empty(2)
    for k in range(len(out)):
        y = min(rows.speed[k, 0], rows.speed[k, 1]) - rows.speed_off[k]  # speeds let no more than 1/y pass
        cap = 1 / y * (1 + ROUNDINGS) if y > 0 else np.inf
        if nodes[k, 0] == 0 and nodes[k, 1] == 0 and nodes[k + 1, 0] == 0 and nodes[k + 1, 1] == 0 and bulge[k] == 0:
            # y lies above its chord, and the square root of a chord lies above the chord of the square root
            first, last = rows.speed[k, 0] - rows.speed_off[k], rows.speed[k, 1] - rows.speed_off[k]
            slowness = (np.sqrt(first) + np.sqrt(last)) / 2 if y > 0 else 0.0
            out[k] = rows.width[k] * slowness * (1 - ROUNDINGS)
            continue
        sum_rows(rows, k, third, nodes, bulge[k], given[k, 0], sigma[k, 0], sums[0])
        for e in range(2):
            ends[e] = add_below(least_over(sums[0, e, 0], sums[0, e, 1], 0.0, cap), sums[0, e, 2])
        if sums[0, 0, 0] < 0 or sums[0, 1, 0] < 0:
            for n in range(1, sets):
                sum_rows(rows, k, third, nodes, bulge[k], given[k, n], sigma[k, n], sums[n])
            bound_cell(sums, about[k], cap, ends)
        out[k] = add_below(ends[0], ends[1]) * rows.width[k] / 2
        out[k] -= ROUNDINGS * abs(out[k]) if out[k] > -np.inf else 0.0
