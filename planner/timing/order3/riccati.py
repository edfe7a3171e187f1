"""A Newton step of the order-3 problem by a Riccati recursion over the stages.

Linearized, Δs eliminates one control of each stage: h where the interval ends in motion, j where it
ends near rest. The other one is the stage's free control u. Backwards, the cost to go from the
state y = (v, a) is ½ yᵀPy + pᵀy, and minimizing over u gives P and p of the stage before: see J. B.
Rawlings, D. Q. Mayne and M. M. Diehl, Model Predictive Control (2nd ed., 2017), section 8.8.

A given last state enters as a penalty ϱ/2 |residual|² with a multiplier (augmented Lagrangian).
A larger ϱ would cost the recursion its digits: where this one leaves much of the residual, the last
state is met exactly, as a fixed duration always is, by multipliers that border the system (Schur
complement).
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import Flags1, Floats1, Floats2, Floats3, Ints1, kernel
from planner.timing.order3.kkt import Iterate
from planner.timing.order3.stages import (
    END,
    Stages,
    add_hessian,
    advance,
    differentiate_place,
    get_stage,
)

# Least curvature along a free control that counts as positive, in units of the objective per
# squared scale.
MIN_CURVATURE = 1e-9
# Penalty ϱ of the last state, in units of the objective per squared scale, and the share of its
# residual that a step may leave.
PENALTY = 1e8
MAX_REMAINDER = 0.1
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
    hessian: Floats3
    gradient: Floats2
    last: Floats1
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

    P: Floats2
    p: Floats2
    eliminated: Ints1
    elimination: Floats2
    control: Floats2
    border: Floats3
    lever: Floats2
    residual: Floats1
    change: Floats1

    @classmethod
    def allocate(cls, count: int) -> "Recursion":
        """Return room for the recursion over `count` stages."""
        P = np.zeros((count + 1, 3))
        p = np.zeros((count + 1, 2))
        border = np.zeros((3, count + 1, 2))
        rows = np.zeros((count, 4))
        return cls(
            P,
            p,
            np.zeros(count, int),
            rows,
            rows.copy(),
            border,
            np.zeros((3, count)),
            np.zeros(3),
            np.zeros(3),
        )


class _Model(NamedTuple):
    """Hessian and gradient of the cost to go of a stage: by x, H and g; by v, a and u, M and G."""

    H: Floats2
    g: Floats1
    M: Floats2
    G: Floats1


class Direction(NamedTuple):
    """Newton step: changes of states (N + 1, 2), stages (N, 4), s and z (K,), and the new λ.

    next (N + 1, 2), step (N,)  multipliers after a full step
    time (1,)                   change of the multiplier of the duration
    """

    states: Floats2
    stages: Floats2
    s: Floats1
    z: Floats1
    next: Floats2
    step: Floats1
    time: Floats1


@kernel
def solve_newton(system: NewtonSystem, recursion: Recursion, direction: Direction) -> bool:
    """Fill the direction, except s and z. Return False where more regularization is needed.

    That is so where the Hessian is not positive definite along a free control, or so nearly that
    the step overflows.
    """
    stages = system.stages
    residual = recursion.residual
    count = len(stages.step)
    direction.time[0] = 0.0
    if not recur_backward(system, recursion):
        return False
    recur_forward(system, recursion, direction)
    residual[0] = direction.states[count, 0]
    residual[1] = direction.states[count, 1]
    residual[2] = 0.0
    for k in range(count):
        residual[2] += direction.stages[k, 3]
    residual[2] += system.time_residual
    for n in range(3):
        if not np.isfinite(residual[n]):
            return False
    before = after = 0.0
    for n in range(1 if stages.free_end else 2):
        before = max(before, abs(system.point.next[count - 1, n]) / stages.scale[n])
        after = max(after, abs(residual[n]) / stages.scale[n])
    exact = after > MAX_REMAINDER * before
    if not (exact or stages.fixed_time):
        return True
    enforced = np.empty(3, np.bool_)
    enforced[0] = exact
    enforced[1] = exact and not stages.free_end
    enforced[2] = stages.fixed_time
    enforce_ends(system, recursion, enforced)
    change = recursion.change[2]
    direction.time[0] = change
    for k in range(count):
        system.gradient[k, 3] += change
    recur_forward(system, recursion, direction)
    for k in range(count):
        system.gradient[k, 3] -= change
    last = direction.states[count]
    return bool(np.isfinite(last[0]) and np.isfinite(last[1]))


@kernel
def recur_backward(system: NewtonSystem, recursion: Recursion) -> bool:
    """Fill the recursion; return False where the curvature along a free control is not positive."""
    stages = system.stages
    point = system.point
    count = len(stages.step)
    scale = stages.scale
    model = _Model(np.empty((4, 4)), np.empty(4), np.empty((3, 3)), np.empty(3))
    H = model.H
    g = model.g
    P = recursion.P
    p = recursion.p
    P[count, 0] = PENALTY / scale[0] ** 2
    P[count, 1] = 0.0
    P[count, 2] = 0.0 if stages.free_end else PENALTY / scale[1] ** 2
    p[count, 0] = system.last[0]
    p[count, 1] = 0.0 if stages.free_end else system.last[1]
    for k in range(count - 1, -1, -1):
        _, a, j, h = get_stage(point.states, point.controls, k)
        derivatives = differentiate_place(END, a, j, h)
        t, half_square, v_h, a_h = derivatives
        # the cost to go of the next state, as a function of x
        for m in range(4):
            for n in range(4):
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
        if not _condense(system, recursion, k, model):
            return False
    if stages.start_reward > 0 and not P[0, 0] * scale[0] ** 2 > MIN_CURVATURE:
        return False
    return not stages.free_start or P[0, 2] * scale[1] ** 2 > MIN_CURVATURE


@kernel
def _condense(system: NewtonSystem, recursion: Recursion, k: int, model: _Model) -> bool:
    """Eliminate both controls of stage k: set P[k] and p[k]."""
    stages = system.stages
    point = system.point
    H, g, M, G = model
    v, a, j, h = get_stage(point.states, point.controls, k)
    # Δs by j and by h: the control that moves it more is eliminated
    by_j = h * h * h / 6
    by_h = advance(v, a, j, h)[0]
    if abs(by_h) * stages.duration[k] >= abs(by_j) * stages.scale[2]:
        e = 3
        u = 2
        pivot = by_h
        other = by_j
        unit = stages.scale[2]
    else:
        e = 2
        u = 3
        pivot = by_j
        other = by_h
        unit = stages.duration[k]
    f = recursion.elimination[k]
    f[0] = -h / pivot
    f[1] = -h * h / 2 / pivot
    f[2] = -other / pivot
    f[3] = -point.step[k] * stages.step[k] / pivot
    # x as a function of v, a and u: the Hessian M and the gradient G by these
    index = (0, 1, u)
    for m in range(4):
        for n in range(m):
            H[m, n] = H[n, m]
    for m in range(3):
        G[m] = g[index[m]] + H[index[m], e] * f[3] + f[m] * (g[e] + H[e, e] * f[3])
        for n in range(m, 3):
            M[m, n] = H[index[m], index[n]] + f[n] * H[index[m], e]
            M[m, n] += f[m] * (H[index[n], e] + f[n] * H[e, e])
    curvature = M[2, 2]
    if not curvature * unit * unit > MIN_CURVATURE:
        return False
    recursion.eliminated[k] = e
    control = recursion.control[k]
    control[0] = curvature
    control[1] = M[0, 2]
    control[2] = M[1, 2]
    control[3] = G[2]
    P = recursion.P[k]
    p = recursion.p[k]
    P[0] = M[0, 0] - M[0, 2] * M[0, 2] / curvature
    P[1] = M[0, 1] - M[0, 2] * M[1, 2] / curvature
    P[2] = M[1, 1] - M[1, 2] * M[1, 2] / curvature
    p[0] = G[0] - M[0, 2] * G[2] / curvature
    p[1] = G[1] - M[1, 2] * G[2] / curvature
    return True


@kernel
def recur_forward(system: NewtonSystem, recursion: Recursion, direction: Direction) -> None:
    """Fill the direction from the first state on."""
    stages = system.stages
    point = system.point
    dy = direction.states
    P = recursion.P
    p = recursion.p
    dy[0, 0] = -p[0, 0] / P[0, 0] if stages.start_reward > 0 else 0.0
    dy[0, 1] = -p[0, 1] / P[0, 2] if stages.free_start else 0.0
    for k in range(len(stages.step)):
        v, a, j, h = get_stage(point.states, point.controls, k)
        t, half_square, v_h, a_h = differentiate_place(END, a, j, h)
        control = recursion.control[k]
        elimination = recursion.elimination[k]
        e = recursion.eliminated[k]
        dv = dy[k, 0]
        da = dy[k, 1]
        du = -(control[1] * dv + control[2] * da + control[3]) / control[0]
        de = elimination[0] * dv + elimination[1] * da + elimination[2] * du + elimination[3]
        dj, dh = (du, de) if e == 3 else (de, du)
        dx = direction.stages[k]
        dx[0] = dv
        dx[1] = da
        dx[2] = dj
        dx[3] = dh
        next_v = point.next[k, 0] + dv + t * da + half_square * dj + v_h * dh
        next_a = point.next[k, 1] + da + t * dj + a_h * dh
        dy[k + 1, 0] = next_v
        dy[k + 1, 1] = next_a
        # λ of the next state is the gradient of the cost to go
        lambda_v = p[k + 1, 0] + P[k + 1, 0] * next_v + P[k + 1, 1] * next_a
        lambda_a = p[k + 1, 1] + P[k + 1, 1] * next_v + P[k + 1, 2] * next_a
        direction.next[k + 1, 0] = lambda_v
        direction.next[k + 1, 1] = lambda_a
        # λ of Δs makes the Lagrangian stationary along the eliminated control
        H = system.hessian[k]
        total = system.gradient[k, e] + H[0, e] * dv + H[1, e] * da + H[2, 3] * du + H[e, e] * de
        if e == 3:
            total += v_h * lambda_v + a_h * lambda_a
            total += system.delta_w / stages.duration[k] ** 2 * de
            slope = advance(v, a, j, h)[0]
        else:
            total += half_square * lambda_v + t * lambda_a
            total += system.delta_w / stages.scale[2] ** 2 * de
            slope = h * h * h / 6
        direction.step[k] = -total / slope * stages.step[k]


@kernel
def enforce_ends(system: NewtonSystem, recursion: Recursion, enforced: Flags1) -> None:
    """Change the multipliers of the last v, the last a and Σ h so that the enforced ones (3,) hold.

    Where that overflows, they stay: the step of the penalty is finite, though it leaves some
    residual.
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
def _recur_border(system: NewtonSystem, recursion: Recursion, enforced: Flags1) -> Array:
    """Fill border and lever. Return the Schur complement (3, 3): residual per multiplier."""
    stages = system.stages
    point = system.point
    border = recursion.border
    P = recursion.P
    count = len(stages.step)
    border[:, count] = 0.0
    border[0, count, 0] = border[1, count, 1] = 1.0
    schur = np.zeros((3, 3))
    for k in range(count - 1, -1, -1):
        _, a, j, h = get_stage(point.states, point.controls, k)
        t, half_square, v_h, a_h = differentiate_place(END, a, j, h)
        control = recursion.control[k]
        elimination = recursion.elimination[k]
        v_share = control[1] / control[0]
        a_share = control[2] / control[0]
        for i in range(3):
            if not enforced[i]:
                continue
            g_v = border[i, k + 1, 0]
            g_a = border[i, k + 1, 1]
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
def _solve_schur(schur: Floats2, recursion: Recursion, enforced: Flags1) -> None:
    """Solve schur · change = residual, without rows that overflow or depend on others."""
    residual = recursion.residual
    change = recursion.change
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
