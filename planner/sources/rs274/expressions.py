"""Parameters and expressions of RS-274, as LinuxCNC has them: #1, #<name>, #[2 + 3], [#1 * SIN[30]], ATAN[1]/[2].

Angles are in degrees. Of operators bind first **, then * / MOD, then + -, then EQ NE GT GE LT LE, then AND OR XOR; each
from left to right. Case and blanks say nothing. A parameter has to be set before it is used: where RS-274 would take 0,
a reader cannot know whether that was meant.
"""

import re
from collections.abc import Callable, Mapping
from functools import partial
from math import acos, asin, atan2, ceil, cos, degrees, exp, floor, fmod, isfinite, log, radians, sin, sqrt, tan

from kinematics.foundation.errors import MotionError

MAX_DEPTH, MAX_VALUE = 40, 1e15
LAST_NUMBER, LOCAL_NUMBERS = 5000, 30
"""Parameters above are the controller's own; those up to #30 belong to a call."""
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?![\d.])"
_NUMBER = re.compile(NUMBER, re.ASCII)
_NAME = re.compile(r"<([^<>#\[\]]*)>")
_LETTERS = re.compile(r"[A-Za-z]+", re.ASCII)
_BLANKS = re.compile(r"[ \t]*")
_OPERATOR = re.compile(r"\*\*|[-+*/]|[A-Za-z]+", re.ASCII)

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
"""How tightly each binds, and what it makes of two values."""
EQUAL = 1e-6
"""Difference below which EQ takes two values for the same, as LinuxCNC does."""
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
    """What is wrong with an expression; column: from 1, of its line."""

    def __init__(self, column: int, message: str) -> None:
        self.column = column
        super().__init__(message)


class Parameters:
    """The values of a program's parameters; a call has its own #1 to #30 and names without a leading underscore."""

    def __init__(self) -> None:
        self._shared: dict[int | str, float] = {}
        self._own: list[dict[int | str, float]] = [{}]

    @property
    def depth(self) -> int:
        """How many calls are open."""
        return len(self._own) - 1

    def enter(self, given: list[float]) -> None:
        """A call with these values as #1, #2 …; those up to #30 that it does not give are 0."""
        own: dict[int | str, float] = dict.fromkeys(range(1, LOCAL_NUMBERS + 1), 0.0)
        own.update(enumerate(given, 1))
        self._own.append(own)

    def leave(self) -> None:
        """The end of a call."""
        self._own.pop()

    def _table(self, key: int | str) -> dict[int | str, float]:
        own = key <= LOCAL_NUMBERS if isinstance(key, int) else not key.startswith("_")
        return self._own[-1] if own else self._shared

    def find(self, key: int | str) -> float | None:
        """The value of a parameter; None: it has none."""
        return self._table(key).get(key)

    def set(self, key: int | str, value: float) -> None:
        """Give a parameter a value."""
        self._table(key)[key] = value


class Cursor:
    """A place in a line from which words and values are read."""

    def __init__(self, line: str, at: int, parameters: Parameters) -> None:
        self.line, self.at, self.parameters = line, at, parameters
        self._depth = 0

    @property
    def next(self) -> str:
        """The character behind blanks; "" at the end."""
        self.at += len(_BLANKS.match(self.line, self.at)[0])  # type: ignore[index]  # which matches nothing, too
        return self.line[self.at : self.at + 1]

    def take(self, character: str, why: str) -> None:
        """Go past a character that has to stand there."""
        if self.next != character:
            raise ExpressionFault(self.at + 1, f'"{character}" is missing here{why}')
        self.at += 1

    def value(self) -> float:
        """A number, a parameter, an expression in brackets or a function of one, with or without a sign."""
        character, begin = self.next, self.at
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise ExpressionFault(begin + 1, f"brackets within brackets: more than {MAX_DEPTH} deep")
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
            raise ExpressionFault(begin + 1, f"{self.line[begin : self.at].strip()[:60]} has no value that makes sense")
        return found

    def _bracket(self) -> float:
        self.take("[", "")
        found = self._binary(0)
        self.take("]", ", to close the bracket")
        return found

    def _binary(self, least: int) -> float:
        """Operators that bind tighter than `least`, from left to right."""
        begin = self.at
        found = self.value()
        while True:
            character, back = self.next, self.at
            operator = _OPERATOR.match(self.line, back)
            if character in ("", "]") or operator is None:
                return found
            known = OPERATORS.get(operator[0].upper())
            if known is None:
                raise ExpressionFault(back + 1, f"{operator[0]} is no operator: give one of {', '.join(OPERATORS)}")
            if known[0] <= least:
                return found
            self.at = operator.end()
            other = self._binary(known[0])
            found = self._compute(partial(known[1], found, other), begin)

    def _compute(self, value: Callable[[], float], begin: int) -> float:
        try:
            return self._check(value(), begin)
        except (ValueError, ZeroDivisionError, OverflowError):
            told = self.line[begin : self.at].strip()[:60]
            raise ExpressionFault(begin + 1, f"{told} has no value: see what it is computed from") from None

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
            told = f'"{self.line[begin : begin + 20].strip()}" is no value' if begin < len(self.line) else "no value"
            raise ExpressionFault(begin + 1, f"{told}: write a number, #parameter, [expression] or a function of one")
        return self._compute(partial(FUNCTIONS[name], self._bracket()), begin)

    def key(self) -> int | str:
        """What stands behind #: a name, or a value that is a whole number."""
        begin = self.at
        if self.next == "<":
            name = _NAME.match(self.line, self.at)
            if name is None:
                raise ExpressionFault(begin + 1, 'the name of this parameter has no end: write ">" behind it')
            self.at = name.end()
            return re.sub(r"[ \t]", "", name[1]).lower()
        number = self.value()
        if abs(number - round(number)) > 1e-4 or not 1 <= round(number) <= LAST_NUMBER:
            raise ExpressionFault(
                begin + 1, f"#{number:g} is not a parameter of a program: those are #1 to #{LAST_NUMBER} and #<names>"
            )
        return round(number)

    def _read_parameter(self) -> float:
        begin = self.at
        self.take("#", "")
        key = self.key()
        found = self.parameters.find(key)
        if found is None:
            told = self.line[begin : self.at].strip()
            raise ExpressionFault(begin + 1, f"{told} has no value here: set it before, as {told} = 0")
        return found


def read_block(line: str, parameters: Parameters) -> tuple[list[tuple[str, str]], list[int]]:
    """The words of a line with parameters or expressions, and the column of each, from 1; what it sets is set.

    Parameters have their new values behind the line, as RS-274 has it. Raises ExpressionFault.
    """
    cursor = Cursor(line, 0, parameters)
    found: list[tuple[str, str]] = []
    columns: list[int] = []
    settings: list[tuple[int | str, float]] = []
    while character := cursor.next:
        begin = cursor.at
        if character == "#":
            cursor.at += 1
            key = cursor.key()
            cursor.take("=", ": a line begins with a letter, or sets a parameter as #1 = 2")
            settings.append((key, cursor.value()))
        elif character.isascii() and character.isalpha():
            cursor.at += 1
            columns.append(begin + 1)
            if (number := _NUMBER.match(line, cursor.at)) is not None:
                cursor.at = number.end()
                found.append((character, number[0]))
            else:
                found.append((character, repr(cursor.value())))
        else:
            raise ExpressionFault(begin + 1, f'"{character}" begins no word')
    for key, value in settings:
        parameters.set(key, value)
    return found, columns
