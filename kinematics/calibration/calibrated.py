"""The machine with the parameters that were found."""

from copy import copy
from dataclasses import replace

import numpy as np

from kinematics.array import Array, frozen
from kinematics.axis import Axis
from kinematics.calibration.prediction import Prediction
from kinematics.errors import MotionError
from kinematics.hexapod import Hexapod
from kinematics.machine import Machine
from kinematics.pose import Pose, from_numbers, numbers

ROOM = ("leg_radius", "leg_ends", "base_disc", "platform_disc")
"""What a hexapod says of the room that its parts take."""


def calibrated(prediction: Prediction, theta: Array) -> Machine:
    """The machine of a full vector (k,): pulse · factor, joints, and as home the pose that it takes at zero counts.

    Offsets need no place of their own: home_q = q(home) of that pose is the nominal q_home + offset. The measuring
    frame is no part of the machine. Raises MotionError where there is no pose at zero counts.
    """
    machine, vector = prediction.machine, prediction.vector
    for axis, factor in zip(machine.axes, theta[vector.factors()], strict=True):
        if factor <= 0:
            raise MotionError(
                f"machine {machine.name}: the measurements ask for a factor of {factor:.6g} on the pulse of "
                f"{axis.name}, which must be above 0; check units and signs of the file"
            )
    axes = [
        replace(axis, pulse=axis.pulse * float(factor))
        for axis, factor in zip(machine.axes, theta[vector.factors()], strict=True)
    ]
    offsets, joints = theta[vector.offsets()], theta[vector.joints()]
    home = machine.home
    if offsets.any() or (joints != vector.nominal[vector.joints()]).any():
        x = prediction.poses(theta, np.zeros((1, len(axes))), numbers(home))
        if not np.isfinite(x).all():
            raise MotionError(f"machine {machine.name}: with the parameters found it has no pose at zero counts")
        home = from_numbers(x[0])
    if isinstance(machine, Hexapod):
        return _hexapod(machine, joints.reshape(2, 6, 3), axes, home)
    moved = copy(machine)
    moved.name, moved.axes, moved.home = f"{machine.name}-calibrated", tuple(axes), home
    moved.home_q = frozen(machine.home_q + offsets)
    return moved


def _hexapod(machine: Hexapod, joints: Array, axes: list[Axis], home: Pose) -> Hexapod:
    return Hexapod(
        joints[0],
        joints[1],
        axes=axes,
        home=home,
        base_rest=machine.base_rest,
        platform_rest=machine.platform_rest,
        max_tilt=(float(machine.max_tilt[0]), float(machine.max_tilt[6])),
        name=f"{machine.name}-calibrated",
        load=machine.load,
        **({} if machine.bodies is None else {key: getattr(machine.bodies, key) for key in ROOM}),
    )
