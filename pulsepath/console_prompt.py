"""The console's front: at a terminal a prompt with history and completion, else a script from a pipe."""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from controllers.console.grammar import OPERATOR
from controllers.console.serve import Server

LEAVE = ("EXIT", "QUIT")
TURNS = ("CW", "CCW")


def script(server: Server, remote: bool) -> None:
    """Serve until the script has ended and all stands; with a remote line, in mode REM, until interrupted."""
    server.until(
        lambda desk: not server.script_left and server.standing and not (remote and desk.session.mode == "REM")
    )


def prompt(server: Server) -> None:
    """Serve at a terminal, until EXIT or the end of input. Any key ends a jog."""
    _completing((*OPERATOR, *LEAVE, *TURNS, *server.desk.session.drives.names))
    while True:
        stands = server.desk.end is None
        ask = f"{server.desk.session.mode}> "
        if stands:
            sys.stdout.write(f"\r{ask}")
            sys.stdout.flush()
        with _keys():
            server.until(lambda desk, was=stands: _pressed() or (desk.end is None) != was)  # type: ignore[misc]
            if _pressed() and server.desk.session.jogging:
                os.read(sys.stdin.fileno(), 4096)
                server.say("STOP")
                continue
        if not _pressed():
            continue
        sys.stdout.write("\r")
        try:
            line = input(ask).strip()
        except EOFError:
            break
        server.step()  # what remote lines have said by now was said in the mode of before
        if line.upper() in LEAVE:
            break
        if line:
            server.say(line)
    server.until(lambda _: server.standing)


def _pressed() -> bool:
    return bool(select.select([sys.stdin], [], [], 0)[0])


@contextmanager
def _keys() -> Iterator[None]:
    """Keys as they are pressed, and not shown: whoever takes them shows them."""
    import termios
    import tty

    kept = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin, termios.TCSANOW)
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSANOW, kept)


def _completing(words: tuple[str, ...]) -> None:
    """Let readline, where Python has it, complete words and keep the session's history."""
    try:
        import readline
    except ImportError:
        return

    def complete(text: str, state: int) -> str | None:
        found = [word + " " for word in words if word.startswith(text.upper())]
        return found[state] if state < len(found) else None

    readline.set_completer(complete)
    readline.set_completer_delims(" \t")
    readline.parse_and_bind("tab: complete")
