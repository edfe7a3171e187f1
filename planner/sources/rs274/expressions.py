"""Parameters and expressions of RS-274: #1, #<name>, #[2 + 3], [#1 * SIN[30]], ATAN[1]/[2].

Angles are in degrees. Operators bind in this order: ** first, then * / MOD, then + -, then EQ NE GT
GE LT LE, then AND OR XOR; each from left to right. Case and blanks mean nothing. A parameter has to
be set before it is used: where RS-274 would take 0, a reader cannot know whether that was meant.
#<_value> and #<_value_returned> are set by calls only, and are 0 before the first.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from math import (
    acos,
    asin,
    atan2,
    ceil,
    cos,
    degrees,
    exp,
    floor,
    fmod,
    isfinite,
    log,
    radians,
    sin,
    sqrt,
    tan,
)

from kinematics.foundation.errors import MotionError

MAX_DEPTH, MAX_VALUE = 40, 1e15
LAST_NUMBER, LOCAL_NUMBERS = 5000, 30
"""Parameters above are the controller's own; those up to #30 belong to a call."""
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?![\d.])"
_NUMBER = re.compile(NUMBER, re.ASCII)
_NAME = re.compile(r"<([^<>]*)>")
_FOREIGN = re.compile(r"_(hal|ini)\[", re.IGNORECASE)
_LETTERS = re.compile(r"[A-Za-z]+", re.ASCII)
_BLANKS = re.compile(r"[ \t]*")

Binary = Callable[[float, float], float]
OPERATORS: Mapping[str, tuple[int, Binary]] = {
    "**": (5, lambda a, b: a**b),
    "*": (4, lambda a, b: a * b),
    "/": (4, lambda a, b: a / b),
    "MOD": (4, lambda a, b: fmod(a, b) + (abs(b) if fmod(a, b) < 0 else 0.0)),
    "+": (3, lambda a, b: a + b),
    "-": (3, lambda a, b: a - b),
    "EQ": (2, lambda a, b: float(abs(a - b) < EQUAL)),
    "NE": (2, lambda a, b: float(abs(a - b) >= EQUAL)),
    "GT": (2, lambda a, b: float(a > b)),
    "GE": (2, lambda a, b: float(a >= b)),
    "LT": (2, lambda a, b: float(a < b)),
    "LE": (2, lambda a, b: float(a <= b)),
    "AND": (1, lambda a, b: float(a != 0 and b != 0)),
    "OR": (1, lambda a, b: float(a != 0 or b != 0)),
    "XOR": (1, lambda a, b: float((a != 0) != (b != 0))),
}
"""Precedence of each operator, and its function of two values."""
_OPERATOR = re.compile(
    "|".join(re.escape(name) for name in sorted(OPERATORS, key=len, reverse=True)), re.IGNORECASE
)
EQUAL = 1e-6
"""Difference below which two values are equal for EQ and NE, as in LinuxCNC."""
FUNCTIONS: Mapping[str, Callable[[float], float]] = {
    "ABS": abs,
    "ACOS": lambda a: degrees(acos(a)),
    "ASIN": lambda a: degrees(asin(a)),
    "COS": lambda a: cos(radians(a)),
    "EXP": exp,
    "FIX": lambda a: float(floor(a)),
    "FUP": lambda a: float(ceil(a)),
    "LN": log,
    "ROUND": lambda a: floor(abs(a) + 0.5) * (1.0 if a >= 0 else -1.0),
    "SIN": lambda a: sin(radians(a)),
    "SQRT": sqrt,
    "TAN": lambda a: tan(radians(a)),
}


class ExpressionFault(MotionError):
    """A fault of an expression; column: from 1, of its line."""

    def __init__(self, column: int, message: str) -> None:
        self.column = column
        super().__init__(message)


RETURNED = ("_value", "_value_returned")
"""The value that the last call returned, and 1 if it returned one; else both 0."""


class Parameters:
    """The values of a program's parameters.

    A call of an O-word sub has its own #1 to #30 and names without a leading underscore. M98 shares
    those of its
    caller. Each call has a context: M70 and M73 save the modal state there
    (planner.sources.rs274.modes).

    ended  contexts of the calls that have returned since the reader has looked, in this order
    """

    def __init__(self) -> None:
        self._shared: dict[int | str, float] = dict.fromkeys(RETURNED, 0.0)
        self._own: list[dict[int | str, float]] = [{}]
        self._contexts: list[dict[str, object]] = [{}]
        self.ended: list[dict[str, object]] = []

    @property
    def context(self) -> dict[str, object]:
        """State that was saved in the call that runs."""
        return self._contexts[-1]

    def enter(self, given: list[float] | None) -> None:
        """Begin a call with these values as #1, #2 …, the others up to #30 are 0; None: by M98."""
        self._contexts.append({})
        if given is None:
            self._own.append(self._own[-1])
            return
        own: dict[int | str, float] = dict.fromkeys(range(1, LOCAL_NUMBERS + 1), 0.0)
        own.update(enumerate(given, 1))
        self._own.append(own)

    def leave(self, value: float | None) -> None:
        """End a call; value: its result, None: it has none."""
        self._own.pop()
        self.ended.append(self._contexts.pop())
        self._shared["_value"] = 0.0 if value is None else value
        self._shared["_value_returned"] = float(value is not None)

    def _table(self, key: int | str) -> dict[int | str, float]:
        own = key <= LOCAL_NUMBERS if isinstance(key, int) else not key.startswith("_")
        return self._own[-1] if own else self._shared

    def find(self, key: int | str) -> float | None:
        """Return the value of a parameter; None: it has none."""
        return self._table(key).get(key)

    def set(self, key: int | str, value: float) -> None:
        """Give a parameter a value."""
        self._table(key)[key] = value


class Cursor:
    """A position in a line from which words and values are read."""

    def __init__(self, line: str, at: int, parameters: Parameters) -> None:
        self.line, self.at, self.parameters = line, at, parameters
        self._depth = 0

    @property
    def next(self) -> str:
        """The next character, blanks apart; "" at the end."""
        self.at += len(_BLANKS.match(self.line, self.at)[0])  # type: ignore[index]  # which matches nothing, too
        return self.line[self.at : self.at + 1]

    def take(self, character: str, why: str) -> None:
        """Move past a character. Raise ExpressionFault if another one is next."""
        if self.next != character:
            raise ExpressionFault(self.at + 1, f'"{character}" is missing here{why}')
        self.at += 1

    def value(self) -> float:
        """Read a number, parameter, expression in brackets or function, with or without a sign."""
        character, begin = self.next, self.at
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionFault(
                begin + 1, f"brackets within brackets: more than {MAX_DEPTH} deep"
            )
        try:
            number = _NUMBER.match(self.line, begin)
            if number:
                self.at = number.end()
                found = float(number[0])
            elif character in ("+", "-") and character:
                self.at += 1
                found = self.value() * (-1 if character == "-" else 1)
            elif character == "[":
                found = self._bracket()
            elif character == "#":
                found = self._read_parameter()
            else:
                found = self._function()
        finally:
            self._depth -= 1
        return self._check(found, begin)

    def _check(self, found: float, begin: int) -> float:
        if isinstance(found, complex) or not isfinite(found) or abs(found) > MAX_VALUE:
            raise ExpressionFault(
                begin + 1,
                f"{self.line[begin : self.at].strip()[:60]} has no value that makes sense",
            )
        return found

    def _bracket(self) -> float:
        self.take("[", "")
        found = self._binary(0)
        self.take("]", ", to close the bracket")
        return found

    def _binary(self, least: int) -> float:
        """Read values joined by operators that bind tighter than `least`, from left to right."""
        begin = self.at
        result = self.value()
        while True:
            character, at = self.next, self.at
            if character in ("", "]"):
                return result
            operator = _OPERATOR.match(self.line, self.at)
            if operator is None:
                letters = _LETTERS.match(self.line, self.at)
                if letters is None:
                    return result
                raise ExpressionFault(
                    at + 1, f"{letters[0]} is no operator: give one of {', '.join(OPERATORS)}"
                )
            precedence, function = OPERATORS[operator[0].upper()]
            if precedence <= least:
                return result
            self.at = operator.end()
            other = self._binary(precedence)
            result = self._compute(partial(function, result, other), begin)

    def _compute(self, value: Callable[[], float], begin: int) -> float:
        try:
            return self._check(value(), begin)
        except (ValueError, ZeroDivisionError, OverflowError):
            told = self.line[begin : self.at].strip()[:60]
            raise ExpressionFault(
                begin + 1, f"{told} has no value: see what it is computed from"
            ) from None

    def _function(self) -> float:
        letters, begin = _LETTERS.match(self.line, self.at), self.at
        name = "" if letters is None else letters[0].upper()
        if letters is not None:
            self.at = letters.end()
        if name == "EXISTS":
            self.take("[", ", as in EXISTS[#<name>]")
            self.take("#", ", as in EXISTS[#<name>]")
            found = self.parameters.find(self.key()) is not None
            self.take("]", ", to close the bracket")
            return float(found)
        if name == "ATAN":
            above = self._bracket()
            self.take("/", ", as in ATAN[1]/[2]")
            return degrees(atan2(above, self._bracket()))
        if name not in FUNCTIONS:
            told = (
                f'"{self.line[begin : begin + 20].strip()}" is no value'
                if begin < len(self.line)
                else "no value"
            )
            raise ExpressionFault(
                begin + 1, f"{told}: write a number, #parameter, [expression] or a function of one"
            )
        return self._compute(partial(FUNCTIONS[name], self._bracket()), begin)

    def key(self) -> int | str:
        """Read the key of a parameter after #: a name, or a value that is a whole number."""
        begin = self.at
        if self.next == "<":
            name = _NAME.match(self.line, self.at)
            if name is None:
                raise ExpressionFault(
                    begin + 1, 'the name of this parameter has no end: write ">" behind it'
                )
            self.at = name.end()
            if _FOREIGN.match(name[1].strip()):
                raise ExpressionFault(
                    begin + 1,
                    f"#<{name[1]}> is a value of the controller, which the file does not state: write its value",
                )
            if any(character in name[1] for character in "#[]"):
                raise ExpressionFault(
                    begin + 1, f"#<{name[1]}>: a name has no #, [ or ]: rename it"
                )
            return re.sub(r"[ \t]", "", name[1]).lower()
        number = self.value()
        if abs(number - round(number)) > 1e-4 or not 1 <= round(number) <= LAST_NUMBER:
            raise ExpressionFault(
                begin + 1,
                f"#{number:g} is not a parameter of a program: those are #1 to #{LAST_NUMBER} and #<names>",
            )
        return round(number)

    def _read_parameter(self) -> float:
        begin = self.at
        self.take("#", "")
        key = self.key()
        found = self.parameters.find(key)
        if found is None:
            told = self.line[begin : self.at].strip()
            raise ExpressionFault(
                begin + 1, f"{told} has no value here: set it before, as {told} = 0"
            )
        return found


def read_block(line: str, parameters: Parameters) -> tuple[list[tuple[str, str]], list[int]]:
    """Return the words of a line with parameters or expressions, and the column of each, from 1.

    The parameters that the line sets have their new values after it, as in RS-274. Raises
    ExpressionFault.
    """
    cursor = Cursor(line, 0, parameters)
    words: list[tuple[str, str]] = []
    columns: list[int] = []
    settings: list[tuple[int | str, float]] = []
    while character := cursor.next:
        begin = cursor.at
        if character == "#":
            cursor.at += 1
            key = cursor.key()
            cursor.take("=", ": a line begins with a letter, or sets a parameter as #1 = 2")
            if key in RETURNED:
                raise ExpressionFault(
                    begin + 1, f"#<{key}> is set by calls only: choose another name"
                )
            settings.append((key, cursor.value()))
        elif character == "$" or (character.isascii() and character.isalpha()):
            cursor.at += 1
            columns.append(begin + 1)
            if (number := _NUMBER.match(line, cursor.at)) is not None:
                cursor.at = number.end()
                words.append((character, number[0]))
            else:
                words.append((character, repr(cursor.value())))
        else:
            raise ExpressionFault(begin + 1, f'"{character}" begins no word')
    for key, value in settings:
        parameters.set(key, value)
    return words, columns
