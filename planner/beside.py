"""One piece of work in another process while this one goes on with something else: the command line's second core."""

import multiprocessing
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

from planner.parallel import cores
from planner.workers import Worker

Result = TypeVar("Result")


class Beside:
    """A process beside this one, or none."""

    def __init__(self, worker: Worker | None) -> None:
        self._worker = worker

    def start(self, work: Callable[[], Result]) -> Callable[[], Result]:
        """Begin; what is returned waits for the result, and raises what the work raised.

        Where there is no other process, or it died of it, the work is done here, when its result is asked for.
        """
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.wait()
            worker.take()
            worker.give(_CALLED, 1, work)

        @cache
        def result() -> Result:
            outcome = None
            if worker is not None:
                worker.wait()
                _, outcome = worker.take()
            return work() if outcome is None else outcome.result()

        return result


@contextmanager
def beside(ready: Callable[[], object]) -> Iterator[Beside]:
    """Another process for one piece of work, if there is a core for it; when the block ends, it is no more.

    ready: what it does at once, such as imports, while this one prepares the work.
    """
    worker = Worker() if cores() > 1 and multiprocessing.parent_process() is None else None
    try:
        if worker is not None:
            worker.give(_CALLED, 0, ready)
        yield Beside(worker)
    finally:
        if worker is not None:
            worker.kill()


def _called(work: Callable[[], Any]) -> Any:
    return work()


_CALLED = pickle.dumps(_called)
