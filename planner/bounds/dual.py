"""Multipliers for the lower bound of the duration: a primal-dual interior-point method on cells.

On each of M cells of width h, x = (a, b, c) is free at both ends, each end with the weight w = h/2:

    minimise    Σ w/√a                                                                        (1)
    subject to  −A₋ ≤ q′b + q″a ≤ A₊,  −J₋ ≤ √a (q′c + 3q″b + q‴a) ≤ J₊,  ya ≤ 1              (2)
                Σ w (λa′a + (2λa + λb′) b + λb c) = [λa a + λb b]  for all λ                  (3)

for λa linear and λb quadratic on each cell: (3) is a′ = 2b and b′ = c in weak form. From its
multipliers λ, `planner.bounds.lower_bound` makes a proof, which holds for any λ: nothing here has
to be exact.

The method is J. Nocedal and S. Wright, Numerical Optimization (2006), section 19.2, in its symbols:

    s, z        slacks and multipliers of the rows (2), h(x) + s = 0, as shares of the time at a
                place
    λ           multipliers of (3); on a cell λa, λb at its start, the bulge of λb, λa, λb at its
                end
    B           (3, 5) at each end: B λ multiplies (a, b, c) in (3)
    G           (R, 3) at each end: gradient of the rows
    μ, σ        complementarity and centring
    H           Hessian of the Lagrangian by x, to which the rows add Gᵀ (z/s) G
    α_s, α_z    step lengths of x, s and of z, λ, by the fraction-to-the-boundary rule (19.9)

The rows of jerk are not convex: what their curvature takes from the curvature of the duration is
left out where too little would remain.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import LinAlgError, solve_banded

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import (
    Flags2,
    Floats1,
    Floats2,
    Floats3,
    kernel,
)
from planner.bounds.lower_bound import RowCells

MAX_ITERATIONS = 80
# Complementarity, as a share of the duration, and residual of the rows at which λ is good enough.
DUAL_TOLERANCE = 1e-5
ROW_TOLERANCE = 1e-2
TO_BOUNDARY = 0.99
# Step length below which rounding rules, and the complementarity at which the iterations end then.
SHORT_STEP = 0.05
ROUGH_TOLERANCE = 1e-3
# Least curvature by a, as a share of the curvature of the duration.
LEAST_CURVATURE = 0.01
# Least pivot, as a share of the diagonal: below it there is only rounding.
LEAST_PIVOT = 1e-14
# Number of λ of a cell; from one cell to the next STRIDE of them change.
LOCAL = 5
STRIDE = 3


class DualProblem(NamedTuple):
    """M cells with motions through them.

    given (2, 2)   a and b at the start and at the end
    free (M+1, 2)  nodes at which λ shall be 0
    x (M, 2, 3)    a, b, c near a motion, with a > 0
    length, time   m, s: units in which numbers are near 1
    """

    rows: RowCells
    given: Array
    free: np.ndarray
    x: Array
    length: float
    time: float


class Multipliers(NamedTuple):
    """Finite multipliers of M cells, and x at which the iterations ended.

    nodes (M+1, 2)      λ
    bulge (M,)          difference of λb′ at a cell's ends from its mean
    rows (M, 2, 2, n)   of acceleration and jerk at both ends of each cell, with their signs
    speed (M, 2)
    x (M, 2, 3)         a, b, c
    """

    nodes: Array
    bulge: Array
    rows: Array
    speed: Array
    x: Array


class _Rows(NamedTuple):
    """Rows h = G x − t ≤ 0 at K = 2M ends of cells: acceleration, jerk, speed; t = 1.

    t = √a₀/√a for jerk, which scales it to be near 1 as well, as a₀ is near a.

    slope (K, R, 3)  G without the slope of t
    exists (K, R)
    root (K,)        √a₀
    weight (K,)      w
    """

    slope: Floats3
    exists: Flags2
    root: Floats1
    weight: Floats1

    @property
    def jerk(self) -> slice:
        """The rows of jerk."""
        half = self.exists.shape[1] // 2
        return slice(half, 2 * half)


def maximise_dual(problem: DualProblem) -> Multipliers:
    """Return multipliers, in SI units."""
    count = len(problem.x)
    length = problem.length
    time = problem.time
    speed = length / time
    units = np.array([speed**2, speed / time, time**-2])
    scaled = problem._replace(
        rows=_scale_rows(problem.rows, length, time),
        given=problem.given / units[:2],
        x=(problem.x / units).reshape(-1, 3),
    )
    rows = _list_rows(scaled.rows, np.sqrt(scaled.x[:, 0]))
    x = scaled.x.copy()
    s, z = _start_rows(rows, x)
    unknown = _iterate(scaled, rows, (x, s, z))

    z[:, rows.jerk] *= rows.root[:, None]
    pairs = z[:, :-1].reshape(count, 2, 2, 2, -1)  # end, kind, side
    signed = pairs[:, :, :, 0] - pairs[:, :, :, 1]
    bounds = np.stack([problem.rows.acceleration, problem.rows.jerk], 1)
    signed = signed / np.where(signed > 0, *bounds)
    # those of jerk scale with 1/√a, as the integrand
    signed[:, :, 0] /= speed
    nodes = np.stack([unknown[::STRIDE], unknown[1::STRIDE]], 1)
    return Multipliers(
        nodes=_replace_infinite(nodes) * time / units[:2],
        bulge=_replace_infinite(unknown[2::STRIDE]) * time / units[0],
        rows=_replace_infinite(signed),
        speed=_replace_infinite(z[:, -1].reshape(-1, 2)) / speed,
        x=_replace_infinite(x, 1.0).reshape(-1, 2, 3) * units,
    )


def _replace_infinite(values: Array, by: float = 0.0) -> Array:
    return np.where(np.isfinite(values), values, by)


def _scale_rows(rows: RowCells, length: float, time: float) -> RowCells:
    return rows._replace(
        width=rows.width / length,
        ends=rows.ends * np.array([length, length**2, length**3])[:, None],
        speed=rows.speed * (length / time) ** 2,
        acceleration=rows.acceleration * time**2,
        jerk=rows.jerk * time**3,
    )


def _list_rows(cells: RowCells, root: Array) -> _Rows:
    """Return the rows (2) of acceleration and jerk, each upwards and downwards, and of speed."""
    axes = cells.jerk.shape[1]
    first, second, third = np.moveaxis(cells.ends, 2, 0).reshape(3, -1, axes)
    acceleration = np.stack([second, first, np.zeros_like(first)], -1)
    jerk = np.stack([third, 3 * second, first], -1) * root[:, None, None]
    speed = cells.speed.reshape(-1, 1)
    bounds = np.concatenate([cells.acceleration, cells.jerk])
    signed = [
        sign * slope / bound[:, None]
        for sign, slope, bound in zip(
            (1, -1, 1, -1),
            (acceleration, acceleration, jerk, jerk),
            bounds,
            strict=True,
        )
    ]
    signed.append(speed[:, :, None] * np.array([1.0, 0.0, 0.0]))
    limited = np.tile(bounds.ravel() < np.inf, (len(root), 1))
    return _Rows(
        slope=np.ascontiguousarray(np.concatenate(signed, 1)),
        exists=np.hstack([limited, speed > 0]),
        root=root,
        weight=np.repeat(cells.width / 2, 2),
    )


def _start_rows(rows: _Rows, x: Array) -> tuple[Array, Array]:
    """Return first slacks and multipliers: with s·z = 0.1 where a row is near or exceeded."""
    root = np.sqrt(x[:, :1])
    room = np.ones(rows.exists.shape)
    room[:, rows.jerk] = rows.root[:, None] / root
    room -= (rows.slope @ x[:, :, None])[:, :, 0]
    s = np.where(rows.exists, np.maximum(room, 0.1), 1.0)
    z = np.where(rows.exists, 0.1 / s / root, 0.0)
    return s, z


def _list_balance(
    cells: RowCells,
    free: np.ndarray,
) -> tuple[Array, np.ndarray]:
    """Return B (M, 2, 3, 5) at both ends of each cell, and which λ have to be 0 (3M + 2,)."""
    count = len(cells.width)
    slope = 1 / cells.width[:, None]
    balance = np.zeros((count, 2, 3, LOCAL))
    for row in range(2):  # λa′ and λb′, of the chord
        balance[:, :, row, row] = -slope
        balance[:, :, row, row + STRIDE] = slope
    balance[:, :, 1, 2] = 1.0, -1.0  # λb′ of the bulge
    for end in range(2):
        balance[:, end, 1, STRIDE * end] = 2.0  # 2λa
        balance[:, end, 2, STRIDE * end + 1] = 1.0  # λb

    fixed = np.zeros(STRIDE * count + 2, bool)
    fixed[::STRIDE], fixed[1::STRIDE] = free.T
    if not (cells.jerk < np.inf).any():
        fixed[1::STRIDE] = True
        fixed[2::STRIDE] = True
    balance[np.broadcast_to(_windows(fixed)[:, None, None], balance.shape)] = 0.0
    return balance, fixed


def _windows(unknown: Array) -> Array:
    """Return λ of each cell (M, 5)."""
    return sliding_window_view(unknown, LOCAL)[::STRIDE]


def _find_usual(cells: RowCells) -> tuple[Array, Array]:
    """Return the usual b² (2M,) at each place: by acceleration, and by jerk at a speed ṡ of 1."""
    size = np.abs(cells.ends[:, :, 0]).reshape(-1, cells.jerk.shape[1])
    with np.errstate(divide="ignore", invalid="ignore"):
        by_acceleration = (cells.acceleration.min(0) / size) ** 2
        by_jerk = 2 * cells.jerk.min(0) / size
    return by_acceleration.min(1), by_jerk.min(1)


def _iterate(
    cells: DualProblem,
    rows: _Rows,
    point: tuple[Array, Array, Array],
) -> Array:
    """Improve the point (x, s, z) in place, and return λ (3M + 2,)."""
    x, s, z = point
    balance, fixed = _list_balance(cells.rows, cells.free)
    usual_by_acceleration, usual_by_jerk = _find_usual(cells.rows)
    weight = rows.weight
    per_row = weight / rows.root @ rows.exists.sum(1)  # s of time, over all rows
    unknown = np.zeros(len(fixed))
    ds = np.zeros_like(s)
    dz = np.zeros_like(z)
    alpha = 0.5
    for _ in range(MAX_ITERATIONS):
        a = x[:, 0].copy()
        root = np.sqrt(a)
        time = weight @ (1 / root)
        mu = weight @ (s * z).sum(1)
        sigma = 0.1 if alpha > 0.9 else (0.3 if alpha > 0.5 else 0.7)
        goal = sigma * mu / per_row / rows.root

        # Hessian and gradient of the Lagrangian by x, without the rows' slacks and multipliers
        # (19.6)
        steady = min(1.0, mu / time)  # keeps first steps near, and goes as μ does
        jerky = 1.0 - z[:, rows.jerk].sum(1) * rows.root  # of the curvature, after the rows of jerk
        hessian = np.zeros((len(x), 3, 3))
        share = np.maximum(jerky, LEAST_CURVATURE) + steady
        usual = np.minimum(usual_by_acceleration, usual_by_jerk * root)
        hessian[:, 0, 0] = share * 0.75 / (a * a * root)
        hessian[:, 1, 1] = steady / (usual * root)
        gradient = np.einsum("keij,kj->kei", balance, _windows(unknown)).reshape(-1, 3)
        gradient[:, 0] -= 0.5 / (a * root)
        residual = add_rows(rows, point, goal, hessian, gradient)

        try:
            dx, step = _solve_newton(cells, (balance, fixed), x, hessian, gradient)
        except LinAlgError:  # by rounding: the point so far serves
            break
        alpha_s, alpha_z = find_step(rows, point, goal, dx, (ds, dz))
        alpha = min(alpha_s, alpha_z)
        if not alpha > SHORT_STEP and mu < ROUGH_TOLERANCE * time:
            break
        x += alpha_s * dx
        s += alpha_s * ds
        z += alpha_z * dz
        unknown += alpha_z * step
        if mu < DUAL_TOLERANCE * time and residual < ROW_TOLERANCE and alpha > 0.5:
            break
    return unknown


@kernel
def add_rows(
    rows: _Rows,
    point: tuple[Floats2, Floats2, Floats2],
    goal: Floats1,
    hessian: Floats3,
    gradient: Floats2,
) -> float:
    """Add Gᵀ (z/s) G, upper half, to H, and Gᵀ (z + (goal + z h)/s) to the gradient.

    Return the largest |h + s|.
    """
    x, s, z = point
    residual = 0.0
    g = np.zeros(3)
    half = s.shape[1] // 2
    for k in range(len(x)):
        a = x[k, 0]
        share = rows.root[k] / np.sqrt(a)
        for r in range(s.shape[1]):
            if not rows.exists[k, r]:
                continue
            for i in range(3):
                g[i] = rows.slope[k, r, i]
            h = g[0] * a + g[1] * x[k, 1] + g[2] * x[k, 2]
            if half <= r < 2 * half:  # jerk
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
    rows: _Rows,
    point: tuple[Floats2, Floats2, Floats2],
    goal: Floats1,
    dx: Floats2,
    out: tuple[Floats2, Floats2],
) -> tuple[float, float]:
    """Fill ds and dz of the step dx. Return α_s and α_z (19.9).

    a becomes at most four times as large, and at least a tenth.
    """
    x, s, z = point
    ds, dz = out
    alpha_s = alpha_z = 1.0
    half = s.shape[1] // 2
    for k in range(len(x)):
        a = x[k, 0]
        da = dx[k, 0]
        if da < 0:
            alpha_s = min(alpha_s, -0.9 * a / da)
        elif da > 3 * a:
            alpha_s = min(alpha_s, 3 * a / da)
        b = x[k, 1] + dx[k, 1]
        c = x[k, 2] + dx[k, 2]
        share = rows.root[k] / np.sqrt(a)
        for r in range(s.shape[1]):
            if not rows.exists[k, r]:
                continue
            g = rows.slope[k, r]
            slack = s[k, r]
            h = g[0] * (a + da) + g[1] * b + g[2] * c
            if half <= r < 2 * half:  # jerk
                h += 0.5 * share / a * da - share
            else:
                h -= 1.0
            step_s = -h - slack
            step_z = (goal[k] - z[k, r] * (slack + step_s)) / slack
            if step_s < 0:
                alpha_s = min(alpha_s, -TO_BOUNDARY * slack / step_s)
            if step_z < 0:
                alpha_z = min(alpha_z, -TO_BOUNDARY * z[k, r] / step_z)
            ds[k, r] = step_s
            dz[k, r] = step_z
    return alpha_s, alpha_z


def _solve_newton(
    cells: DualProblem,
    constraint: tuple[Array, np.ndarray],
    x: Array,
    hessian: Array,
    gradient: Array,
) -> tuple[Array, Array]:
    """Return the steps of x (2M, 3) and of λ (3M + 2,): H dx + B dλ = −gradient, and (3).

    With dx eliminated, Σ w Bᵀ H⁻¹ B dλ = Σ w Bᵀ (x − H⁻¹ gradient) − [a, b]. It is a band, as cells
    share λ at nodes.
    """
    balance, fixed = constraint
    count = len(balance)
    right = np.concatenate([balance.reshape(-1, 3, LOCAL), gradient[:, :, None]], 2)
    solved = _solve_small(hessian, right).reshape(count, 6, LOCAL + 1)
    both = solved.copy()
    both[:, :, LOCAL] = x.reshape(count, 6) - both[:, :, LOCAL]
    half = cells.rows.width[:, None, None] / 2
    local = balance.reshape(count, 6, LOCAL).transpose(0, 2, 1) * half @ both

    size = len(fixed)
    band = np.zeros((2 * LOCAL - 1, size))
    right_side = np.zeros(size)
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
    by_lambda = np.einsum("kij,kj->ki", solved[:, :, :LOCAL], _windows(step))
    return (-solved[:, :, LOCAL] - by_lambda).reshape(-1, 3), step


def _solve_small(matrices: Array, right: Array) -> Array:
    """Solve symmetric systems (K, 3, 3), of which the upper half counts, for right (K, 3, N).

    Gaussian elimination, in which no pivot is below LEAST_PIVOT of its diagonal.
    """
    rows = matrices.transpose(1, 2, 0).copy()
    x = right.transpose(1, 0, 2).copy()
    diagonal = np.maximum(np.einsum("iik->ik", rows), 0.0)
    diagonal[diagonal == 0] = 1.0  # where q′ = 0, the cost does not depend on b and c
    for i in range(3):
        rows[i, i] = diagonal[i]
    least = LEAST_PIVOT * diagonal
    for i in range(3):
        pivot = np.maximum(rows[i, i], least[i])
        rows[i, i] = pivot
        for j in range(i + 1, 3):
            factor = rows[i, j] / pivot
            rows[j, j:] -= factor * rows[i, j:]
            x[j] -= factor[:, None] * x[i]
    for i in (2, 1, 0):
        for j in range(i + 1, 3):
            x[i] -= rows[i, j, :, None] * x[j]
        x[i] /= rows[i, i, :, None]
    return x.transpose(1, 0, 2)
