"""Actuator forces of a motion: of the platform's mass, a wrench on it and gravity, and of what legs and links weigh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arm import Arm
from kinematics.arm_dynamics import link_torques
from kinematics.array import Array, finite, frozen
from kinematics.body import Body, Leg
from kinematics.closed_loop import leg_forces
from kinematics.errors import MotionError
from kinematics.hexapod import Hexapod
from kinematics.machine import Machine
from kinematics.massless import massless_forces
from kinematics.motion import Motion, Moving, motion_of_axes
from kinematics.pose import numbers
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Share of a coordinate (of 1 m or rad at least) that a motion's may be off its pose's: rounding.
OTHER = 1e-9


@dataclass(frozen=True, slots=True)
class Forces(Result):
    """force (N, n): what each actuator gives, N along a linear axis and N·m about a rotary one.

    Positive pushes towards greater q, so that force · q̇ is the power that the actuator gives.
    """

    machine: Machine
    motion: Motion = field(repr=False)
    force: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "force", frozen(self.force))

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
        forces = (Column(f"{name} force", self.force[:, k], unit) for k, (name, unit) in enumerate(axes))
        power = (Column(f"{name} power", self.power[:, k], "W") for k, (name, _) in enumerate(axes))
        instants = Column("instant", range(len(self.force)))
        return Table(f"actuator forces of {self.machine.name}", (instants, *forces, *power))

    def plot(self, ax: Axes | None = None, t: ArrayLike | None = None) -> Axes:
        """Force of every axis over the instants, or over their times t (N,) in s."""
        from kinematics.plots import force

        return force(self, None if t is None else np.asarray(t, float), ax)


def forces(
    machine: Machine,
    motion: Motion | Moving,
    *,
    platform: Body | None = None,
    wrench: ArrayLike | None = None,
    gravity: ArrayLike | None = None,
    legs: Leg | Sequence[Leg] | None = None,
    reflected: ArrayLike | None = None,
) -> Forces:
    """The forces that the actuators give in a motion, by inverse dynamics at every one of its N instants.

    motion     a `Motion`, or the state of a trajectory at N times
    platform   what moves with the platform's (tool's) frame, in that frame
    wrench     (6,) or (N, 6) N and N·m that act on the platform from outside at its origin, in the base frame
    gravity    (3,) m/s² in the base frame
    legs       a hexapod's leg, or six: then they have inertia, in closed loops
    reflected  kg or kg·m², one or (n,): rotors and screws as each axis feels them; adds reflected · q̈ to its force

    What is not given is as the machine states it (`Machine.load`, its axes), friction always; mostly that is nothing.
    An arm's links weigh what its URDF says. Raises MotionError for a singular pose, for what does not fit the machine,
    and where pinocchio is needed (legs, arm) but not installed.
    """
    moving = _own(machine, motion if isinstance(motion, Motion) else motion_of_axes(machine, motion))
    n, count, name = len(machine.axes), len(moving), f"machine {machine.name}"
    if not count:
        raise MotionError(f"{name}: the motion has no instants")
    stated, inertias = machine.load, [axis.reflected for axis in machine.axes]
    body = stated.platform if platform is None else platform
    legs = (stated.legs or None) if legs is None else legs
    if not isinstance(body, Body):
        raise MotionError(f"{name}: platform must be a Body, not {body!r}")
    push = stated.wrench if wrench is None else wrench
    load = finite(push, f"{name}: wrench", (6,), (1, 6), (count, 6), unit="N and N·m")
    load = np.broadcast_to(load, (count, 6))
    down = finite(stated.gravity if gravity is None else gravity, f"{name}: gravity", (3,), unit="m/s²")
    own = finite(inertias if reflected is None else reflected, f"{name}: reflected", (), (n,), unit="kg or kg·m²")
    own = np.broadcast_to(own, (n,))
    if (own < 0).any():
        raise MotionError(f"machine {machine.name}: reflected inertias {own.tolist()} must not be below 0")
    if legs is not None:
        if not isinstance(machine, Hexapod):
            raise MotionError(f"machine {machine.name} is no hexapod: legs with inertia are known for hexapods only")
        six = (legs,) if isinstance(legs, Leg) else tuple(legs) if isinstance(legs, Sequence) else (legs,)
        if len(six) not in (1, 6) or not all(isinstance(leg, Leg) for leg in six):
            kinds = ", ".join(sorted({type(leg).__name__ for leg in six}))
            raise MotionError(f"{name}: {len(six)} legs with inertia ({kinds}); give one Leg for all, or six")
        found = leg_forces(machine, six * (6 // len(six)), moving, body, load, down)
    else:
        found = massless_forces(machine, moving, body, load, down)
        if isinstance(machine, Arm):
            found = found + link_torques(machine, moving, down)
    total = found + own * moving.qdd + moving.qd * [axis.friction for axis in machine.axes]
    if not np.isfinite(total).all():
        raise MotionError(f"{name}: loads and motion are too large for numbers; check their units (SI)")
    return Forces(machine, moving, total)


def _own(machine: Machine, motion: Motion) -> Motion:
    """The motion, if it is one of this machine: its coordinates are those of its poses."""
    n = len(machine.axes)
    if motion.q.shape[1] != n:
        raise MotionError(f"machine {machine.name} has {n} axes; the motion has {motion.q.shape[1]}")
    x = numbers(motion.pose)
    off = np.abs(machine.inverse_map(machine.inputs(x, motion.q)) - motion.q)
    if not (off <= OTHER * np.maximum(1.0, np.abs(motion.q))).all():
        instant, k = np.argwhere(~(off <= OTHER * np.maximum(1.0, np.abs(motion.q))))[0]
        raise MotionError(
            f"machine {machine.name}: the motion is another machine's: at instant {instant} its {machine.axes[k].name} "
            f"is at {motion.q[instant, k]:.9g} {machine.axes[k].unit}, which is not what its pose needs here; make it "
            "by motion_of_poses of this machine"
        )
    return motion
