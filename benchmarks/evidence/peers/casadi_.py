"""The order-3 problem by FATROP and IPOPT through CasADi: a second opinion on our interior-point method.

The fastest motion (planner.timing.solvers.third_order) and the smoothest of a stated duration
(planner.timing.stated_duration), on the same stages with the same rows.

Derivatives of a problem are written out, which takes a third of the time of CasADi's own: CasADi differentiates a
mapped function column by column and walks through every stage for each; written out once, the entries of a stage's
Jacobian and Hessian share what they have in common.

A stage is a function (x (k,), data) -> the state that it leads to, other constraints, its part of the cost; the state
that it starts from comes first in x. The variables of the whole are those of all stages, and then the last state; the
parameters are their data; the constraints are, stage by stage, the next state less the one led to, and the others.

FATROP: L. Vanroye et al., IROS 2023. IPOPT: A. Wächter and L. T. Biegler, Mathematical Programming 106 (2006) 25–57.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.limits.limit import Term
from planner.orientation.evaluation_limit import EvaluationLimit
from planner.timing.problem import Block, Problem
from planner.timing.profile import RunSolution, close_profile
from planner.timing.solvers.stage_problem import JERK_WEIGHT, POWERS, SHORTEST, SHORTEST_STATED, jerk_share


def chain_stages(stage: ca.Function, intervals: int, patience: EvaluationLimit) -> dict[str, ca.MX]:
    """The whole problem, as CasADi's solvers take it."""
    states = stage.size1_out(0)
    columns, last = ca.MX.sym("columns", stage.size1_in(0), intervals), ca.MX.sym("last", states)
    data = ca.MX.sym("data", stage.size1_in(1), intervals)
    reached, others, costs = stage.map(intervals)(columns, data)
    constraints = ca.vec(ca.vertcat(ca.horzcat(columns[:states, 1:], last) - reached, others))
    return {
        "x": ca.vertcat(ca.vec(columns), last),
        "p": ca.vec(data),
        "f": ca.sum2(costs),
        "g": ca.vertcat(constraints[0] + patience(columns[0]), constraints[1:]),
    }


def derivatives(stage: ca.Function, intervals: int) -> dict[str, ca.Function]:
    """The constraints' Jacobian and the Lagrangian's Hessian, by the names under which CasADi keeps FATROP's."""
    x, data = ca.SX.sym("x", stage.size1_in(0)), ca.SX.sym("data", stage.size1_in(1))
    reached, others, cost = stage(x, data)
    own, states, size = ca.vertcat(-reached, others), reached.numel(), x.numel()
    weight, force = ca.SX.sym("weight"), ca.SX.sym("force", own.numel())
    slope = ca.vertcat(ca.horzcat(ca.SX.eye(states), ca.SX(states, size - states)), ca.jacobian(own, x))
    bend, push = ca.hessian(weight * cost + ca.dot(force, own), x)
    first = ca.Function("first", [x, data], [own, slope.nz[:]], {"cse": True}).map(intervals)
    second = ca.Function("second", [x, data, weight, force], [push, bend.nz[:]], {"cse": True}).map(intervals)

    variables, parameters = ca.MX.sym("x", size * intervals + states), ca.MX.sym("p", data.numel() * intervals)
    columns, last = ca.reshape(variables[:-states], size, intervals), variables[-states:]
    given = ca.reshape(parameters, data.numel(), intervals)
    values, slopes = first(columns, given)
    values = ca.vec(ca.vertcat(values[:states, :] + ca.horzcat(columns[:states, 1:], last), values[states:, :]))
    sparsity, kept = _chain(slope.sparsity(), states, intervals)
    jacobian = ca.MX(sparsity, ca.vertcat(ca.vec(slopes), ca.MX.ones(states))[kept])

    whole, forces = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", own.numel() * intervals)
    pulls = ca.reshape(forces, own.numel(), intervals)
    pushes, bends = second(columns, given, ca.repmat(whole, 1, intervals), pulls)
    before = ca.horzcat(ca.MX(states, 1), pulls[:states, :-1])
    gradient = ca.vertcat(ca.vec(ca.vertcat(pushes[:states, :] + before, pushes[states:, :])), pulls[:states, -1])
    hessian = ca.MX(ca.diagcat(*[bend.sparsity()] * intervals, ca.Sparsity(states, states)), ca.vec(bends))
    return {
        "nlp_jac_g": ca.Function("nlp_jac_g", [variables, parameters], [values, jacobian]),
        "nlp_hess_l": ca.Function("nlp_hess_l", [variables, parameters, whole, forces], [gradient, hessian]),
    }


def _chain(slope: ca.Sparsity, states: int, intervals: int) -> tuple[ca.Sparsity, list[int]]:
    """Where a stage's entries (states + m, k) stand in the whole Jacobian, and which of all stages' do.

    Its first rows are those of the stage before, which the first stage has not; of the last state there are only those.
    """
    rows, columns = (np.array(each) for each in slope.get_triplet())
    height, width = slope.size1() - states, slope.size2()
    n = np.arange(intervals)[:, None]
    down = np.where(rows < states, rows - height, rows - states) + n * height
    down = np.append(down, (intervals - 1) * height + np.arange(states))
    along = np.append(columns + n * width, intervals * width + np.arange(states))
    kept = np.flatnonzero(down >= 0)
    shape = intervals * height, intervals * width + states
    return ca.Sparsity.triplet(*shape, down[kept].tolist(), along[kept].tolist()), kept.tolist()


Solver = Literal["fatrop", "ipopt"]
LARGE_PROBLEM = 500
"""Intervals up to which assembled problems are kept a dozen at a time."""
# The cost is the duration in thousandths of the guess', which suits the solver's tolerances, and a trace for jerk.
DURATION_WEIGHT = 1000.0
# Iterations of a solver, and evaluations of the constraints, after which it is given up; 40 of either are usual.
ITERATIONS, EVALUATIONS = 200, 400
QUIET = {"print_time": False, "error_on_fail": False, "show_eval_warnings": False}
# Rounding of a given speed beyond a limit.
SPEED_ROUNDING = 1e-9
Signature = tuple[tuple[tuple[Term, ...], int], ...]
"""Of each block: its terms and its number of rows."""


def solve_by_casadi(problem: Problem, guess: Array, solver: Solver = "fatrop") -> RunSolution:
    """What planner.timing.solvers.third_order.third_order finds, by a solver of others.

    Lengths are counted in the run's, times in the guess' duration, and each variable in its largest guess: with all of
    them about one, 35 iterations suffice where the plain problem takes 400. It is stopped when the solver does not
    converge.
    """
    length, time = problem.s[-1] - problem.s[0], float(guess[3].sum())
    unit = np.array([length / time, length / time**2, length / time**3, time])
    start = guess / unit[:, None]
    # a motion of constant speed has no s̈ and s⃛; from rest to rest they are 4 and 32 at least
    largest = np.maximum(np.abs(start).max(1, keepdims=True), [[0.0], [1.0], [1.0], [0.0]])
    scale = np.repeat(largest, problem.intervals, 1)
    scale[3] = start[3]
    signature, coefficients, low, high = pose_rows(problem, length, time)
    step = np.diff(problem.s)[None] / length
    jerk = jerk_share(problem, unit[2]) * scale[2:3] * np.sqrt(start[3])
    data = np.concatenate([step, scale, jerk, coefficients])
    if not (np.isfinite(data).all() and (step > 0).all()):
        told = "the jerk-limited problem holds what is no number, or an interval of no length"
        return RunSolution.refused(MotionError(told))
    speeds = np.array(problem.speeds) / unit[0] / scale[0, 0]
    assembled = _assemble(problem.intervals, signature, solver)
    try:
        answer = _answer(*assembled, data, (low, high), start / scale, speeds, problem.free)
    except BaseException:
        _forget()
        raise
    if isinstance(answer, MotionError):
        _forget()
        return RunSolution.refused(answer)
    columns = answer * scale * unit[:, None]
    profile = close_profile(problem, columns)
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile, maker=solver, problem=problem)


def smooth_by_casadi(problem: Problem, jerks: Array, guess: Array) -> RunSolution:
    """The smoothest motion of the guess' duration by FATROP, with the time as one more state.

    jerks (N, 2, A, 3): as planner.timing.solvers.stage_problem.pose_smoothest takes them
    """
    length, time, count = problem.s[-1] - problem.s[0], float(guess[3].sum()), problem.intervals
    unit = np.array([length / time, length / time**2, length / time**3, time])
    start = guess / unit[:, None]
    scale = np.repeat(np.abs(start).max(1, keepdims=True), count, 1)
    scale[3] = start[3]
    signature, coefficients, low, high = pose_rows(problem, length, time)
    v, a, j, h = start
    rough = jerks * [1.0, 3 * length, length**2]
    now = rough[:, 0, :, 0] * j[:, None] + rough[:, 0, :, 1] * (v * a)[:, None] + rough[:, 0, :, 2] * (v**3)[:, None]
    rough = rough / np.sqrt((now**2 * h[:, None]).sum())
    data = np.concatenate(
        [np.diff(problem.s)[None] / length, scale, np.zeros((1, count)), coefficients, rough.reshape(count, -1).T]
    )
    solver, patience = _build_smoothest(count, signature, rough.shape[2])
    variables = np.insert(start / scale, 2, np.concatenate([[0.0], np.cumsum(h)[:-1]]), axis=0)
    least = np.tile([0.0, -np.inf, -np.inf, -np.inf, SHORTEST_STATED], (count, 1))
    most = np.full((count, 5), np.inf)
    least[0, :3] = most[0, :3] = 0.0
    last, equal = [0.0, 0.0, 1.0], np.zeros((4, count))
    with patience.asked():
        answer = solver(
            x0=np.concatenate([variables.T.ravel(), last]),
            p=data.T.ravel(),
            lbx=np.concatenate([least.ravel(), last]),
            ubx=np.concatenate([most.ravel(), last]),
            lbg=np.concatenate([equal, low]).T.ravel(),
            ubg=np.concatenate([equal, high]).T.ravel(),
        )
    found = np.asarray(answer["x"]).ravel()[:-3].reshape(count, 5).T
    if not solver.stats()["success"]:
        return RunSolution.refused(MotionError(f"FATROP stopped: {solver.stats()['return_status']}"))
    profile = close_profile(problem, np.delete(found, 2, axis=0) * scale * unit[:, None])
    if isinstance(profile, MotionError):
        return RunSolution.refused(profile)
    return RunSolution("solved", profile.slowed(time / profile.duration), maker="fatrop", problem=problem)


def _build_smoothest(intervals: int, signature: Signature, axes: int) -> tuple[ca.Function, EvaluationLimit]:
    stage = make_stage(signature)
    size, rows = stage.size1_in(1), stage.size1_out(2)
    x, data = ca.SX.sym("x", 5), ca.SX.sym("data", size + 6 * axes)
    ends, travelled, values = stage(ca.vertcat(x[:2], x[3:]), data[:size])
    v, a, j, h = ca.vertsplit(ca.vertcat(x[:2], x[3:]) * data[1:5])
    cost: ca.SX = ca.SX(0)
    for side, (speed, push) in enumerate(((v, a), (v + h * (a + h * j / 2), a + h * j))):
        own = ca.reshape(data[size + 3 * side * axes : size + 3 * (side + 1) * axes], 3, axes).T
        cost += h / 2 * ca.sumsqr(own @ ca.vertcat(j, speed * push, speed**3))
    interval = ca.Function(
        "interval", [x, data], [ca.vertcat(ends, x[2] + h), ca.vertcat(travelled, values), cost], {"cse": True}
    )
    options: dict[str, Any] = QUIET | {
        "structure_detection": "auto",
        "equality": np.tile(np.arange(4 + rows) < 4, intervals).tolist(),
        "cache": derivatives(interval, intervals),
        "fatrop": {"print_level": 0, "max_iter": 300, "tol": 1e-8, "mu_init": 1e-1, "alpha_min_frac": 0.0},
    }
    patience = EvaluationLimit(EVALUATIONS)
    return ca.nlpsol("smoothest", "fatrop", chain_stages(interval, intervals, patience), options), patience


def _kept_at_end(terms: Sequence[Term]) -> bool:
    """Rows with s⃛ are kept at both ends of an interval, as the jerk jumps; others at its start and in its middle."""
    return Term.SDDD in terms


def pose_rows(problem: Problem, length: float, time: float) -> tuple[Signature, Array, Array, Array]:
    """Signature, coefficients (k, N) in the order that `make_stage` reads them, and bounds low and high (rows, N)."""
    signature, coefficients, low, high = [], [], [], []
    for block in problem.blocks:
        terms = tuple(block.start)
        rows = next(iter(block.start.values())).shape[1]
        signature.append((terms, rows))
        middle = {term: (block.start[term] + block.end[term]) / 2 for term in terms}
        second, room_second = (block.end, block.room) if _kept_at_end(terms) else (middle, block.room)
        for side, share in ((block.start, _row_room(block)), (second, room_second)):
            coefficients += [side[term].T * (length ** POWERS[term][0] / time ** POWERS[term][1]) for term in terms]
            low.append((block.middle - 1)[:, None] * share)
            high.append((block.middle + 1)[:, None] * share)
    return tuple(signature), np.concatenate(coefficients), np.concatenate(low), np.concatenate(high)


def _row_room(block: Block) -> Array:
    """Room of the rows at an interval's start; rows that are kept there only speak for the interval before it too."""
    if _kept_at_end(tuple(block.start)):
        return block.room
    # at the very start speed and s̈ are given: nothing is to be chosen (and a given speed may be at its limit)
    return np.concatenate([[1 + SPEED_ROUNDING], np.minimum(block.room[1:], block.room[:-1])])


def make_stage(signature: Signature) -> ca.Function:
    """One interval: (ṡ, s̈, s⃛, h; Δs, scales, jerk's weight, coefficients) -> end state (2), error of Δs, all rows."""
    x, size = ca.SX.sym("x", 4), sum(2 * len(terms) * rows for terms, rows in signature)
    data = ca.SX.sym("data", 6 + size)
    step, scale = data[0], data[1:5]
    v, a, j, h = ca.vertsplit(x * scale)
    v_end, a_end = v + h * (a + h * j / 2), a + h * j
    values, at = [], 6
    for terms, rows in signature:
        for speed, acceleration in (
            (v, a),
            (v_end, a_end) if _kept_at_end(terms) else (v + h / 2 * (a + h * j / 4), a + h * j / 2),
        ):
            value: ca.SX = ca.SX.zeros(rows)
            for term in terms:
                value += data[at : at + rows] * _term(term, speed, acceleration, j)
                at += rows
            values.append(value)
    travelled = h * (v + h * (a / 2 + h * j / 6)) / step - 1
    return ca.Function(
        "stage", [x, data], [ca.vertcat(v_end, a_end) / scale[:2], travelled, ca.vertcat(*values)], {"cse": True}
    )


def _term(term: Term, v: ca.SX, a: ca.SX, j: ca.SX) -> ca.SX:
    square: ca.SX = v**2
    values = {Term.ONE: ca.SX(1), Term.SD: v, Term.SD2: square, Term.SD3: square * v, Term.SDD: a, Term.SDSDD: v * a}
    return values.get(term, j)


def _assemble(intervals: int, signature: Signature, solver: Solver) -> tuple[ca.Function, EvaluationLimit]:
    """The problem for N intervals, built once and kept: of large ones, which hold some 0.15 MB an interval, few."""
    return (_built if intervals <= LARGE_PROBLEM else _built_large)(intervals, signature, solver)


def _forget() -> None:
    """A failed solve can leave infinities in the solver, and all that follow would fail."""
    _built.cache_clear()
    _built_large.cache_clear()


def _build(intervals: int, signature: Signature, solver: Solver) -> tuple[ca.Function, EvaluationLimit]:
    """The problem for N intervals: variables in stages, coefficients as parameters."""
    stage = make_stage(signature)
    x, data = ca.SX.sym("x", 4), ca.SX.sym("data", stage.size1_in(1))
    ends, *others = stage(x, data)
    cost = DURATION_WEIGHT * (x[3] * data[4] + JERK_WEIGHT * (x[2] * data[5]) ** 2)
    interval = ca.Function("interval", [x, data], [ends, ca.vertcat(*others), cost], {"cse": True})
    equality = np.tile(np.arange(3 + stage.size1_out(2)) < 3, intervals)
    options: dict[str, Any] = dict(QUIET)
    if solver == "fatrop":
        options |= {
            "structure_detection": "auto",
            "equality": equality.tolist(),
            "cache": derivatives(interval, intervals),
            # no step too short: else its restoration begins, which knows no end (see EvaluationLimit)
            "fatrop": {"print_level": 0, "max_iter": ITERATIONS, "tol": 1e-7, "mu_init": 1e-2, "alpha_min_frac": 0.0},
        }
    else:
        options |= {"ipopt": {"print_level": 0, "sb": "yes", "max_iter": ITERATIONS, "tol": 1e-9}}
    patience = EvaluationLimit(EVALUATIONS)
    problem = chain_stages(interval, intervals, patience)
    return ca.nlpsol("third_order", solver, problem, options), patience


_built, _built_large = lru_cache(maxsize=12)(_build), lru_cache(maxsize=1)(_build)


def _answer(
    solver: ca.Function,
    patience: EvaluationLimit,
    data: Array,
    rows: tuple[Array, Array],
    guess: Array,
    speeds: Array,
    free: tuple[bool, bool],
) -> Array | MotionError:
    """Columns (4, N), scaled, or why there are none; rows: what they lie between, (rows, N) each.

    speeds (2,): ṡ at both ends
    free: the ends at which s̈ is not given
    """
    count = guess.shape[1]
    least = np.tile([0.0, -np.inf, -np.inf, SHORTEST], (count, 1))
    most = np.full((count, 4), np.inf)
    pushed = np.where(free, np.inf, 0.0)
    most[0, :2], most_last = (speeds[0], pushed[0]), [speeds[1], pushed[1]]
    least[0, :2], least_last = (speeds[0], -pushed[0]), [speeds[1], -pushed[1]]
    for end in np.flatnonzero(free):  # s̈ is constant beside it: else q⃛ may peak between grid points, as it is 0 on one
        least[-end, 2] = most[-end, 2] = 0.0
    equal = np.zeros((3, count))
    low, high = rows
    try:
        with patience.asked():
            answer = solver(
                x0=np.concatenate([guess.T.ravel(), [speeds[1], 0.0]]),
                p=data.T.ravel(),
                lbx=np.concatenate([least.ravel(), least_last]),
                ubx=np.concatenate([most.ravel(), most_last]),
                lbg=np.concatenate([equal, low]).T.ravel(),
                ubg=np.concatenate([equal, high]).T.ravel(),
            )
            stats = solver.stats()
    except RuntimeError as failure:  # CasADi's own, as when an evaluation overflows
        return MotionError(f"the jerk-limited solver failed: {failure}")
    columns = np.asarray(answer["x"]).ravel()[:-2].reshape(count, 4).T
    if not stats["success"] or not np.isfinite(columns).all():
        return MotionError(
            "the jerk-limited solver stopped without an answer "
            f"({stats['return_status']}, {stats['iter_count']} iterations)"
        )
    return columns
