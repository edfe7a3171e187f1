"""The traverser: slides are coordinates, and a turn is the one that is meant."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Machine, MotionError, OutOfReach, Traverser, load_machine

AXES = [Axis("X"), Axis("Y"), Axis("Z"), Axis("R", kind="rotary")]


@pytest.fixture(scope="module")
def machine():
    return Traverser(axes=AXES, home=RigidTransform.identity())


@pytest.fixture(scope="module")
def preset():
    return load_machine("traverser")


@given(st.floats(-1e3, 1e3), st.floats(-3.1, 3.1))
def test_the_turn_nearest_to_what_was_meant(machine, angle, off):
    pose = RigidTransform.from_rotation(Rotation.from_euler("Z", angle))
    found = machine.inverse(pose, near=[0, 0, 0, angle + off])
    assert found[3] == pytest.approx(
        angle, abs=1e-10
    )  # the matrix of 1e3 rad holds the angle to 1e-13


@given(st.floats(-50, 50))
def test_forward_keeps_every_turn(machine, angle):
    found = machine.forward([0.1, 0.2, 0.3, angle])
    assert found.residual < 1e-12
    assert machine.inverse(found.pose, near=[0, 0, 0, angle])[3] == pytest.approx(angle, abs=1e-12)


def test_forward_is_certified_all_over_the_travel(preset):
    rng = np.random.default_rng(0)
    q = np.column_stack(
        [rng.uniform(*axis.travel, 200) for axis in preset.axes[:3]] + [rng.uniform(-3, 3, 200)]
    )
    found = preset.forward(q)
    assert found.certified.all()
    assert np.abs(found.pose.translation - q[:, :3]).max() < 1e-14


class Slides(Machine):
    """x, y, z alone: its Jacobian is the same everywhere."""

    freedom = ("x", "y", "z")
    characteristic_length = 1.0

    def expression(self, position, rotation, near):
        return position


def test_a_constant_jacobian_is_regular_everywhere():
    machine = Slides("slides", AXES[:3], RigidTransform.identity())
    found = machine.forward([[0.1, 0.2, 0.3], [-5.0, 0, 0]])
    assert found.certified.all()
    assert found.pose.translation == pytest.approx(
        np.array([[0.1, 0.2, 0.3], [-5.0, 0, 0]]), abs=1e-15
    )


def test_slides_may_lie_askew():
    slides = np.array([[1, 0, 0.1], [0.05, 1, 0], [0, 0, -2]])
    machine = Traverser(axes=AXES, home=RigidTransform.identity(), directions=slides)
    unit = slides / np.linalg.norm(slides, axis=1)[:, None]
    q = machine.inverse(RigidTransform.from_translation([0.3, -0.1, 0.2]))
    assert q[:3] @ unit == pytest.approx([0.3, -0.1, 0.2], abs=1e-15)


def test_the_home_may_be_turned():
    home = RigidTransform.from_components([0, 0, 0.1], Rotation.from_euler("XYZ", [0.3, 0.2, 0.1]))
    machine = Traverser(axes=AXES, home=home)
    turned = RigidTransform.from_components(
        [0, 0, 0.1], Rotation.from_euler("Z", 0.5) * home.rotation
    )
    assert machine.home_q == pytest.approx([0, 0, 0.1, 0], abs=1e-15)
    assert machine.inverse(turned)[3] == pytest.approx(0.5, abs=1e-14)


def test_a_tilted_pose_is_refused(preset):
    with pytest.raises(
        OutOfReach, match=r"holds ry: pose 0 has ry 1 deg off home; it moves x, y, z, rz only"
    ):
        preset.inverse(RigidTransform.from_rotation(Rotation.from_euler("Y", 1, degrees=True)))


@pytest.mark.parametrize(
    ("values", "phrase"),
    [
        ({"directions": np.eye(2)}, "directions"),
        ({"directions": np.zeros((3, 3))}, "directions"),
        ({"directions": [[1, 0, 0], [0, 1, 0], [1, 1, 0]]}, "do not span"),
        ({"length": 0.0}, "length"),
    ],
)
def test_what_is_no_traverser_is_refused(values, phrase):
    with pytest.raises(MotionError, match=phrase):
        Traverser(axes=AXES, home=RigidTransform.identity(), **values)


def test_what_is_near_to_nothing_is_refused(preset):
    for near in ([0, 0, 0], [0, 0, 0, np.nan]):
        with pytest.raises(MotionError, match=r"near must be finite numbers \(4,\)"):
            preset.inverse(preset.home, near=near)


def test_the_source_s_figures(preset):
    """0.000625 in a step, 48, 48 and 72 in of travel, 1.5 in/s, 0.001 in of lead error per inch."""
    inch = 0.0254
    assert preset.axes[0].pulse == pytest.approx(0.000625 * inch, rel=1e-15)
    assert [axis.travel[1] / inch for axis in preset.axes[:3]] == pytest.approx(
        [48, 48, 72], rel=1e-15
    )
    for axis in preset.axes[:3]:
        (_, first), (last, error) = axis.lead_error
        assert (first, error / last) == pytest.approx((0.0, 1e-3), rel=1e-12)
        assert axis.max_speed == pytest.approx(1.5 * inch, rel=1e-15)
