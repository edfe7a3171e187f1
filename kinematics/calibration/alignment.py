"""Where the measuring frame may stand: a start for the fit, so that it may be turned by any angle."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array
from kinematics.calibration.measurements import POSITION, ROTATION, Measurements

FLAT = 1e-3
"""Second extent of a set of positions over its first, from which on they lie on a line and show no turn about it."""


def frame_start(measured: Measurements, used: np.ndarray, parts: Sequence[str]) -> Array:
    """The frame x, y, z, rx, ry, rz that carries commanded poses nearest to the measured ones; zero where none is free.

    Its turn is the mean of those between commanded and measured rotations, or where these were not measured the one
    between the positions about their centres [Kabsch 1976]; none where the positions lie on a line.
    """
    rows = np.flatnonzero(used[:, POSITION].all(1))
    if not {"frame", "frame-yaw"} & set(parts) or not len(rows):
        return np.zeros(6)
    commanded, seen = measured.commanded[rows], measured.measured[rows]
    turn = _turn(commanded.translation, seen.translation, yaw="frame-yaw" in parts)
    whole = np.flatnonzero(used[:, ROTATION].all(1))
    if len(whole) and "frame" in parts:
        turn = (measured.measured[whole].rotation * measured.commanded[whole].rotation.inv()).mean()
    shift = seen.translation.mean(0) - turn.apply(commanded.translation.mean(0))
    return np.concatenate([shift, turn.as_euler("XYZ")])


def _turn(commanded: Array, seen: Array, yaw: bool) -> Rotation:
    a, b = commanded - commanded.mean(0), seen - seen.mean(0)
    if yaw:
        across, along = np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a[:, :2] * b[:, :2])
        return Rotation.from_euler("z", np.arctan2(across, along))
    extents = np.linalg.svd(a, compute_uv=False)
    if len(extents) < 3 or extents[1] < FLAT * extents[0]:
        return Rotation.identity()
    return Rotation.align_vectors(b, a)[0]
