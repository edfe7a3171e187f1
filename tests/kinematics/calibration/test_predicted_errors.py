"""Foreseen standard errors: what a calibration with the further pose then states."""

import numpy as np
import pytest

from kinematics import (
    MotionError,
    Noise,
    Pose,
    calibrate,
    foreseen_errors,
    load_machine,
    load_measurements,
    measured_positions,
)

FIRST = (
    np.array(
        [[5.0, 0, 10], [-2.5, 4.3, 10], [-2.5, -4.3, 10], [0, 0, 25], [5, 5, 35], [-5, -5, 15]]
    )
    * 1e-3
)
FURTHER = np.array([[0.0, 0, 45], [0, 0, 12], [10, -5, 30]]) * 1e-3
NOISE = Noise(5e-6, 20e-6)


def measured(places):
    """1 % further from home than commanded, and 0.1 mm aside; exactly, so that noise moves no
    estimate.
    """
    return measured_positions(
        Pose.from_translation(places), 1.01 * places + [1e-4, 0, 0], noise=NOISE
    )


def test_they_are_those_of_the_calibration_with_that_pose():
    """The other way round: measure it, fit again, and read what the fit states.

    What the two differ by is the change of the estimates, some 1e-4 of them, since a hexapod's
    poses do not grow in exact proportion to its strokes.
    """
    machine = load_machine("hexapod")
    calibration = calibrate(machine, measured(FIRST))
    foreseen = foreseen_errors(calibration, Pose.from_translation(FURTHER))
    assert foreseen.shape == (3, len(calibration.parameters))
    for place, errors in zip(FURTHER, foreseen, strict=True):
        again = calibrate(machine, measured(np.vstack([FIRST, place])))
        stated = np.array([each.error for each in again.parameters]) / max(1.0, again.scale)
        assert errors / max(1.0, calibration.scale) == pytest.approx(stated, rel=1e-3)


def test_a_further_pose_never_makes_anything_less_certain():
    calibration = calibrate(load_machine("hexapod"), load_measurements("cmm"))
    errors = np.array([each.error for each in calibration.parameters])
    foreseen = foreseen_errors(calibration, Pose.from_translation(FURTHER))
    assert (foreseen <= errors * (1 + 1e-12)).all()
    factor = calibration.names.index("factor")
    assert foreseen[0, factor] < 0.9 * errors[factor]  # far up, where a longer pulse shows most


def test_what_nothing_shows_stays_unknown_until_a_pose_does():
    """All measured positions at one height over one place tell the factor from the frame's height
    nowhere.
    """
    machine = load_machine("hexapod")
    calibration = calibrate(
        machine, measured(np.array([[0, 0, 0.02]] * 4)), ("factor", "frame-yaw")
    )
    factor = calibration.names.index("factor")
    assert calibration.parameters[factor].error == np.inf
    same, other = foreseen_errors(calibration, Pose.from_translation([[0, 0, 0.02], [0, 0, 0.04]]))
    assert same[factor] == np.inf
    assert np.isfinite(other[factor])


def test_a_pose_that_cannot_be_measured():
    calibration = calibrate(load_machine("hexapod"), load_measurements("cmm"))
    with pytest.raises(MotionError, match="further measurements: pose 2"):
        foreseen_errors(calibration, Pose.from_translation([[0, 0, 0.02], [0, 0, 0.09]]))
