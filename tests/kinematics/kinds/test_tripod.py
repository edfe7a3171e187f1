"""The tripod: three arms above a plate that they do not turn."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import OutOfReach, load_machine


def test_the_tripod_hangs_and_holds_its_plate():
    """Arms by the theorem of Pythagoras; the tool is the point whose place a pose states."""
    tripod = load_machine("tripod")
    across, down = (300 - 60) / np.sqrt(3), 250.0
    assert tripod.home_q * 1e3 == pytest.approx([np.hypot(across, down)] * 3, abs=1e-6)
    assert np.rad2deg(
        np.arccos(tripod.tilt_map(np.concatenate([[0, 0, -0.3], np.eye(3).ravel()])[None]))
    ) == (pytest.approx(np.rad2deg(np.arctan2(across, down)), abs=1e-6))
    pulse = tripod.axes[0].pulse
    assert 1e-3 / pulse == pytest.approx(
        500 * 50, rel=1e-12
    )  # counts per mm, step pulses per count [KMITL 2005]


@pytest.mark.parametrize("turn", [[0.3, 0.0, 0.0], [0.0, -0.2, 0.01], [0.01, 0.0, 0.1]])
def test_the_largest_of_what_is_off_is_named(turn):
    tripod = load_machine("tripod")
    name, value = ("rx", "ry", "rz")[int(np.argmax(np.abs(turn)))], np.rad2deg(max(turn, key=abs))
    with pytest.raises(
        OutOfReach, match=f"holds {name}: pose 0 has {name} {value:.6g} deg off home"
    ):
        tripod.inverse(
            RigidTransform.from_components(tripod.home.translation, Rotation.from_rotvec(turn))
        )
