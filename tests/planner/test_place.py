"""Errors carry the number of the segment that they are about."""

import pickle

import pytest
from scipy.spatial.transform import Rotation

import planner
from kinematics import MotionError, load_machine
from kinematics.foundation.errors import BadValue, NotFree, locate_errors
from planner import Line, Program, Turn
from planner.place import Infeasible, Place

NEAR, NEARER, FAR = (0.0, 0.0, 0.02), (0.0, 0.0, 0.01), (0.0, 0.0, 9.0)


def test_an_infeasible_motion_is_about_the_segment_of_its_place():
    place = Place(0.1, segment=3)
    error = Infeasible("speed", "leg1", place, 2.0, 1.0, "m/s", "go slower")
    assert error.segment == 3
    assert error.add_advice(lambda: "or shrink the path").segment == 3
    assert Infeasible("duration", "", None, 2.0, 1.0, "s", "wait").segment is None


def test_a_path_out_of_reach_is_about_the_segment_that_leaves(limit_search):
    limit_search(0.0)
    program = Program((Line(NEAR), Line(NEARER), Line(FAR)))
    violations = planner.check(program, "hexapod").violations
    assert violations
    assert violations[0].segment == 3
    assert pickle.loads(pickle.dumps(violations[0])).segment == 3


@pytest.mark.parametrize(
    ("program", "segment"),
    [
        (Program((Line(NEAR), Line(NEAR))), 2),
        (Program((Line(NEAR), Line(NEARER, speed=0.01)), end_speed=0.02), 2),
    ],
)
def test_a_segment_that_cannot_be_drawn_is_named(program, segment):
    with pytest.raises(MotionError) as caught:
        planner.check(program, load_machine("hexapod"))
    assert f"segment {segment}" in str(caught.value)
    assert caught.value.segment == segment


def test_a_pose_that_the_machine_does_not_move_to_is_about_its_segment():
    program = Program((Line(NEAR), Turn(Rotation.from_euler("x", 5, degrees=True))))
    with pytest.raises(NotFree, match="segment 2 has rx") as caught:
        planner.check(program, "tripod")
    assert caught.value.segment == 2
    assert pickle.loads(pickle.dumps(caught.value)).pose == caught.value.pose


@pytest.mark.parametrize("kind", [MotionError, BadValue])
def test_an_error_told_with_its_place_keeps_its_segment(kind):
    with pytest.raises(kind, match=r"^option --speed: ") as caught, locate_errors("option --speed"):
        raise kind("too fast").in_segment(4)
    assert caught.value.segment == 4
