"""A command that loads much and ends soon has little use for the collection of garbage."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

# New objects until the youngest, the younger and all are looked through. Python's own numbers have a command look
# through all that it loads again and again, for a tenth of its time; with these what it draws is still cleared up.
THRESHOLDS = 50_000, 20, 100


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Inside it, garbage is collected seldom."""
    before = gc.get_threshold()
    gc.set_threshold(*THRESHOLDS)
    try:
        yield
    finally:
        gc.set_threshold(*before)
