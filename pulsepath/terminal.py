"""The console at a terminal: a prompt with history and completion.

prompt_toolkit draws the prompt in a thread of its own. The server stays in the main thread, which
gets the signals, and waits for no key: remote lines are served, and motions end, while a line is
half typed.
"""

import asyncio
import os
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from threading import Thread

from prompt_toolkit import PromptSession
from prompt_toolkit.application import run_in_terminal
from prompt_toolkit.completion import WordCompleter
from prompt_toolkit.filters import Condition
from prompt_toolkit.input.vt100 import Vt100Input
from prompt_toolkit.key_binding import KeyBindings
from prompt_toolkit.keys import Keys
from prompt_toolkit.output.vt100 import Vt100_Output
from prompt_toolkit.shortcuts import CompleteStyle

from controllers.console.grammar import OPERATOR_COMMANDS, TURNS
from controllers.console.links import Link
from controllers.console.serve import Server
from pulsepath.process.ending import on_forced_end

LEAVE_WORDS = ("EXIT", "QUIT")
# s after which an ESC is that key, and not the beginning of another key's sequence.
ESCAPE_TIME = 0.05


class Keyboard(Vt100Input):
    """Standard input in its present mode, in which Ctrl-C is a signal."""

    def raw_mode(self) -> nullcontext[None]:
        return nullcontext()

    cooked_mode = raw_mode


class Screen(Vt100_Output):
    """Standard output. Pasted lines count as typed, and the terminal need not report its cursor."""

    responds_to_cpr = False

    def enable_bracketed_paste(self) -> None:
        pass


@dataclass(frozen=True, slots=True, kw_only=True)
class Terminal(Link):
    """Keyboard and screen. The server reads a pipe, which wakes it for a typed line and for STOP.

    wake: the pipe's other end
    loop: of the prompt's thread, while there is one
    """

    wake: int
    loop: asyncio.AbstractEventLoop
    session: PromptSession[str]

    def send_bytes(self, data: bytes) -> bytes | None:
        return self.show(partial(Link.send_bytes, self, data))

    def show(self, write: Callable[[], bytes | None]) -> bytes | None:
        """Write above the prompt, if there is one."""

        async def write_above() -> bytes | None:
            return await run_in_terminal(write)

        with suppress(OSError):  # a terminal that has hung up draws no prompt
            if self.loop.is_running():
                return asyncio.run_coroutine_threadsafe(write_above(), self.loop).result()
        return write()

    def prompt(self, server: Server) -> None:
        """Serve until EXIT or the end of input. Any key ends a jog."""
        keys = KeyBindings()

        @keys.add(Keys.Any, eager=True, filter=Condition(lambda: server.desk.session.jogging))
        def stop(_: object) -> None:
            os.write(self.wake, b"STOP\n")

        self.session.key_bindings = keys
        with _read_single_keys(), _run_in_thread(self.loop):
            while (line := self._next_line(server)).upper() not in LEAVE_WORDS:
                server.say(line)
        server.serve_until(lambda _: server.is_idle)

    def _next_line(self, server: Server) -> str:
        prompt = self.session.prompt_async(
            lambda: f"{server.desk.session.mode}> ",
            set_exception_handler=False,
        )
        line = asyncio.run_coroutine_threadsafe(prompt, self.loop)
        line.add_done_callback(lambda _: os.write(self.wake, b"\n"))
        while not line.done():
            server.step()
        server.step()  # remote lines that came before this one are served in the mode before it
        try:
            return line.result().strip()
        except (EOFError, OSError):  # Ctrl-D on an empty line; a terminal that has hung up
            return LEAVE_WORDS[0]


def open_terminal(names: tuple[str, ...]) -> Terminal:
    """Return standard input and output as a terminal. names: of the axes, which Tab completes."""
    words = [f"{word} " for word in (*OPERATOR_COMMANDS, *LEAVE_WORDS, *TURNS, *names)]
    session: PromptSession[str] = PromptSession(
        completer=WordCompleter(words, ignore_case=True),
        complete_style=CompleteStyle.READLINE_LIKE,
        complete_while_typing=False,
        input=Keyboard(sys.stdin),
        output=Screen.from_pty(sys.stdout, term=os.environ.get("TERM")),
    )
    session.app.ttimeoutlen = ESCAPE_TIME
    reads, wake = os.pipe()
    return Terminal(
        reads,
        sys.stdout.fileno(),
        "console",
        lambda: None,
        line_end="\n",
        wake=wake,
        loop=asyncio.new_event_loop(),
        session=session,
    )


@contextmanager
def _run_in_thread(loop: asyncio.AbstractEventLoop) -> Iterator[None]:
    """Run the loop in a thread of its own. At the end, its tasks are cancelled."""
    over = asyncio.Event()

    def run() -> None:
        with asyncio.Runner(loop_factory=lambda: loop) as runner:
            runner.run(over.wait())

    thread = Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        loop.call_soon_threadsafe(over.set)
        thread.join()


@contextmanager
def _read_single_keys() -> Iterator[None]:
    """Read keys as they are pressed, and do not show them: the prompt does."""
    before = termios.tcgetattr(sys.stdin)

    def restore() -> None:
        with suppress(termios.error):  # the terminal has hung up
            termios.tcsetattr(sys.stdin, termios.TCSANOW, before)

    try:
        tty.setcbreak(sys.stdin, termios.TCSANOW)
        with on_forced_end(restore):
            yield
    finally:
        restore()
