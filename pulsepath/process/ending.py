"""Signals that end a program in good order: Ctrl-C, the system's request to end, a terminal that hangs up."""

import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Timer, main_thread
from types import FrameType
from typing import Any

from pulsepath.process.supervisor import SIGNAL_NAMES

RESEND_DELAY = 0.002
"""s until a signal is given again that would have been lost."""
UNSAFE_MODULES = ("casadi.casadi", "importlib._bootstrap", "_frozen_importlib")
"""Modules in whose calls no exception may be raised."""


class EndSignal(KeyboardInterrupt):
    """A signal has come; code: 128 and its number, as shells tell it."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.Signals(number).name)
        self.code = 128 + number


@contextmanager
def raise_on_signal(last: bool = False) -> Iterator[None]:
    """Let each of the signals raise EndSignal once, so that the clean-up that follows is not interrupted.

    last  whether the process ends after the block: then a second signal is ignored

    A signal that is ignored already, as by nohup, stays ignored.
    """
    kept: dict[signal.Signals, Any] = {}
    later: list[Timer] = []
    outermost = sys._getframe(2)  # of the with statement: this one's, and contextlib's, are gone once it is within

    def end(number: int, where: FrameType | None) -> None:
        if _is_swallowed(where, outermost):
            if not any(timer.is_alive() for timer in later):
                later.append(Timer(RESEND_DELAY, _resend, (signal.Signals(number),)))
                later[-1].daemon = True
                later[-1].start()
            return
        for each in kept:
            signal.signal(each, signal.SIG_IGN)
        raise EndSignal(number)

    try:
        for number in (signal.Signals[name] for name in SIGNAL_NAMES if hasattr(signal, name)):
            if (before := signal.getsignal(number)) is not signal.SIG_IGN:
                kept[number] = before
                signal.signal(number, end)
        yield
    except EndSignal:
        if last:
            kept.clear()
        raise
    finally:
        for timer in later:
            timer.cancel()
        for number, before in kept.items():
            signal.signal(number, before)


def _resend(number: signal.Signals) -> None:
    """A signal to the main thread, which wakes where the system can send it to that thread alone."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread().ident or 0, number)
    else:
        interrupt_main(number)


def _is_swallowed(where: FrameType | None, outermost: FrameType) -> bool:
    """Return whether an exception raised in a frame would be lost, or end the process."""
    while where is not None and where is not outermost:
        if where.f_globals.get("__name__") in UNSAFE_MODULES:
            return True
        where = where.f_back
    return False
