"""Formulas of files: text -> a CasADi expression, by an allow-list of what may stand in them;
nothing is evaluated.

    15*cos(t) + r/2      numbers, + − * / **, signs, parentheses, pi, t, named constants
    sin cos tan asin acos atan atan2 hypot sinh cosh tanh sqrt exp log abs min max

It becomes what derivatives and guaranteed enclosures know: |a| = a sign(a), max(a, b) = (a + b + |a
− b|)/2, asin(a) = atan2(a, √(1 − a²)), powers are products, or exp and log.
"""

import ast
import math
import re
import warnings
from collections.abc import Callable, Mapping
from functools import reduce

import casadi as ca

from kinematics.foundation import operations
from kinematics.foundation.errors import BadValue, MotionError, locate_errors
from kinematics.foundation.names import closest, count_noun, nearest
from kinematics.foundation.units import describe_value

MAX_CHARACTERS = 500
"""Characters of a formula."""
MAX_DEPTH = 40
"""Operands inside each other: in parentheses, signs, exponents and calls.

A row as a + b - c, however long, is one.
"""
MAX_EXPONENT = 64
"""Largest exponent of what is not constant."""

_FORBIDDEN = re.compile(r"[^A-Za-z0-9_+\-*/()., \t]")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)


_FUNCTIONS: dict[str, tuple[int, Callable[..., ca.SX]]] = {
    "sin": (1, ca.sin),
    "cos": (1, ca.cos),
    "tan": (1, operations.tangent),
    "asin": (1, operations.arc_sine),
    "acos": (1, operations.arc_cosine),
    "atan": (1, operations.arc_tangent),
    "atan2": (2, ca.atan2),
    "hypot": (2, operations.hypotenuse),
    "sinh": (1, operations.hyperbolic_sine),
    "cosh": (1, operations.hyperbolic_cosine),
    "tanh": (1, operations.hyperbolic_tangent),
    "sqrt": (1, ca.sqrt),
    "exp": (1, ca.exp),
    "log": (1, ca.log),
    "abs": (1, operations.absolute),
    "min": (2, lambda *values: reduce(operations.least, values)),
    "max": (2, lambda *values: reduce(operations.largest, values)),
}
"""How many arguments each takes, hypot, min and max at least, and what it is."""
_VARIADIC = ("hypot", "min", "max")
KNOWN_NAMES = ("t", "pi", *_FUNCTIONS)
_OPERATORS: dict[type[ast.operator], Callable[[ca.SX, ca.SX], ca.SX]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: _power(a, b),
}


_PRODUCT = re.compile(r"(?<![\w.])([\d.]+) *([A-Za-z]\w*)")


def formula(
    text: str,
    constants: Mapping[str, float],
    t: ca.SX | None = None,
    variables: Mapping[str, ca.SX] | None = None,
) -> ca.SX:
    """The expression of a formula, of t where it is given, else it may not stand in it; and of
    variables by name.

    Raises MotionError for anything that the allow-list has not, and for what is not finite or not
    real.
    """
    if len(text) > MAX_CHARACTERS:
        raise MotionError(
            f"{describe_value(text)}: {len(text)} characters; a formula has at most {MAX_CHARACTERS}"
        )
    if odd := _FORBIDDEN.search(text):
        instead = ": write ** for a power" if odd[0] == "^" else ""
        raise MotionError(
            f"{describe_value(text)}: {describe_value(odd[0])} is not allowed in a formula{instead}"
        )
    text = text.strip()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of the parser, about what is no formula anyway
            tree = ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        opened, closed = text.count("("), text.count(")")
        paired = "" if opened == closed else f", with {opened} ( and {closed} )"
        if product := _PRODUCT.search(text):
            paired += f": a product is written {product[1]}*{product[2]}"
        raise MotionError(
            f'{describe_value(text)} is no formula{paired}: write e.g. "15*cos(t)"'
        ) from None
    known = {"pi": ca.SX(math.pi), **{name: ca.SX(value) for name, value in constants.items()}}
    if t is not None:
        known["t"] = t
    known |= variables or {}
    with locate_errors(str(describe_value(text))):
        return _build_node(tree, text, known, 0)


def constant(text: str, constants: Mapping[str, float]) -> float:
    """The value of a formula without t."""
    return float(formula(text, constants))


def check_names(constants: Mapping[str, float]) -> None:
    """Raise MotionError for a constant whose name is none, or means something else already, or that
    is not finite.
    """
    for name, value in constants.items():
        if not _NAME.fullmatch(name) or len(name) > MAX_DEPTH:
            raise MotionError(
                f"constant {describe_value(name)}: a name is letters, digits and _, and begins with a letter"
            )
        if name in KNOWN_NAMES:
            raise MotionError(f"constant {name}: {name} is predefined; choose another name")
        if not math.isfinite(value):
            raise MotionError(f"constant {name}: {value} must be finite")


def _build_node(node: ast.expr, text: str, known: Mapping[str, ca.SX], depth: int) -> ca.SX:
    if depth > MAX_DEPTH:
        raise MotionError(f"nested more than {MAX_DEPTH} levels deep; split it with constants")
    match node:
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            made = ca.SX(_finite(value))
        case ast.Name(id=name):
            if name not in known:
                where = (
                    " here" if name in ("t", *_FUNCTIONS) else nearest(name, [*known, *_FUNCTIONS])
                )
                near = "" if name in KNOWN_NAMES else closest(name, [*known, *_FUNCTIONS])
                told = f"{name} is not defined{where}; known names are {', '.join(known)}"
                raise BadValue(told, allowed=", ".join(known), nearest=near)
            made = known[name]
        case ast.UnaryOp(op=ast.UAdd() | ast.USub(), operand=operand):
            inner = _build_node(operand, text, known, depth + 1)
            made = -inner if isinstance(node.op, ast.USub) else inner
        case ast.BinOp(op=operator) if type(operator) in _OPERATORS:
            made = _fold_operands(node, text, known, depth)
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in _FUNCTIONS:
            count, function = _FUNCTIONS[name]
            if len(arguments) < count or (len(arguments) > count and name not in _VARIADIC):
                raise MotionError(
                    f"{name} takes {count_noun(count, 'argument')}, not {len(arguments)}"
                )
            values = [_build_node(argument, text, known, depth + 1) for argument in arguments]
            made = function(*values)
        case ast.Call(func=ast.Name(id=name)):
            told = f"{name[:40]}(…) is not a known function{nearest(name, _FUNCTIONS)}; there are {', '.join(_FUNCTIONS)}"
            raise BadValue(told, allowed=", ".join(_FUNCTIONS), nearest=closest(name, _FUNCTIONS))
        case _:
            raise MotionError(
                f"{_source(node, text)}: not allowed in formulas, which have numbers, names, + - * / ** and functions: "
                f"{', '.join(_FUNCTIONS)}"
            )
    _check_finite(made, node, text)
    return made


def _fold_operands(node: ast.BinOp, text: str, known: Mapping[str, ca.SX], depth: int) -> ca.SX:
    """Sums and products lean to the left in the tree, which is no nesting: their operands are
    worked out one by one.
    """
    parts: list[ast.BinOp] = []
    first: ast.expr = node
    while isinstance(first, ast.BinOp) and type(first.op) in _OPERATORS:
        parts.append(first)
        first = first.left
    made = _build_node(first, text, known, depth + 1)
    for part in reversed(parts):
        made = _OPERATORS[type(part.op)](made, _build_node(part.right, text, known, depth + 1))
        _check_finite(made, part, text)
    return made


def _check_finite(made: ca.SX, node: ast.expr, text: str) -> None:
    if made.is_constant() and not math.isfinite(float(made)):
        raise MotionError(f"{_source(node, text)} is not a finite number")


def _source(node: ast.expr, text: str) -> str:
    own = text[node.col_offset : node.end_col_offset]
    return own if len(own) <= MAX_DEPTH else f"{own[:MAX_DEPTH]} ..."


def _finite(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _power(base: ca.SX, exponent: ca.SX) -> ca.SX:
    """aᵇ where one of the two is constant: by products for whole b, else as exp(b log a)."""
    if base.is_constant() and exponent.is_constant():
        try:
            value = float(base) ** float(exponent)
        except (OverflowError, ZeroDivisionError):
            value = math.inf
        return ca.SX(math.nan if isinstance(value, complex) else value)
    if not exponent.is_constant():
        if not base.is_constant() or float(base) <= 0:
            raise MotionError(
                "a variable exponent needs a constant base above 0; write exp(b*log(a))"
            )
        return ca.exp(exponent * math.log(float(base)))
    if abs(float(exponent)) > MAX_EXPONENT:
        raise MotionError(
            f"exponent {float(exponent):g}: at most {MAX_EXPONENT} for a variable base"
        )
    return operations.power(base, exponent)
