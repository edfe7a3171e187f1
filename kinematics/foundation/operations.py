"""Which operations an expression may have: those with guaranteed bounds, and those that are made of
these.

tan, asin, acos, atan, hypot, hyperbolic functions, powers, min and max are rewritten when an
expression is made: so arrays, derivatives and enclosures all see the same few operations. What is
neither has values, and no bounds.
"""

from collections.abc import Callable

import casadi as ca

from kinematics.foundation.errors import MotionError

BASIC = {
    *(
        ca.OP_CONST,
        ca.OP_INPUT,
        ca.OP_OUTPUT,
        ca.OP_ASSIGN,
        ca.OP_ADD,
        ca.OP_SUB,
        ca.OP_NEG,
        ca.OP_MUL,
        ca.OP_DIV,
    ),
    *(ca.OP_INV, ca.OP_TWICE, ca.OP_SQ, ca.OP_SQRT, ca.OP_SIN, ca.OP_COS, ca.OP_EXP, ca.OP_LOG),
    *(ca.OP_FABS, ca.OP_SIGN, ca.OP_ATAN2),
}
"""CasADi's numbers of what arrays and enclosures compute as it stands."""


def absolute(a: ca.SX) -> ca.SX:
    return a * ca.sign(a)


def step(a: ca.SX) -> ca.SX:
    """1 where a > 0, 0 where a < 0."""
    half: ca.SX = (1 + ca.sign(a)) / 2
    return half


def tangent(a: ca.SX) -> ca.SX:
    ratio: ca.SX = ca.sin(a) / ca.cos(a)
    return ratio


def arc_sine(a: ca.SX) -> ca.SX:
    return ca.atan2(a, ca.sqrt(1 - a * a))


def arc_cosine(a: ca.SX) -> ca.SX:
    return ca.atan2(ca.sqrt(1 - a * a), a)


def arc_tangent(a: ca.SX) -> ca.SX:
    return ca.atan2(a, ca.SX(1))


def hypotenuse(*sides: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(ca.vertcat(*sides)))


def hyperbolic_sine(a: ca.SX) -> ca.SX:
    half: ca.SX = (ca.exp(a) - ca.exp(-a)) / 2
    return half


def hyperbolic_cosine(a: ca.SX) -> ca.SX:
    half: ca.SX = (ca.exp(a) + ca.exp(-a)) / 2
    return half


def hyperbolic_tangent(a: ca.SX) -> ca.SX:
    value: ca.SX = 1 - 2 / (1 + ca.exp(2 * a))
    return value


def least(a: ca.SX, b: ca.SX) -> ca.SX:
    return (a + b - absolute(a - b)) / 2


def largest(a: ca.SX, b: ca.SX) -> ca.SX:
    return (a + b + absolute(a - b)) / 2


def power(base: ca.SX, exponent: ca.SX) -> ca.SX:
    """aᵇ: a product for a whole constant b, else as exp(b log a)."""
    if exponent.is_constant() and float(exponent) == int(float(exponent)):
        count = int(float(exponent))
        whole = _product(base, abs(count))
        return whole if count >= 0 else 1 / whole
    return ca.exp(exponent * ca.log(base))


def _product(base: ca.SX, count: int) -> ca.SX:
    if count == 0:
        return ca.SX(1)
    half = _product(base, count // 2)
    return half * half * base if count % 2 else half * half


REWRITTEN: dict[int, Callable[..., ca.SX]] = {
    ca.OP_TAN: tangent,
    ca.OP_ASIN: arc_sine,
    ca.OP_ACOS: arc_cosine,
    ca.OP_ATAN: arc_tangent,
    ca.OP_HYPOT: hypotenuse,
    ca.OP_SINH: hyperbolic_sine,
    ca.OP_COSH: hyperbolic_cosine,
    ca.OP_TANH: hyperbolic_tangent,
    ca.OP_POW: power,
    ca.OP_CONSTPOW: power,
    ca.OP_FMIN: least,
    ca.OP_FMAX: largest,
    ca.OP_LT: lambda a, b: step(b - a),  # in derivatives of min and max
    ca.OP_LE: lambda a, b: step(b - a),
}
ALLOWED = "+ - * / **, sqrt exp log sin cos tan asin acos atan atan2 hypot sinh cosh tanh fabs sign fmin fmax"
"""What a message says that there is."""
_NAMES = {value: name[3:].lower() for name, value in vars(ca).items() if name.startswith("OP_")}


def refuse_unknown(function: ca.Function) -> None:
    """Raise MotionError, with what is allowed, for an operation that is neither basic nor made of
    basic ones.
    """
    codes = {function.instruction_id(k) for k in range(function.n_instructions())}
    for strange in sorted(codes - BASIC - REWRITTEN.keys()):
        raise MotionError(
            f"{function.name()}: {_NAMES.get(strange, strange)} is no operation that has derivatives and guaranteed "
            f"bounds here; there are {ALLOWED}"
        )


def rewrite(function: ca.Function) -> ca.Function:
    """The same function of basic operations alone; itself where it has no others, or some that are
    unknown.
    """
    codes = [function.instruction_id(k) for k in range(function.n_instructions())]
    others = set(codes) - BASIC
    if not others or others - REWRITTEN.keys():
        return function
    x = ca.SX.sym("x", function.size1_in(0))
    work: dict[int, ca.SX] = {}
    out = [ca.SX(0)] * function.size1_out(0)
    for k, code in enumerate(codes):
        read, write = function.instruction_input(k), function.instruction_output(k)
        if code == ca.OP_INPUT:
            work[write[0]] = x[read[1]]
        elif code == ca.OP_OUTPUT:
            out[write[1]] = work[read[0]]
        elif code == ca.OP_CONST:
            work[write[0]] = ca.SX(function.instruction_constant(k))
        elif code in REWRITTEN:
            work[write[0]] = REWRITTEN[code](*(work[slot] for slot in read))
        else:
            arguments = [work[slot] for slot in read]
            work[write[0]] = (
                ca.SX.unary(code, *arguments)
                if len(arguments) == 1
                else ca.SX.binary(code, *arguments)
            )
    return ca.Function(function.name(), [x], [ca.densify(ca.vertcat(*out))], {"cse": True})
