"""Actuator forces of a hexapod whose legs have inertia: platform and legs in closed loops, one linear system."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from kinematics.array import Array
from kinematics.body import Body, Leg
from kinematics.errors import MotionError
from kinematics.expression import Expression
from kinematics.hexapod import Hexapod
from kinematics.leg_frames import ALONG, home_frames
from kinematics.motion import Motion, controlled
from kinematics.pinocchio_adapter import inertia, pinocchio
from kinematics.pose import numbers
from kinematics.rates import Moving


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """A free platform, and legs on it that are cut at their platform joints and closed by constraints.

    model        pinocchio's tree: the platform (6 freedoms, in its own frame), then per leg two turns and the stroke
    constraints  one per leg: rod and platform have their joint's centre in common
    driven       (n,) indices of the strokes among the velocities
    """

    model: Any
    constraints: tuple[Any, ...]
    driven: np.ndarray


def closed_loop(machine: Hexapod, legs: Sequence[Leg], platform: Body, gravity: Array) -> ClosedLoop:
    """The hexapod with universal joints on the base and spherical joints on the platform."""
    pin = pinocchio("a hexapod whose legs have inertia")
    model, none, driven, ends = pin.Model(), pin.SE3.Identity(), [], []
    model.gravity.linear[:] = gravity
    plate = model.addJoint(0, pin.JointModelFreeFlyer(), none, "platform")
    model.appendBodyToJoint(plate, inertia(platform), none)
    for axis, leg, frame, base in zip(machine.axes, legs, home_frames(machine, legs), machine.base, strict=True):
        first = model.addJoint(0, pin.JointModelRX(), pin.SE3(frame, base), f"{axis.name} first turn")
        second = model.addJoint(first, pin.JointModelRY(), none, f"{axis.name} second turn")
        stroke = model.addJoint(second, pin.JointModelPZ(), none, f"{axis.name} stroke")
        model.appendBodyToJoint(second, inertia(leg.barrel), none)
        model.appendBodyToJoint(stroke, inertia(leg.rod), none)
        driven.append(model.joints[stroke].idx_v)
        ends.append(stroke)
    constraints = tuple(
        pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D, model, end, none, plate, pin.SE3(np.eye(3), joint), pin.ReferenceFrame.LOCAL
        )
        for end, joint in zip(ends, machine.platform, strict=True)
    )
    return ClosedLoop(model, constraints, np.array(driven))


def states(machine: Hexapod, legs: Sequence[Leg], motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates (N, 25), velocities and accelerations (N, 24) of the tree in which all loops are closed.

    A leg along u in its base frame is turned by θ₁ = atan2(−u_y, u_z) and θ₂ = atan2(u_x, √(u_y² + u_z²)).
    """
    x = ca.SX.sym("x", 12)
    moving = Moving(x)
    joints = []
    for base, end, frame in zip(machine.base, machine.platform, home_frames(machine, legs), strict=True):
        u = frame.T @ (moving.position + moving.rotation @ end - base)
        joints += [ca.atan2(-u[1], u[2]), ca.atan2(u[0], ca.sqrt(u[1] ** 2 + u[2] ** 2)), ca.norm_2(u)]
    inputs = ca.vertcat(x, moving.twist, moving.acceleration)
    leg_rates = Expression("leg_rates", inputs, ca.vertcat(*moving.derivatives(ca.vertcat(*joints))))
    values = leg_rates(np.concatenate([numbers(motion.pose), motion.twist, motion.acceleration], 1))
    turned, turned_rate, turned_rate2 = np.split(values, 3, 1)
    locked = np.cos(turned[:, 1::3]) < ALONG
    if locked.any():
        instant, leg = np.argwhere(locked)[0]
        raise MotionError(
            f"machine {machine.name}: at instant {instant} {machine.axes[leg].name} lies along the first axis of its "
            "universal joint, which cannot swing it from there; choose another first_axis"
        )
    linear, spin = motion.twist[:, :3], motion.twist[:, 3:]
    # the platform's own velocity components change with the frame that they are along, too
    apparent = motion.acceleration[:, :3] - np.cross(spin, linear)
    local = [_in_platform(motion, each) for each in (linear, spin, apparent, motion.acceleration[:, 3:])]
    place = [np.atleast_2d(motion.pose.translation), np.atleast_2d(motion.pose.rotation.as_quat())]
    return (
        np.concatenate([*place, turned], 1),
        np.concatenate([*local[:2], turned_rate], 1),
        np.concatenate([*local[2:], turned_rate2], 1),
    )


def leg_forces(
    machine: Hexapod, legs: Sequence[Leg], motion: Motion, platform: Body, wrench: Array, gravity: Array
) -> Array:
    """(N, 6) N along the legs: M v̇ + h = B f + Jᵀ λ + wrench, solved for forces f (6) and joint forces λ (18) at once.

    Raises MotionError at a singular pose, and where a leg lies along the first axis of its universal joint.
    """
    controlled(machine, numbers(motion.pose), motion.q)  # refuses what is singular
    pin, loop = pinocchio("a hexapod whose legs have inertia"), closed_loop(machine, legs, platform, gravity)
    model, data = loop.model, loop.model.createData()
    closings = [(constraint, constraint.createData()) for constraint in loop.constraints]
    n, count = model.nv, len(motion)
    system, needed = np.zeros((count, n, n)), np.empty((count, n))
    system[:, loop.driven, np.arange(len(loop.driven))] = 1.0
    for k, (q, v, a) in enumerate(zip(*states(machine, legs, motion), strict=True)):
        needed[k] = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        for leg, (constraint, state) in enumerate(closings):
            constraint.calc(model, data, state)  # getConstraintJacobian reads what this leaves behind
            columns = slice(6 + 3 * leg, 9 + 3 * leg)
            system[k, :, columns] = pin.getConstraintJacobian(model, data, constraint, state).T
    needed[:, :6] -= local_wrench(motion, wrench)
    return np.asarray(np.linalg.solve(system, needed[:, :, None])[:, : len(loop.driven), 0], float)


def local_wrench(motion: Motion, wrench: Array) -> Array:
    """(N, 6) a wrench at the platform's origin, along the platform's axes instead of the base's."""
    return np.concatenate([_in_platform(motion, wrench[:, :3]), _in_platform(motion, wrench[:, 3:])], 1)


def _in_platform(motion: Motion, vectors: Array) -> Array:
    rotation = motion.pose.rotation.as_matrix().reshape(-1, 3, 3)
    return np.asarray(np.einsum("nji,nj->ni", rotation, vectors), float)
