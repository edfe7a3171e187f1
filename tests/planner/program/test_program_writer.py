"""Written program files: read back, they are the same program."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError
from kinematics.files.plain_text import describe_control_character
from kinematics.foundation.arrays import MAX_DISTANCE
from planner import (
    Arc,
    Blend,
    Curve,
    Dwell,
    Free,
    Line,
    Program,
    Spline,
    Stop,
    Through,
    Trigger,
    Turn,
    load_program,
    program_names,
)
from planner.program.program_writer import program_toml

LAST = 4 * np.finfo(float).eps
"""A length is rounded once from mm to m; a turn through sines and cosines of angles of at most
pi.
"""


@pytest.fixture
def again(tmp_path):
    def read(program, comment=""):
        path = tmp_path / f"{program.name}.toml"
        path.write_text(program_toml(program, comment), encoding="utf-8")
        return load_program(path)

    return read


def same(a, b):
    """Fields one by one: arrays and floats to rounding, rotations by the angle between them."""
    if isinstance(a, Rotation):
        assert np.max((a.inv() * b).magnitude()) < 1e-14
    elif isinstance(a, RigidTransform):
        same(a.rotation, b.rotation)
        np.testing.assert_allclose(a.translation, b.translation, rtol=LAST)
    elif isinstance(a, np.ndarray | float):
        np.testing.assert_allclose(a, b, rtol=LAST, atol=1e-300)
    elif isinstance(a, tuple):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            same(one, other)
    elif hasattr(a, "__dataclass_fields__"):
        assert type(a) is type(b)
        for field in fields(a):
            if field.name not in ("line_number", "file"):  # where it was read from
                same(getattr(a, field.name), getattr(b, field.name))
    else:
        assert a == b


@pytest.mark.parametrize("name", program_names())
def test_bundled_programs_come_back(name, again):
    program = load_program(name)
    same(program, again(program))


lengths = st.floats(-10, 10).filter(lambda x: x == 0 or abs(x) > 1e-300)
points = st.tuples(lengths, lengths, lengths)
turns = st.tuples(*[st.floats(-3, 3)] * 3).map(lambda angles: Rotation.from_euler("XYZ", angles))
positive = st.floats(1e-6, 1e6)
tolerances = st.floats(1e-6, MAX_DISTANCE)
joins = st.one_of(
    st.just(Stop()),
    st.just(Through()),
    st.builds(Blend, tolerances),
    st.builds(Blend, tolerances, st.floats(1e-6, 1)),
)
letters = st.characters(exclude_categories=["Cs"]).filter(
    lambda letter: describe_control_character(letter) is None
)
names = st.text(letters, min_size=1)
triggers = st.none() | st.builds(Trigger, names, st.floats(0, 1))
caps = {
    "acceleration": st.none() | positive,
    "angular_speed": st.none() | positive,
    "trigger": triggers,
}
frees = st.none() | st.builds(Free, st.just(True), st.floats(0, 1.5))
drawn = {**caps, "speed": st.none() | positive, "join": joins, "free": frees}
directions = points.filter(lambda p: np.linalg.norm(p) > 1e-3)
angles = st.floats(-20, 20).filter(lambda a: abs(a) > 1e-6)
segments = st.one_of(
    st.builds(Line, points, st.none() | turns, **drawn),
    st.builds(Arc, points, directions, angles, st.none() | turns, rise=lengths, **drawn),
    st.builds(lambda a, b, **said: Spline([a, np.add(b, 30)], **said), points, points, **drawn),
    st.builds(
        lambda bounds, rotate, constants, **said: Curve(
            ("a*cos(t)", "2**-t", "-1"), *bounds, rotate, constants=constants, length=1e-3, **said
        ),
        st.tuples(lengths, lengths).filter(lambda pair: pair[0] != pair[1]),
        st.none() | st.just(("0", "t/2", "a")),
        lengths.map(lambda a: (("a", a), ("b_1", 2.0))),
        **drawn,
    ),
    st.builds(
        lambda to, join, speed: Turn(to, join, angular_speed=speed),
        turns,
        joins,
        caps["angular_speed"],
    ),
    st.builds(lambda about, angle: Turn(about=about, angle=angle), directions, angles),
    st.builds(Dwell, positive),
)
poses = st.none() | st.builds(RigidTransform.from_components, points, turns)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, max_examples=60
)
@given(
    st.builds(
        Program,
        st.lists(segments, min_size=1, max_size=4),
        st.sampled_from(["home", "base"]),
        poses,
        st.none() | names,
        duration=st.none() | positive,
        speed=st.none() | positive,
        tool=poses,
        work=poses,
        repeat=st.integers(1, 9),
        start_speed=st.floats(0, 1),
    )
)
def test_any_program_comes_back(again, program):
    same(program, again(program))


@pytest.mark.parametrize("take", [Trigger, lambda name: Program([Dwell(1.0)], machine=name)])
@pytest.mark.parametrize("name", ["\x08", "a\x1b[31m", "a\rb", "\x9b2J", "\u202ea", "a\u2028"])
def test_a_name_that_no_file_may_hold_is_refused_where_it_is_given(name, take):
    with pytest.raises(
        MotionError,
        match=r"holds \\(r|x[0-9a-f]{2}|u[0-9a-f]{4}), which is no letter .*; take it out",
    ):
        take(name)


def test_a_comment_stays_one(again):
    """Also where it holds the ends of lines: what follows them is no key."""
    program = load_program("circle")
    same(program, again(program, 'from "a.nc"\nrepeat = 9\rspeed = 3\u2028duration = 1'))
