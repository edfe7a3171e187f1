"""Operations of expressions: what is rewritten has its own values and sound bounds; what is not
known is refused.
"""

import casadi as ca
import numpy as np
import pytest

import pulsepath as pp
from kinematics import MotionError
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.formula import formula
from kinematics.foundation.operations import ALLOWED, BASIC, refuse_unknown, rewrite
from kinematics.foundation.taylor_model import Series

A, B = ca.SX.sym("a"), ca.SX.sym("b")
CASES = {
    "tan": (ca.tan(A), np.tan),
    "asin": (ca.asin(A), np.arcsin),
    "acos": (ca.acos(A), np.arccos),
    "atan": (ca.atan(A), np.arctan),
    "sinh": (ca.sinh(A), np.sinh),
    "cosh": (ca.cosh(A), np.cosh),
    "tanh": (ca.tanh(A), np.tanh),
    "cube": (A**3, lambda a: a**3),
    "inverse square": (A**-2, lambda a: a**-2.0),
    "root of the cube": ((A + 2) ** 1.5, lambda a: (a + 2) ** 1.5),
}
PAIRS = {
    "hypot": (ca.hypot(A, B), np.hypot),
    "atan2": (ca.atan2(A, B), np.arctan2),
    "fmin": (ca.fmin(A, B), np.minimum),
    "fmax": (ca.fmax(A, B), np.maximum),
    "power": ((A + 2) ** B, lambda a, b: (a + 2) ** b),
}


@pytest.fixture
def values():
    given = np.random.default_rng(5).uniform(-0.9, 0.9, (200, 2))
    return given[np.abs(given).min(1) > 1e-2]


@pytest.mark.parametrize("name", [*CASES, *PAIRS])
def test_values_and_derivatives_are_those_of_other_libraries(name, values):
    expression, function = CASES.get(name) or PAIRS[name]
    columns = values.T if name in PAIRS else values[:, :1].T
    made = Expression(name.replace(" ", "_"), ca.vertcat(A, B), expression)
    np.testing.assert_allclose(made(values)[:, 0], function(*columns), rtol=1e-13, atol=1e-15)
    slope = Expression("slope", ca.vertcat(A, B), ca.jacobian(expression, A))
    own = ca.Function("own", [A, B], [ca.jacobian(expression, A)])
    np.testing.assert_allclose(
        slope(values)[:, 0], np.array(own(*values.T)).ravel(), rtol=1e-12, atol=1e-14
    )


@pytest.mark.parametrize("name", [*CASES, *PAIRS])
def test_enclosures_hold_every_value(name, values):
    """Of an interval around each of the values: numpy's values lie within."""
    expression, function = CASES.get(name) or PAIRS[name]
    made, half = Expression("made", ca.vertcat(A, B), expression), 5e-3
    (found,) = made.enclose(
        [Series(column[None], np.full((1, len(column)), half), 0) for column in values.T]
    )
    assert (
        np.isfinite(found.rad[0]).mean() > 0.8
    )  # unbounded only where the smaller of two is not told apart
    for share in np.linspace(-1, 1, 9):
        moved = values + half * share
        told = function(*(moved.T if name in PAIRS else moved[:, :1].T))
        beyond = np.abs(told - found.mid[0]) > found.rad[0] + 1e-14 * (
            1 + np.abs(told)
        )  # nan: no bound
        assert not beyond.any()


def test_basic_functions_stay_as_they_are():
    function = ca.Function("f", [ca.vertcat(A, B)], [ca.sin(A) * ca.sqrt(B)])
    assert rewrite(function) is function


@pytest.mark.parametrize(
    "expression",
    [
        ca.floor(A),
        ca.if_else(A > B, A, B),
        ca.fmod(A, B),
        ca.erf(A),
        ca.copysign(A, B),
        ca.asinh(A),
    ],
)
def test_what_has_no_bounds_is_refused_with_what_there_is(expression):
    made = Expression("own", ca.vertcat(A, B), expression)
    assert np.isfinite(made(np.array([[0.4, 0.3]]))).all()  # values need no bounds
    for ask in (
        lambda: refuse_unknown(made.function),
        lambda: made.enclose([Series.constant(np.ones(1), 2)] * 2),
    ):
        with pytest.raises(MotionError) as no:
            ask()
        assert ALLOWED in str(no.value)


def test_formulas_have_the_same_functions():
    a, b = 0.3, -0.7
    for text, wanted in {
        "hypot(a, b)": np.hypot(a, b),
        "hypot(a, b, 2)": np.sqrt(a * a + b * b + 4),
        "atan(a)": np.arctan(a),
        "sinh(a) + cosh(b) + tanh(a)": np.sinh(a) + np.cosh(b) + np.tanh(a),
        "min(a, b, 0) + max(a, b)": b + a,
    }.items():
        assert float(formula(text, {"a": a, "b": b})) == pytest.approx(wanted, rel=1e-14)
    with pytest.raises(MotionError, match="hypot takes 2 arguments, not 1"):
        formula("hypot(a)", {"a": a})


class Polar(pp.Machine):
    """r and φ of a point in the plane, and its height."""

    freedom = ("x", "y", "z")
    sorts = ("linear", "rotary", "linear")
    characteristic_length = 0.1

    def __init__(self, height=lambda z: z):
        self.height = height
        axes = [
            pp.Axis(name, kind, max_speed=0.5, max_acceleration=5.0)
            for name, kind in zip(("r", "phi", "z"), self.sorts, strict=True)
        ]
        super().__init__("polar", axes, [0.1, 0, 0])

    def expression(self, position, rotation, near):
        r = ca.hypot(position[0], position[1])
        return ca.vertcat(
            r, ca.sign(position[1] + 1e-300) * ca.acos(position[0] / r), self.height(position[2])
        )


def test_a_machine_in_python_has_them_too():
    """Its plan is proved: the certificate's enclosures know hypot and acos."""
    machine = Polar()
    plan = pp.plan(pp.Program([pp.Line([0.02, 0.05, 0.01])], start=[0, 0.01, 0]), machine)
    assert plan.certificate.holds
    state = plan.trajectory.at(np.linspace(0, plan.trajectory.duration, 50))
    x, y, z = state.pose.translation.T
    np.testing.assert_allclose(
        state.q, np.stack([np.hypot(x, y), np.arctan2(y, x), z], 1), atol=1e-12
    )


def test_a_machine_of_unknown_operations_is_refused_when_it_is_made():
    with pytest.raises(
        MotionError, match=r"machine polar: inverse: floor is no operation .* there are \+ - \* /"
    ):
        Polar(lambda z: ca.floor(z * 100) / 100)
    with pytest.raises(MotionError, match="machine polar: inverse: if_else_zero is no operation"):
        Polar(lambda z: ca.if_else(z > 0, z, 0))


def test_every_operation_of_casadi_is_known_or_named():
    """None slips through: what is not basic becomes basic."""
    for name, (expression, _) in (CASES | PAIRS).items():
        made = Expression(name.replace(" ", "_"), ca.vertcat(A, B), expression).function
        assert {made.instruction_id(k) for k in range(made.n_instructions())} <= BASIC
