"""Processor time, wall time and memory of calls: shared by all cases that measure speed."""

import resource
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")


def time_calls(
    work: Callable[[], Result],
    repeats: int = 1,
    clock: Callable[[], float] = process_time,
    most: float = float("inf"),
) -> tuple[Result, list[float]]:
    """Return the last result, and the seconds that each call took by `clock`.

    The calls end early once two or more of them have taken `most` seconds together.
    """
    times: list[float] = []
    while True:
        begin = clock()
        result = work()
        times.append(clock() - begin)
        if len(times) == repeats or (len(times) > 1 and sum(times) > most):
            return result, times


@dataclass(frozen=True, slots=True)
class Measured(Generic[Result]):
    """Result of a call in a process of its own.

    processor  s of processor time, of the call and of the processes that it started
    wall       s of wall time
    peak       bytes of memory, at most at one time, of the process with the most
    """

    result: Result
    processor: float
    wall: float
    peak: int


def measure_apart(work: Callable[..., Result], *arguments: Any) -> Measured[Result]:
    """Call `work` in a new process, in which nothing is loaded and no memory is in use yet."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(measure_here, work, *arguments).result()


def measure_here(work: Callable[..., Result], *arguments: Any) -> Measured[Result]:
    """Call `work` in this process. The peak is that of the process so far."""
    processor, wall = processor_time(), perf_counter()
    result = work(*arguments)
    return Measured(result, processor_time() - processor, perf_counter() - wall, peak_memory())


def processor_time() -> float:
    """Return s of processor time of this process and of the processes that it has ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + ended.ru_utime + ended.ru_stime


def peak_memory() -> int:
    """Return the bytes of memory that the largest of this process and its ended ones had at
    most.
    """
    # ru_maxrss of this process would count the memory of the process that started it
    mine = int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])
    return 1024 * max(mine, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
