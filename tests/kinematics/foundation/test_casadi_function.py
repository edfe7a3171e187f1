"""Compiled expressions: batches of every size, and enclosures of their values over cells."""

import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import Series
from kinematics.machine.pose import to_numbers

LARGEST = 600


def sparse():
    """Three inputs, five outputs: of the inputs, a structural zero, a constant."""
    x = ca.SX.sym("x", 3)
    out = ca.SX(5, 1)
    out[0] = ca.sqrt(1 + x[0] ** 2) / (3 - ca.cos(x[1]))
    out[2] = 2.5
    out[3] = x[0] * ca.sin(x[2]) - x[1]
    out[4] = x[2]
    assert out.nnz() == 4
    return Expression("sparse", x, out)


def sparse_by_hand(x):
    a, b, c = x.T
    columns = np.sqrt(1 + a**2) / (3 - np.cos(b)), 0 * a, 2.5 + 0 * a, a * np.sin(c) - b, c
    return np.stack(columns, 1)


def points(count, inputs, seed=0):
    return np.random.default_rng(seed).uniform(-2, 2, (count, inputs))


def test_batches_of_every_size_equal_one_row_at_a_time():
    """Blocks of 256, 16 and 1 meet in every combination; the same compiled code on every row: equal
    to the last bit.
    """
    expression, x = sparse(), points(LARGEST, 3)
    one_by_one = np.concatenate([expression(row[None]) for row in x])
    # a handful of roundings of values below 5
    assert one_by_one == pytest.approx(sparse_by_hand(x), rel=0, abs=4e-15)
    fresh = sparse()
    for size in range(LARGEST + 1):
        start = LARGEST - size
        assert np.array_equal(fresh(x[start:]), one_by_one[start:])


@pytest.mark.parametrize("size", [1, 16, 17, 256, 273, 529])
def test_maps_of_machines_in_batches_equal_one_pose_at_a_time(machine, poses_about, size):
    poses = to_numbers(poses_about(machine.home, machine, size, 0.3))
    x = machine.inputs(poses, machine.home_q)
    for expression, rows in (
        (machine.inverse_map, x),
        (machine.jacobian_map, x),
        (machine.tilt_map, poses),
    ):
        assert np.array_equal(
            expression(rows), np.concatenate([expression(row[None]) for row in rows])
        )


def test_results_are_not_overwritten_by_the_next_call():
    expression, x = sparse(), points(256, 3)
    first = expression(x)
    kept = first.copy()
    expression(-x)
    assert np.array_equal(first, kept)


def test_inputs_need_not_lie_together_in_memory():
    expression, x = sparse(), points(40, 3)
    expected = expression(x)
    assert np.array_equal(expression(np.asfortranarray(x)), expected)
    assert np.array_equal(expression(np.repeat(x, 2, 0)[::2]), expected)
    assert np.array_equal(expression(x[::-1]), expected[::-1])


def test_threads_do_not_meet_in_the_memory_of_a_block():
    expression = sparse()
    inputs = [points(300, 3, seed) for seed in range(4)]
    expected = [expression(x) for x in inputs]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)  # so that they would
    try:
        with ThreadPoolExecutor(4) as pool:
            jobs = [(k % 4, pool.submit(expression, inputs[k % 4])) for k in range(400)]
            assert all(np.array_equal(job.result(), expected[k]) for k, job in jobs)
    finally:
        sys.setswitchinterval(interval)


def cells(centre, half, order):
    """x = centre + half·τ: about the centres, and with centres anywhere in the cells (N, k)."""
    columns = zip(centre.T, half.T, strict=True)
    about, anywhere = [], []
    for c, h in columns:
        mid, none = np.stack([c, h]), np.zeros((2, len(c)))
        about.append(Series(mid, none, order))
        anywhere.append(Series(mid, np.stack([np.abs(h), none[0]]), order))
    return about, anywhere


def assert_encloses(expression, centre, half, order=3):
    """Values inside the cells lie in the Taylor polynomial about the centre with Lagrange's
    remainder over the cell.

    How much wider the enclosure is than it need be is the enclosure of the remainder: returned for
    the caller to judge.
    """
    about, anywhere = (
        Series.stack(expression.enclose(x)).pad(order) for x in cells(centre, half, order)
    )
    whole = anywhere.mid[0], anywhere.rad[0]
    remainder = np.abs(anywhere.mid[order]) + anywhere.rad[order]
    for tau in np.linspace(-1, 1, 9):
        values = expression(centre + half * tau)
        rounding = 1e-14 * (
            1 + np.abs(values)
        )  # of the compared values themselves: some dozen operations
        powers = tau ** np.arange(order)[:, None, None]
        polynomial = (powers * about.mid[:order]).sum(0)
        error = (np.abs(powers) * about.rad[:order]).sum(0) + remainder * abs(tau) ** order
        assert (np.abs(values - polynomial) <= error + rounding).all()
        assert (np.abs(values - whole[0]) <= whole[1] + rounding).all()
    return remainder


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_enclosures_contain_the_values_inside_the_cells(order):
    """The error of a cell shrinks with the width to the power of the order, as a Taylor
    polynomial's does.
    """
    centre, half = points(300, 3, 1), points(300, 3, 2)
    widths = (0.1, 0.01, 0.001)
    errors = [assert_encloses(sparse(), centre, width * half, order).max() for width in widths]
    for wide, narrow in pairwise(errors):
        assert narrow < wide / 10 ** (order - 0.2)
    # structural zeros, constants and straight lines have no remainder at all
    assert not assert_encloses(sparse(), centre, widths[0] * half)[:, [1, 2, 4]].any()


def test_enclosures_of_machines_contain_the_values_inside_the_cells(machine, poses_about):
    """The twelve numbers of a pose vary freely here: no rotation is needed for the maps to be
    functions.
    """
    random = np.random.default_rng(3)
    centre = to_numbers(poses_about(machine.home, machine, 40, 0.3))
    size = np.array([machine.characteristic_length] * 3 + [1.0] * 9)
    half = 0.02 * size * random.uniform(-1, 1, (40, 12))
    branch, same = (
        machine.inputs(centre, machine.home_q),
        machine.inputs(half, np.zeros(len(machine.axes))),
    )
    for expression in (machine.inverse_map, machine.jacobian_map):
        assert np.isfinite(assert_encloses(expression, branch, same)).all()
    if machine.tilt_names:
        assert np.isfinite(assert_encloses(machine.tilt_map, centre, half)).all()


RULES = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_NEG: lambda a, b: -a,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_INV: lambda a, b: 1 / a,
    ca.OP_TWICE: lambda a, b: a + a,
    ca.OP_SQ: lambda a, b: a * a,
    ca.OP_SQRT: lambda a, b: ca.sqrt(a),
    ca.OP_SIN: lambda a, b: ca.sin(a),
    ca.OP_COS: lambda a, b: ca.cos(a),
}


@pytest.mark.parametrize("operation", RULES)
def test_every_operation_has_its_own_enclosure(operation):
    x = ca.SX.sym("x", 2)
    expression = Expression("single", x, RULES[operation](x[0], x[1]))
    function = expression.function
    assert operation in {function.instruction_id(k) for k in range(function.n_instructions())}
    random = np.random.default_rng(operation)
    centre, half = random.uniform(1, 3, (50, 2)), random.uniform(-0.3, 0.3, (50, 2))
    assert np.isfinite(assert_encloses(expression, centre, half)).all()
