"""Circular arcs in any plane, by any signed angle."""

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array, frozen
from kinematics.pose import Pose, axis_angle, turned
from planner.path.shape import Piece, Shape


def _motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p = c + u cos(κs) + v sin(κs), R = R0 exp(s · rate · axis×); u is the start's radius vector, v = normal × u."""
    centre, u, v, curvature, r0, axis, rate = ca.vertsplit(parameters, [0, 3, 6, 9, 10, 19, 22, 23])
    position = centre + u * ca.cos(curvature * s) + v * ca.sin(curvature * s)
    return position, turned(ca.reshape(r0, 3, 3).T, axis, rate * s)


ARC = Shape("arc", 23, _motion)


def arc(
    start: Pose,
    centre: Array,
    normal: Array,
    angle: float,
    end_rotation: Rotation,
    segment: int,
) -> Piece:
    """The arc from start about `centre` by the signed angle, right hand about the unit normal, to `end_rotation`."""
    centre = centre + ((start.translation - centre) @ normal) * normal  # in the start's own plane, to the last digit
    u = start.translation - centre
    radius = float(np.linalg.norm(u))
    length = radius * abs(angle)
    axis, turn = axis_angle(start.rotation, end_rotation)
    numbers = [
        centre,
        u,
        np.cross(normal, u),
        [np.sign(angle) / radius],
        start.rotation.as_matrix().ravel(),
        axis[0],
        turn / length,
    ]
    whole = abs(angle) + float(turn[0])
    return Piece(ARC, frozen(np.concatenate(numbers)), length, segment, turn=whole)
