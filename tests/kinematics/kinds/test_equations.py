"""Machines of formulas: the bundled ones, against geometry worked out otherwise, and as plans."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import FileError, MotionError, OutOfReach, load_machine
from kinematics.analysis.posture import posture_of_pose
from kinematics.analysis.workspace import workspace
from kinematics.kinds.equations import Equations
from kinematics.machine.machine_writer import machine_toml
from kinematics.machine.model import place_skeleton
from kinematics.machine.pose import COMPONENTS, from_numbers, to_numbers
from planner import Arc, Curve, Line, Program, Turn, plan

PRESETS = Path(__file__).parents[3] / "kinematics" / "presets"
OF_FORMULAS = (
    "cartesian",
    "gantry",
    "corexy",
    "delta",
    "delta-rotary",
    "scara",
    "hexapod-rotary",
    "hexaglide",
    "five-axis",
)


@pytest.fixture(scope="module", params=OF_FORMULAS)
def machine(request):
    return load_machine(request.param)


def move(machine, twists):
    """Home's pose moved by (N, 6) of position and rotation vector, in what the machine controls."""
    free = [name in machine.freedom for name in COMPONENTS]
    kept = np.asarray(twists) * free
    turned = Rotation.from_rotvec(kept[:, 3:]) * machine.home.rotation
    poses = RigidTransform.from_components(machine.home.translation + kept[:, :3], turned)
    if not machine.follows:
        return poses
    inputs = machine.inputs(to_numbers(poses), machine.inverse(poses))
    return from_numbers(machine.carried_map(inputs))  # with what follows filled in


def test_forward_of_inverse_is_the_pose_certified(machine):
    poses = move(
        machine, np.random.default_rng(0).uniform(-1, 1, (20, 6)) * ([0.01] * 3 + [0.05] * 3)
    )
    found = machine.forward(machine.inverse(poses))
    assert found.certified.all()
    assert (
        np.abs(found.pose.as_matrix() - poses.as_matrix()).max() < 1e-9
    )  # Newton's residual at this conditioning


def test_the_jacobian_is_that_of_differences(machine):
    twists = np.random.default_rng(1).uniform(-1, 1, (5, 6)) * ([0.01] * 3 + [0.05] * 3)
    poses, step = move(machine, twists), 1e-6
    jacobian = machine.jacobian(poses)
    for k, name in enumerate(COMPONENTS):
        if name in machine.freedom:
            ways = [np.eye(6)[k] * size for size in (step, -step)]
            after, before = (
                machine.inverse(
                    RigidTransform.from_components(
                        poses.translation + way[:3], Rotation.from_rotvec(way[3:]) * poses.rotation
                    )
                )
                for way in ways
            )
            # central differences: step² of the third derivative, and rounding/step
            assert np.allclose(
                (after - before) / (2 * step), jacobian[:, :, k], rtol=1e-6, atol=1e-7
            )


@pytest.mark.parametrize("order", [2, 3])
def test_plans_are_certified_and_their_pulses_follow(machine, order):
    loop = Program(
        (Line([0.01, 0, 0.005]), Arc([0, 0, 0.005], [0, 0, 1], 2 * np.pi), Line([0, 0, 0]))
    )
    made = plan(loop, machine, order=order)
    assert made.certificate.holds
    assert max(made.certificate.worst.values()) <= 1 + 1e-9
    times = np.linspace(0, made.trajectory.duration, 200)
    state = made.trajectory.at(times)
    pulses = np.array([axis.pulse for axis in machine.axes])
    late = made.pulses.counts(times) * pulses - (state.q - machine.home_q)
    tick = np.abs(state.qd).max() / made.pulses.clock_hz
    assert (
        np.abs(late) <= pulses / 2 + tick + 1e-12
    ).all()  # the nearest count, and one tick's travel
    assert np.allclose(machine.inverse(state.pose), state.q, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "lengths"),
    [
        ("delta-rotary", (0.15, 0.32)),
        ("hexapod-rotary", (0.06, 0.2)),
        ("hexaglide", (0.35, 0.1)),
        ("scara", (0.2, 0.18)),
    ],
)
def test_drawn_links_keep_their_lengths(name, lengths):
    """The bars are worked out from the coordinates, the rods' ends from the pose: a wrong branch
    would stretch them.
    """
    machine = load_machine(name)
    poses = move(
        machine, np.random.default_rng(2).uniform(-1, 1, (10, 6)) * ([0.01] * 3 + [0.05] * 3)
    )
    bars = place_skeleton(machine, to_numbers(poses), machine.inverse(poses)).bars
    found = np.linalg.norm(bars[:, :, 1] - bars[:, :, 0], axis=2)
    each = found.reshape(len(found), len(machine.axes), -1)
    for k, length in enumerate(lengths):
        assert np.allclose(each[:, :, k], length, atol=1e-12)


def changed(tmp_path, name, old, new):
    text = (PRESETS / f"{name}.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "machine.toml").write_text(text.replace(old, new), encoding="utf-8")
    return tmp_path / "machine.toml"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("sqrt(", "root(", "there are sin, cos, tan"),
        ("sqrt(rod", "sqrt(rood", 'rood is not defined, nearest is "rod"'),
        ("z + sqrt", "z.real + sqrt", "functions: sin, cos"),
        ("z + sqrt", "__import__('os') + sqrt", "is not allowed in a formula"),
        ('"x", "y", "z"]\njoints', '"x", "y", "w"]\njoints', "components: x, y, z, rx, ry, rz"),
        ('moves = ["x", "y", "z"]', 'moves = ["x", "y"]', "3 axes and 2 formulas for 2 components"),
        ('rod = "250 mm"', 'rod = "250 kg"', "neither a number nor a length or an angle"),
        ('rod = "250 mm"', 'x = "250 mm", rod = "250 mm"', "has a meaning already"),
        (
            'angle = ["0 deg", "120 deg"',
            'angle = [[], "120 deg"',
            "[] is neither a number nor a length or an angle",
        ),
        ('angle = ["0 deg", "120 deg"', 'angle = [[0, 1], "120 deg"', "[0, 1] is neither a number"),
        (
            'angle = ["0 deg", "120 deg", "240 deg"]',
            "angle = [[0, 1, 2]]",
            "[0, 1, 2] is neither a number",
        ),
        ('angle = ["0 deg", "120 deg", "240 deg"]', "angle = []", "one or (3,), not of shape (0,)"),
        ("[axes]", '[[axis]]\nname = "a"\nmax_speed = "5 deg/s"\n[axes]', "slides"),
        ('rod = "250 mm"', 'rod = "100 mm"', "no actuator coordinates reach"),
    ],
)
def test_what_is_wrong_in_a_file_is_refused_by_name(tmp_path, old, new, told):
    with pytest.raises(FileError) as refusal:
        load_machine(changed(tmp_path, "delta", old, new))
    assert told in str(refusal.value)


def test_out_of_reach_and_singular_are_refused():
    """A SCARA reaches 380 mm; where its arm is straight, no speed of the tool along it has a finite
    speed of joints.
    """
    scara = load_machine("scara")
    with pytest.raises(OutOfReach, match="bring it nearer"):
        scara.inverse(RigidTransform.from_translation([0.381, 0, 0]))
    with pytest.raises(MotionError):
        plan(Program((Line([0.2, 0, 0]),)), scara)


def test_a_turning_axis_goes_on_past_half_a_turn():
    scara = load_machine("scara")
    turned = scara.home * RigidTransform.from_rotation(Rotation.from_euler("z", 2.0))
    near = scara.home_q + np.array([0, 0, 0, 2 * np.pi])
    assert scara.inverse(scara.home, near)[3] == pytest.approx(scara.home_q[3] + 2 * np.pi)
    assert scara.inverse(turned)[3] == pytest.approx(scara.home_q[3] + 2.0)


def test_a_bed_is_kept_where_the_belts_would_reach_farther():
    """x + y and x − y reach a diamond of 100 mm; the bed is a box in it, and an arc leaves it
    between its ends.
    """
    machine = load_machine("corexy")
    assert machine.inverse(RigidTransform.from_translation([0.09, 0, 0])).max() < 0.1
    with pytest.raises(MotionError, match=r"room 90 mm is (above|beyond) .*60 mm .*at x"):
        plan(Program((Line([0.09, 0, 0]),)), machine)
    bulge = Program(
        (Line([0.055, -0.03, 0]), Arc([0.04, 0, 0], [0, 0, 1], 2 * np.arctan2(0.03, 0.015)))
    )
    with pytest.raises(MotionError, match=r"room 73\.\d* mm .*60 mm .*at x"):
        plan(bulge, machine)
    made = plan(Program((Line([0.055, -0.03, 0]), Line([0.055, 0.03, 0]))), machine)
    assert made.certificate.worst["room"] == pytest.approx(55 / 60, rel=1e-9)
    assert made.certificate.where["room"].axis == "x"


def test_margins_the_workspace_and_postures_keep_to_the_bed():
    machine = load_machine("corexy")
    places = np.array([[0.03, -0.06, 0.02], [0.0, 0.0615, 0.02], [0.0, 0.0, -0.0115]])
    margins = machine.check(RigidTransform.from_translation(places))
    assert margins.ok.tolist() == [True, False, False]
    assert margins.names[-3:] == ("x room", "y room", "z room")
    assert margins.uses[:, -3:] == pytest.approx(
        np.abs(places - [0, 0, 0.02]) / [0.06, 0.06, 0.03], rel=1e-12
    )
    assert margins.worst() == "z room: 105.0% of its limit at pose 2"
    (told,) = posture_of_pose(machine, RigidTransform.from_translation(places[1])).violations
    assert told.startswith("y room: 61.5 mm, outside -60 to 60 mm")
    assert load_machine("traverser").check(machine.home).room_names == ()
    reach = workspace(machine, x=(-0.08, 0.08), y=(-0.03, 0.03), z=0.0, cells=16)
    assert np.array_equal(
        reach.reachable[:, 8, 0], np.abs(reach.nodes[0]) < 0.065
    )  # the belts reach on
    assert reach.contains([-0.06, -0.03, 0], [0.06, 0.03, 0])
    assert (
        "x room: 101.7% of its limit" in reach.contains([-0.061, -0.03, 0], [0.06, 0.03, 0]).reason
    )


def test_a_bed_is_written_back(tmp_path):
    machine = load_machine("corexy")
    (tmp_path / "again.toml").write_text(machine_toml(machine), encoding="utf-8")
    assert load_machine(tmp_path / "again.toml").room == machine.room


DOME = Curve(
    ("r*s*cos(t)", "r*s*sin(t)", "r*c"),
    0,
    2 * np.pi,
    rotate=("atan2(-s*sin(t), c)", "asin(s*cos(t))", "0"),
    constants=(("r", 0.03), ("s", 0.5), ("c", 0.75**0.5)),
)


def test_a_five_axis_table_holds_the_tool_upright_on_a_dome():
    """Where the slides hold the tool's tip, carried by the table that A tilts and C turns, is the
    point of the part.
    """
    machine = load_machine("five-axis")
    start = RigidTransform.from_components(
        [0.015, 0, 0.03 * 0.75**0.5], Rotation.from_euler("y", 30, degrees=True)
    )
    made = plan(Program((DOME,), start=start, frame="base"), machine)
    assert made.certificate.holds
    state = made.trajectory.at(np.linspace(0, made.trajectory.duration, 100))
    x, a, c = state.q[:, :3], state.q[:, 3], state.q[:, 4]
    tilted = Rotation.from_rotvec(np.outer(-a, [1, 0, 0]))
    tip = Rotation.from_rotvec(np.outer(-c, [0, 0, 1])).apply(tilted.apply(x))
    outwards = Rotation.from_rotvec(np.outer(-c, [0, 0, 1])).apply(tilted.apply([0, 0, 1]))
    assert np.allclose(np.linalg.norm(tip, axis=1), 0.03, atol=1e-12)
    assert np.allclose(outwards, tip / 0.03, atol=1e-9)
    assert np.ptp(c) == pytest.approx(2 * np.pi, rel=1e-9)  # C turns with the way, and never back
    assert np.ptp(x, axis=0).max() < 1e-9  # all that is left for the slides


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('follows = ["rz"]\n', "", "need each other"),
        ('follows = ["rz"]', 'follows = ["rx"]', "among moves and follows"),
        ('angle = "-C"', 'angle = "C"', "has other coordinates"),
        ('angle = "-C"', 'angle = "-B"', "B is not defined"),
        ('about = "z"', 'about = "w"', "about"),
    ],
)
def test_an_orientation_that_is_not_that_of_the_coordinates_is_refused(tmp_path, old, new, told):
    with pytest.raises(FileError) as refusal:
        load_machine(changed(tmp_path, "five-axis", old, new))
    assert told in str(refusal.value)


def test_a_five_axis_table_is_singular_where_the_tool_stands_along_its_turning_axis(tmp_path):
    machine = load_machine("five-axis")
    with pytest.raises(MotionError, match=r"singular|no actuator coordinates"):
        plan(Program((Turn(Rotation.from_euler("x", 30, degrees=True)),)), machine)


@pytest.mark.parametrize("complete", [False, True])
def test_what_is_written_is_the_same_machine(machine, tmp_path, complete):
    """Its axes, its places at poses about home, its skeleton; and the text of what is read back is
    the text.
    """
    file = tmp_path / f"{machine.name}.toml"
    file.write_text(machine_toml(machine, complete=complete), encoding="utf-8")
    again = load_machine(file)
    assert again.axes == machine.axes
    poses = move(
        machine, np.random.default_rng(2).uniform(-1, 1, (5, 6)) * ([0.01] * 3 + [0.05] * 3)
    )
    np.testing.assert_allclose(again.inverse(poses), machine.inverse(poses), rtol=1e-12, atol=1e-12)
    assert len(again.bars) == len(machine.bars)
    assert machine_toml(again, complete=complete) == file.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "room", [[(0, 1)], [(0, np.inf), (0, 1), (0, 1)], [(1, 0), (0, 1), (0, 1)], [(0, np.nan)] * 3]
)
def test_a_room_that_is_none_is_refused(room):
    machine = load_machine("corexy")
    with pytest.raises(MotionError, match=r"room .*from and to of x, y and z"):
        Equations(
            machine.freedom, machine.coordinates, axes=machine.axes, home=machine.home, room=room
        )
