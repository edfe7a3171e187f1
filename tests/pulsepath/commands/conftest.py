"""What holds for the tests of commands that read a plan."""

import numpy as np
import pytest

from pulsepath.store.verify import prove_motion


@pytest.fixture(autouse=True)
def shared_proof(monkeypatch, request):
    """The motion of the shared plan is proved once, when it is made: that a command does so too has
    tests of its own.

    They are those of pulsepath.store.verify.
    """

    def prove(trajectory, limits, axes):
        plan = request.getfixturevalue("job").plan
        shared = plan.trajectory
        names = ("knots", "s", "v", "a", "j", "piece")
        same = all(
            np.array_equal(getattr(trajectory, name), getattr(shared, name)) for name in names
        )
        return (plan.certificate, plan.shaped) if same else prove_motion(trajectory, limits, axes)

    monkeypatch.setattr("pulsepath.store.read.prove_motion", prove)
