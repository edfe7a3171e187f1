"""From actuator coordinates to the pose: Newton on SE(3), and the proof that it is the pose the machine is in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.freedom import columns, refuse, square_jacobian
from kinematics.pose import Pose, from_numbers, numbers
from kinematics.regular import regular

if TYPE_CHECKING:
    from kinematics.machine import Machine

ITERATIONS = 50
CONVERGED = 1e-9
"""m or rad: residual under which a pose counts as a solution (Newton leaves 1e-16; the rest is for scale)."""
# Share of the coordinates at which Newton stops: some thirty units in the last place.
ROUNDING = 1e-14


@dataclass(frozen=True, slots=True)
class Forward:
    """pose; residual (N,) largest |inverse(pose) − q|; certified (N,) bool. Plain scalars for a single q.

    residual: infinite where the search ended in a pose that no coordinates reach.
    certified: inverse(pose) is q, and the straight motion from `near` to this pose meets no singularity, proved cell by
    cell over the whole motion: a machine that goes this way from `near` arrives in this pose and no other. False
    throughout where no proof was asked for.
    """

    pose: Pose
    residual: Array
    certified: np.ndarray


def solve(machine: Machine, q: Array, near: Pose, certify: bool = True) -> Forward:
    """Damped Newton in the twist of the platform, batched, then the certificate if it is asked for."""
    rows, start = np.atleast_2d(q), numbers(near)
    what = f"machine {machine.name}: forward takes"
    if rows.ndim != 2 or rows.shape[1] != len(machine.axes):
        raise MotionError(f"{what} finite coordinates (N, {len(machine.axes)}), not shape {q.shape}")
    if not np.isfinite(rows).all():
        row, axis = np.argwhere(~np.isfinite(rows))[0]
        raise MotionError(
            f"{what} finite coordinates (N, {len(machine.axes)}), "
            f"not {rows[row, axis]} {machine.axes[axis].unit} for {machine.axes[axis].name} in row {row}"
        )
    if len(start) not in (1, len(rows)) or not np.isfinite(start).all():
        raise MotionError(f"{what} one finite pose `near`, or one for each of {len(rows)} rows of q, not {len(start)}")
    refuse(machine, start)
    start = np.broadcast_to(start, (len(rows), 12))
    x = _newton(machine, rows, machine.start(rows, start).copy())
    if machine.follows:
        carried = machine.carried_map(machine.inputs(x, rows))
        x = np.where(np.isfinite(carried).all(1, keepdims=True), carried, x)
    pose = from_numbers(x)
    residual = np.abs(machine.inverse_map(machine.inputs(numbers(pose), rows)) - rows).max(1)
    residual[np.isnan(residual)] = np.inf  # Newton stayed where no coordinates reach
    certified = (residual < CONVERGED) & certify
    origin = near if len(numbers(near)) == 1 else near[certified]
    certified[certified] = regular(machine, origin, pose[certified], rows[certified])
    if q.ndim == 1:
        return Forward(pose[0], residual[0], certified[0])
    return Forward(pose, frozen(residual), frozen(certified))


def _newton(machine: Machine, q: Array, x: Array) -> Array:
    """x ← exp(δ) x with J δ = q − inverse(x), turning one radian at most; a step that gains nothing is quartered.

    δ moves what the machine controls; what is held or follows stays.
    """
    free = columns(machine)
    error = q - machine.inverse_map(machine.inputs(x, q))
    active, floor = np.arange(len(q)), max(1.0, np.abs(q).max(initial=0.0))
    damping = np.ones(len(q))
    for _ in range(ITERATIONS):
        size = np.abs(error[active]).max(1)
        # a hopeless damping ends the search
        active = active[(size > ROUNDING * floor) & (damping[active] > 1e-6)]
        if not len(active):
            break
        step = np.zeros((len(active), 6))
        step[:, free] = _solve(square_jacobian(machine, x[active], q[active]), error[active])
        turn = np.linalg.norm(step[:, 3:], axis=1)
        step *= (damping[active] / np.maximum(turn, 1.0))[:, None]
        trial = _moved(x[active], step)
        error_trial = q[active] - machine.inverse_map(machine.inputs(trial, q[active]))
        better = np.abs(error_trial).max(1) < np.abs(error[active]).max(1)
        won = active[better]
        x[won], error[won] = trial[better], error_trial[better]
        damping[won] = np.minimum(1.0, 2 * damping[won])
        lost = active[~better]
        damping[lost] /= 4
    return x


def _solve(jacobian: Array, error: Array) -> Array:
    try:
        return np.asarray(np.linalg.solve(jacobian, error[..., None])[..., 0], float)
    except np.linalg.LinAlgError:  # a pose of the batch is exactly singular
        return np.asarray((np.linalg.pinv(jacobian) @ error[..., None])[..., 0], float)


def _moved(x: Array, twist: Array) -> Array:
    turned = Rotation.from_rotvec(twist[:, 3:]).as_matrix() @ x[:, 3:].reshape(-1, 3, 3)
    return np.concatenate([x[:, :3] + twist[:, :3], turned.reshape(-1, 9)], 1)
