"""Work in another process while this one goes on with something else: the command line's second core."""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from planner.workers import Started, TaskOutcome, Worker

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class PendingResult(Generic[Result]):
    """What another process was asked to do."""

    told: "Future[TaskOutcome | None] | None"

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for it; `here` does the same in this process.

        That is asked for what cannot be done there, for want of a process or because one died of it, or because
        something cannot leave a process; and for what raised there, so that it raises here.
        """
        outcome = None if self.told is None else self.told.result()
        return here() if outcome is None or outcome.error is not None else outcome.value


class SideProcess:
    """A process beside this one, or none; it does one thing after the other."""

    def __init__(self, worker: Worker | None = None, thread: ThreadPoolExecutor | None = None) -> None:
        self._worker, self._thread = worker, thread

    def start(self, work: Callable[[], Result]) -> PendingResult[Result]:
        """Have it begin, when it is through with what it was asked for before."""
        # by a thread, since a pipe takes no more than the other side has read
        if self._worker is None or self._thread is None:
            return PendingResult(None)
        return PendingResult(self._thread.submit(self._done, self._worker, work))

    def _done(self, worker: Worker, work: Callable[[], Any]) -> TaskOutcome | None:
        try:
            worker.give(_PICKLED_CALL, 0, work)
        except Exception:  # pickle raises whatever an object's own code does
            return None
        worker.wait()
        return worker.take()[1]


NO_PROCESS = SideProcess()
"""No other process: everything is done here."""


@contextmanager
def side_process(started: Started | None) -> Iterator[SideProcess]:
    """A process that has been started for `planner.workers.serve_tasks`, if any; when the block ends, it is no more."""
    if started is None:
        yield NO_PROCESS
        return
    worker = Worker(started)
    with ThreadPoolExecutor(1) as thread:
        try:
            yield SideProcess(worker, thread)
        finally:
            worker.process.kill()  # on which the thread waits no longer
            thread.shutdown(cancel_futures=True)
            worker.end()


def _call_work(work: Callable[[], Any]) -> Any:
    return work()


_PICKLED_CALL = pickle.dumps(_call_work)
