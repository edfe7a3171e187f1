"""Paths of every made-up shape can be sent to another process, and are the same there."""

import pickle

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from planner import Blend, Free, Line, Program, Spline
from planner.path.actuation import actuate
from planner.path.shape import DEGREE

FIRST, THEN = Line((0.0, 0.0, 0.004), join=Blend(1e-4)), Line((0.004, 0.0, 0.004))
TOOL = RigidTransform.from_translation([0.0, 0.0, 0.04])
PROGRAMS = {  # by a part of the shape's name
    "blend": Program((FIRST, THEN)),
    "by_tool": Program((Line((0.0, 0.0, 0.004)), THEN), tool=TOOL),
    "even": Program(
        (Spline(((0.001, 0.0, 0.002), (0.003, 0.001, 0.004)), speed=0.002, speed_constant=True),)
    ),
    "freed": Program(
        (Line((0.002, 0.0, 0.0), free=Free(yaw=True, controls=np.full((3, DEGREE + 1), 0.01))),)
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_they_come_back_as_they_were(name, hexapod):
    path = actuate(PROGRAMS[name], hexapod)
    assert any(name in piece.shape.name for piece in path.pieces)
    sent = pickle.loads(pickle.dumps(path))
    piece = np.repeat(np.arange(len(path.pieces)), 5)
    s = (path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * np.linspace(0, 1, 5)).ravel()
    for mine, theirs in zip(path.derivatives(s, piece), sent.derivatives(s, piece), strict=True):
        np.testing.assert_array_equal(mine, theirs)
