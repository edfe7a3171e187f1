"""Poses: SciPy's rigid transforms outside, twelve plain numbers inside compiled code.

The twelve numbers are the position (3) and the rotation matrix row by row (9), of the platform's
frame in the base frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array, freeze_array, numeric_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.rotations import find_vectors

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform, Rotation

    Pose = RigidTransform
else:

    def __getattr__(name: str) -> Any:
        """Pose, when it is first asked for: SciPy's rotations take longer to load than a machine's
        file to be read.
        """
        if name == "Pose":
            from scipy.spatial.transform import RigidTransform

            return RigidTransform
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


PoseLike: TypeAlias = "Pose | ArrayLike"
"""A pose, or the numbers of one or of many: see `read_pose`."""

# How far R Rᵀ may be from the identity, entry by entry: far above rounding, far below what a
# measurement sees.
ROTATION_TOLERANCE = 1e-9

# Numbers of a pose that is neither moved nor turned.
IDENTITY = freeze_array(np.concatenate([np.zeros(3), np.eye(3).ravel()]))

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
"""Of a pose, as files and messages call them."""


def make_pose(position: Array | Sequence[float], angles: Array | Sequence[float]) -> Pose:
    """The pose at a position (…, 3) m, turned by θx, θy, θz (…, 3) rad about the moving axes in
    turn.
    """
    from scipy.spatial.transform import RigidTransform, Rotation

    return RigidTransform.from_components(position, Rotation.from_euler("XYZ", angles))


def join_pose(position: Array, rotation: Rotation) -> Pose:
    """Return the pose (or poses) at a position, with a rotation."""
    from scipy.spatial.transform import RigidTransform

    return RigidTransform.from_components(position, rotation)


def read_pose(what: str, given: object) -> Pose:
    """A pose as it is, or made of numbers: x, y, z (m), or these and θx, θy, θz (rad), one row a
    pose.

    Angles are about the moving axes in turn, Rx · Ry · Rz, as in files; three numbers are not
    turned. Raises MotionError for anything else.
    """
    from scipy.spatial.transform import RigidTransform

    if isinstance(given, RigidTransform):
        return given
    numbers = numeric_array(given)
    if (
        numbers is None
        or numbers.ndim not in (1, 2)
        or numbers.shape[-1] not in (3, 6)
        or not numbers.size
    ):
        raise MotionError(
            f"{what} must be a pose: a scipy RigidTransform, or numbers x, y, z (m), or these and θx, θy, θz (rad), "
            f"not {given!r:.80}"
        )
    if not np.isfinite(numbers).all():
        raise OutOfReach(f"{what} must be finite, not {numbers.tolist()!s:.80}")
    angles = numbers[..., 3:] if numbers.shape[-1] == 6 else np.zeros_like(numbers)
    return make_pose(numbers[..., :3], angles)


def read_position(given: object) -> Array | None:
    """Return the position (3,) that the numbers of a pose which is not turned state; None for all
    else.

    Most machines have such a home: they are made without SciPy's rotations, which take longer to
    load than all else.
    """
    numbers = numeric_array(given) if isinstance(given, (tuple, list, np.ndarray)) else None
    if numbers is None or numbers.shape not in ((3,), (6,)):
        return None
    if not np.isfinite(numbers).all() or numbers[3:].any():
        return None
    return numbers[:3]


def read_rotation(what: str, given: object, *shape: int) -> Rotation:
    """A rotation as it is, or made of θx, θy, θz (…, 3) rad about the moving axes in turn; shape:
    of how many.

    Raises MotionError for anything else.
    """
    from scipy.spatial.transform import Rotation

    if isinstance(given, Rotation):
        return given
    angles = numeric_array(given)
    if angles is None or angles.shape != (*shape, 3) or not np.isfinite(angles).all():
        rows = f"{shape[0]} rows of " if shape else ""
        raise MotionError(
            f"{what} must be a rotation: a scipy Rotation, or {rows}three finite angles θx, θy, θz (rad), "
            f"not {given!r:.80}"
        )
    return Rotation.from_euler("XYZ", angles)


def check_pose(machine: str, what: str, pose: Pose, *, single: bool = False) -> Array:
    """(N, 12) numbers of the poses that a caller gives to a machine.

    Raises MotionError for what is not a single pose where one is wanted, and for rotations that are
    none: scaled, as from a quaternion that was not normalised, or mirrored; OutOfReach for a pose
    that is not finite.
    """
    if single and not pose.single:
        raise MotionError(
            f"machine {machine}: {what} must be one pose, not {len(pose)}; index the one that is meant"
        )
    x = to_numbers(pose)
    rows = x[:, 3:].reshape(-1, 3, 3)
    with np.errstate(invalid="ignore"):  # what is not finite
        off = np.abs(rows @ rows.swapaxes(1, 2) - np.eye(3)).max((1, 2), initial=0.0)
        wrong = ~((off < ROTATION_TOLERANCE) & (np.linalg.det(rows) > 0) & np.isfinite(x).all(1))
    if wrong.any():
        k = int(np.argmax(wrong))
        where = f"machine {machine}: {what}" if single else f"machine {machine}: {what} {k}"
        if not np.isfinite(x[k]).all():
            raise OutOfReach(
                f"{where} must be finite; its position is {x[k, :3]} m, its rotation {rows[k].tolist()}"
            )
        fault = (
            f"R Rᵀ is {off[k]:.3g} off the identity"
            if off[k] >= ROTATION_TOLERANCE
            else "it is mirrored, det R < 0"
        )
        raise MotionError(
            f"{where} has a rotation that is none: {fault}; normalise its quaternion or matrix"
        )
    return x


def to_numbers(pose: Pose) -> Array:
    """(N, 12) position and rotation rows of N poses (N = 1 for a single one).

    Raises MotionError for no pose.
    """
    from scipy.spatial.transform import RigidTransform

    if not isinstance(pose, RigidTransform):
        raise MotionError(f"a pose is a scipy RigidTransform, not {type(pose).__name__}")
    matrix = pose.as_matrix().reshape(-1, 4, 4)
    return np.concatenate([matrix[:, :3, 3], matrix[:, :3, :3].reshape(-1, 9)], 1)


def read_numbers(machine: str, what: str, given: object) -> Array:
    """Return the numbers (1, 12) of one pose that a caller gives to a machine.

    Raises as `read_pose` and `check_pose`.
    """
    position = read_position(given)
    if position is None:
        pose = read_pose(f"machine {machine}: {what}", given)
        return check_pose(machine, what, pose, single=True)
    return np.concatenate([position, np.eye(3).ravel()])[None]


def from_numbers(values: Array) -> Pose:
    """The poses of (N, 12) numbers, or of (12,) a single one."""
    from scipy.spatial.transform import RigidTransform, Rotation

    matrix = values[..., 3:].reshape(*values.shape[:-1], 3, 3)
    return RigidTransform.from_components(values[..., :3], Rotation.from_matrix(matrix))


def split_pose_symbols(x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position (3) and rotation (3, 3) of a column of twelve symbols."""
    return x[:3], ca.reshape(x[3:12], 3, 3).T


def column(position: ca.SX, rotation: ca.SX) -> ca.SX:
    """The column of twelve for a position and a rotation."""
    return ca.vertcat(position, ca.vec(rotation.T))


def rotate_about(rotation: ca.SX, axis: ca.SX, angle: ca.SX) -> ca.SX:
    """R · exp(angle · axis×) for a unit axis in the moving frame (Rodrigues)."""
    k = ca.skew(axis)
    return rotation @ (ca.SX.eye(3) + ca.sin(angle) * k + (1 - ca.cos(angle)) * (k @ k))


STRAIGHT_SIZE = 3 + 3 + 9 + 3 + 1
"""How many numbers describe a straight motion: start, direction, start rotation (rows), turning
axis, rate.
"""


def straight_pose(s: ca.SX, parameters: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Pose at s of p = p0 + d s, R = R0 exp(s · rate · axis×): the straight motion, turning
    steadily.
    """
    p0, direction, r0, axis, rate = ca.vertsplit(parameters, [0, 3, 6, 15, 18, 19])
    return p0 + direction * s, rotate_about(ca.reshape(r0, 3, 3).T, axis, rate * s)


def straight_parameters(start: Pose, end: Pose, length: Array | float) -> Array:
    """Parameters (N, 19) of the straight motions from start to end over s in [0, length], the
    shorter way round.
    """
    p0, p1 = np.atleast_2d(start.translation), np.atleast_2d(end.translation)
    axis, angle = axis_angle(start.rotation, end.rotation)
    length = np.broadcast_to(np.asarray(length, float), len(angle))
    first = np.broadcast_to(to_numbers(start)[:, 3:], (len(angle), 9))
    return np.concatenate(
        [
            np.broadcast_to(p0, p1.shape),
            (p1 - p0) / length[:, None],
            first,
            axis,
            (angle / length)[:, None],
        ],
        1,
    )


def straight_numbers(start: Array, end: Array) -> Array:
    """Return the parameters (N, 19) over s in [0, 1] for pose numbers (12) or (N, 12) of both
    ends.
    """
    start, end = np.broadcast_arrays(*np.atleast_2d(start, end))
    first, last = (x[:, 3:].reshape(-1, 3, 3) for x in (start, end))
    vector = find_vectors(first.swapaxes(1, 2) @ last)
    angle = np.linalg.norm(vector, axis=1)[:, None]
    axis = np.where(angle > 0, vector / np.where(angle > 0, angle, 1.0), [0.0, 0.0, 1.0])
    return np.concatenate([start[:, :3], end[:, :3] - start[:, :3], start[:, 3:], axis, angle], 1)


def axis_angle(start: Rotation, end: Rotation) -> tuple[Array, Array]:
    """Unit axis (N, 3) in the moving frame and angle (N,) ≤ π of the shortest turn; +z where there
    is none.
    """
    vector = np.atleast_2d((start.inv() * end).as_rotvec())
    angle = np.linalg.norm(vector, axis=1)
    return np.where(
        angle[:, None] > 0, vector / np.where(angle > 0, angle, 1.0)[:, None], [0.0, 0.0, 1.0]
    ), angle
