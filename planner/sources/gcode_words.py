"""The words of a G-code file, line by line: comments taken out, every other character accounted for."""

import re
from collections.abc import Iterator

from kinematics.units import shown
from planner.sources.faults import Faults

LONGEST = 1024
"""Characters of a line; controllers take 255 or 256."""
LARGEST = 1e9
"""Magnitude of a number; no coordinate, speed or line number that means something comes near it."""

_NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
WORD = re.compile(rf"([A-Za-z])[ \t]*({_NUMBER})(?![\d.])", re.ASCII)
"""One word: a letter and a number, between them nothing but blanks."""
_PLAIN = re.compile(rf"[ \t]*(?:[A-Za-z][ \t]*{_NUMBER}(?![\d.])[ \t]*)*", re.ASCII)
_COMMENT = re.compile(r"\([^()]*\)|;.*")

Words = list[tuple[str, str]]
"""Letters and the texts of their numbers."""


def words(text: str, faults: Faults) -> Iterator[tuple[int, str, Words]]:
    """Number, text without comments, and words of every line that has some, up to the % that ends the program.

    A faulty line is told of, and left out. Comments are ( … ) without parentheses inside, and from ; to the line's end;
    in the text blanks stand for them, so that columns stay.
    """
    begun = False
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > LONGEST:
            faults.add(f"{len(line)} characters; a line has at most {LONGEST}", number)
            continue
        if "(" in line or ";" in line or ")" in line:
            line = _COMMENT.sub(lambda comment: " " * len(comment[0]), line)
        if not _PLAIN.fullmatch(line):
            if line.strip() == "%":
                if begun:
                    return
                begun = True
                continue
            column, message = _odd(line)
            faults.add(message, number, f"column {column}")
            continue
        found = WORD.findall(line)
        if found:
            begun = True
            yield number, line, found


def column_of(line: str, nth: int) -> int:
    """The column, from 1, of the n-th word of a line, from 0."""
    return [word.start() for word in WORD.finditer(line)][nth] + 1


def _odd(line: str) -> tuple[int, str]:
    """The column of what begins no word, and what to say of it."""
    plain = _PLAIN.match(line)
    at = plain.end() if plain else 0
    rest = line[at:]
    if rest[0] == "(":
        return at + 1, "this comment has no end, or holds another; write ( … ) once, or ; before it"
    if rest[0] == ")":
        return at + 1, "a comment ends here that began nowhere; comments do not hold others"
    if rest[0] == "/":
        return at + 1, "a block that may be skipped (/): take it out, or the slash away"
    if rest[0] in "#[=":
        return at + 1, f"{shown(rest)}: parameters and expressions are not supported; write their numbers"
    if rest[0] == "%":
        return at + 1, "% stands alone on its line, before the program and after it"
    if re.match(r"[GM][Oo]", rest, re.IGNORECASE):
        return at + 1, f"{shown(rest)} is no word: write {rest[0]}0 with a zero"
    if rest[0].isascii() and rest[0].isalpha():
        return at + 1, f"{shown(rest)} is no word: a letter, then a number as 12, -0.5 or .25"
    return at + 1, f"{shown(rest)}: nothing that stands here begins a word"
