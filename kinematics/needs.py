"""What a set of motions needs of the actuators and joints of a machine."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite, frozen
from kinematics.dynamics import Forces
from kinematics.errors import MotionError
from kinematics.motion import Motion
from kinematics.pose import Pose, numbers
from kinematics.result import Result
from kinematics.table import Column, Table
from kinematics.units import describe, unit_value

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kinematics.machine import Machine

UNITS = {"stroke": "mm", "speed": "mm/s", "force": "N", "precision": "um", "tilt": "deg"}
"""The unit in which a property is shown."""
SI = {"tilt": "rad", "stroke": "m", "speed": "m/s", "force": "N", "precision": "m"}


class _Need(Result):
    """Properties that are asked for."""

    __slots__ = ()

    def asked(self) -> dict[str, float]:
        """The properties that matter, SI, by name."""
        stated = ((name, getattr(self, name, None)) for name in SI)
        return {name: value for name, value in stated if value is not None}

    def tables(self) -> tuple[Table, ...]:
        """What is asked for; what does not matter is left out."""
        wanted = self.asked()
        units = [SI[name] for name in wanted]
        columns = (Column("property", [*wanted]), Column("needed", [*wanted.values()], units, "human"))
        return (Table(f"{type(self).__name__.removesuffix('Need').lower()} that is needed", columns),)

    def plot(self, ax: Axes | None = None) -> Axes:
        """What is asked for, in the units of `UNITS`."""
        from kinematics.bars import bars

        wanted = self.asked()
        shown = [value / unit_value(UNITS[name], SI[name]) for name, value in wanted.items()]
        return bars([f"{name} ({UNITS[name]})" for name in wanted], shown, "needed", ax)


@dataclass(frozen=True, slots=True)
class ActuatorNeed(_Need):
    """What every actuator must offer: stroke (m), speed (m/s), force (N); precision (m) no coarser. None: no matter."""

    stroke: float | None = None
    speed: float | None = None
    force: float | None = None
    precision: float | None = None

    def __post_init__(self) -> None:
        _checked(self)


@dataclass(frozen=True, slots=True)
class JointNeed(_Need):
    """What every joint must offer: tilt (rad) from its rest axis, force (N). None: no matter."""

    tilt: float | None = None
    force: float | None = None

    def __post_init__(self) -> None:
        _checked(self)


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """q (m), qd (m/s) and force (N) of all axes over a motion, each (N, n); force may be left out."""

    q: Array
    qd: Array
    force: Array | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            array = finite(value, f"motion: {field.name}")
            if array.ndim != 2 or not array.size:
                raise MotionError(f"motion: {field.name} must be finite numbers (N, axes), not shape {array.shape}")
            if array.shape != np.shape(self.q):
                raise MotionError(f"motion: {field.name} is {array.shape}, q is {np.shape(self.q)}: (N, axes) of both")
            object.__setattr__(self, field.name, frozen(array))


def actuator_need(motions: Iterable[AxisMotion | Motion | Forces], precision: float | None = None) -> ActuatorNeed:
    """What one type of linear actuator on all axes needs for all motions, mounted once.

    A motion may be given as what `forces` or `motion_of_poses` returns.

    stroke = maxᵢ (max q_i − min q_i) over all motions together; speed = max |qd|; force = max |force|.
    Raises MotionError for no motion, motions of different machines, and forces of some of them only.
    """
    runs = [_run(motion) for motion in motions]
    if not runs or len({run.q.shape[1] for run in runs}) > 1:
        raise MotionError("selection needs at least one motion, all of the same axes")
    q = np.concatenate([run.q for run in runs])
    forces = [np.abs(run.force).max() for run in runs if run.force is not None]
    if len(forces) not in (0, len(runs)):
        raise MotionError(f"{len(forces)} of {len(runs)} motions have forces; give them for all, or for none")
    return ActuatorNeed(
        stroke=float(np.ptp(q, axis=0).max()) or None,
        speed=float(max(np.abs(run.qd).max() for run in runs)) or None,
        force=float(max(forces)) or None if forces else None,
        precision=precision,
    )


def _run(motion: AxisMotion | Motion | Forces) -> AxisMotion:
    match motion:
        case AxisMotion():
            return motion
        case Forces():
            return AxisMotion(motion.motion.q, motion.motion.qd, motion.force)
        case Motion():
            return AxisMotion(motion.q, motion.qd)
        case _:
            raise MotionError(f"selection: {motion!r} is no motion; give AxisMotion, Motion or Forces")


def joint_need(machine: Machine, pose: Pose, force: ArrayLike | None = None) -> JointNeed:
    """What one type of joint everywhere needs: the largest tilt over N poses, the largest |force| (any shape, N)."""
    if not machine.tilt_names:
        raise MotionError(f"machine {machine.name} has no joints that tilt")
    machine.inverse(pose)  # refuses what cannot be reached
    tilt = float(np.arccos(np.clip(machine.tilt_map(numbers(pose)), -1.0, 1.0)).max())
    return JointNeed(tilt or None, None if force is None else float(np.abs(finite(force, "force")).max()) or None)


def _checked(need: ActuatorNeed | JointNeed) -> None:
    for name, value in need.asked().items():
        if not finite(value, f"needed {name}", (), unit="SI units") > 0:
            raise MotionError(f"needed {name} {describe(value, UNITS[name])} must be positive and finite, or None")
