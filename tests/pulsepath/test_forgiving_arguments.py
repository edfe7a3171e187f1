"""What a notebook may write: names, paths and objects alike, and poses and rotations as lists of
numbers.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

import pulsepath as pp

UP = [0, 0, 0.01]
LIFT = pp.Program([pp.Line(UP)])


@pytest.fixture(scope="module")
def hexapod():
    return pp.load_machine("hexapod")


@pytest.fixture(scope="module")
def files(hexapod, tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    hexapod.save(folder / "own.toml")
    LIFT.save(folder / "lift.toml")
    return folder


def test_names_paths_and_objects_lead_to_the_same_plan(hexapod, files):
    wanted = pp.plan(LIFT, hexapod, order=2).duration
    for program in (files / "lift.toml", str(files / "lift.toml"), LIFT):
        for machine in ("hexapod", files / "own.toml", hexapod):
            planned = pp.plan(program, machine, order=2)
            assert planned.duration == pytest.approx(wanted, rel=1e-12)


def test_objects_stay_as_they_are(hexapod):
    assert pp.load_machine(hexapod) is hexapod
    assert pp.load_program(LIFT) is LIFT
    rig, measured = pp.load_rig("servo-rig"), pp.load_measurements("cmm")
    assert pp.load_rig(rig) is rig
    assert pp.load_measurements(measured) is measured
    assert pp.plan(LIFT, hexapod).machine is hexapod


def test_all_that_takes_a_machine_takes_its_name(hexapod):
    place = hexapod.home
    assert not pp.check(LIFT, "hexapod").violations
    assert pp.orient(LIFT, "hexapod") is LIFT
    assert [part.standing.duration for part in pp.plan_parts(LIFT, "hexapod")]
    assert pp.plan_many([LIFT], "hexapod")[0].certificate.holds
    assert pp.posture_of_pose("hexapod", place).q == pytest.approx(
        pp.posture_of_pose(hexapod, place).q
    )
    assert pp.posture_of_axes("hexapod", hexapod.home_q).q == pytest.approx(hexapod.home_q)
    assert pp.joint_need("hexapod", place) == pp.joint_need(hexapod, place)
    assert pp.workspace("hexapod", x=0, y=0, cells=4).machine.name == "hexapod"
    budgets = [pp.error_budget(one, place, [pp.Quantization()]) for one in ("hexapod", hexapod)]
    np.testing.assert_array_equal(*(budget.total.covariance for budget in budgets))


def test_tracking_takes_names_of_machine_law_and_rig(hexapod):
    plan = pp.plan(LIFT, hexapod, order=2)
    named = pp.track(plan, "hexapod", "6", rig="hexapod-steppers", period=1e-2)
    made = pp.track(plan, hexapod, pp.find_law("6"), period=1e-2)
    np.testing.assert_array_equal(named.actual, made.actual)
    assert (
        pp.evaluate(named, plan, "hexapod").contour.max
        == pp.evaluate(made, plan, hexapod).contour.max
    )


def test_what_is_no_plan_or_law_is_refused(hexapod):
    with pytest.raises(pp.MotionError, match="a plan or its trajectory is needed, not 'circle'"):
        pp.track("circle", hexapod, "6")
    with pytest.raises(
        pp.MotionError, match="a law is needed, or its number or name as a text, not 6"
    ):
        pp.track(LIFT, hexapod, 6)


@pytest.mark.parametrize(
    ("program", "machine", "told"),
    [
        ("circel", "hexapod", 'no program is called "circel", nearest is "circle"'),
        ("circle", "hexpod", 'no machine is called "hexpod", nearest is "hexapod"'),
        (
            "nowhere/circle.toml",
            "hexapod",
            "nowhere/circle.toml: No such file or directory: there is no folder",
        ),
        ("circle", "own.toml", "own.toml: No such file or directory"),
        (
            "circle",
            Path("hexapod"),
            'no such file: hexapod; the bundled machine is given as a text, "hexapod"',
        ),
        (
            3,
            "hexapod",
            "a program is given by its name or the path of a file, or as it is, not as 3",
        ),
        (
            "circle",
            LIFT,
            "a machine is given by its name or the path of a file, or as it is, not as",
        ),
        (None, "hexapod", "not as None"),
    ],
)
def test_what_is_not_there_is_refused_by_what_it_is(program, machine, told, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(pp.MotionError) as no:
        pp.plan(program, machine)
    assert told in str(no.value)


def test_numbers_are_poses_with_the_angles_of_files(hexapod):
    """Rx · Ry · Rz, by SciPy's own three rotations."""
    numbers = [0.01, -0.02, 0.25, 0.02, -0.05, 0.03]
    turned = (
        Rotation.from_rotvec([0.02, 0, 0])
        * Rotation.from_rotvec([0, -0.05, 0])
        * Rotation.from_rotvec([0, 0, 0.03])
    )
    pose = RigidTransform.from_components(numbers[:3], turned)
    q = hexapod.inverse(pose)
    np.testing.assert_allclose(hexapod.inverse(numbers), q, rtol=0, atol=1e-15)
    np.testing.assert_allclose(hexapod.inverse([numbers, numbers]), [q, q], rtol=0, atol=1e-15)
    np.testing.assert_allclose(
        hexapod.jacobian(tuple(numbers)), hexapod.jacobian(pose), rtol=0, atol=1e-14
    )
    assert hexapod.check(numbers).ok.all()
    level = RigidTransform.from_translation(numbers[:3])
    np.testing.assert_allclose(
        hexapod.inverse(np.array(numbers[:3])), hexapod.inverse(level), rtol=0, atol=1e-15
    )


def test_programs_and_machines_take_lists(hexapod):
    program = pp.Program(
        [
            pp.Line(UP, rotate=[0.02, 0, 0]),
            pp.Turn([0, 0.03, 0]),
            pp.Spline([[0, 0.01, 0.01], [0.01, 0.01, 0.01]], rotate=np.zeros((2, 3))),
        ],
        start=[0, 0, 0.005],
        tool=[0, 0, 0.002, 0, 0, 0],
        work=(0.0, 0.0, 0.01),
    )
    line, turn, spline = program.segments
    np.testing.assert_allclose(line.rotate.as_rotvec(), [0.02, 0, 0], atol=1e-16)
    np.testing.assert_allclose(turn.to.as_rotvec(), [0, 0.03, 0], atol=1e-16)
    assert len(spline.rotate) == 2
    np.testing.assert_allclose(program.start.translation, [0, 0, 0.005])
    assert program.tool.rotation.magnitude() == 0
    assert pp.plan(program, hexapod).certificate.holds
    own = pp.Hexapod(
        hexapod.base, hexapod.platform, axes=hexapod.axes, home=list(hexapod.home.translation)
    )
    np.testing.assert_allclose(own.home_q, hexapod.home_q, atol=1e-15)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: pp.Line([0, 0]), "line: to must be three finite numbers, not [0, 0]"),
        (lambda: pp.Line([[0, 0, 1]]), "line: to must be three finite numbers"),
        (lambda: pp.Line("up"), "line: to must be three finite numbers, not 'up'"),
        (lambda: pp.Line(UP, rotate=[0, 1]), "rotate must be a rotation: a scipy Rotation, or three finite angles"),
        (lambda: pp.Line(UP, rotate=[[0, 0, 1]]), "line: rotate must be a rotation"),
        (lambda: pp.Line(UP, rotate=Rotation.identity(2)), "line: rotate must be one rotation, not 2"),
        (lambda: pp.Arc(UP, [0, 0, 1], 1.0, rotate="up"), "arc: rotate must be a rotation"),
        (lambda: pp.Arc(UP, [0, 1], 1.0), "arc: normal must be three finite numbers, not [0, 1]"),
        (lambda: pp.Turn([0, 0, np.nan]), "turn: to must be a rotation"),
        (lambda: pp.Spline([UP], rotate=[0, 0, 1]), "rotate must be a rotation: a scipy Rotation, or 1 rows of"),
        (lambda: pp.Synchronised(UP, rotate=3), "synchronised: rotate must be a rotation"),
        (lambda: pp.Program([pp.Line(UP)], start=[0, 0]), "program: start must be a pose: a scipy RigidTransform, or"),
        (lambda: pp.Program([pp.Line(UP)], tool="pen"), "program: tool must be a pose"),
        (lambda: pp.Program([pp.Line(UP)], work=[UP, UP]), "program: work must be one pose, not 2"),
        (lambda: pp.load_machine("hexapod").inverse([0, 0, 0, 1]), "machine hexapod: pose must be a pose"),
        (lambda: pp.load_machine("hexapod").inverse([0, 0, np.inf]), "machine hexapod: pose must be finite"),
        (lambda: pp.load_machine("hexapod").check(None), "machine hexapod: pose must be a pose"),
        (lambda: pp.load_machine("hexapod").inverse([]), "machine hexapod: pose must be a pose"),
    ],
)  # fmt: skip
def test_wrong_numbers_are_refused_with_what_is_wanted(make, told):
    with pytest.raises(pp.MotionError) as no:
        make()
    assert told in str(no.value)
