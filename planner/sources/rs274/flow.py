"""Subprograms, loops and conditions of RS-274, as LinuxCNC has them: the order in which lines run.

| words | meaning |
|---|---|
| O1 sub, O1 endsub [value], O1 return [value] | lines that only a call runs |
| O1 call [a] [b] | runs them with a, b as #1, #2; the label may be computed: O[#2 + 100] call |
| O1 if [c], elseif [c], else, endif | the first part whose condition is not 0 |
| O1 while [c], endwhile; O1 do, while [c]; O1 repeat [n], endrepeat | loops |
| O1 break, O1 continue | leave a loop; begin its next turn |
| O1 alone, M99 | the first line and the return of a subprogram as Fanuc has it, after the end of the main program |
| M98 P1 L3 | runs subprogram O1, three times, with the parameters of its caller |

A label is a number or a <name>. Blocks close in reverse order of opening. Subs of other files are
not searched. A label alone before everything else is the number of the main program. M99 in the
main program ends it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf

from planner.sources.rs274.expressions import Cursor, ExpressionFault, Parameters, read_block
from planner.sources.source import Faults

KEYWORDS = (
    "sub", "endsub", "call", "return", "while", "endwhile", "do", "if", "elseif", "else", "endif", "repeat",
    "endrepeat", "break", "continue",
)  # fmt: skip
_NUMBERED = r"[ \t]*(?:N[ \t]*\d+[ \t]*)?"
_NAMED = r"O[ \t]*(?:<[^<>\n]*>|\d+)"
_KEYWORD = re.compile(rf"[ \t]*({'|'.join(KEYWORDS)})\b", re.IGNORECASE | re.ASCII)
_LABEL = re.compile(rf"{_NUMBERED}({_NAMED}|O[ \t]*(?=[\[#]))", re.IGNORECASE | re.ASCII)
_CALL = re.compile(r"M[ \t]*0*(9[89])(?![\d.])", re.IGNORECASE | re.ASCII)
_ANY = re.compile(
    rf"^{_NUMBERED}/?{_NUMBERED}(?:{_NAMED}[ \t]*(?:{'|'.join(KEYWORDS)})\b|O[ \t]*[\[#])"
    r"|M[ \t]*0*9[89](?![\d.])",
    re.IGNORECASE | re.MULTILINE | re.ASCII,
)
_PROGRAM = re.compile(rf"{_NUMBERED}{_NAMED}[ \t]*", re.IGNORECASE | re.ASCII)
_SLASH = re.compile(rf"({_NUMBERED})/", re.IGNORECASE | re.ASCII)
_COMMENT = re.compile(r"\([^()]*\)|;.*")
ENDS = {"endsub": "sub", "endwhile": "while", "endif": "if", "endrepeat": "repeat"}
PARTS = {"elseif": "if", "else": "if"}
PROGRAM, CALL, RETURN, COMPUTED = "program", "M98", "M99", ""
"""Kinds of lines that are no O-word with a keyword: a label alone, M98 and M99; and the label of a
computed call."""
MAX_CALLS, MAX_LINES = 20, 1_000_000


def find_flow(text: str) -> bool:
    """Return whether a file has O-words or M98, so that its lines run in another order."""
    return _ANY.search(text) is not None


def is_program_label(line: str) -> bool:
    """Return whether a line is a label alone, as O1000: the number of a program."""
    return _PROGRAM.fullmatch(line) is not None


def delete_slash(line: str, deleted: str) -> str:
    """Return a line without the slash at its beginning or after its number; "": it is skipped."""
    slash = _SLASH.match(line)
    if slash is None:
        return line
    return "" if deleted == "skip" else f"{slash[1]} {line[slash.end() :]}"


@dataclass(slots=True)
class _Word:
    """An O-word or a call.

    line, column  from 0 and from 1;  after: where its keyword ends
    parts, end, start  lines of the other parts of its block
    """

    line: int
    label: str
    keyword: str
    after: int
    column: int
    parts: tuple[int, ...] = ()
    end: int = -1
    start: int = -1


@dataclass(slots=True)
class _Call:
    """A call that runs.

    back    line that runs after it;  turns: of each repeat that was open, how many are left
    again   how often it runs again;  target: line of the label that M98 called, -1: none
    """

    back: int
    turns: dict[int, int]
    again: int = 0
    target: int = -1


class Flow:
    """A file's lines and the order in which they run.

    used      whether that is another order than they are written in
    restarts  line of an M99 that ends the main program, where a controller would start it again; 0:
              none has run
    """

    def __init__(
        self,
        text: str,
        parameters: Parameters,
        faults: Faults,
        deleted: str | None = None,
    ) -> None:
        self.parameters, self.faults = parameters, faults
        self.used = find_flow(text)
        self.lines = text.split("\n") if self.used else []
        self.words: dict[int, _Word] = {}
        self.subs: dict[str, _Word] = {}
        self.programs: dict[str, _Word] = {}
        self.restarts = 0
        self._ran = bytearray(len(self.lines))
        begun = False
        for index, line in enumerate(self.lines):
            if line.strip() == "%":
                if begun:
                    break
                begun = True
                continue
            begun = begun or self._has_words(index)
            if deleted is not None and "/" in line:
                line = self.lines[index] = delete_slash(line, deleted)
            word = self._read_word(index, line)
            if word is not None:
                self.words[index] = word
        self._pair()

    def _read_word(self, index: int, line: str) -> _Word | None:
        """Return the O-word or the call of a line, if it has one."""
        if "O" not in line.upper() and "M" not in line.upper():
            return None
        line = _COMMENT.sub(lambda comment: " " * len(comment[0]), line)
        label = _LABEL.match(line)
        if label is None:
            code = _CALL.search(line)
            if code is None:
                return None
            return _Word(index, "", f"M{code[1]}", code.end(), code.start() + 1)
        column, name = label.start(1) + 1, _normalize(label[1])
        after = label.end()
        if name == "o":
            name, after = COMPUTED, _find_value_end(line, label.end())
        keyword = _KEYWORD.match(line, after)
        if keyword is not None:
            return _Word(index, name, keyword[1].lower(), keyword.end(), column)
        if name != COMPUTED and not line[after:].strip():
            return _Word(index, name, PROGRAM, after, column)
        return None

    def count_unread(self, line: int) -> int:
        """Return how many lines after one, from 1, have words and never ran."""
        return sum(
            not ran and text.strip() not in ("", "%")
            for ran, text in zip(self._ran[line:], self.lines[line:], strict=True)
        )

    def _fault(self, word: _Word, message: str, column: int | None = None) -> None:
        self.faults.add(message, word.line + 1, f"column {column or word.column}")

    def _pair(self) -> None:
        """Find where every block ends."""
        opened: list[_Word] = []
        for word in self.words.values():
            last = opened[-1] if opened and opened[-1].label == word.label else None
            kind = None if last is None else last.keyword
            if word.label == COMPUTED and word.keyword not in (CALL, RETURN):
                if word.keyword != "call":
                    self._fault(
                        word,
                        f"the label of {word.keyword} is computed, which only call takes: write a number",
                    )
                    return
            elif word.keyword == PROGRAM:
                self._add_program(word, opened)
            elif word.keyword == "while" and kind == "do" and last is not None:
                last.end, word.start = word.line, last.line
                opened.pop()
            elif word.keyword in ("sub", "while", "do", "if", "repeat"):
                if word.keyword == "sub":
                    if word.label in self.subs:
                        self._fault(
                            word,
                            f"{word.label} sub is defined twice in this file: give it another label",
                        )
                    self.subs[word.label] = word
                opened.append(word)
            elif word.keyword in PARTS:
                if kind != "if" or last is None:
                    self._fault(
                        word,
                        f"{word.label} {word.keyword} has no {word.label} if that is open here",
                    )
                    return
                last.parts += (word.line,)
                word.start = last.line
            elif word.keyword in ENDS:
                if kind != ENDS[word.keyword] or last is None:
                    wanted = f"{word.label} {ENDS[word.keyword]}"
                    self._fault(
                        word,
                        f"{word.label} {word.keyword} has no {wanted} that is open here",
                    )
                    return
                last.end, word.start = word.line, last.line
                opened.pop()
            elif word.keyword in ("break", "continue") and not self._loop(opened, word):
                self._fault(word, f"{word.label} {word.keyword} is not inside a loop {word.label}")
            elif word.keyword == "return" and not any(one.keyword == "sub" for one in opened):
                self._fault(word, f"{word.label} return is not inside a sub")
            elif word.keyword == RETURN and any(one.keyword == "sub" for one in opened):
                self._fault(word, "M99 is inside an O-word sub: write return or endsub")
        for word in opened:
            end = {"do": "while"}.get(word.keyword, f"end{word.keyword}")
            self._fault(word, f"{word.label} {word.keyword} has no end: write {word.label} {end}")

    def _add_program(self, word: _Word, opened: list[_Word]) -> None:
        if opened:
            self._fault(
                word,
                f"{word.label} begins a subprogram inside {opened[-1].label} {opened[-1].keyword}",
            )
        if word.label in self.programs:
            self._fault(word, f"{word.label} is defined twice in this file: give it another number")
        self.programs[word.label] = word

    @staticmethod
    def _loop(opened: list[_Word], word: _Word) -> bool:
        for one in opened:
            if one.label == word.label and one.keyword in ("while", "do", "repeat"):
                word.start = one.line
                return True
        return False

    def run(self) -> Iterator[tuple[int, str]]:
        """Yield number and text of each line to read, in the order they run, up to a fault."""
        if self.faults:
            return
        at, begun = 0, False
        done = 0  # lines that ran again
        turns: dict[int, int] = {}
        calls: list[_Call] = []
        while at < len(self.lines):
            word = self.words.get(at)
            done += self._ran[at]
            self._ran[at] = 1
            if done > MAX_LINES:
                self.faults.add(
                    f"runs more than {MAX_LINES} lines again: does a loop here ever end?",
                    at + 1,
                )
                return
            if word is None:
                begun = begun or self._has_words(at)
                yield at + 1, self.lines[at]
                at += 1
                continue
            if self.faults:
                return
            try:
                if word.keyword in ("call", CALL):
                    at, turns = self._call(word, calls, turns)
                elif word.keyword == RETURN and not calls:
                    self._check_alone(word)
                    self.restarts = at + 1
                    return
                elif word.keyword in ("return", "endsub", RETURN):
                    at, turns = self._return(word, calls, turns)
                elif word.keyword == PROGRAM:
                    if begun or calls:
                        self._fault(word, self._describe_fall(word, calls))
                        return
                    at += 1
                else:
                    at = self._step(word, turns)
            except ExpressionFault as error:
                self._fault(word, str(error), error.column)
                return
        if calls and calls[-1].target >= 0:
            word = self.words[calls[-1].target]
            self._fault(
                word,
                f"{word.label} has no M99, which returns to its caller: write it at its end",
            )

    def _has_words(self, at: int) -> bool:
        return _COMMENT.sub("", self.lines[at]).strip() not in ("", "%")

    def _describe_fall(self, word: _Word, calls: list[_Call]) -> str:
        if calls:
            return f"the subprogram before {word.label} has no M99, which returns to its caller: write it there"
        return f"{word.label} begins a subprogram, and the program does not end before it: write M30 or M2 there"

    def _call(
        self,
        word: _Word,
        calls: list[_Call],
        turns: dict[int, int],
    ) -> tuple[int, dict[int, int]]:
        """Return the first line that an O-word or M98 calls, and the open loops there."""
        if len(calls) == MAX_CALLS:
            raise ExpressionFault(word.column, f"calls within calls: more than {MAX_CALLS} deep")
        back = word.line + 1
        if word.keyword == CALL:
            label, count = self._read_call(word)
            target = self.programs.get(label)
            if target is None:
                other = (
                    f"; {label} sub is called by {label} call"
                    if label in self.subs
                    else ": add it there"
                )
                raise ExpressionFault(
                    word.column,
                    f"{label} is not a subprogram of this file{other}",
                )
            if count == 0:
                return back, turns
            self.parameters.enter(None)
            calls.append(_Call(back, turns, count - 1, target.line))
            self._ran[target.line] = 1
            return target.line + 1, {}
        label = word.label or self._compute_label(word)
        if label not in self.subs:
            other = (
                f"; subprogram {label} is called by M98"
                if label in self.programs
                else ": add it there"
            )
            raise ExpressionFault(word.column, f"{label} is not a sub of this file{other}")
        self.parameters.enter(self._values(word, None))
        calls.append(_Call(back, turns))
        line = self.subs[label].line
        self._ran[line] = 1
        return line + 1, {}

    def _return(
        self,
        word: _Word,
        calls: list[_Call],
        turns: dict[int, int],
    ) -> tuple[int, dict[int, int]]:
        """Return the line that runs after a return, and the open loops there."""
        call = calls.pop()
        if (word.keyword == RETURN) != (call.target >= 0):
            end = "M99" if call.target >= 0 else "return or endsub"
            raise ExpressionFault(
                word.column,
                f"{word.keyword} ends no subprogram of this kind: write {end}",
            )
        if word.keyword == RETURN:
            self._check_alone(word)
        values = [] if word.keyword == RETURN else self._values(word, None)
        self.parameters.leave(values[0] if values else None)
        if call.again == 0:
            return call.back, call.turns
        self.parameters.enter(None)
        calls.append(_Call(call.back, call.turns, call.again - 1, call.target))
        return call.target + 1, {}

    def _read_call(self, word: _Word) -> tuple[str, int]:
        """Return the label that M98 calls, and how often. Raises ExpressionFault."""
        values = self._read_words(word)
        if values.keys() - {"P", "L", "N"} or "P" not in values:
            raise ExpressionFault(
                word.column,
                "M98 takes P, the number of a subprogram, and L, and shares its line with no other word",
            )
        for letter, most in (("P", inf), ("L", MAX_LINES)):
            value = values.get(letter, 1.0)
            if value != round(value) or not 0 <= value <= most:
                raise ExpressionFault(
                    word.column,
                    f"M98: {letter}{value:g} must be a whole number, not negative",
                )
        return f"o{round(values['P'])}", round(values.get("L", 1.0))

    def _check_alone(self, word: _Word) -> None:
        if self._read_words(word).keys() - {"N"}:
            raise ExpressionFault(
                word.column,
                "M99 shares its line with no other word: put them on other lines",
            )

    def _read_words(self, word: _Word) -> dict[str, float]:
        """Return the other words of a line with M98 or M99, by letter."""
        line = _COMMENT.sub(lambda comment: " " * len(comment[0]), self.lines[word.line])
        code = line[word.column - 1 : word.after]
        words, _ = read_block(line.replace(code, " " * len(code), 1), self.parameters)
        return {letter.upper(): float(value) for letter, value in words}

    def _compute_label(self, word: _Word) -> str:
        """Return the label of a call that the file computes. Raises ExpressionFault."""
        line = self.lines[word.line]
        cursor = Cursor(line, word.column, self.parameters)
        number = cursor.value()
        if abs(number - round(number)) > 1e-4 or number < 0:
            raise ExpressionFault(word.column, f"O{number:g} is no label: labels are whole numbers")
        return f"o{round(number)}"

    def _step(self, word: _Word, turns: dict[int, int]) -> int:
        """Return the line that runs next, from 0, after an O-word of a block."""
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
        """Return the line after the first part of a condition that holds."""
        if self._values(word, 1)[0] != 0:
            return word.line + 1
        for line in word.parts:
            part = self.words[line]
            if part.keyword == "else" or self._values(part, 1)[0] != 0:
                return line + 1
        return word.end + 1

    def _values(self, word: _Word, count: int | None) -> list[float]:
        """Return the values in brackets after an O-word; count: how many it needs, None: any."""
        line = _COMMENT.sub(lambda comment: " " * len(comment[0]), self.lines[word.line])
        cursor, values = Cursor(line, word.after, self.parameters), list[float]()
        while cursor.next == "[":
            values.append(cursor.value())
        if cursor.next:
            raise ExpressionFault(
                cursor.at + 1,
                f"{word.keyword} takes nothing but values in brackets, as [#1 LT 5]",
            )
        if count is not None and len(values) != count:
            raise ExpressionFault(
                word.column,
                f"{word.keyword} needs a value in brackets, as [#1 LT 5]",
            )
        return values


def _normalize(label: str) -> str:
    """Return a label without blanks and leading zeros, in lower case: O 0100 is o100."""
    label = re.sub(r"[ \t]", "", label).lower()
    return f"o{int(label[1:])}" if label[1:].isdigit() else label


def _find_value_end(line: str, at: int) -> int:
    """Return where a value in brackets or a parameter ends; the line's end if it does not."""
    depth = 0
    for k in range(at, len(line)):
        if line[k] == "#" and depth == 0:
            name = re.compile(r"#+[ \t]*(?:<[^<>]*>|\d+)").match(line, k)
            return name.end() if name else len(line)
        depth += (line[k] == "[") - (line[k] == "]")
        if depth == 0:
            return k + 1
    return len(line)
