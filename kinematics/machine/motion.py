"""A motion at N instants: of the axes and of the platform, either from the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.short_repr import short_repr
from kinematics.machine.kind import columns, describe_pose
from kinematics.machine.model import MachineModel, square_jacobian

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

# Condition of the Jacobian (turns at the characteristic length) above which coordinates no longer tell the motion.
MAX_CONDITION = 1e10


class AxesState(Protocol):
    """Anything that states axis coordinates q, q̇, q̈ (N, n) at N instants, in m or rad."""

    @property
    def q(self) -> Array: ...
    @property
    def qd(self) -> Array: ...
    @property
    def qdd(self) -> Array: ...


class AxesAndPose(AxesState, Protocol):
    """Anything that states the poses as well, such as what a trajectory is at times."""

    @property
    def pose(self) -> Pose | None: ...


@dataclass(frozen=True, slots=True)
class Motion:
    """Poses of the platform at N instants, following coordinates included, and axis coordinates q, q̇, q̈ (N, n).

    twist         (N, 6) velocity of the platform's origin (m/s) and angular velocity (rad/s), in the base frame
    acceleration  (N, 6) their rates
    """

    __repr__ = short_repr
    pose: Pose
    q: Array
    qd: Array
    qdd: Array
    twist: Array
    acceleration: Array

    def __post_init__(self) -> None:
        freeze_fields(self, "q", "qd", "qdd", "twist", "acceleration")

    def __len__(self) -> int:
        return len(self.q)


def controlled_jacobian(machine: MachineModel, x: Array, q: Array) -> Array:
    """(N, n, n) the Jacobian's columns of what the machine controls. Raises MotionError at a singular pose."""
    jacobian = square_jacobian(machine, x, q)
    broken = is_singular(machine, jacobian)
    if broken.any():
        first = int(np.argmax(broken))
        raise MotionError(
            f"machine {machine.name} is singular at {describe_pose(x, first)}: its axes do not "
            "hold the platform there, so that forces and errors have no bound; keep away from it"
        )
    return jacobian


def is_singular(machine: MachineModel, jacobian: Array) -> np.ndarray:
    """(N,) whether square Jacobians (N, n, n) tell nothing of some motion."""
    scale = np.where(columns(machine) < 3, 1.0, 1.0 / machine.characteristic_length)
    with np.errstate(all="ignore"):
        return np.asarray(~(np.linalg.cond(jacobian * scale) < MAX_CONDITION))
