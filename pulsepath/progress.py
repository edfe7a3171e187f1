"""Progress of long work, on stderr: a spinner on a terminal, a line per step elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter

from pulsepath.interrupt import interruptible


@contextmanager
def step(what: str) -> Iterator[None]:
    """Tell that a step is under way, and in the end how long it took; Ctrl-C ends it at its end at the latest."""
    begin = perf_counter()
    with interruptible():
        if sys.stderr.isatty():
            from rich.console import Console

            with Console(stderr=True, markup=False).status(what):
                yield
        else:
            yield
    print(f"{what}: {perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)
