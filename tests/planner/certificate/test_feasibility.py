"""Paths through singular poses are refused before anything is solved; those beside them are not."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import OutOfReach, Tripod, load_machine
from planner import Arc, Line, Program, Turn, check, plan
from planner.certificate import find_singularity
from planner.path.actuation import actuate
from planner.trajectory import unit_speed_trajectory


def met(program, machine):
    path = actuate(program, machine)
    along = unit_speed_trajectory(path)
    return path, find_singularity(path, np.append(along.s, path.breaks[-1]), along.piece)


@pytest.fixture(scope="module")
def tripod():
    """The preset, without the bounds that keep it below its base, posed at the plate itself."""
    preset = load_machine("tripod")
    axes = [replace(axis, travel=(-1.0, 1.0)) for axis in preset.axes]
    return Tripod(preset.base, preset.platform, axes=axes, home=preset.home)


def test_the_flat_pose_of_a_tripod_is_named(tripod):
    """The arms lie in one plane where the plate's joints reach the base's: at the height that this
    is.
    """
    flat = -(tripod.home.translation[2] + tripod.platform[0, 2])
    path, found = met(Program([Line([0, 0, flat + 0.05])]), tripod)
    assert found is not None
    assert found[0] == pytest.approx(flat, abs=1e-3)
    with pytest.raises(OutOfReach, match=r"singular, or too close .* route the path around it"):
        plan(Program([Line([0, 0, flat + 0.05])]), tripod, order=2)
    (told,) = check(Program([Line([0, 0, flat + 0.05])]), tripod).violations
    assert "segment 1" in str(told)
    assert path.breaks[-1] > flat


def test_a_path_that_ends_before_it_is_free(tripod):
    flat = -(tripod.home.translation[2] + tripod.platform[0, 2])
    assert met(Program([Line([0, 0, flat - 0.01]), Line([0, 0, 0.01])]), tripod)[1] is None


@pytest.mark.parametrize(
    ("name", "segments"),
    [
        (
            "hexapod",
            [
                Line([0.01, 0, 0.02]),
                Arc([0, 0, 0.02], [0, 0, 1], 7.0),
                Turn(Rotation.from_euler("X", 0.1)),
            ],
        ),
        ("tripod", [Line([0.01, 0.02, 0.02])]),
        ("linkage", [Line([0.03, 0.02, 0])]),
        ("traverser", [Line([0.5, 0.2, 0.3]), Turn(about=[0, 0, 1], angle=9.0)]),
        ("arm", [Line([-0.05, 0.05, 0.05])]),
    ],
)
def test_ordinary_paths_are_free(name, segments):
    assert met(Program(segments), load_machine(name))[1] is None


def test_what_is_free_keeps_the_sign_of_its_determinant(hexapod):
    """And what is met is no more than a hair from where the determinant's sign changes: a turn of
    120 deg.
    """
    turned = Program([Turn(about=[0, 0, 1], angle=np.deg2rad(120))])
    path, found = met(turned, hexapod)
    s = np.linspace(0, path.breaks[-1], 2001)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.breaks) - 2)
    x = path.pose_numbers(s, piece)
    pose = RigidTransform.from_components(
        x[:, :3], Rotation.from_matrix(x[:, 3:].reshape(-1, 3, 3))
    )
    sign = np.sign(np.linalg.det(hexapod.jacobian(pose)))
    changes = np.flatnonzero(np.diff(sign))
    assert len(changes)
    assert found is not None
    assert found[0] == pytest.approx(s[changes[0]], abs=2e-3 * path.breaks[-1])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("machine", "far"), [("hexapod", [0, 0, 25.0]), ("linkage", [0, -0.7, 0])])
def test_metres_for_millimetres_are_refused_without_a_warning(machine, far, limit_search):
    limit_search(0.0)
    (told, *_) = check(Program([Line(far)]), load_machine(machine)).violations
    assert "segment 1" in str(told)
