"""Signals held back while what they would break off must not be: Ctrl-C, the system's request to end, a hang-up."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from threading import current_thread, main_thread
from types import FrameType
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
"""Signals that end a program in good order, of which a system may not know all."""


class Held:
    """came: the number of the last signal that came meanwhile; None: none did."""

    __slots__ = ("came",)

    def __init__(self) -> None:
        self.came: int | None = None

    def note(self, number: int, _: FrameType | None) -> None:
        self.came = number


@contextmanager
def held() -> Iterator[Held]:
    """Within, a signal that a function of Python's handles is noted, and given to that function at the end.

    What is ignored, or left to the system, stays so. Only the main thread is ever told of signals.
    """
    kept: dict[int, Any] = {}
    waiting = Held()
    try:
        if current_thread() is main_thread():
            for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
                if callable(before := signal.getsignal(number)):
                    kept[number] = before
                    signal.signal(number, waiting.note)
        yield waiting
    finally:
        for number, before in kept.items():
            signal.signal(number, before)
        if waiting.came is not None:
            signal.raise_signal(waiting.came)
