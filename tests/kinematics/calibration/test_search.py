"""The search of a calibration: it finds weakly shown parameters, and refuses what the data
contradict.
"""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import (
    Axis,
    Hexapod,
    Machine,
    MotionError,
    Noise,
    OutOfReach,
    calibrate,
    load_machine,
    load_measurements,
    measured_positions,
    whole_poses,
)
from kinematics.calibration import search
from kinematics.calibration.measurements import select_rows
from kinematics.calibration.parameters import Prediction, full_vector
from kinematics.calibration.search import _has_converged
from kinematics.machine.pose import to_numbers
from tests.kinematics.calibration.drawn_hexapod import NOISE, add_noise, draw, draw_commands

MIDDLE = np.array([0, 0, 0.02])
JOINTS = ("factors", "offsets", "joints")


def built(machine, error, random):
    """A machine whose joints err."""
    base, platform = (
        joints + random.normal(0, error, (6, 3)) for joints in (machine.base, machine.platform)
    )
    return Hexapod(base, platform, axes=machine.axes, home=machine.home)


def sent(machine, real, commanded, factor=1.01, offsets=0.0):
    """What the real machine does, from the nominal home, when the nominal one is sent to poses."""
    target = machine.home * commanded
    lengths = machine.home_q + offsets + factor * (machine.inverse(target) - machine.home_q)
    return machine.home.inv() * real.forward(lengths, near=target, certify=False).pose


def translations(machine, seed, count, reach):
    """Positions of a machine with errors of its joints and pulses, at poses that are not turned."""
    random = np.random.default_rng(seed)
    commanded = RigidTransform.from_translation(random.uniform(-reach, reach, (count, 3)) + MIDDLE)
    real = built(machine, 5e-4, random)
    measured = sent(machine, real, commanded).translation + random.normal(0, 5e-6, (count, 3))
    return measured_positions(commanded, measured, noise=Noise(5e-6, 2e-5))


@pytest.mark.parametrize(
    ("frame", "columns"),
    [("frame-yaw", [5]), ("frame", [3, 4, 5])],
    ids=["turned about z", "turned"],
)
def test_the_thesis_data_with_every_factor_and_offset(preset, frame, columns):
    """An independent fit of the same model: forward kinematics of the package, SciPy's derivatives,
    mm and percent.
    """
    data = select_rows(load_measurements("cmm"), range(8))
    target = preset.home * data.commanded
    counts = preset.inverse(target) - preset.home_q

    def errors(theta):
        lengths = preset.home_q + 1e-3 * theta[6:12] + (1 + 1e-2 * theta[:6]) * counts
        pose = preset.home.inv() * preset.forward(lengths, near=target, certify=False).pose
        angles = np.zeros(6)
        angles[columns] = 1e-2 * theta[15:]
        turned = (
            Rotation.from_euler("XYZ", angles[3:]).apply(pose.translation) + 1e-3 * theta[12:15]
        )
        return 1e6 * (turned - data.measured.translation).ravel()

    independent = least_squares(
        errors, np.zeros(15 + len(columns)), xtol=1e-12, ftol=1e-12, max_nfev=1000
    )
    found = calibrate(preset, data, ("factors", "offsets", frame))
    # a narrow valley, along which both stop where the sum of squares changes no more
    assert 1e6 * found.rms(found.after) == pytest.approx(
        np.sqrt(np.mean(independent.fun**2)), rel=1e-4
    )
    assert 1e6 * found.rms(found.after) == pytest.approx(
        {1: 3.67, 3: 3.61}[len(columns)], abs=0.005
    )


@pytest.mark.parametrize(
    ("seed", "count", "reach"), [(1, 20, 0.01), (11, 20, 0.005), (13, 40, 0.01), (14, 20, 0.005)]
)
def test_positions_of_a_small_range_show_joints_weakly_and_are_explained(
    preset, seed, count, reach
):
    """The errors come down to the noise, however far the way: these once stalled, or ended 20 mm
    off.
    """
    found = calibrate(preset, translations(preset, seed, count, reach), ("factors", "joints"))
    assert found.rms(found.before) > 100e-6
    assert found.rms(found.after) < NOISE.position * 1.2
    assert found.degrees == 3 * count - found.observability.rank


FAR_OFF = [(2, False), (4, True)]


@pytest.mark.parametrize(("seed", "refused"), FAR_OFF, ids=["found", "refused"])
def test_joints_that_are_far_off_are_found_or_refused(preset, seed, refused):
    """Joints and lengths of 100 mm that err by 10 mm take poses to singularities: no garbage, and
    no traceback.
    """
    random = np.random.default_rng(seed)
    commanded = RigidTransform.from_components(
        random.uniform(-0.02, 0.02, (40, 3)) + MIDDLE,
        Rotation.from_euler("XYZ", random.uniform(-10, 10, (40, 3)), degrees=True),
    )
    real = built(preset, 1e-2, random)
    measured = add_noise(sent(preset, real, commanded, offsets=random.normal(0, 1e-2, 6)), random)
    data = whole_poses(commanded, measured, noise=NOISE)
    if refused:
        with pytest.raises(MotionError, match="the measurements contradict the machine hexapod"):
            calibrate(preset, data, JOINTS)
    else:
        # χ² of 192 degrees: a standard deviation of 5 % of its root
        assert calibrate(preset, data, JOINTS).scale == pytest.approx(1, abs=0.2)


def test_errors_are_a_function_of_the_parameters(preset):
    random = np.random.default_rng(0)
    used = draw_commands(random, 6)
    vector = full_vector(preset)
    prediction = Prediction.from_measurements(preset, vector, whole_poses(used, used))
    expected = prediction.at(vector.nominal)[0]
    for _ in range(5):
        prediction.at(vector.nominal + random.normal(0, 2e-2, vector.size))
        np.testing.assert_array_equal(prediction.at(vector.nominal)[0], expected)


class Wave(Machine):
    """One slide whose coordinate is the sine of its place: singular at ±π/2, where the slope
    changes its sign.
    """

    freedom = ("x",)
    characteristic_length = 1.0

    def expression(self, position, rotation, near):
        return ca.sin(position[0])


def test_a_pose_on_the_other_side_of_a_singularity_is_none():
    machine = Wave("wave", [Axis("X")], RigidTransform.identity())
    used = RigidTransform.from_translation([[1.4, 0, 0]])
    vector = full_vector(machine)
    prediction = Prediction.from_measurements(machine, vector, whole_poses(used, used))
    crossed = 0
    for offset in np.linspace(-1.5, 0.0, 61):
        theta = vector.nominal + offset * np.eye(vector.size)[1]
        newton = prediction.poses(theta, prediction.sent, to_numbers(used))[0, 0]
        error = prediction.at(theta)[0][0, 0]
        across = not np.cos(newton) > 0
        crossed += across
        assert np.isnan(error) if across else error == pytest.approx(newton - 1.4, abs=1e-12)
    assert crossed > 10  # far from the commanded place, Newton jumps about


def test_convergence_is_what_the_tangent_plane_still_promises():
    """Errors square to the Jacobian's columns: nothing to gain.

    Along one: all of it. Tiny ones are none.
    """
    jacobian = np.array([[1.0, 0.0], [0.0, 1e-6], [0.0, 0.0], [0.0, 0.0]])
    assert _has_converged(np.array([0.0, 0.0, 1.0, 1.0]), jacobian, 0.0)
    # 1e-3 · √(2 parameters / 2 spare values) · √2 of what is left
    assert _has_converged(np.array([0.0, 1.4e-3, 1.0, 1.0]), jacobian, 0.0)
    assert not _has_converged(np.array([0.0, 1.5e-3, 1.0, 1.0]), jacobian, 0.0)
    assert not _has_converged(np.array([1e-9, 0.0, 0.0, 0.0]), jacobian, 0.0)
    assert _has_converged(np.array([1e-9, 0.0, 0.0, 0.0]), jacobian, 1e-8)
    # as many values as parameters: nothing is left over to compare with
    assert not _has_converged(np.array([1e-9, 0.0]), jacobian[:2], 0.0)
    assert _has_converged(np.zeros(2), jacobian[:2], 0.0)


def test_a_search_that_does_not_converge_is_told_from_bad_data(preset, monkeypatch):
    monkeypatch.setattr(search, "MAX_EVALUATIONS", 5)
    with pytest.raises(
        MotionError, match=r"did not converge in 5 evaluations.*identify fewer, or measure"
    ):
        calibrate(preset, translations(preset, 0, 20, 0.005), ("factors", "joints"))


def test_one_pose_of_another_machine_is_named(preset):
    used = draw_commands(np.random.default_rng(0), 4)
    places = used.translation + np.array([[0, 0, 0], [0, 0, 0], [100.0, 0, 0], [0, 0, 0]])
    with pytest.raises(
        MotionError, match=r"pose 3 contradicts the machine hexapod.* mm off.*leave that pose out"
    ):
        calibrate(preset, measured_positions(used, places))


def test_a_pose_beyond_travel_is_a_slip_of_units_and_told_by_axis(preset):
    """3 mm short of the machine's lower end, home, is nothing; a commanded height in m instead of
    mm is.
    """
    random = np.random.default_rng(0)
    used = draw_commands(random, 6)
    below = RigidTransform.concatenate([used, RigidTransform.from_translation([[0, 0, -0.003]])])
    assert calibrate(preset, whole_poses(below, below)).skipped == ()
    far = RigidTransform.concatenate(
        [used, RigidTransform.from_translation([[0.001, 0.002, -100.0]])]
    )
    told = r"pose 7: leg1 would stand 99569\.8 mm from home; its travel is 0 mm to 50\.8 mm; check the file's units"
    with pytest.raises(MotionError, match=told):
        calibrate(preset, whole_poses(far, far))


def test_poses_off_the_machine_are_told_by_file_and_label_and_only_if_fitted():
    """[Sahbaz 2007, Table 6.4] turns the platform, which a tripod does not; it is a check, and no
    reason to stop.
    """
    data, tripod = load_measurements("cmm"), load_machine("tripod")
    found = calibrate(tripod, data, other_machine=True)
    assert len(found.after) == len(found.measurements) == 8
    (skipped,) = found.skipped
    assert "rotation 1 (6.4): machine tripod holds ry: it has ry -6.99" in skipped
    with pytest.raises(
        MotionError, match=r"cmm\.toml:15: pose 1 \(6\.2\): machine linkage holds z: it has z 10 mm"
    ) as raised:
        calibrate(load_machine("linkage"), data, other_machine=True)
    assert not isinstance(raised.value, OutOfReach)  # bad input, not an infeasible job
    assert len(raised.value.faults) == int(data.fit.sum())  # every table of theirs leads up
    with pytest.raises(MotionError, match=r"rotation 1 \(6\.4\): machine tripod holds ry"):
        calibrate(tripod, replace(data, fit=np.ones(9, bool)), other_machine=True)


def test_rotations_count_wherever_they_were_measured(preset):
    """One pose of many without its rotation does not take the others' away; directions are asked
    for.
    """
    random = np.random.default_rng(1)
    drawn, used = draw(preset, random), draw_commands(random, 20)
    data = whole_poses(used, add_noise(drawn.poses(used), random), noise=NOISE)
    seen = data.seen.copy()
    seen[7, 3:6] = False
    found = calibrate(preset, replace(data, seen=seen), JOINTS)
    assert found.used.sum() == 20 * 6 - 3
    assert found.observability.rank == 48
    assert not calibrate(preset, load_measurements("cmm")).used[:, 3:].any()
    assert calibrate(preset, load_measurements("cmm"), use="all").used[:8, 6:].all()


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"use": "pos"}, "use 'pos' must be"),
        ({"use": ""}, "use '' must be"),
        ({"use": 5}, "use 5 must be"),
        ({"parts": None}, "None is not a sequence of parts"),
        ({"parts": "factor"}, "'factor' is not a sequence of parts; parts: factor, factors"),
        (
            {"machine": 3},
            "a machine is given by its name or the path of a file, or as it is, not as 3",
        ),
        (
            {"measured": [1]},
            "a measurement file is given by its name or the path of a file, or as it is",
        ),
    ],
)
def test_calls_that_ask_for_nothing_known(preset, changed, told):
    with pytest.raises(MotionError, match=told):
        calibrate(**{"machine": preset, "measured": load_measurements("cmm"), **changed})


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda p: whole_poses(p[0], p[0]), "commanded is a single pose"),
        (
            lambda p: whole_poses(p, p, labels=["one"]),
            "4 commanded poses for 1 label; give one each",
        ),
        (lambda p: whole_poses(p, p[:3]), "3 measured poses for 4 labels"),
        (
            lambda p: whole_poses(p, p.translation),
            r"measured must be poses \(RigidTransform\), not ndarray",
        ),
        (
            lambda p: measured_positions(p, 2e3 + p.translation),
            "pose 1: measured must be finite, and within 1000 m",
        ),
        (
            lambda p: measured_positions(p, p.translation[:, :2]),
            r"positions \(N, 3\) in m, not of shape \(4, 2\)",
        ),
        (lambda p: measured_positions(p, "here"), "finite numbers in m, not 'here'"),
        (lambda p: whole_poses(p, p, noise=(5e-6, 2e-5)), "must be a Noise or None"),
        (lambda p: Noise("5 um", 1.0), "must be one finite number, not '5 um'"),
        (lambda p: Noise(1e-300, 1.0), "between 1e-15 and 1000"),
    ],
)
def test_measurements_that_are_none(make, told):
    with pytest.raises(MotionError, match=told):
        make(draw_commands(np.random.default_rng(0), 4))
