"""The smoothest motion of a stated duration: least integral of squared actuator jerk, by CasADi and FATROP.

The stages are those of planner.timing.third_order with one more state, the time t, and another cost:

    minimise ∫ Σ_i (q⃛_i/w_i)² dt
    such that t rises from 0 to T, the next state follows, and every row is kept

with q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³ at both ends of every interval, weighed half each.
"""

from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.timing.closing import closed
from planner.timing.patience import Patience
from planner.timing.problem import Problem
from planner.timing.profile import Profile
from planner.timing.quiet import quiet
from planner.timing.stages import chained, derivatives
from planner.timing.third_order import _ONE_AT_A_TIME, Signature, _rows, _stage

ITERATIONS, EVALUATIONS, TOLERANCE = 300, 600, 1e-8
# Least duration of an interval, as a share of its guess.
SHORTEST = 0.05
HALVINGS = 60


def smoothest(path: ActuatorPath, problem: Problem, weights: Array, guess: Array) -> Profile:
    """The smoothest motion from rest to rest, s̈ zero at both ends, that takes as long as the guess.

    weights (n,): w of each axis, ∞ for one that does not count. guess (4, N): ṡ, s̈, s⃛, h to start from. Raises
    MotionError when the solver does not converge.
    """
    length, time, count = problem.s[-1] - problem.s[0], float(guess[3].sum()), problem.intervals
    unit = np.array([length / time, length / time**2, length / time**3, time])
    start = guess / unit[:, None]
    scale = np.repeat(np.abs(start).max(1, keepdims=True), count, 1)
    scale[3] = start[3]
    signature, coefficients, least, most = _rows(problem, length, time)
    # jerks of the axes, counted in what they are on average under the guess
    sides = [path.derivatives(s, problem.piece)[1:] for s in (problem.s[:-1], problem.s[1:])]
    rough = np.stack([d / weights * unit[2] * length**k for side in sides for k, d in enumerate(side)])
    v, a, j = start[:3]
    jerks = rough[0] * j[:, None] + 3 * rough[1] * (v * a)[:, None] + rough[2] * (v**3)[:, None]
    rough /= np.sqrt((jerks**2 * start[3][:, None]).sum())
    data = np.concatenate(
        [np.diff(problem.s)[None] / length, scale, np.zeros((1, count)), coefficients, *rough.transpose(0, 2, 1)]
    )
    solver, patience = _assemble(count, signature, rough.shape[2])
    variables = np.insert(start / scale, 2, np.concatenate([[0.0], np.cumsum(start[3])[:-1]]), axis=0)
    low = np.tile([0.0, -np.inf, -np.inf, -np.inf, SHORTEST], (count, 1))
    high = np.full((count, 5), np.inf)
    low[0, :3] = high[0, :3] = 0.0
    last = [0.0, 0.0, 1.0]
    equal = np.zeros((4, count))
    try:
        with _ONE_AT_A_TIME, quiet(), patience.asked():
            answer = solver(
                x0=np.concatenate([variables.T.ravel(), last]),
                p=data.T.ravel(),
                lbx=np.concatenate([low.ravel(), last]),
                ubx=np.concatenate([high.ravel(), last]),
                lbg=np.concatenate([equal, least]).T.ravel(),
                ubg=np.concatenate([equal, most]).T.ravel(),
            )
            stats = solver.stats()
    except RuntimeError as failure:  # CasADi's own
        raise MotionError(f"the solver of the smoothest motion failed: {failure}") from failure
    found = np.asarray(answer["x"]).ravel()[:-3].reshape(count, 5).T
    if not stats["success"] or not np.isfinite(found).all():
        _assemble.cache_clear()  # a failed solve can leave infinities in the solver
        raise MotionError(f"the solver of the smoothest motion stopped: {stats['return_status']}")
    profile = closed(problem, np.delete(found, 2, axis=0) * scale * unit[:, None])
    return profile.slowed(time / profile.duration)


def quintic(s: Array, duration: float) -> Array:
    """(4, N) of ṡ, s̈, s⃛, h on a grid s (N+1,) of 10 τ³ − 15 τ⁴ + 6 τ⁵: the smoothest straight motion without limits."""
    share = (s - s[0]) / (s[-1] - s[0])
    low, high = np.zeros(len(s)), np.ones(len(s))
    for _ in range(HALVINGS):
        tau = (low + high) / 2
        early = tau**3 * (10 - 15 * tau + 6 * tau**2) < share
        low, high = np.where(early, tau, low), np.where(early, high, tau)
    tau[0], tau[-1] = 0.0, 1.0
    length, h = s[-1] - s[0], np.diff(tau)
    v, a = 30 * (tau * (1 - tau)) ** 2, 60 * tau * (1 - tau) * (1 - 2 * tau)
    scale = length / duration ** np.arange(1, 4)
    return np.stack([v[:-1] * scale[0], a[:-1] * scale[1], np.diff(a) / h * scale[2], h * duration])


def even(intervals: int) -> Array:
    """Where a grid's points lie, as shares of the way (intervals+1,), for the quintic to take as long over each."""
    tau = np.linspace(0.0, 1.0, intervals + 1)
    return np.asarray(tau**3 * (10 - 15 * tau + 6 * tau**2))


@lru_cache(maxsize=4)
def _assemble(intervals: int, signature: Signature, axes: int) -> tuple[ca.Function, Patience]:
    stage = _stage(signature)
    size, rows = stage.size1_in(1), stage.size1_out(2)
    x, data = ca.SX.sym("x", 5), ca.SX.sym("data", size + 6 * axes)
    ends, travelled, values = stage(ca.vertcat(x[:2], x[3:]), data[:size])
    v, a, j, h = ca.vertsplit(ca.vertcat(x[:2], x[3:]) * data[1:5])
    cost: ca.SX = ca.SX(0)
    for side, (speed, push) in enumerate(((v, a), (v + h * (a + h * j / 2), a + h * j))):
        first, second, third = (data[size + (3 * side + k) * axes : size + (3 * side + k + 1) * axes] for k in range(3))
        cost += h / 2 * ca.sumsqr(first * j + 3 * second * speed * push + third * speed**3)
    interval = ca.Function(
        "interval", [x, data], [ca.vertcat(ends, x[2] + h), ca.vertcat(travelled, values), cost], {"cse": True}
    )
    patience = Patience(EVALUATIONS)
    options: dict[str, Any] = {
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "structure_detection": "auto",
        "equality": np.tile(np.arange(4 + rows) < 4, intervals).tolist(),
        "cache": derivatives(interval, intervals),
        "fatrop": {
            "print_level": 0,
            "max_iter": ITERATIONS,
            "tol": TOLERANCE,
            "mu_init": 1e-1,
            "alpha_min_frac": 0.0,  # see Patience
        },
    }
    problem = chained(interval, intervals, patience)
    return ca.nlpsol("smoothest", "fatrop", problem, options), patience
