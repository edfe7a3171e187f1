"""Step lengths: the fraction to the boundary, and the backtracking line search with a filter.

Step A-5 of A. Wächter and L. T. Biegler, Mathematical Programming 106 (2006) 25–57, without
second-order corrections and without a restoration phase.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.kernels import Floats1, Floats2, kernel
from planner.timing.order3.kkt import Derivatives, Iterate, Program
from planner.timing.order3.riccati import Direction
from planner.timing.order3.stages import (
    WHOLE,
    advance,
    differentiate_place,
    get_stage,
    sum_costs,
)

# Least fraction to the boundary, τ_min (equation 8); and the largest share of an interval's h that
# one step takes off.
TAU_MIN = 0.99
MAX_SHORTENING = 0.9
# Margins γ_θ and γ_φ of the filter (equation 18), and η_φ of the Armijo condition (equation 20).
GAMMA = 1e-5
ETA = 1e-8
# Exponents of the switching condition (equation 19).
S_PHI = 2.3
S_THETA = 1.1
# θ_min and θ_max, as factors of the first θ. The paper's θ_max is 1e4, which lets steps from our
# guesses lead astray.
THETA_MIN = 1e-4
THETA_MAX = 2.0
MAX_HALVINGS = 14
# A step along which φ changes by less than its own rounding, as a share of it, is judged by θ
# alone.
FLAT = 1e-11
# θ that counts as zero then.
ROUNDING_THETA = 1e-11
# Rounding of φ in the Armijo condition, as a share.
ROUNDING = 1e-13
# z stays within this factor of μ/s, and its inverse (κ_Σ, equation 16).
KAPPA_SIGMA = 1e10
# Product of slacks at which its logarithm is taken, before it underflows.
UNDERFLOW = 1e-200
# Outcomes of a line search: no step is acceptable; one is; one is, and the filter is augmented.
FAILED, ACCEPTED, AUGMENTS = range(3)


class Merit(NamedTuple):
    """Measures of a point: constraint violation θ, objective f, Σ ln s, and Σ h."""

    theta: float
    objective: float
    logarithms: float
    time: float

    def phi(self, mu: float) -> float:
        """Return the barrier function φ_μ = f − μ Σ ln s."""
        return self.objective - mu * self.logarithms


class Limits(NamedTuple):
    """Largest step lengths of x, s and of z (equation 15), and the slope of φ along the step."""

    alpha: float
    alpha_z: float
    slope: float


class Ray(NamedTuple):
    """A point with its merit, and a direction from there with its limits."""

    program: Program
    point: Iterate
    merit: Merit
    direction: Direction
    limits: Limits
    mu: float

    @property
    def is_flat(self) -> bool:
        """True if φ changes by no more than its rounding."""
        return abs(self.limits.slope) <= FLAT * abs(self.merit.phi(self.mu))


class Filter:
    """Pairs (θ, φ) that a trial point must improve on; θ_min and θ_max (step A-1)."""

    def __init__(self) -> None:
        self.entries: list[tuple[float, float]] = []
        self.theta_min = self.theta_max = 0.0

    def widen(self, theta: float) -> None:
        """Empty the filter, and raise θ_min and θ_max for a point with violation θ."""
        self.entries.clear()
        self.theta_min = max(self.theta_min, THETA_MIN * max(1.0, theta))
        self.theta_max = max(self.theta_max, THETA_MAX * max(1.0, theta))


class Standard(NamedTuple):
    """Numbers by which a trial point is judged: θ, φ and slope at the point, and the filter.

    entries (N, 2)   pairs (θ, φ) of the filter
    """

    theta: float
    phi: float
    slope: float
    mu: float
    is_flat: bool
    theta_min: float
    theta_max: float
    entries: Floats2


class Taken(NamedTuple):
    """A step length, the merit of its trial point, and the outcome of the search."""

    alpha: float
    theta: float
    objective: float
    logarithms: float
    time: float
    outcome: int


def search(ray: Ray, filter: Filter, trial: Iterate) -> tuple[float, Merit]:
    """Fill x, s and residuals of `trial` at an acceptable step length (steps A-5 and A-7).

    Returns the step length and the merit.
    """
    theta = ray.merit.theta
    phi = ray.merit.phi(ray.mu)
    standard = Standard(
        theta=theta,
        phi=phi,
        slope=min(ray.limits.slope, 0.0),
        mu=ray.mu,
        is_flat=ray.is_flat,
        theta_min=filter.theta_min,
        theta_max=filter.theta_max,
        entries=np.array(filter.entries).reshape(-1, 2),
    )
    taken = try_steps(ray.program, ray.point, ray.direction, ray.limits.alpha, standard, trial)
    if taken.outcome == AUGMENTS:
        filter.entries.append((theta, phi))
    elif taken.outcome == FAILED:
        # instead of the restoration phase: the shortest step that was tried is taken, from
        # which others may succeed
        filter.entries.clear()
    return taken.alpha, Merit(taken.theta, taken.objective, taken.logarithms, taken.time)


def measure(program: Program, point: Iterate, direction: Direction, trial: Iterate) -> Merit:
    """Fill x, s and the residuals of `trial` with those of the point; return its merit."""
    any_point = Standard(np.inf, 0.0, 0.0, 0.0, True, 0.0, np.inf, np.empty((0, 2)))
    taken = try_steps(program, point, direction, 0.0, any_point, trial)
    return Merit(taken.theta, taken.objective, taken.logarithms, taken.time)


@kernel
def try_steps(
    program: Program,
    point: Iterate,
    direction: Direction,
    alpha: float,
    standard: Standard,
    trial: Iterate,
) -> Taken:
    """Halve the step length alpha until the step is acceptable (steps A-5.1 to A-5.10)."""
    outcome = FAILED
    merit = try_step(program, point, direction, alpha, trial)
    for tried in range(MAX_HALVINGS):
        if tried:
            alpha /= 2
            merit = try_step(program, point, direction, alpha, trial)
        phi = merit.objective - standard.mu * merit.logarithms
        outcome = judge_step(standard, alpha, merit.theta, phi)
        if outcome != FAILED:
            break
    return Taken(alpha, merit.theta, merit.objective, merit.logarithms, merit.time, outcome)


@kernel
def judge_step(standard: Standard, alpha: float, theta: float, phi: float) -> int:
    """Return whether a trial point with θ and φ is acceptable, and whether the filter grows."""
    before = standard.theta
    entries = standard.entries
    if not theta < standard.theta_max:
        return FAILED
    for i in range(len(entries)):
        if not (theta < (1 - GAMMA) * entries[i, 0] or phi < entries[i, 1] - GAMMA * entries[i, 0]):
            return FAILED
    if standard.is_flat:
        return ACCEPTED if theta <= max(before, ROUNDING_THETA) else FAILED
    if before <= standard.theta_min and alpha * (-standard.slope) ** S_PHI > before**S_THETA:
        # case I: φ decreases by the Armijo condition
        least = standard.phi + ETA * alpha * standard.slope + ROUNDING * abs(standard.phi)
        return ACCEPTED if phi <= least else FAILED
    if theta <= (1 - GAMMA) * before or phi <= standard.phi - GAMMA * before:
        # case II: θ or φ decreases, and the filter is augmented
        return AUGMENTS
    return FAILED


@kernel
def limit_step(
    program: Program,
    point: Iterate,
    derivatives: Derivatives,
    mu: float,
    direction: Direction,
) -> Limits:
    """Fill the changes of s and z, and return the limits of the step."""
    stages, active = program
    slope = 0.0
    alpha = 1.0
    for k in range(len(stages.step)):
        v, a, j, h = get_stage(point.states, point.controls, k)
        dx = direction.stages[k]
        for n in range(4):
            slope += derivatives.objective[k, n] * dx[n]
        if dx[3] * alpha < -MAX_SHORTENING * h:
            alpha = -MAX_SHORTENING * h / dx[3]
        for place in range(3):
            t, half_square, v_h, a_h = differentiate_place(place, a, j, h)
            v_here, a_here = advance(v, a, j, t)
            dv = dx[0] + t * dx[1] + half_square * dx[2] + v_h * dx[3]
            da = dx[1] + t * dx[2] + a_h * dx[3]
            change = (
                dv,
                2 * v_here * dv,
                3 * v_here * v_here * dv,
                da,
                dv * a_here + v_here * da,
                dx[2],
            )
            for i in range(active.begin[k, place], active.begin[k, place + 1]):
                direction.s[i] = point.g[i] - _sum_terms(active.coefficients[i], change)
        for i in range(active.begin[k, WHOLE], active.begin[k, WHOLE + 1]):
            direction.s[i] = point.g[i] - active.coefficients[i, 1] * dx[3] / stages.duration[k]
    primal = dual = centred = 0.0
    for i in range(len(point.s)):
        z = point.z[i]
        ds = direction.s[i]
        inverse = 1 / point.s[i]
        dz = (mu - z * ds) * inverse - z
        direction.z[i] = dz
        ds *= inverse
        centred += ds
        primal = max(primal, -ds)
        dual = max(dual, -dz / z)
    tau = max(TAU_MIN, 1 - mu)
    if primal * alpha > tau:
        alpha = tau / primal
    return Limits(alpha, tau / dual if dual > tau else 1.0, slope - mu * centred)


@kernel
def _sum_terms(row: Floats1, terms: tuple[float, float, float, float, float, float]) -> float:
    value: float = row[1] * terms[0] + row[2] * terms[1] + row[3] * terms[2]
    value += row[4] * terms[3] + row[5] * terms[4] + row[6] * terms[5]
    return value


@kernel
def try_step(
    program: Program,
    point: Iterate,
    direction: Direction,
    alpha: float,
    trial: Iterate,
) -> Merit:
    """Fill x, s and the residuals of `trial` after a step of length alpha; return its merit."""
    stages, active = program
    count = len(stages.step)
    theta = time = 0.0
    _move_states(point, direction, alpha, stages.free_end, trial.states)
    for k in range(count):
        v = trial.states[k, 0]
        a = trial.states[k, 1]
        j = point.controls[k, 0] + alpha * direction.stages[k, 2]
        h = point.controls[k, 1] + alpha * direction.stages[k, 3]
        trial.controls[k, 0] = j
        trial.controls[k, 1] = h
        v_end, a_end = advance(v, a, j, h)
        trial.next[k, 0] = v_end - trial.states[k + 1, 0]
        trial.next[k, 1] = a_end - trial.states[k + 1, 1]
        trial.step[k] = h * (v + h * (a / 2 + h * j / 6)) / stages.step[k] - 1
        theta += abs(trial.step[k]) + abs(trial.next[k, 0]) / stages.scale[0]
        if k < count - 1 or not stages.free_end:
            theta += abs(trial.next[k, 1]) / stages.scale[1]
        time += h
        for place in range(3):
            v_here, a_here = advance(v, a, j, h * place / 2)
            terms = (v_here, v_here * v_here, v_here * v_here * v_here, a_here, v_here * a_here, j)
            for i in range(active.begin[k, place], active.begin[k, place + 1]):
                row = active.coefficients[i]
                trial.g[i] = active.bound[i] - row[0] - _sum_terms(row, terms)
        for i in range(active.begin[k, WHOLE], active.begin[k, WHOLE + 1]):
            trial.g[i] = active.bound[i] - active.coefficients[i, 1] * h / stages.duration[k]
    if stages.fixed_time:
        theta += abs(time - 1)
    logarithms = 0.0
    product = 1.0  # one logarithm of a product costs less than a sum of logarithms
    for i in range(len(active.bound)):
        trial.s[i] = point.s[i] + alpha * direction.s[i]
        trial.g[i] -= trial.s[i]
        theta += abs(trial.g[i])
        product *= trial.s[i]
        if product < UNDERFLOW or product > 1 / UNDERFLOW:
            logarithms += np.log(product)
            product = 1.0
    objective = stages.objective_scale * sum_costs(stages, trial.states, trial.controls)
    return Merit(theta, objective, logarithms + np.log(product), time)


@kernel
def _move_states(
    point: Iterate,
    direction: Direction,
    alpha: float,
    free_end: bool,
    out: Floats2,
) -> None:
    """Fill out with states + alpha · their change. A given last state stays."""
    last = len(out) - 1
    for k in range(last + 1):
        for n in range(2):
            moves = k < last or (n == 1 and free_end)
            out[k, n] = point.states[k, n] + (alpha * direction.states[k, n] if moves else 0.0)


@kernel
def step_multipliers(point: Iterate, direction: Direction, alpha: float, mu: float) -> None:
    """Change z by a step of length alpha, and keep it near μ/s (equation 16)."""
    for i in range(len(point.z)):
        center = mu / point.s[i]
        z = point.z[i] + alpha * direction.z[i]
        point.z[i] = min(max(z, center / KAPPA_SIGMA), center * KAPPA_SIGMA)
