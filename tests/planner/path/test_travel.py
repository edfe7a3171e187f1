"""The way along a path, where its parameter is another: against closed forms and sums of chords."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics import load_machine
from planner import Arc, Blend, Line, Program, Spline, Turn
from planner.path.actuation import actuate
from planner.path.arc_length import measure_travel

SQUARE = [Line([0.02, 0, 0.02]), Line([0.02, 0.02, 0.02]), Line([0, 0.02, 0.02])]


def path_of(segments, join=None):
    segments = segments if join is None else [replace(each, join=join) for each in segments]
    return actuate(Program([Line([0, 0, 0.02]), *segments]), load_machine("hexapod"))


def sum_chords(path):
    """m, of many short chords: what is left is of the second order in their length."""
    total = 0.0
    for piece in path.pieces:
        places = piece.poses(piece.start + np.linspace(0.0, piece.length, 2001))[:, :3]
        total += float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    return total


def test_lines_and_arcs_count_their_own_length():
    path = path_of([Line([0.01, 0, 0.02]), Arc([0, 0, 0.02], [0, 0, 1], np.pi)])
    assert measure_travel(path.pieces) == pytest.approx(0.02 + 0.01 + np.pi * 0.01, rel=1e-12)


@pytest.mark.parametrize("tolerance", [0.05e-3, 1e-3])
def test_a_blend_shortens_the_way(tolerance):
    path = path_of(SQUARE, Blend(tolerance))
    way = measure_travel(path.pieces)
    assert path.breaks[-1] == pytest.approx(0.08, rel=1e-12)
    assert way == pytest.approx(sum_chords(path), rel=1e-6)
    # of each of two right angles at least as much as a straight cut as far from the corner leaves:
    # 2 (√2 − 1) τ
    assert way < 0.08 - 2 * 2 * (np.sqrt(2) - 1) * tolerance


def test_a_spline_is_longer_than_its_chords():
    path = path_of([Spline([[0.01, 0.005, 0.02], [0.02, 0, 0.02]])])
    assert measure_travel(path.pieces) == pytest.approx(sum_chords(path), rel=1e-6)
    assert measure_travel(path.pieces) > path.breaks[-1]


def test_a_turn_in_place_counts_as_its_parameter_does():
    path = path_of([Turn(Rotation.from_euler("z", 5, degrees=True))])
    assert measure_travel(path.pieces) == pytest.approx(path.breaks[-1], rel=1e-12)
