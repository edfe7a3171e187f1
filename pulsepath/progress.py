"""Progress of long work, on stderr: a spinner on a terminal, a line per step elsewhere, and how far long steps are."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from pulsepath import talk

EVERY = 10.0
"""s between two lines of a long step, where they are not drawn over each other."""
COUNTED = 1000
"""Up to so many, things are told by number; of more, as of ticks or bytes, their share says enough."""


@contextmanager
def step(what: str) -> Iterator[Callable[[int, int], None]]:
    """Tell that a step begins, and in the end how long it took; what it yields tells how much is done, of how much."""
    begin, what = perf_counter(), talk.plain(what)
    if talk.level() == talk.QUIET:
        yield _nothing
        return
    if talk.dressed(sys.stderr):
        from rich.console import Console

        with Console(stderr=True, markup=False).status(what) as status:
            yield lambda done, of: status.update(f"{what}: {_far(done, of)}")
    else:
        print(f"{what} …", file=sys.stderr, flush=True)
        told = begin

        def tell(done: int, of: int) -> None:
            nonlocal told
            if perf_counter() - told > EVERY:
                told = perf_counter()
                print(f"{what}: {_far(done, of)}", file=sys.stderr, flush=True)

        yield tell
    print(f"{what}: {perf_counter() - begin:.1f} s", file=sys.stderr, flush=True)


def _nothing(done: int, of: int) -> None:
    """What is told of progress where all is to be quiet."""


def _far(done: int, of: int) -> str:
    return f"{done} of {of}" if of <= COUNTED else f"{100 * done // of} %"
