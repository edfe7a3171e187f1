"""The program model: values are checked where they are made."""

import dataclasses
import math
from itertools import repeat

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics import MotionError
from planner import Arc, Blend, Dwell, Line, Program, Stop, Turn
from planner.program.model import SegmentStream


def test_segments_stop_by_default_and_are_read_only():
    for segment in (Line([1, 2, 3]), Arc([0, 0, 0], [0, 0, 1], 1.0), Turn(Rotation.identity())):
        assert segment.join == Stop()
        with pytest.raises(dataclasses.FrozenInstanceError):
            segment.join = Blend(1e-3)
    with pytest.raises(ValueError, match="read-only"):
        Line([1, 2, 3]).to[0] = 5


def test_a_segment_keeps_no_hold_of_its_arguments():
    point = np.array([1.0, 2.0, 3.0])
    line = Line(point)
    point[0] = 9.0
    assert line.to[0] == 1.0


@pytest.mark.parametrize(
    "normal", [[0, 0, 5], [0, 0, 1e-300], [0, 0, 1e300], [3e-320, 4e-320, 0], [3e307, 4e307, 0]]
)
def test_an_arc_s_normal_becomes_a_unit_vector(normal):
    unit = Arc([0, 0, 0], normal, 1.0).normal
    # subnormal components carry only three digits, the unit vector stays one all the same
    assert np.linalg.norm(unit) == pytest.approx(1.0, abs=4e-16)
    assert (np.sign(unit) == np.sign(normal)).all()


@pytest.mark.parametrize(
    ("make", "phrase"),
    [
        (lambda: Line([1, 2]), "three finite numbers"),
        (lambda: Line([1, 2, math.nan]), "three finite numbers"),
        (lambda: Line("abc"), "three finite numbers"),
        (lambda: Line([1, 2, 3], speed=0.0), "speed 0.0 m/s must be positive"),
        (lambda: Line([1, 2, 3], speed=math.inf), "speed inf m/s"),
        (lambda: Arc([0, 0, math.inf], [0, 0, 1], 1.0), "centre"),
        (lambda: Arc([0, 0, 0], [0, 0, 0], 1.0), "normal is zero"),
        (lambda: Arc([0, 0, 0], [0, 0, 1], 0.0), "angle 0.0 rad"),
        (lambda: Arc([0, 0, 0], [0, 0, 1], math.nan), "angle nan rad"),
        (lambda: Arc([0, 0, 0], [0, 0, 1], 1.0, speed=-1.0), "speed -1.0 m/s"),
        (lambda: Dwell(0.0), "duration 0.0 s"),
        (lambda: Dwell(math.nan), "duration nan s"),
        (lambda: Blend(0.0), "tolerance 0.0 m"),
        (lambda: Blend(1e-3, 0.0), "angle 0.0 rad"),
        (lambda: Arc([0, 0, 0], [0, 0, 1], 1.0, rise=math.inf), "rise inf m"),
        (lambda: Program(()), "is empty"),
        (
            lambda: Program((Dwell(1.0),), frame="tool"),
            'frame is "tool"; expected "home" or "base"',
        ),
    ],
)
def test_nonsense_is_refused_with_its_name(make, phrase):
    with pytest.raises(MotionError) as refusal:
        make()
    assert phrase in str(refusal.value)


@given(
    st.lists(
        st.floats(-1e9, 1e9).filter(lambda x: x == 0 or abs(x) > 1e-9), min_size=3, max_size=3
    ).filter(any)
)
def test_a_normal_that_was_brought_to_length_one_stays_as_it_is(normal):
    once = Arc([0, 0, 1], normal, 1.0).normal
    assert np.linalg.norm(once) == pytest.approx(1.0, abs=1e-15)
    assert Arc([0, 0, 1], once, 1.0).normal.tolist() == once.tolist()
    assert Arc([0, 0, 1], [0, -0.6, 0.8], 1.0).normal.tolist() == [0, -0.6, 0.8]


def test_a_stream_may_be_of_any_length_and_what_is_held_may_not() -> None:
    """A file that is read anew takes no memory for its segments."""
    line = Line([1e-3, 0, 0])
    stream = SegmentStream(lambda: repeat(line, 3_000_000), 3_000_000)
    assert len(Program(stream).segments) == 3_000_000
    with pytest.raises(MotionError, match="repeat 2 of 3000000 segments is more than 1000000"):
        Program(SegmentStream(lambda: iter(()), 3_000_000), repeat=2)
