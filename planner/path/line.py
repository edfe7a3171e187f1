"""Straight lines, and turns on the spot: both straight motions, each with its own meaning of path length."""

import numpy as np

from kinematics.array import Array, frozen
from kinematics.pose import STRAIGHT, Pose, axis_angle, numbers, straight, straight_numbers
from planner.path.shape import Piece, Shape

LINE = Shape("line", STRAIGHT, straight)


def line(start: Pose, end: Pose, length: float, segment: int) -> Piece:
    """The straight motion from start to end over a length, turning the shorter way in proportion to the path."""
    turn = turn_angle(start, end)
    return Piece(LINE, frozen(straight_numbers(start, end, length)[0]), length, segment, turn=turn)


def turn_angle(start: Pose, end: Pose) -> float:
    """Angle of the shorter turn from start to end, rad."""
    return float(axis_angle(start.rotation, end.rotation)[1][0])


def turn(start: Pose, axis: Array, angle: float, characteristic: float, segment: int) -> Piece:
    """On the spot about a unit axis of the moving frame, by a signed angle; `characteristic` m of path for a radian."""
    place, rows = np.split(numbers(start)[0], [3])
    rate = np.sign(angle) / characteristic
    length = abs(angle) * characteristic
    return Piece(
        LINE, frozen(np.concatenate([place, np.zeros(3), rows, axis, [rate]])), length, segment, turn=abs(angle)
    )
