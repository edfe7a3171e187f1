"""Orientation left free: the choice keeps the tool's way, the cone and the ends; it makes paths
feasible, or fast.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, MotionError, load_machine
from planner import (
    Arc,
    Blend,
    Free,
    Infeasible,
    Line,
    Program,
    Spline,
    Through,
    check,
    load_program,
    orient,
    plan,
)
from planner.path.actuation import actuate
from planner.path.shape import DEGREE


@pytest.fixture
def few_intervals(monkeypatch):
    """A coarser grid, on which a choice takes a third of the time."""
    monkeypatch.setattr("planner.orientation.nlp.INTERVALS", 16)


@pytest.fixture(scope="module")
def reach():
    return load_program("free-yaw")


@pytest.fixture(scope="module")
def fastest(reach, hexapod):
    """Its plan, which chooses first."""
    return plan(reach, hexapod, order=2)


@pytest.fixture(scope="module")
def chosen(fastest):
    return fastest.program


def poses(program, machine, count=301):
    """Along the whole path: s, positions (N, 3), rotations."""
    path = actuate(program, machine)
    s = np.linspace(0, path.breaks[-1], count)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.breaks) - 2)
    x = path.pose_numbers(s, piece)
    return s, x[:, :3], Rotation.from_matrix(x[:, 3:].reshape(-1, 3, 3))


def held(program):
    return replace(
        program, segments=tuple(replace(segment, free=None) for segment in program.segments)
    )


def test_a_reach_that_needs_the_turn(reach, fastest, hexapod, limit_search):
    """With the platform straight it leaves the travel; turned, every limit is proved."""
    limit_search(0.0)
    worst = check(held(reach), hexapod).violations[0]
    assert isinstance(worst, Infeasible)
    assert worst.kind == "travel"
    assert fastest.certificate.holds


def test_only_the_turn_about_the_tool_is_used(reach, chosen, hexapod):
    """Positions stay, to rounding; the platform turns about z alone, and begins as the program
    says.
    """
    (_, straight, _), (_, turned, rotation) = poses(held(reach), hexapod), poses(chosen, hexapod)
    assert np.abs(straight - turned).max() < 1e-15
    vector = rotation.as_rotvec()
    assert np.abs(vector[:, :2]).max() < 1e-14
    assert np.abs(vector[0]).max() < 1e-15
    assert np.abs(vector[:, 2]).max() > np.deg2rad(2)


def test_time_is_what_is_chosen_for(reach, fastest, hexapod):
    """Faster than what is only feasible, and than what tilts least; and less tilted than either, if
    that is asked.
    """
    others = {objective: orient(reach, hexapod, objective) for objective in ("feasible", "tilt")}
    took = {name: plan(program, hexapod, order=2) for name, program in others.items()}
    for other in took.values():
        assert fastest.trajectory.duration < 0.95 * other.trajectory.duration
    assert took["tilt"].certificate.worst["tilt"] <= fastest.certificate.worst["tilt"]
    assert (
        took["tilt"].certificate.worst["tilt"] <= took["feasible"].certificate.worst["tilt"] + 1e-6
    )


@pytest.mark.usefixtures("few_intervals")
def test_a_cone_is_never_left(hexapod):
    """The tool's axis leans by at most the cone, at every instant; the tool's point goes where it
    went.
    """
    tool = RigidTransform.from_components([0.01, 0, 0.04], Rotation.from_euler("X", 0.1))
    through = (
        np.array([[0.02, 0.01, 0.03], [0.03, -0.01, 0.028], [0.01, -0.02, 0.03]]) + tool.translation
    )
    segments = [Spline(through, free=Free(yaw=False, tilt=np.deg2rad(3)))]
    program = Program(segments, tool=tool)
    made = orient(program, hexapod, "tilt")
    (_, _, before), (_, place, after) = poses(held(program), hexapod), poses(made, hexapod)
    _, straight, _ = poses(held(program), hexapod)
    axis = tool.rotation.as_matrix()[:, 2]
    lean = np.arccos(np.clip((before.apply(axis) * after.apply(axis)).sum(1), -1, 1))
    assert lean.max() <= np.deg2rad(3) * (1 + 1e-9)
    assert lean.max() > np.deg2rad(1)  # the freedom is used
    tip = [
        rotation.apply(tool.translation) + at
        for rotation, at in ((before, straight), (after, place))
    ]
    assert np.abs(tip[0] - tip[1]).max() < 1e-15


@pytest.mark.usefixtures("few_intervals")
def test_free_segments_give_the_orientation_back(hexapod):
    """Before a segment that is not free, and at the end of each repetition, it is the program's
    own.
    """
    out, back = Line([0.03, 0, 0.03], free=Free()), Line([0, 0, 0.03])
    program = Program([out, back], start=RigidTransform.from_translation([0, 0, 0.03]))
    s, _, rotation = poses(orient(program, hexapod, order=2), hexapod)
    assert rotation.magnitude()[s >= 0.03].max() < 1e-14
    again = Program([out, replace(back, free=Free())], start=program.start, repeat=2)
    made = orient(again, hexapod, order=2)
    assert np.abs(made.segments[1].free.controls[:, DEGREE]).max() < 1e-9
    assert (
        np.abs(
            made.segments[0].free.controls[:, DEGREE] - made.segments[1].free.controls[:, 0]
        ).max()
        < 1e-9
    )


def test_what_a_machine_does_not_control_cannot_be_free(reach, hexapod):
    with pytest.raises(
        MotionError, match=r"segment 2 leaves free what machine tripod does not control: rz"
    ):
        orient(reach, load_machine("tripod"))
    with pytest.raises(
        MotionError, match='objective is "fast"; expected "time" or "tilt" or "feasible"'
    ):
        orient(reach, hexapod, "fast")


@pytest.mark.parametrize(
    ("said", "phrase"),
    [({"tilt": -0.1}, "tilt -0.1"), ({"tilt": 1.6}, "right angle"), ({"yaw": False}, "omit free")],
)
def test_freedom_that_is_none(said, phrase):
    with pytest.raises(MotionError, match=phrase):
        Free(**said)


def test_free_in_a_file(tmp_path):
    text = 'schema = 1\nlength = "mm"\nangle = "deg"\n'
    path = tmp_path / "p.toml"
    for said, yaw, tilt in (
        ('"yaw"', True, 0.0),
        ("{ tilt = 5 }", False, np.deg2rad(5)),
        ('{ yaw = true, tilt = "0.1 rad" }', True, 0.1),
    ):
        path.write_text(f"{text}[[segment]]\nline = {{ to = [1, 2, 3] }}\nfree = {said}\n")
        free = load_program(path).segments[0].free
        assert (free.yaw, free.tilt) == (yaw, pytest.approx(tilt))
    for said in ('"roll"', "{ tilt = -1 }", "{ jaw = true }", "true"):
        path.write_text(f"{text}[[segment]]\nline = {{ to = [1, 2, 3] }}\nfree = {said}\n")
        with pytest.raises(MotionError, match=r"p\.toml:6: segment\[1\]\.free"):
            load_program(path)


@pytest.mark.usefixtures("few_intervals")
def test_limits_that_differ_by_direction_are_no_hindrance(hexapod):
    axes = [
        replace(axis, max_speed=(0.015, 0.02), max_acceleration=(0.2, 0.3)) for axis in hexapod.axes
    ]
    machine = Hexapod(
        hexapod.base, hexapod.platform, axes=axes, home=hexapod.home, max_tilt=np.deg2rad(35)
    )
    made = plan(Program([Line([0, 0, 0.03]), Line([0.01, 0, 0.03], free=Free())]), machine, order=2)
    assert made.certificate.holds


@pytest.mark.usefixtures("few_intervals")
def test_what_turns_out_slower_than_as_the_program_says_is_not_taken(hexapod, monkeypatch):
    """Stretch by stretch: an estimate that wriggles is dropped, one that is faster beside it, after
    a rest, is kept.
    """
    better = plan_turn(hexapod)

    def wriggling(machine, parts, joints, objective, start):
        wild = np.zeros_like(start)
        wild[:, 2, 2:6] = [0.2, -0.2, 0.2, -0.2]
        return wild if len(parts) == 2 else better

    monkeypatch.setattr("planner.orientation.orient.solve_controls", wriggling)
    blend = Blend(5e-4)
    free = [
        Line([0.006, 0.002, 0.03], free=Free(), join=blend),
        Line([0.008, 0.004, 0.03], free=Free(), join=blend),
    ]
    back = [Line([0, 0, 0.03]), Line([0.035, 0.02, 0.03], free=Free())]
    program = Program([*free, *back], start=RigidTransform.from_translation([0, 0, 0.03]))
    made = orient(program, hexapod, order=2)
    assert not made.segments[0].free.controls.any()
    assert not made.segments[1].free.controls.any()
    assert (made.segments[3].free.controls == better[0]).all()
    one, other = (plan(each, hexapod, order=2) for each in (made, held(program)))
    assert one.certificate.holds
    assert one.trajectory.duration < other.trajectory.duration


def plan_turn(machine):
    """What really is faster for one line."""
    line = Program(
        [Line([0.035, 0.02, 0.03], free=Free())],
        start=RigidTransform.from_translation([0, 0, 0.03]),
    )
    return np.array([orient(line, machine, order=2).segments[0].free.controls])


def test_through_a_passage_it_turns_smoothly(hexapod):
    """Line, arc: without a stop between them as without the turn, and faster."""
    start = RigidTransform.from_translation([0, 0, 0.025])
    segments = [
        Line([0.01, 0, 0.025], free=Free(), join=Through()),
        Arc([0.01, 0.005, 0.025], [0, 0, 1], np.pi / 2, free=Free()),
    ]
    program = Program(segments, start=start)
    made = orient(program, hexapod, order=2)
    free, straight = (plan(each, hexapod, order=2) for each in (made, held(program)))
    assert free.path.stops(2).sum() == 2
    assert free.trajectory.duration < 0.99 * straight.trajectory.duration
    before, after = (segment.free.controls for segment in made.segments)
    slopes = (
        (before[2, -1] - before[2, -2]) / 0.01,
        (after[2, 1] - after[2, 0]) / (0.005 * np.pi / 2),
    )
    assert slopes[0] == pytest.approx(slopes[1], abs=1e-12)


@pytest.mark.usefixtures("few_intervals")
def test_a_small_cone_is_a_cone_too(hexapod):
    """0.5 mrad: the choice uses it all, and no more."""
    lean, start = 5e-4, RigidTransform.from_translation([0, 0, 0.03])
    program = Program([Line([0.02, 0, 0.03], free=Free(yaw=False, tilt=lean))], start=start)
    alpha, beta, _ = orient(program, hexapod, "tilt").segments[0].free.controls
    assert 0.9 * lean < np.hypot(alpha, beta).max() <= lean
