"""Plans in parts of small windows, so that a short program has several of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from planner.plan_parts import plan_parts
from pulsepath import parts_job


@contextmanager
def small_windows(pieces: int) -> Iterator[None]:
    """Let the command `plan --stream` plan so many pieces of the path at a time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts_job, "plan_parts", partial(plan_parts, pieces=pieces))
        yield
