"""How a platform moves when one axis does: the inverse Jacobian, and what follows along."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from kinematics.array import Array
from kinematics.expression import Expression
from kinematics.freedom import columns
from kinematics.motion import controlled
from kinematics.pose import column, symbols

if TYPE_CHECKING:
    from kinematics.machine import Machine


def sensitivity(machine: Machine, x: Array, q: Array) -> Array:
    """(N, 6, n): the twist [v, ω] of the platform in the base frame for the unit change of each axis.

    J⁻¹ of the columns that the machine controls at pose numbers x (N, 12) and their coordinates q (N, n); zero for what
    it holds; for what follows, the derivative of the pose that is carried along. Raises MotionError at a singular pose.
    """
    free, count = columns(machine), len(machine.axes)
    twist = np.zeros((len(x), 6, count))
    twist[:, free] = np.linalg.inv(controlled(machine, x, q))
    return np.asarray(_carried(machine, machine.inputs(x, q)) @ twist) if machine.follows else twist


def _carried(machine: Machine, inputs: Array) -> Array:
    """(N, 6, 6): the twist of the pose with what follows filled in, for the twist of what is controlled.

    ω of a rotation R that depends on t: [ω]× = (dR/dt) Rᵀ.
    """
    given = ca.SX.sym("inputs", inputs.shape[1])
    x, near, twist = given[:12], given[12:], ca.SX.sym("twist", 6)
    position, rotation = symbols(x)
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
