"""Poses as options and commands say them: "0 mm, 0 mm, 25 mm", and three angles after that where they are turned."""

from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.errors import MotionError
from kinematics.pose import Pose
from kinematics.units import quantity

UNITS = ("m", "m", "m", "rad", "rad", "rad")


def six(text: str, what: str = "origin") -> list[float]:
    """x, y, z (m), θx, θy, θz (rad, 0 where they are left out). Raises MotionError for anything else."""
    parts = text.split(",")
    if len(parts) not in (3, 6):
        raise MotionError(
            f'{what} "{text[:80]}": {len(parts)} entries; write x, y, z with units as "0 mm, 0 mm, 25 mm", and '
            "θx, θy, θz after them where it is turned"
        )
    return [quantity(part, unit) for part, unit in zip(parts, UNITS, strict=False)] + [0.0] * (6 - len(parts))


def placed(text: str) -> Pose:
    """The frame moved by x, y, z, then turned by θx, θy, θz about its moving axes in turn, Rx · Ry · Rz."""
    values = six(text)
    return RigidTransform.from_components(values[:3], Rotation.from_euler("XYZ", values[3:]))
