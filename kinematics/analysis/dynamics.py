"""Actuator forces of a motion: of the platform's mass, a wrench on it, gravity, and what legs and
links weigh.

Where only the platform has mass, J⁻ᵀ of the wrench that it needs. Of a serial arm's links, the
recursive Newton-Euler algorithm. Of a hexapod whose legs have inertia, platform and legs in closed
loops: one linear system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.platform_motion import motion_of_axes
from kinematics.foundation.arrays import Array, finite_array, freeze_fields
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.kinds.arm import Arm, inertia, pinocchio
from kinematics.kinds.hexapod import Hexapod
from kinematics.kinds.legged import MIN_AXIS_SINE, home_frames
from kinematics.machine.kind import controlled_twists
from kinematics.machine.load import Body, Leg
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.model import MovingPose
from kinematics.machine.motion import AxesAndPose, Motion, controlled_jacobian
from kinematics.machine.pose import to_numbers


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """A free platform, and legs on it that are cut at their platform joints and closed by
    constraints.

    model        pinocchio's tree: the platform (6 freedoms, in its own frame), then per leg two
                 turns and the stroke
    constraints  one per leg: rod and platform have their joint's centre in common
    driven       (n,) indices of the strokes among the velocities
    """

    model: Any
    constraints: tuple[Any, ...]
    driven: np.ndarray


def closed_loop(
    machine: Hexapod, legs: Sequence[Leg], platform: Body, gravity: Array
) -> ClosedLoop:
    """The hexapod with universal joints on the base and spherical joints on the platform."""
    pin = pinocchio("a hexapod whose legs have inertia")
    model, none, driven, ends = pin.Model(), pin.SE3.Identity(), [], []
    model.gravity.linear[:] = gravity
    plate = model.addJoint(0, pin.JointModelFreeFlyer(), none, "platform")
    model.appendBodyToJoint(plate, inertia(platform), none)
    for axis, leg, frame, base in zip(
        machine.axes, legs, home_frames(machine, legs), machine.base, strict=True
    ):
        first = model.addJoint(
            0, pin.JointModelRX(), pin.SE3(frame, base), f"{axis.name} first turn"
        )
        second = model.addJoint(first, pin.JointModelRY(), none, f"{axis.name} second turn")
        stroke = model.addJoint(second, pin.JointModelPZ(), none, f"{axis.name} stroke")
        model.appendBodyToJoint(second, inertia(leg.barrel), none)
        model.appendBodyToJoint(stroke, inertia(leg.rod), none)
        driven.append(model.joints[stroke].idx_v)
        ends.append(stroke)
    constraints = tuple(
        pin.RigidConstraintModel(
            pin.ContactType.CONTACT_3D,
            model,
            end,
            none,
            plate,
            pin.SE3(np.eye(3), joint),
            pin.ReferenceFrame.LOCAL,
        )
        for end, joint in zip(ends, machine.platform, strict=True)
    )
    return ClosedLoop(model, constraints, np.array(driven))


def states(machine: Hexapod, legs: Sequence[Leg], motion: Motion) -> tuple[Array, Array, Array]:
    """Coordinates (N, 25), velocities and accelerations (N, 24) of the tree in which all loops are
    closed.

    A leg along u in its base frame is turned by θ₁ = atan2(−u_y, u_z) and θ₂ = atan2(u_x, √(u_y² +
    u_z²)).
    """
    x = ca.SX.sym("x", 12)
    moving = MovingPose(x)
    joints = []
    for base, end, frame in zip(
        machine.base, machine.platform, home_frames(machine, legs), strict=True
    ):
        u = frame.T @ (moving.position + moving.rotation @ end - base)
        joints += [
            ca.atan2(-u[1], u[2]),
            ca.atan2(u[0], ca.sqrt(u[1] ** 2 + u[2] ** 2)),
            ca.norm_2(u),
        ]
    inputs = ca.vertcat(x, moving.twist, moving.acceleration)
    leg_rates = Expression(
        "leg_rates", inputs, ca.vertcat(*moving.derivatives(ca.vertcat(*joints)))
    )
    values = leg_rates(
        np.concatenate([to_numbers(motion.pose), motion.twist, motion.acceleration], 1)
    )
    turned, turned_rate, turned_rate2 = np.split(values, 3, 1)
    locked = np.cos(turned[:, 1::3]) < MIN_AXIS_SINE
    if locked.any():
        instant, leg = np.argwhere(locked)[0]
        raise MotionError(
            f"machine {machine.name}: at instant {instant} {machine.axes[leg].name} lies along the first axis of its "
            "universal joint, which cannot swing it from there; choose another first_axis"
        )
    linear, spin = motion.twist[:, :3], motion.twist[:, 3:]
    # the platform's own velocity components change with the frame that they are along, too
    apparent = motion.acceleration[:, :3] - np.cross(spin, linear)
    local = [
        _in_platform(motion, each) for each in (linear, spin, apparent, motion.acceleration[:, 3:])
    ]
    place = [np.atleast_2d(motion.pose.translation), np.atleast_2d(motion.pose.rotation.as_quat())]
    return (
        np.concatenate([*place, turned], 1),
        np.concatenate([*local[:2], turned_rate], 1),
        np.concatenate([*local[2:], turned_rate2], 1),
    )


def leg_forces(
    machine: Hexapod,
    legs: Sequence[Leg],
    motion: Motion,
    platform: Body,
    wrench: Array,
    gravity: Array,
) -> Array:
    """(N, 6) N along the legs: M v̇ + h = B f + Jᵀ λ + wrench, solved for forces f (6) and joint
    forces λ (18) at once.

    Raises MotionError at a singular pose, and where a leg lies along the first axis of its
    universal joint.
    """
    controlled_jacobian(machine, to_numbers(motion.pose), motion.q)  # refuses what is singular
    pin, loop = (
        pinocchio("a hexapod whose legs have inertia"),
        closed_loop(machine, legs, platform, gravity),
    )
    model, data = loop.model, loop.model.createData()
    closings = [(constraint, constraint.createData()) for constraint in loop.constraints]
    n, count = model.nv, len(motion)
    system, needed = np.zeros((count, n, n)), np.empty((count, n))
    system[:, loop.driven, np.arange(len(loop.driven))] = 1.0
    for k, (q, v, a) in enumerate(zip(*states(machine, legs, motion), strict=True)):
        needed[k] = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        for leg, (constraint, state) in enumerate(closings):
            constraint.calc(
                model, data, state
            )  # getConstraintJacobian reads what this leaves behind
            columns = slice(6 + 3 * leg, 9 + 3 * leg)
            system[k, :, columns] = pin.getConstraintJacobian(model, data, constraint, state).T
    needed[:, :6] -= local_wrench(motion, wrench)
    return np.asarray(np.linalg.solve(system, needed[:, :, None])[:, : len(loop.driven), 0], float)


def local_wrench(motion: Motion, wrench: Array) -> Array:
    """(N, 6) a wrench at the platform's origin, along the platform's axes instead of the base's."""
    return np.concatenate(
        [_in_platform(motion, wrench[:, :3]), _in_platform(motion, wrench[:, 3:])], 1
    )


def _in_platform(motion: Motion, vectors: Array) -> Array:
    rotation = motion.pose.rotation.as_matrix().reshape(-1, 3, 3)
    return np.asarray(np.einsum("nji,nj->ni", rotation, vectors), float)


def arm_model(arm: Arm, gravity: Array) -> Any:
    """pinocchio's model of the joints and their links: every joint's frame is parallel to the
    base's at q = 0.
    """
    pin = pinocchio("the dynamics of an arm")
    model, on, parent = pin.Model(), np.zeros(3), 0
    model.gravity.linear[:] = gravity
    links = arm.joints.links or ((0.0, np.zeros(3), np.zeros((3, 3))),) * 3
    for axis, point, direction, link in zip(
        arm.axes, arm.joints.points, arm.joints.directions, links, strict=True
    ):
        placement = pin.SE3(np.eye(3), point - on)
        parent = model.addJoint(
            parent, pin.JointModelRevoluteUnaligned(direction), placement, axis.name
        )
        body = Body(*link, name=f"machine {arm.name}: what {axis.name} moves")
        model.appendBodyToJoint(parent, inertia(body), pin.SE3(np.eye(3), -point))
        on = point
    return model


def link_torques(arm: Arm, motion: Motion, gravity: Array) -> Array:
    """(N, 3) N·m: τ = M(q) q̈ + C(q, q̇) q̇ + g(q) of the links alone."""
    pin, model = pinocchio("the dynamics of an arm"), arm_model(arm, gravity)
    data = model.createData()
    rows = zip(motion.q, motion.qd, motion.qdd, strict=True)
    return np.array([pin.rnea(model, data, q, qd, qdd) for q, qd, qdd in rows])


def needed_wrench(body: Body, motion: Motion, gravity: Array) -> Array:
    """(N, 6) force and moment about the platform's origin, base frame, that move a body fixed to
    the platform.

    F = m (p̈ + ω̇ × c + ω × (ω × c) − g),    M = c × F + I ω̇ + ω × I ω,    with c and I turned
                                              into the base frame.
    """
    rotation = motion.pose.rotation.as_matrix().reshape(-1, 3, 3)
    arm = rotation @ body.centre
    inertia = rotation @ body.inertia @ rotation.swapaxes(1, 2)
    spin, turn = motion.twist[:, 3:], motion.acceleration[:, 3:]
    at_centre = (
        motion.acceleration[:, :3] + np.cross(turn, arm) + np.cross(spin, np.cross(spin, arm))
    )
    force = body.mass * (at_centre - gravity)
    moment = np.cross(arm, force) + _times(inertia, turn) + np.cross(spin, _times(inertia, spin))
    return np.concatenate([force, moment], 1)


def massless_forces(
    machine: Machine, motion: Motion, platform: Body, wrench: Array, gravity: Array
) -> Array:
    """(N, n) by virtual power, f · q̇ = (F − wrench) · ν for every motion that the machine has: Jᵀ
    f = Sᵀ (F − wrench).

    ν = S ν_c, the platform's twist by what is controlled; J has the columns of ν_c. Guides bear
    what is held.
    """
    need = needed_wrench(platform, motion, gravity) - wrench
    jacobian = controlled_jacobian(machine, to_numbers(motion.pose), motion.q)
    generalized = _times(_twists(machine, motion).swapaxes(1, 2), need)
    return np.asarray(
        np.linalg.solve(jacobian.swapaxes(1, 2), generalized[:, :, None])[:, :, 0], float
    )


def _twists(machine: Machine, motion: Motion) -> Array:
    """S (N, 6, n): the platform's twist of a unit of each controlled component, with what
    follows.
    """
    count, n = len(motion), len(machine.axes)
    unit = controlled_twists(machine, to_numbers(motion.pose))
    if not machine.follows:
        return unit
    inputs = machine.inputs(to_numbers(motion.pose), motion.q)
    still = np.zeros((count, 6))
    carried = [
        machine.rates_map(np.concatenate([inputs, unit[:, :, k], still], 1)) for k in range(n)
    ]
    return np.stack([rows[:, 2 * n : 2 * n + 6] for rows in carried], 2)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("nij,nj->ni", matrices, vectors), float)


# Share of a coordinate (of 1 m or rad at least) that a motion's may be off its pose's: rounding.
COORDINATE_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True)
class Forces(Result):
    """Actuator forces: force (N, n), N along a linear axis and N·m about a rotary one.

    Positive pushes towards greater q, so that force · q̇ is the power that the actuator gives.
    """

    machine: Machine
    motion: Motion = field(repr=False)
    force: Array

    def __post_init__(self) -> None:
        freeze_fields(self, "force")

    @property
    def power(self) -> Array:
        """(N, n) W; negative where the actuator brakes."""
        return np.asarray(self.force * self.motion.qd, float)

    @property
    def use(self) -> Array:
        """(n,) largest |force| as a share of each axis' max_force; 0 where it states none."""
        most = [np.inf if axis.max_force is None else axis.max_force for axis in self.machine.axes]
        return np.asarray(np.abs(self.force).max(0) / most, float)

    def tables(self) -> tuple[Table, ...]:
        """Of each axis the least and the largest force, and the largest power."""
        least, most = self.force.min(0), self.force.max(0)
        columns = (
            Column("axis", [axis.name for axis in self.machine.axes]),
            Column("least", least, self.units),
            Column("most", most, self.units),
            Column("power", np.abs(self.power).max(0), "W"),
        )
        return (Table(f"actuator forces of {self.machine.name}", columns),)

    @property
    def units(self) -> tuple[str, ...]:
        """N or N m of each axis."""
        return tuple("N" if axis.kind == "linear" else "N m" for axis in self.machine.axes)

    def data(self) -> Table:
        """Force and power of each axis, instant by instant."""
        axes = [*zip([axis.name for axis in self.machine.axes], self.units, strict=True)]
        forces = (
            Column(f"{name} force", self.force[:, k], unit) for k, (name, unit) in enumerate(axes)
        )
        power = (Column(f"{name} power", self.power[:, k], "W") for k, (name, _) in enumerate(axes))
        instants = Column("instant", range(len(self.force)))
        return Table(f"actuator forces of {self.machine.name}", (instants, *forces, *power))


@check_arguments("motion")
def forces(
    machine: MachineSource,
    motion: Motion | AxesAndPose,
    *,
    platform: Body | None = None,
    wrench: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    legs: Leg | Sequence[Leg] | None = None,
    reflected: ArrayLike | None = None,
) -> Forces:
    """Find the actuator forces of a motion by inverse dynamics, at each of its N instants.

    What is not given is as the machine states it (`Machine.load`, its axes), friction always;
    mostly that is nothing. An arm's links weigh what its URDF says.

    Parameters
    ----------
    machine
        That the motion is of.
    motion
        A `Motion`, or the state of a trajectory at N times.
    platform
        What moves with the platform's (tool's) frame, in that frame.
    wrench
        (6,) or (N, 6) N and N·m that act on the platform from outside at its origin, in the base
        frame.
    gravity
        (3,) m/s² in the base frame; None: as the machine states it, else down its vertical.
    legs
        A hexapod's leg, or six: then they have inertia, in closed loops.
    reflected
        kg or kg·m², one or (n,): rotors and screws as each axis feels them; adds reflected · q̈ to
        its force.

    Returns
    -------
    Forces
        (N, n) N or N·m, and the power.

    Raises
    ------
    MotionError
        A pose is singular, something does not fit the machine, or pinocchio is needed (legs, arm)
        and not installed.
    """
    machine = load_machine(machine)
    moving = _check_motion(
        machine, motion if isinstance(motion, Motion) else motion_of_axes(machine, motion)
    )
    n, count, name = len(machine.axes), len(moving), f"machine {machine.name}"
    if not count:
        raise MotionError(f"{name}: the motion has no instants")
    stated, inertias = machine.load, [axis.reflected for axis in machine.axes]
    body = stated.platform if platform is None else platform
    legs = (stated.legs or None) if legs is None else legs
    if not isinstance(body, Body):
        raise MotionError(f"{name}: platform must be a Body, not {body!r}")
    push = stated.wrench if wrench is None else wrench
    load = finite_array(push, f"{name}: wrench", (6,), (1, 6), (count, 6), unit="N and N·m")
    load = np.broadcast_to(load, (count, 6))
    down = finite_array(
        machine.gravity if gravity is None else gravity, f"{name}: gravity", (3,), unit="m/s²"
    )
    own = finite_array(
        inertias if reflected is None else reflected,
        f"{name}: reflected",
        (),
        (n,),
        unit="kg or kg·m²",
    )
    own = np.broadcast_to(own, (n,))
    if (own < 0).any():
        raise MotionError(
            f"machine {machine.name}: reflected inertias {own.tolist()} must not be below 0"
        )
    if legs is not None:
        if not isinstance(machine, Hexapod):
            raise MotionError(
                f"machine {machine.name} is not a hexapod: legs with inertia are known for hexapods only"
            )
        six = (
            (legs,)
            if isinstance(legs, Leg)
            else tuple(legs)
            if isinstance(legs, Sequence)
            else (legs,)
        )
        if len(six) not in (1, 6) or not all(isinstance(leg, Leg) for leg in six):
            kinds = ", ".join(sorted({type(leg).__name__ for leg in six}))
            raise MotionError(
                f"{name}: {len(six)} legs with inertia ({kinds}); give one Leg for all, or six"
            )
        found = leg_forces(machine, six * (6 // len(six)), moving, body, load, down)
    else:
        found = massless_forces(machine, moving, body, load, down)
        if isinstance(machine, Arm):
            found = found + link_torques(machine, moving, down)
    total = found + own * moving.qdd + moving.qd * [axis.friction for axis in machine.axes]
    if not np.isfinite(total).all():
        raise MotionError(
            f"{name}: loads and motion are too large for numbers; check their units (SI)"
        )
    return Forces(machine, moving, total)


def _check_motion(machine: Machine, motion: Motion) -> Motion:
    """The motion, if it is one of this machine: its coordinates are those of its poses."""
    n = len(machine.axes)
    if motion.q.shape[1] != n:
        raise MotionError(
            f"machine {machine.name} has {count_noun(n, 'axis')}; the motion has {motion.q.shape[1]}"
        )
    x = to_numbers(motion.pose)
    off = np.abs(machine.inverse_map(machine.inputs(x, motion.q)) - motion.q)
    if not (off <= COORDINATE_ROUNDING * np.maximum(1.0, np.abs(motion.q))).all():
        instant, k = np.argwhere(~(off <= COORDINATE_ROUNDING * np.maximum(1.0, np.abs(motion.q))))[
            0
        ]
        raise MotionError(
            f"machine {machine.name}: the motion is another machine's: at instant {instant} its {machine.axes[k].name} "
            f"is at {motion.q[instant, k]:.9g} {machine.axes[k].unit}, which is not what its pose needs here; make it "
            "by motion_of_poses of this machine"
        )
    return motion
