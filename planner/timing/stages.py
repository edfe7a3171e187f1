"""A problem made of equal stages in a row, and its derivatives, written out: a third of the time that AD takes.

CasADi differentiates a mapped function column by column and walks through every stage for each; written out once, the
entries of a stage's Jacobian and Hessian share what they have in common.

A stage is a function (x (k,), data) -> the state that it leads to, other constraints, its part of the cost; the state
that it starts from comes first in x. The variables of the whole are those of all stages, and then the last state; the
parameters are their data; the constraints are, stage by stage, the next state less the one led to, and the others.
"""

import casadi as ca
import numpy as np

from planner.timing.patience import Patience


def chained(stage: ca.Function, intervals: int, patience: Patience) -> dict[str, ca.MX]:
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
