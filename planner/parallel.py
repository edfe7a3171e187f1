"""Independent work in several processes, where there is enough of it: the same results, in the same order.

The processes are loky's. Unlike those of Python's own pool they do not run the caller's script again, and where one is
killed nothing waits for a lock that it held. What loky leaves open is done here: tasks and results go through files,
since whoever reads a long message waits for ever where its writer is killed in the midst of it; the processes ignore
Ctrl-C, which a terminal sends to all of a group, even before Python has started in them; and they end with the process
that started them.
"""

import gc
import multiprocessing
import operator
import os
import pickle
import signal
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
"""Called with how much is done, and of how much; what it counts is its giver's to say."""

# s of work left from which on processes pay: to start one, with all that it imports, takes a second or two.
MIN_POOL_WORK = 4.0
# Tasks done here first, to see what one takes: the first of all also builds what all share.
FIRST_TASKS = 2
# Tasks that a process is given at a time: one that it does, and one to go on with.
TASKS_EACH = 2
# Processes that a task may take along before it is done here, and pools that are begun anew for it.
MAX_DEATHS, MAX_POOLS = 2, 8
# As in pulsepath.__main__.
GC_THRESHOLDS = 50_000, 20, 100
# loky would start a process anew that has grown by 300 MB, and find modules in the folder that the caller stands in.
_ENVIRONMENT = {"LOKY_MAX_MEMORY_LEAK_SIZE": "1e18", "PYTHONSAFEPATH": "1"}
_WORK = "work"


def ignore_progress(done: int, of: int) -> None:
    """Progress that nobody asked about."""


def share_progress(progress: Progress, nth: int, shares: int) -> Progress:
    """Of work in several shares, done one after the other and taken to be as long, the progress of one (from 0)."""
    return lambda done, of: progress(nth * of + done, shares * of)


def cores() -> int:
    """Processor cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


_WITHOUT = False
"""Whether no processes are started for now."""


@contextmanager
def without_processes() -> Iterator[None]:
    """Inside it, all is done by this process: as a worker of a cluster, which is one of many on its computer."""
    global _WITHOUT
    before, _WITHOUT = _WITHOUT, True
    try:
        yield
    finally:
        _WITHOUT = before


def _may_start() -> bool:
    """Whether other processes help: not inside a process of another pool."""
    return cores() > 1 and not _WITHOUT and multiprocessing.parent_process() is None


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
        if len(results) >= FIRST_TASKS and waiting > MIN_POOL_WORK and _may_start():
            break
    tried, early = len(results), dict[int, Result]()
    packed = _pickle_work(work) if tried < len(tasks) else None
    if packed is not None:
        with closing(_run_tasks(packed, tasks[tried:])) as found:
            for n, result in found:
                early[tried + n] = result
                while len(results) in early:
                    have(early.pop(len(results)))
    while (n := len(results)) < len(tasks):  # what processes cannot do, or what raises
        have(early.pop(n) if n in early else work(tasks[n]))
    return results


def _pickle_work(work: Callable[[Any], Any]) -> bytes | None:
    """What a process is given; None where that cannot leave this one, as what the caller's own script defines."""
    try:
        packed = pickle.dumps(work)
    except Exception:  # pickle raises whatever an object's own code does
        return None
    return None if b"__main__" in packed else packed


def _run_tasks(work: bytes, tasks: Sequence[Any]) -> Generator[tuple[int, Any], None, None]:
    """(n, result) of tasks as they are done; close it, and the processes are no more.

    Left out are a task that raised and those after it, tasks that took several processes along, and all where too many
    died.
    """
    todo, deaths = list(range(len(tasks))), Counter[int]()
    for _ in range(MAX_POOLS):
        if not todo:
            return
        given, ready = dict[int, PendingResult[Any]](), list[tuple[int, Any]]()
        processes = min(cores(), len(todo))
        with suppress(BrokenExecutor, OSError), open_pool(work, processes) as pool:
            while todo or given:
                while todo and len(given) < processes:
                    given[todo[0]] = pool.submit(tasks[todo[0]])
                    del todo[0]
                yield from ready  # with all at work meanwhile
                ready.clear()
                wait([each.future for each in given.values()], return_when=FIRST_COMPLETED)
                for n in [n for n, each in given.items() if each.future.done()]:
                    if given[n].future.result():
                        ready.append((n, given.pop(n).read()))
                    else:
                        del given[n]
                        todo = [k for k in todo if k < n]
        yield from ready
        deaths.update([*given])
        todo = sorted([*todo, *(n for n in given if deaths[n] < MAX_DEATHS)])


@dataclass(frozen=True, slots=True)
class PendingResult(Generic[Result]):
    """What a process was asked to do: whether that is done, and its result is in `file`."""

    future: "Future[bool]"
    file: Path

    @classmethod
    def none(cls) -> "PendingResult[Result]":
        """Of what no process was asked for."""
        nowhere: Future[bool] = Future()
        nowhere.set_result(False)
        return cls(nowhere, Path())

    def read(self) -> Result:
        """The result of what is done, once."""
        result: Result = pickle.loads(self.file.read_bytes())
        self.file.unlink()
        return result

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for it; `here` does the same in this process.

        That is asked for what cannot be done there, for want of a process or because one died of it, or because
        something cannot leave a process; and for what raised there, so that it raises here.
        """
        return here() if self.future.exception() is not None or not self.future.result() else self.read()


class Pool:
    """Processes that do one kind of work; when any dies, all do, and every future raises BrokenExecutor."""

    def __init__(self, executor: Any, folder: Path) -> None:
        self._executor, self._folder, self._numbers = executor, folder, count()

    def submit(self, task: Any) -> PendingResult[Any]:
        """Have it done. Raises BrokenExecutor, and what pickling the task raises."""
        file = self._folder / str(next(self._numbers))
        file.write_bytes(pickle.dumps(task))
        return PendingResult(self._executor.submit(_do_task, file), file)


@contextmanager
def open_pool(work: bytes, processes: int, modules: Sequence[str] = ()) -> Iterator[Pool]:
    """Processes that load modules, and then wait for tasks of pickled work; when the block ends, they are no more.

    Raises OSError where the system has no room for them.
    """
    from loky import ProcessPoolExecutor
    from loky.backend import resource_tracker as tracker

    with ExitStack() as stack:
        prefix = f"pulsepath-{os.getpid()}-"  # by which the command line clears up after a kill
        folder = Path(stack.enter_context(TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)))
        tracker.register(str(folder), "folder")  # which goes even where this process is killed
        stack.callback(tracker.unregister, str(folder), "folder")
        (folder / _WORK).write_bytes(work)
        ends = multiprocessing.Pipe(duplex=False)
        for end in ends:
            stack.enter_context(end)
        begin = (ends[0], tuple(modules))
        executor = ProcessPoolExecutor(processes, initializer=_begin_process, initargs=begin, env=_ENVIRONMENT)
        stack.callback(executor.shutdown, kill_workers=True)
        with hold_interrupts():
            executor.submit(int)  # on which they start
        yield Pool(executor, folder)


@contextmanager
def hold_interrupts() -> Iterator[None]:
    """No Ctrl-C in processes that start meanwhile: what is held off here is held off in them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # else started with them, when it would let Ctrl-C in again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_process(parent: "Connection", modules: Sequence[str]) -> None:
    """In a process: end with the one that started it, and load what its work takes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first process ends all
    Thread(target=_end_with_parent, args=(parent,), daemon=True).start()
    gc.set_threshold(*GC_THRESHOLDS)
    for name in modules:
        import_module(name)
    gc.freeze()  # loky has garbage collected after the first task


def _end_with_parent(parent: "Connection") -> None:
    """Even where that is killed: nothing ever comes through the pipe but its end."""
    with suppress(EOFError, OSError):
        parent.recv_bytes()
    os._exit(1)


def _do_task(file: Path) -> bool:
    """In a process: put the result in the task's place. Whether it is there: what raises is done again, and raises."""
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
    """A process beside this one, or none; it does one thing after the other."""

    def __init__(self, pool: Pool | None = None) -> None:
        self._pool = pool

    def start(self, work: Callable[[], Result]) -> PendingResult[Result]:
        """Have it begin, when it is through with what it was asked for before."""
        if self._pool is not None:
            with suppress(Exception):  # it is no more; and pickle raises whatever an object's own code does
                return self._pool.submit(work)
        return PendingResult.none()


NO_PROCESS = SideProcess()
"""No other process: everything is done here."""


@contextmanager
def side_process(modules: Sequence[str] = ()) -> Iterator[SideProcess]:
    """A process for a part of the work, with modules loaded, where there are a core and room for it."""
    with ExitStack() as stack:
        pool = None
        if _may_start():
            with suppress(OSError):
                pool = stack.enter_context(open_pool(pickle.dumps(operator.call), 1, modules))
        yield SideProcess(pool)


class LocalHelpers:
    """Processes of this computer that plan stretches, as `planner.windows.Helpers`, once a plan has taken a while.

    One for each core but that of this process, which has other work too: what they have no time for, it does.
    """

    def __init__(self, stack: ExitStack) -> None:
        """stack: ends the processes."""
        self._stack, self._begin, self._deaths = stack, perf_counter(), 0
        self._work: bytes | None = None
        self._pool: Pool | None = None
        self._given: list[PendingResult[Any]] = []

    def prepare(self, work: Callable[[Task], Result]) -> Callable[[Task], PendingResult[Result]]:
        """What gives a task of this work to a process."""
        self._work = _pickle_work(work)

        def submit(task: Task) -> PendingResult[Result]:
            self._given = [each for each in self._given if not each.future.done()]
            if self._pool is not None and len(self._given) < self._most:
                try:
                    self._given.append(self._pool.submit(task))
                    return self._given[-1]
                except (BrokenExecutor, OSError):  # one was killed, and others are started once more
                    self._pool, self._deaths = None, self._deaths + 1
                except Exception:  # pickle raises whatever an object's own code does
                    self._deaths = MAX_DEATHS
            return PendingResult.none()

        return submit

    def room(self) -> int:
        """How many tasks there are at a time, with one for this process: none at first, nor where nobody can help."""
        late = perf_counter() - self._begin > MIN_POOL_WORK
        if self._pool is None and self._work is not None and late and self._deaths < MAX_DEATHS and _may_start():
            try:
                self._pool = self._stack.enter_context(open_pool(self._work, cores() - 1))
            except OSError:
                self._deaths = MAX_DEATHS
        return 0 if self._pool is None else self._most + 1

    @property
    def _most(self) -> int:
        return TASKS_EACH * (cores() - 1)

    def tell_alone(self, segment: int) -> None:
        """Nobody asked for processes."""
