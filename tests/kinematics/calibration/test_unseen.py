"""Combinations of parameters that poses do not show: warned of, named, and shown by the proposed
poses.
"""

import re

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import calibrate, load_machine, whole_poses
from kinematics.calibration.unseen import MAX_PROPOSED
from kinematics.machine.load import Load
from kinematics.machine.pose import make_pose
from tests.kinematics.calibration.drawn_hexapod import (
    NOISE,
    draw,
    draw_commands,
    predict_poses,
    rms,
)

HEIGHTS = np.linspace(2e-3, 45e-3, 16)
POSE = re.compile(r"\(([^)]*)\) mm(?: turned \(([^)]*)\) deg)?")


def along_z():
    return make_pose(np.column_stack([0 * HEIGHTS, 0 * HEIGHTS, HEIGHTS]), np.zeros((16, 3)))


@pytest.fixture(scope="module")
def drawn():
    """A hexapod whose joints, offsets and factors differ from its file's."""
    return draw(load_machine("hexapod").carrying(Load()), np.random.default_rng(0))


def proposed(warning):
    found = POSE.findall(warning.partition("from home: ")[2])
    lengths = np.array([[float(number) for number in place.split(",")] for place, _ in found])
    angles = np.array(
        [[float(number) for number in (turn or "0, 0, 0").split(",")] for _, turn in found]
    )
    return make_pose(1e-3 * lengths, np.deg2rad(angles))


@pytest.mark.parametrize("parts", [["factors", "joints"], ["offsets", "joints"]])
def test_poses_along_one_line_are_warned_of_and_further_ones_proposed(drawn, parts):
    """Without noise: all that is wrong at other poses comes from combinations that are not
    shown.
    """
    poses = along_z()
    first = calibrate(drawn.nominal, whole_poses(poses, drawn.poses(poses), noise=NOISE), parts)
    hidden = 42 - first.observability.rank
    assert hidden > 15
    (warning,) = [text for text in first.warnings if "do not show" in text]
    assert warning.startswith(
        f"the fitted poses do not show {hidden} combinations of the 42 parameters"
    )
    assert f"and {hidden - 3} more; measure at further poses, from home: (" in warning
    named = warning.partition("any amount: ")[2].partition("; and ")[0].split("; ")
    assert len(named) == 3
    assert all(any(name in text for name in first.names) for text in named)
    assert any(warning in note for table in first.tables() for note in table.notes)

    more = proposed(warning)
    assert 3 <= len(more) <= MAX_PROPOSED
    assert drawn.nominal.check(drawn.nominal.home * more).ok.all()
    together = RigidTransform.concatenate([poses, more])
    second = calibrate(
        drawn.nominal, whole_poses(together, drawn.poses(together), noise=NOISE), parts
    )
    assert second.observability.rank == 42
    assert not any("do not show" in text for text in second.warnings)
    held = draw_commands(np.random.default_rng(5))
    before, after = (
        rms(predict_poses(drawn.nominal, each.machine, held), drawn.poses(held))
        for each in (first, second)
    )
    assert before["position"] > 2e-4
    assert after["position"] < 0.2 * before["position"]


def test_a_named_combination_moves_the_machine_elsewhere_and_not_at_the_fitted_poses(drawn):
    from kinematics.calibration.fit import weights_of
    from kinematics.calibration.parameters import (
        Prediction,
        free_parameters,
        full_vector,
        selection,
    )
    from kinematics.calibration.unseen import find_unseen

    machine, poses = drawn.nominal, along_z()
    measured = whole_poses(poses, poses, noise=NOISE)
    found = calibrate(machine, measured, ["joints", "offsets"])
    vector = full_vector(machine)
    select = selection(vector, free_parameters(vector, found.parts))
    prediction = Prediction.from_measurements(machine, vector, measured)
    rows = weights_of(machine, measured), found.used.any(0), select
    unseen = find_unseen(prediction, np.array(vector.nominal), found.observability, rows)
    change = select @ unseen.changes[0]
    change *= 1e-5 / abs(change).max()
    at_fitted = prediction.at(vector.nominal + change)[0]
    other = make_pose(unseen.proposed[:, :3], unseen.proposed[:, 3:])
    elsewhere = Prediction.from_measurements(machine, vector, whole_poses(other, other)).at(
        vector.nominal + change
    )[0]
    assert abs(at_fitted).max() < 5e-9  # of second order in 1e-5 m, with levers of 0.1 m
    assert abs(elsewhere).max() > 2e-6


def test_candidates_that_cannot_be_closed_spoil_no_others(drawn, monkeypatch):
    from kinematics.calibration.parameters import Prediction

    whole = Prediction.at

    def at(self, theta):
        errors, jacobian = whole(self, theta)
        spoiled = len(self.sent) > 100 or self._commanded[0, 0] > 0.02
        return (errors, jacobian * np.nan) if spoiled else (errors, jacobian)

    monkeypatch.setattr(Prediction, "at", at)
    poses = along_z()
    found = calibrate(
        drawn.nominal, whole_poses(poses, drawn.poses(poses), noise=NOISE), ["offsets", "joints"]
    )
    (warning,) = [text for text in found.warnings if "do not show" in text]
    assert len(proposed(warning)) > 2
    assert (proposed(warning).translation[:, 0] <= 0.02).all()


@pytest.mark.parametrize(
    ("parts", "count"),
    [(["factor", "frame-yaw"], 0), (["factors", "offsets"], 0), (["joints", "frame"], 6)],
)
def test_combinations_without_an_effect_anywhere_are_not_warned_of(drawn, parts, count):
    """A shift and a turn of all base joints are the same as those of the frame: six that no pose
    can show.
    """
    poses = draw_commands(np.random.default_rng(1))
    found = calibrate(drawn.nominal, whole_poses(poses, drawn.poses(poses), noise=NOISE), parts)
    assert len(found.parameters) - found.observability.rank == count
    assert not any("do not show" in text for text in found.warnings)


@pytest.mark.parametrize("name", ["linkage", "tripod", "cartesian"])
def test_machines_of_other_kinds(name):
    """Poses on one line in x: the factor of an axis that does not move is not shown, and is by the
    proposed poses.
    """
    machine = load_machine(name)
    start = {"linkage": [0, 0, 0], "tripod": [0, 0, 0.02], "cartesian": [0, 0, 0]}[name]
    places = np.array(start) + np.linspace(1e-3, 6e-3, 8)[:, None] * [1, 0, 0]
    poses = RigidTransform.from_translation(places)
    found = calibrate(machine, whole_poses(poses, poses), ["factors", "offsets"])
    if found.observability.rank == len(found.parameters):
        assert name != "cartesian"
        return
    (warning,) = [text for text in found.warnings if "do not show" in text]
    more = RigidTransform.concatenate([poses, proposed(warning)])
    assert calibrate(
        machine, whole_poses(more, more), ["factors", "offsets"]
    ).observability.rank == len(found.parameters)
