"""The words of a G-code file, block by block: comments taken out, every other character accounted for.

Words that leave the path as it is may be left out.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.units import describe_value
from planner.sources.rs274.expressions import NUMBER, ExpressionFault, Parameters, read_block
from planner.sources.rs274.flow import KEYWORDS, Flow, find_flow
from planner.sources.source import Faults

MAX_CHARACTERS = 1024
"""Characters of a line; controllers take 255 or 256."""
MAX_NUMBER = 1e9
"""Magnitude of a number; no coordinate, speed or line number that means something comes near it."""

WORD = re.compile(rf"([A-Za-z])[ \t]*({NUMBER})", re.ASCII)
"""One word: a letter and a number, between them nothing but blanks."""
_PLAIN = re.compile(rf"[ \t]*(?:[A-Za-z][ \t]*{NUMBER}[ \t]*)*", re.ASCII)
_LABEL = re.compile(r"[ \t]*(?:N[ \t]*\d+[ \t]*)?(O[ \t]*(?:<|\d+[ \t]*[A-Za-z]{2}))", re.IGNORECASE | re.ASCII)
_COMPUTED = re.compile(r"#|[A-Za-z][ \t]*[+-]?[ \t]*(?:#|\[|[A-Za-z]{2,6}[ \t]*\[)", re.ASCII)
"""What begins a word whose value is computed, or sets a parameter."""
_COMMENT = re.compile(r"\([^()]*\)|;.*")

Words = list[tuple[str, str]]
"""Letters and the texts of their numbers."""


class WordBlock(NamedTuple):
    """A line that has words: its number, its text with blanks for comments, its words.

    columns  of the words, from 1, where some were computed; none: where the text says
    """

    number: int
    line: str
    words: Words
    columns: tuple[int, ...] = ()

    def column(self, nth: int) -> int:
        """The column, from 1, of the n-th word, from 0."""
        return self.columns[nth] if self.columns else [word.start() for word in WORD.finditer(self.line)][nth] + 1


SYSTEMS = (54.0, 55.0, 56.0, 57.0, 58.0, 59.0, 59.1, 59.2, 59.3)
NOTHING = (8.0, 15.0, 40.0, 49.0, 69.0)
"""What ends modes that no file gets into here, or only by words that are left out."""
GROUPS: Mapping[float, str] = {
    **dict.fromkeys((0.0, 1.0, 2.0, 3.0), "motion"),
    **dict.fromkeys((17.0, 18.0, 19.0), "plane"),
    **dict.fromkeys((20.0, 21.0), "length"),
    **dict.fromkeys((61.0, 61.1, 64.0), "join"),
    **dict.fromkeys((90.0, 91.0), "distance"),
    **dict.fromkeys((90.1, 91.1), "centre"),
    **dict.fromkeys((93.0, 94.0), "feed"),
    **dict.fromkeys(SYSTEMS, "system"),
    **dict.fromkeys((10.0, 28.0, 53.0, 92.0, 92.1, 92.2, 92.3), "once"),
    4.0: "dwell",
    **{value: f"G{value:g}" for value in NOTHING},
    80.0: "cycle",
}
"""What each G says something about: of each, a block says one."""


class WordFault(MotionError):
    """What is wrong with a block, at one of its words or, for "", all of it."""

    def __init__(self, word: str, message: str) -> None:
        self.word = word
        super().__init__(message)


def split_lines(text: str) -> Iterator[str]:
    """The lines of a text with their ends, one by one: StringIO would hold it again in four bytes a character."""
    begin = 0
    while begin < len(text):
        end = text.find("\n", begin) + 1 or len(text)
        yield text[begin:end]
        begin = end


def blocks(text: str, faults: Faults, deleted: Literal["skip", "run"] | None = None) -> Iterator[WordBlock]:
    """Every line that has words, in the order in which lines run, up to the % that ends the program.

    deleted: what becomes of lines that begin with /; None: they are faults. A faulty line is told of, and left out.
    Comments are ( … ) without parentheses inside, and from ; to the line's end; in the text blanks stand for them, so
    that columns stay.
    """
    begun, parameters = False, Parameters()
    lines = Flow(text, parameters, faults).run() if find_flow(text) else enumerate(split_lines(text), 1)
    for number, ended in lines:
        line = ended.rstrip("\n")
        if len(line) > MAX_CHARACTERS:
            faults.add(
                f"{count_noun(len(line), 'character')}; a line has at most {MAX_CHARACTERS}: split "
                "it, or shorten its comment",
                number,
            )
            faults.unread = True
            continue
        if "(" in line or ";" in line or ")" in line:
            line = _COMMENT.sub(lambda comment: " " * len(comment[0]), line)
        columns: tuple[int, ...] = ()
        if not _PLAIN.fullmatch(line):
            if line.strip() == "%":
                if begun:
                    return
                begun = True
                continue
            if deleted is not None and (start := line.find("/")) >= 0 and not line[:start].strip():
                if deleted == "skip":
                    continue
                line = line.replace("/", " ", 1)
            computed = _compute_words(number, line, parameters, faults)
            if computed is None:
                faults.unread = True
                continue
            found, columns = computed
        else:
            found = WORD.findall(line)
        if found:
            begun = True
            yield WordBlock(number, line, found, columns)


def _compute_words(
    number: int, line: str, parameters: Parameters, faults: Faults
) -> tuple[Words, tuple[int, ...]] | None:
    """The words of a line that is not letters and numbers alone, and their columns; None where it is faulty."""
    if _PLAIN.fullmatch(line):
        return WORD.findall(line), ()
    column, message = _find_odd_character(line)
    if message:
        faults.add(message, number, f"column {column}")
        return None
    try:
        found, columns = read_block(line, parameters)
    except ExpressionFault as wrong:
        faults.add(str(wrong), number, f"column {wrong.column}")
        return None
    return found, tuple(columns)


def _find_odd_character(line: str) -> tuple[int, str]:
    """The column of what begins no word, and what to say of it; "" where parameters or expressions may be all it is."""
    if label := _LABEL.match(line):
        told = describe_value(line[label.start(1) :])
        return label.start(1) + 1, f"{told}: an O-word is a label and one of {', '.join(KEYWORDS)}"
    plain = _PLAIN.match(line)
    at = plain.end() if plain else 0
    rest = line[at:]
    if rest[0] == "(":
        return at + 1, "the comment has no end, or contains another; write ( … ) once, or ; before it"
    if rest[0] == ")":
        return at + 1, "unmatched parenthesis; comments cannot be nested: take it out, or write ( … )"
    if rest[0] == "/":
        return at + 1, "block delete (/): give the option block_delete as skip or run, or remove the slash"
    if _COMPUTED.match(rest):
        return at + 1, ""
    if rest[0] in "@^":
        return at + 1, f"{describe_value(rest)}: polar coordinates are not supported; write X and Y"
    if rest[0] == "%":
        return at + 1, "% must be alone on its line, before the program and after it"
    if re.match(r"[GM][Oo]", rest, re.IGNORECASE):
        return at + 1, f"{describe_value(rest)} is not a word: write {rest[0]}0 with a zero"
    if rest[0].isascii() and rest[0].isalpha():
        return at + 1, f"{describe_value(rest)} is not a word: write a letter, then a number as 12, -0.5 or .25"
    return at + 1, f"{describe_value(rest)}: not the start of a word; take it out, or put it into ( … )"


MACHINING_WORDS = frozenset({"S", "T", "M19", "G97"})
"""Of spindle and tool, and no events: they leave the path as it is, and are skipped unless they are to be refused."""
IGNORABLE_LETTERS = frozenset("STHDE")
"""Speed of the spindle, tool, the numbers of its offsets, and what a printer extrudes: left out with any number."""
IGNORABLE_G = frozenset({40.0, 43.0, 49.0, *SYSTEMS, 80.0, 97.0, 98.0, 99.0})
"""Offsets of tool and work, and modes of cycles and spindles; none is a path by itself. Some are read in any case."""
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
