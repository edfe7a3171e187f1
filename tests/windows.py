"""Plans in parts of small windows, so that a short program has several of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from planner.plan_parts import make_parts
from pulsepath import parts_job


@contextmanager
def small_windows(pieces: int) -> Iterator[None]:
    """Let the command `plan --stream` plan so many pieces of the path at a time."""

    def make(request, *rest):
        return make_parts(replace(request, pieces=pieces), *rest)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts_job, "make_parts", make)
        yield
