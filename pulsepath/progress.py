"""Progress of long work, on stderr: a spinner on a terminal, a line per step elsewhere."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter


@contextmanager
def step(what: str) -> Iterator[None]:
    """Tell that a step begins, and in the end how long it took."""
    begin = perf_counter()
    if sys.stderr.isatty():
        from rich.console import Console

        with Console(stderr=True, markup=False).status(what):
            yield
    else:
        print(f"{what} …", file=sys.stderr, flush=True)
        yield
    print(f"{what}: {perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)
