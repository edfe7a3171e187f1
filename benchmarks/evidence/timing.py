"""How long calls take: what every script that measures speed shares."""

import json
import subprocess
import sys
from collections.abc import Callable
from time import process_time
from typing import Any, TypeVar

Result = TypeVar("Result")


def time_calls(
    work: Callable[[], Result], repeats: int = 1, clock: Callable[[], float] = process_time, most: float = float("inf")
) -> tuple[Result, list[float]]:
    """The last result, and s of each call by a clock: no more once two calls or more have taken `most` s in all."""
    times: list[float] = []
    while True:
        begin = clock()
        result = work()
        times.append(clock() - begin)
        if len(times) == repeats or (len(times) > 1 and sum(times) > most):
            return result, times


def run_in_new_process(module: str, *arguments: object) -> Any:
    """What `python -m module` prints as JSON: nothing is warm there, and no memory is counted twice."""
    command = [sys.executable, "-m", module, *map(str, arguments)]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
