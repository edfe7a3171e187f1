"""From actuator coordinates to the pose: Newton on SE(3), and the proof that it is the pose the machine is in."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.expression import Expression
from kinematics.freedom import columns, refuse
from kinematics.pose import STRAIGHT, Pose, column, from_numbers, numbers, straight, straight_numbers
from kinematics.series import Series

if TYPE_CHECKING:
    from kinematics.machine import Machine

ITERATIONS = 50
CONVERGED = 1e-9
"""m or rad: residual under which a pose counts as a solution (Newton leaves 1e-16; the rest is for scale)."""
# Share of the coordinates at which Newton stops: some thirty units in the last place.
ROUNDING = 1e-14
# Smallest step of the continuation, as a share of the motion from `near`; beyond it the motion counts as singular.
FINEST = 2.0**-12


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
    certified[certified] = regular(machine, from_numbers(start[certified]), pose[certified], rows[certified])
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
        step[:, free] = _solve(_jacobian(machine, x[active], q[active]), error[active])
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


@cache
def _motion() -> Expression:
    s, parameters = ca.SX.sym("s"), ca.SX.sym("parameters", STRAIGHT)
    return Expression("straight", ca.vertcat(s, parameters), column(*straight(s, parameters)))


def regular(machine: Machine, start: RigidTransform, end: RigidTransform, near: Array | None = None) -> np.ndarray:
    """(N,) bool: proved that the Jacobian is nonsingular along the whole straight motion from start to end.

    The Jacobian is that of what the machine controls, on the branch of the coordinates near (N, n), or home's.

    Where det J has other signs at the two ends, it vanishes between them. Any other motion is cut into cells. Over a
    cell with centre c, J = J_c + J_1 τ + J_2(τ) τ², |τ| ≤ 1, in guaranteed Taylor arithmetic. With C ≈ J_c⁻¹,
    ‖I − C J(τ)‖_∞ ≤ ‖|I − C J_c| + |C J_1| + |C| |J_2|‖_∞ < 1 proves J(τ) nonsingular for every τ. Cells that fail are
    halved, unless J_c itself is singular to rounding, which ends the search of its motion. Columns of rotation are
    scaled by the characteristic length.
    """
    parameters = straight_numbers(start, end, 1.0)
    near = np.broadcast_to(machine.home_q if near is None else near, (len(parameters), len(machine.axes)))
    with np.errstate(invalid="ignore"):  # out of reach: no sign, and nothing is proved
        first, last = (np.linalg.slogdet(_jacobian(machine, numbers(pose), near)).sign for pose in (start, end))
    proved = np.broadcast_to(first * last > 0, len(parameters)).copy()
    pending = np.flatnonzero(proved)
    low, width = np.zeros(len(pending)), np.ones(len(pending))
    while len(pending):
        fine, centre = _cells_regular(machine, parameters[pending], near[pending], low, width)
        hopeless = ~centre | ~fine & (width <= FINEST)
        proved[pending[hopeless]] = False
        again = ~fine & ~hopeless & proved[pending]
        half = width[again] / 2
        low, width = np.concatenate([low[again], low[again] + half]), np.concatenate([half, half])
        pending = np.concatenate([pending[again], pending[again]])
    return proved


def _jacobian(machine: Machine, x: Array, near: Array) -> Array:
    full = machine.jacobian_map(machine.inputs(x, near)).reshape(len(x), len(machine.axes), 6)
    return full[:, :, columns(machine)]


def _cells_regular(
    machine: Machine, parameters: Array, near: Array, low: Array, width: Array
) -> tuple[np.ndarray, np.ndarray]:
    """Two of (N,) bool: proved that the Jacobian is nonsingular in the whole cell, and at its centre."""
    count, axes = len(low), len(machine.axes)
    half = width / 2
    # columns: the centres of all cells, then the cells whole
    middle = np.concatenate([low + half, low + half])
    scale = np.concatenate([half, half])
    spread = np.concatenate([np.zeros(count), half])
    s = Series(np.stack([middle, scale]), np.stack([spread, np.zeros(2 * count)]), 2)
    rest = [Series.constant(column, 2) for column in np.concatenate([parameters, parameters]).T]
    branch = [Series.constant(column, 2) for column in np.concatenate([near, near]).T if machine.branched]
    entries = machine.jacobian_map.enclose([*_motion().enclose([s, *rest]), *branch])
    free = columns(machine)
    chosen = [entries[6 * row + k] for row in range(axes) for k in free]
    jacobian = Series.stack([*chosen, Series.zeros(2, (2 * count,))])[:, :-1]  # as many rows where all are constant
    shape = (count, axes, len(free))
    length = np.array([1.0, 1.0, 1.0] + [1 / machine.characteristic_length] * 3)[free]
    middle_j = jacobian.mid[0, :count].reshape(shape) * length
    error_j = jacobian.rad[0, :count].reshape(shape) * length
    slope = jacobian.mid[1, :count].reshape(shape) * length
    error_slope = jacobian.rad[1, :count].reshape(shape) * length
    bend = (np.abs(jacobian.mid[2, count:]) + jacobian.rad[2, count:]).reshape(shape) * length
    inverse = np.linalg.pinv(np.where(np.isfinite(middle_j), middle_j, 0.0))  # out of reach, it proves nothing
    size = np.abs(inverse)
    # a little below 1, for the rounding of these lines themselves
    with np.errstate(invalid="ignore"):
        centre = np.abs(np.eye(axes) - inverse @ middle_j) + size @ error_j
        whole = centre + np.abs(inverse @ slope) + size @ (error_slope + bend)
        return whole.sum(-1).max(-1) < 1 - 1e-9, centre.sum(-1).max(-1) < 1 - 1e-9
