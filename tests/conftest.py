"""What holds for all tests."""

import gc
import os
import signal
from collections.abc import Callable, Generator, Iterator
from functools import cache
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from kinematics import NotInstalled

if TYPE_CHECKING:
    from planner import Plan

# The same code gives the same verdict; to look for new examples: pytest
# --hypothesis-profile=default
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

# What a shell runs in the background is deaf to Ctrl-C, under nohup to a hang-up, and the tests'
# commands would be too.
SIGNALS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]
for _number in SIGNALS:
    if signal.getsignal(_number) is signal.SIG_IGN:
        signal.signal(
            _number, signal.default_int_handler if _number == signal.SIGINT else signal.SIG_DFL
        )
# Commands print tables as wide as COLUMNS says: without it they are alike wherever the tests run.
os.environ.pop("COLUMNS", None)
CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


def pytest_configure() -> None:
    """Keeps each worker of `pytest -n` to a core of its own, where there are no more cores than
    workers.

    Commands called without a process would each start a second one, for a core that another worker
    uses.
    """
    worker, count = (
        os.environ.get("PYTEST_XDIST_WORKER", ""),
        os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0"),
    )
    if CORES and 1 < len(CORES) <= int(count):
        os.sched_setaffinity(0, {CORES[int(worker.removeprefix("gw")) % len(CORES)]})


@pytest.fixture(autouse=True)
def _same_signals() -> Iterator[None]:
    """A command that a signal ended leaves its process deaf to others, as the last of it: the tests
    go on in theirs.
    """
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.fixture
def all_cores() -> Iterator[None]:
    """Those of the machine: for tests of what several processes do."""
    if not CORES:
        yield
        return
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, CORES)
    yield
    os.sched_setaffinity(0, before)


@pytest.fixture(scope="session")
def plan_bundled() -> "Callable[..., Plan]":
    """Plan a bundled program on a bundled machine, once for all tests: program, machine, order.

    Not to be changed.
    """

    @cache
    def make(program: str, machine: str, order: int) -> "Plan":
        from planner import plan

        return plan(program, machine, order=order)

    return make


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Spread work over so many cores, from so much work (s) on; without arguments over two, however
    little there is.
    """

    def spread(cores: int = 2, least: float = 0.0) -> None:
        monkeypatch.setattr("planner.parallel.cores", lambda: cores)
        monkeypatch.setattr("planner.parallel.MIN_POOL_WORK", least)

    return spread


@pytest.fixture
def limit_search(monkeypatch):
    """(s) -> refusals search for a remedy so long: 0 where a test does not look at it."""
    return lambda seconds: monkeypatch.setattr("planner.remedies.MAX_SEARCH_TIME", seconds)


@pytest.fixture
def connection_time(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Wait so long (s) for a cluster: short where none comes, long for workers that start while
    other tests run.
    """
    return lambda seconds: monkeypatch.setattr("planner.cluster.MAX_CONNECTION_TIME", seconds)


def pytest_collection_finish() -> None:
    """What was collected and loaded stays to the end: it is not looked through for garbage again
    and again.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup() -> Generator[None]:
    """Where a package has no wheel, or an extra was not installed, what needs it is skipped and
    says what it needs.
    """
    try:
        yield
    except NotInstalled as absent:
        pytest.skip(str(absent))


pytest_runtest_call = pytest_runtest_setup
