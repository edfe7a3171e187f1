"""Words of a G-code file, block by block, without comments: every other character counts.

Words that leave the path as it is may be left out on demand, together with their arguments.
"""

import re
from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.units import describe_value
from planner.sources.rs274.expressions import NUMBER, ExpressionFault, Parameters, read_block
from planner.sources.rs274.flow import KEYWORDS, Flow, delete_slash, is_program_label
from planner.sources.source import Faults

MAX_CHARACTERS = 1024
"""Characters of a line; controllers take 255 or 256."""
MAX_NUMBER = 1e9
"""Largest magnitude of a number. Coordinates, speeds and line numbers are far smaller."""

WORD = re.compile(rf"([A-Za-z$])[ \t]*({NUMBER})", re.ASCII)
"""One word: a letter, or $ for a spindle, and a number, with nothing but blanks in between."""
_PLAIN = re.compile(rf"[ \t]*(?:[A-Za-z$][ \t]*{NUMBER}[ \t]*)*", re.ASCII)
_LABEL = re.compile(
    r"[ \t]*(?:N[ \t]*\d+[ \t]*)?(O[ \t]*(?:<|[\[#]|\d+[ \t]*[A-Za-z]{2}))",
    re.IGNORECASE | re.ASCII,
)
_COMPUTED = re.compile(r"#|[A-Za-z$][ \t]*[+-]?[ \t]*(?:#|\[|[A-Za-z]{2,6}[ \t]*\[)", re.ASCII)
"""How a word begins whose value is computed, or a block that sets a parameter."""
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_WITHIN_NUMBER = re.compile(r"^[^;]*?[\d.][ \t]*(\([^()]*\))(?:[ \t]|\([^()]*\))*[\d.]", re.ASCII)
_CODE = re.compile(rf"([GM])[ \t]*({NUMBER})", re.IGNORECASE | re.ASCII)
_TEXT = re.compile(r"[ \t]+\d", re.ASCII)
"""How text begins that would read as more digits of the word before it, as blanks mean nothing."""

Words = list[tuple[str, str]]
"""Letters and the texts of their numbers."""


class WordBlock(NamedTuple):
    """A line that has words: its number, its text with blanks for comments, its words.

    columns  of the words, from 1, if the line had to be parsed; empty: the columns in the text
    """

    number: int
    line: str
    words: Words
    columns: tuple[int, ...] = ()

    def column(self, nth: int) -> int:
        """Return the column, from 1, of the n-th word, from 0."""
        if self.columns:
            return self.columns[nth]
        return [word.start() for word in WORD.finditer(self.line)][nth] + 1


SYSTEMS = (54.0, 55.0, 56.0, 57.0, 58.0, 59.0, 59.1, 59.2, 59.3)
CYCLES = (73.0, 74.0, 81.0, 82.0, 83.0, 84.0, 85.0, 86.0, 87.0, 88.0, 89.0)
"""Canned cycles (planner.sources.rs274.cycles)."""
NOTHING = (8.0, 15.0, 40.0, 49.0, 69.0)
"""Ends of modes that the reader never enters, or only by words that are left out."""
GROUPS: Mapping[float, str] = {
    **dict.fromkeys((0.0, 1.0, 2.0, 3.0, *CYCLES), "motion"),
    **dict.fromkeys((17.0, 18.0, 19.0), "plane"),
    **dict.fromkeys((20.0, 21.0), "length"),
    **dict.fromkeys((61.0, 61.1, 64.0), "join"),
    **dict.fromkeys((90.0, 91.0), "distance"),
    **dict.fromkeys((90.1, 91.1), "centre"),
    **dict.fromkeys((93.0, 94.0), "feed"),
    **dict.fromkeys((98.0, 99.0), "retract"),
    **dict.fromkeys(SYSTEMS, "system"),
    **dict.fromkeys((10.0, 11.0, 28.0, 52.0, 53.0, 92.0, 92.1, 92.2, 92.3), "once"),
    4.0: "dwell",
    **{value: f"G{value:g}" for value in NOTHING},
    80.0: "cycle",
}
"""Modal group of each G word. A block has at most one word of a group."""


class WordFault(MotionError):
    """A fault of a block, at one of its words; word "": the block as a whole."""

    def __init__(self, word: str, message: str) -> None:
        self.word = word
        super().__init__(message)


def split_lines(text: str) -> Iterator[str]:
    """Yield the lines of a text with their ends, without the copy that StringIO makes."""
    begin = 0
    while begin < len(text):
        end = text.find("\n", begin) + 1 or len(text)
        yield text[begin:end]
        begin = end


def blocks(
    text: str,
    faults: Faults,
    deleted: Literal["skip", "run"] | None = None,
    ignored: frozenset[str] = frozenset(),
    flow: Flow | None = None,
) -> Iterator[WordBlock]:
    """Yield every line that has words, in the order in which lines run, up to the last %.

    deleted  how to treat blocks that begin with /; None: they are faults
    ignored  words that are left out, so that text after them is no fault
    flow     the order in which lines run, if the caller needs it too; None: it is made here
    A faulty line becomes a fault, and is left out. Comments are ( … ) without parentheses inside,
    and from ; to the
    line's end; blanks take their place in the text, so that columns stay.
    """
    begun, first = False, True
    if flow is None:
        flow = Flow(text, Parameters(), faults, deleted)
    parameters = flow.parameters
    lines = flow.run() if flow.used else enumerate(split_lines(text), 1)
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
            split = _WITHIN_NUMBER.search(line)
            if split is not None:
                faults.add(
                    "a comment is within a number: move it",
                    number,
                    f"column {split.start(1) + 1}",
                )
                faults.unread = True
                continue
            line = _COMMENT.sub(lambda comment: " " * len(comment[0]), line)
        if first and is_program_label(line):
            first = False
            continue
        columns: tuple[int, ...] = ()
        if not _PLAIN.fullmatch(line):
            if line.strip() == "%":
                if begun:
                    return
                begun = True
                continue
            if deleted is not None and "/" in line:
                line = delete_slash(line, deleted)
                if not line.strip():
                    continue
            computed = _parse_line(number, line, parameters, faults, ignored)
            if computed is None:
                faults.unread = True
                continue
            words, columns = computed
        else:
            words = WORD.findall(line)
        if words:
            begun, first = True, False
            yield WordBlock(number, line, words, columns)


def _parse_line(
    number: int, line: str, parameters: Parameters, faults: Faults, ignored: frozenset[str]
) -> tuple[Words, tuple[int, ...]] | None:
    """Return the words of a line that is not letters and numbers alone, and their columns.

    Blanks mean nothing, not even within a number (RS-274). Text after an ignored word is left out.
    None: a fault.
    """
    line = _cut_text(line, ignored)
    places = [k for k, character in enumerate(line) if character not in " \t"]
    compact = "".join(line[k] for k in places)
    places.append(len(line))
    if not _PLAIN.fullmatch(compact):
        wrong = _parse_compact(compact, line, places, parameters)
        if isinstance(wrong, tuple):
            words, columns = wrong
            return words, tuple(places[column - 1] + 1 for column in columns)
        end = _find_argument_text(compact, wrong.column - 1, ignored)
        if end is None:
            faults.add(
                str(wrong),
                number,
                f"column {places[min(wrong.column - 1, len(compact))] + 1}",
            )
            return None
        compact = compact[:end]
    matches = list(WORD.finditer(compact))
    words = [(word[1], word[2]) for word in matches]
    return words, tuple(places[word.start()] + 1 for word in matches)


def _parse_compact(
    compact: str, line: str, places: list[int], parameters: Parameters
) -> tuple[Words, list[int]] | ExpressionFault:
    """Return the words of a line without blanks and their columns in it, or its fault."""
    if label := _LABEL.match(line):
        column = places.index(label.start(1)) + 1
        text = describe_value(line[label.start(1) :])
        return ExpressionFault(
            column,
            f"{text}: an O-word is a label and one of {', '.join(KEYWORDS)}",
        )
    plain = _PLAIN.match(compact)
    at = plain.end() if plain else 0
    message = _describe_odd_character(compact, at, line[places[at] :])
    if message:
        return ExpressionFault(at + 1, message)
    try:
        return read_block(compact, parameters)
    except ExpressionFault as error:
        return error


def _cut_text(line: str, ignored: frozenset[str]) -> str:
    """Return a line without the text after an ignored word, as in M117 50% done."""
    for code in _CODE.finditer(line):
        letter, value = code[1].upper(), float(code[2])
        if letter != "M" or find_ignored_word(letter, value, ignored) is None:
            continue
        takes_text = argument_letters(letter, value) is None or value in STOP_WORDS
        if value in TEXT_WORDS or (takes_text and _TEXT.match(line, code.end())):
            return line[: code.end()]
    return line


def _find_argument_text(compact: str, at: int, ignored: frozenset[str]) -> int | None:
    """Return the end of an ignored word with text as its argument; None: no such word."""
    codes = [code for code in _CODE.finditer(compact) if code.end() <= at]
    for code in codes:
        letter, value = code[1].upper(), float(code[2])
        if find_ignored_word(letter, value, ignored) is None:
            continue
        taken = argument_letters(letter, value)
        between = [letter for letter, _ in WORD.findall(compact[code.end() : at])]
        fits = taken is None or (value in STOP_WORDS and set(between) <= taken)
        if code is codes[-1] and fits:
            return code.end()
    return None


def _describe_odd_character(compact: str, at: int, shown: str) -> str:
    """Return the fault of a place where no plain word begins; "": it may be an expression.

    at  the place in the line without blanks;  shown: the rest of the line as it is
    """
    rest = compact[at:]
    if rest[0] == "(":
        return "the comment has no end, or contains another; write ( … ) once, or ; before it"
    if rest[0] == ")":
        return "unmatched parenthesis; comments cannot be nested: take it out, or write ( … )"
    if rest[0] == "/":
        if at == 0 or re.fullmatch(r"N\d+", compact[:at], re.IGNORECASE):
            return (
                "block delete (/): give the option block_delete as skip or run, or remove the slash"
            )
        return "a slash deletes a block only at its beginning: move it there, or remove it"
    if _COMPUTED.match(rest):
        return ""
    if rest[0] in "@^":
        return f"{describe_value(shown)}: polar coordinates are not supported; write X and Y"
    if rest[0] == "%":
        return "% must be alone on its line, before the program and after it"
    if re.match(r"[GM][Oo]", rest, re.IGNORECASE):
        return f"{describe_value(shown)} is not a word: write {rest[0]}0 with a zero"
    if rest[0].isascii() and rest[0].isalpha():
        return f"{describe_value(shown)} is not a word: write a letter, then a number as 12, -0.5 or .25"
    return f"{describe_value(shown)}: not the start of a word; take it out, or put it into ( … )"


MACHINING_WORDS = frozenset({"S", "T", "M19", "G97"})
"""Words of spindle and tool that are no events: skipped, as they leave the path as it is, unless
`strict` refuses."""
IGNORABLE_LETTERS = frozenset("STHDE")
"""Speed of the spindle, tool, the numbers of its offsets, and material of a printer: left out with
any number."""
IGNORABLE_G = frozenset({40.0, 43.0, 49.0, *SYSTEMS, 80.0, 97.0})
"""Offsets of tool and work, and ends of modes. None is a path by itself; some are read in any
case."""
PATH_M = frozenset(
    map(float, (2, 30, 32, 47, 70, 71, 72, 73, 96, 97, 98, 99, 128, 198, 808, *range(810, 820)))
)
"""M words that decide which lines run or in which modes, among them calls of subprograms and macros
of printers."""
SHIFTING_M = frozenset(map(float, (206, 218, 290, 428, 665, 666, 851)))
"""M words of printers that move the origin: left out only before the first move, as an origin of
the machine."""
TEXT_WORDS = frozenset(map(float, (16, 23, 28, 117, 118, 928)))
"""M words of printers whose argument is the rest of the line, whatever it looks like."""
STOP_WORDS = frozenset((0.0, 1.0))
"""M words of stops. A printer's have a time or a text."""
ARGUMENTS: Mapping[str, str] = {
    **dict.fromkeys(("M3", "M4", "M5"), "S$"),
    "M6": "T",
    **dict.fromkeys(("M0", "M1", "M7", "M8", "M9", "M60"), ""),
    "M19": "RPQ$",
    "G43": "H",
    "G97": "S$",
}
"""Letters of the arguments of standard words in LinuxCNC; a motion may share their block."""
EXTRA_ARGUMENTS = frozenset("DEHKLPQRST")
"""Letters of the arguments that other controllers give standard M words."""


def argument_letters(letter: str, value: float) -> frozenset[str] | None:
    """Return the letters of the arguments of a word that is left out; None: all."""
    letters = ARGUMENTS.get(f"{letter}{value:g}", "" if letter == "G" else None)
    if letters is None:
        return None
    return frozenset(letters) | (EXTRA_ARGUMENTS if letter == "M" else frozenset())


def find_ignored_word(letter: str, value: float, words: frozenset[str]) -> str | None:
    """Return the word, M3 or S as `words` has it, if it is left out."""
    word = f"{letter}{value:g}"
    if word in words and is_ignorable(word):
        return word
    return letter if letter in words and _is_silent(letter, value) else None


def is_ignorable(word: str) -> bool:
    """Return whether a word without leading zeros, or all words of a letter, may be left out."""
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
    return letter in IGNORABLE_LETTERS or (letter == "M" and value not in PATH_M)
