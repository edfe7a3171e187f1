"""Hundreds of programs planned at once on a cluster: Dask's, on this computer or on any number of others."""

import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from types import ModuleType
from typing import Any, TypeVar

from kinematics.foundation.errors import MotionError, NotInstalled
from kinematics.machine.machine import Machine
from planner.environment import PACKAGES, Facts, Look, describe_mismatches, make_fact_finder
from planner.parallel import Progress, cores
from planner.plan import Plan, plan
from planner.program.model import Program

Task = TypeVar("Task")
Shared = TypeVar("Shared")
Result = TypeVar("Result")

# s to wait for a cluster that is said to be there.
MAX_CONNECTION_TIME = 10.0


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
    try:
        from distributed import Client, KilledWorker, LocalCluster, as_completed
    except ImportError as missing:
        raise NotInstalled("a cluster", "Dask", "cluster") from missing
    with ExitStack() as stack:
        cluster: Any = address
        if address is None:
            with _hide_main():
                local = LocalCluster(
                    n_workers=min(cores(), len(tasks)), threads_per_worker=1, processes=True, dashboard_address=None
                )
                cluster = stack.enter_context(local)
        try:
            client = stack.enter_context(Client(cluster, timeout=MAX_CONNECTION_TIME))
        except (OSError, ValueError) as silent:
            raise MotionError(f"no Dask scheduler answers at {address}: {silent}; check the address") from silent
        look = make_fact_finder(packages)
        _check_workers(client, look)
        checked = _wrap_checked(work, look, look())
        everywhere = client.scatter(pickle.dumps(shared), broadcast=True)
        futures = {
            client.submit(checked, pickle.dumps(task), everywhere, pure=False): n for n, task in enumerate(tasks)
        }
        for future in as_completed(futures):
            try:
                result, theirs = future.result()
            except KilledWorker as lost:
                yield futures[future], LostTask(f"every worker that ran it died, possibly out of memory: {lost}")
                continue
            if theirs is not None:
                raise _mismatch_error("a worker that joined later", describe_mismatches(look(), theirs))
            yield futures[future], result


@contextmanager
def _hide_main() -> Iterator[None]:
    """Around the start of Dask's processes: each would run the caller's script again, and few are made for it."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _check_workers(client: Any, look: Look) -> None:
    """Raise MotionError unless there are workers, all of which compute with what is here."""
    try:
        client.wait_for_workers(1, timeout=MAX_CONNECTION_TIME)
    except TimeoutError:
        raise MotionError(f"the Dask cluster has no worker after {MAX_CONNECTION_TIME:g} s: start some") from None
    ours = look()
    others = {worker: describe_mismatches(ours, theirs) for worker, theirs in client.run(look).items()}
    others = {worker: found for worker, found in others.items() if found}
    if others:
        worker, found = next(iter(others.items()))
        raise _mismatch_error(f"{len(others)} of the cluster's workers, as {worker},", found)


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
        import pickle

        theirs = look()
        if theirs != ours:
            return None, theirs
        return pickle.loads(packed)(pickle.loads(task), pickle.loads(shared)), None

    return do


def plan_many(
    programs: Iterable[Program],
    machine: Machine,
    *,
    order: int | None = None,
    clock_hz: int = 10_000_000,
    address: str | None = None,
    progress: Progress | None = None,
) -> list[Plan | MotionError]:
    """Plan many programs in parallel: a Plan, or the MotionError raised, for each, in order.

    order and clock_hz as of `plan`. address as of `run_on_cluster`: of a Dask scheduler; None: this computer's cores.
    progress is told how many programs are done, and of how many. Raises MotionError where Dask is not installed or
    nothing answers.
    """
    asked = list(programs)
    found: dict[int, Plan | MotionError] = {}
    if not asked:
        return []
    for n, one in run_on_cluster(_plan_one, asked, (machine, order, clock_hz), address):
        found[n] = MotionError(f"program {asked[n].name}: {one}") if isinstance(one, LostTask) else one
        if progress is not None:
            progress(len(found), len(asked))
    return [found[n] for n in range(len(asked))]


def _plan_one(program: Program, how: tuple[Machine, int | None, int]) -> Plan | MotionError:
    """On a worker."""
    machine, order, clock_hz = how
    try:
        return plan(program, machine, order=order, clock_hz=clock_hz)
    except MotionError as error:
        return error.with_traceback(None)
