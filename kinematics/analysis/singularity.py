"""The proof that a straight motion meets no singularity, cell by cell; and how a platform moves
when one axis does.

Enclosures are balls |x − mid| ≤ rad of symbols: the operations of `Expression.run` on balls instead
of numbers give two expressions, midpoint and radius, for CasADi to evaluate. The error of the
arguments and the rounding of every operation are carried along; underflow is not. What has no bound
has an infinite or undefined radius, and no operation makes a finite one of that. Source: Rump, Acta
Numerica 19 (2010), section 5.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.machine.kind import columns, controlled_twists
from kinematics.machine.model import MachineModel, square_jacobian
from kinematics.machine.motion import controlled_jacobian
from kinematics.machine.pose import (
    STRAIGHT_SIZE,
    column,
    split_pose_symbols,
    straight_numbers,
    straight_pose,
    to_numbers,
)

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

# Twice the unit roundoff: covers the rounding of the operation itself and of the radius that bounds
# it.
EPS = 2.0**-52
_EPS = ca.SX(EPS)
_ONE_ROUNDING = ca.SX(1 + EPS)
_FOUR_ROUNDINGS = ca.SX(1 + 4 * EPS)
_EIGHT_ROUNDINGS = ca.SX(1 + 8 * EPS)
_ZERO = ca.SX(0)
_ONE = ca.SX(1)
_INFINITE = ca.SX(inf)


def _plus(a: ca.SX, b: ca.SX) -> ca.SX:
    """a + b, without the search for its meaning, which takes six times as long."""
    return ca.SX.binary(ca.OP_ADD, a, b)


def _times(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.SX.binary(ca.OP_MUL, a, b)


def _minus(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.SX.binary(ca.OP_SUB, a, b)


def _over(a: ca.SX, b: ca.SX) -> ca.SX:
    return ca.SX.binary(ca.OP_DIV, a, b)


def _choose(condition: ca.SX, a: ca.SX, b: ca.SX) -> ca.SX:
    """a where the condition holds, else b: as `casadi.if_else`."""
    first = ca.SX.binary(ca.OP_IF_ELSE_ZERO, condition, a)
    return _plus(first, ca.SX.binary(ca.OP_IF_ELSE_ZERO, ca.SX.unary(ca.OP_NOT, condition), b))


def _size(a: ca.SX) -> ca.SX:
    return ca.SX.unary(ca.OP_FABS, a)


@dataclass(frozen=True, slots=True)
class Ball:
    """Scalar symbols: midpoint and radius."""

    mid: ca.SX
    rad: ca.SX

    @staticmethod
    def constant(value: float) -> Ball:
        return Ball(ca.SX(value), ca.SX(0))

    def __neg__(self) -> Ball:
        return Ball(-self.mid, self.rad)

    def __add__(self, other: Ball) -> Ball:
        mid = _plus(self.mid, other.mid)
        return Ball(
            mid, _plus(_times(_plus(self.rad, other.rad), _ONE_ROUNDING), _times(_EPS, _size(mid)))
        )

    def __sub__(self, other: Ball) -> Ball:
        return self + -other

    def __mul__(self, other: Ball | float) -> Ball:
        if not isinstance(other, Ball):
            other = Ball.constant(other)
        mid = _times(self.mid, other.mid)
        rad = _plus(
            _times(_size(self.mid), other.rad), _times(self.rad, _plus(_size(other.mid), other.rad))
        )
        return Ball(mid, _plus(_times(rad, _FOUR_ROUNDINGS), _times(_EPS, _size(mid))))

    def __truediv__(self, other: Ball) -> Ball:
        return self * other._inverse()

    def __rtruediv__(self, other: float) -> Ball:
        return self._inverse() * other

    def _inverse(self) -> Ball:
        """|1/x − 1/m| = |x − m|/(|x| |m|) ≤ rad/((|m| − rad) |m|)."""
        size = _size(self.mid)
        safe = ca.SX.binary(ca.OP_LT, self.rad, size)
        error = _over(self.rad, _times(_minus(size, self.rad), size))
        rad = _plus(_times(error, _EIGHT_ROUNDINGS), _over(_EPS, size))
        return Ball(_choose(safe, _over(_ONE, self.mid), _ZERO), _choose(safe, rad, _INFINITE))

    def sqrt(self) -> Ball:
        """|√x − √m| = |x − m|/(√x + √m) ≤ rad/(√(m − rad) + √m); no bound where x may be ≤ 0."""
        safe = self.mid > self.rad
        root = ca.sqrt(self.mid)
        rad = self.rad / (ca.sqrt(self.mid - self.rad) + root) * (1 + 8 * EPS) + 2 * EPS * root
        return Ball(ca.if_else(safe, root, 0), ca.if_else(safe, rad, inf))

    def sincos(self) -> tuple[Ball, Ball]:
        """|sin x − sin m| ≤ |cos m| rad + rad²/2, never above 2; libm is trusted to two units in
        the last place.
        """
        sine, cosine = ca.sin(self.mid), ca.cos(self.mid)
        rads = (ca.fabs(slope) * self.rad + self.rad**2 / 2 for slope in (cosine, sine))
        bound = [ca.fmin(rad, 2) * (1 + 4 * EPS) + 4 * EPS for rad in rads]
        return Ball(sine, bound[0]), Ball(cosine, bound[1])

    def sign(self) -> Ball:
        """±1; no bound where x may be zero."""
        return Ball(ca.sign(self.mid), ca.if_else(ca.fabs(self.mid) > self.rad, 0, inf))

    def atan2(self, x: Ball) -> Ball:
        """The angle of the point (x, self): off by asin(t) ≤ t/√(1 − t²), t = error/distance.

        No bound where the point may be the origin or on the cut.
        """
        away = ca.sqrt(self.mid**2 + x.mid**2) * (1 - 4 * EPS)
        error = ca.sqrt(self.rad**2 + x.rad**2) * (1 + 4 * EPS)
        clear = ca.logic_or(x.mid > x.rad, ca.fabs(self.mid) > self.rad)
        rad = error / ca.sqrt((away - error) * (away + error)) * (1 + 8 * EPS) + 8 * EPS
        return Ball(
            ca.atan2(self.mid, x.mid), ca.if_else(ca.logic_and(away > error, clear), rad, inf)
        )


# Smallest cell, as a share of the motion; beyond it the motion counts as singular.
MIN_CELL_SHARE = 2.0**-12
# Into how many cells one that fails is cut, at most.
MAX_PARTS = 4


def prove_regular(
    machine: MachineModel, start: Pose, end: Pose, near: Array | None = None
) -> np.ndarray:
    """Return `prove_nonsingular` of poses."""
    return prove_nonsingular(machine, to_numbers(start), to_numbers(end), near)


def prove_nonsingular(
    machine: MachineModel, start: Array, end: Array, near: Array | None = None
) -> np.ndarray:
    """Prove that the Jacobian is nonsingular along the whole straight motion from start to end:
    (N,) bool.

    start, end: pose numbers (1, 12) or (N, 12).

    The Jacobian is that of what the machine controls, on the branch of the coordinates near (N, n),
    or home's.

    Where det J has other signs at the two ends, it vanishes between them. Any other motion is cut
    into cells c ± h, and over each, by the mean value theorem in guaranteed arithmetic, J(s) lies
    in J_c + J' [−h, h], with J' the ball of the derivative over the cell. With C ≈ J_c⁻¹, ‖|I − C
    J_c| + h |C J'|‖_∞ < 1 for all of that ball proves J(s) nonsingular for every s. Cells that fail
    are cut up, unless J_c itself is singular to rounding, which ends the search of its motion.
    Columns of rotation are scaled by the characteristic length.
    """
    parameters = straight_numbers(start, end)
    near = np.broadcast_to(
        machine.home_q if near is None else near, (len(parameters), len(machine.axes))
    )
    with np.errstate(invalid="ignore"):  # out of reach: no sign, and nothing is proved
        ends = (np.broadcast_to(x, (len(near), 12)) for x in (start, end))
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
        # about as many as the bound asks for, were it to fall with the width's square, as it mostly
        # does
        parts = np.ceil(
            np.clip(1.1 * np.sqrt(np.nan_to_num(size[again], nan=9.0)), 2.0, MAX_PARTS)
        ).astype(int)
        number = np.arange(parts.sum()) - np.repeat(parts.cumsum() - parts, parts)
        narrow = np.repeat(width[again] / parts, parts)
        low, width = np.repeat(low[again], parts) + number * narrow, narrow
        pending = np.repeat(pending[again], parts)
    return proved


def cell_map(machine: MachineModel) -> Expression:
    """Centre, half width, straight motion (19), near (n) where branched -> J_c, its error, J', its
    error, all (n, m).

    The last value is finite where all of J is bounded over the whole cell, which is where no other
    branch is met.
    """
    s, half, motion = ca.SX.sym("s"), ca.SX.sym("half"), ca.SX.sym("motion", STRAIGHT_SIZE)
    near = ca.SX.sym("near", len(machine.axes) if machine.branched else 0)
    x = column(*straight_pose(s, motion))
    entries = ca.reshape(
        machine.controlled_map.function(ca.vertcat(x, near)), len(machine.axes), -1
    ).T
    lengths = np.where(columns(machine) < 3, 1.0, 1 / machine.characteristic_length)
    j = ca.vec((entries * ca.repmat(ca.DM(lengths).T, len(machine.axes), 1)).T)
    inputs = ca.vertcat(s, motion, near)
    at, slope = Expression("jacobian", inputs, j), Expression("slope", inputs, ca.jacobian(j, s))
    rest = [Ball(value, ca.SX(0)) for value in ca.vertsplit(ca.vertcat(motion, near))]
    point, cell = [Ball(s, ca.SX(0)), *rest], [Ball(s, half), *rest]
    centre, change = at.walk(point, Ball.constant), slope.walk(cell, Ball.constant)
    whole = at.walk(cell, Ball.constant) if machine.branched else []
    loose = ca.sum1(ca.vertcat(0, *(each.rad for each in whole)))
    out = [
        *(b.mid for b in centre),
        *(b.rad for b in centre),
        *(b.mid for b in change),
        *(b.rad for b in change),
    ]
    return Expression("cells", ca.vertcat(s, half, motion, near), ca.vertcat(*out, loose))


def _bound_cells(
    machine: MachineModel, parameters: Array, near: Array, low: Array, width: Array
) -> tuple[Array, np.ndarray]:
    """(N,) bound below which the Jacobian is proved nonsingular in the whole cell: 1; (N,) whether
    at its centre.
    """
    count, axes, half = len(low), len(machine.axes), width / 2
    # a little wider, for the rounding of the cells' ends
    inputs = [(low + half)[:, None], half[:, None] * (1 + 1e-9) + 1e-15, parameters]
    values = machine.derive(cell_map)(
        np.concatenate([*inputs, near] if machine.branched else inputs, 1)
    )
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
    """(N, 6, n): the twist [v, ω] of the platform in the base frame for the unit change of each
    axis.

    J⁻¹ of the columns that the machine controls at pose numbers x (N, 12) and their coordinates q
    (N, n); zero for what it holds; for what follows, the derivative of the pose that is carried
    along. Raises MotionError at a singular pose.
    """
    twist = controlled_twists(machine, x) @ np.linalg.inv(controlled_jacobian(machine, x, q))
    return (
        np.asarray(_complete_twists(machine, machine.inputs(x, q)) @ twist)
        if machine.follows
        else twist
    )


def _complete_twists(machine: MachineModel, inputs: Array) -> Array:
    """(N, 6, 6): the twist of the pose with what follows filled in, for the twist of what is
    controlled.

    ω of a rotation R that depends on t: [ω]× = (dR/dt) Rᵀ.
    """
    given = ca.SX.sym("inputs", inputs.shape[1])
    x, near, twist = given[:12], given[12:], ca.SX.sym("twist", 6)
    position, rotation = split_pose_symbols(x)
    moved = position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation
    q = machine.expression(*moved, near if machine.branched else ca.SX.zeros(len(machine.axes)))
    carried_position, carried_rotation = machine.fill_pose(*moved, q)
    slope = ca.jacobian(column(carried_position, carried_rotation), twist)
    turns = []
    for k in range(6):
        spin = ca.reshape(slope[3:, k], 3, 3).T @ carried_rotation.T
        turns.append(ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0]))
    whole = ca.substitute(ca.vertcat(slope[:3, :], ca.horzcat(*turns)), twist, ca.SX.zeros(6))
    return Expression("carried_twist", given, ca.vec(whole.T))(inputs).reshape(-1, 6, 6)
