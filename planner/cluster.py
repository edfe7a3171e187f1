"""Work on a Dask cluster of one or more computers: whole programs, or windows of a long program."""

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

# s to wait for a scheduler or a worker: a shorter time refuses slow networks, a longer one delays
# the message about a wrong address.
MAX_CONNECTION_TIME = 10.0
ALONE = "the motion goes on for long without a stop: its windows need each other, and this computer plans them in turn"
# s between two attempts to read the file that a scheduler is about to write.
FILE_PERIOD = 0.1
# Dask's own loggers are silenced: errors are raised here, and the rest concerns interrupted
# clusters.
LOGGERS = "distributed", "distributed.client", "tornado.application", "asyncio"
WORKER_LOGS = {"distributed.nanny.pre-spawn-environ.DASK_LOGGING__DISTRIBUTED": "critical"}


class LostTask(MotionError):
    """A task that killed every worker that ran it."""


def is_installed() -> bool:
    """Return whether Dask is installed."""
    try:
        return find_spec("distributed") is not None
    except ValueError:  # the entry in sys.modules has no spec
        return False


def run_on_cluster(
    work: Callable[[Task, Shared], Result],
    tasks: Sequence[Task],
    shared: Shared,
    address: str | None = None,
    *,
    packages: Sequence[str] = PACKAGES,
) -> Iterator[tuple[int, Result | LostTask]]:
    """Yield (n, work(tasks[n], shared)) of each task as it is done, or a LostTask.

    A worker that dies costs time only. `shared` goes to each worker once. An exception of `work`
    is raised here.

    address: of a Dask scheduler whose workers have this package, such as "tcp://10.0.0.1:8786".
    None: one worker for each core of this computer, until all tasks are done.

    packages: packages whose sources determine the results. They, Python and the libraries must be
    the same on every worker. This is compared before the first task, and again by each worker
    before each task, since workers may join later.

    Raises MotionError if Dask is not installed, if no scheduler answers, or if there is no worker
    or a different one.
    """
    with open_cluster(address, packages, most=len(tasks)) as cluster:
        from distributed import KilledWorker, as_completed

        checked = _wrap_checked(work, cluster.look, cluster.look())
        everywhere = cluster.send(shared)
        waiting = iter(enumerate(tasks))
        futures = dict[Any, int]()
        done = as_completed()

        def submit() -> None:
            for n, task in waiting:
                future = cluster.client.submit(checked, pickle.dumps(task), everywhere, pure=False)
                futures[future] = n
                done.add(future)
                if len(futures) >= cluster.room():
                    return

        submit()
        for future in done:
            n = futures.pop(future)
            submit()
            try:
                result, theirs = future.result()
            except KilledWorker as error:
                yield n, LostTask(f"every worker that ran it died, possibly out of memory: {error}")
                continue
            future.release()
            if theirs is not None:
                raise _mismatch_error(
                    "a worker that joined later", describe_mismatches(cluster.look(), theirs)
                )
            yield n, result


@contextmanager
def open_cluster(
    address: str | None = None,
    packages: Sequence[str] = PACKAGES,
    *,
    most: int | None = None,
    tell: Callable[[str], None] | None = None,
) -> "Iterator[Cluster]":
    """Connect to the workers of a Dask scheduler until the block ends.

    address: of the scheduler, or the file that it wrote; None: one worker for each core.
    most: largest number of these workers. tell: prints a message about workers that fail; None: the
    logger `pulsepath`. Raises MotionError as `run_on_cluster`.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise NotInstalled("a cluster", "Dask", "cluster") from error
    with _hush_logs(), ExitStack() as stack:
        scheduler: Any
        if address is None:
            # workers inherit the blocked Ctrl-C: this process ends them, once they have started
            with _hide_main(), hold_interrupts(), dask.config.set(WORKER_LOGS):
                local = LocalCluster(
                    n_workers=min(cores(), most or cores()),
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address="127.0.0.1:0",
                )
                scheduler = stack.enter_context(local)
        else:
            scheduler = _find_scheduler(address)
        try:
            client = stack.enter_context(Client(scheduler, timeout=MAX_CONNECTION_TIME))
        except (OSError, ValueError, TypeError, ImportError) as error:
            # a tls:// address without keys raises TypeError
            reason = f"{error}" or type(error).__name__
            raise MotionError(
                f"no Dask scheduler answers at {scheduler}: {reason}; check the address",
            ) from error
        look = make_fact_finder(packages)
        tell = tell or logging.getLogger("pulsepath").warning
        _check_workers(client, look)
        _tell_processors(client, tell)
        yield Cluster(client, look, tell)


def _find_scheduler(address: str) -> str:
    """Return the address in a .json file of `dask scheduler --scheduler-file`, else `address`."""
    if not address.endswith(".json"):
        return address
    file = Path(address)
    end = time.monotonic() + MAX_CONNECTION_TIME
    while True:
        try:
            return str(json.loads(file.read_bytes())["address"])
        except FileNotFoundError:
            reason = "there is no such file"
        except (OSError, ValueError, KeyError, TypeError) as error:
            reason = f"it cannot be read ({error})"
        if time.monotonic() > end:
            raise MotionError(
                f"{file}: {reason}; give the address, or the --scheduler-file of a Dask scheduler",
            )
        time.sleep(FILE_PERIOD)


class Cluster:
    """Workers of a Dask scheduler that share this process's work: `planner.windows.Helpers`."""

    def __init__(self, client: Any, look: Look, tell: Callable[[str], None]) -> None:
        self.client = client
        self.look = look
        self._tell = tell
        self._refused = set[str]()  # addresses
        self._messages = set[str]()  # printed already

    def find_workers(self) -> list[str]:
        """Return the addresses of the present workers, without the refused ones."""
        if not self._there():
            return []
        try:
            return [worker for worker in self.client.nthreads() if worker not in self._refused]
        except Exception:  # the client raises any exception when its scheduler ends meanwhile
            return []

    def _there(self) -> bool:
        return self.client.status not in ("closing", "closed")

    def room(self) -> int:
        """Return how many tasks are sent at a time; 0 after the scheduler has ended."""
        return TASKS_EACH * max(1, len(self.find_workers())) if self._there() else 0

    def send(self, value: Any) -> Any:
        """Send a value to each worker that needs it, once.

        It is sent as a task, which Dask does again if all workers that have the value died.
        """
        packed = pickle.dumps(value)

        def give() -> bytes:
            return packed

        return self.client.submit(give, pure=False)

    def prepare(self, work: Callable[[Task], Result]) -> "Callable[[Task], SharedTask[Result]]":
        """Return the function that sends a task of this work to a worker."""
        checked = _wrap_checked(_call, self.look, self.look())
        everywhere = self.send(work)

        def submit(task: Task) -> SharedTask[Result]:
            chosen = self.find_workers() if self._refused else None
            try:
                packed = pickle.dumps(task)
                future = self.client.submit(checked, packed, everywhere, pure=False, workers=chosen)
            except Exception as error:  # pickling runs the task's own code; the client may end
                return SharedTask(self, None, f"it cannot be sent: {error}")
            return SharedTask(self, future)

        return submit

    def refuse(self, future: Any, theirs: Facts) -> str:
        """Send no more tasks to the worker of a future, whose facts differ; return the reason."""
        owners = self.client.who_has([future]).values()
        self._refused |= {worker for each in owners for worker in each}
        mismatches = describe_mismatches(self.look(), theirs)
        return str(_mismatch_error("a worker that joined later", mismatches))

    def tell_lost(self, why: str) -> None:
        """Report that this computer does work that no worker did: once per reason."""
        self._tell_once(why, f"done by this computer instead of the cluster: {why}")

    def tell_alone(self, segment: int) -> None:
        """Report once that windows without a stop between them are not shared."""
        self._tell_once(ALONE, f"from segment {segment} on {ALONE}")

    def _tell_once(self, reason: str, message: str) -> None:
        if reason not in self._messages:
            self._messages.add(reason)
            self._tell(message)


@dataclass(frozen=True, slots=True)
class SharedTask(Generic[Result]):
    """A task sent to a worker of a cluster, or the reason (`unsent`) why it was not sent."""

    cluster: Cluster
    future: Any
    unsent: str = ""

    def result(self, here: Callable[[], Result]) -> Result:
        """Wait for the result. `here` does the task in this process if no worker does it."""
        try:
            return self._wait()
        except _LostShareError as error:
            self.cluster.tell_lost(str(error))
            return here()
        finally:
            if self.future is not None:
                self.future.release()

    def _wait(self) -> Result:
        if self.future is None:
            raise _LostShareError(self.unsent)
        while True:
            try:
                answer: tuple[Result, Facts | None] = self.future.result(MAX_CONNECTION_TIME)
            except TimeoutError:
                if self.cluster.find_workers():
                    continue
                raise _LostShareError("it has no worker any more") from None
            except (asyncio.CancelledError, CancelledError) as error:
                raise _LostShareError("its scheduler is no more") from error
            except Exception as error:  # for example, a library that only the worker lacks
                raise _LostShareError(f"{type(error).__name__}: {error}") from error
            result, theirs = answer
            if theirs is not None:
                raise _LostShareError(self.cluster.refuse(self.future, theirs))
            return result


class _LostShareError(Exception):
    """The reason why no worker did a task."""


@contextmanager
def _hide_main() -> Iterator[None]:
    """Hide the caller's script while Dask's processes start: each would run it again."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextmanager
def _hush_logs() -> Iterator[None]:
    """Silence Dask's own logs until the block ends.

    After Ctrl-C they stay silent: they would print below the program's last line.
    """
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
    """Raise MotionError unless there are workers, all with this process's facts."""
    try:
        client.wait_for_workers(1, timeout=MAX_CONNECTION_TIME)
    except TimeoutError:
        raise MotionError(
            f"the Dask cluster has no worker after {MAX_CONNECTION_TIME:g} s: start some"
        ) from None
    versions = client.get_versions()
    python = versions["client"]["host"]["python"]
    for worker, facts in versions["workers"].items():
        if facts["host"]["python"] != python:  # another Python cannot run `look`
            raise _mismatch_error(worker, [f"python {facts['host']['python']} (here {python})"])
    ours = look()
    every = {
        worker: describe_mismatches(ours, theirs) for worker, theirs in client.run(look).items()
    }
    others = {worker: mismatches for worker, mismatches in every.items() if mismatches}
    if others:
        worker, mismatches = next(iter(others.items()))
        who = f"{len(others)} of the cluster's workers, as {worker},"
        raise _mismatch_error(who, mismatches)


def _tell_processors(client: Any, tell: Callable[[str], None]) -> None:
    """Report workers whose processor has other instructions.

    numpy and BLAS choose their code by the processor, and so round differently.
    """

    def look() -> tuple[str, ...]:
        from platform import machine

        import numpy as np

        known = np.show_config(mode="dicts").get("SIMD Extensions", {})  # empty entries are missing
        return machine(), *known.get("found", ())

    others = [worker for worker, theirs in client.run(look).items() if theirs != look()]
    if others:
        tell(
            f"{len(others)} of the cluster's workers, as {others[0]}, have another kind of processor than this "
            "computer: what they compute may differ in its last digits, though it is proved all the same"
        )


def _mismatch_error(who: str, mismatches: Sequence[str]) -> MotionError:
    return MotionError(
        f"{who} would give different results: {'; '.join(mismatches)}. "
        "Install the same there, and start the workers again",
    )


def _wrap_checked(
    work: Callable[[Any, Any], Any], look: Look, ours: Facts
) -> Callable[[bytes, bytes], Any]:
    """Wrap `work` for a worker: return (result, None), or (None, its facts) if they are not ours.

    The wrapper is local and takes bytes, so that a worker with other sources of this project
    unpacks none of its objects.
    """
    packed = pickle.dumps(work)

    def do(task: bytes, shared: bytes) -> Any:
        theirs = look()
        if theirs != ours:
            return None, theirs
        from planner.cluster import do_task

        return do_task(packed, task, shared), None

    return do


# The threads of a worker would share caches that are made for one thread.
_ONE_TASK = Lock()


def do_task(work: bytes, task: bytes, shared: bytes) -> Any:
    """Do a task on a worker, one at a time.

    `shared` is unpacked once, with the caches built on it.
    """
    with _ONE_TASK, without_processes():
        return _unpack(work)(pickle.loads(task), _unpack(shared))


_unpack = lru_cache(4)(pickle.loads)


def _call(task: Task, work: Callable[[Task], Result]) -> Result:
    return work(task)
