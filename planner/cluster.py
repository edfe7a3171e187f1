"""Independent work on a cluster: Dask's, on this computer or on any number of others."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any, TypeVar

from kinematics.errors import MotionError, NotInstalled
from planner.environment import PACKAGES, Facts, Look, differences, looking
from planner.parallel import cores
from planner.workers import main_hidden

Task = TypeVar("Task")
Shared = TypeVar("Shared")
Result = TypeVar("Result")

# s to wait for a cluster that is said to be there.
PATIENCE = 10.0


class Lost(MotionError):
    """A task that killed every worker it was given to."""


def installed() -> bool:
    """Whether Dask is there."""
    try:
        return find_spec("distributed") is not None
    except ValueError:  # what stands in sys.modules under its name has no spec
        return False


def on_cluster(
    work: Callable[[Task, Shared], Result],
    tasks: Sequence[Task],
    shared: Shared,
    address: str | None = None,
    *,
    packages: Sequence[str] = PACKAGES,
) -> Iterator[tuple[int, Result | Lost]]:
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
            with main_hidden():
                local = LocalCluster(
                    n_workers=min(cores(), len(tasks)), threads_per_worker=1, processes=True, dashboard_address=None
                )
                cluster = stack.enter_context(local)
        try:
            client = stack.enter_context(Client(cluster, timeout=PATIENCE))
        except (OSError, ValueError) as silent:
            raise MotionError(f"no Dask scheduler answers at {address}: {silent}; check the address") from silent
        look = looking(packages)
        _compare(client, look)
        checked = _after_comparing(work, look, look())
        everywhere = client.scatter(pickle.dumps(shared), broadcast=True)
        futures = {
            client.submit(checked, pickle.dumps(task), everywhere, pure=False): n for n, task in enumerate(tasks)
        }
        for future in as_completed(futures):
            try:
                result, theirs = future.result()
            except KilledWorker as lost:
                yield futures[future], Lost(f"every worker that took it died, as for want of memory: {lost}")
                continue
            if theirs is not None:
                raise _differ("a worker that joined later", differences(look(), theirs))
            yield futures[future], result


def _compare(client: Any, look: Look) -> None:
    """Raise MotionError unless there are workers, all of which compute with what is here."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise MotionError(f"the Dask cluster has no worker after {PATIENCE:g} s: start some") from None
    ours = look()
    others = {worker: differences(ours, theirs) for worker, theirs in client.run(look).items()}
    others = {worker: found for worker, found in others.items() if found}
    if others:
        worker, found = next(iter(others.items()))
        raise _differ(f"{len(others)} of the cluster's workers, as {worker},", found)


def _differ(who: str, found: Sequence[str]) -> MotionError:
    return MotionError(
        f"{who} would give other results: {'; '.join(found)}. Install the same there, and start the workers again"
    )


def _after_comparing(work: Callable[[Any, Any], Any], look: Look, ours: Facts) -> Callable[[bytes, bytes], Any]:
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
