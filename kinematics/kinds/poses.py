"""Tables of poses and points that several kinds' files share."""

from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.pose import Pose
from kinematics.schema import Table
from kinematics.units import Angle, Length

Point = tuple[Length, Length, Length]


class Home(Table):
    """The pose from which travel and pulses count: a position, turned by θx, θy, θz about the moving axes in turn.

    to      the platform's origin in the base frame
    rotate  θx, θy, θz about the moving axes in turn
    """

    to: Point
    rotate: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return RigidTransform.from_components(self.to, Rotation.from_euler("XYZ", self.rotate))
