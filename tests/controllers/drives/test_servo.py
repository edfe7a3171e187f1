"""The servo against the analytic answers of its loops."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from controllers.drives.axes import read_encoder, rotor
from controllers.drives.servo import Servo, leg_servo, servo_axes
from controllers.simulate import bank
from kinematics import Axis, MotionError

AXIS = Axis("leg", pulse=0.75e-6)
PLAIN = leg_servo(AXIS)
FINE = replace(PLAIN, encoder=1e15)
"""As good as an encoder without steps: 1e-15 m."""


def run(servos, command):
    """Positions and torques (N, n) of one run, and the state after it (n,)."""
    axes = servo_axes([servos], servos[0].sample)
    done, state = axes.run(
        axes.standing(np.zeros((1, len(servos)))), at_once(command), np.arange(len(command))
    )
    last = SimpleNamespace(**{name: getattr(state, name)[0] for name in ("x", "v", "integral")})
    return axes, SimpleNamespace(position=done.position[:, 0], torque=done.torque[:, 0], state=last)


def at_once(command):
    return np.asarray(command, float)[:, None]


def ramp(speed, seconds, servo):
    return np.arange(round(seconds / servo.sample))[:, None] * servo.sample * np.atleast_1d(speed)


@pytest.mark.parametrize("friction", [0.0, 5.0, 200.0])
def test_following_error_at_constant_speed_is_speed_over_gain(friction):
    """e = v/Kv in steady state, with any friction: the speed loop's integral carries that."""
    servos = [replace(FINE, position_gain=gain, friction=friction) for gain in (20.0, 30.0, 45.0)]
    speed = np.array([0.02, -0.013, 0.005])
    command = ramp(speed, 2.0, FINE)
    _, response = run(servos, command)
    # the slowest mode of these loops, 18 1/s, has died to e^-36
    np.testing.assert_allclose(
        command[-1] - response.position[-1], speed / [20.0, 30.0, 45.0], rtol=1e-9
    )


def test_quantized_feedback_moves_the_following_error_by_half_a_count_at_most():
    command = ramp(0.02, 2.0, PLAIN)
    _, response = run([PLAIN], command)
    error = (command - response.position)[-400:, 0]
    assert np.abs(error - 0.02 / 30).max() <= 0.5 / PLAIN.encoder


@pytest.mark.parametrize("step", [1e-3, -1e-3])
def test_step_response_converges_without_leaving_the_torque_limit(step):
    weak = replace(FINE, torque_limit=0.5)
    command = np.full((8000, 1), step)
    _, response = run([weak], command)
    assert np.abs(response.torque).max() == 0.5, "the step must be large enough to saturate"
    assert abs(response.position[-1, 0] - step) < 1e-9
    # unsaturated the same loop needs more than that torque
    _, free = run([FINE], command)
    assert np.abs(free.torque).max() > 0.5
    assert abs(free.position[-1, 0] - step) < 1e-9


def test_saturated_axis_accelerates_at_torque_over_inertia():
    """No faster than the torque allows, and exactly so while it saturates: x = τ t²/2 J without
    friction.
    """
    weak = replace(FINE, torque_limit=2.0, inertia=4.0, friction=0.0)
    _, response = run([weak], np.full((200, 1), 1.0))
    assert np.all(response.torque == 2.0)
    t = np.arange(200) * weak.sample
    np.testing.assert_allclose(response.position[:, 0], 0.5 * t**2 / 2, rtol=1e-12, atol=1e-18)
    assert response.state.integral[0] == 0, "the integral must not wind up"


@given(st.floats(-0.05, 0.05))
def test_no_command_no_motion(place):
    """At rest on whole counts, nothing moves, exactly."""
    axes = servo_axes([[PLAIN]], PLAIN.sample)
    start = read_encoder(axes.encoder, np.array([[place]]))
    response, _ = axes.run(axes.standing(start), np.full((50, 1, 1), start[0, 0]), np.arange(50))
    assert np.all(response.position == start[0, 0])
    assert not response.torque.any()


@given(st.floats(-0.3, 0.3))
def test_encoder_reads_whole_counts_within_half_a_count(x):
    reading = read_encoder(np.array([[PLAIN.encoder]]), np.array([[x]]))[0, 0]
    assert abs(reading - x) <= 0.5 / PLAIN.encoder * (1 + 1e-6)
    counts = reading * PLAIN.encoder
    assert abs(counts - round(counts)) < 1e-6


@given(friction=st.floats(0.0, 1e4), inertia=st.floats(0.01, 100.0), sample=st.floats(1e-5, 1e-2))
def test_motor_is_discretised_exactly(friction, inertia, sample):
    """Against the matrix exponential of [x, v, τ], from no friction to time constants far below the
    sample.
    """
    model = rotor(*(np.array([[of]]) for of in (inertia, friction, 0.0)), sample)
    a = np.array([[0, 1, 0], [0, -friction / inertia, 1 / inertia], [0, 0, 0]])
    exact = expm(a * sample)
    ours = [float(of[0, 0]) for of in model.lanes[3:]]
    # expm itself scales and squares: 1e-9 of a large exponent
    np.testing.assert_allclose(
        ours, [exact[0, 1], exact[0, 2], exact[1, 1], exact[1, 2]], rtol=1e-8, atol=1e-18
    )


def test_linear_response_is_that_of_the_matrix_model():
    """Unsaturated and unquantized, the loop is linear: against its state matrices written out."""
    axes, response = run([FINE], 1e-4 * np.sin(np.arange(400) * 0.05)[:, None])
    gx, hx, gv, hv = (float(value[0, 0]) for value in axes.rotor.lanes[3:])
    kp, ks, ki = 30.0, 2 * np.pi * 30.0, 2 * np.pi * 30.0 / 0.03 * FINE.sample
    # the torque is linear in [x, v, I] and r
    torque = np.array([-ks * kp, -ks, 1.0])
    a = np.array([[1, gx, 0], [0, gv, 0], [-ki * kp, -ki, 1.0]]) + np.outer([hx, hv, 0.0], torque)
    b = np.array([hx * ks * kp, hv * ks * kp, ki * kp])
    state, expected = np.zeros(3), []
    for r in 1e-4 * np.sin(np.arange(400) * 0.05):
        expected.append(state[0])
        state = a @ state + b * r
    # an encoder of 1e-15 m, multiplied by the gains
    np.testing.assert_allclose(response.position[:, 0], expected, atol=1e-13)


def test_axes_do_not_disturb_each_other():
    """An axis alone and the same axis among others: the same to the last bit."""
    servos = [PLAIN, replace(PLAIN, position_gain=20.0), replace(PLAIN, inertia=3.0)]
    command = ramp([0.02, 0.01, -0.015], 0.1, PLAIN)
    _, together = run(servos, command)
    for i, servo in enumerate(servos):
        _, alone = run([servo], command[:, [i]])
        np.testing.assert_array_equal(together.position[:, i], alone.position[:, 0])


@pytest.mark.parametrize(
    "change", [{}, {"command_delay": 3, "loop_delay": 2}, {"coulomb": 0.5, "play": 1e-5}]
)
def test_the_drive_can_be_run_in_portions(change):
    """Also in portions shorter than its delays."""
    command = ramp(0.02, 0.1, PLAIN)
    axes, whole = run([replace(PLAIN, **change)], command)
    state, parts = axes.standing(np.zeros((1, 1))), []
    for portion in np.split(command, [1, 2, 4, 150, 153]):
        response, state = axes.run(state, at_once(portion), np.arange(len(portion)))
        parts.append(response.position[:, 0])
    np.testing.assert_array_equal(np.concatenate(parts), whole.position)


def test_default_servo_is_the_table():
    assert (PLAIN.position_gain, PLAIN.speed_loop, PLAIN.integral_time) == (30.0, 30.0, 0.03)
    assert PLAIN.encoder * AXIS.pulse == pytest.approx(4.0)


@pytest.mark.parametrize(
    "field",
    [
        "position_gain",
        "speed_loop",
        "integral_time",
        "torque_limit",
        "inertia",
        "encoder",
        "sample",
    ],
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_impossible_servos_are_refused(field, value):
    with pytest.raises(MotionError, match=field):
        replace(PLAIN, **{field: value})


def test_friction_may_be_zero_but_not_negative():
    assert Servo(30, 30, 0.03, 1, 1, 0.0, 1e6).friction == 0
    with pytest.raises(MotionError, match="friction"):
        replace(PLAIN, friction=-1e-9)


def test_drives_of_different_sample_times_are_refused():
    with pytest.raises(MotionError, match="sample times"):
        bank([[PLAIN, replace(PLAIN, sample=1e-3)]])


def test_a_command_delay_is_a_shift():
    command = ramp(0.02, 0.1, FINE)
    _, prompt = run([FINE], command)
    _, late = run([replace(FINE, command_delay=5)], command)
    np.testing.assert_array_equal(late.position[5:], prompt.position[:-5])


def test_delays_may_differ_by_axis():
    servos = [PLAIN, replace(PLAIN, command_delay=3), replace(PLAIN, loop_delay=2)]
    command = ramp([0.02, 0.02, 0.02], 0.1, PLAIN)
    _, together = run(servos, command)
    for i, servo in enumerate(servos):
        _, alone = run([servo], command[:, [i]])
        np.testing.assert_array_equal(together.position[:, i], alone.position[:, 0])


def test_a_loop_delay_holds_the_torque_back():
    """It answers a step `loop_delay` samples later, and then with K J ω · step."""
    command = np.full((10, 1), 1e-3)
    _, response = run([replace(FINE, loop_delay=4)], command)
    assert not response.torque[:4].any()
    assert response.torque[4, 0] == pytest.approx(30 * 2 * np.pi * 30 * 1e-3, rel=1e-9)


def test_a_long_loop_delay_is_unstable():
    """The speed loop's crossover of 30 Hz has some 80° to spare: 7 ms of delay cost 76°, 10 ms
    108°.
    """
    step = np.full((1200, 1), 1e-6)
    _, calm = run([replace(FINE, loop_delay=8)], step)
    _, wild = run([replace(FINE, loop_delay=48)], step)
    assert np.abs(calm.position[-100:] - 1e-6).max() < 1e-8
    assert np.abs(wild.position[-100:]).max() > 1e-3


@pytest.mark.parametrize("factor", [0.7, 1.3])
def test_a_drive_that_is_set_wrong_answers_by_its_own_idea(factor):
    """The torque is that of the nominal inertia, the acceleration that of the true one: x = τ t²/(2
    J′).
    """
    weak = replace(FINE, torque_limit=2.0, inertia=4.0, friction=0.0)
    _, response = run([replace(weak, inertia_factor=factor)], np.full((100, 1), 1.0))
    assert np.all(response.torque == 2.0)
    t = np.arange(100) * weak.sample
    np.testing.assert_allclose(
        response.position[:, 0], 0.5 * t**2 / 2 / factor, rtol=1e-12, atol=1e-18
    )
    _, nominal = run([FINE], np.full((1, 1), 1e-3))
    _, other = run([replace(FINE, inertia_factor=factor)], np.full((1, 1), 1e-3))
    assert nominal.torque[0] == other.torque[0]


def test_it_sticks_until_the_integral_overcomes_the_friction():
    """K ω J Δ (1 + k h/T) = c at sample k: before it, nothing moves at all."""
    servo = replace(FINE, coulomb=1.0)
    step = 0.5 / (30 * 2 * np.pi * 30)
    _, response = run([servo], np.full((400, 1), step))
    moving = int(np.flatnonzero(response.position[:, 0])[0])
    # half of the friction at once, the other half within T; torque k moves the axis by sample k + 1
    assert moving - 1 == np.floor(servo.integral_time / servo.sample) + 1
    assert not response.position[:moving].any()


@pytest.mark.parametrize("feedback", ["motor", "output"])
def test_play_costs_half_of_itself_where_the_encoder_does_not_see_it(feedback):
    play = 4e-4
    servo = replace(FINE, play=play, feedback=feedback)
    command = ramp(0.02, 2.0, FINE)
    _, response = run([servo], command)
    seen = 0.0 if feedback == "output" else play / 2
    # the slowest mode, 18 1/s, has died
    np.testing.assert_allclose((command - response.position)[-1, 0], 0.02 / 30 + seen, rtol=1e-9)


def test_at_a_reversal_the_output_waits_for_the_play():
    """Up half the play behind the motor, whose way is that without play; then held until the motor
    came back by it.
    """
    servo = replace(FINE, play=4e-4)
    up = ramp(0.02, 0.5, FINE)
    command = np.concatenate([up, 2 * up[-1] - up])
    _, response = run([servo], command)
    _, stiff = run([FINE], command)
    motor = stiff.position[:, 0]
    top = int(motor.argmax())
    rising = np.maximum(motor[: top + 1] - 2e-4, 0.0)
    falling = np.minimum(motor[top] - 2e-4, motor[top:] + 2e-4)
    np.testing.assert_allclose(response.position[: top + 1, 0], rising, atol=1e-18)
    np.testing.assert_allclose(response.position[top:, 0], falling, atol=1e-18)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("feedback", "gear"),
        ("command_delay", 0.5),
        ("loop_delay", -1),
        ("play", -1e-9),
        ("coulomb", np.nan),
    ],
)
def test_impossible_additions_are_refused(field, value):
    with pytest.raises(MotionError, match=field):
        replace(PLAIN, **{field: value})
