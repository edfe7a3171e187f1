"""Straight lines, and turns on the spot: both straight motions, each with its own meaning of path length."""

from kinematics.array import frozen
from kinematics.pose import STRAIGHT, Pose, axis_angle, straight, straight_numbers
from planner.path.shape import Piece, Shape

LINE = Shape("line", STRAIGHT, straight)


def line(start: Pose, end: Pose, length: float, segment: int) -> Piece:
    """The straight motion from start to end over a length, turning the shorter way in proportion to the path."""
    turn = turn_angle(start, end)
    return Piece(LINE, frozen(straight_numbers(start, end, length)[0]), length, segment, turn=turn)


def turn_angle(start: Pose, end: Pose) -> float:
    """Angle of the shorter turn from start to end, rad."""
    return float(axis_angle(start.rotation, end.rotation)[1][0])
