"""Calibration: known errors are found again, their uncertainty is honest, and the thesis' own data
give their cause.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Hexapod,
    Machine,
    MotionError,
    Noise,
    calibrate,
    load_measurements,
    whole_poses,
)
from kinematics.calibration import PARTS
from kinematics.calibration.checks import axis_checks
from kinematics.calibration.measurements import select_rows
from kinematics.calibration.parameters import Prediction, full_vector
from kinematics.calibration.result import identified_pulses, nearest_step
from tests.kinematics.calibration.drawn_hexapod import (
    ALL_PARTS,
    FACTORS,
    NOISE,
    add_noise,
    draw,
    draw_commands,
    predict_poses,
    rms,
)

TARGETS = {"position": 7e-6, "rotation": 25e-6}
"""Largest RMS error of held-out poses: NOISE, and what 40 poses leave of it in 48 parameters."""


@pytest.fixture(scope="module")
def real(preset):
    return calibrate(preset, load_measurements("cmm"))


@pytest.fixture(scope="module")
def identified(preset):
    """48 parameters from 40 noisy poses, by seed: errors of 40 other poses as measured, and in
    truth.
    """

    def calibrate_drawn(seed):
        random = np.random.default_rng(seed)
        drawn = draw(preset, random)
        used, held = draw_commands(random), draw_commands(random)
        measured = whole_poses(used, add_noise(drawn.poses(used), random), noise=NOISE)
        found = calibrate(preset, measured, ALL_PARTS)
        truth, guess = drawn.poses(held), predict_poses(preset, found.machine, held)
        return found, rms(guess, add_noise(truth, random)), rms(guess, truth)

    return {seed: calibrate_drawn(seed) for seed in range(3)}


def spoiled(machine, seed):
    """A full vector away from the nominal one, and commanded and measured poses about home."""
    random, vector = np.random.default_rng(seed), full_vector(machine)
    theta = vector.nominal + 1e-3 * machine.characteristic_length * random.normal(size=vector.size)
    theta[vector.frame()] = [1e-3, -2e-3, 3e-3, 0.2, -0.1, 0.4]
    size = machine.characteristic_length
    commanded, measured = (
        RigidTransform.from_components(
            size * random.uniform(-0.1, 0.1, (4, 3)),
            Rotation.from_rotvec(random.uniform(-0.1, 0.1, (4, 3))),
        )
        for _ in range(2)
    )
    return Prediction.from_measurements(machine, vector, whole_poses(commanded, measured)), theta


def test_the_jacobian_is_that_of_the_errors(any_hexapod):
    prediction, theta = spoiled(any_hexapod, 3)
    _, jacobian = prediction.at(theta)
    # differences of fourth order: truncation of h⁴ and 1e-13 / h of the closed machine meet at 1e-8
    step = 1e-4
    for k in range(len(theta)):
        change = step * np.eye(len(theta))[k]
        one, two = (
            prediction.at(theta + n * change)[0] - prediction.at(theta - n * change)[0]
            for n in (1, 2)
        )
        np.testing.assert_allclose(
            jacobian[..., k], (8 * one - two) / (12 * step), rtol=1e-6, atol=1e-7
        )


def test_a_prediction_closes_the_machine(any_hexapod):
    """The predicted pose has, with the changed joints, the lengths that were sent: written out
    again.
    """
    prediction, theta = spoiled(any_hexapod, 4)
    vector, machine = prediction.vector, any_hexapod
    base, platform = theta[vector.joints()].reshape(2, 6, 3)
    frame = RigidTransform.from_components(theta[-6:-3], Rotation.from_euler("XYZ", theta[-3:]))
    pose = machine.home * (frame.inv() * prediction.measured_poses(theta))
    sent = machine.inverse(machine.home * prediction.measurements.commanded) - machine.home_q
    for k in range(len(pose)):
        legs = pose[k].apply(platform) - base
        lengths = machine.home_q + theta[6:12] + theta[:6] * sent[k]
        np.testing.assert_allclose(np.linalg.norm(legs, axis=1), lengths, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000), st.floats(-0.05, 0.05), st.floats(-2.5, 2.5))
def test_what_is_measured_without_noise_is_found(preset, seed, factor, yaw):
    random = np.random.default_rng(seed)
    commanded = draw_commands(random, 8)
    lengths = preset.home_q + (1 + factor) * (
        preset.inverse(preset.home * commanded) - preset.home_q
    )
    frame = RigidTransform.from_components(
        random.uniform(-0.5, 0.5, 3), Rotation.from_euler("XYZ", [0.02, -0.03, yaw])
    )
    measured = (
        frame * preset.home.inv() * preset.forward(lengths, near=preset.home * commanded).pose
    )
    found = calibrate(preset, whole_poses(commanded, measured), ("factor", "frame"))
    assert found["factor"].value == pytest.approx(1 + factor, abs=1e-9)
    seen = [found[f"frame {name}"].value for name in ("x", "y", "z", "rx", "ry", "rz")]
    expected = [*frame.translation, *frame.rotation.as_euler("XYZ")]
    np.testing.assert_allclose(seen, expected, atol=1e-9)
    assert found.rms(found.after) < 1e-10


def test_all_48_parameters_are_found_without_noise(preset):
    random = np.random.default_rng(5)
    drawn, used, held = draw(preset, random), draw_commands(random), draw_commands(random)
    found = calibrate(preset, whole_poses(used, drawn.poses(used)), ALL_PARTS)
    assert len(found.parameters) == found.observability.rank == 48
    # forward kinematics leaves 1e-14 m, the smallest singular value amplifies it ten thousand times
    np.testing.assert_allclose(found.machine.base, drawn.built.base, atol=1e-8)
    np.testing.assert_allclose(found.machine.platform, drawn.built.platform, atol=1e-8)
    np.testing.assert_allclose(
        [found[f"leg{n} factor"].value for n in range(1, 7)], drawn.factors, atol=1e-8
    )
    np.testing.assert_allclose(
        [found[f"leg{n} offset"].value for n in range(1, 7)], drawn.offsets, atol=1e-8
    )
    errors = rms(predict_poses(preset, found.machine, held), drawn.poses(held))
    assert errors["position"] < 1e-10
    assert errors["rotation"] < 1e-9
    # and offsets are where they belong: zero counts are at home
    np.testing.assert_allclose(found.machine.home_q, preset.home_q + drawn.offsets, atol=1e-8)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_held_out_poses_are_predicted(identified, seed):
    found, measured, truth = identified[seed]
    for name, limit in TARGETS.items():
        assert measured[name] <= limit
    # 48 parameters from 240 values leave, on average over the fitted poses, √(48/240) of the noise
    # in the prediction
    share = np.sqrt(48 / 240)
    assert truth["position"] == pytest.approx(share * NOISE.position, rel=0.5)
    assert truth["rotation"] == pytest.approx(share * NOISE.rotation, rel=0.5)
    assert found.degrees == 192
    # χ² of 192 degrees: a standard deviation of 5 % of its root
    assert found.scale == pytest.approx(1, abs=0.2)
    assert found.rms(found.left_out) > NOISE.position > found.rms(found.after)


def test_standard_errors_are_those_of_the_estimates(preset, identified):
    """Over seeds, (estimate − truth) / standard error has a variance of one for every kind of
    parameter.
    """
    deviations = []
    for seed, (found, _, _) in identified.items():
        drawn = draw(preset, np.random.default_rng(seed))
        joints = np.concatenate([drawn.built.base.ravel(), drawn.built.platform.ravel()])
        expected = np.concatenate([drawn.factors, drawn.offsets, joints])
        deviations.append(
            [(p.value - e) / p.error for p, e in zip(found.parameters, expected, strict=True)]
        )
    # 144 deviations, of which perhaps half are independent: 1 ± 0.35 is three of their standard
    # deviations
    assert np.sqrt(np.mean(np.square(deviations))) == pytest.approx(1, abs=0.35)


def test_less_noise_gives_smaller_standard_errors_in_proportion(preset):
    random = np.random.default_rng(1)
    used = draw_commands(random, 10)
    errors = [
        [
            p.error
            for p in calibrate(
                preset, whole_poses(used, used, noise=noise), ("factor", "frame")
            ).parameters
        ]
        for noise in (Noise(5e-6, 2e-5), Noise(1e-6, 4e-6))
    ]
    np.testing.assert_allclose(errors[0], 5 * np.array(errors[1]), rtol=1e-6)


def test_residuals_beyond_the_stated_noise_widen_the_errors(preset):
    random = np.random.default_rng(2)
    drawn, used = draw(preset, random), draw_commands(random)
    stated = replace(whole_poses(used, drawn.poses(used)), noise=NOISE)
    found, silent = (
        calibrate(preset, data) for data in (stated, replace(stated, noise=Noise(1.0, 4.0)))
    )
    assert found.scale > 10  # a factor and a frame do not explain errors of all joints
    assert silent.scale < 1
    # NOISE in the same proportion, in metres: weights, hence the estimates, are the same
    assert found["factor"].value == pytest.approx(silent["factor"].value, rel=1e-9)
    assert found["factor"].error == pytest.approx(
        silent["factor"].error * NOISE.position * found.scale, rel=1e-6
    )


def test_the_thesis_data_give_their_cause(real, preset):
    """[Sahbaz 2007, Tables 6.2 and 6.3]."""
    errors = np.array([20.3429, 21.6857, -43.4999])
    np.testing.assert_allclose(real.before[0, :3], 1e-6 * errors, atol=1e-12)
    assert 1e6 * real.rms(real.before) == pytest.approx(183, abs=0.5)
    assert real.rms(real.after) <= 14e-6
    assert real.rms(real.left_out) <= 17e-6
    assert len(real.parameters) == 5
    assert real.used.sum() == 24
    assert real["factor"].value == pytest.approx(1.0178, abs=1e-4)
    (pulse,) = identified_pulses(real)
    assert pulse.step is not None
    # 0.00006 in per step, halved
    assert pulse.step.length == pytest.approx(0.762e-6)
    assert {axis.pulse for axis in real.machine.axes} == {pulse.value}
    # a factor alone moves no joint, and home stays where it is
    np.testing.assert_array_equal(real.machine.base, preset.base)
    np.testing.assert_array_equal(real.machine.home.as_matrix(), preset.home.as_matrix())


def test_the_thesis_rotation_error_is_only_half_explained(real):
    """[Sahbaz 2007, Table 6.4]: the pulse explains how far the plate leans, not that it leans
    elsewhere.
    """
    (check,) = axis_checks(real)
    assert check.is_explained is False
    commanded, measured, guess = np.rad2deg(check.tilt)
    assert commanded == pytest.approx(9.2098, abs=1e-3)
    assert abs(guess - measured) < 0.1 * abs(measured - commanded)
    headings = np.rad2deg(check.heading)
    assert abs(headings[1] - headings[0]) == pytest.approx(1.8, abs=0.1)
    assert abs(headings[2] - headings[0]) < 0.1


def test_an_independent_fit_agrees(real, preset):
    """Five parameters by differences, on leg lengths and Newton written out again."""
    data = real.measurements
    desired, measured = data.commanded.translation[:8], data.measured.translation[:8]
    start = preset.home.translation

    def legs(position, turn):
        return np.linalg.norm(
            position + preset.platform @ Rotation.from_rotvec(turn).as_matrix().T - preset.base,
            axis=1,
        )

    def reached(target, lengths):
        solved = least_squares(
            lambda x: legs(x[:3], x[3:]) - lengths, [*(start + target), 0, 0, 0], x_scale=[0.01] * 3 + [0.1] * 3,
            xtol=1e-15, ftol=1e-15, gtol=1e-15,
        )  # fmt: skip
        return solved.x[:3] - start

    home = legs(start, np.zeros(3))

    def errors(theta):
        positions = [
            reached(p, home + theta[0] * (legs(start + p, np.zeros(3)) - home)) for p in desired
        ]
        return (Rotation.from_euler("z", theta[4]).apply(positions) + theta[1:4] - measured).ravel()

    found = least_squares(
        errors, [1, 0, 0, 0, 0], x_scale=[1e-2, 1e-4, 1e-4, 1e-4, 1e-3], diff_step=1e-4
    )
    expected = [parameter.value for parameter in real.parameters]
    np.testing.assert_allclose(found.x, expected, atol=2e-6)


def test_left_out_errors_are_those_of_fits_without_the_pose(real, preset):
    data = real.measurements
    for k in range(8):
        others = select_rows(data, [row for row in range(8) if row != k])
        alone = calibrate(preset, others)
        # the pose that was left out, as a check of that fit
        theta = full_vector(preset).nominal.copy()
        theta[:6] = alone["factor"].value
        theta[[-6, -5, -4, -1]] = [alone[f"frame {name}"].value for name in ("x", "y", "z", "rz")]
        errors = Prediction.from_measurements(
            preset, full_vector(preset), select_rows(data, [k])
        ).at(theta)[0][0, :3]
        # of second order in parameters that differ by 1e-3: a thousandth of the errors
        np.testing.assert_allclose(real.left_out[k, :3], errors, atol=5e-8)


def test_what_the_others_do_not_determine_has_no_left_out_error(preset):
    used = draw_commands(np.random.default_rng(0), 3)
    found = calibrate(preset, whole_poses(used, used), ("factors", "offsets"))
    # two poses determine two parameters of every leg
    assert np.isfinite(found.left_out[:, :6]).all()
    two = calibrate(preset, whole_poses(used[:2], used[:2]), ("factors", "offsets"))
    assert np.isnan(two.left_out).all()
    assert two.degrees == 0
    assert all(np.isnan(parameter.error) for parameter in two.parameters)


def test_moving_frame_and_base_together_is_not_seen(preset):
    random = np.random.default_rng(7)
    drawn, used = draw(preset, random), draw_commands(random)
    measured = drawn.poses(used)
    found = calibrate(preset, whole_poses(used, measured), (*ALL_PARTS, "frame"))
    assert (len(found.parameters), found.observability.rank) == (54, 48)
    assert set(found.observability.indices.values()) == {0.0}
    assert found.rms(found.after) < 1e-10
    assert found.rms(found.after, "rotation") < 1e-9
    # base joints and frame hide each other; what a leg does by itself is seen
    hidden = {p.name for p in found.parameters if np.isinf(p.error)}
    assert {p.name for p in found.parameters if "base" in p.name or "frame" in p.name} >= hidden
    assert {f"frame {name}" for name in ("x", "y", "z", "rx", "ry", "rz")} <= hidden
    assert all(np.isfinite(found[f"leg{n} factor"].error) for n in range(1, 7))
    # such a change leaves every error as it is, to second order
    vector = full_vector(preset)
    prediction = Prediction.from_measurements(preset, vector, found.measurements)
    theta = np.array([p.value for p in found.parameters])
    for change in found.observability.unobservable_changes:
        small = 1e-5 * change / np.abs(change).max()
        moved = prediction.at(theta + small)[0] - prediction.at(theta)[0]
        assert np.abs(moved).max() < 1e-9


def test_one_pose_repeated_shows_lengths_and_not_factors(preset):
    pose = draw_commands(np.random.default_rng(0), 1)
    many = RigidTransform.concatenate([pose] * 4)
    found = calibrate(preset, whole_poses(many, many), ("factors", "offsets"))
    assert found.observability.rank == 6
    assert all(np.isinf(parameter.error) for parameter in found.parameters)
    # nothing was wrong, so nothing is changed
    np.testing.assert_allclose([p.value - p.nominal for p in found.parameters], 0, atol=1e-12)


class Slides(Machine):
    """Three slides at right angles, the platform held."""

    freedom = ("x", "y", "z")
    characteristic_length = 0.1

    def expression(self, position, rotation, near):
        return ca.vertcat(2 * position[0], position[1], position[2])


def test_machines_of_other_kinds():
    machine = Slides("slides", [Axis(name) for name in ("X", "Y", "Z")], RigidTransform.identity())
    at = np.random.default_rng(0).uniform(-1, 1, (6, 3))
    factors, offsets = np.array([1.01, 0.99, 1.002]), np.array([1e-3, -2e-3, 3e-3])
    # q = (2x, y, z), so an offset of X moves half as far
    measured = at * factors + offsets / [2, 1, 1]
    poses = [RigidTransform.from_translation(p) for p in (at, measured)]
    found = calibrate(machine, whole_poses(*poses), ("factors", "offsets"))
    np.testing.assert_allclose(
        [p.value for p in found.parameters], [*factors, *offsets], atol=1e-12
    )
    np.testing.assert_allclose(
        [axis.pulse for axis in found.machine.axes], 1e-6 * factors, rtol=1e-12
    )
    np.testing.assert_allclose(found.machine.home_q, offsets, atol=1e-12)
    np.testing.assert_allclose(found.machine.home.translation, offsets / [2, 1, 1], atol=1e-12)
    with pytest.raises(MotionError, match="hexapods only"):
        calibrate(machine, whole_poses(*poses), ("joints",))


@pytest.mark.parametrize(
    ("parts", "told"),
    [
        (("factr",), 'nearest is "factor"'),
        (("factor", "factors"), "factor is contained in factors"),
        (("frame-yaw", "frame"), "frame-yaw is contained in frame"),
        ((), "one part or more"),
        (("offsets", "offsets"), "each once"),
    ],
)
def test_models_that_are_none(preset, parts, told):
    used = draw_commands(np.random.default_rng(0))
    with pytest.raises(MotionError, match=told):
        calibrate(preset, whole_poses(used, used), parts)


def test_too_few_values_are_refused(preset):
    used = draw_commands(np.random.default_rng(0), 1)
    with pytest.raises(
        MotionError, match=r"6 values of 1 pose for 48 parameters.*measure more poses"
    ):
        calibrate(preset, whole_poses(used, used), ALL_PARTS)


def test_measurements_that_are_none(preset):
    used = draw_commands(np.random.default_rng(0), 4)
    spoilt = used.as_matrix().copy()
    spoilt[2, 0, 3] = np.nan
    with pytest.raises(MotionError, match="pose 3: measured must be finite"):
        whole_poses(used, RigidTransform.from_matrix(spoilt))
    with pytest.raises(MotionError, match="3 measured poses for 4 labels"):
        whole_poses(used, used[:3])
    with pytest.raises(MotionError, match="noise of the rotation"):
        Noise(1e-6, 0.0)


def test_a_singular_machine_is_named(preset, monkeypatch):
    """All six platform joints in one point: nothing holds the platform's turn."""
    monkeypatch.setattr(
        "kinematics.kinds.legged._refuse_coincident", lambda *_: None
    )  # else it is no machine
    machine = Hexapod(
        preset.base, np.full((6, 3), 1e-3), axes=preset.axes, home=preset.home, name="point"
    )
    used = draw_commands(np.random.default_rng(0), 4)
    with pytest.raises(MotionError, match="pose 1: machine point is singular"):
        calibrate(machine, whole_poses(used, used))


def test_every_part_is_one_of_the_full_vector(preset):
    vector = full_vector(preset)
    sizes = {name: len(tuple(part(vector))) for name, part in PARTS.items()}
    assert sizes == {
        "factor": 1,
        "factors": 6,
        "offsets": 6,
        "joints": 36,
        "frame": 6,
        "frame-yaw": 4,
    }


def test_steps_of_the_catalogue():
    assert nearest_step(0.7634e-6).length == pytest.approx(0.762e-6)
    assert nearest_step(1.53e-6).length == pytest.approx(1.524e-6)
    assert nearest_step(0.75e-6) is None
    assert FACTORS < 0.005  # a synthetic error cannot pass for another step


def test_a_prediction_that_cannot_be_closed_is_no_number(preset):
    prediction, theta = spoiled(preset, 1)
    theta[6:12] -= 1.0  # legs of negative length
    assert np.isnan(prediction.at(theta)[0]).all()


def test_two_legs_in_the_same_place_are_refused(preset, monkeypatch):
    monkeypatch.setattr(
        "kinematics.kinds.legged._refuse_coincident", lambda *_: None
    )  # else they are no machine
    base, platform = preset.base.copy(), preset.platform.copy()
    base[1], platform[1] = base[0], platform[0]
    machine = Hexapod(base, platform, axes=preset.axes, home=preset.home, name="five legs")
    used = draw_commands(np.random.default_rng(0), 4)
    with pytest.raises(MotionError, match="pose 1: machine five legs is singular"):
        calibrate(machine, whole_poses(used, used))


def test_a_calibration_is_printed_as_a_table(real):
    text = str(real)
    assert "183.062" in text
    assert "13.29" in text
    assert "array" not in text + repr(real)
    assert all(parameter.name in text for parameter in real.parameters)


def test_groups_and_parameters_that_are_none_are_told(real):
    with pytest.raises(MotionError, match='no group "positon", nearest is "position"'):
        real.rms(real.after, "positon")
    with pytest.raises(MotionError, match='no group "turn"'):
        real.plot(group="turn")
    with pytest.raises(MotionError, match=r'no parameter "frame q".*parameters: factor, frame x'):
        real["frame q"]
