import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from kinematics import Leadscrew, MotionError, Slide, StepMotor, Traverse, size_stepper
from kinematics.design.sizing import GRAVITY, trapezoid_time

SLIDE, SCREW = Slide(20.0, 5.0, 1.0), Leadscrew(0.005, 0.02, 1.0, 0.9, 0.03)
MOTOR, TRAVERSE = StepMotor(np.deg2rad(1.8), 4e-4, 2.0), Traverse(0.5, 20.0, 4.0, 1e-3)


def test_inertia_of_a_screw_is_that_of_its_cylinders_integrated():
    """∫ ρ r² dV over a solid bar, shell by shell; the midpoint rule's error is of (1/shells)²."""
    edges = np.linspace(0, SCREW.diameter / 2, 2001)
    r, dr = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    shells = (SCREW.density * 2 * np.pi * r**3 * SCREW.length * dr).sum()
    assert SCREW.inertia == pytest.approx(shells, rel=1e-6)


def test_energy_balance_of_a_frictionless_lift():
    """Work of the torque over one revolution lifts the weight by one lead."""
    sizing = size_stepper(Slide(20.0, 0.0, 1.0), Leadscrew(0.005, 0.02, 1.0), MOTOR, TRAVERSE)
    assert sizing.gravity_torque * 2 * np.pi == pytest.approx(20.0 * GRAVITY * 0.005, rel=1e-14)
    assert sizing.standstill_torque == sizing.gravity_torque


def test_the_torque_really_accelerates_the_axis():
    """Integrate the motion under the torque found, without losses but those of the screw: full
    speed after the ramp.
    """
    s = size_stepper(SLIDE, SCREW, MOTOR, TRAVERSE)
    radius = SCREW.lead / (2 * np.pi)

    def motion(t, y):
        shaft, force = s.torque - SCREW.drag, SLIDE.friction + SLIDE.mass * GRAVITY
        # shaft: T = I α + F r/η, slide: F = m a + load
        alpha = (shaft - force * radius / 0.9) / (
            SCREW.inertia + MOTOR.inertia + SLIDE.mass * radius**2 / 0.9
        )
        return [y[1], alpha * radius]

    end = solve_ivp(motion, (0, TRAVERSE.ramp), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert end == pytest.approx([s.speed * TRAVERSE.ramp / 2, s.speed], rel=1e-9)


@given(st.floats(0.01, 10), st.floats(1, 100), st.floats(0.01, 0.5))
def test_least_speed_takes_exactly_the_time(travel, time, share):
    traverse = Traverse(travel, time, share * time, 1e-3)
    assert trapezoid_time(travel, traverse.least_speed, traverse.ramp) == pytest.approx(
        time, rel=1e-12
    )


def test_short_travel_is_a_triangle():
    """With acceleration a = v/ramp: 2 √(travel/a), and continuous where the triangle touches the
    top speed.
    """
    assert trapezoid_time(0.02, 0.1, 1.0) == pytest.approx(2 * np.sqrt(0.02 / 0.1))
    assert trapezoid_time(0.1 * (1 - 1e-12), 0.1, 1.0) == pytest.approx(
        trapezoid_time(0.1, 0.1, 1.0)
    )


@pytest.mark.parametrize(
    ("motor", "traverse", "broken"),
    [
        (MOTOR, TRAVERSE, set()),
        (MOTOR, Traverse(0.5, 20.0, 4.0, 1e-4), {"step"}),
        (MOTOR, Traverse(0.5, 20.0, 4.0, 1e-3, speed=0.02), {"time"}),
        (StepMotor(MOTOR.step, 4e-4, 0.1), TRAVERSE, {"holding torque"}),
        (StepMotor(MOTOR.step, 4e-4, 2.0, ((0, 2.0), (900, 1.0))), TRAVERSE, {"torque"}),
        (StepMotor(MOTOR.step, 4e-4, 2.0, ((0, 2.0), (2000, 1.0))), TRAVERSE, set()),
        (
            StepMotor(MOTOR.step, 4e-4, 2.0, ((0, 2.0), (500, 0.01), (2000, 1.0))),
            TRAVERSE,
            {"torque"},
        ),
    ],
)
def test_rules(motor, traverse, broken):
    sizing = size_stepper(SLIDE, SCREW, motor, traverse)
    assert {
        check.name.split(" up to")[0] for check in sizing.checks if check.holds is False
    } == broken
    assert sizing.ok is not bool(broken)
    assert ("NO" in str(sizing)) is bool(broken)


def test_what_is_not_stated_is_said():
    sizing = size_stepper(SLIDE, SCREW, StepMotor(MOTOR.step, 4e-4), TRAVERSE)
    assert [check.holds for check in sizing.checks] == [True, True, None, None]
    assert "not stated" in str(sizing)


def test_a_step_of_exactly_a_fifth_is_allowed():
    step = SCREW.lead * MOTOR.step / (2 * np.pi)
    sizing = size_stepper(SLIDE, SCREW, MOTOR, Traverse(0.5, 20.0, 4.0, 5 * step))
    assert sizing.checks[0].holds
    assert sizing.coarsest_lead == pytest.approx(SCREW.lead)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: Leadscrew(0.0, 0.02, 1.0), "leadscrew: lead 0.0 must be positive"),
        (lambda: Leadscrew(0.005, 0.02, 1.0, 1.2), "efficiency 1.2"),
        (lambda: Leadscrew(0.005, float("nan"), 1.0), "diameter must be one finite number"),
        (lambda: Slide(20.0, -1.0), "friction -1.0 must be zero or more"),
        (lambda: Slide(20.0, 0.0, 1.5), "lift 1.5"),
        (lambda: StepMotor(0.03, 1e-4, pull_out=((0, 1.0),)), "two or more"),
        (lambda: StepMotor(0.03, 1e-4, pull_out=((5, 1.0), (5, 0.5))), "rising"),
        (lambda: StepMotor(0.03, 1e-4, pull_out=((0, 1.0), (5, -0.5))), "not negative"),
        (lambda: Traverse(0.5, 20.0, 11.0, 1e-3), "at most 10 s"),
        (lambda: size_stepper(SLIDE, SCREW, MOTOR, TRAVERSE, share=0.5), "share 0.5"),
    ],
)
def test_bad_input(wrong, message):
    with pytest.raises(MotionError, match=message):
        wrong()
