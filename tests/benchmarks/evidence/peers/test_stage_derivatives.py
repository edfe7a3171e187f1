"""Derivatives written out for stages in a row against CasADi's own of the whole."""

import casadi as ca
import numpy as np
import pytest

from benchmarks.evidence.peers.casadi_ import derivatives


def toy() -> ca.Function:
    """Three variables, of which two are the state; two data; one further constraint."""
    x, data = ca.SX.sym("x", 3), ca.SX.sym("data", 2)
    reached = ca.vertcat(x[0] * x[2] + data[0], x[1] + ca.sin(x[2]) * x[0] ** 2)
    cost = data[0] * x[2] + x[1] ** 2 * x[0]
    return ca.Function("stage", [x, data], [reached, data[1] * x[1] * x[2] ** 2, cost])


@pytest.mark.parametrize("intervals", [1, 2, 7])
def test_they_are_those_of_the_whole_problem(intervals: int) -> None:
    stage = toy()
    x, p = ca.MX.sym("x", 3 * intervals + 2), ca.MX.sym("p", 2 * intervals)
    rows, cost = [], ca.MX(0)
    for n in range(intervals):
        reached, other, price = stage(x[3 * n : 3 * n + 3], p[2 * n : 2 * n + 2])
        rows += [x[3 * n + 3 : 3 * n + 5] - reached, other]
        cost += price
    values, whole, forces = ca.vertcat(*rows), ca.MX.sym("f"), ca.MX.sym("g", 3 * intervals)
    bend, push = ca.hessian(whole * cost + ca.dot(forces, values), x)
    given = [np.random.default_rng(1).normal(size=size) for size in (x.numel(), p.numel(), 1, forces.numel())]
    ours = derivatives(stage, intervals)
    found = [*ours["nlp_jac_g"](*given[:2]), *ours["nlp_hess_l"](*given)]
    wanted = ca.Function("whole", [x, p, whole, forces], [values, ca.jacobian(values, x), push, bend])(*given)
    for mine, theirs in zip(found, wanted, strict=True):
        assert mine.sparsity() == theirs.sparsity()  # the solver reads its structure from it
        np.testing.assert_allclose(mine.full(), theirs.full(), rtol=1e-13, atol=1e-13)
