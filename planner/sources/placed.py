"""Where the coordinates of a file lie in the program's frame, as an option says it."""

from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.errors import MotionError
from kinematics.pose import Pose
from kinematics.units import quantity

UNITS = ("m", "m", "m", "rad", "rad", "rad")


def placed(text: str) -> Pose:
    """The frame of "0 mm, 0 mm, 25 mm" or "0 mm, 0 mm, 25 mm, 90 deg, 0 deg, 0 deg": moved, then turned θx, θy, θz.

    Rotations are about the moving axes in turn, Rx · Ry · Rz. Raises MotionError for anything else.
    """
    parts = text.split(",")
    if len(parts) not in (3, 6):
        raise MotionError(
            f'origin "{text[:80]}": {len(parts)} entries; write x, y, z with units as "0 mm, 0 mm, 25 mm", and '
            "θx, θy, θz after them where it is turned"
        )
    values = [quantity(part, unit) for part, unit in zip(parts, UNITS, strict=False)]
    return RigidTransform.from_components(values[:3], Rotation.from_euler("XYZ", values[3:] or [0.0, 0.0, 0.0]))
