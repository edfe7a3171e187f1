"""The motion of a machine's platform and axes together: from that of poses, or from that of the
axes.
"""

import numpy as np
from numpy.typing import ArrayLike

from kinematics.foundation.arrays import Array, finite_array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.machine.kind import controlled_twists
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.motion import AxesAndPose, Motion, controlled_jacobian
from kinematics.machine.pose import COMPONENTS, PoseLike, from_numbers, to_numbers


@check_arguments("machine", "pose")
def motion_of_poses(
    machine: MachineSource,
    pose: PoseLike,
    twist: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    near: ArrayLike | None = None,
) -> Motion:
    """The motion of given poses; at rest unless twists or accelerations are given.

    Components that follow are filled in, whatever is given for them.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    pose
        N poses in the base frame.
    twist, acceleration
        (N, 6): [m/s, rad/s] and [m/s², rad/s²] of the platform's origin in the base frame.
    near
        As of `Machine.inverse`.

    Returns
    -------
    Motion
        Poses and coordinates of the axes, with their derivatives.

    Raises
    ------
    OutOfReach
        A pose has no coordinates.
    MotionError
        A twist leaves the machine's freedom.
    """
    machine = load_machine(machine)
    pose = machine.read_pose(pose)
    q = np.atleast_2d(machine.inverse(pose, near))
    held = [k for k, name in enumerate(COMPONENTS) if name not in machine.freedom + machine.follows]
    given = []
    for what, values in (("twist", twist), ("acceleration", acceleration)):
        shape = (len(q), 6)
        values = np.zeros(6) if values is None else values
        rows = np.broadcast_to(
            finite_array(values, f"machine {machine.name}: {what}", shape, (6,), (1, 6)), shape
        )
        if rows[:, held].any():
            instant, k = np.argwhere(rows[:, held])[0]
            raise OutOfReach(
                f"machine {machine.name} holds {COMPONENTS[held[k]]}: the {what} at instant {instant} has "
                f"{rows[instant, held[k]]:.6g} of it; it moves {', '.join(machine.freedom)} only"
            )
        given.append(rows)
    return _complete_motion(machine, to_numbers(pose), q, *given)


@check_arguments("machine", "state")
def motion_of_axes(machine: MachineSource, state: AxesAndPose) -> Motion:
    """The motion of the platform from that of the axes: J ν = q̇ and J ν̇ = q̈ − J̇ ν, solved for
    what is controlled.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    state
        Poses, q, q̇ and q̈ of N instants, as `Trajectory.at` gives them.

    Returns
    -------
    Motion
        With twists and accelerations of the platform.

    Raises
    ------
    MotionError
        The machine is singular, so that the axes do not determine the motion.
    """
    machine = load_machine(machine)
    if not all(hasattr(state, name) for name in ("pose", "q", "qd", "qdd")):
        raise MotionError(
            f"{type(state).__name__} is not a motion; motion_of_poses makes one from poses"
        )
    if state.pose is None:
        raise MotionError("forces need a pose; this motion has no machine")
    n, x = len(machine.axes), to_numbers(state.pose)
    q, qd, qdd = (np.atleast_2d(np.asarray(each, float)) for each in (state.q, state.qd, state.qdd))
    for what, rows in (("q", q), ("qd", qd), ("qdd", qdd)):
        if rows.shape != (len(x), n) or not np.isfinite(rows).all():
            raise MotionError(
                f"machine {machine.name} has {count_noun(n, 'axis')}: {what} must be finite, "
                f"({len(x)}, {n}) for {count_noun(len(x), 'pose')}, "
                f"not {rows.shape}"
            )
    inputs = machine.inputs(x, q)
    jacobian = controlled_jacobian(machine, x, q)
    controlled = controlled_twists(machine, x)
    twist = (controlled @ np.linalg.solve(jacobian, qd[:, :, None]))[:, :, 0]
    still = np.zeros_like(twist)
    bias = machine.rates_map(np.concatenate([inputs, twist, still], 1))[:, n : 2 * n]
    acceleration = (controlled @ np.linalg.solve(jacobian, (qdd - bias)[:, :, None]))[:, :, 0]
    return _complete_motion(machine, x, q, twist, acceleration)


def _complete_motion(
    machine: Machine, x: Array, q: Array, twist: Array, acceleration: Array
) -> Motion:
    n, inputs = len(machine.axes), machine.inputs(x, q)
    out = machine.rates_map(np.concatenate([inputs, twist, acceleration], 1))
    qd, qdd, twist, acceleration = np.split(out, [n, 2 * n, 2 * n + 6], 1)
    pose = from_numbers(machine.carried_map(inputs) if machine.follows else x)
    return Motion(pose, q, qd, qdd, twist, acceleration)
