"""Forces along a planned motion: the work of a round is nothing, the platform's motion the
path's.
"""

import numpy as np
import pytest

from kinematics import Body, forces
from tests.kinematics.bodies import LEG, PLATE, combine_bodies

PAYLOAD = Body(5.0, [0.02, 0, 0.05], np.diag([0.01, 0.02, 0.02]), "payload")


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("legs", [None, LEG])
def test_no_work_is_left_after_a_round(planned, order, legs):
    """From rest to rest in one place, ∫ Σ f q̇ dt = 0: Gauss with three points on every piece, 1e-6
    of ∫ |Σ f q̇| dt.
    """
    if legs is not None:
        pytest.importorskip("pinocchio")
    made = planned("bare-circle", order)
    trajectory = made.trajectory
    points, weights = np.polynomial.legendre.leggauss(3)
    length = np.diff(trajectory.knots)
    k = np.repeat(np.flatnonzero(length > 0), 3)
    share = np.tile((1 + points) / 2, len(k) // 3)
    state = trajectory.within(k, share * length[k])
    found = forces(made.machine, state, platform=combine_bodies(PLATE, PAYLOAD), legs=legs)
    power = found.power.sum(1)
    work, turnover = (np.tile(weights / 2, len(k) // 3) * length[k]) @ np.stack(
        [power, np.abs(power)], 1
    )
    assert turnover > 1e-3
    assert abs(work) < 1e-6 * turnover
    assert found.motion.twist[:, :3] == pytest.approx(state.tool_velocity, abs=1e-10)
