"""Independent work on a cluster: Dask's, on this computer or on any number of others."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from importlib.util import find_spec
from typing import Any, TypeVar

from kinematics.errors import MotionError, NotInstalled
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
    work: Callable[[Task, Shared], Result], tasks: Sequence[Task], shared: Shared, address: str | None = None
) -> Iterator[tuple[int, Result | Lost]]:
    """(n, work(tasks[n], shared)) of every task as it is done, or that it was lost; a worker that dies costs time only.

    address: of a Dask scheduler whose workers have this package, such as "tcp://10.0.0.1:8786"; None: one worker for
    each core of this computer, for as long as this takes. `shared` goes to each worker once. What `work` raises is
    raised here. Raises MotionError where Dask is not installed or nothing answers.
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
        everywhere = client.scatter(shared, broadcast=True)
        futures = {client.submit(work, task, everywhere, pure=False): n for n, task in enumerate(tasks)}
        for future in as_completed(futures):
            try:
                yield futures[future], future.result()
            except KilledWorker as lost:
                yield futures[future], Lost(f"every worker that took it died, as for want of memory: {lost}")
