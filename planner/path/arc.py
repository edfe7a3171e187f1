"""Circular arcs in any plane, by any signed angle, and helices: arcs that rise along their normal."""

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array, frozen
from kinematics.pose import Pose, axis_angle, turned
from planner.path.shape import Piece, Shape


def _motion(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """p = c + u cos(ks) + v sin(ks) + h s, R = R0 exp(s · rate · axis×).

    u is the start's radius vector, v = normal × u, k the angle and h (along the normal) the rise by path length.
    """
    centre, u, v, angle_rate, rise_rate, r0, axis, rate = ca.vertsplit(parameters, [0, 3, 6, 9, 10, 13, 22, 25, 26])
    turn = angle_rate * s
    position = centre + u * ca.cos(turn) + v * ca.sin(turn) + rise_rate * s
    return position, turned(ca.reshape(r0, 3, 3).T, axis, rate * s)


ARC = Shape("arc", 26, _motion)


def arc(
    start: Pose,
    centre: Array,
    normal: Array,
    angle: float,
    end_rotation: Rotation,
    segment: int,
    rise: float = 0.0,
) -> Piece:
    """The arc from start about `centre` by the signed angle, right hand about the unit normal, to `end_rotation`.

    rise (m, along the normal) makes it a helix, of length √((radius · angle)² + rise²).
    """
    centre = centre + ((start.translation - centre) @ normal) * normal  # in the start's own plane, to the last digit
    u = start.translation - centre
    length = float(np.hypot(np.linalg.norm(u) * angle, rise))
    axis, turn = axis_angle(start.rotation, end_rotation)
    numbers = [
        centre,
        u,
        np.cross(normal, u),
        [angle / length],
        normal * (rise / length),
        start.rotation.as_matrix().ravel(),
        axis[0],
        turn / length,
    ]
    whole = abs(angle) + float(turn[0])
    return Piece(ARC, frozen(np.concatenate(numbers)), length, segment, turn=whole)
