"""Independent tasks in several processes, if they take long enough: same results, same order.

The processes are loky's. Unlike those of Python's own pool they do not run the caller's script
again, and a killed process leaves no lock that others wait for. Three problems that loky leaves
open are solved here:

- Tasks and results go through files: the reader of a pipe waits for ever if its writer is killed
  in the middle of a long message.
- The processes ignore Ctrl-C and hang-ups, which a terminal sends to a whole group, even before
  Python starts.
- They end with the process that started them.
"""

import gc
import multiprocessing
import operator
import os
import pickle
import signal
import sys
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from itertools import count
from multiprocessing import resource_tracker
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread
from time import perf_counter
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

Task = TypeVar("Task")
Result = TypeVar("Result")
Progress = Callable[[int, int], None]
"""Callback (done, of): how many units are done, and of how many. The caller defines the unit."""

# s of work left above which processes pay: to start one, with its imports, takes 1 to 2 s.
MIN_POOL_WORK = 4.0
# Tasks done here first, to measure the time of one: the first also builds shared caches.
FIRST_TASKS = 2
# Tasks that a process has at a time: the one that it does, and the next. More would delay sharing.
TASKS_EACH = 2
# Processes that a task may kill before it is done here, and pools that are started for all tasks.
MAX_DEATHS, MAX_POOLS = 2, 8
# As in pulsepath.__main__.
GC_THRESHOLDS = 50_000, 20, 100
# loky would restart a process that has grown by 300 MB, and import modules of the current folder.
_ENVIRONMENT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e18", "PYTHONSAFEPATH": "1"}
_WORK = "work"
# Option -W of loky's tracker of resources, which cleans up after a killed process: it need not say
# so.
_QUIET = "ignore:resource_tracker:UserWarning"


def ignore_progress(done: int, of: int) -> None:
    """Ignore progress."""


def share_progress(progress: Progress, nth: int, shares: int) -> Progress:
    """Return the progress callback for share `nth` (from 0) of work in equal, successive shares."""
    return lambda done, of: progress(nth * of + done, shares * of)


def cores() -> int:
    """Return how many processor cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # some systems lack it
        return os.cpu_count() or 1


_WITHOUT = False
"""True while `without_processes` is active."""


@contextmanager
def without_processes() -> Iterator[None]:
    """Start no processes until the block ends: a worker of a cluster shares its computer."""
    global _WITHOUT
    before = _WITHOUT
    _WITHOUT = True
    try:
        yield
    finally:
        _WITHOUT = before


def _may_start() -> bool:
    """Return whether processes may be started: never inside a process of another pool."""
    return cores() > 1 and not _WITHOUT and multiprocessing.parent_process() is None


def spread(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    done: Callable[[Task, Result], None] = lambda task, result: None,
) -> list[Result]:
    """Return [work(task) for task in tasks], in several processes if that is faster.

    `done` is called with each result in order. Each process gets `work` once and the tasks one by
    one. The exception of the first task in order that raises is raised here. Ctrl-C ends all
    processes. If a process dies, another does its task; a task that kills several is done here.
    """
    results: list[Result] = []

    def append(result: Result) -> None:
        results.append(result)
        done(tasks[len(results) - 1], result)

    while len(results) < len(tasks):
        begin = perf_counter()
        append(work(tasks[len(results)]))
        waiting = (len(tasks) - len(results)) * (perf_counter() - begin)
        if len(results) >= FIRST_TASKS and waiting > MIN_POOL_WORK and _may_start():
            break
    first = len(results)
    early = dict[int, Result]()
    packed = _pickle_work(work) if first < len(tasks) else None
    if packed is not None:
        with closing(_run_tasks(packed, tasks[first:])) as finished:
            for n, result in finished:
                early[first + n] = result
                while len(results) in early:
                    append(early.pop(len(results)))
    while (n := len(results)) < len(tasks):  # tasks that processes cannot do, or that raise
        append(early.pop(n) if n in early else work(tasks[n]))
    return results


def _pickle_work(work: Callable[[Any], Any]) -> bytes | None:
    """Pickle work for a process; None if it cannot leave this one, as the caller's script."""
    try:
        packed = pickle.dumps(work)
    except Exception:  # pickling runs the object's own code
        return None
    return None if b"__main__" in packed else packed


def _run_tasks(work: bytes, tasks: Sequence[Any]) -> Generator[tuple[int, Any], None, None]:
    """Yield (n, result) of tasks as they are done; closing the generator ends the processes.

    A task that raised and those after it are left out, as are tasks that killed several processes,
    and all remaining tasks after too many deaths.
    """
    todo = list(range(len(tasks)))
    deaths = Counter[int]()
    for _ in range(MAX_POOLS):
        if not todo:
            return
        pending = dict[int, PendingResult[Any]]()
        ready = list[tuple[int, Any]]()
        processes = min(cores(), len(todo))
        with suppress(BrokenExecutor, OSError), open_pool(work, processes) as pool:
            while todo or pending:
                while todo and len(pending) < processes:
                    pending[todo[0]] = pool.submit(tasks[todo[0]])
                    del todo[0]
                yield from ready  # all processes work meanwhile
                ready.clear()
                wait([each.future for each in pending.values()], return_when=FIRST_COMPLETED)
                for n in [n for n, each in pending.items() if each.future.done()]:
                    if pending[n].future.result():
                        ready.append((n, pending.pop(n).read()))
                    else:
                        del pending[n]
                        todo = [k for k in todo if k < n]
        yield from ready
        deaths.update([*pending])
        todo = sorted([*todo, *(n for n in pending if deaths[n] < MAX_DEATHS)])


@dataclass(frozen=True, slots=True)
class PendingResult(Generic[Result]):
    """A task sent to a process. `future` is True once the result is in `file`."""

    future: "Future[bool]"
    file: Path

    @classmethod
    def none(cls) -> "PendingResult[Result]":
        """Return the pending result of a task that no process gets."""
        future: Future[bool] = Future()
        future.set_result(False)
        return cls(future, Path())

    def read(self) -> Result:
        """Read the result of a task that is done, and delete its file."""
        result: Result = pickle.loads(self.file.read_bytes())
        self.file.unlink()
        return result

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for the result. `here` does the task in this process if no other did.

        There may have been no process, it may have died, or its result could not be pickled. A task
        that raised there raises again here.
        """
        failed = self.future.exception() is not None or not self.future.result()
        return here() if failed else self.read()


class Pool:
    """Processes for one kind of work.

    If one dies, all end, and each future raises BrokenExecutor.
    """

    def __init__(self, executor: Any, folder: Path) -> None:
        self._executor = executor
        self._folder = folder
        self._numbers = count()

    def submit(self, task: Any) -> PendingResult[Any]:
        """Send a task to a process.

        Raises BrokenExecutor, and any exception of pickling the task.
        """
        file = self._folder / str(next(self._numbers))
        file.write_bytes(pickle.dumps(task))
        return PendingResult(self._executor.submit(_do_task, file), file)


@contextmanager
def open_pool(work: bytes, processes: int, modules: Sequence[str] = ()) -> Iterator[Pool]:
    """Start processes that load `modules` and wait for tasks of pickled work, until the block ends.

    Raises OSError if the system has no room for them.
    """
    from loky import ProcessPoolExecutor
    from loky.backend import resource_tracker as tracker

    if _QUIET not in sys.warnoptions:
        sys.warnoptions.append(_QUIET)
    with ExitStack() as stack:
        temporary = TemporaryDirectory(
            prefix=f"pulsepath-{os.getpid()}-", ignore_cleanup_errors=True
        )
        folder = Path(stack.enter_context(temporary))
        with hold_interrupts():
            tracker.register(str(folder), "folder")  # removes it even if this process is killed
        stack.callback(tracker.unregister, str(folder), "folder")
        (folder / _WORK).write_bytes(work)
        ends = multiprocessing.Pipe(duplex=False)
        for end in ends:
            stack.enter_context(end)
        begin = (ends[0], tuple(modules))
        executor = ProcessPoolExecutor(
            processes,
            initializer=_begin_process,
            initargs=begin,
            env=_ENVIRONMENT,
        )
        stack.callback(executor.shutdown, kill_workers=True)
        with hold_interrupts():
            executor.submit(int)  # the first task starts the processes
        yield Pool(executor, folder)


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """Block Ctrl-C and hang-ups until the block ends: processes that start meanwhile inherit the
    mask.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    try:
        resource_tracker.ensure_running()  # if it started with them, it would unblock Ctrl-C
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_process(parent: "Connection", modules: Sequence[str]) -> None:
    """Prepare a process: it ends with its parent, and loads the modules of its work."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first process ends all
    Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    gc.set_threshold(*GC_THRESHOLDS)
    for name in modules:
        import_module(name)
    gc.freeze()  # loky has garbage collected after the first task


def _end_with_parent(parent: "Connection") -> None:
    """End with the parent, even if that is killed: the pipe then reports its end."""
    with suppress(EOFError, OSError):
        parent.recv_bytes()
    os._exit(1)


def _do_task(file: Path) -> bool:
    """Do a task in a process, and replace its file by the result; False if it raised.

    The parent then does the task again, and raises.
    """
    try:
        result = _load_work(file.with_name(_WORK))(pickle.loads(file.read_bytes()))
        file.write_bytes(pickle.dumps(result))
    except BaseException:
        return False
    return True


@lru_cache(1)
def _load_work(file: Path) -> Callable[[Any], Any]:
    work: Callable[[Any], Any] = pickle.loads(file.read_bytes())
    return work


class SideProcess:
    """A second process that does one task after the other, or none."""

    def __init__(self, pool: Pool | None = None) -> None:
        self._pool = pool

    def start(self, work: Callable[[], Result]) -> PendingResult[Result]:
        """Start a task after the earlier ones."""
        if self._pool is not None:
            with suppress(Exception):  # it has ended; and pickling runs the object's own code
                return self._pool.submit(work)
        return PendingResult.none()


NO_PROCESS = SideProcess()
"""No other process: everything is done here."""


@contextmanager
def side_process(modules: Sequence[str] = ()) -> Iterator[SideProcess]:
    """Start a second process with modules loaded, if there are a core and memory for it."""
    with ExitStack() as stack:
        pool = None
        if _may_start():
            with suppress(OSError):
                pool = stack.enter_context(open_pool(pickle.dumps(operator.call), 1, modules))
        yield SideProcess(pool)


class LocalHelpers:
    """Processes of this computer that plan runs between stops: `planner.windows.Helpers`.

    They start once a plan has taken MIN_POOL_WORK. There is one for each core but that of this
    process, which also does the tasks that they have no time for.
    """

    def __init__(self, stack: ExitStack) -> None:
        """stack: ends the processes."""
        self._stack = stack
        self._begin = perf_counter()
        self._deaths = 0
        self._work: bytes | None = None
        self._pool: Pool | None = None
        self._pending: list[PendingResult[Any]] = []

    def prepare(self, work: Callable[[Task], Result]) -> Callable[[Task], PendingResult[Result]]:
        """Return the function that sends a task of this work to a process."""
        self._work = _pickle_work(work)

        def submit(task: Task) -> PendingResult[Result]:
            self._pending = [each for each in self._pending if not each.future.done()]
            if self._pool is not None and len(self._pending) < self._most:
                try:
                    self._pending.append(self._pool.submit(task))
                    return self._pending[-1]
                except (BrokenExecutor, OSError):  # a process was killed: start a pool once more
                    self._pool = None
                    self._deaths += 1
                except Exception:  # pickling runs the task's own code
                    self._deaths = MAX_DEATHS
            return PendingResult.none()

        return submit

    def room(self) -> int:
        """Return how many tasks may run at a time, with one for this process; 0 without
        processes.
        """
        late = perf_counter() - self._begin > MIN_POOL_WORK
        can_start = late and self._deaths < MAX_DEATHS and _may_start()
        if self._pool is None and self._work is not None and can_start:
            try:
                self._pool = self._stack.enter_context(open_pool(self._work, cores() - 1))
            except OSError:
                self._deaths = MAX_DEATHS
        return 0 if self._pool is None else self._most + 1

    @property
    def _most(self) -> int:
        return TASKS_EACH * (cores() - 1)

    def tell_alone(self, segment: int) -> None:
        """Ignore the message: the caller did not ask for processes."""
