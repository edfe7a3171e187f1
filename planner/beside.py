"""Work in another process while this one goes on with something else: the command line's second core."""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from planner.workers import Outcome, Started, Worker

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Begun(Generic[Result]):
    """What another process was asked to do."""

    told: "Future[Outcome | None] | None"

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for it; `here` does the same in this process.

        That is asked for what cannot be done there, for want of a process or because one died of it, or because
        something cannot leave a process; and for what raised there, so that it raises here.
        """
        outcome = None if self.told is None else self.told.result()
        return here() if outcome is None or outcome.error is not None else outcome.value


class Beside:
    """A process beside this one, or none; it does one thing after the other."""

    def __init__(self, worker: Worker | None = None, thread: ThreadPoolExecutor | None = None) -> None:
        self._worker, self._thread = worker, thread

    def start(self, work: Callable[[], Result]) -> Begun[Result]:
        """Have it begin, when it is through with what it was asked for before."""
        # by a thread, since a pipe takes no more than the other side has read
        if self._worker is None or self._thread is None:
            return Begun(None)
        return Begun(self._thread.submit(self._done, self._worker, work))

    def _done(self, worker: Worker, work: Callable[[], Any]) -> Outcome | None:
        try:
            worker.give(_CALLED, 0, work)
        except Exception:  # pickle raises whatever an object's own code does
            return None
        worker.wait()
        return worker.take()[1]


NOTHING = Beside()
"""No other process: everything is done here."""


@contextmanager
def beside(started: Started | None) -> Iterator[Beside]:
    """A process that has been started for `planner.workers.serve`, if any; when the block ends, it is no more."""
    if started is None:
        yield NOTHING
        return
    worker = Worker(started)
    with ThreadPoolExecutor(1) as thread:
        try:
            yield Beside(worker, thread)
        finally:
            worker.process.kill()  # on which the thread waits no longer
            thread.shutdown(cancel_futures=True)
            worker.end()


def _called(work: Callable[[], Any]) -> Any:
    return work()


_CALLED = pickle.dumps(_called)
