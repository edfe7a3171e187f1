"""Processes that do tasks one by one and may die of it: what one held, another does.

Each has a pipe of its own and no lock in common, so that none waits for what another took along (as those of Python's
own pool may, for ever), and each ends when the process that started it is no more.
"""

import multiprocessing
import os
import pickle
import signal
import sys
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Thread
from traceback import format_exc
from types import ModuleType
from typing import Any

# Processes that a task may take along before no other is given it.
MAX_DEATHS = 2
# Processes replaced at most: where more die, it is not for the tasks that they do.
MAX_REPLACED = 16
# s given to a process that has nothing left to do to end by itself.
END_WAIT = 2.0

_CONTEXT = multiprocessing.get_context("spawn")

Started = tuple[BaseProcess, Connection]
"""A process that does `serve_tasks`, and this end of its pipe."""


class RemoteTrace(Exception):
    """Where in another process an error was raised."""


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """What a task gave: its value, or the error that it raised and the trace of that."""

    value: Any = None
    error: Exception | None = None
    trace: str = ""

    def result(self) -> Any:
        """The value. Raises what the task raised."""
        if self.error is not None:
            raise self.error from RemoteTrace(f"\n{self.trace}")
        return self.value


def run_tasks(packed: bytes, tasks: Sequence[Any], count: int) -> Generator[tuple[int, TaskOutcome], None, None]:
    """(n, outcome) of tasks as they are done by `count` processes; close it, and they are no more.

    A process that dies is replaced. Left out are tasks that took several along, all where too many died, and what
    comes after a task that raised.

    packed  the pickled function that does a task
    """
    workers = [Worker() for _ in range(count)]
    todo, lost, spare = deque(range(len(tasks))), Counter[int](), MAX_REPLACED
    finished: list[tuple[int, TaskOutcome]] = []
    try:
        while True:
            for worker in workers:
                if worker.busy is None and todo:
                    worker.give(packed, todo[0], tasks[todo[0]])
                    todo.popleft()
            yield from finished  # with all at work meanwhile
            finished.clear()
            busy = [worker for worker in workers if worker.busy is not None]
            if not busy:
                return
            wait([source for worker in busy for source in (worker.pipe, worker.process.sentinel)])
            for worker in busy:
                if not worker.ready():
                    continue
                n, outcome = worker.take()
                if outcome is None:
                    workers.remove(worker)
                    worker.kill()
                    lost[n] += 1
                    if lost[n] < MAX_DEATHS:
                        todo.appendleft(n)
                    if spare and todo:
                        spare -= 1
                        workers.append(Worker())
                    continue
                if outcome.error is not None:
                    todo = deque(k for k in todo if k < n)
                finished.append((n, outcome))
    except BaseException:
        for worker in workers:
            worker.kill()
        raise
    finally:
        for worker in workers:
            worker.end()


class Worker:
    """A process, this end of its pipe, and the number of the task that it is busy with."""

    def __init__(self, started: Started | None = None) -> None:
        self.process, self.pipe = _start_worker() if started is None else started
        self.busy: int | None = None
        self._told = False

    def give(self, packed: bytes, n: int, task: Any) -> None:
        """A task; of a process that is dead already, `take` will say so. Raises what pickling the task raises."""
        message = pickle.dumps(task)
        self.busy = n
        try:
            if not self._told:
                self.pipe.send_bytes(packed)
                self._told = True
            self.pipe.send_bytes(message)
        except OSError:
            pass

    def wait(self) -> None:
        """Until its task is done, or the process is dead."""
        wait([self.pipe, self.process.sentinel])

    def ready(self) -> bool:
        """Whether its task is done, or the process is dead."""
        try:
            return self.pipe.poll() or not self.process.is_alive()
        except OSError:
            return True

    def take(self) -> tuple[int, TaskOutcome | None]:
        """The task that it was given, and what that gave: None where the process died before it could tell."""
        n, self.busy = self.busy, None
        assert n is not None  # only the busy are asked
        try:
            return n, (pickle.loads(self.pipe.recv_bytes()) if self.pipe.poll() else None)
        except (EOFError, OSError):
            return n, None

    def kill(self) -> None:
        self.process.kill()
        self.end()

    def end(self) -> None:
        self.pipe.close()  # on which it ends, unless it is busy
        self.process.join(END_WAIT if self.busy is None else 0)
        if self.process.is_alive():
            self.process.kill()
        self.process.join()


def _start_worker() -> Started:
    pipe, other = _CONTEXT.Pipe()
    # its work goes through the pipe too: what a process is started with, Python cannot send to one that is killed
    process = _CONTEXT.Process(target=serve_tasks, args=(other,), daemon=True)
    with hide_main():
        process.start()
    other.close()
    return process, pipe


def serve_tasks(pipe: Connection) -> None:
    """In a process: do tasks until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal's Ctrl-C reaches every process; the first one ends all
    Thread(target=_end_with_parent, daemon=True).start()
    try:
        work = pickle.loads(pipe.recv_bytes())
        while True:
            pipe.send_bytes(_run_task(work, pipe.recv_bytes()))
    except (EOFError, OSError):
        pass


def _end_with_parent() -> None:
    """Where that is killed: the pipe tells it too, but only once a task is done."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _run_task(work: Callable[[Any], Any], task: bytes) -> bytes:
    """The pickled outcome of a pickled task."""
    try:
        return pickle.dumps(TaskOutcome(work(pickle.loads(task))))
    except Exception as error:
        trace = format_exc()
        try:
            packed = pickle.dumps(TaskOutcome(error=error, trace=trace))
            pickle.loads(packed)  # not every error can be made again
        except Exception:
            packed = pickle.dumps(TaskOutcome(error=RuntimeError(repr(error)), trace=trace))
        return packed


@contextmanager
def hide_main() -> Iterator[None]:
    """Around the start of processes: each would run the caller's script again, and few scripts are made for it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main
