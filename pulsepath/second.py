"""The command line's second process, started before anything slow is loaded, so that both load at once."""

import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from types import ModuleType
from typing import TYPE_CHECKING

from pulsepath.seldom import seldom_collected

if TYPE_CHECKING:
    from planner.beside import Beside

ALWAYS, DRAWING = ("pulsepath.second_work",), ("benchmarks.report", "controllers.plots", "planner.plots")


@contextmanager
def second(figures: bool) -> Iterator["Beside"]:
    """Another process for a part of the work, where there is a core for it, with what that takes loaded."""
    started = _started(figures) if multiprocessing.parent_process() is None and _cores() > 1 else None
    from planner.beside import beside

    with beside(started) as other:
        yield other


def _cores() -> int:
    # planner.parallel has the same, and is slow to load
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _started(figures: bool) -> tuple[BaseProcess, Connection] | None:
    """None where the system has no room for one more, which is no reason not to go on."""
    context = multiprocessing.get_context("spawn")
    try:
        pipe, other = context.Pipe()
    except OSError:
        return None
    process = context.Process(target=_serve, args=(other, figures), daemon=True)
    with other:
        try:
            with _apart():
                process.start()
        except OSError:
            pipe.close()
            return None
    return process, pipe


@contextmanager
def _apart() -> Iterator[None]:
    """Around the start of a process: it runs no script of the caller again, and no Ctrl-C before it can ignore it.

    The first is as in planner.workers, which is slow to load.
    """
    main = sys.modules["__main__"]
    if hasattr(signal, "pthread_sigmask"):  # what is held off here is held off in what is started
        resource_tracker.ensure_running()  # else started with the process, when it would let Ctrl-C in again
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
        if hasattr(signal, "pthread_sigmask"):
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve(pipe: Connection, figures: bool) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as `serve` has it, which is slow to load
    with seldom_collected():
        from planner.workers import serve

        for name in (*ALWAYS, *(DRAWING if figures else ())):
            import_module(name)
        serve(pipe)
