"""The words of a G-code file, line by line: comments taken out, every other character accounted for.

Words that leave the path as it is may be left out. Of arcs: the centre and the signed angle that I J K or R and the end
point say, in the arc's plane: (2,) points, with the angle positive from the first axis to the second.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import StringIO
from math import atan2, copysign, dist, hypot, pi, sqrt

from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import describe_value
from planner.program.model import MIN_MOVE
from planner.sources.source import Faults

MAX_CHARACTERS = 1024
"""Characters of a line; controllers take 255 or 256."""
MAX_NUMBER = 1e9
"""Magnitude of a number; no coordinate, speed or line number that means something comes near it."""

_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
WORD = re.compile(rf"([A-Za-z])[ \t]*({_NUMBER})(?![\d.])", re.ASCII)
"""One word: a letter and a number, between them nothing but blanks."""
_PLAIN = re.compile(rf"[ \t]*(?:[A-Za-z][ \t]*{_NUMBER}(?![\d.])[ \t]*)*", re.ASCII)
_COMMENT = re.compile(r"\([^()]*\)|;.*")

Words = list[tuple[str, str]]
"""Letters and the texts of their numbers."""
GROUPS: Mapping[float, str] = {
    **dict.fromkeys((0.0, 1.0, 2.0, 3.0), "motion"),
    **dict.fromkeys((17.0, 18.0, 19.0), "plane"),
    **dict.fromkeys((20.0, 21.0), "length"),
    **dict.fromkeys((61.0, 61.1, 64.0), "join"),
    **dict.fromkeys((90.0, 91.0), "distance"),
    **dict.fromkeys((90.1, 91.1), "centre"),
    **dict.fromkeys((93.0, 94.0), "feed"),
    4.0: "dwell",
}
"""What each G says something about: of each, a block says one."""


class WordFault(MotionError):
    """What is wrong with a block, at one of its words or, for "", all of it."""

    def __init__(self, word: str, message: str) -> None:
        self.word = word
        super().__init__(message)


def words(text: str, faults: Faults) -> Iterator[tuple[int, str, Words]]:
    """Number, text without comments, and words of every line that has some, up to the % that ends the program.

    A faulty line is told of, and left out. Comments are ( … ) without parentheses inside, and from ; to the line's end;
    in the text blanks stand for them, so that columns stay.
    """
    begun = False
    for number, ended in enumerate(StringIO(text), 1):
        line = ended.rstrip("\n")
        if len(line) > MAX_CHARACTERS:
            faults.add(f"{len(line)} characters; a line has at most {MAX_CHARACTERS}", number)
            continue
        if "(" in line or ";" in line or ")" in line:
            line = _COMMENT.sub(lambda comment: " " * len(comment[0]), line)
        if not _PLAIN.fullmatch(line):
            if line.strip() == "%":
                if begun:
                    return
                begun = True
                continue
            column, message = _find_odd_character(line)
            faults.add(message, number, f"column {column}")
            continue
        found = WORD.findall(line)
        if found:
            begun = True
            yield number, line, found


def column_of(line: str, nth: int) -> int:
    """The column, from 1, of the n-th word of a line, from 0."""
    return [word.start() for word in WORD.finditer(line)][nth] + 1


def _find_odd_character(line: str) -> tuple[int, str]:
    """The column of what begins no word, and what to say of it."""
    plain = _PLAIN.match(line)
    at = plain.end() if plain else 0
    rest = line[at:]
    if rest[0] == "(":
        return at + 1, "the comment has no end, or contains another; write ( … ) once, or ; before it"
    if rest[0] == ")":
        return at + 1, "unmatched parenthesis; comments cannot be nested"
    if rest[0] == "/":
        return at + 1, "block delete (/) is not supported: remove the block, or the slash"
    if rest[0] in "#[=":
        return at + 1, f"{describe_value(rest)}: parameters and expressions are not supported; write numbers"
    if rest[0] == "%":
        return at + 1, "% stands alone on its line, before the program and after it"
    if re.match(r"[GM][Oo]", rest, re.IGNORECASE):
        return at + 1, f"{describe_value(rest)} is not a word: write {rest[0]}0 with a zero"
    if rest[0].isascii() and rest[0].isalpha():
        return at + 1, f"{describe_value(rest)} is not a word: write a letter, then a number as 12, -0.5 or .25"
    return at + 1, f"{describe_value(rest)}: not the start of a word"


# The distances of the two ends from the centre may differ by ALWAYS_REFUSED, or if by more than ROUNDED (m) then by
# RELATIVE of the radius: what Grbl and LinuxCNC take for rounding of coordinates.
ALWAYS_REFUSED, ROUNDED, RELATIVE = 0.5e-3, 5e-6, 1e-3

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class ArcFit:
    """An arc from where the tool stands: its centre, signed angle (rad), and how far from its end point it ends (m)."""

    centre: Point
    angle: float
    off: float


def arc_by_centre(stands: Point, start: Point, end: Point, offset: Point, clockwise: bool) -> ArcFit:
    """About `start` + `offset`; a full circle where start and end are the same.

    stands  where the tool is, which an arc before it may have left a rounding beside `start`
    It keeps the radius that it stands at, so it ends on the line from the centre to the end point. Raises MotionError
    where the radii at both ends differ by more than rounding.
    """
    centre = start[0] + offset[0], start[1] + offset[1]
    first, last = ((p[0] - centre[0], p[1] - centre[1]) for p in (stands, end))
    radius, final = hypot(*first), hypot(*last)
    off = abs(radius - final)
    if min(radius, final) <= MIN_MOVE:
        raise MotionError(f"its centre [{_mm(centre)}] mm is its start or end point; give another centre, or R")
    if off > ALWAYS_REFUSED or off > max(ROUNDED, RELATIVE * max(radius, final)):
        raise MotionError(
            f"its start is {radius * 1e3:.6g} mm from the centre [{_mm(centre)}] mm and its end {final * 1e3:.6g} mm; "
            f"at most {min(ALWAYS_REFUSED, max(ROUNDED, RELATIVE * radius)) * 1e3:.4g} mm may lie between the two"
        )
    if dist(start, end) <= MIN_MOVE:
        return ArcFit(centre, -2 * pi if clockwise else 2 * pi, off)
    angle = atan2(first[0] * last[1] - first[1] * last[0], first[0] * last[0] + first[1] * last[1])
    if clockwise and angle >= 0:
        angle -= 2 * pi
    elif not clockwise and angle <= 0:
        angle += 2 * pi
    return ArcFit(centre, angle, off)


def arc_by_radius(stands: Point, start: Point, end: Point, radius: float, clockwise: bool) -> ArcFit:
    """Of a radius: the way of at most half a turn, or for a negative radius the other.

    stands  as in `arc_by_centre`
    Raises MotionError where start and end are the same, or farther apart than the circle is wide.
    """
    over, up = end[0] - stands[0], end[1] - stands[1]
    half = hypot(over, up) / 2
    if half == 0 or dist(start, end) <= MIN_MOVE:
        raise MotionError("R does not define a full circle; give its centre with I J K")
    if half - abs(radius) > ROUNDED:
        raise MotionError(
            f"R {radius * 1e3:.6g} mm is too small: its ends are {2 * half * 1e3:.6g} mm apart, so give at least "
            f"{half * 1e3:.6g} mm"
        )
    height = sqrt(max(radius * radius - half * half, 0.0))
    # the centre of a counterclockwise arc of at most half a turn lies to the left of its chord
    side = copysign(height, radius) * (-1 if clockwise else 1) / (2 * half)
    centre = (stands[0] + end[0]) / 2 - up * side, (stands[1] + end[1]) / 2 + over * side
    short = 2 * atan2(half, height)
    angle = short if radius > 0 else 2 * pi - short
    return ArcFit(centre, -angle if clockwise else angle, 0.0)


def _mm(point: Point) -> str:
    return ", ".join(f"{value * 1e3:.6g}" for value in point)


IGNORABLE_LETTERS = frozenset("STHD")
"""Speed of the spindle, tool, and the numbers of its offsets: letters that may be left out with any number."""
IGNORABLE_G = frozenset({40.0, 43.0, 49.0, *map(float, range(54, 60)), 80.0, 97.0, 98.0, 99.0})
"""Offsets of tool and work, and modes of cycles and spindles; none is a path by itself."""
PROGRAM_FLOW_M = frozenset({2.0, 30.0, *map(float, range(96, 100))})
"""Ends and calls of programs."""


def find_ignored_word(letter: str, value: float, words: frozenset[str]) -> str | None:
    """The word, M3 or S as `words` has it, if it is to be left out."""
    word = f"{letter}{value:g}"
    if word in words and is_ignorable(word):
        return word
    return letter if letter in words and _is_silent(letter, value) else None


def is_ignorable(word: str) -> bool:
    """Whether a word without leading zeros, or all of a letter, may be left out."""
    letter, number = word[:1], word[1:]
    if not number:
        return letter in IGNORABLE_LETTERS or letter == "M"
    try:
        return _is_silent(letter, float(number))
    except ValueError:
        return False


def _is_silent(letter: str, value: float) -> bool:
    if letter == "G":
        return value in IGNORABLE_G
    return letter in IGNORABLE_LETTERS or (letter == "M" and value not in PROGRAM_FLOW_M)


class Offsets:
    """What words that are left out say of the coordinates: one offset of the work and one of the tool, or none.

    A program that moves under two of a kind is another path without them: what holds when it moves is compared with
    what held before. Where it has said nothing yet, any is as good.
    """

    def __init__(self) -> None:
        self._said: dict[str, str] = {}
        self._moved: dict[str, str] = {}
        self._tool = self._loaded = ""

    def block(self, left_out: list[tuple[str, float]]) -> None:
        """The words of a block that are left out, letters and numbers."""
        number = {letter: value for letter, value in left_out if letter != "G" and letter != "M"}
        self._tool = f"T{number['T']:g}" if "T" in number else self._tool
        if ("M", 6.0) in left_out:
            self._loaded = self._tool
        for letter, value in left_out:
            if letter == "G" and 54 <= value <= 59:
                self._said["work"] = f"G{value:g}"
            elif letter == "G" and value == 49:
                self._said["tool"] = "G49"
            elif letter == "G" and value == 43:
                self._said["tool"] = f"G43 H{number['H']:g}" if "H" in number else f"G43 {self._loaded}".strip()

    def find_change(self) -> tuple[str, str] | None:
        """Two offsets, the one under which it moved and the one under which it moves now, if they are not the same."""
        for kind, now in self._said.items():
            if self._moved.setdefault(kind, now) != now:
                return self._moved[kind], now
        return None
