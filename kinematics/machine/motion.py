"""A motion at N instants: of the axes and of the platform, either from the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.short_repr import short_repr
from kinematics.machine.kind import columns, describe_pose
from kinematics.machine.model import MachineModel, scaled_jacobian, square_jacobian
from kinematics.machine.pose import to_numbers

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

# Condition of the Jacobian (turns at the characteristic length) above which coordinates no longer
# tell the motion.
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
    """Poses of the platform at N instants, following coordinates included, and axis coordinates q,
    q̇, q̈ (N, n).

    twist         (N, 6) velocity of the platform's origin (m/s) and angular velocity (rad/s), in
                  the base frame
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
    """(N, n, n) the Jacobian's columns of what the machine controls.

    Raises MotionError at a singular pose.
    """
    jacobian = square_jacobian(machine, x, q)
    broken = is_singular(machine, jacobian)
    if broken.any():
        first = int(np.argmax(broken))
        lost = describe_singularity(machine, scaled_jacobian(machine, x[[first]], q[[first]])[0])
        raise MotionError(
            f"machine {machine.name} is singular at {describe_pose(x, first)}: {lost}; keep away from it"
        )
    return jacobian


def is_singular(machine: MachineModel, jacobian: Array) -> np.ndarray:
    """(N,) whether square Jacobians (N, n, n) tell nothing of some motion."""
    scale = np.where(columns(machine) < 3, 1.0, 1.0 / machine.characteristic_length)
    finite = np.asarray(np.isfinite(jacobian).all((1, 2)))  # of others there is no condition
    with np.errstate(all="ignore"):
        condition = np.linalg.cond(np.where(finite[:, None, None], jacobian * scale, 0.0))
    return np.asarray(~(finite & (condition < MAX_CONDITION)))


def describe_singularity(machine: MachineModel, jacobian: Array) -> str:
    """What is lost in a pose of scaled Jacobian (n, n) that is singular, or nearly.

    J = ∂q/∂x. Where σ_min → 0, a motion of the platform moves no axis; where σ_max → ∞, some motion
    of the tool is beyond the axes. Both are measured against home. Source: Gosselin, Angeles, IEEE
    Trans. Robotics 6 (1990) 281-290.
    """
    home, here = (
        np.linalg.svd(each, compute_uv=False)
        if np.isfinite(each).all()
        else np.array([np.inf, 0.0])
        for each in (
            scaled_jacobian(machine, to_numbers(machine.home), machine.home_q[None])[0],
            jacobian,
        )
    )
    with np.errstate(divide="ignore"):
        cannot_move = here[0] / home[0] > home[-1] / here[-1] or not np.isfinite(here[0])
    if cannot_move:
        return (
            "no motion of the axes moves the tool in some direction, as where an arm is stretched or folded, or at the "
            "pole of an axis that turns"
        )
    return "the actuators do not constrain the platform, so that forces and errors have no bound"
