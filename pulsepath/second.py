"""The command line's second process, started before anything slow is loaded, so that both load at once."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
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


def _started(figures: bool) -> tuple[BaseProcess, Connection]:
    context = multiprocessing.get_context("spawn")
    pipe, other = context.Pipe()
    process = context.Process(target=_serve, args=(other, figures), daemon=True)
    process.start()
    other.close()
    return process, pipe


def _serve(pipe: Connection, figures: bool) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as `serve` has it, which is slow to load
    with seldom_collected():
        from planner.workers import serve

        for name in (*ALWAYS, *(DRAWING if figures else ())):
            import_module(name)
        serve(pipe)
