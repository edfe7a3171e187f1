"""The tripod: three arms that move a plate without turning it."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite, frozen
from kinematics.clearance import Disc
from kinematics.legs import Legged, joints
from kinematics.pose import Pose


class Tripod(Legged):
    """Three arms; the plate keeps the orientation that it has at home.

    base, platform  (3, 3) joint centres in the frames of base and plate, m
    tool            (3,) the tool's centre in the plate's frame, m: poses are those of the tool
    Everything else as `Legged` has it; a tripod that hangs has rest axes that point down. Source: [KMITL 2005].
    """

    legs = 3
    sorts = ("linear",) * 3
    freedom = ("x", "y", "z")

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        tool: ArrayLike = (0.0, 0.0, 0.0),
        platform_disc: Disc | None = None,
        **options: Any,
    ) -> None:
        machine = options.get("name") or "tripod"
        self.tool: Array = frozen(finite(tool, f"machine {machine}: tool", (3,), unit="m"))
        if isinstance(platform_disc, Disc):
            platform_disc = replace(platform_disc, centre=np.asarray(platform_disc.centre) - self.tool)
        plate = joints(machine, "platform", platform, self.legs) - self.tool
        super().__init__(base, plate, platform_disc=platform_disc, **options)

    def arm_lengths(self, pose: Pose) -> Array:
        """‖p + R a − b‖ of each arm at any pose of the tool, turned or not: (N, 3) m, or (3,).

        A simulation, as [KMITL 2005] has it: three arms cannot hold a plate that is turned, so `inverse` refuses to.
        """
        joints = self.platform @ np.swapaxes(pose.rotation.as_matrix(), -1, -2) + pose.translation[..., None, :]
        return np.asarray(np.linalg.norm(joints - self.base, axis=-1))
