"""The laws that know the nominal drive: feedforward and predictive, and what they are made of."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from controllers import Rig, find_law, load_rig
from controllers.card import PCI_8132, at_rest, send
from controllers.drives.servo import leg_servo
from controllers.laws.law import Feedback, Reference, ramp
from controllers.laws.nominal import (
    NominalAxes,
    friction_response,
    nominal_axes,
    response,
    usual_axes,
)
from controllers.laws.open_loop import Feedforward, OpenPosition
from controllers.laws.predictive import Friction, Horizon, Predictive
from controllers.simulate import sample, simulate
from kinematics import MotionError
from tests.controllers.servos import track

PULSE = 0.75e-6
DT = 0.125
WAYS = (60_000, -25_000, 40_000)
NO_LIMIT = np.full(3, np.inf)


def axes(**changes):
    return replace(
        NominalAxes.from_key(usual_axes().key(), 3),
        **{name: np.array(of, float) for name, of in changes.items()},
    )


def steady(run):
    """Mean and span (n,) of the following errors in pulses, where the quarter-sine's speed has long
    been constant.
    """
    middle = (run.t > 2.0) & (run.t < 3.9)
    return ((run.reference - run.actual)[middle] / PULSE).mean(0), np.ptp(
        (run.reference - run.actual)[middle], 0
    ) / PULSE


def test_between_samples_the_reference_is_a_cubic():
    """A cubic is met exactly, also by axes and runs at instants of their own; rest outside."""
    p, v, a = (np.polynomial.Polynomial([0, 30, -200, 700]).deriv(n) for n in range(3))
    k = np.arange(5) * 0.1
    reference = Reference(0.1, np.stack([p(k), -p(k)], 1), np.stack([v(k), -v(k)], 1))
    t = np.array([[0.0, 0.33], [0.25, 0.1]])
    for got, want in zip(reference.between(t), (p, v, a), strict=True):
        np.testing.assert_allclose(got, want(t) * [1, -1], rtol=1e-9)
    np.testing.assert_allclose(
        reference.between(np.array([0.4, 0.4]), before=True)[2], a(0.4) * np.array([1, -1])
    )
    for outside in (-0.1, 0.4, 7.0):
        position, speed, acceleration = reference.between(np.full(2, outside))
        np.testing.assert_allclose(position, p(np.clip(outside, 0, 0.4)) * np.array([1, -1]))
        assert not speed.any()
        assert not acceleration.any()


def test_heading_is_the_way_an_axis_last_went():
    reference = Reference(
        1.0,
        np.array([[0.0], [0.0], [5.0], [5.0], [0.0], [0.0]]),
        np.array([[0], [0], [5], [0], [-5.0], [0]]),
    )
    np.testing.assert_array_equal(reference.heading(np.array([[0.0], [1.0], [2.0], [3.0], [4.0], [5.0], [9.0]]))[:, 0],
                                  [0, 0, 1, 1, -1, -1, -1])  # fmt: skip


@settings(max_examples=60, deadline=None, derandomize=True)
@given(way=st.integers(-3000, 3000), start=st.floats(-3e4, 3e4), end=st.floats(-3e4, 3e4))
def test_a_ramp_arrives_in_its_step(way, start, end):
    """On the card: to one step of the speed register (36.6 pulses/s) over the step, and the pulse's
    rounding.
    """
    move = ramp(np.array([500.0 + way]), np.array([start]), np.array([end]), np.array([500.0]), DT)
    state = send(PCI_8132, at_rest([500]), move, 0.0)
    assert abs(state.counter(DT)[0, 0] - (500 + way)) <= PCI_8132.least_speed * DT + 1
    assert np.all(move.start_speed >= 0)
    assert np.all(move.max_speed >= 0)


def test_open_loop_lags_by_speed_over_gain_and_feedforward_by_nothing(rig, axis_motion):
    """Behind the command by v/K, K = 30: in closed form.

    Left of it is quantization: a pulse of the command.
    """
    motion = axis_motion("quarter-sine", WAYS, duration=5.0)
    speed = motion.at(2.5).qd / PULSE
    plain = track(motion, rig, OpenPosition(), dt=DT)
    behind, _ = steady(replace(plain, reference=plain.command))
    np.testing.assert_allclose(behind, speed / 30, rtol=5e-3)
    ahead, ripple = steady(track(motion, rig, Feedforward(), dt=DT))
    assert np.all(np.abs(ahead) <= 1.0)
    assert np.all(ripple <= 3.0)


def test_dead_time_is_met_by_a_shift(rig, axis_motion):
    """40 samples of 0.25 ms: unknown they cost v · 10 ms, known nothing."""
    motion = axis_motion("quarter-sine", WAYS, duration=5.0)
    speed = motion.at(2.5).qd / PULSE
    late = replace(leg_servo(rig.axes[0]), command_delay=40)
    unknown, _ = steady(track(motion, rig, Feedforward(), dt=DT, servo=late))
    np.testing.assert_allclose(unknown, speed * 0.01, rtol=0.02)
    known = Feedforward(axes=nominal_axes(Rig(rig, (late,) * 3)))
    assert known.axes.delay == pytest.approx([0.01] * 3)
    assert np.all(np.abs(steady(track(motion, rig, known, dt=DT, servo=late))[0]) <= 1.0)


def test_acceleration_feedforward_is_for_speed_loops_without_integral(rig, axis_motion):
    """Such a drive is r̈/(K ω) behind what ṙ/K gives it, in closed form; the share γ = 1 of it
    removes that.
    """
    motion = axis_motion("there and back", (200_000, -100_000, 50_000), duration=5.0)
    bare = replace(leg_servo(rig.axes[0]), integral_time=1e6, friction=0.0)
    worst = []
    for share in (0.0, 1.0):
        run = track(motion, rig, Feedforward(acceleration=share), dt=0.025, servo=bare)
        inside = (run.t > 0.5) & (run.t < 4.5)
        worst.append(np.abs(run.reference - run.actual)[inside].max(0) / PULSE)
    largest = 2 * np.pi**2 * np.array([200_000, 100_000, 50_000]) / 5.0**2 / (30 * 2 * np.pi * 30)
    np.testing.assert_allclose(worst[0], largest, atol=2.0)
    # rounding, and what a straight line of speed leaves out between samples
    assert np.all(worst[1] <= 3.0)


def test_play_is_taken_up_by_half_on_the_way(rig, axis_motion):
    motion = axis_motion("quarter-sine", WAYS, duration=5.0)
    loose = replace(leg_servo(rig.axes[0]), play=20 * PULSE)
    know = nominal_axes(Rig(rig, (loose,) * 3))
    behind = [
        steady(track(motion, rig, Feedforward(play=share, axes=know), dt=DT, servo=loose))[0]
        for share in (0, 1)
    ]
    np.testing.assert_allclose(behind[0], [10, -10, 10], atol=1.0)
    np.testing.assert_allclose(behind[1], 0, atol=1.0)


def test_nominal_axes_are_the_rig_as_stated_and_find_their_way_into_laws():
    stated = load_rig("servo-rig")
    for number in ("ff", "mpc"):
        law = find_law(number, stated)
        np.testing.assert_allclose(law.axes.position_gain, [30, 30, 20])
        np.testing.assert_allclose(law.axes.integral_time, [30e-3, 30e-3, 45e-3])
        np.testing.assert_allclose(law.axes.play, 2 / 60 / (360 / (2048 * 74)), rtol=1e-9)
    with pytest.raises(MotionError, match="no position loop"):
        Horizon(nominal_axes(load_rig("hexapod-steppers")), DT, 2, 0.1)


def test_response_is_the_drive_integrated():
    """Against integration of `NominalAxes`' equations to 1e-9: for a command of a ramp of speed,
    and for friction.
    """
    some = axes(position_gain=[30, 20, 12], integral_time=[0.03, 0.045, 0.1], friction=[5, 0, 1])
    model, state, w = (
        response(some, DT, 5),
        np.array([3.0, 40.0, -200.0, 10.0]),
        np.array([900.0, -300.0]),
    )
    at = np.arange(1, 6) / 5 * DT
    push = friction_response(some, DT / 5, 5)[:, 1:]
    for i in range(3):
        gain, loop, integral, friction = (
            of[i] for of in (some.position_gain, some.speed_loop, some.integral_time, some.friction)
        )

        def rates(t, z, torque, way, gain=gain, loop=loop, integral=integral, friction=friction):
            x, v, held = z
            u = t / DT
            error = gain * (way * (state[3] + w[0] * u + (w[1] - w[0]) * u * u / 2) - x) - v
            return [v, loop * error + held - friction * v + torque, loop / integral * error]

        def integrated(start, torque, way):
            return solve_ivp(
                rates, (0, DT), start, t_eval=at, args=(torque, way), rtol=1e-11, atol=1e-11
            ).y[0]

        np.testing.assert_allclose(
            model.C[i] @ state + model.D[i] @ w, integrated(state[:3], 0.0, 1.0), rtol=1e-9
        )
        np.testing.assert_allclose(push[i], integrated(np.zeros(3), 1.0, 0.0), rtol=1e-6)


def test_steps_in_a_row_are_one_long_response():
    model = response(axes(), DT, 2)
    free, driven = model.extend(3)
    rng = np.random.default_rng(0)
    state, w = rng.normal(size=(3, 4)), rng.normal(size=(3, 6))
    s, seen = state, []
    for k in range(3):
        two = w[:, 2 * k : 2 * k + 2, None]
        seen.append((model.C @ s[..., None] + model.D @ two)[..., 0])
        s = (model.F @ s[..., None] + model.G @ two)[..., 0]
    together = (free @ state[..., None] + driven @ w[..., None])[..., 0]
    np.testing.assert_allclose(together, np.concatenate(seen, 1), rtol=1e-12, atol=1e-12)


def test_friction_that_turns_in_the_middle_is_its_response_from_there():
    know = axes(coulomb=[2e6, 1e6, 0])
    instants = np.arange(1, 11) / 5
    friction = Friction(know, DT, 2, instants)
    heading = np.where(friction.places < 1.0, -1.0, 1.0)[:, None] * np.ones(3)
    want = (
        -2
        * know.coulomb[:, None]
        * np.concatenate([np.zeros((3, 5)), friction_response(know, DT / 5, 5)[:, 1:]], 1)
    )
    got = friction.respond(heading)
    # the place is known to half a stretch of 5 ms
    np.testing.assert_allclose(got, want, atol=0.12 * np.abs(want).max())


def problem(rng, scale=1.0):
    state = np.stack([np.zeros(3), 1e3 * np.abs(rng.normal(size=3)), np.zeros(3), np.zeros(3)], 1)
    guide = np.abs(scale * rng.normal(500, 100, size=(3, 6)))
    wanted = np.cumsum(np.full((3, 15), 100.0 * scale), 1) + rng.normal(size=(3, 15))
    return state, wanted, guide


def test_without_limits_the_program_is_least_squares():
    """Against the stacked least squares, by numpy; 1e-5 of hundreds of pulses is OSQP's own
    tolerance.
    """
    rng = np.random.default_rng(1)
    horizon = Horizon(axes(), DT, 3, 0.05)
    for _ in range(5):
        state, wanted, guide = problem(rng)
        got = horizon.best(state, wanted, guide)
        for i in range(3):
            rows = np.concatenate([horizon.driven[i], np.sqrt(0.05) * np.eye(6)])
            right = np.concatenate(
                [wanted[i] - horizon.free[i] @ state[i], np.sqrt(0.05) * guide[i]]
            )
            np.testing.assert_allclose(got[i], np.linalg.lstsq(rows, right)[0], atol=1e-4)


def test_limits_are_kept_and_reached():
    rng = np.random.default_rng(2)
    tight = axes(max_speed=[3000] * 3, max_acceleration=[8000] * 3)
    horizon = Horizon(tight, DT, 3, 0.05)
    for _ in range(5):
        state, wanted, guide = problem(rng)
        w = horizon.best(state, wanted, guide)
        now = np.clip(state[:, 1], -3000, 3000) * DT
        change = np.diff(np.concatenate([now[:, None], w], 1), axis=1)
        assert np.abs(w).max() <= 3000 * DT + 1e-4
        assert np.abs(change).max() <= 8000 * DT**2 + 1e-4
        assert np.abs(change).max() >= 8000 * DT**2 - 1e-2
        # no other permitted command is nearer: the cost does not fall towards permitted neighbours
        gradient = (horizon.hessian @ w[..., None])[..., 0] - horizon.pull(state, wanted, guide)
        for _ in range(20):
            other = w + rng.normal(size=w.shape)
            other = np.clip(other, -3000 * DT, 3000 * DT)
            jump = np.diff(np.concatenate([now[:, None], other], 1), axis=1)
            if np.abs(jump).max() <= 8000 * DT**2 and (other[:, 0::2] * other[:, 1::2] >= 0).all():
                assert (gradient * (other - w)).sum() >= -1e-2


def test_no_step_of_a_program_turns_round():
    """A command of the card runs one way."""
    horizon = Horizon(axes(), DT, 4, 1e-3)
    wanted = np.tile(300 * np.sin(np.arange(1, 21) / 20 * 2 * np.pi), (3, 1))
    w = horizon.best(np.zeros((3, 4)), wanted, np.zeros((3, 8)))
    assert np.all(w[:, 0::2] * w[:, 1::2] >= -1e-3)
    assert (w > 10).any()
    assert (w < -10).any()


def test_predictive_follows_and_its_runs_do_not_know_each_other(rig, axis_motion):
    motion = axis_motion("quarter-sine", WAYS, duration=2.0)
    run = track(motion, rig, Predictive(), dt=DT)
    plain = track(motion, rig, OpenPosition(), dt=DT)
    rms, before = (np.sqrt(np.mean((of.actual - of.reference) ** 2, 0)) for of in (run, plain))
    assert np.all(rms < before / 50)
    reference = Reference(DT, np.cumsum(np.full((9, 3), 400.0), 0), np.full((9, 3), 3200.0))
    weight = np.array([[1e-3], [1e-1], [1e-3]])
    rng = np.random.default_rng(3)
    read = Feedback(*(rng.normal(size=(3, 3)) * 50 + 1000 for _ in range(3)))
    together = Predictive(weight=weight).command(2, reference, read)
    for b in range(3):
        own = Feedback(read.position[b : b + 1], read.speed[b : b + 1], read.counter[b : b + 1])
        alone = Predictive(weight=float(weight[b, 0])).command(2, reference, own)
        np.testing.assert_array_equal(together.max_speed[b], alone.max_speed[0])


@pytest.mark.parametrize(
    ("wrong", "reason"), [({"weight": 0.0}, "above zero"), ({"horizon": 0}, "at least 1")]
)
def test_predictive_refuses_what_has_no_meaning(wrong, reason):
    with pytest.raises(MotionError, match=reason):
        Predictive(**wrong)


@pytest.mark.parametrize("speed", [3.9, -3.9, 0.5, 40.0])
def test_an_axis_too_fast_to_turn_before_a_step_brakes_within_it(speed):
    """A step that turns is bound to one sign, which the acceleration limit must be able to reach.

    speed  in changes of speed that the limit allows between two ends of steps
    """
    limit = 8000.0
    change = limit * DT**2
    horizon = Horizon(axes(max_acceleration=[limit] * 3), DT, 3, 1e-4)
    state = np.zeros((3, 4))
    state[:, 1] = speed * change / DT
    wanted = np.full((3, 15), -np.sign(speed) * 1e4)
    w = horizon.best(state, wanted, np.zeros((3, 6)))

    jumps = np.diff(np.concatenate([state[:, 1:2] * DT, w], 1), axis=1)
    assert np.abs(jumps).max() <= change * (1 + 1e-9)
    assert np.all(w[:, 0::2] * w[:, 1::2] >= -1e-6)
    # it brakes at the limit, as whoever wants the other way does
    np.testing.assert_allclose(jumps[:, 0], -np.sign(speed) * change, rtol=1e-6)


def test_every_state_and_scale_has_a_command_within_the_limits():
    """A law that is asked for the best always answers: speeds, limits and weights over twelve
    decades.
    """
    rng = np.random.default_rng(7)
    for _ in range(60):
        step, size = 10 ** rng.uniform(-3, -0.7), 10 ** rng.uniform(0, 6)
        top, rate = size * 10 ** rng.uniform(-2, 2), size * 10 ** rng.uniform(-2, 3)
        horizon = Horizon(
            axes(max_speed=[top] * 3, max_acceleration=[rate] * 3),
            step,
            4,
            10 ** rng.uniform(-4, 1),
        )
        for _ in range(4):
            state = rng.normal(size=(3, 4)) * size * [1, 5, 20, 1]
            w = horizon.best(
                state, size * rng.normal(size=(3, 20)), size * step * rng.normal(size=(3, 8))
            )
            jumps = np.diff(w, axis=1)
            assert np.abs(w).max() <= (top + rate * step) * step * (1 + 1e-9)
            assert np.abs(jumps).max() <= rate * step**2 * (1 + 1e-9)


def test_predictive_runs_the_whole_sine_of_the_servo_rig():
    """Its axes start at full speed at once, which the acceleration limit does not allow: they catch
    up and turn.
    """
    stated = load_rig("servo-rig")
    task = stated.task("sine")
    weight = np.array([[1e-3], [1e-2], [1e-1], [1.0]])
    laws = find_law("mpc", stated, weight=weight)
    runs = simulate(sample(task.motion, stated.machine, task.dt), laws, [stated] * 4)
    reference = task.motion.at(runs.t).q - stated.machine.home_q
    pulse = np.array([axis.pulse for axis in stated.machine.axes])
    # it stops from full speed at the end, which it prepares for
    middle = (runs.t > 2) & (runs.t < 18)
    error = runs.actual * pulse - reference[:, None]
    # by ṙ/K the drive alone lags up to 0.987 rad/s / 30 1/s = 33 mrad
    assert np.abs(error[middle]).max() < 1e-3
