"""Independent work spread over processes, where there is enough of it: the same results, in the same order."""

import multiprocessing
import os
import pickle
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from time import perf_counter
from types import ModuleType
from typing import Any, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")
Progress = Callable[[int, int], None]
"""Called with how much is done, and of how much; what it counts is its giver's to say."""


def silent(done: int, of: int) -> None:
    """Progress that nobody asked about."""


def share(progress: Progress, nth: int, shares: int) -> Progress:
    """Of work in several shares, done one after the other and taken to be as long, the progress of one (from 0)."""
    return lambda done, of: progress(nth * of + done, shares * of)


# s of work left from which on processes pay: to start one, with all that it imports, takes a second or two.
ENOUGH = 4.0
# Tasks done here first, to see what one takes: the first of all also builds what all share.
TRIED = 2

_work: Callable[[Any], Any] | None = None
"""In a worker process: what it does with each task."""


def spread(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    done: Callable[[Task, Result], None] = lambda task, result: None,
) -> list[Result]:
    """[work(task) for task in tasks], in several processes where that is faster; `done` is told of each result in turn.

    Each process is given `work` once and the tasks one by one. What a task raises is raised here, of several the first
    in order; Ctrl-C ends all of them. Inside a process of another pool, everything is done here.
    """
    results: list[Result] = []
    left = iter(tasks)
    for task in left:
        begin = perf_counter()
        results.append(work(task))
        done(task, results[-1])
        waiting = (len(tasks) - len(results)) * (perf_counter() - begin)
        if len(results) >= TRIED and waiting > ENOUGH and cores() > 1 and multiprocessing.parent_process() is None:
            break
    rest = list(left)
    packed = _packed(work) if rest else None
    if packed is not None:
        results += _in_processes(packed, rest, done)
    for task in tasks[len(results) :]:  # where processes cannot do it, one always can
        results.append(work(task))
        done(task, results[-1])
    return results


def _packed(work: Callable[[Any], Any]) -> bytes | None:
    """What a process is given; None where that cannot leave this one, as what the caller's own script defines."""
    try:
        packed = pickle.dumps(work)
    except Exception:  # pickle raises whatever an object's own code does
        return None
    return None if b"__main__" in packed else packed


def _in_processes(packed: bytes, tasks: Sequence[Task], done: Callable[[Task, Any], None]) -> list[Any]:
    """What the tasks gave, up to the first that was lost with its process."""
    results: list[Any] = []
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(
        min(cores(), len(tasks)), multiprocessing.get_context("spawn"), initializer=_begin, initargs=(packed,)
    )
    try:
        with main_hidden():
            futures: list[Future[Any]] = [pool.submit(_do, task) for task in tasks]
        for task, future in zip(tasks, futures, strict=True):
            results.append(future.result())
            done(task, results[-1])
    except BrokenProcessPool:
        pass
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
            process.join()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
    return results


def _begin(packed: bytes) -> None:
    global _work
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C reaches every process; the first one ends all
    _work = pickle.loads(packed)


def _do(task: Any) -> Any:
    assert _work is not None  # the pool begins every process with it
    return _work(task)


@contextmanager
def main_hidden() -> Iterator[None]:
    """Around the start of processes: each would run the caller's script again, and few scripts are made for it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def cores() -> int:
    """Processor cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
