"""The command line's second process, started before anything slow is loaded, so that both load at once.

A command that loads much and ends soon has little use for the collection of garbage.
"""

import gc
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

if TYPE_CHECKING:
    from planner.beside import SideProcess

# New objects until the youngest, the younger and all are looked through. Python's own numbers have a command look
# through all that it loads again and again, for a tenth of its time; with these what it draws is still cleared up.
THRESHOLDS = 50_000, 20, 100


@contextmanager
def reduce_garbage_collection() -> Iterator[None]:
    """Inside it, garbage is collected seldom."""
    before = gc.get_threshold()
    gc.set_threshold(*THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)


WORK_MODULES, FIGURE_MODULES = (
    ("pulsepath.process.second_work",),
    ("benchmarks.reports.plan_report", "controllers.figures", "planner.figures"),
)


@contextmanager
def second(figures: bool) -> Iterator["SideProcess"]:
    """Another process for a part of the work, where there is a core for it, with what that takes loaded."""
    started = _started(figures) if multiprocessing.parent_process() is None and _cores() > 1 else None
    from planner.beside import side_process

    with side_process(started) as other:
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
            with _isolate_start():
                process.start()
        except OSError:
            pipe.close()
            return None
    return process, pipe


@contextmanager
def _isolate_start() -> Iterator[None]:
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # as `serve_tasks` has it, which is slow to load
    with reduce_garbage_collection():
        from planner.workers import serve_tasks

        for name in (*WORK_MODULES, *(FIGURE_MODULES if figures else ())):
            import_module(name)
        serve_tasks(pipe)
