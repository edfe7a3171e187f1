"""The console's front: at a terminal a prompt with history and completion, else a script from a pipe."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

from controllers.console.grammar import OPERATOR, TURNS
from controllers.console.links import Link
from controllers.console.serve import Server
from pulsepath.line_editor import CLEAR, END, Editor

LEAVE = ("EXIT", "QUIT")
WIPE = "\r\x1b[K"
"""To the beginning of the terminal's line, and nothing on it."""


class Screen:
    """A terminal's last line: the prompt and what is typed at it, below all that is said."""

    __slots__ = ("_drawn", "editor", "typed")

    def __init__(self, names: tuple[str, ...]) -> None:
        self.editor = Editor((*OPERATOR, *LEAVE, *TURNS, *names), leave=LEAVE[0])
        self.typed, self._drawn = b"", ""

    def draw(self, mode: str) -> None:
        """The prompt of a mode, if it is not there already; of a long line the end."""
        ask = f"{mode}> "
        room = max(_columns() - len(ask) - 1, 1)
        shown = ask + self.editor.text[-room:]
        if shown != self._drawn:
            _show(WIPE + shown)
            self._drawn = shown

    def wipe(self) -> None:
        """Make room for something to be said."""
        if self._drawn:
            _show(WIPE)
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
    with _keys():
        while not _left(server, screen):
            screen.draw(server.desk.session.mode)
            server.step()
        screen.leave()
        server.until(lambda _: server.standing)


def _left(server: Server, screen: Screen) -> bool:
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
        if line.upper() in LEAVE:
            return True
        screen.draw(server.desk.session.mode)
        screen.leave()
        if line:
            server.step()  # what remote lines have said by now was said in the mode of before
            server.say(line)
    return False


@contextmanager
def _keys() -> Iterator[None]:
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
