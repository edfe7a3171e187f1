"""Work on a cluster: Dask's, on this computer or on any number of others: programs, and the windows of a long one."""

import asyncio
import json
import logging
import pickle
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from types import ModuleType
from typing import Any, Generic, TypeVar

from kinematics.foundation.errors import MotionError, NotInstalled
from planner.environment import PACKAGES, Facts, Look, describe_mismatches, make_fact_finder
from planner.parallel import TASKS_EACH, cores, hold_interrupts, without_processes

Task = TypeVar("Task")
Shared = TypeVar("Shared")
Result = TypeVar("Result")

# s to wait for a cluster that is said to be there, and for a worker where there is none any more.
MAX_CONNECTION_TIME = 10.0
ALONE = "the motion goes on for long without a stop: its windows need each other, and this computer plans them in turn"
# Between two looks (s) for a file that a scheduler is about to write.
FILE_PERIOD = 0.1
# What Dask says of itself: what goes wrong is raised here, and all it adds is said of clusters that are ended midway.
LOGGERS = "distributed", "distributed.client", "tornado.application", "asyncio"
WORKER_LOGS = {"distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical"}


class LostTask(MotionError):
    """A task that killed every worker it was given to."""


def is_installed() -> bool:
    """Whether Dask is there."""
    try:
        return find_spec("distributed") is not None
    except ValueError:  # what stands in sys.modules under its name has no spec
        return False


def run_on_cluster(
    work: Callable[[Task, Shared], Result],
    tasks: Sequence[Task],
    shared: Shared,
    address: str | None = None,
    *,
    packages: Sequence[str] = PACKAGES,
) -> Iterator[tuple[int, Result | LostTask]]:
    """(n, work(tasks[n], shared)) of every task as it is done, or that it was lost; a worker that dies costs time only.

    address: of a Dask scheduler whose workers have this package, such as "tcp://10.0.0.1:8786"; None: one worker for
    each core of this computer, for as long as this takes. `shared` goes to each worker once. What `work` raises is
    raised here.

    packages: whose sources make the results. They, Python and the libraries must be the same on every worker: this is
    compared before any work is given out, and by each worker again before each task, for those that join later.

    Raises MotionError where Dask is not installed, nothing answers, there is no worker, or one differs.
    """
    with open_cluster(address, packages, most=len(tasks)) as cluster:
        from distributed import KilledWorker, as_completed

        checked, everywhere = _wrap_checked(work, cluster.look, cluster.look()), cluster.send(shared)
        waiting, futures, done = iter(enumerate(tasks)), dict[Any, int](), as_completed()

        def submit() -> None:
            for n, task in waiting:
                futures[future := cluster.client.submit(checked, pickle.dumps(task), everywhere, pure=False)] = n
                done.add(future)
                if len(futures) >= cluster.room():
                    return

        submit()
        for future in done:
            n = futures.pop(future)
            submit()
            try:
                result, theirs = future.result()
            except KilledWorker as lost:
                yield n, LostTask(f"every worker that ran it died, possibly out of memory: {lost}")
                continue
            future.release()
            if theirs is not None:
                raise _mismatch_error("a worker that joined later", describe_mismatches(cluster.look(), theirs))
            yield n, result


@contextmanager
def open_cluster(
    address: str | None = None,
    packages: Sequence[str] = PACKAGES,
    *,
    most: int | None = None,
    tell: Callable[[str], None] | None = None,
) -> "Iterator[Cluster]":
    """The workers of a Dask scheduler: at an address, or in the file that it wrote; None: of this computer's cores.

    most: of these workers. tell: what is told of workers that do not do what they were given; None: the logger
    `pulsepath`. Raises MotionError as `run_on_cluster`.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as missing:
        raise NotInstalled("a cluster", "Dask", "cluster") from missing
    with _hush_logs(), ExitStack() as stack:
        there: Any = None if address is None else _find_scheduler(address)
        if address is None:
            # workers inherit that no Ctrl-C comes to them: this process ends them, once they have started
            with _hide_main(), hold_interrupts(), dask.config.set(WORKER_LOGS):
                count = min(cores(), most or cores())
                local = LocalCluster(
                    n_workers=count, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
                )
                there = stack.enter_context(local)
        try:
            client = stack.enter_context(Client(there, timeout=MAX_CONNECTION_TIME))
        except (OSError, ValueError, TypeError, ImportError) as silent:  # of a tls:// address without keys a TypeError
            told = f"{silent}" or type(silent).__name__
            raise MotionError(f"no Dask scheduler answers at {there}: {told}; check the address") from silent
        look, tell = make_fact_finder(packages), tell or logging.getLogger("pulsepath").warning
        _check_workers(client, look)
        _tell_processors(client, tell)
        yield Cluster(client, look, tell)


def _find_scheduler(address: str) -> str:
    """What `dask scheduler --scheduler-file` wrote into a file that is named, or an address as it is."""
    if not address.endswith(".json"):
        return address
    file, end = Path(address), time.monotonic() + MAX_CONNECTION_TIME
    while True:
        try:
            return str(json.loads(file.read_bytes())["address"])
        except FileNotFoundError:
            no = "there is no such file"
        except (OSError, ValueError, KeyError, TypeError) as error:
            no = f"it cannot be read ({error})"
        if time.monotonic() > end:
            raise MotionError(f"{file}: {no}; give the address, or the --scheduler-file of a Dask scheduler")
        time.sleep(FILE_PERIOD)


class Cluster:
    """Workers of a Dask scheduler that compute what this process would: `planner.windows.Helpers`."""

    def __init__(self, client: Any, look: Look, tell: Callable[[str], None]) -> None:
        self.client, self.look, self._tell = client, look, tell
        self._refused, self._told = set[str](), set[str]()  # addresses, and what was told already

    def find_workers(self) -> list[str]:
        """Addresses of those that are there and are not refused."""
        if not self._there():
            return []
        try:
            return [worker for worker in self.client.nthreads() if worker not in self._refused]
        except Exception:  # of a scheduler that ends meanwhile whatever its client meets
            return []

    def _there(self) -> bool:
        return self.client.status not in ("closing", "closed")

    def room(self) -> int:
        """How many tasks they are given at a time; none where the scheduler is no more."""
        return TASKS_EACH * max(1, len(self.find_workers())) if self._there() else 0

    def send(self, value: Any) -> Any:
        """To each worker that needs it, once: as a task, which is done again where all that had it died."""
        packed = pickle.dumps(value)

        def give() -> bytes:
            return packed

        return self.client.submit(give, pure=False)

    def prepare(self, work: Callable[[Task], Result]) -> "Callable[[Task], SharedTask[Result]]":
        """What gives a task of this work to a worker."""
        checked, everywhere = _wrap_checked(_call, self.look, self.look()), self.send(work)

        def submit(task: Task) -> SharedTask[Result]:
            chosen = self.find_workers() if self._refused else None
            try:
                future = self.client.submit(checked, pickle.dumps(task), everywhere, pure=False, workers=chosen)
            except Exception as no:  # pickle raises whatever an object's own code does, and so does a client that ends
                return SharedTask(self, None, f"it cannot be sent: {no}")
            return SharedTask(self, future)

        return submit

    def refuse(self, future: Any, theirs: Facts) -> str:
        """Give the worker that has looked instead of working no more; returns why."""
        self._refused |= {worker for each in self.client.who_has([future]).values() for worker in each}
        return str(_mismatch_error("a worker that joined later", describe_mismatches(self.look(), theirs)))

    def tell_lost(self, why: str) -> None:
        """Of work that no worker did, that it is done here: once of each reason."""
        if why not in self._told:
            self._told.add(why)
            self._tell(f"done by this computer instead of the cluster: {why}")

    def tell_alone(self, segment: int) -> None:
        """That windows without a stop between them are not shared: once."""
        if ALONE not in self._told:
            self._told.add(ALONE)
            self._tell(f"from segment {segment} on {ALONE}")


@dataclass(frozen=True, slots=True)
class SharedTask(Generic[Result]):
    """What a worker of a cluster was asked for, or why none was."""

    cluster: Cluster
    future: Any
    unsent: str = ""

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for it; `here` does in this process what no worker does, be it for want of one or because it raises."""
        try:
            return self._wait()
        except _LostShareError as lost:
            self.cluster.tell_lost(str(lost))
            return here()
        finally:
            if self.future is not None:
                self.future.release()

    def _wait(self) -> Result:
        if self.future is None:
            raise _LostShareError(self.unsent)
        while True:
            try:
                found: tuple[Result, Facts | None] = self.future.result(MAX_CONNECTION_TIME)
            except TimeoutError:
                if self.cluster.find_workers():
                    continue
                raise _LostShareError("it has no worker any more") from None
            except (asyncio.CancelledError, CancelledError) as error:
                raise _LostShareError("its scheduler is no more") from error
            except Exception as error:  # a worker lacks what it lacks
                raise _LostShareError(f"{type(error).__name__}: {error}") from error
            result, theirs = found
            if theirs is not None:
                raise _LostShareError(self.cluster.refuse(self.future, theirs))
            return result


class _LostShareError(Exception):
    """Why no worker did something."""


@contextmanager
def _hide_main() -> Iterator[None]:
    """Around the start of Dask's processes: each would run the caller's script again, and few are made for it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _hush_logs() -> Iterator[None]:
    """Around a cluster: nothing of Dask's own logs; as before after it, unless Ctrl-C ends all: what is left of it then
    would speak after the last line."""
    before = {name: logging.getLogger(name).level for name in LOGGERS}
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        yield
    except (KeyboardInterrupt, GeneratorExit):
        before.clear()
        raise
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


def _check_workers(client: Any, look: Look) -> None:
    """Raise MotionError unless there are workers, all of which compute with what is here."""
    try:
        client.wait_for_workers(1, timeout=MAX_CONNECTION_TIME)
    except TimeoutError:
        raise MotionError(f"the Dask cluster has no worker after {MAX_CONNECTION_TIME:g} s: start some") from None
    versions = client.get_versions()
    python = versions["client"]["host"]["python"]
    for worker, there in versions["workers"].items():
        if there["host"]["python"] != python:  # which does not run the code that looks
            raise _mismatch_error(worker, [f"python {there['host']['python']} (here {python})"])
    ours = look()
    others = {worker: describe_mismatches(ours, theirs) for worker, theirs in client.run(look).items()}
    others = {worker: found for worker, found in others.items() if found}
    if others:
        worker, found = next(iter(others.items()))
        raise _mismatch_error(f"{len(others)} of the cluster's workers, as {worker},", found)


def _tell_processors(client: Any, tell: Callable[[str], None]) -> None:
    """Of workers whose processor has other instructions: numpy and BLAS choose theirs by that, and round otherwise."""

    def look() -> tuple[str, ...]:
        from platform import machine

        import numpy as np

        known = np.show_config(mode="dicts").get("SIMD Extensions", {})  # which leaves out what is empty
        return machine(), *known.get("found", ())

    others = [worker for worker, theirs in client.run(look).items() if theirs != look()]
    if others:
        tell(
            f"{len(others)} of the cluster's workers, as {others[0]}, have another kind of processor than this "
            "computer: what they compute may differ in its last digits, though it is proved all the same"
        )


def _mismatch_error(who: str, found: Sequence[str]) -> MotionError:
    return MotionError(
        f"{who} would give different results: {'; '.join(found)}. Install the same there, and start the workers again"
    )


def _wrap_checked(work: Callable[[Any, Any], Any], look: Look, ours: Facts) -> Callable[[bytes, bytes], Any]:
    """What a worker does: its result and None, or none and its facts where they are not ours.

    Local and of bytes, so that nothing of this project is unpacked where it is another.
    """
    packed = pickle.dumps(work)

    def do(task: bytes, shared: bytes) -> Any:
        theirs = look()
        if theirs != ours:
            return None, theirs
        from planner.cluster import do_task

        return do_task(packed, task, shared), None

    return do


# Of a worker with several threads, which would share what is made for one.
_ONE_TASK = Lock()


def do_task(work: bytes, task: bytes, shared: bytes) -> Any:
    """On a worker, one at a time: what all tasks share is unpacked for the first, and with it what is built on it."""
    with _ONE_TASK, without_processes():
        return _unpack(work)(pickle.loads(task), _unpack(shared))


_unpack = lru_cache(4)(pickle.loads)


def _call(task: Task, work: Callable[[Task], Result]) -> Result:
    return work(task)
