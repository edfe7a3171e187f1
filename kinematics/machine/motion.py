"""A motion at N instants: of the axes and of the platform, either from the other."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array, finite_array, freeze_fields
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.options import check_arguments
from kinematics.foundation.short_repr import short_repr
from kinematics.machine.kind import columns
from kinematics.machine.model import MachineModel, square_jacobian
from kinematics.machine.pose import COMPONENTS, Pose, PoseLike, from_numbers, to_numbers

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


@check_arguments()
def motion_of_poses(
    machine: MachineModel,
    pose: PoseLike,
    twist: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    near: ArrayLike | None = None,
) -> Motion:
    """The motion of given poses, twists (N, 6) and accelerations (N, 6); default: at rest.

    What follows is filled in, whatever is given for it. Raises OutOfReach where a pose has no coordinates, MotionError
    where a twist leaves the machine's freedom. near as in `Machine.inverse`.
    """
    pose = machine.read_pose(pose)
    q = np.atleast_2d(machine.inverse(pose, near))
    held = [k for k, name in enumerate(COMPONENTS) if name not in machine.freedom + machine.follows]
    given = []
    for what, values in (("twist", twist), ("acceleration", acceleration)):
        shape = (len(q), 6)
        values = np.zeros(6) if values is None else values
        rows = np.broadcast_to(finite_array(values, f"machine {machine.name}: {what}", shape, (6,), (1, 6)), shape)
        if rows[:, held].any():
            instant, k = np.argwhere(rows[:, held])[0]
            raise OutOfReach(
                f"machine {machine.name} holds {COMPONENTS[held[k]]}: the {what} at instant {instant} has "
                f"{rows[instant, held[k]]:.6g} of it; it moves {', '.join(machine.freedom)} only"
            )
        given.append(rows)
    return _complete_motion(machine, to_numbers(pose), q, *given)


@check_arguments("state")
def motion_of_axes(machine: MachineModel, state: AxesAndPose) -> Motion:
    """The motion of the platform from that of the axes: J ν = q̇ and J ν̇ = q̈ − J̇ ν, solved for what is controlled.

    Raises MotionError where the machine is singular, so that the axes do not tell the motion.
    """
    if not all(hasattr(state, name) for name in ("pose", "q", "qd", "qdd")):
        raise MotionError(f"{type(state).__name__} is not a motion; motion_of_poses makes one from poses")
    if state.pose is None:
        raise MotionError("forces need a pose; this motion has no machine")
    free, n, x = columns(machine), len(machine.axes), to_numbers(state.pose)
    q, qd, qdd = (np.atleast_2d(np.asarray(each, float)) for each in (state.q, state.qd, state.qdd))
    for what, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
        if rows.shape != (len(x), n) or not np.isfinite(rows).all():
            raise MotionError(
                f"machine {machine.name} has {n} axes: {what} must be finite, ({len(x)}, {n}) for {len(x)} poses, "
                f"not {rows.shape}"
            )
    inputs = machine.inputs(x, q)
    jacobian = controlled_jacobian(machine, x, q)
    twist, acceleration = np.zeros((2, len(q), 6))
    twist[:, free] = np.linalg.solve(jacobian, qd[:, :, None])[:, :, 0]
    bias = machine.rates_map(np.concatenate([inputs, twist, acceleration], 1))[:, n : 2 * n]
    acceleration[:, free] = np.linalg.solve(jacobian, (qdd - bias)[:, :, None])[:, :, 0]
    return _complete_motion(machine, x, q, twist, acceleration)


def controlled_jacobian(machine: MachineModel, x: Array, q: Array) -> Array:
    """(N, n, n) the Jacobian's columns of what the machine controls. Raises MotionError at a singular pose."""
    jacobian = square_jacobian(machine, x, q)
    broken = is_singular(machine, jacobian)
    if broken.any():
        first = int(np.argmax(broken))
        raise MotionError(
            f"machine {machine.name} is singular at pose {first}, position {x[first, :3] * 1e3} mm: its axes do not "
            "hold the platform there, so that forces and errors have no bound; keep away from it"
        )
    return jacobian


def is_singular(machine: MachineModel, jacobian: Array) -> np.ndarray:
    """(N,) whether square Jacobians (N, n, n) tell nothing of some motion."""
    scale = np.where(columns(machine) < 3, 1.0, 1.0 / machine.characteristic_length)
    with np.errstate(all="ignore"):
        return np.asarray(~(np.linalg.cond(jacobian * scale) < MAX_CONDITION))


def _complete_motion(machine: MachineModel, x: Array, q: Array, twist: Array, acceleration: Array) -> Motion:
    n, inputs = len(machine.axes), machine.inputs(x, q)
    out = machine.rates_map(np.concatenate([inputs, twist, acceleration], 1))
    qd, qdd, twist, acceleration = np.split(out, [n, 2 * n, 2 * n + 6], 1)
    pose = from_numbers(machine.carried_map(inputs) if machine.follows else x)
    return Motion(pose, q, qd, qdd, twist, acceleration)
