"""The proof that a straight motion meets no singularity, cell by cell.

How a platform moves when one axis does: the inverse Jacobian, and what follows along.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.interval import Ball
from kinematics.machine.kind import columns
from kinematics.machine.model import MachineModel, square_jacobian
from kinematics.machine.motion import controlled_jacobian
from kinematics.machine.pose import (
    STRAIGHT_SIZE,
    column,
    split_pose_symbols,
    straight_parameters,
    straight_pose,
    to_numbers,
)

# Smallest cell, as a share of the motion; beyond it the motion counts as singular.
MIN_CELL_SHARE = 2.0**-12
# Into how many cells one that fails is cut, at most.
MAX_PARTS = 4


def prove_regular(
    machine: MachineModel, start: RigidTransform, end: RigidTransform, near: Array | None = None
) -> np.ndarray:
    """(N,) bool: proved that the Jacobian is nonsingular along the whole straight motion from start to end.

    The Jacobian is that of what the machine controls, on the branch of the coordinates near (N, n), or home's.

    Where det J has other signs at the two ends, it vanishes between them. Any other motion is cut into cells c ± h, and
    over each, by the mean value theorem in guaranteed arithmetic, J(s) lies in J_c + J' [−h, h], with J' the ball of
    the derivative over the cell. With C ≈ J_c⁻¹, ‖|I − C J_c| + h |C J'|‖_∞ < 1 for all of that ball proves J(s)
    nonsingular for every s. Cells that fail are cut up, unless J_c itself is singular to rounding, which ends the
    search of its motion. Columns of rotation are scaled by the characteristic length.
    """
    parameters = straight_parameters(start, end, 1.0)
    near = np.broadcast_to(machine.home_q if near is None else near, (len(parameters), len(machine.axes)))
    with np.errstate(invalid="ignore"):  # out of reach: no sign, and nothing is proved
        ends = (np.broadcast_to(to_numbers(pose), (len(near), 12)) for pose in (start, end))
        first, last = (np.linalg.slogdet(square_jacobian(machine, x, near)).sign for x in ends)
    proved = np.broadcast_to(first * last > 0, len(parameters)).copy()
    pending = np.flatnonzero(proved)
    low, width = np.zeros(len(pending)), np.ones(len(pending))
    while len(pending):
        size, centre = _bound_cells(machine, parameters[pending], near[pending], low, width)
        fine = size < 1
        hopeless = ~centre | ~fine & (width <= MIN_CELL_SHARE)
        proved[pending[hopeless]] = False
        again = ~fine & ~hopeless & proved[pending]
        # about as many as the bound asks for, were it to fall with the width's square, as it mostly does
        parts = np.ceil(np.clip(1.1 * np.sqrt(np.nan_to_num(size[again], nan=9.0)), 2.0, MAX_PARTS)).astype(int)
        number = np.arange(parts.sum()) - np.repeat(parts.cumsum() - parts, parts)
        narrow = np.repeat(width[again] / parts, parts)
        low, width = np.repeat(low[again], parts) + number * narrow, narrow
        pending = np.repeat(pending[again], parts)
    return proved


def cell_map(machine: MachineModel) -> Expression:
    """Centre, half width, straight motion (19), near (n) where branched -> J_c, its error, J', its error, all (n, m).

    The last value is finite where all of J is bounded over the whole cell, which is where no other branch is met.
    """
    s, half, motion = ca.SX.sym("s"), ca.SX.sym("half"), ca.SX.sym("motion", STRAIGHT_SIZE)
    near = ca.SX.sym("near", len(machine.axes) if machine.branched else 0)
    x = column(*straight_pose(s, motion))
    entries = ca.reshape(machine.jacobian_map.function(ca.vertcat(x, near)), 6, -1).T[:, columns(machine).tolist()]
    lengths = np.where(columns(machine) < 3, 1.0, 1 / machine.characteristic_length)
    j = ca.vec((entries * ca.repmat(ca.DM(lengths).T, len(machine.axes), 1)).T)
    inputs = ca.vertcat(s, motion, near)
    at, slope = Expression("jacobian", inputs, j), Expression("slope", inputs, ca.jacobian(j, s))
    rest = [Ball(value, ca.SX(0)) for value in ca.vertsplit(ca.vertcat(motion, near))]
    point, cell = [Ball(s, ca.SX(0)), *rest], [Ball(s, half), *rest]
    centre, change = at.walk(point, Ball.constant), slope.walk(cell, Ball.constant)
    whole = at.walk(cell, Ball.constant) if machine.branched else []
    loose = ca.sum1(ca.vertcat(0, *(each.rad for each in whole)))
    out = [*(b.mid for b in centre), *(b.rad for b in centre), *(b.mid for b in change), *(b.rad for b in change)]
    return Expression("cells", ca.vertcat(s, half, motion, near), ca.vertcat(*out, loose))


def _bound_cells(
    machine: MachineModel, parameters: Array, near: Array, low: Array, width: Array
) -> tuple[Array, np.ndarray]:
    """(N,) bound below which the Jacobian is proved nonsingular in the whole cell: 1; (N,) whether at its centre."""
    count, axes, half = len(low), len(machine.axes), width / 2
    # a little wider, for the rounding of the cells' ends
    inputs = [(low + half)[:, None], half[:, None] * (1 + 1e-9) + 1e-15, parameters]
    values = machine.derived(cell_map)(np.concatenate([*inputs, near] if machine.branched else inputs, 1))
    at, error, change, spread = values[:, :-1].reshape(count, 4, axes, -1).transpose(1, 0, 2, 3)
    inverse = np.linalg.pinv(np.where(np.isfinite(at), at, 0.0))  # out of reach, it proves nothing
    size = np.abs(inverse)
    with np.errstate(invalid="ignore"):
        centre = np.abs(np.eye(axes) - inverse @ at) + size @ error
        whole = centre + half[:, None, None] * (np.abs(inverse @ change) + size @ spread)
        # a little more, for the rounding of these lines themselves
        bound = np.where(np.isfinite(values[:, -1]), whole.sum(-1).max(-1) * (1 + 1e-9), np.inf)
        return bound, centre.sum(-1).max(-1) < 1 - 1e-9


def sensitivity(machine: MachineModel, x: Array, q: Array) -> Array:
    """(N, 6, n): the twist [v, ω] of the platform in the base frame for the unit change of each axis.

    J⁻¹ of the columns that the machine controls at pose numbers x (N, 12) and their coordinates q (N, n); zero for what
    it holds; for what follows, the derivative of the pose that is carried along. Raises MotionError at a singular pose.
    """
    free, count = columns(machine), len(machine.axes)
    twist = np.zeros((len(x), 6, count))
    twist[:, free] = np.linalg.inv(controlled_jacobian(machine, x, q))
    return np.asarray(_complete_twists(machine, machine.inputs(x, q)) @ twist) if machine.follows else twist


def _complete_twists(machine: MachineModel, inputs: Array) -> Array:
    """(N, 6, 6): the twist of the pose with what follows filled in, for the twist of what is controlled.

    ω of a rotation R that depends on t: [ω]× = (dR/dt) Rᵀ.
    """
    given = ca.SX.sym("inputs", inputs.shape[1])
    x, near, twist = given[:12], given[12:], ca.SX.sym("twist", 6)
    position, rotation = split_pose_symbols(x)
    moved = position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation
    q = machine.expression(*moved, near if machine.branched else ca.SX.zeros(len(machine.axes)))
    carried_position, carried_rotation = machine.carried(*moved, q)
    slope = ca.jacobian(column(carried_position, carried_rotation), twist)
    turns = []
    for k in range(6):
        spin = ca.reshape(slope[3:, k], 3, 3).T @ carried_rotation.T
        turns.append(ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]))
    whole = ca.substitute(ca.vertcat(slope[:3, :], ca.horzcat(*turns)), twist, ca.SX.zeros(6))
    return Expression("carried_twist", given, ca.vec(whole.T))(inputs).reshape(-1, 6, 6)
