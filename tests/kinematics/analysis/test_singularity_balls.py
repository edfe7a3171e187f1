"""Compiled balls: what they enclose contains the exact value, and what may have no bound has
none.
"""

from fractions import Fraction
from math import atan2, cos, isfinite, isqrt, sin

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.analysis.singularity import EPS, Ball
from kinematics.foundation.casadi_function import Expression

OPERATIONS = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a, b: -a,
    "sqrt": lambda a, b: ca.sqrt(a),
    "sin": lambda a, b: ca.sin(a),
    "cos": lambda a, b: ca.cos(a),
    "sign": lambda a, b: ca.sign(a),
    "atan2": ca.atan2,
}


def compiled(name):
    """(mid a, rad a, mid b, rad b) -> (mid, rad) of the operation, by walking its expression."""
    a, b = ca.SX.sym("a"), ca.SX.sym("b")
    numbers = ca.SX.sym("numbers", 4)
    (out,) = Expression(name, ca.vertcat(a, b), OPERATIONS[name](a, b)).walk(
        [Ball(numbers[0], numbers[1]), Ball(numbers[2], numbers[3])], Ball.constant
    )
    return Expression("ball", numbers, ca.vertcat(out.mid, out.rad))


COMPILED = {name: compiled(name) for name in OPERATIONS}
values = st.one_of(
    *(st.floats(low, high) for low, high in ((-1e6, -1e-6), (1e-6, 1e6), (-4, -0.25), (0.25, 4)))
)
radii = st.one_of(st.just(0.0), st.floats(1e-12, 1e3), st.floats(1e-3, 0.5))
shares = st.sampled_from([Fraction(n, 4) for n in range(-4, 5)])


def root(x):
    """√x to 200 binary digits."""
    return Fraction(isqrt(x.numerator * x.denominator << 400), x.denominator << 200)


EXACT = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b if b else None,
    "neg": lambda a, b: -a,
    "sqrt": lambda a, b: root(a) if a > 0 else None,
    # libm's: their error of a unit in the last place is added to the ball
    "sin": lambda a, b: Fraction(sin(a)),
    "cos": lambda a, b: Fraction(cos(a)),
    "sign": lambda a, b: Fraction((a > 0) - (a < 0)),
    "atan2": lambda a, b: Fraction(atan2(a, b)) if a or b else None,
}


@pytest.mark.parametrize("name", OPERATIONS)
@given(mid=st.tuples(values, values), rad=st.tuples(radii, radii), share=st.tuples(shares, shares))
def test_the_exact_value_lies_in_the_ball(name, mid, rad, share):
    a, b = (Fraction(m) + t * Fraction(r) for m, r, t in zip(mid, rad, share, strict=True))
    ((middle, radius),) = COMPILED[name](np.array([[mid[0], rad[0], mid[1], rad[1]]]))
    if not isfinite(radius):
        return
    exact = EXACT[name](a, b)
    assert exact is not None
    slack = Fraction(4 * EPS) * abs(exact) if name in ("sin", "cos", "atan2") else 0
    if name in ("sin", "cos"):
        slack += Fraction(EPS) * abs(a)  # the exact point is rounded before libm has it
    assert abs(exact - Fraction(middle)) <= Fraction(radius) + slack


@pytest.mark.parametrize(
    ("name", "ball"),
    [
        ("div", (1.0, 0.0, 0.1, 0.1)),
        ("div", (1.0, 0.0, 0.0, 0.0)),
        ("sqrt", (0.1, 0.2, 0.0, 0.0)),
        ("sqrt", (-1.0, 0.2, 0.0, 0.0)),
        ("sign", (0.1, 0.1, 0.0, 0.0)),
        ("atan2", (0.0, 0.1, -1.0, 0.1)),
        ("atan2", (0.1, 0.2, 0.1, 0.2)),
        *(
            (name, (1.0, np.inf, 1.0, np.inf))
            for name in ("add", "sub", "mul", "div", "neg", "sqrt", "sign", "atan2")
        ),
        *(
            (name, (0.0, np.nan, 1.0, np.nan))
            for name in ("add", "sub", "mul", "div", "neg", "sqrt", "sign", "atan2")
        ),
    ],
)
def test_what_has_no_bound_gets_none(name, ball):
    assert not np.isfinite(COMPILED[name](np.array([ball]))).all()


@pytest.mark.parametrize("name", [name for name in OPERATIONS if name != "sign"])
def test_small_balls_stay_small(name):
    """At most a few times wider than the slope asks for: 1e-9 about 1.5 and 2."""
    ((_, radius),) = COMPILED[name](np.array([[1.5, 1e-9, 2.0, 1e-9]]))
    assert 0 < radius < 5e-9
