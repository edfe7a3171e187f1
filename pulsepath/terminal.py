"""The console's front: at a terminal a prompt with history and completion, else a script from a pipe.

A line as it is typed, key by key, so that nobody waits for its end: backspace, history, completion.
"""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import takewhile

from controllers.console.grammar import OPERATOR_COMMANDS, TURNS
from controllers.console.links import MAX_LINE_BYTES, THETA, Link
from controllers.console.serve import Server

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
        elif 0x20 <= key < 0x7F and len(self.text) <= MAX_LINE_BYTES:
            self.text += chr(key)
        elif begun + byte in THETA and len(self.text) <= MAX_LINE_BYTES:
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


LEAVE_WORDS = ("EXIT", "QUIT")
WIPE_SEQUENCE = "\r\x1b[K"
"""To the beginning of the terminal's line, and nothing on it."""


class Screen:
    """A terminal's last line: the prompt and what is typed at it, below all that is said."""

    __slots__ = ("_drawn", "editor", "typed")

    def __init__(self, names: tuple[str, ...]) -> None:
        self.editor = Editor((*OPERATOR_COMMANDS, *LEAVE_WORDS, *TURNS, *names), leave=LEAVE_WORDS[0])
        self.typed, self._drawn = b"", ""

    def draw(self, mode: str) -> None:
        """The prompt of a mode, if it is not there already; of a long line the end."""
        ask = f"{mode}> "
        room = max(_columns() - len(ask) - 1, 1)
        shown = ask + self.editor.text[-room:]
        if shown != self._drawn:
            _show(WIPE_SEQUENCE + shown)
            self._drawn = shown

    def wipe(self) -> None:
        """Make room for something to be said."""
        if self._drawn:
            _show(WIPE_SEQUENCE)
            self._drawn = ""

    def leave(self) -> None:
        """Let what is typed stand, and begin a new line."""
        _show("\n")
        self._drawn = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal(Link):
    """Keyboard and screen: keys are kept for the prompt, which makes lines of them."""

    screen: Screen

    def received(self) -> bytes | None:
        with suppress(OSError):  # the terminal has been hung up
            if keys := os.read(sys.stdin.fileno(), 4096):
                self.screen.typed += keys
                return b""
        self.screen.typed += CLEAR + END
        return None

    def sent(self, data: bytes) -> bytes | None:
        self.screen.wipe()
        return Link.sent(self, data)


def terminal(names: tuple[str, ...]) -> Terminal:
    """Standard input and output, where these are a terminal; names: of the axes, which Tab completes."""
    screen = Screen(names)
    return Terminal(sys.stdin.fileno(), sys.stdout.fileno(), "console", lambda: None, line_end="\n", screen=screen)


def script(server: Server, remote: bool) -> None:
    """Serve until the script has ended and all stands; with a remote line, in mode REM, until interrupted."""
    server.until(
        lambda desk: not server.script_left and server.standing and not (remote and desk.session.mode == "REM")
    )


def prompt(server: Server, screen: Screen) -> None:
    """Serve at a terminal, until EXIT or the end of input. Any key ends a jog.

    Nothing here waits for a key: remote lines are served, and motions end, while a line is half typed.
    """
    with _raw_key_mode():
        while not _process_keys(server, screen):
            screen.draw(server.desk.session.mode)
            server.step()
        screen.leave()
        server.until(lambda _: server.standing)


def _process_keys(server: Server, screen: Screen) -> bool:
    """Whether the keys that have come end the session; lines among them are said."""
    while screen.typed:
        key, screen.typed = screen.typed[0], screen.typed[1:]
        if server.desk.session.jogging:
            screen.typed = b""
            server.say("STOP")
            return False
        entered = screen.editor.press(key)
        if entered is None:
            continue
        line = entered.strip()
        if line.upper() in LEAVE_WORDS:
            return True
        screen.draw(server.desk.session.mode)
        screen.leave()
        if line:
            server.step()  # what remote lines have said by now was said in the mode of before
            server.say(line)
    return False


@contextmanager
def _raw_key_mode() -> Iterator[None]:
    """Keys as they are pressed, and not shown: the prompt shows them."""
    import termios
    import tty

    kept = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin, termios.TCSANOW)
        yield
    finally:
        with suppress(termios.error):  # the terminal has been hung up
            termios.tcsetattr(sys.stdin, termios.TCSANOW, kept)


def _columns() -> int:
    with suppress(OSError):
        return os.get_terminal_size(sys.stdout.fileno()).columns or 80
    return 80


def _show(text: str) -> None:
    with suppress(OSError):  # nobody looks any more; the keyboard's end tells
        os.write(sys.stdout.fileno(), text.encode(sys.stdout.encoding or "ascii", "replace"))
