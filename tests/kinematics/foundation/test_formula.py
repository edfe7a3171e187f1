"""Formulas of files: what they are worth, and that nothing else than formulas gets anywhere."""

import ast
import cmath
import contextlib
import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from kinematics import MotionError
from kinematics.foundation.formula import MAX_CHARACTERS, MAX_DEPTH, check_names, constant, formula
from tests.pace import cpu_limit

T = ca.SX.sym("t")


def at(text, t, constants=()):
    return float(ca.Function("f", [T], [formula(text, dict(constants), T)])(t))


@pytest.mark.parametrize(("text", "value"), [
    ("15*cos(t) + r/2", 15 * math.cos(0.3) + 2),
    ("-t**2", -0.09),
    ("2**-1", 0.5),
    ("2**3**2", 512),
    ("(-8)**3", -512),
    ("t**-2", 1 / 0.09),
    ("t**0.5", math.sqrt(0.3)),
    ("2**t", 2**0.3),
    ("(-t)**3", -0.027),
    ("tan(t)", math.tan(0.3)),
    ("asin(t) + acos(t)", math.pi / 2),
    ("atan2(-t, -1)", math.atan2(-0.3, -1)),
    ("sqrt(t) * exp(t) * log(t)", math.sqrt(0.3) * math.exp(0.3) * math.log(0.3)),
    ("abs(-t) + abs(t)", 0.6),
    ("min(t, 0.2, 5)", 0.2),
    ("max(t, 0.2, 5)", 5),
    ("+t - -t", 0.6),
    (" ( t ) ", 0.3),
    ("1_000.5e-3", 1.0005),
])  # fmt: skip
def test_worth(text, value):
    assert at(text, 0.3, [("r", 4.0)]) == pytest.approx(value, rel=1e-14)


leaves = st.one_of(
    st.floats(-9, 9).map(lambda x: f"{x:.3f}"),
    st.sampled_from(["t", "pi", "r"]),
    st.integers(0, 99).map(str),
)
formulas = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", " ** "]), inner).map(
            lambda x: f"({x[0]}{x[1]}{x[2]})"
        ),
        st.tuples(
            st.sampled_from(
                ["-", "+", "sin", "cos", "tan", "exp", "abs", "log", "sqrt", "asin", "acos"]
            ),
            inner,
        ).map(lambda x: f"{x[0]}({x[1]})"),
        st.tuples(st.sampled_from(["atan2", "min", "max"]), inner, inner).map(
            lambda x: f"{x[0]}({x[1]}, {x[2]})"
        ),
    ),
    max_leaves=8,
)


def worth(node, names):
    """Python's own arithmetic, in complex numbers: nan where the real ones have no answer."""
    match node:
        case ast.Constant():
            return complex(node.value)
        case ast.Name():
            return complex(names[node.id])
        case ast.UnaryOp():
            value = worth(node.operand, names)
            return -value if isinstance(node.op, ast.USub) else value
        case ast.BinOp():
            a, b = worth(node.left, names), worth(node.right, names)
            return {ast.Add: a.__add__, ast.Sub: a.__sub__, ast.Mult: a.__mul__, ast.Div: a.__truediv__,
                    ast.Pow: a.__pow__}[type(node.op)](b)  # fmt: skip
    name, values = node.func.id, [worth(argument, names) for argument in node.args]
    if any(abs(value.imag) > 0 for value in values):
        return complex("nan")
    if name == "atan2" and values[0] == 0:
        return complex("nan")  # the side of a zero is lost on the way
    if name in ("sin", "cos", "tan") and abs(values[0]) > 1e6:
        return complex("nan")  # the rounding of so large an angle is more than is looked at
    if name in ("atan2", "min", "max", "abs"):
        return complex(
            {"atan2": math.atan2, "min": min, "max": max, "abs": abs}[name](
                *(v.real for v in values)
            )
        )
    return getattr(cmath, name)(*values)


@settings(max_examples=150)
@given(formulas, st.floats(-3, 3))
def test_random_formulas_are_worth_what_python_says(text, t):
    names = {"t": t, "pi": math.pi, "r": 2.5}
    try:
        exact = worth(ast.parse(text, mode="eval").body, names)
    except (ArithmeticError, ValueError):
        exact = complex("nan")
    try:
        found = at(text, t, [("r", 2.5)])
    except MotionError:
        return  # of exponents that vary, or constants without a value
    assume(cmath.isfinite(exact) and abs(exact) < 1e12 and abs(exact.imag) == 0)
    if math.isfinite(found):  # asin(1) has a value and no derivative, (-1)**2.0 goes by products
        assert found == pytest.approx(exact.real, rel=1e-6, abs=1e-6)


# fmt: off
HOSTILE = [
    "__import__('os').system('true')", "().__class__.__bases__[0]", "t.__class__", "t[0]", "[t]", "{t}", "{t: t}",
    "lambda: t", "(lambda: t)()", "t if t else 1", "t and t", "not t", "t < 1", "t == t", "t | 1", "t ^ 2", "~t",
    "t << 9", "t // 2", "t % 2", "t @ t", "(t := 3)", "t := 3", "t = 3", "*t", "sin(*t)", "sin(t, t)", "sin()",
    "sin(x=t)", "sin(**t)", "atan2(t)", "max(t)", "min()", "eval(t)", "exec(t)", "open(t)", "print(t)", "exit()",
    "getattr(t, t)", "sinn(t)", "sin", "pi()", "t(t)", "sin(sin)", "T", "Pi", "e", "inf", "nan", "True", "None",
    "...",
    "1j", "'t'", '"t"', "f'{t}'", "b't'", "1e999", "9" * 400, "9**9**9**9", "9**9**9", "(-1)**0.5", "1/0", "0**-1",
    "log(0)", "log(-1)", "sqrt(-1)", "asin(2)", "acos(-2)", "t**t", "t**65", "t**-65", "t**1e300", "(-2)**t", "0**t",
    "t; t", "t\nt", "t\x00", "# t", "t # t", "t\\", "import os", "", " ", "()", "(", ")", "t)", "((t)", "t t",
    "1.2.3", "1..",
    "--" * 100 + "t", "(" * 240 + "t" + ")" * 240, "sin(" * 100 + "t" + ")" * 100, "t+" * 249 + "t",
    "t" * (MAX_CHARACTERS + 1),
    "-" * 499 + "t", "not " * 120 + "t", "await t", "yield t", "ｓin(t)", "t\u200b", "²", "t·t", "print", "assert t",
    "1if t else 2", "0777", "1__0", "_", "__", "_t", "t.real", "1 .real", "1.real", "t.", ".",
]
# fmt: on


@pytest.mark.parametrize("text", HOSTILE)
def test_nothing_else_is_a_formula(text):
    """Refused, at once, and without a warning of the parser; but for sums and parentheses, which
    are harmless.
    """
    with cpu_limit(0.2):
        if text.startswith(("t+t+", "((((")):
            with contextlib.suppress(MotionError):
                assert math.isfinite(at(text, 1.0))
        else:
            with pytest.raises(MotionError) as refused:
                formula(text, {}, T)
            assert len(str(refused.value)) < 400
            assert str(refused.value).isprintable()


@settings(max_examples=300)
@given(st.text(max_size=60) | st.text("t1.()+-*/, sincoabexplgqrt_[]'", max_size=80))
def test_any_text_is_a_formula_or_refused(text):
    with contextlib.suppress(MotionError):
        assert formula(text, {}, T).shape == (1, 1)


def test_nesting_ends_before_the_stack_does():
    deep = "sin(" * (MAX_DEPTH - 1) + "t" + ")" * (MAX_DEPTH - 1)
    assert math.isfinite(at(deep, 1.0))
    with pytest.raises(MotionError, match="deep"):
        formula("sin(" * (MAX_DEPTH + 1) + "t" + ")" * (MAX_DEPTH + 1), {}, T)


def test_a_long_sum_is_not_nested():
    """240 terms, and products as long; what is in parentheses is."""
    assert at("+".join(["t"] * 240), 0.5) == 120
    assert at("-".join(["1", *["t"] * 200]), 0.5) == -99
    assert at("*".join(["t"] * 240), 1.0) == 1
    assert at("8/2/2*t-3-2", 2.0) == -1
    with pytest.raises(MotionError, match="deep"):
        formula("(1+" * (MAX_DEPTH + 1) + "t" + ")" * (MAX_DEPTH + 1), {}, T)


def test_constants_have_names_of_their_own():
    assert constant("2*pi*n", {"n": 3.0}) == 6 * math.pi
    with pytest.raises(MotionError, match="t is not defined here"):
        constant("2*t", {})
    with pytest.raises(MotionError, match='radus is not defined, nearest is "radius"'):
        formula("radus*t", {"radius": 1.0}, T)
    for name in ("t", "pi", "sin", "a b", "1a", "", "_x", "é", "a.b", "x" * 100):
        with pytest.raises(MotionError, match="constant"):
            check_names({name: 1.0})
    with pytest.raises(MotionError, match="finite"):
        check_names({"a": math.inf})


def test_derivatives_are_exact():
    """Three of them, against the answers of calculus."""
    t = np.array(0.7)
    found = formula("log(1 + t) + t**3 + exp(2*t)", {}, T)
    truths = [1 / 1.7 + 3 * 0.49 + 2 * math.exp(1.4), -1 / 1.7**2 + 6 * 0.7 + 4 * math.exp(1.4),
              2 / 1.7**3 + 6 + 8 * math.exp(1.4)]  # fmt: skip
    for truth in truths:
        found = ca.jacobian(found, T)
        assert float(ca.Function("f", [T], [found])(t)) == pytest.approx(truth, rel=1e-14)
