"""Independent work spread over processes, where there is enough of it: the same results, in the same order."""

import multiprocessing
import os
import pickle
from collections.abc import Callable, Sequence
from contextlib import closing
from time import perf_counter
from typing import Any, TypeVar

from planner.workers import TaskOutcome, run_tasks

Task = TypeVar("Task")
Result = TypeVar("Result")
Progress = Callable[[int, int], None]
"""Called with how much is done, and of how much; what it counts is its giver's to say."""


def ignore_progress(done: int, of: int) -> None:
    """Progress that nobody asked about."""


def share_progress(progress: Progress, nth: int, shares: int) -> Progress:
    """Of work in several shares, done one after the other and taken to be as long, the progress of one (from 0)."""
    return lambda done, of: progress(nth * of + done, shares * of)


# s of work left from which on processes pay: to start one, with all that it imports, takes a second or two.
ENOUGH = 4.0
# Tasks done here first, to see what one takes: the first of all also builds what all share.
TRIED = 2


def spread(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    done: Callable[[Task, Result], None] = lambda task, result: None,
) -> list[Result]:
    """[work(task) for task in tasks], in several processes where that is faster; `done` is told of each result in turn.

    Each process is given `work` once and the tasks one by one. What a task raises is raised here, of several the first
    in order; Ctrl-C ends all of them. A process that dies costs the time of its task: another does it, and this one
    what kills them all. Inside a process of another pool, everything is done here.
    """
    results: list[Result] = []

    def have(result: Result) -> None:
        results.append(result)
        done(tasks[len(results) - 1], result)

    while len(results) < len(tasks):
        begin = perf_counter()
        have(work(tasks[len(results)]))
        waiting = (len(tasks) - len(results)) * (perf_counter() - begin)
        if len(results) >= TRIED and waiting > ENOUGH and cores() > 1 and multiprocessing.parent_process() is None:
            break
    tried, early = len(results), dict[int, TaskOutcome]()
    rest = tasks[tried:]
    packed = _pickle_work(work) if rest else None
    if packed is not None:
        with closing(run_tasks(packed, rest, min(cores(), len(rest)))) as outcomes:
            for n, outcome in outcomes:
                early[tried + n] = outcome
                while len(results) in early:
                    have(early.pop(len(results)).result())
    while (n := len(results)) < len(tasks):  # where processes cannot do it, one always can
        have(early.pop(n).result() if n in early else work(tasks[n]))
    return results


def _pickle_work(work: Callable[[Any], Any]) -> bytes | None:
    """What a process is given; None where that cannot leave this one, as what the caller's own script defines."""
    try:
        packed = pickle.dumps(work)
    except Exception:  # pickle raises whatever an object's own code does
        return None
    return None if b"__main__" in packed else packed


def cores() -> int:
    """Processor cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1
