import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.published.deflections import FRAME
from kinematics import Axis, Beam, Deflection, MotionError, Traverser, error_budget
from kinematics.foundation.units import unit_value

INCH, POUND_FORCE = unit_value("in", "m"), unit_value("lbf", "N")
LOAD, HEIGHT = 255 * POUND_FORCE, 70 * INCH


def frame(**changed):
    """The traverser's frame [Sasidhar 1981, Appendix D]: four spans along z, its tip a lever of 70
    in above.
    """
    given = {
        "beam": FRAME, "load": LOAD, "start": (0, 0, 0), "along": (0, 0, 1), "down": (-1, 0, 0), "spans": 4,
    }  # fmt: skip
    return Deflection(**{**given, **changed})


@pytest.fixture(scope="module")
def traverser():
    axes = [Axis(name, pulse=0.000625 * INCH) for name in "XYZ"] + [
        Axis("R", "rotary", pulse=np.deg2rad(0.9))
    ]
    return Traverser(axes=axes, home=RigidTransform.identity())


def tip(z, height=HEIGHT, y=0.0):
    return RigidTransform.from_translation(
        np.stack(np.broadcast_arrays(height, y, z), -1).astype(float)
    )


def test_sasidhars_frame_as_an_item_of_the_budget(traverser):
    """Mid-span: it sinks by W l³/48EI and does not tilt.

    Where it tilts most, the tip moves along by θ h.
    """
    steep = FRAME.span * (3 - np.sqrt(3)) / 6
    budget = error_budget(traverser, tip(np.array([FRAME.span / 2, steep])), [frame()])
    bias = budget.total.bias
    assert -bias[0, 0] / INCH == pytest.approx(8.060e-5, rel=1e-3)  # printed, four digits
    assert bias[0, 1:] == pytest.approx(np.zeros(5), abs=1e-18)
    slope = bias[1, 4]
    assert abs(slope) == pytest.approx(
        5.895e-6, rel=3e-3
    )  # printed 5.895e-7 with the factor 0.096 for √3/18
    assert abs(bias[1, 2]) == pytest.approx(abs(slope) * HEIGHT, rel=1e-12)
    assert abs(bias[1, 2]) / INCH == pytest.approx(
        4.12e-4, rel=1e-2
    )  # printed 4.12e-5, from the slope's lost power


def test_the_tip_moves_as_the_bent_beam_carries_it():
    """A rigid post, square to the beam's line at the load: the tip goes where the post's foot and
    direction put it.
    """
    source, h = frame(), 1.3
    for z in np.linspace(0.02, 4 * FRAME.span - 0.02, 37):
        c = z % FRAME.span
        sag, slope = FRAME.deflection(LOAD, c), FRAME.slope(LOAD, c)
        # beam's line (x, z) = (−δ(z), z): tangent (−δ′, 1), normal (1, δ′); the foot sinks by δ
        post = np.array([1.0, slope]) / np.hypot(1.0, slope)
        moved = np.array([-sag, z]) + h * post - np.array([h, z])
        twist = source.twist(np.array([[h, 0.0, z]]), LOAD)[0]
        assert twist[[0, 2]] == pytest.approx(
            moved, abs=h * slope**2 + 1e-15
        )  # first order, and rounding
        assert twist[1] == 0


def test_tilt_and_abbe_shift_form_one_rigid_motion():
    """Any two points of the platform keep their distance: v₂ − v₁ = ω × (p₂ − p₁) at the same place
    along the beam.
    """
    source = frame(beam=Beam(0.8, 7e10, 2e-8))
    first, second = np.array([0.3, 0.1, 0.5]), np.array([-0.2, 0.4, 0.5])
    one, two = source.twist(np.stack([first, second]), LOAD)
    assert one[3:] == pytest.approx(two[3:])
    assert two[:3] - one[:3] == pytest.approx(np.cross(one[3:], second - first), rel=1e-12)


def test_spans_repeat_and_supports_do_not_yield():
    source, span = frame(), FRAME.span
    z = span * np.array([0.3, 1.3, 3.3, 0.0, 1.0, 4.0])
    twist = source.twist(np.stack([np.full(6, HEIGHT), np.zeros(6), z], -1), LOAD)
    assert twist[1] == pytest.approx(twist[0], rel=1e-9)
    assert twist[2] == pytest.approx(twist[0], rel=1e-9)
    assert twist[3:, 0] == pytest.approx(np.zeros(3), abs=1e-15)


def test_load_error_spreads_in_proportion(traverser):
    pose = tip(np.array([0.2, 0.7]))
    budget = error_budget(traverser, pose, [frame(load_error=0.1 * LOAD)])
    assert budget.total.spread == pytest.approx(0.1 * np.abs(budget.total.bias), rel=1e-12)
    assert budget.total.sigma == pytest.approx(budget.total.spread / np.sqrt(3), rel=1e-12)
    unloaded = error_budget(traverser, pose, [frame(load=0.0, load_error=0.1 * LOAD)]).total
    assert not unloaded.bias.any()
    assert unloaded.spread == pytest.approx(budget.total.spread)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"load": -1.0}, "load -1.0"),
        ({"along": (0, 0, 0)}, "not be zero"),
        ({"along": (1, 0, 1)}, "square to `along`"),
        ({"spans": 0}, "0 spans"),
    ],
)
def test_bad_deflections(changed, message):
    with pytest.raises(MotionError, match=message):
        frame(**changed)


def test_a_pose_off_the_beam_is_named(traverser):
    with pytest.raises(MotionError, match=r"pose 1 is 2540 mm along a beam of 2133\.6 mm"):
        error_budget(traverser, tip(np.array([0.1, 2.54])), [frame()])
