"""A Newton step of the order-3 problem by a Riccati recursion, backward and forward over the stages.

Linearized, Δs eliminates one control of each stage: h where the interval ends in motion, j where it ends near rest. The
other one is the stage's free control u. Backwards, the cost to go from the state y = (v, a) is ½ yᵀPy + pᵀy, and
minimizing over u gives P and p of the stage before: see J. B. Rawlings, D. Q. Mayne and M. M. Diehl, Model Predictive
Control (2nd ed., 2017), section 8.8.

A given last state enters as a penalty ϱ/2 |residual|² with its own multiplier (augmented Lagrangian). A larger ϱ
would cost the recursion its digits: where this one leaves much of the residual, the last state is met exactly, as
a fixed duration always is, by multipliers that border the system (Schur complement).
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.order3.kkt import Iterate
from planner.timing.order3.stages import END, Stages, add_hessian, advance, differentiate_place

# Least curvature along a free control that counts as positive, in units of the objective per squared scale.
MIN_CURVATURE = 1e-9
# Penalty ϱ of the last state, in units of the objective per squared scale, and the share of its residual that a step
# may leave.
PENALTY, MAX_REMAINDER = 1e8, 0.1
# Share of a pivot of the Schur complement that is rounding once the others are eliminated.
MIN_PIVOT = 1e-14


class NewtonSystem(NamedTuple):
    """Quadratic model at a point.

    hessian (N, 4, 4)    upper half
    gradient (N, 4)
    last (2,)            multiplier of the last state
    time_residual        Σ h − 1
    delta_w              regularization δ_w, in units of the objective per squared scale
    """

    stages: Stages
    point: Iterate
    hessian: Array
    gradient: Array
    last: Array
    time_residual: float
    delta_w: float


class Recursion(NamedTuple):
    """Result of the backward recursion.

    P (N + 1, 3)         its three entries
    p (N + 1, 2)
    eliminated (N,)      control that Δs eliminates: 2 for j, 3 for h
    elimination (N, 4)   that control by v, a and u, and its constant
    control (N, 4)       curvature along u, mixed with v and a, and gradient
    border (3, N + 1, 2) gradients of the last v, the last a and Σ h by each state
    lever (3, N)         the same by each u
    residual (3,)        of these three
    change (3,)          of their multipliers
    """

    P: Array
    p: Array
    eliminated: np.ndarray
    elimination: Array
    control: Array
    border: Array
    lever: Array
    residual: Array
    change: Array

    @classmethod
    def allocate(cls, count: int) -> "Recursion":
        """Return room for the recursion over `count` stages."""
        P, p, border = np.zeros((count + 1, 3)), np.zeros((count + 1, 2)), np.zeros((3, count + 1, 2))
        rows = np.zeros((count, 4))
        return cls(
            P, p, np.zeros(count, int), rows, rows.copy(), border, np.zeros((3, count)), np.zeros(3), np.zeros(3)
        )


class Direction(NamedTuple):
    """A Newton step: changes of states (N + 1, 2), of stages (N, 4) and of s and z (K,), and the new λ.

    next (N + 1, 2), step (N,)  multipliers after a full step
    time (1,)                   change of the multiplier of the duration
    """

    states: Array
    stages: Array
    s: Array
    z: Array
    next: Array
    step: Array
    time: Array


@kernel
def solve_newton(system: NewtonSystem, recursion: Recursion, direction: Direction) -> bool:
    """Fill the direction, except s and z. Return False where more regularization is needed.

    That is so where the Hessian is not positive definite along a free control, or so nearly that the step overflows.
    """
    stages, residual = system.stages, recursion.residual
    count = len(stages.step)
    direction.time[0] = 0.0
    if not recur_backward(system, recursion):
        return False
    recur_forward(system, recursion, direction)
    residual[0], residual[1] = direction.states[count, 0], direction.states[count, 1]
    residual[2] = direction.stages[:, 3].sum() + system.time_residual
    if not np.isfinite(residual).all():
        return False
    before = after = 0.0
    for n in range(1 if stages.free_end else 2):
        before = max(before, abs(system.point.next[count - 1, n]) / stages.scale[n])
        after = max(after, abs(residual[n]) / stages.scale[n])
    exact = after > MAX_REMAINDER * before
    if not (exact or stages.fixed_time):
        return True
    enforce_ends(system, recursion, np.array([exact, exact and not stages.free_end, stages.fixed_time]))
    direction.time[0] = recursion.change[2]
    system.gradient[:, 3] += recursion.change[2]
    recur_forward(system, recursion, direction)
    system.gradient[:, 3] -= recursion.change[2]
    return bool(np.isfinite(direction.states[count]).all())


@kernel
def recur_backward(system: NewtonSystem, recursion: Recursion) -> bool:
    """Fill the recursion; return False where the curvature along a free control is not positive."""
    stages, point = system.stages, system.point
    count, scale = len(stages.step), stages.scale
    H = np.empty((4, 4))
    g = np.empty(4)
    P, p = recursion.P, recursion.p
    P[count, 0] = PENALTY / scale[0] ** 2
    P[count, 1] = 0.0
    P[count, 2] = 0.0 if stages.free_end else PENALTY / scale[1] ** 2
    p[count, 0] = system.last[0]
    p[count, 1] = 0.0 if stages.free_end else system.last[1]
    for k in range(count - 1, -1, -1):
        a, j, h = point.states[k, 1], point.controls[k, 0], point.controls[k, 1]
        derivatives = differentiate_place(END, a, j, h)
        t, half_square, v_h, a_h = derivatives
        # the cost to go of the next state, as a function of x
        for m in range(4):
            for n in range(m, 4):
                H[m, n] = system.hessian[k, m, n]
        add_hessian(derivatives, (P[k + 1, 0], P[k + 1, 1], 0.0, P[k + 1, 2], 0.0, 0.0), H)
        next_v = p[k + 1, 0] + P[k + 1, 0] * point.next[k, 0] + P[k + 1, 1] * point.next[k, 1]
        next_a = p[k + 1, 1] + P[k + 1, 1] * point.next[k, 0] + P[k + 1, 2] * point.next[k, 1]
        g[0] = system.gradient[k, 0] + next_v
        g[1] = system.gradient[k, 1] + t * next_v + next_a
        g[2] = system.gradient[k, 2] + half_square * next_v + t * next_a
        g[3] = system.gradient[k, 3] + v_h * next_v + a_h * next_a
        for n in range(3):
            H[n, n] += system.delta_w / scale[n] ** 2
        H[3, 3] += system.delta_w / stages.duration[k] ** 2
        if not _condense(system, recursion, k, H, g):
            return False
    if stages.start_reward > 0 and not P[0, 0] * scale[0] ** 2 > MIN_CURVATURE:
        return False
    return not stages.free_start or P[0, 2] * scale[1] ** 2 > MIN_CURVATURE


@kernel
def _condense(system: NewtonSystem, recursion: Recursion, k: int, H: Array, g: Array) -> bool:
    """Eliminate both controls of stage k, whose Hessian and gradient are H and g: set P[k] and p[k]."""
    stages, point = system.stages, system.point
    v, a, j, h = point.states[k, 0], point.states[k, 1], point.controls[k, 0], point.controls[k, 1]
    # Δs by j and by h: the control that moves it more is eliminated
    by_j, by_h = h * h * h / 6, advance(v, a, j, h)[0]
    if abs(by_h) * stages.duration[k] >= abs(by_j) * stages.scale[2]:
        e, u, pivot, other, unit = 3, 2, by_h, by_j, stages.scale[2]
    else:
        e, u, pivot, other, unit = 2, 3, by_j, by_h, stages.duration[k]
    f0, f1, f2 = -h / pivot, -h * h / 2 / pivot, -other / pivot
    f3 = -point.step[k] * stages.step[k] / pivot
    H_ue = H[2, 3]
    curvature = H[u, u] + 2 * f2 * H_ue + f2 * f2 * H[e, e]
    if not curvature * unit * unit > MIN_CURVATURE:
        return False
    vv = H[0, 0] + 2 * f0 * H[0, e] + f0 * f0 * H[e, e]
    va = H[0, 1] + f1 * H[0, e] + f0 * H[1, e] + f0 * f1 * H[e, e]
    aa = H[1, 1] + 2 * f1 * H[1, e] + f1 * f1 * H[e, e]
    vu = H[0, u] + f2 * H[0, e] + f0 * H_ue + f0 * f2 * H[e, e]
    au = H[1, u] + f2 * H[1, e] + f1 * H_ue + f1 * f2 * H[e, e]
    g_e = g[e] + H[e, e] * f3
    g_v = g[0] + H[0, e] * f3 + f0 * g_e
    g_a = g[1] + H[1, e] * f3 + f1 * g_e
    g_u = g[u] + H_ue * f3 + f2 * g_e
    elimination, control = recursion.elimination[k], recursion.control[k]
    recursion.eliminated[k] = e
    elimination[0], elimination[1], elimination[2], elimination[3] = f0, f1, f2, f3
    control[0], control[1], control[2], control[3] = curvature, vu, au, g_u
    v_share, a_share = vu / curvature, au / curvature
    recursion.P[k, 0] = vv - vu * v_share
    recursion.P[k, 1] = va - vu * a_share
    recursion.P[k, 2] = aa - au * a_share
    recursion.p[k, 0] = g_v - v_share * g_u
    recursion.p[k, 1] = g_a - a_share * g_u
    return True


@kernel
def recur_forward(system: NewtonSystem, recursion: Recursion, direction: Direction) -> None:
    """Fill the direction from the first state on."""
    stages, point = system.stages, system.point
    dy, P, p = direction.states, recursion.P, recursion.p
    dy[0, 0] = -p[0, 0] / P[0, 0] if stages.start_reward > 0 else 0.0
    dy[0, 1] = -p[0, 1] / P[0, 2] if stages.free_start else 0.0
    for k in range(len(stages.step)):
        v, a, j, h = point.states[k, 0], point.states[k, 1], point.controls[k, 0], point.controls[k, 1]
        t, half_square, v_h, a_h = differentiate_place(END, a, j, h)
        control, elimination, e = recursion.control[k], recursion.elimination[k], recursion.eliminated[k]
        dv, da = dy[k, 0], dy[k, 1]
        du = -(control[1] * dv + control[2] * da + control[3]) / control[0]
        de = elimination[0] * dv + elimination[1] * da + elimination[2] * du + elimination[3]
        dj, dh = (du, de) if e == 3 else (de, du)
        dx = direction.stages[k]
        dx[0], dx[1], dx[2], dx[3] = dv, da, dj, dh
        next_v = point.next[k, 0] + dv + t * da + half_square * dj + v_h * dh
        next_a = point.next[k, 1] + da + t * dj + a_h * dh
        dy[k + 1, 0], dy[k + 1, 1] = next_v, next_a
        # λ of the next state is the gradient of the cost to go
        lambda_v = p[k + 1, 0] + P[k + 1, 0] * next_v + P[k + 1, 1] * next_a
        lambda_a = p[k + 1, 1] + P[k + 1, 1] * next_v + P[k + 1, 2] * next_a
        direction.next[k + 1, 0], direction.next[k + 1, 1] = lambda_v, lambda_a
        # λ of Δs makes the Lagrangian stationary along the eliminated control
        H = system.hessian[k]
        total = system.gradient[k, e] + H[0, e] * dv + H[1, e] * da + H[2, 3] * du + H[e, e] * de
        if e == 3:
            total += system.delta_w / stages.duration[k] ** 2 * de + v_h * lambda_v + a_h * lambda_a
            slope = advance(v, a, j, h)[0]
        else:
            total += system.delta_w / stages.scale[2] ** 2 * de + half_square * lambda_v + t * lambda_a
            slope = h * h * h / 6
        direction.step[k] = -total / slope * stages.step[k]


@kernel
def enforce_ends(system: NewtonSystem, recursion: Recursion, enforced: np.ndarray) -> None:
    """Change the multipliers of the last v, the last a and Σ h so that no residual is left of those to enforce (3,).

    Where that overflows, they stay: the step of the penalty is finite, though it leaves some residual.
    """
    schur = _recur_border(system, recursion, enforced)
    _solve_schur(schur, recursion, enforced)
    change = recursion.change
    if change[0] == 0 and change[1] == 0 and change[2] == 0:
        return
    for k in range(len(recursion.p)):
        for i in range(3):
            if enforced[i]:
                recursion.p[k, 0] += change[i] * recursion.border[i, k, 0]
                recursion.p[k, 1] += change[i] * recursion.border[i, k, 1]
                if k < len(recursion.control):
                    recursion.control[k, 3] += change[i] * recursion.lever[i, k]


@kernel
def _recur_border(system: NewtonSystem, recursion: Recursion, enforced: np.ndarray) -> Array:
    """Fill border and lever; return the Schur complement (3, 3): residuals removed per multiplier."""
    stages, point = system.stages, system.point
    border, P = recursion.border, recursion.P
    count = len(stages.step)
    border[:, count] = 0.0
    border[0, count, 0] = border[1, count, 1] = 1.0
    schur = np.zeros((3, 3))
    for k in range(count - 1, -1, -1):
        t, half_square, v_h, a_h = differentiate_place(
            END,
            point.states[k, 1],
            point.controls[k, 0],
            point.controls[k, 1],
        )
        control, elimination = recursion.control[k], recursion.elimination[k]
        v_share, a_share = control[1] / control[0], control[2] / control[0]
        for i in range(3):
            if not enforced[i]:
                continue
            g_v, g_a = border[i, k + 1, 0], border[i, k + 1, 1]
            by_u = half_square * g_v + t * g_a
            by_e = v_h * g_v + a_h * g_a + (1.0 if i == 2 else 0.0)
            if recursion.eliminated[k] == 2:
                by_u, by_e = by_e, by_u
            by_u += elimination[2] * by_e
            recursion.lever[i, k] = by_u
            border[i, k, 0] = g_v + elimination[0] * by_e - v_share * by_u
            border[i, k, 1] = t * g_v + g_a + elimination[1] * by_e - a_share * by_u
            for n in range(i + 1):
                schur[i, n] += by_u / control[0] * recursion.lever[n, k]
    for i in range(3):
        for n in range(i + 1):
            if stages.start_reward > 0:
                schur[i, n] += border[i, 0, 0] * border[n, 0, 0] / P[0, 0]
            if stages.free_start:
                schur[i, n] += border[i, 0, 1] * border[n, 0, 1] / P[0, 2]
            schur[n, i] = schur[i, n]
    return schur


@kernel
def _solve_schur(schur: Array, recursion: Recursion, enforced: np.ndarray) -> None:
    """Solve schur · change = residual by elimination; withdraw what overflows or depends on the others."""
    residual, change = recursion.residual, recursion.change
    pivots = np.array([schur[0, 0], schur[1, 1], schur[2, 2]])
    for i in range(3):
        enforced[i] = enforced[i] and schur[i, i] > MIN_PIVOT * pivots[i]
        for n in range(i + 1, 3 if enforced[i] else 0):
            share = schur[n, i] / schur[i, i]
            residual[n] -= share * residual[i]
            for m in range(i + 1, 3):
                schur[n, m] -= share * schur[i, m]
    change[:] = 0.0
    for i in range(2, -1, -1):
        if enforced[i]:
            change[i] = residual[i]
            for n in range(i + 1, 3):
                change[i] -= schur[i, n] * change[n]
            change[i] /= schur[i, i]
