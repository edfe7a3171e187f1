"""Multipliers for the lower bound of the duration: a primal-dual interior-point method on cells of a path.

On each of M cells of width h, with weight w = h/2 for each of its ends, x = (a, b, c) is free at both ends, and

    minimise    Σ w/√a                                                                        (1)
    subject to  −A₋ ≤ q′b + q″a ≤ A₊,  −J₋ ≤ √a (q′c + 3q″b + q‴a) ≤ J₊,  ya ≤ 1              (2)
                Σ w (λa′a + (2λa + λb′) b + λb c) = [λa a + λb b]  for all λ                  (3)

for λa linear and λb quadratic on each cell: (3) is a′ = 2b and b′ = c in weak form. Its multipliers λ are what
`planner.bounds.lower_bound` makes a proof of. That proof holds for any λ, so nothing here has to be exact.

The method is J. Nocedal and S. Wright, Numerical Optimization (2006), section 19.2, in its symbols:

    s, z        slacks and multipliers of the rows (2), h(x) + s = 0; all as shares of the time spent at a place
    λ           multipliers of (3); on a cell λa, λb at its start, the bulge of λb, and λa, λb at its end
    B           (3, 5) at each end: B λ multiplies (a, b, c) in (3)
    G           (R, 3) at each end: gradient of the rows
    μ, σ        complementarity and centring
    H           Hessian of the Lagrangian by x, to which the rows add Gᵀ (z/s) G
    α_s, α_z    step lengths of x, s and of z, λ, by the fraction-to-the-boundary rule (19.9)

The rows of jerk are not convex: what their curvature takes off that of the duration is left out where nothing would
remain.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import LinAlgError, solve_banded

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import Flags2, Floats1, Floats2, Floats3, kernel

MAX_ITERATIONS = 80
# Complementarity, as a share of the duration, and residual of the rows at which λ is good enough for the bound.
DUAL_TOLERANCE, ROW_TOLERANCE = 1e-5, 1e-2
TO_BOUNDARY = 0.99
# Where rounding makes steps so short, what has been reached is taken if its complementarity is at most this.
SHORT_STEP, ROUGH_TOLERANCE = 0.05, 1e-3
# Least curvature by a, as a share of the duration's own.
LEAST_CURVATURE = 0.01
# Least pivot, as a share of the diagonal: below it there is only rounding.
LEAST_PIVOT = 1e-14
# λ of a cell: two at its start, its bulge, two at its end, which the next cell shares.
LOCAL, STRIDE = 5, 3


class DualCells(NamedTuple):
    """M cells on n axes, scaled so that times and lengths are near 1.

    width (M,); q (M, 2, 3, n): q′, q″, q‴ at both ends; y (M, 2) of the speed row
    acceleration, jerk (2, n): towards greater and smaller values, ∞ without a limit
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
    """Multipliers and x at which the iterations ended.

    nodes (M+1, 2): λ; bulge (M,): by which λb′ differs at a cell's ends
    rows (M, 2, 2, n): of acceleration and jerk at both ends of each cell, with their signs; speed (M, 2)
    x (M, 2, 3): a, b, c
    """

    nodes: Array
    bulge: Array
    rows: Array
    speed: Array
    x: Array
    iterations: int


class _Rows(NamedTuple):
    """Rows h = G x − t ≤ 0 at K = 2M ends of cells; t = 1, but √a₀/√a for jerk, which is scaled to be near 1 too.

    slope (K, R, 3): G without the slope of t; jerk, exists (K, R); root, weight (K,): √a₀ and w
    """

    slope: Floats3
    jerk: Flags2
    exists: Flags2
    root: Floats1
    weight: Floats1


def maximise_dual(cells: DualCells, x: Array) -> Multipliers:
    """Return multipliers, from x (M, 2, 3) near a motion with a > 0."""
    count, axes = len(cells.width), cells.q.shape[3]
    rows = _list_rows(cells)
    x = x.reshape(-1, 3).copy()
    s, z = _start_rows(rows, x)
    unknown = np.zeros(STRIDE * count + 2)
    iterations = _iterate(cells, rows, (x, s, z), unknown)

    nodes = np.stack([unknown[::STRIDE], unknown[1::STRIDE]], 1)
    z[rows.jerk] *= np.broadcast_to(rows.root[:, None], z.shape)[rows.jerk]
    pairs = z[:, :-1].reshape(count, 2, 2, 2, axes)  # kind, side
    signed = pairs[:, :, :, 0] - pairs[:, :, :, 1]
    return Multipliers(nodes, unknown[2::STRIDE], signed, z[:, -1].reshape(-1, 2), x.reshape(-1, 2, 3), iterations)


def _list_rows(cells: DualCells) -> _Rows:
    """Return the rows (2) of acceleration and jerk, upwards and downwards for each axis, and of speed."""
    first, second, third = cells.q.reshape(-1, *cells.q.shape[2:]).transpose(1, 0, 2)
    root = cells.root.ravel()
    nothing = np.zeros_like(first)
    acceleration = np.stack([second, first, nothing], -1)
    jerk = root[:, None, None] * np.stack([third, 3 * second, first], -1)
    speed = cells.y.reshape(-1, 1, 1) * np.array([1.0, 0.0, 0.0])

    signed = [
        sign * slope / bound[:, None]
        for slope, bounds in ((acceleration, cells.acceleration), (jerk, cells.jerk))
        for sign, bound in zip((1, -1), bounds, strict=True)
    ]
    bounds = np.concatenate([*cells.acceleration, *cells.jerk])
    exists = np.hstack([np.tile(bounds < np.inf, (len(root), 1)), cells.y.reshape(-1, 1) > 0])
    is_jerk = exists.copy()
    is_jerk[:, : 2 * first.shape[1]] = is_jerk[:, -1] = False
    slope = np.ascontiguousarray(np.concatenate([*signed, speed], 1))
    return _Rows(slope, is_jerk, exists, root, np.repeat(cells.width / 2, 2))


def _start_rows(rows: _Rows, x: Array) -> tuple[Array, Array]:
    """Return first slacks and multipliers: 0.1 times each other where a row is near or exceeded."""
    root = np.sqrt(x[:, :1])
    room = np.where(rows.jerk, rows.root[:, None] / root, 1.0) - (rows.slope @ x[:, :, None])[:, :, 0]
    s = np.where(rows.exists, np.maximum(room, 0.1), 1.0)
    z = np.where(rows.exists, 0.1 / s / root, 0.0)
    return s, z


def _list_balance(cells: DualCells) -> tuple[Array, np.ndarray]:
    """Return B (M, 2, 3, 5) at both ends of each cell, and which λ have to be 0 (3M + 2,)."""
    count = len(cells.width)
    slope = 1 / cells.width[:, None]
    balance = np.zeros((count, 2, 3, LOCAL))
    balance[:, :, 0, 0], balance[:, :, 0, 3] = -slope, slope  # λa′
    balance[:, :, 1, 1], balance[:, :, 1, 4] = -slope, slope  # λb′, of the chord
    balance[:, :, 1, 2] = 1.0, -1.0  # and of the bulge
    for end in range(2):
        balance[:, end, 1, 3 * end] = 2.0  # 2λa
        balance[:, end, 2, 3 * end + 1] = 1.0  # λb

    fixed = np.zeros(STRIDE * count + 2, bool)
    fixed[::STRIDE], fixed[1::STRIDE] = cells.free.T
    if not (cells.jerk < np.inf).any():
        fixed[1::STRIDE] = fixed[2::STRIDE] = True
    balance[np.broadcast_to(_windows(fixed)[:, None, None], balance.shape)] = 0.0
    return balance, fixed


def _windows(unknown: Array) -> Array:
    """Return λ of each cell (M, 5)."""
    return sliding_window_view(unknown, LOCAL)[::STRIDE]


def _find_usual(cells: DualCells) -> tuple[Array, Array]:
    """Return about the largest b² at each place (2M,): by acceleration, and by jerk at a speed ṡ of 1."""
    size = np.abs(cells.q[:, :, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = (cells.acceleration.min(0) / size) ** 2, 2 * cells.jerk.min(0) / size
    by_acceleration, by_jerk = (np.where(size > 0, ratio, np.inf).min(2).ravel() for ratio in ratios)
    return by_acceleration, by_jerk


def _iterate(cells: DualCells, rows: _Rows, point: tuple[Array, Array, Array], unknown: Array) -> int:
    """Improve the point (x, s, z) and λ in place. Return how many iterations that took."""
    x, s, z = point
    balance, fixed = _list_balance(cells)
    usual_by_acceleration, usual_by_jerk = _find_usual(cells)
    weight = rows.weight
    per_row = weight / rows.root @ rows.exists.sum(1)  # s of time, over all rows
    ds, dz = np.zeros_like(s), np.zeros_like(z)
    alpha = 0.5
    for iteration in range(MAX_ITERATIONS):
        a, root = x[:, 0].copy(), np.sqrt(x[:, 0])
        time = weight @ (1 / root)
        mu = weight @ (s * z).sum(1)
        sigma = 0.1 if alpha > 0.9 else (0.3 if alpha > 0.5 else 0.7)
        goal = sigma * mu / per_row / rows.root

        # Hessian and gradient of the Lagrangian by x, with the rows' slacks and multipliers eliminated (19.6)
        steady = min(1.0, mu / time)  # keeps first steps near, and goes as μ does
        left = 1.0 - (z * rows.jerk).sum(1) * rows.root  # of the duration's curvature, after the rows of jerk
        hessian = np.zeros((len(x), 3, 3))
        hessian[:, 0, 0] = (np.maximum(left, LEAST_CURVATURE) + steady) * 0.75 / (a * a * root)
        hessian[:, 1, 1] = steady / (np.minimum(usual_by_acceleration, usual_by_jerk * root) * root)
        gradient = np.einsum("keij,kj->kei", balance, _windows(unknown)).reshape(-1, 3)
        gradient[:, 0] -= 0.5 / (a * root)
        residual = add_rows(rows, point, goal, hessian, gradient)

        try:
            dx, step = _solve_newton(cells, (balance, fixed), x, hessian, gradient)
        except LinAlgError:  # by rounding; what has been reached is taken
            return iteration
        alpha_s, alpha_z = find_step(rows, point, goal, dx, (ds, dz))
        alpha = min(alpha_s, alpha_z)
        if not alpha > SHORT_STEP and mu < ROUGH_TOLERANCE * time:
            return iteration + 1
        x += alpha_s * dx
        s += alpha_s * ds
        z += alpha_z * dz
        unknown += alpha_z * step
        if mu < DUAL_TOLERANCE * time and residual < ROW_TOLERANCE and alpha > 0.5:
            return iteration + 1
    return MAX_ITERATIONS


@kernel
def add_rows(
    rows: _Rows, point: tuple[Floats2, Floats2, Floats2], goal: Floats1, hessian: Floats3, gradient: Floats2
) -> float:
    """Add Gᵀ (z/s) G, upper half, to H, and Gᵀ (z + (goal + z h)/s) to the gradient. Return the largest |h + s|."""
    x, s, z = point
    residual = 0.0
    g = np.zeros(3)
    for k in range(len(x)):
        a = x[k, 0]
        share = rows.root[k] / np.sqrt(a)
        for r in range(s.shape[1]):
            if not rows.exists[k, r]:
                continue
            for i in range(3):
                g[i] = rows.slope[k, r, i]
            h = g[0] * a + g[1] * x[k, 1] + g[2] * x[k, 2]
            if rows.jerk[k, r]:
                h -= share
                g[0] += 0.5 * share / a
            else:
                h -= 1.0
            residual = max(residual, abs(h + s[k, r]))
            curvature = z[k, r] / s[k, r]
            pull = z[k, r] + goal[k] / s[k, r] + curvature * h
            for i in range(3):
                gradient[k, i] += pull * g[i]
                for j in range(i, 3):
                    hessian[k, i, j] += curvature * g[i] * g[j]
    return residual


@kernel
def find_step(
    rows: _Rows, point: tuple[Floats2, Floats2, Floats2], goal: Floats1, dx: Floats2, out: tuple[Floats2, Floats2]
) -> tuple[float, float]:
    """Fill ds and dz of the step dx. Return α_s and α_z (19.9); a changes fourfold or to a tenth at most."""
    x, s, z = point
    ds, dz = out
    alpha_s = alpha_z = 1.0
    for k in range(len(x)):
        a, da = x[k, 0], dx[k, 0]
        if da < 0:
            alpha_s = min(alpha_s, -0.9 * a / da)
        elif da > 3 * a:
            alpha_s = min(alpha_s, 3 * a / da)
        share = rows.root[k] / np.sqrt(a)
        for r in range(s.shape[1]):
            if not rows.exists[k, r]:
                continue
            g = rows.slope[k, r]
            h = g[0] * (a + da) + g[1] * (x[k, 1] + dx[k, 1]) + g[2] * (x[k, 2] + dx[k, 2])
            h += 0.5 * share / a * da - share if rows.jerk[k, r] else -1.0
            ds[k, r] = -h - s[k, r]
            dz[k, r] = (goal[k] - z[k, r] * (s[k, r] + ds[k, r])) / s[k, r]
            if ds[k, r] < 0:
                alpha_s = min(alpha_s, -TO_BOUNDARY * s[k, r] / ds[k, r])
            if dz[k, r] < 0:
                alpha_z = min(alpha_z, -TO_BOUNDARY * z[k, r] / dz[k, r])
    return alpha_s, alpha_z


def _solve_newton(
    cells: DualCells, constraint: tuple[Array, np.ndarray], x: Array, hessian: Array, gradient: Array
) -> tuple[Array, Array]:
    """Return the steps of x (2M, 3) and of λ (3M + 2,): H dx + B dλ = −gradient, and (3).

    With dx eliminated, Σ w Bᵀ H⁻¹ B dλ = Σ w Bᵀ (x − H⁻¹ gradient) − [a, b]: a band, as cells share λ at nodes.
    """
    balance, fixed = constraint
    count = len(cells.width)
    right = np.concatenate([balance.reshape(-1, 3, LOCAL), gradient[:, :, None]], 2)
    solved = _solve_small(hessian, right)
    both = solved.reshape(count, 6, LOCAL + 1).copy()
    both[:, :, LOCAL] = x.reshape(count, 6) - both[:, :, LOCAL]
    weighted = balance.reshape(count, 6, LOCAL).transpose(0, 2, 1) * (cells.width / 2)[:, None, None]
    local = weighted @ both

    size = len(fixed)
    band, right_side = np.zeros((2 * LOCAL - 1, size)), np.zeros(size)
    for i in range(LOCAL):
        right_side[i : size - LOCAL + 1 + i : STRIDE] += local[:, i, LOCAL]
        for j in range(LOCAL):
            band[LOCAL - 1 + i - j, j : size - LOCAL + 1 + j : STRIDE] += local[:, i, j]
    right_side[:2] += cells.given[0]
    right_side[-2:] -= cells.given[1]
    right_side[fixed] = 0.0
    diagonal = band[LOCAL - 1]
    diagonal[diagonal == 0] = 1.0
    step = solve_banded((LOCAL - 1, LOCAL - 1), band, right_side, check_finite=False)
    by_lambda = np.einsum("kij,kj->ki", solved.reshape(count, 6, -1)[:, :, :LOCAL], _windows(step))
    return -solved[:, :, LOCAL] - by_lambda.reshape(-1, 3), step


def _solve_small(matrices: Array, right: Array) -> Array:
    """Solve symmetric systems (K, 3, 3), of which the upper half counts, by L D Lᵀ: right (K, 3, N)."""
    diagonal = np.maximum(np.einsum("kii->ki", matrices), 0.0)
    diagonal[diagonal == 0] = 1.0  # where q′ = 0, the cost does not depend on b and c
    least = LEAST_PIVOT * diagonal
    m01, m02, m12 = matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2]
    d0 = diagonal[:, 0]
    l10, l20 = m01 / d0, m02 / d0
    d1 = np.maximum(diagonal[:, 1] - l10 * m01, least[:, 1])
    l21 = (m12 - l20 * m01) / d1
    d2 = np.maximum(diagonal[:, 2] - l20 * m02 - l21 * l21 * d1, least[:, 2])

    y0 = right[:, 0]
    y1 = right[:, 1] - l10[:, None] * y0
    y2 = right[:, 2] - l20[:, None] * y0 - l21[:, None] * y1
    z2 = y2 / d2[:, None]
    z1 = y1 / d1[:, None] - l21[:, None] * z2
    z0 = y0 / d0[:, None] - l10[:, None] * z1 - l20[:, None] * z2
    return np.stack([z0, z1, z2], 1)
