"""Overshoot of splines: the distance from the polygon against one found on its own, in `check`,
plans and warnings.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import load_machine
from planner import Blend, Line, Program, Spline, check, plan

START = RigidTransform.identity()
CARTESIAN = load_machine("cartesian")


def program(corners, *after, scale=1e-3, join=None):
    more = {} if join is None else {"join": join}
    return Program(
        [Spline(scale * np.array(corners, float), **more), *after], start=START, frame="home"
    )


def segment_distance(x, begin, end):
    chord = end - begin
    share = np.clip((x - begin) @ chord / (chord @ chord), 0, 1)
    return np.linalg.norm(x - begin - share[:, None] * chord, axis=1)


@pytest.mark.parametrize(
    "corners",
    [
        [[10, 0, 0], [10, 10, 0], [0, 10, 0]],
        [[1, 0.1, 0], [2, -0.1, 0], [3, 0.1, 0], [23, 0, 0], [43, 0, 0]],
    ],
)
def test_it_is_the_largest_distance_from_the_polygon(corners):
    standing = check(program(corners), CARTESIAN)
    (overshoot,) = standing.overshoots
    made = plan(program(corners), CARTESIAN, order=2)
    s = np.linspace(0, made.path.breaks[-1], 20001)
    piece = np.clip(
        np.searchsorted(made.path.breaks, s, side="right") - 1, 0, len(made.path.pieces) - 1
    )
    x = made.path.pose_numbers(s, piece)[:, :3] - CARTESIAN.home.translation
    points = np.concatenate([[[0, 0, 0]], 1e-3 * np.array(corners)])
    away = np.min([segment_distance(x, *ends) for ends in pairwise(points)], 0)
    assert overshoot.distance == pytest.approx(away.max(), rel=5e-3)  # both are sampled
    assert abs(overshoot.s - s[away.argmax()]) < 0.05 * made.path.breaks[-1]
    assert made.path.overshoots == standing.overshoots
    assert any(
        "straight lines through their points" in table.title
        for table in (*standing.tables(), *made.tables())
    )


def test_a_quarter_of_a_circle_in_one_span_is_not_warned_of():
    angles = np.radians([90, 180, 270, 360])
    quarters = 10 * np.stack([np.sin(angles), 1 - np.cos(angles), 0 * angles], 1)
    assert not check(program(quarters), CARTESIAN).warnings


def test_a_curve_far_off_beside_short_chords_is_warned_of_by_its_points():
    """A long chord after a corner of short ones: the curve needs room there."""
    corners = [[0.2, 0, 0], [0.2, 0.2, 0], [80, 0.2, 0]]
    (warning,) = check(program(corners), CARTESIAN).warnings
    assert "segment 1, spline: between points 2 and 3 the curve is up to" in warning
    assert "shortest chord nearby, 0.2 mm; add points" in warning


def test_places_count_along_the_whole_path():
    """A line before the spline, and a blend that takes its beginning."""
    moves = [
        Line([0.02, 0, 0], join=Blend(1e-4)),
        Spline(1e-3 * np.array([[20.0, 10, 0], [10, 20, 0], [0, 20, 0]])),
    ]
    (overshoot,) = check(Program(moves, start=START, frame="home"), CARTESIAN).overshoots
    assert overshoot.segment == 2
    assert 0.02 < overshoot.s < 0.06


def test_no_spline_has_none():
    standing = check(
        Program([Line([0.01, 0, 0], Rotation.identity())], start=START, frame="home"), CARTESIAN
    )
    assert standing.overshoots == ()
