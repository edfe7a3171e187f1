"""Actuator forces as one expression of the motion, for every kind of machine: what limits and
certificates enclose.

A body's frame is twelve numbers y of the pose x and the coordinates q. With S = ∫ r rᵀ dm about the
frame's origin, its inertia less its weight does on any small change δy = (δp, δR) the work

    m (p̈ + R̈ c − g) · δp + (m (p̈ − g) cᵀ + R̈ S) : δR

which is linear in ÿ: no angular velocity appears. The sum over all bodies, carried back to x and q
by the transposed derivatives of y, is the work of the actuators: W_x on a change of the pose, W_q
on one of the coordinates, so that

    f = W_q + J⁻ᵀ Bᵀ W_x + reflected · q̈ + friction · q̇

with J the square Jacobian of what is controlled and B the change of x with it. Lagrange's equations
in coordinates with constraints; see Udwadia and Kalaba, Analytical Dynamics (1996), chapter 3. The
linear systems A f = b are solved numerically in batches, and in Taylor series with guaranteed
error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import overload

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.taylor_model import EPS, Series
from kinematics.machine.kind import controlled_twist_symbols
from kinematics.machine.load import Body
from kinematics.machine.model import MachineModel
from kinematics.machine.pose import column, split_pose_symbols


def solve(matrix: Array, right: Array) -> Array:
    """f (N, n, k) of A (N, n, n) and b (N, n, k); nan where A is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(invert(matrix) @ right)


def solve_series(matrix: Series, right: Series) -> Series:
    """Return f with A f = b for series A (N, n, n) and b (N, n): A₀ f_k = b_k − Σ_{j>0} A_j
    f_{k−j}.

    With C ≈ A₀⁻¹ and E = 1 − C A₀, f = C b + E f, so that |f − C b| ≤ |E| 1 · ‖C b‖/(1 − ‖E‖), the
    norms largest row sums (Rump, Acta Numerica 19 (2010), section 10); no bound where ‖E‖ ≥ 1.
    """
    order = min(matrix.order, right.order)
    full = right.cut(order).pad(order)
    powers = min(matrix.degree, order) + 1
    shape = (powers, *full.mid.shape[1:], full.mid.shape[2])
    a_mid, a_rad = (np.broadcast_to(values[:powers], shape) for values in (matrix.mid, matrix.rad))
    out = Series.zeros(order, full.mid.shape[1:])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        guess = invert(a_mid[0])  # C; nan where A₀ is singular
        excess = _find_excess(guess, a_mid[0], a_rad[0])
        norm = excess.max(1, keepdims=True)
        spread = np.where(norm < 1, excess / (1 - norm), np.inf)
        for k in range(order + 1):
            known, blur = full.mid[k], full.rad[k]
            for j in range(1, min(k, powers - 1) + 1):
                product, error = _multiply(a_mid[j], a_rad[j], out.mid[k - j], out.rad[k - j])
                known = known - product
                blur = (blur + error) * (1 + EPS) + EPS * np.abs(known)
            middle, error = _multiply(guess, np.zeros_like(guess), known, blur)
            size = (np.abs(middle) + error).max(1, keepdims=True)
            radius = (error + spread * size * (1 + 8 * EPS)) * (1 + 4 * EPS)
            is_bounded = np.isfinite(middle) & np.isfinite(radius)
            out.mid[k] = np.where(is_bounded, middle, 0.0)
            out.rad[k] = np.where(is_bounded, radius, np.inf)
    return out


def _find_excess(guess: Array, mid: Array, rad: Array) -> Array:
    """Return upper bounds (N, n) of the row sums of |1 − C A| for C (N, n, n) and balls A (N, n,
    n).
    """
    n = mid.shape[-1]
    terms = n + 3
    size = 1 + np.abs(guess) @ np.abs(mid)
    error = np.abs(guess) @ rad + terms * EPS * size
    entries = np.abs(np.eye(n) - guess @ mid) + error
    return np.asarray(entries.sum(2) * (1 + 2 * terms * EPS))


def _multiply(a_mid: Array, a_rad: Array, mid: Array, rad: Array) -> tuple[Array, Array]:
    """Return the ball (N, n) of A x for balls A (N, n, n) and x (N, n)."""
    terms = mid.shape[-1] + 3
    column, spread = mid[..., None], rad[..., None]
    size = np.abs(a_mid) @ np.abs(column)
    error = np.abs(a_mid) @ spread + a_rad @ (np.abs(column) + spread)
    radius = (error + terms * EPS * size) * (1 + terms * EPS)
    return (a_mid @ column)[..., 0], radius[..., 0]


def invert(matrix: Array) -> Array:
    """A⁻¹ (N, n, n); nan where there is none."""
    finite: np.ndarray = np.asarray(np.isfinite(matrix).all((1, 2)))
    safe = np.where(finite[:, None, None], matrix, np.eye(matrix.shape[-1]))
    try:
        found = np.linalg.inv(safe)
    except np.linalg.LinAlgError:  # one singular matrix fails the whole batch
        regular = np.linalg.matrix_rank(safe) >= matrix.shape[-1]
        found = np.full(safe.shape, np.nan)
        found[regular] = np.linalg.inv(safe[regular])
    return np.asarray(np.where(finite[:, None, None], found, np.nan))


@dataclass(frozen=True, slots=True)
class Balance:
    """What gives the forces: those that need no solving, and the system Jᵀ f = Bᵀ W_x where there
    are others.

    expression  inputs -> W_q and the axes' own (n), then Bᵀ W_x (n) and Jᵀ row by row (n, n) where
                they are needed
    axes        n
    count       of motions at one place whose forces these are, one after the other: k of W_q, k of
                Bᵀ W_x, and one Jᵀ
    """

    expression: Expression
    axes: int
    count: int = 1

    @overload
    def force(self, values: Array) -> Array: ...
    @overload
    def force(self, values: Series) -> Series: ...
    def force(self, values: Array | Series) -> Array | Series:
        """Forces (N, k n) of the expression's values (N, m); nan, or no bound, where the machine is
        singular.
        """
        n, k = self.axes, self.count
        if self.expression.size[1] == k * n:
            return values
        if isinstance(values, Series):
            flat = values[:, 2 * n :]
            shape = (*flat.mid.shape[:-1], n, n)
            matrix = Series(flat.mid.reshape(shape), flat.rad.reshape(shape), flat.order)
            return values[:, :n] + solve_series(matrix, values[:, n : 2 * n])
        right = values[:, k * n : 2 * k * n].reshape(-1, k, n).swapaxes(1, 2)
        solved = solve(values[:, 2 * k * n :].reshape(-1, n, n), right)
        return np.asarray(values[:, : k * n] + solved.swapaxes(1, 2).reshape(-1, k * n))

    def __call__(self, inputs: Array) -> Array:
        return self.force(self.expression(inputs))


def force_map(machine: MachineModel) -> Balance:
    """x, ẋ, ẍ (12 each), q, q̇, q̈ (n each) -> actuator forces f (n), N or N·m, positive towards
    greater q.

    x has what follows filled in; q tells the branch too.
    """
    x, q = _Rates(12, "x"), _Rates(len(machine.axes), "q")
    reflected, friction = (
        ca.DM([getattr(axis, name) for axis in machine.axes]) for name in ("reflected", "friction")
    )
    own, solved = _load_forces(machine, x, q)
    values = ca.vertcat(own + reflected * q.second + friction * q.first, solved)
    return Balance(Expression("force", ca.vertcat(*x.all, *q.all), values), len(machine.axes))


def force_terms_map(machine: MachineModel) -> Balance:
    """x, x′, x″ (12 each), q, q′, q″ (n each) along a path -> actuator forces (3 n) of three
    motions: at rest, at rest with s̈ = 1, and with ṡ = 1; of a motion ẋ = x′ ṡ and ẍ = x′ s̈ + x″
    ṡ², and q so too.
    """
    x, q = _Rates(12, "x"), _Rates(len(machine.axes), "q")
    reflected, friction = (
        ca.DM([getattr(axis, name) for axis in machine.axes]) for name in ("reflected", "friction")
    )
    own, solved = _load_forces(machine, x, q)
    right = solved[: len(machine.axes)] if solved.numel() else solved
    forces = own + reflected * q.second + friction * q.first
    rates, still = (
        ca.vertcat(x.first, q.first, x.second, q.second),
        ca.SX.zeros(12 + len(machine.axes)),
    )
    first, second = ca.vertcat(x.first, q.first), ca.vertcat(x.second, q.second)
    motions = [ca.vertcat(still, still), ca.vertcat(still, first), ca.vertcat(first, second)]
    parts = [ca.substitute(part, rates, motion) for part in (forces, right) for motion in motions]
    values = ca.vertcat(*parts, solved[len(machine.axes) :] if solved.numel() else solved)
    return Balance(
        Expression("force_terms", ca.vertcat(*x.all, *q.all), values),
        len(machine.axes),
        len(motions),
    )


def holding_map(machine: MachineModel) -> Balance:
    """x (12), q (n) -> the forces that hold the machine still."""
    x, q = _Rates(12, "x"), _Rates(len(machine.axes), "q")
    moving = ca.vertcat(x.first, x.second, q.first, q.second)
    values = ca.substitute(
        ca.vertcat(*_load_forces(machine, x, q)), moving, ca.SX.zeros(moving.numel())
    )
    return Balance(Expression("holding", ca.vertcat(x.value, q.value), values), len(machine.axes))


def has_load(machine: MachineModel) -> bool:
    """Whether the machine states anything that its actuators have to push."""
    x, q = _Rates(12, "x"), _Rates(len(machine.axes), "q")
    moved = machine.moving_bodies(*split_pose_symbols(x.value), q.value)
    own = any(axis.friction or axis.reflected for axis in machine.axes)
    return own or bool(machine.load.wrench.any()) or any(body.mass > 0 for body, _ in moved)


class _Rates:
    """A column of symbols, and of its first and second rates in time."""

    def __init__(self, size: int, name: str) -> None:
        self.all = tuple(ca.SX.sym(name + dots, size) for dots in ("", "d", "dd"))
        self.value, self.first, self.second = self.all


def _load_forces(machine: MachineModel, x: _Rates, q: _Rates) -> tuple[ca.SX, ca.SX]:
    """W_q, and Bᵀ W_x with Jᵀ row by row: nothing where W_x is zero."""
    position, rotation = split_pose_symbols(x.value)
    moved = machine.moving_bodies(position, rotation, q.value)
    state, first, second = (ca.vertcat(*both) for both in zip(x.all, q.all, strict=True))
    work = ca.SX.zeros(state.numel())
    for body, frame in moved:
        if body.mass > 0:
            rate = ca.jtimes(frame, state, first)
            acceleration = ca.jtimes(rate, state, first) + ca.jtimes(frame, state, second)
            work += ca.jtimes(
                frame, state, _inertial_force(body, acceleration, machine.gravity), True
            )
    if machine.load.wrench.any():
        platform = moved[0][1]
        work -= ca.jtimes(
            platform,
            state,
            _wrench_force(machine.load.wrench, split_pose_symbols(platform)[1]),
            True,
        )
    on_pose, on_axes = work[:12], work[12:]
    push, turns = split_pose_symbols(on_pose)
    moment = sum((ca.cross(rotation[:, k], turns[:, k]) for k in range(3)), ca.SX.zeros(3))
    generalized = controlled_twist_symbols(machine, rotation).T @ ca.vertcat(push, moment)
    if generalized.is_zero():
        return on_axes, ca.SX(0, 1)
    return on_axes, ca.vertcat(
        generalized, ca.vec(_square_jacobian(machine, position, rotation, q.value))
    )


def _inertial_force(body: Body, acceleration: ca.SX, gravity: Array) -> ca.SX:
    """What ÿ asks for: conjugate to the frame's twelve numbers."""
    linear, turning = split_pose_symbols(acceleration)
    spread = body.inertia
    about_origin = (
        np.trace(spread) / 2 * np.eye(3) - spread + body.mass * np.outer(body.centre, body.centre)
    )
    centre, free = ca.DM(body.centre), linear - ca.DM(gravity)
    return column(
        body.mass * (free + turning @ centre),
        body.mass * free @ centre.T + turning @ ca.DM(about_origin),
    )


def _wrench_force(wrench: Array, rotation: ca.SX) -> ca.SX:
    """The same of a force and a moment M on the frame: M · δθ = ½ Σ (M × r_k) · δr_k over the
    columns of R.
    """
    moment = ca.DM(wrench[3:])
    turns = ca.horzcat(*(ca.cross(moment, rotation[:, k]) / 2 for k in range(3)))
    return column(ca.SX(ca.DM(wrench[:3])), turns)


def _square_jacobian(machine: MachineModel, position: ca.SX, rotation: ca.SX, near: ca.SX) -> ca.SX:
    """J (n, n): q by a small motion of what is controlled."""
    twist = ca.SX.sym("twist", 6)
    moved = machine.expression(position + twist[:3], rotation + ca.skew(twist[3:]) @ rotation, near)
    jacobian = ca.substitute(ca.jacobian(moved, twist), twist, ca.SX.zeros(6))
    return jacobian @ controlled_twist_symbols(machine, rotation)
