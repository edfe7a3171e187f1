"""Numbers from outside: what is none, or of another shape, is refused in words, wherever a user can
give it.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

import kinematics as k
from kinematics.foundation.arrays import MAX_SHOWN_CHARS, bisect, finite_array

PLACE = RigidTransform.from_translation([[0, 0, 0.24], [0, 0, 0.25]])
BODY = k.Body(1.0, np.zeros(3), 0.01 * np.eye(3))
BEAM = k.Beam(1.0, 2e11, 1e-6)


@pytest.fixture(scope="module")
def motion(preset):
    return k.motion_of_poses(preset, PLACE)


@given(st.lists(st.floats(-1e300, 1e300), min_size=1, max_size=5))
def test_numbers_stay_what_they_are(values):
    np.testing.assert_array_equal(finite_array(values, "x", (len(values),)), values)
    with pytest.raises(k.MotionError, match=rf"x must be finite numbers \({len(values) + 1},\)"):
        finite_array(values, "x", (len(values) + 1,))
    for bad in (np.nan, np.inf, -np.inf):
        with pytest.raises(k.MotionError, match="x must be finite numbers in mm"):
            finite_array([*values, bad], "x", unit="mm")


@pytest.mark.parametrize(
    "value", ["1", "1 m", None, [[1], [2, 3]], [1, None], object(), {1: 2}, True, 1j, b"1"]
)
def test_what_is_no_number_is_said(value):
    with pytest.raises(k.MotionError, match=r"^span must be one finite number in m, not "):
        finite_array(value, "span", (), unit="m")


def test_a_long_value_is_shown_in_part():
    with pytest.raises(k.MotionError) as raised:
        finite_array(np.zeros((50, 2)), "x", (3,))
    assert len(str(raised.value)) < MAX_SHOWN_CHARS + 60
    assert "\n" not in str(raised.value)


SOURCES = [
    (lambda m: [k.PulseLength([1e-6] * 3)], "pulse length: 3 numbers for the 6 axes of hexapod"),
    (lambda m: [k.LeadError([1e-6] * 3)], "lead error: 3 numbers for the 6 axes"),
    (lambda m: [k.LeadError(0.0, [1e-6] * 3)], "lead error: 3 numbers for the 6 axes"),
    (lambda m: [k.LeadError(np.ones((2, 2)))], "must be a single number"),
    (lambda m: [k.Quantization([0.5] * 3)], "quantization: 3 numbers for the 6 axes"),
    (lambda m: [k.Temperature([1, 2])], r"ambient \[1, 2\] must be a single number"),
    (lambda m: [k.PulseLength("5 ppm")], "pulse length: error must be finite numbers"),
    (lambda m: k.Quantization(), "expected a list, each entry an error source"),
    (lambda m: [3], r"sources is \[3\]; expected a list"),
    (lambda m: [], "no sources"),
]


@pytest.mark.parametrize(("sources", "told"), SOURCES)
def test_sources_of_another_shape(preset, sources, told):
    with pytest.raises(k.MotionError, match=told):
        k.error_budget(preset, PLACE, sources(preset))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"pose": "up"}, "pose must be a pose: a scipy RigidTransform, or numbers"),
        ({"near": [1, 2]}, r"near must be finite numbers \(6,\)"),
        ({"tool": "tip"}, r"tool must be finite numbers \(3,\) in m"),
    ],
)
def test_budgets_of_no_pose(preset, given, told):
    with pytest.raises(k.MotionError, match=told):
        k.error_budget(**{"machine": preset, "pose": PLACE, "sources": [k.Quantization()], **given})


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"gravity": [9.8]}, r"gravity must be finite numbers \(3,\) in m/s²"),
        ({"gravity": 9.8}, "gravity must be"),
        ({"gravity": np.ones((2, 3))}, "gravity must be"),
        (
            {"wrench": [1.0]},
            r"wrench must be finite numbers \(6,\) or \(1, 6\) or \(2, 6\) in N and N·m",
        ),
        ({"wrench": np.ones((2, 1))}, "wrench must be"),
        ({"wrench": [[1, 2], [3]]}, "wrench must be"),
        ({"wrench": "10 N"}, "wrench must be"),
        ({"wrench": [1e308] * 6}, "too large for numbers"),
        ({"reflected": [1.0] * 5}, r"reflected must be finite numbers one or \(6,\)"),
        ({"platform": 4.0}, "platform is 4.0; expected a body or None"),
        ({"legs": 3}, "legs is 3; expected a leg or a list"),
        ({"motion": None}, "NoneType is not a motion"),
    ],
)
def test_forces_of_what_does_not_fit(preset, motion, given, told):
    with pytest.raises(k.MotionError, match=told):
        k.forces(**{"machine": preset, "motion": motion, **given})


def test_the_shapes_that_forces_say(preset, motion):
    """One wrench for all instants, written in any of the three ways, is the same wrench."""
    wrench = [1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    expected = k.forces(preset, motion, wrench=wrench).force
    for same in ([wrench], [wrench, wrench]):
        np.testing.assert_array_equal(k.forces(preset, motion, wrench=same).force, expected)


def test_the_motion_of_another_machine_is_refused(preset):
    other = k.load_machine("hexapod-initial")
    foreign = k.motion_of_poses(preset, PLACE)
    with pytest.raises(
        k.MotionError,
        match=r"hexapod-initial: the motion is another machine's: at instant 0 its leg1",
    ):
        k.forces(other, foreign, reflected=1.0)
    own = k.motion_of_poses(other, PLACE)
    np.testing.assert_array_equal(k.forces(other, own).motion.q, other.inverse(PLACE))


BAD = [
    (lambda: k.Beam("1 m", 1.0, 1.0), "beam: span must be one finite number, not '1 m'"),
    (lambda: BEAM.deflection(np.nan, 0.5), "the load must be one finite number in N"),
    (lambda: BEAM.slope(np.inf, 0.5), "the load must be"),
    (lambda: BEAM.deflection(1.0, "middle"), "the load's place must be"),
    (lambda: k.Deflection(BEAM, 100, (0, 0), (1, 0, 0)), r"start must be finite numbers \(3,\)"),
    (lambda: k.Deflection(BEAM, 100, (0, 0, 0), (1, 0, 0), spans=1.5), "1.5 spans"),
    (lambda: k.Deflection(3, 100, (0, 0, 0), (1, 0, 0)), "beam must be a Beam"),
    (
        lambda: k.StepMotor(0.03, 1e-5, pull_out=((5, 1, 1), (6, 2, 2))),
        r"points \(steps/s, N·m\), not of shape \(2, 3\)",
    ),
    (lambda: k.StepMotor(0.03, 1e-5, pull_out=((5, 1), (6,))), "pull_out must be finite numbers"),
    (lambda: k.StepMotor("1.8 deg", 1e-5), "motor: step must be one finite number"),
    (lambda: k.Body("1"), "body: mass must be one finite number in kg"),
    (lambda: k.Leg(1.0, 0.6), "leg: barrel must be a Body, not 1.0"),
    (lambda: k.ActuatorNeed(stroke="50 mm"), "needed stroke must be one finite number"),
    (lambda: k.AxisMotion(np.zeros((3, 2)), np.zeros((5, 2))), r"qd is \(5, 2\), q is \(3, 2\)"),
    (lambda: k.load_measurements(None), "measurement file is given by its name or the path"),
    (lambda: k.load_machine(3), "machine is given by its name or the path"),
    (lambda: k.actuator_need([3]), r"motions is \[3\]; expected a list"),
]


@pytest.mark.parametrize(("make", "told"), BAD)
def test_values_that_are_none(make, told):
    with pytest.raises(k.MotionError, match=told):
        make()


def test_bisection_finds_each_edge_from_below():
    edges = np.array([0.1, 1 / 3, 0.9])
    found = bisect(lambda values: values <= edges, np.zeros(3), np.ones(3))
    assert (found <= edges).all()
    assert found == pytest.approx(edges, rel=1e-14)
    assert bisect(lambda value: value**2 <= 2.0, 1.0, 2.0, 20) == pytest.approx(
        np.sqrt(2.0), abs=2.0**-20
    )
