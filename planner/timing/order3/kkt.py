"""Optimality (KKT) conditions of the order-3 problem: residuals, gradient and Hessian.

Active constraints are g(x) + s = b with slacks s > 0 and multipliers z, which also are those of the
bounds s ≥ 0. Equality constraints c(x) = 0 are the next states, the steps Δs, and the duration if
it is fixed; λ are their multipliers. For a barrier parameter μ a solution satisfies

    ∇f + ∇g z + ∇c λ = 0     c(x) = 0     g(x) + s = b     s z = μ

Newton's method for these eliminates ds = b − g − s − ∇gᵀ dx and dz = (μ − z ds)/s − z, which leaves
a problem in dx: its gradient is the sum of a part without μ and of μ times a second one, and its
Hessian that of the Lagrangian with ∇g (z/s) ∇gᵀ.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.kernels import Floats1, Floats2, Floats3, kernel
from planner.timing.order3.active_set import ActiveSet
from planner.timing.order3.stages import (
    END,
    MIDDLE,
    START,
    WHOLE,
    Stages,
    add_hessian,
    advance,
    differentiate_place,
    evaluate_square,
)

# Scaling of multipliers in the optimality error (s_max, after equation 5).
S_MAX = 100.0
# Parts of the gradient: of constraints with their multipliers (the dual residual), of constraints
# with z eliminated, of the barrier, and of the objective.
DUAL, CONSTRAINTS, BARRIER, OBJECTIVE = range(4)


class Program(NamedTuple):
    """The nonlinear program that an iteration works on."""

    stages: Stages
    active: ActiveSet


class Iterate(NamedTuple):
    """Variables x, s, z, and residuals of the constraints at x and s.

    states (N + 1, 2), controls (N, 2)   x
    s, z (K,)                            slacks and multipliers of active constraints
    g (K,)                               b − g(x) − s
    next (N, 2)                          v⁺ and a⁺ minus the next state
    step (N,)                            the stages' Δs, relative to those of the grid, minus 1
    """

    states: Floats2
    controls: Floats2
    s: Floats1
    z: Floats1
    g: Floats1
    next: Floats2
    step: Floats1


class EqualityMultipliers(NamedTuple):
    """λ of the states (N + 1, 2) except the first, of the steps (N,), and of the duration (1,)."""

    next: Floats2
    step: Floats1
    time: Floats1

    @classmethod
    def allocate(cls, count: int) -> "EqualityMultipliers":
        """Return zeros for `count` stages."""
        return cls(np.zeros((count + 1, 2)), np.zeros(count), np.zeros(1))


class Derivatives(NamedTuple):
    """Derivatives by x = (v, a, j, h) of each stage.

    objective (N, 4)    ∇f
    constant, barrier (N, 4)   gradient of the eliminated problem: constant + μ · barrier
    hessian (N, 4, 4)   its Hessian: the upper half
    """

    objective: Floats2
    constant: Floats2
    barrier: Floats2
    hessian: Floats3

    @classmethod
    def allocate(cls, count: int) -> "Derivatives":
        """Return room for the derivatives of `count` stages."""
        objective, constant, barrier = np.zeros((3, count, 4))
        return cls(objective, constant, barrier, np.zeros((count, 4, 4)))


class OptimalityError(NamedTuple):
    """Parts of the optimality error: primal and dual residuals, extremes of s z, sum of z."""

    primal: float
    dual: float
    least_product: float
    largest_product: float
    multiplier_sum: float

    def at(self, mu: float, constraints: int) -> float:
        """Return E_μ (equation 5); constraints: number of inequality constraints, active or not."""
        scaling = max(S_MAX, self.multiplier_sum / constraints) / S_MAX
        complementarity = max(self.largest_product - mu, mu - self.least_product)
        return max(self.primal, self.dual / scaling, complementarity / scaling)


class _Stage(NamedTuple):
    """Sums over a stage: at its places by (v, a, j), then by x.

    places (3, 2)         v and a
    gradients (4, 3, 3)   by part and place
    curvatures (3, 6)     second derivatives, in the order of `add_hessian`
    mapped (4, 4)         gradients by x
    errors (5,)           of `OptimalityError`
    """

    places: Floats2
    gradients: Floats3
    curvatures: Floats2
    mapped: Floats2
    errors: Floats1


@kernel
def _allocate_sums() -> _Stage:
    places = np.empty((3, 2))
    gradients = np.empty((4, 3, 3))
    curvatures = np.empty((3, 6))
    errors = np.array([0.0, 0.0, np.inf, 0.0, 0.0])
    return _Stage(places, gradients, curvatures, np.empty((4, 4)), errors)


@kernel
def linearize(
    program: Program,
    point: Iterate,
    multipliers: EqualityMultipliers,
    out: Derivatives,
) -> OptimalityError:
    """Fill out, and return the optimality error."""
    stages, active = program
    sums = _allocate_sums()
    errors = sums.errors
    last = len(stages.step) - 1
    scale = stages.objective_scale
    for k in range(last + 1):
        v = point.states[k, 0]
        a = point.states[k, 1]
        j = point.controls[k, 0]
        h = point.controls[k, 1]
        for place in range(3):
            sums.places[place, 0], sums.places[place, 1] = advance(v, a, j, h * place / 2)
            _add_constraints(active, point, k, place, sums)
        sums.gradients[OBJECTIVE] = 0.0
        hessian = out.hessian[k]
        sums.gradients[DUAL, END, 0] += multipliers.next[k + 1, 0]
        sums.gradients[DUAL, END, 1] += multipliers.next[k + 1, 1]
        square = _add_squares(stages, point, k, sums)
        _map_stage(a, j, h, sums, hessian)
        _add_duration(program, point, k, sums, hessian)
        if stages.squares.shape[2] > 0:
            for n in range(4):
                hessian[n, 3] += sums.mapped[OBJECTIVE, n] / h * (2 if n == 3 else 1)
            sums.mapped[OBJECTIVE, 3] += scale * square
        if not stages.fixed_time:
            sums.mapped[OBJECTIVE, 2] += 2 * scale * stages.jerk_weight[k] * j
            sums.mapped[OBJECTIVE, 3] += scale
            hessian[2, 2] += 2 * scale * stages.jerk_weight[k]
            if k == 0:
                sums.mapped[OBJECTIVE, 0] -= scale * stages.start_reward
        _add_step(multipliers.step[k] / stages.step[k], h, sums, hessian)
        sums.mapped[DUAL, 3] += multipliers.time[0]
        for n in range(4):
            out.objective[k, n] = sums.mapped[OBJECTIVE, n]
            out.barrier[k, n] = sums.mapped[BARRIER, n]
            out.constant[k, n] = sums.mapped[CONSTRAINTS, n] + sums.mapped[OBJECTIVE, n]
            residual = sums.mapped[DUAL, n] + sums.mapped[OBJECTIVE, n]
            if n < 2 and k > 0:
                residual -= multipliers.next[k, n]
            elif (n == 0 and stages.start_reward == 0) or (n == 1 and not stages.free_start):
                residual = 0.0
            size = stages.scale[n] if n < 3 else stages.duration[k]
            errors[1] = max(errors[1], abs(residual) * size)
        errors[0] = max(errors[0], abs(point.step[k]), abs(point.next[k, 0]) / stages.scale[0])
        if k < last or not stages.free_end:
            errors[0] = max(errors[0], abs(point.next[k, 1]) / stages.scale[1])
    return OptimalityError(errors[0], errors[1], errors[2], errors[3], errors[4])


@kernel
def _add_constraints(active: ActiveSet, point: Iterate, k: int, place: int, sums: _Stage) -> None:
    """Set the sums at a place to those of its active constraints."""
    v = sums.places[place, 0]
    a = sums.places[place, 1]
    rows = active.coefficients
    dual_v = dual_a = dual_j = 0.0
    constant_v = constant_a = constant_j = 0.0
    barrier_v = barrier_a = barrier_j = 0.0
    vv = va = vj = aa = aj = jj = 0.0
    primal = sums.errors[0]
    least = sums.errors[2]
    largest = sums.errors[3]
    total = sums.errors[4]
    for i in range(active.begin[k, place], active.begin[k, place + 1]):
        square = rows[i, 2]
        cube = rows[i, 3]
        cross = rows[i, 5]
        by_v = rows[i, 1] + (2 * square + 3 * v * cube) * v + a * cross
        by_a = rows[i, 4] + v * cross
        by_j = rows[i, 6]
        z = point.z[i]
        residual = point.g[i]
        inverse = 1 / point.s[i]
        product = point.s[i] * z
        sigma = z * inverse
        constant = -sigma * residual
        primal = max(primal, abs(residual))
        least = min(least, product)
        largest = max(largest, product)
        total += z
        dual_v += z * by_v
        dual_a += z * by_a
        dual_j += z * by_j
        constant_v += constant * by_v
        constant_a += constant * by_a
        constant_j += constant * by_j
        barrier_v += inverse * by_v
        barrier_a += inverse * by_a
        barrier_j += inverse * by_j
        vv += sigma * by_v * by_v + z * (2 * square + 6 * v * cube)
        va += sigma * by_v * by_a + z * cross
        vj += sigma * by_v * by_j
        aa += sigma * by_a * by_a
        aj += sigma * by_a * by_j
        jj += sigma * by_j * by_j
    sums.errors[0] = primal
    sums.errors[2] = least
    sums.errors[3] = largest
    sums.errors[4] = total
    g = sums.gradients
    c = sums.curvatures
    g[DUAL, place, 0] = dual_v
    g[DUAL, place, 1] = dual_a
    g[DUAL, place, 2] = dual_j
    g[CONSTRAINTS, place, 0] = constant_v
    g[CONSTRAINTS, place, 1] = constant_a
    g[CONSTRAINTS, place, 2] = constant_j
    g[BARRIER, place, 0] = barrier_v
    g[BARRIER, place, 1] = barrier_a
    g[BARRIER, place, 2] = barrier_j
    c[place, 0] = vv
    c[place, 1] = va
    c[place, 2] = vj
    c[place, 3] = aa
    c[place, 4] = aj
    c[place, 5] = jj


@kernel
def _add_squares(stages: Stages, point: Iterate, k: int, sums: _Stage) -> float:
    """Add the objective's ∫ Σ r² dt to the sums at both ends, and return its integrand, ½ Σ r²."""
    total = 0.0
    j = point.controls[k, 0]
    h = point.controls[k, 1]
    share = stages.objective_scale * h
    for end in range(2 if stages.squares.shape[2] > 0 else 0):
        place = END * end
        v = sums.places[place, 0]
        a = sums.places[place, 1]
        gradient = sums.gradients[OBJECTIVE, place]
        curvature = sums.curvatures[place]
        for i in range(stages.squares.shape[2]):
            row = stages.squares[k, end, i]
            r = evaluate_square(row, v, a, j)
            by_v = row[1] * a + 3 * row[2] * v * v + 2 * row[4] * v
            by_a = row[1] * v + row[3]
            by_j = row[0]
            total += r * r / 2
            gradient[0] += share * r * by_v
            gradient[1] += share * r * by_a
            gradient[2] += share * r * by_j
            curvature[0] += share * (by_v * by_v + r * (6 * row[2] * v + 2 * row[4]))
            curvature[1] += share * (by_v * by_a + r * row[1])
            curvature[2] += share * by_v * by_j
            curvature[3] += share * by_a * by_a
            curvature[4] += share * by_a * by_j
            curvature[5] += share * by_j * by_j
    return total


@kernel
def _map_stage(a: float, j: float, h: float, sums: _Stage, hessian: Floats2) -> None:
    """Set the gradients by x, and the Hessian, from the sums at the places."""
    mapped = sums.mapped
    hessian[:] = 0.0
    mapped[:] = 0.0
    for place in range(3):
        derivatives = differentiate_place(place, a, j, h)
        t, half_square, v_h, a_h = derivatives
        for part in range(4):
            g_v = sums.gradients[part, place, 0]
            g_a = sums.gradients[part, place, 1]
            g_j = sums.gradients[part, place, 2]
            mapped[part, 0] += g_v
            mapped[part, 1] += g_v * t + g_a
            mapped[part, 2] += g_v * half_square + g_a * t + g_j
            mapped[part, 3] += g_v * v_h + g_a * a_h
        c = sums.curvatures
        add_hessian(
            derivatives,
            (c[place, 0], c[place, 1], c[place, 2], c[place, 3], c[place, 4], c[place, 5]),
            hessian,
        )
        if place != START:
            # v and a at the place have second derivatives themselves
            share = 0.5 if place == MIDDLE else 1.0
            g_v = sums.gradients[DUAL, place, 0] + sums.gradients[OBJECTIVE, place, 0]
            g_a = sums.gradients[DUAL, place, 1] + sums.gradients[OBJECTIVE, place, 1]
            hessian[1, 3] += g_v * share
            hessian[2, 3] += (g_v * t + g_a) * share
            hessian[3, 3] += g_v * share * share * j


@kernel
def _add_duration(program: Program, point: Iterate, k: int, sums: _Stage, hessian: Floats2) -> None:
    """Add the active bounds of h."""
    stages, active = program
    errors = sums.errors
    mapped = sums.mapped
    for i in range(active.begin[k, WHOLE], active.begin[k, WHOLE + 1]):
        by_h = active.coefficients[i, 1] / stages.duration[k]
        s = point.s[i]
        z = point.z[i]
        residual = point.g[i]
        errors[0] = max(errors[0], abs(residual))
        errors[2] = min(errors[2], s * z)
        errors[3] = max(errors[3], s * z)
        errors[4] += z
        mapped[DUAL, 3] += z * by_h
        mapped[CONSTRAINTS, 3] -= z / s * residual * by_h
        mapped[BARRIER, 3] += by_h / s
        hessian[3, 3] += z / s * by_h * by_h


@kernel
def _add_step(multiplier: float, h: float, sums: _Stage, hessian: Floats2) -> None:
    """Add the constraint Δs = v h + a h²/2 + j h³/6."""
    end = sums.places[END]
    dual = sums.mapped[DUAL]
    hessian[0, 3] += multiplier
    hessian[1, 3] += multiplier * h
    hessian[2, 3] += multiplier * h * h / 2
    hessian[3, 3] += multiplier * end[1]
    dual[0] += multiplier * h
    dual[1] += multiplier * h * h / 2
    dual[2] += multiplier * h * h * h / 6
    dual[3] += multiplier * end[0]
