"""Compiled kernels and tapes: CasADi's own values to the last bit, and what is said while they are compiled."""

import subprocess
import sys

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.foundation import kernels
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.tape import BLOCK, make_tape, run_tape

UNARY = {
    "sin": ca.sin,
    "cos": ca.cos,
    "sqrt": ca.sqrt,
    "exp": ca.exp,
    "log": ca.log,
    "fabs": ca.fabs,
    "sign": ca.sign,
    "square": lambda a: a**2,
    "negative": lambda a: -a,
    "inverse": lambda a: 1 / a,
    "twice": lambda a: 2 * a,
}
BINARY = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "atan2": ca.atan2,
}
STEPS = st.lists(
    st.tuples(st.sampled_from([*UNARY, *BINARY]), st.integers(0, 99), st.integers(0, 99)), min_size=1, max_size=30
)


def run(function, x):
    tape = make_tape(function)
    assert tape is not None
    out = np.empty((len(x), function.size1_out(0)))
    run_tape(tape, x, out)
    return out


@settings(max_examples=60, deadline=None)
@given(STEPS, st.integers(0, 2**32), st.sampled_from([1, BLOCK - 1, BLOCK, 2 * BLOCK + 5]))
def test_a_tape_gives_casadis_values(steps, seed, count):
    """Of random expressions, NaN and infinities among them, whatever the number of points."""
    x = ca.SX.sym("x", 3)
    values = [*ca.vertsplit(x), ca.SX(0.25)]
    for name, first, second in steps:
        a, b = values[first % len(values)], values[second % len(values)]
        values.append(UNARY[name](a) if name in UNARY else BINARY[name](a, b))
    function = ca.Function("f", [x], [ca.densify(ca.vertcat(*values[-5:]))], {"cse": True})
    points = np.random.default_rng(seed).normal(size=(count, 3))
    with np.errstate(all="ignore"):
        expected = np.array(function.map(count)(points.T)).T
        assert np.array_equal(run(function, points), expected, equal_nan=True)


def test_an_operation_that_no_tape_knows_is_left_to_casadi():
    x = ca.SX.sym("x", 1)
    assert make_tape(ca.Function("f", [x], [ca.erf(x)])) is None
    points = np.linspace(0, 1, 40_000)[:, None]
    values = Expression("f", x, ca.erf(x))(points)
    assert values[-1, 0] == pytest.approx(0.8427007929497149, rel=1e-12)


def test_large_batches_give_the_values_of_small_ones():
    """Whether the tape or CasADi runs them is decided by size alone."""
    x = ca.SX.sym("x", 2)
    both = Expression("f", x, ca.vertcat(ca.sin(x[0]) * x[1], ca.sqrt(x[0] ** 2 + x[1] ** 2)))
    points = np.random.default_rng(1).normal(size=(40_000, 2))
    run(both.function, points[:2])  # the compiler is loaded
    assert np.array_equal(both(points)[::997], np.concatenate([both(point[None]) for point in points[::997]]))


def test_a_first_call_that_takes_long_is_announced_once(monkeypatch, caplog):
    monkeypatch.setattr(kernels, "PATIENCE", 0.0)
    kernels._announce.cache_clear()

    @kernels.Kernel
    def double(x):
        return 2 * x

    monkeypatch.setattr(sys.modules[__name__], "double", double, raising=False)
    with caplog.at_level("WARNING", "pulsepath"):
        assert double(3) == 6
        assert double(4) == 8
    assert [record.message.split(":")[0] for record in caplog.records] == ["compiling numerical kernels"]


def test_what_does_not_plan_does_not_load_the_compiler():
    code = (
        "import sys, pulsepath.cli, kinematics, planner; kinematics.load_machine('hexapod');"
        "print('numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
