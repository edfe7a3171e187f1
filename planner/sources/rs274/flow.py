"""O-words of RS-274, as LinuxCNC has them: subroutines, loops and conditions, and in which order lines run.

| words | meaning |
|---|---|
| O1 sub, O1 endsub [value], O1 return [value] | lines that only a call runs |
| O1 call [a] [b] | runs them with a, b as #1, #2 |
| O1 if [c], elseif [c], else, endif | the first part whose condition is not 0 |
| O1 while [c], endwhile; O1 do, while [c]; O1 repeat [n], endrepeat | loops |
| O1 break, O1 continue | out of a loop, or to its next turn |

A label is a number or a <name>. Blocks close in the order in which they open. A sub of another file is not looked for.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass

from planner.sources.rs274.expressions import Cursor, ExpressionFault, Parameters
from planner.sources.source import Faults

KEYWORDS = (
    "sub", "endsub", "call", "return", "while", "endwhile", "do", "if", "elseif", "else", "endif", "repeat",
    "endrepeat", "break", "continue",
)  # fmt: skip
_LABEL = r"O[ \t]*(?:<[^<>\n]*>|\d+)"
_LINE = re.compile(rf"[ \t]*(?:N[ \t]*\d+[ \t]*)?({_LABEL})[ \t]*({'|'.join(KEYWORDS)})\b", re.IGNORECASE | re.ASCII)
_ANY = re.compile(rf"^[ \t]*(?:N[ \t]*\d+[ \t]*)?{_LABEL}[ \t]*(?:{'|'.join(KEYWORDS)})\b", re.I | re.M | re.A)
_COMMENT = re.compile(r"\([^()]*\)|;.*")
ENDS = {"endsub": "sub", "endwhile": "while", "endif": "if", "endrepeat": "repeat"}
PARTS = {"elseif": "if", "else": "if"}
MAX_CALLS, MAX_LINES = 20, 1_000_000


def find_flow(text: str) -> bool:
    """Whether a file has O-words, so that its lines run in another order than they stand in."""
    return _ANY.search(text) is not None


@dataclass(slots=True)
class _Word:
    """An O-word: its line, from 0, label, keyword and the place behind it; of a block its parts and its end."""

    line: int
    label: str
    keyword: str
    behind: int
    column: int
    parts: tuple[int, ...] = ()
    end: int = -1
    start: int = -1


class Flow:
    """A file with O-words: which of its lines runs when."""

    def __init__(self, text: str, parameters: Parameters, faults: Faults) -> None:
        self.lines = text.split("\n")
        self.parameters, self.faults = parameters, faults
        self.words: dict[int, _Word] = {}
        self.subs: dict[str, _Word] = {}
        for index, line in enumerate(self.lines):
            if (found := _LINE.match(line)) is not None:
                label = re.sub(r"[ \t]", "", found[1]).lower()
                self.words[index] = _Word(index, label, found[2].lower(), found.end(), found.start(1) + 1)
        self._pair()

    def _fault(self, word: _Word, told: str, column: int | None = None) -> None:
        self.faults.add(told, word.line + 1, f"column {column or word.column}")

    def _pair(self) -> None:
        """Where every block ends."""
        opened: list[_Word] = []
        for word in self.words.values():
            last = opened[-1] if opened and opened[-1].label == word.label else None
            kind = None if last is None else last.keyword
            if word.keyword == "while" and kind == "do" and last is not None:
                last.end, word.start = word.line, last.line
                opened.pop()
            elif word.keyword in ("sub", "while", "do", "if", "repeat"):
                if word.keyword == "sub":
                    if word.label in self.subs:
                        self._fault(word, f"{word.label} sub is defined twice in this file: give it another label")
                    self.subs[word.label] = word
                opened.append(word)
            elif word.keyword in PARTS:
                if kind != "if" or last is None:
                    self._fault(word, f"{word.label} {word.keyword} has no {word.label} if that is open here")
                    return
                last.parts += (word.line,)
                word.start = last.line
            elif word.keyword in ENDS:
                if kind != ENDS[word.keyword] or last is None:
                    wanted = f"{word.label} {ENDS[word.keyword]}"
                    self._fault(word, f"{word.label} {word.keyword} has no {wanted} that is open here")
                    return
                last.end, word.start = word.line, last.line
                opened.pop()
            elif word.keyword in ("break", "continue") and not self._loop(opened, word):
                self._fault(word, f"{word.label} {word.keyword} is not inside a loop {word.label}")
            elif word.keyword == "return" and not any(one.keyword == "sub" for one in opened):
                self._fault(word, f"{word.label} return is not inside a sub")
        for word in opened:
            end = {"do": "while"}.get(word.keyword, f"end{word.keyword}")
            self._fault(word, f"{word.label} {word.keyword} has no end: write {word.label} {end}")

    @staticmethod
    def _loop(opened: list[_Word], word: _Word) -> bool:
        for one in opened:
            if one.label == word.label and one.keyword in ("while", "do", "repeat"):
                word.start = one.line
                return True
        return False

    def run(self) -> Iterator[tuple[int, str]]:
        """Number and text of each line that is no O-word, in the order in which they run; ends at the first fault."""
        if self.faults:
            return
        at, done = 0, 0
        calls: list[tuple[int, dict[int, int]]] = []
        turns: dict[int, int] = {}  # of each repeat that is open, how many are left
        while at < len(self.lines):
            word = self.words.get(at)
            done += 1
            if done > MAX_LINES:
                self.faults.add(f"runs more than {MAX_LINES} lines: does a loop here ever end?", at + 1)
                return
            if word is None:
                yield at + 1, self.lines[at]
                at += 1
                continue
            if self.faults:
                return
            try:
                if word.keyword == "call":
                    if len(calls) == MAX_CALLS:
                        raise ExpressionFault(word.column, f"calls within calls: more than {MAX_CALLS} deep")
                    if word.label not in self.subs:
                        raise ExpressionFault(word.column, f"{word.label} is not a sub of this file: add it there")
                    self.parameters.enter(self._values(word, None))
                    calls.append((at + 1, turns))
                    at, turns = self.subs[word.label].line + 1, {}
                elif word.keyword in ("return", "endsub"):
                    given = self._values(word, None)
                    self.parameters.leave()
                    at, turns = calls.pop()
                    for value in given[:1]:
                        self.parameters.set("_value", value)
                else:
                    at = self._step(word, turns)
            except ExpressionFault as wrong:
                self._fault(word, str(wrong), wrong.column)
                return

    def _step(self, word: _Word, turns: dict[int, int]) -> int:
        """The line that comes next, from 0, behind an O-word that is no call."""
        keyword, here = word.keyword, word.line
        if keyword == "sub":
            return word.end + 1
        if keyword in ("elseif", "else"):  # the part before has run
            return self.words[word.start].end + 1
        if keyword == "if":
            return self._choose(word)
        if keyword == "while":
            holds = self._values(word, 1)[0] != 0
            if word.start >= 0:  # of a do
                return word.start + 1 if holds else here + 1
            return here + 1 if holds else word.end + 1
        if keyword == "endwhile":
            return word.start
        if keyword == "repeat":
            turns[here] = round(self._values(word, 1)[0])
            return here + 1 if turns[here] > 0 else word.end + 1
        if keyword == "endrepeat":
            turns[word.start] -= 1
            return word.start + 1 if turns[word.start] > 0 else here + 1
        if keyword in ("break", "continue"):
            loop = self.words[word.start]
            if keyword == "break":
                return loop.end + 1
            return loop.line if loop.keyword == "while" else loop.end
        return here + 1  # endif, do

    def _choose(self, word: _Word) -> int:
        """The first part of a condition that holds."""
        if self._values(word, 1)[0] != 0:
            return word.line + 1
        for line in word.parts:
            part = self.words[line]
            if part.keyword == "else" or self._values(part, 1)[0] != 0:
                return line + 1
        return word.end + 1

    def _values(self, word: _Word, count: int | None) -> list[float]:
        """The values in brackets behind an O-word; count: how many it needs, None: any number."""
        line = _COMMENT.sub(lambda comment: " " * len(comment[0]), self.lines[word.line])
        cursor, found = Cursor(line, word.behind, self.parameters), list[float]()
        while cursor.next == "[":
            found.append(cursor.value())
        if cursor.next:
            raise ExpressionFault(cursor.at + 1, f"{word.keyword} takes nothing but values in brackets, as [#1 LT 5]")
        if count is not None and len(found) != count:
            raise ExpressionFault(word.column, f"{word.keyword} needs a value in brackets, as [#1 LT 5]")
        return found
