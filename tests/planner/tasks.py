"""Tasks of the tests of processes, which import no more than this to do them."""

import multiprocessing
import os
import time
from pathlib import Path


def where(task):
    """Return a task, and the process that does it; some tasks raise, or kill their process."""
    if task == "infeasible":
        from planner import Infeasible, Place

        place = Place(0.1, 2, 0.5, "leg1")
        raise Infeasible("tilt", "leg1 base joint", place, 36.0, 35.0, "deg", "move the path")
    if task == "dies":
        os._exit(1) if multiprocessing.parent_process() else None
    return task, os.getpid()


def multiply(array, task):
    time.sleep(0.02)  # so that one process is not through with all before the other has begun
    return array * task


def sleep(folder, seconds):
    """Sleep, and leave a file that says which process does."""
    Path(folder, str(os.getpid())).touch()
    time.sleep(seconds)
