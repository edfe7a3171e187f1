"""Stops of the same motion from the same instant, computed once, for tests that look at what is
done with them.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from planner.interruption import hold

COLUMNS = ("knots", "s", "v", "a", "j", "piece")


@contextmanager
def shared_stops() -> Iterator[None]:
    """Compute each stop before any shaping once: at order 3 one of the hexapod takes 2 s.

    Only for a test with one machine, as stops are told apart by their motion and instant. That they
    are the soonest, and certified, has tests in tests/planner/interruption.
    """
    compute, made = hold._solve_stop, {}

    def share(whole, running, now):
        motion = running.trajectory
        key = (now.t, whole.order, *(getattr(motion, name).tobytes() for name in COLUMNS))
        if key not in made:
            made[key] = compute(whole, running, now)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hold, "_solve_stop", share)
        yield
