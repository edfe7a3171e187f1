"""Multipliers for the lower bound of the duration: an interior-point method on the dual problem.

On cells of a path, with a = ṡ², b = s̈, c = db/ds as three free numbers x at both ends of each cell,

    minimise Σ w/√a  such that  −A₋ ≤ q′b + q″a ≤ A₊,  −J₋ ≤ √a (q′c + 3q″b + q‴a) ≤ J₊,  ya ≤ 1,  and
    Σ w (λa′a + (2λa + λb′) b + λb c) = [λa a + λb b]  for all λa linear and λb quadratic on each cell:

a′ = 2b and b′ = c as seen by these. Its multipliers λ are what `planner.bounds.lower_bound` makes a proof of.
Newton's method on the optimality conditions; the cells' systems are tridiagonal in the nodes' λ. The rows of jerk
are not convex: what their curvature takes off that of the duration is left out where nothing would remain.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel

MAX_ITERATIONS = 80
# Complementarity and miss of the equations, as shares of the duration, at which λ is good enough for the bound.
DUAL_TOLERANCE, TO_BOUNDARY = 1e-5, 0.99
# Where steps become so short, by rounding, what has been reached is taken if its complementarity is at most this.
LEAST_CURVATURE = 0.01
# What is added to the curvature by a and b so that first steps stay near, of what that by a is; it goes as μ does.
STEADINESS = 1.0
# Of what rounding leaves of a pivot, beside what it was.
LEAST_PIVOT = 1e-14
SHORT_STEP, ROUGH_TOLERANCE = 0.05, 1e-3


class DualCells(NamedTuple):
    """M cells on n axes, scaled so that times and ways are near 1.

    width (M,); q (M, 2, 3, n): q′, q″, q‴ at both ends; y (M, 2) of the speed row
    acceleration, jerk (2, n): towards greater and smaller values, ∞ where there is none
    root (M, 2): about √a
    given (2, 2): a and b at the start and at the end; free (M+1, 2): nodes at which λ shall be 0
    """

    width: Array
    q: Array
    y: Array
    acceleration: Array
    jerk: Array
    root: Array
    given: Array
    free: np.ndarray


class Multipliers(NamedTuple):
    """λ (M+1, 2) at the nodes, bulge (M,) by which λb′ differs at a cell's ends, and of the rows at both ends of each
    cell (M, 2, …): rows (…, 2, n) of acceleration and jerk, with their signs, and speed (…).
    x (M, 2, 3): a, b, c.
    """

    nodes: Array
    bulge: Array
    rows: Array
    speed: Array
    x: Array
    iterations: int


def maximise_dual(cells: DualCells, x: Array) -> Multipliers:
    """From x (M, 2, 3) near a motion, with a > 0."""
    count, axes = len(cells.width), cells.q.shape[3]
    nodes, bulge, x = np.zeros((count + 1, 2)), np.zeros(count), x.copy()
    slack, force = np.ones((count, 2, 4 * axes + 1)), np.ones((count, 2, 4 * axes + 1))
    iterations = run_iterations(cells, x, nodes, bulge, slack, force)
    force[:, :, 2 * axes : 4 * axes] *= cells.root[:, :, None]
    pairs = force[..., : 4 * axes].reshape(count, 2, 2, 2, axes)  # kind, side
    return Multipliers(nodes, bulge, pairs[:, :, :, 0] - pairs[:, :, :, 1], force[..., -1].copy(), x, int(iterations))


@kernel
def fill_row(cells: DualCells, k: int, e: int, r: int, x: Array, g: Array) -> tuple[bool, float]:
    """Slope g (3,) of a row by (a, b, c), whether there is one, and its value: at most 0 where it is kept."""
    n = cells.q.shape[3]
    q = cells.q[k, e]
    a, b, c = x[k, e, 0], x[k, e, 1], x[k, e, 2]
    if r == 4 * n:
        y = cells.y[k, e]
        g[0], g[1], g[2] = y, 0.0, 0.0
        return y > 0, y * a - 1.0
    i = r % n
    side = (r // n) % 2
    sign = 1.0 - 2.0 * side
    if r < 2 * n:
        bound = cells.acceleration[side, i]
        g[0], g[1], g[2] = sign * q[1, i], sign * q[0, i], 0.0
        if not bound < np.inf:
            return False, 0.0
        g[0], g[1] = g[0] / bound, g[1] / bound
        return True, g[0] * a + g[1] * b - 1.0
    bound = cells.jerk[side, i]
    if not bound < np.inf:
        return False, 0.0
    g[0], g[1], g[2] = sign * q[2, i] / bound, sign * 3 * q[1, i] / bound, sign * q[0, i] / bound
    # in shares of what a motion near here may use, of which jerk's part goes with 1/√a
    size = cells.root[k, e] / bound
    g[0], g[1], g[2] = sign * q[2, i] * size, sign * 3 * q[1, i] * size, sign * q[0, i] * size
    root = np.sqrt(a)
    value = g[0] * a + g[1] * b + g[2] * c - cells.root[k, e] / root
    g[0] += 0.5 * cells.root[k, e] / (a * root)
    return True, value


@kernel
def fill_balance(cells: DualCells, nodes: Array, bulge: Array, k: int, e: int, out: Array) -> None:
    """What multiplies a, b and c: λa′, 2λa + λb′, λb."""
    h = cells.width[k]
    out[0] = (nodes[k + 1, 0] - nodes[k, 0]) / h
    out[1] = 2 * nodes[k + e, 0] + (nodes[k + 1, 1] - nodes[k, 1]) / h + (1.0 - 2.0 * e) * bulge[k]
    out[2] = nodes[k + e, 1]


@kernel
def factorize(m: Array) -> None:
    """L of a positive definite matrix L Lᵀ (3, 3) of which the upper half counts, its diagonal inverted, in place."""
    for i in range(3):
        for j in range(i + 1):
            value = m[j, i]
            for k in range(j):
                value -= m[i, k] * m[j, k]
            if i == j:
                m[i, i] = 1 / np.sqrt(max(value, LEAST_PIVOT * m[i, i]))
            else:
                m[i, j] = value * m[j, j]


@kernel
def solve_lower(m: Array, out: Array) -> None:
    """L⁻¹ out, in place, of what `factorize` left."""
    out[0] *= m[0, 0]
    out[1] = (out[1] - m[1, 0] * out[0]) * m[1, 1]
    out[2] = (out[2] - m[2, 0] * out[0] - m[2, 1] * out[1]) * m[2, 2]


@kernel
def solve_upper(m: Array, out: Array) -> None:
    """L⁻ᵀ out, in place."""
    out[2] *= m[2, 2]
    out[1] = (out[1] - m[2, 1] * out[2]) * m[1, 1]
    out[0] = (out[0] - m[1, 0] * out[1] - m[2, 0] * out[2]) * m[0, 0]


@kernel
def add_cell_end(h: float, e: int, m: Array, rest: Array, local: Array, part: Array) -> None:
    """Add what a cell's end says of (λa, λb at the start, bulge, λa, λb at the end); rest (3,): L⁻¹ (Lᵀ x − …)."""
    columns = np.zeros((5, 3))  # L⁻¹ of what multiplies a, b, c, by each of the five
    columns[0, 0], columns[3, 0] = -1 / h, 1 / h
    columns[1, 1], columns[4, 1], columns[2, 1] = -1 / h, 1 / h, 1.0 - 2.0 * e
    columns[3 * e, 1] = 2.0
    columns[3 * e + 1, 2] = 1.0
    for u in range(5):
        solve_lower(m, columns[u])
    for u in range(5):
        part[u] += h / 2 * (columns[u, 0] * rest[0] + columns[u, 1] * rest[1] + columns[u, 2] * rest[2])
        for v in range(u, 5):
            dot = columns[u, 0] * columns[v, 0] + columns[u, 1] * columns[v, 1] + columns[u, 2] * columns[v, 2]
            local[u, v] += h / 2 * dot


@kernel
def solve_nodes(diagonal: Array, beside: Array, right: Array) -> None:
    """Block-tridiagonal symmetric systems (M+1, 2, 2), in place: the answer in `right` (M+1, 2)."""
    last = len(diagonal) - 1
    inverse = np.empty((last + 1, 2, 2))
    for j in range(last + 1):
        d00, d01, d11 = diagonal[j, 0, 0], diagonal[j, 0, 1], diagonal[j, 1, 1]
        if j > 0:
            m = inverse[j - 1]
            u = beside[j - 1]  # rows: node j−1, columns: node j
            p00, p01 = m[0, 0] * u[0, 0] + m[0, 1] * u[1, 0], m[0, 0] * u[0, 1] + m[0, 1] * u[1, 1]
            p10, p11 = m[1, 0] * u[0, 0] + m[1, 1] * u[1, 0], m[1, 0] * u[0, 1] + m[1, 1] * u[1, 1]
            d00 -= u[0, 0] * p00 + u[1, 0] * p10
            d01 -= u[0, 0] * p01 + u[1, 0] * p11
            d11 -= u[0, 1] * p01 + u[1, 1] * p11
            right[j, 0] -= p00 * right[j - 1, 0] + p10 * right[j - 1, 1]
            right[j, 1] -= p01 * right[j - 1, 0] + p11 * right[j - 1, 1]
        d00, d11 = max(d00, LEAST_PIVOT * diagonal[j, 0, 0]), max(d11, LEAST_PIVOT * diagonal[j, 1, 1])
        det = max(d00 * d11 - d01 * d01, LEAST_PIVOT * d00 * d11)
        inverse[j, 0, 0], inverse[j, 0, 1], inverse[j, 1, 0], inverse[j, 1, 1] = (
            d11 / det,
            -d01 / det,
            -d01 / det,
            d00 / det,
        )
    for j in range(last, -1, -1):
        r0, r1 = right[j, 0], right[j, 1]
        if j < last:
            u = beside[j]
            r0 -= u[0, 0] * right[j + 1, 0] + u[0, 1] * right[j + 1, 1]
            r1 -= u[1, 0] * right[j + 1, 0] + u[1, 1] * right[j + 1, 1]
        m = inverse[j]
        right[j, 0], right[j, 1] = m[0, 0] * r0 + m[0, 1] * r1, m[1, 0] * r0 + m[1, 1] * r1


@kernel
def run_iterations(cells: DualCells, x: Array, nodes: Array, bulge: Array, slack: Array, force: Array) -> int:
    """Fill x, λ, slacks and multipliers of the rows; how many iterations that took."""
    count, n = len(cells.width), cells.q.shape[3]
    rows = 4 * n + 1
    third = False
    for i in range(n):
        third = third or cells.jerk[0, i] < np.inf or cells.jerk[1, i] < np.inf
    g, balance, rest = np.zeros(3), np.zeros(3), np.zeros(3)
    hessian, factors = np.zeros((3, 3)), np.zeros((count, 2, 3, 3))
    pull, local, part = np.zeros((count, 2, 3)), np.zeros((5, 5)), np.zeros(5)
    diagonal, beside, right = np.zeros((count + 1, 2, 2)), np.zeros((count, 2, 2)), np.zeros((count + 1, 2))
    middle = np.zeros((count, 6))  # of each bulge: its own, right side, and how it hangs on the four λ
    bulge_step, x_step = np.zeros(count), np.zeros((count, 2, 3))
    weighed = 0.0
    for k in range(count):
        for e in range(2):
            for r in range(rows):
                there, value = fill_row(cells, k, e, r, x, g)
                slack[k, e, r] = max(-value, 0.1) if there else 1.0
                force[k, e, r] = 0.0
                if there:
                    force[k, e, r] = 0.1 / slack[k, e, r] / np.sqrt(x[k, e, 0])
                    weighed += cells.width[k] / 2 / cells.root[k, e]
    share = 0.5
    for iteration in range(MAX_ITERATIONS):
        mu, time = 0.0, 0.0
        for k in range(count):
            for e in range(2):
                time += cells.width[k] / 2 / np.sqrt(x[k, e, 0])
                for r in range(rows):
                    mu += cells.width[k] / 2 * slack[k, e, r] * force[k, e, r]
        steady = STEADINESS * min(1.0, mu / time)
        centre = 0.1 if share > 0.9 else (0.3 if share > 0.5 else 0.7)
        diagonal[:], beside[:], right[:], middle[:] = 0.0, 0.0, 0.0, 0.0
        worst = 0.0
        for k in range(count):
            h = cells.width[k]
            local[:], part[:] = 0.0, 0.0
            for e in range(2):
                a = x[k, e, 0]
                root = np.sqrt(a)
                hessian[:] = 0.0
                left = 1.0  # of the curvature by a, what jerk's rows leave
                for r in range(2 * n, 4 * n):
                    left -= force[k, e, r] * cells.root[k, e]
                hessian[0, 0] = (max(left, LEAST_CURVATURE) + steady) * 0.75 / (a * a * root)
                # where nothing tells b yet, as far as it is usual at such a speed
                usual = np.inf
                for i in range(n):
                    size = abs(cells.q[k, e, 0, i])
                    if size > 0:
                        for side in range(2):
                            usual = min(usual, (cells.acceleration[side, i] / size) ** 2)
                            usual = min(usual, 2 * root * cells.jerk[side, i] / size)
                hessian[1, 1] = steady / (usual * root)
                if not third:
                    hessian[2, 2] = 1.0
                fill_balance(cells, nodes, bulge, k, e, balance)
                p = pull[k, e]
                p[0], p[1], p[2] = balance[0] - 0.5 / (a * root), balance[1], balance[2]
                # what a row's slack and multiplier are led to, as share of the time that is spent here
                goal = centre * mu / weighed / cells.root[k, e]
                for r in range(rows):
                    there, value = fill_row(cells, k, e, r, x, g)
                    if not there:
                        continue
                    s, z = slack[k, e, r], force[k, e, r]
                    miss = value + s
                    worst = max(worst, abs(miss))
                    weight = z / s
                    led = z + (goal - z * s) / s + weight * miss
                    for i in range(3):
                        p[i] += led * g[i]
                        for j in range(i, 3):
                            hessian[i, j] += weight * g[i] * g[j]
                factor = factors[k, e]
                for i in range(3):
                    if hessian[i, i] == 0:  # where the path stands, nothing tells b and c
                        hessian[i, i] = 1.0
                    for j in range(i, 3):
                        factor[i, j] = hessian[i, j]
                factorize(factor)
                # Lᵀ x − L⁻¹ p: what moves x, less the multipliers of the balance
                solve_lower(factor, p)
                for i in range(3):
                    rest[i] = x[k, e, i] / factor[i, i] - p[i]
                    for j in range(i + 1, 3):
                        rest[i] += factor[j, i] * x[k, e, j]
                add_cell_end(h, e, factor, rest, local, part)
            for u in range(5):
                for v in range(u):
                    local[u, v] = local[v, u]
            if third:
                d = 1 / local[2, 2]
                middle[k, 0], middle[k, 1] = d, part[2]
                middle[k, 2], middle[k, 3], middle[k, 4], middle[k, 5] = (
                    local[2, 0],
                    local[2, 1],
                    local[2, 3],
                    local[2, 4],
                )
                for u in range(5):
                    if u != 2:
                        part[u] -= local[2, u] * d * part[2]
                        for v in range(5):
                            if v != 2:
                                local[u, v] -= local[2, u] * d * local[2, v]
            for u in range(2):
                right[k, u] += part[u]
                right[k + 1, u] += part[u + 3]
                for v in range(2):
                    diagonal[k, u, v] += local[u, v]
                    diagonal[k + 1, u, v] += local[u + 3, v + 3]
                    beside[k, u, v] += local[u, v + 3]
        for u in range(2):
            right[0, u] += cells.given[0, u]
            right[count, u] -= cells.given[1, u]
            for j in range(count + 1):
                if cells.free[j, u]:
                    diagonal[j, u, u] *= 1e12
                    right[j, u] = 0.0
        if not third:
            for j in range(count + 1):
                right[j, 1], diagonal[j, 0, 1], diagonal[j, 1, 0], diagonal[j, 1, 1] = 0.0, 0.0, 0.0, 1.0
                if j < count:
                    beside[j, 0, 1], beside[j, 1, 0], beside[j, 1, 1] = 0.0, 0.0, 0.0
        solve_nodes(diagonal, beside, right)
        most, most_force = 1.0, 1.0
        for k in range(count):
            h = cells.width[k]
            bulge_step[k] = 0.0
            if third:
                m = middle[k]
                hang = m[2] * right[k, 0] + m[3] * right[k, 1] + m[4] * right[k + 1, 0] + m[5] * right[k + 1, 1]
                bulge_step[k] = m[0] * (m[1] - hang)
            for e in range(2):
                fill_balance(cells, right, bulge_step, k, e, balance)
                factor, p, step = factors[k, e], pull[k, e], x_step[k, e]
                solve_lower(factor, balance)
                for i in range(3):
                    step[i] = -p[i] - balance[i]
                solve_upper(factor, step)
                if step[0] < 0:
                    most = min(most, -0.9 * x[k, e, 0] / step[0])
                elif step[0] > 3 * x[k, e, 0]:
                    most = min(most, 3 * x[k, e, 0] / step[0])
                goal = centre * mu / weighed / cells.root[k, e]
                for r in range(rows):
                    there, value = fill_row(cells, k, e, r, x, g)
                    if not there:
                        continue
                    s, z = slack[k, e, r], force[k, e, r]
                    ds = -(value + s) - (g[0] * step[0] + g[1] * step[1] + g[2] * step[2])
                    dz = (goal - z * s - z * ds) / s
                    if ds < 0:
                        most = min(most, -TO_BOUNDARY * s / ds)
                    if dz < 0:
                        most_force = min(most_force, -TO_BOUNDARY * z / dz)
        share = min(most, most_force)
        if share < SHORT_STEP and mu < ROUGH_TOLERANCE * time:
            return iteration + 1
        for k in range(count):
            h = cells.width[k]
            for e in range(2):
                step = x_step[k, e]
                goal = centre * mu / weighed / cells.root[k, e]
                for r in range(rows):
                    there, value = fill_row(cells, k, e, r, x, g)
                    if not there:
                        continue
                    s, z = slack[k, e, r], force[k, e, r]
                    ds = -(value + s) - (g[0] * step[0] + g[1] * step[1] + g[2] * step[2])
                    dz = (goal - z * s - z * ds) / s
                    slack[k, e, r] += most * ds
                    force[k, e, r] += most_force * dz
                for i in range(3):
                    x[k, e, i] += most * step[i]
            bulge[k] += most_force * bulge_step[k]
        for j in range(count + 1):
            for u in range(2):
                nodes[j, u] += most_force * right[j, u]
        if mu < DUAL_TOLERANCE * time and worst < 1e-2 and share > 0.5:
            return iteration + 1
    return MAX_ITERATIONS
