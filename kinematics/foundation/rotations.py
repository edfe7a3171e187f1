"""Rotation matrices (N, 3, 3) from rotation vectors and angles, and back, without SciPy.

SciPy's rotations are the type of poses, but loading them takes longer than finding one pose of a
machine. The functions below serve what computes with pose numbers alone.
"""

from math import cos, sin, sqrt

import numpy as np

from kinematics.foundation.arrays import Array

# Cosine of θy below which θx and θz turn about the same axis.
GIMBAL_LOCK = 1e-7


def make_matrices(vectors: Array) -> Array:
    """Return the rotations of vectors (N, 3): unit axis times angle (rad).

    exp(v×) = 1 + sin φ/φ v× + (1 − cos φ)/φ² (v×)², φ = ‖v‖ (Rodrigues).
    """
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = np.zeros((len(vectors), 3, 3))
    for k in range(3):
        first, second = (k + 1) % 3, (k + 2) % 3
        cross[:, second, first] = vectors[:, k]
        cross[:, first, second] = -vectors[:, k]
    # NumPy's sinc(x) is sin(πx)/(πx).
    linear = np.sinc(angle / np.pi)
    square = np.sinc(angle / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + linear * cross + square * (cross @ cross))


def find_vectors(matrices: Array) -> Array:
    """Return the vectors (N, 3) of rotations, of the shorter way round: angles up to π.

    The rows of 4 q qᵀ are multiples of the quaternion q = (x, y, z, w). The one with the largest
    diagonal entry is free of cancellation at every angle [Shepperd 1978].
    """
    m = matrices
    products = np.zeros((len(m), 4, 4))
    for k in range(3):
        first, second = (k + 1) % 3, (k + 2) % 3
        products[:, k, k] = 1 + m[:, k, k] - m[:, first, first] - m[:, second, second]
        products[:, first, second] = products[:, second, first] = (
            m[:, first, second] + m[:, second, first]
        )
        products[:, k, 3] = products[:, 3, k] = m[:, second, first] - m[:, first, second]
    products[:, 3, 3] = 1 + np.trace(m, axis1=1, axis2=2)
    row = np.einsum("nkk->nk", products).argmax(1)
    quaternion = products[np.arange(len(m)), row]
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    quaternion *= np.where(quaternion[:, 3:] < 0, -1.0, 1.0)
    size = np.linalg.norm(quaternion[:, :3], axis=1)
    angle = 2 * np.arctan2(size, quaternion[:, 3])
    scale = np.where(size > 0, angle / np.where(size > 0, size, 1.0), 2.0)
    return np.asarray(scale[:, None] * quaternion[:, :3])


def turn_axes(angles: Array) -> Array:
    """Return the rotations Rx·Ry·Rz of angles θx, θy, θz (N, 3) in rad about the moving axes in
    turn.
    """
    turns = [make_matrices(angles[:, k, None] * np.eye(3)[k]) for k in range(3)]
    return np.asarray(turns[0] @ turns[1] @ turns[2])


def find_angles(matrices: Array) -> Array:
    """Return θx, θy, θz (N, 3) in rad of rotations Rx·Ry·Rz. θz is 0 where only its sum with θx is
    defined.
    """
    m = matrices
    cosine = np.hypot(m[:, 0, 0], m[:, 0, 1])
    locked = cosine < GIMBAL_LOCK
    x = np.where(locked, np.arctan2(m[:, 2, 1], m[:, 1, 1]), np.arctan2(-m[:, 1, 2], m[:, 2, 2]))
    y = np.arctan2(m[:, 0, 2], cosine)
    z = np.where(locked, 0.0, np.arctan2(-m[:, 0, 1], m[:, 0, 0]))
    return np.stack([x, y, z], 1)


def turn_vector(point: Array, rotation: Array) -> Array:
    """Return a point (3,) turned by a rotation (3,), unit axis times angle.

    By a quaternion in SciPy's order of operations, to the same bits:
    `Rotation.from_rotvec(rotation) .apply(point)`. A path does not depend on whether it is drawn
    with SciPy or without.
    """
    a, b, c = rotation.tolist()
    angle = sqrt(a * a + b * b + c * c)
    square = angle * angle
    # a series near 0, where sin(angle/2)/angle has no value
    scale = 0.5 - square / 48 + square * square / 3840 if angle <= 1e-3 else sin(angle / 2) / angle
    x, y, z, w = scale * a, scale * b, scale * c, cos(angle / 2)
    matrix = np.array(
        [
            [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w],
        ]
    )
    return np.asarray(matrix @ point)
