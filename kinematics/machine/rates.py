"""First and second rates of what is a function of the pose, along any motion of it, from the same expression."""

from __future__ import annotations

import casadi as ca

from kinematics.foundation.casadi_function import Expression
from kinematics.machine.kind import Kind
from kinematics.machine.pose import split_pose_symbols


class MovingPose:
    """A pose that passes through pose numbers x (12) with a twist (6) and its rate (6) in the base frame.

        p(t) = p + v t + v̇ t²/2,    R(t) = (1 + ω× t + (ω̇× + ω×ω×) t²/2) R

    agrees with every such motion up to the second order at t = 0.
    """

    def __init__(self, x: ca.SX) -> None:
        self.t = ca.SX.sym("t")
        self.twist, self.acceleration = ca.SX.sym("twist", 6), ca.SX.sym("acceleration", 6)
        position, rotation = split_pose_symbols(x)
        spin, turn = ca.skew(self.twist[3:]), ca.skew(self.acceleration[3:])
        half = self.t**2 / 2
        self.position = position + self.twist[:3] * self.t + self.acceleration[:3] * half
        self.rotation = (ca.SX.eye(3) + spin * self.t + (turn + spin @ spin) * half) @ rotation

    def derivatives(self, values: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """A column of values of the pose, its first and its second derivative at t = 0."""
        first = ca.jacobian(values, self.t)
        second = ca.jacobian(first, self.t)
        value, first, second = (ca.substitute(each, self.t, 0) for each in (values, first, second))
        return value, first, second


def rates(machine: Kind, x: ca.SX, near: ca.SX, inputs: ca.SX) -> Expression:
    """Inputs, twist (6), its rate (6) -> q̇ (n), q̈ (n), and twist and rate (6, 6) with what follows filled in."""
    moving = MovingPose(x)
    q = machine.expression(moving.position, moving.rotation, near)
    position, rotation = machine.carried(moving.position, moving.rotation, q)
    _, qd, qdd = moving.derivatives(q)
    _, v, a = moving.derivatives(position)
    r, r1, r2 = (ca.reshape(each, 3, 3) for each in moving.derivatives(ca.vec(rotation)))
    out = ca.vertcat(qd, qdd, v, _skew_vector(r1 @ r.T), a, _skew_vector(r2 @ r.T))
    return Expression("rates", ca.vertcat(inputs, moving.twist, moving.acceleration), out)


def _skew_vector(m: ca.SX) -> ca.SX:
    """The vector of the skew part: ω of Ṙ Rᵀ = ω×, ω̇ of R̈ Rᵀ = ω̇× + ω×ω×."""
    column: ca.SX = ca.vertcat(m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]) / 2
    return column
