"""Signals that end a command: Ctrl-C, a request to end, a terminal that hangs up.

Python calls the handler of a signal in the main thread, between two of its instructions. The
handler raises EndSignal, so that every `with` block cleans up, which takes a fraction of a second.
A library that computes for long delays the handler, and some libraries swallow the exception. So
`watch` starts a thread that the system itself wakes [signal.set_wakeup_fd]. GRACE_PERIOD after the
first signal, or at a second one, this thread cleans up and ends the process.

Only `pulsepath` as a program is watched. A program that calls its functions keeps its own signals.
"""

import atexit
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from threading import Thread, main_thread
from types import FrameType
from typing import Any, NoReturn

from pulsepath.process import intent

# Signals that end a command in good order. A system may lack some.
SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
# s for an end in good order. A signal ends a command within 2 s: the rest is for a busy computer.
GRACE_PERIOD = 1.4
# s within which a signal is the same one again: `timeout` and some shells send it twice.
REPEAT_TIME = 0.25
# s between two attempts to raise EndSignal in a main thread that is inside one of UNSAFE_MODULES.
RETRY_PERIOD = 0.005
# CasADi discards exceptions of Python code that it calls; a module would be left half loaded.
UNSAFE_MODULES = ("casadi.casadi", "importlib._bootstrap", "_frozen_importlib")


class EndSignal(KeyboardInterrupt):
    """A signal that ends the command. code: 128 and its number, as in shells."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number


@dataclass
class _State:
    """The end of this process, as its main thread and the watching thread know it.

    watched: a thread watches
    postponed: the handler came inside one of UNSAFE_MODULES and did not raise
    grace: s from the first signal to a forced end
    signal_code: exit code of the signal for which EndSignal was raised; None: none was
    code: exit code; None until the command has printed its last message
    """

    watched: bool = False
    postponed: bool = False
    grace: float = GRACE_PERIOD
    signal_code: int | None = None
    code: int | None = None


_STATE = _State()
_ACTIONS: list[Callable[[], None]] = []


@contextmanager
def raise_on_signal() -> Iterator[None]:
    """Let the first signal raise EndSignal; further ones do not interrupt the clean-up.

    A signal that is ignored already, as under nohup, stays ignored. Once the block has ended, a
    watched process is about to end: it ends as it would, and if it does not within GRACE_PERIOD
    after a signal, the watching thread ends it.
    """
    _STATE.signal_code = None
    # The frame of the with statement: those of this function and of contextlib end before its body.
    outermost = sys._getframe(2)
    before: dict[int, Any] = {}

    def end(number: int, frame: FrameType | None) -> None:
        if _STATE.watched and _is_unsafe(frame, outermost):
            _STATE.postponed = True  # the watching thread sends the signal again
            return
        for each in before:
            signal.signal(each, _ignore)
        raised = EndSignal(number)
        _STATE.signal_code = raised.code
        raise raised

    try:
        for number in _list_numbers():
            handler = signal.getsignal(number)
            if handler is not signal.SIG_IGN:
                before[number] = handler
                signal.signal(number, end)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, _ignore if _STATE.watched else handler)


def get_signal_code() -> int | None:
    """Return the exit code of the signal that interrupted the command; None: none did.

    A library may turn EndSignal into an exception of its own.
    """
    return _STATE.signal_code


def _list_numbers() -> list[int]:
    """Return the numbers of the signals that end a command."""
    return [getattr(signal, name) for name in SIGNAL_NAMES if hasattr(signal, name)]


def _ignore(number: int, frame: FrameType | None) -> None:
    """Leave a signal to the watching thread."""


def _ignore_from_now() -> None:
    """Let signals do nothing while the interpreter takes itself apart: it has no handlers then."""
    for number in _list_numbers():
        signal.signal(number, signal.SIG_IGN)


def _is_unsafe(frame: FrameType | None, outermost: FrameType) -> bool:
    """Return whether an exception raised in a frame would be lost or do harm."""
    while frame is not None and frame is not outermost:
        if frame.f_globals.get("__name__") in UNSAFE_MODULES:
            return True
        frame = frame.f_back
    return False


def watch() -> None:
    """Start the thread that ends this process if a signal alone does not."""
    if os.name != "posix":
        return
    atexit.register(_ignore_from_now)  # registered first, it runs last
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    # A signal to a child does not end its parent.
    os.register_at_fork(after_in_child=partial(signal.set_wakeup_fd, -1))
    _STATE.watched = True
    Thread(target=_watch, args=(reading,), daemon=True).start()


def allow_time(grace: float) -> None:
    """Give the command more time (s) to end; until then further signals do nothing."""
    _STATE.grace = grace


def set_exit_code(code: int) -> None:
    """Set the exit code of a command that a signal ended, once it has printed its last message."""
    _STATE.code = code


@contextmanager
def on_forced_end(action: Callable[[], None]) -> Iterator[None]:
    """Let a forced end during the block do something first, such as ending a child process."""
    _ACTIONS.append(action)
    try:
        yield
    finally:
        _ACTIONS.remove(action)


def leave() -> None:
    """End the process at once if a signal has ended its command.

    The interpreter's own end would wait for threads, and crash a compiler that runs in one.
    """
    if not _STATE.watched or _STATE.code is None:
        return
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(_STATE.code)


def _watch(reading: int) -> None:
    """Wait for the first signal, then until its grace period ends or a second signal comes."""
    number = None
    while number is None:
        number = _read_signal(reading, None)
    begin = time.monotonic()
    repeat_end = begin + REPEAT_TIME
    while (now := time.monotonic()) < begin + _STATE.grace:
        again = _read_signal(reading, RETRY_PERIOD)
        if _STATE.postponed:
            _STATE.postponed = False
            repeat_end = now + REPEAT_TIME  # a signal sent here is no second one
            signal.pthread_kill(main_thread().ident or 0, number)
        elif again is not None and now > repeat_end and _STATE.grace == GRACE_PERIOD:
            break
    _force_end(number)


def _read_signal(reading: int, timeout: float | None) -> int | None:
    """Return the number of a signal that ends a command; None: none came."""
    ready, _, _ = select.select([reading], [], [], timeout)
    numbers = os.read(reading, 1 << 16) if ready else b""
    return next((number for number in numbers if number in _list_numbers()), None)


def _force_end(number: int) -> NoReturn:
    """Remove unfinished results, print the command's last message, and end the process."""
    code = 128 + number if _STATE.code is None else _STATE.code
    try:
        for action in reversed(_ACTIONS):
            with suppress(OSError):
                action()
        atomic_files = sys.modules.get("kinematics.files.atomic_files")
        if atomic_files is not None:  # else nothing is unfinished
            atomic_files.remove_staged()
        intent.remove_new_folders()
        if os.isatty(2):
            # Clear the line of progress, and show the cursor again.
            os.write(2, b"\r\x1b[K\x1b[?25h")
        if _STATE.code is None:
            from kinematics.files.plain_text import plain

            message = plain(intent.describe_interruption())
            os.write(2, f"{message}\n".encode(errors="replace"))
    finally:
        os._exit(code)
