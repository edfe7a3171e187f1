"""A line as it is typed, key by key, so that nobody waits for its end: backspace, history, completion."""

from collections.abc import Sequence
from itertools import takewhile

from controllers.console.lines import LONGEST, THETA

ENTER, ERASE, TAB, ESCAPE, CLEAR, END = b"\r\n", b"\x08\x7f", b"\t", b"\x1b", b"\x15", b"\x04"
UP, DOWN = "A", "B"
"""Final characters of the arrow keys' sequences, ESC [ A or ESC O A."""


class Editor:
    """What is typed so far (`text`), and what was typed before.

    words  that Tab completes, in capitals
    leave  the line that Ctrl-D stands for where nothing is typed yet
    """

    __slots__ = ("_begun", "_escape", "_history", "_kept", "_leave", "_place", "_words", "text")

    def __init__(self, words: Sequence[str] = (), leave: str = "") -> None:
        self._words, self._leave = tuple(words), leave
        self.text = self._kept = self._escape = ""
        self._history: list[str] = []
        self._place = 0
        self._begun = b""

    def press(self, key: int) -> str | None:
        """With one byte from the keyboard: the line that it ends, if it does; keys without a meaning have none."""
        byte, begun, self._begun = bytes([key]), self._begun, b""
        if self._escape or byte == ESCAPE:
            self._sequence(chr(key))
        elif byte in ENTER:
            return self._entered()
        elif byte in ERASE:
            self.text = self.text[:-1]
        elif byte == CLEAR:
            self.text = ""
        elif byte == TAB:
            self._complete()
        elif byte == END:
            return None if self.text else self._leave
        elif 0x20 <= key < 0x7F and len(self.text) <= LONGEST:
            self.text += chr(key)
        elif begun + byte in THETA and len(self.text) <= LONGEST:
            self.text += (begun + byte).decode()
        elif any(theta.startswith(byte) for theta in THETA):
            self._begun = byte
        return None

    def _entered(self) -> str:
        line, self.text = self.text, ""
        if line.strip() and line not in self._history[-1:]:
            self._history.append(line)
        self._place = len(self._history)
        return line

    def _sequence(self, key: str) -> None:
        self._escape += key
        if len(self._escape) == 1 or (len(self._escape) == 2 and key in "[O"):
            return
        if len(self._escape) == 2 or "@" <= key <= "~":
            step = {UP: -1, DOWN: 1}.get(key, 0) if len(self._escape) == 3 else 0
            self._escape = ""
            self._turn(step)

    def _turn(self, step: int) -> None:
        """Through the history; below its newest line is what was being typed."""
        place = min(max(self._place + step, 0), len(self._history))
        if place == self._place:
            return
        if self._place == len(self._history):
            self._kept = self.text
        self.text = self._kept if place == len(self._history) else self._history[place]
        self._place = place

    def _complete(self) -> None:
        before, space, word = self.text.rpartition(" ")
        found = [candidate for candidate in self._words if candidate.startswith(word.upper())]
        if len(found) == 1:
            self.text = f"{before}{space}{found[0]} "
        elif found and word:
            shared = takewhile(lambda letters: len(set(letters)) == 1, zip(*found, strict=False))
            self.text = before + space + "".join(letters[0] for letters in shared)
