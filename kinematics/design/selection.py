"""What motions need of a machine's actuators and joints, which of a catalogue can do it, and why
the others cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from math import inf
from typing import TYPE_CHECKING, Generic

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.dynamics import Forces
from kinematics.design.catalogue import Actuator, Joint, Part
from kinematics.design.sizing import SLACK
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.foundation.units import describe
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.motion import Motion
from kinematics.machine.pose import PoseLike, to_numbers

if TYPE_CHECKING:
    pass

UNITS = {"stroke": "mm", "speed": "mm/s", "force": "N", "precision": "um", "tilt": "deg"}
"""The unit in which a property is shown."""
SI = {"tilt": "rad", "stroke": "m", "speed": "m/s", "force": "N", "precision": "m"}


class _Need(Result):
    """Properties that are asked for."""

    __slots__ = ()

    def demands(self) -> dict[str, float]:
        """The properties that matter, SI, by name."""
        stated = ((name, getattr(self, name, None)) for name in SI)
        return {name: value for name, value in stated if value is not None}

    def tables(self) -> tuple[Table, ...]:
        """What is asked for; what does not matter is left out."""
        wanted = self.demands()
        units = [SI[name] for name in wanted]
        columns = (
            Column("property", [*wanted]),
            Column("needed", [*wanted.values()], units, "human"),
        )
        return (
            Table(f"{type(self).__name__.removesuffix('Need').lower()} that is needed", columns),
        )


@dataclass(frozen=True, slots=True)
class ActuatorNeed(_Need):
    """Requirements on every actuator: stroke (m), speed (m/s), force (N), coarsest precision (m).

    None: any.
    """

    stroke: float | None = None
    speed: float | None = None
    force: float | None = None
    precision: float | None = None

    def __post_init__(self) -> None:
        _check_need(self)


@dataclass(frozen=True, slots=True)
class JointNeed(_Need):
    """Requirements on every joint: tilt (rad) from its rest axis, force (N). None: any."""

    tilt: float | None = None
    force: float | None = None

    def __post_init__(self) -> None:
        _check_need(self)


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """q (m), qd (m/s) and optional force (N) of all axes over a motion, each (N, n)."""

    q: Array
    qd: Array
    force: Array | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            array = finite_array(value, f"motion: {field.name}")
            if array.ndim != 2 or not array.size:
                raise MotionError(
                    f"motion: {field.name} must be finite numbers (N, axes), not shape {array.shape}"
                )
            if array.shape != np.shape(self.q):
                raise MotionError(
                    f"motion: {field.name} is {array.shape}, q is {np.shape(self.q)}: (N, axes) of both"
                )
            object.__setattr__(self, field.name, freeze_array(array))


@check_arguments()
def actuator_need(
    motions: Iterable[AxisMotion | Motion | Forces], precision: float | None = None
) -> ActuatorNeed:
    """Requirements on one type of linear actuator used on all axes, for all motions.

    stroke = maxᵢ (max q_i − min q_i) over all motions together; speed = max |qd|; force = max
    |force|.

    Parameters
    ----------
    motions
        Also as `forces` or `motion_of_poses` returns them.
    precision
        m, the coarsest that will do. None: any.

    Returns
    -------
    ActuatorNeed
        Without force where the motions have none.

    Raises
    ------
    MotionError
        There is no motion, the motions are of different machines, or only some have forces.
    """
    runs = [_read_motion(motion) for motion in motions]
    if not runs or len({run.q.shape[1] for run in runs}) > 1:
        raise MotionError("selection needs at least one motion, all of the same axes")
    q = np.concatenate([run.q for run in runs])
    forces = [np.abs(run.force).max() for run in runs if run.force is not None]
    if len(forces) not in (0, len(runs)):
        raise MotionError(
            f"{len(forces)} of {len(runs)} motions have forces; give them for all, or for none"
        )
    return ActuatorNeed(
        stroke=float(np.ptp(q, axis=0).max()) or None,
        speed=float(max(np.abs(run.qd).max() for run in runs)) or None,
        force=float(max(forces)) or None if forces else None,
        precision=precision,
    )


def _read_motion(motion: AxisMotion | Motion | Forces) -> AxisMotion:
    match motion:
        case AxisMotion():
            return motion
        case Forces():
            return AxisMotion(motion.motion.q, motion.motion.qd, motion.force)
        case Motion():
            return AxisMotion(motion.q, motion.qd)
        case _:
            raise MotionError(
                f"selection: {motion!r} is no motion; give AxisMotion, Motion or Forces"
            )


@check_arguments("machine", "pose")
def joint_need(machine: MachineSource, pose: PoseLike, force: ArrayLike | None = None) -> JointNeed:
    """Requirements on one type of joint used everywhere.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    pose
        N poses, over which the largest tilt is taken.
    force
        N, of any shape, of which the largest size is taken. None: any will do.

    Returns
    -------
    JointNeed
        The largest tilt, and the largest force.

    Raises
    ------
    MotionError
        The machine has no joints that tilt.
    """
    machine = load_machine(machine)
    if not machine.tilt_names:
        raise MotionError(f"machine {machine.name} has no joints that tilt")
    pose = machine.read_pose(pose)
    machine.inverse(pose)  # refuses what cannot be reached
    if force is not None and not np.size(
        force := finite_array(force, "joint_need: force", unit="N")
    ):
        raise MotionError(
            "joint_need: force is empty; give the forces of the joints in N, or None where any will do"
        )
    tilt = float(np.arccos(np.clip(machine.tilt_map(to_numbers(pose)), -1.0, 1.0)).max())
    return JointNeed(tilt or None, None if force is None else float(np.abs(force).max()) or None)


def _check_need(need: ActuatorNeed | JointNeed) -> None:
    for name, value in need.demands().items():
        if not finite_array(value, f"needed {name}", (), unit="SI units") > 0:
            raise MotionError(
                f"needed {name} {describe(value, UNITS[name])} must be positive and finite, or None"
            )


AnyPart = Actuator | Joint

_UPPER_BOUNDED = ("precision",)
"""Properties of which a part may offer no more than the need; of all others it must offer no
less.
"""


@dataclass(frozen=True, slots=True)
class Choice(Generic[Part]):
    """A part that does: `reserve` is the smallest offered/needed over all properties, at
    `tightest`.
    """

    part: Part
    reserve: float
    tightest: str


@dataclass(frozen=True, slots=True)
class Refusal(Generic[Part]):
    """A part that does not, and every reason."""

    part: Part
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Selection(Result, Generic[Part]):
    """Feasible parts, best first by `criterion`, and rejected parts with their reasons."""

    need: ActuatorNeed | JointNeed
    criterion: str
    feasible: tuple[Choice[Part], ...]
    refused: tuple[Refusal[Part], ...]

    def tables(self) -> tuple[Table, ...]:
        """The parts in their order, then those that do not, and why."""
        wanted = ", ".join(
            f"{name} {describe(value, UNITS[name])}" for name, value in self.need.demands().items()
        )
        parts: list[AnyPart] = [
            *(choice.part for choice in self.feasible),
            *(out.part for out in self.refused),
        ]
        others = [None] * len(self.refused)
        columns = (
            Column("rank", [*range(1, len(self.feasible) + 1), *others]),
            Column("part", [part.name for part in parts]),
            Column("cost from", [part.cost and part.cost[0] for part in parts]),
            Column("to", [part.cost and part.cost[1] for part in parts]),
            Column("mass", [part.mass for part in parts], "kg", "human"),
            Column("reserve", [*(choice.reserve for choice in self.feasible), *others], form=".2f"),
            Column(
                "tightest, or why not",
                [
                    *(choice.tightest for choice in self.feasible),
                    *("; ".join(out.reasons) for out in self.refused),
                ],
            ),
        )
        return (Table(f"needed: {wanted}; ranked by {self.criterion}", columns),)


_CRITERIA: dict[str, tuple[str, Callable[[AnyPart, float], float | None]]] = {
    "cost": (
        "the upper end of the stated price, cheapest first",
        lambda part, reserve: part.cost and part.cost[1],
    ),
    "mass": ("mass, lightest first", lambda part, reserve: part.mass),
    "precision": ("precision, finest first", lambda part, reserve: part.precision),
    "reserve": ("the smallest offered/needed, largest first", lambda part, reserve: -reserve),
}


@check_arguments()
def select_parts(
    parts: Sequence[Part], need: ActuatorNeed | JointNeed, by: str = "cost"
) -> Selection[Part]:
    """Rank the parts that meet the requirements; list the reasons against all others.

    A property that is needed but not stated counts as not offered.

    Parameters
    ----------
    parts
        Actuators or joints, as from a catalogue.
    need
        What they must offer.
    by
        "cost", "mass", "precision" or "reserve": parts of which it is not stated come last; ties go
        to the larger
        reserve, then to the catalogue's order.

    Returns
    -------
    Selection
        Feasible parts, the best first, and refusals with their reasons.

    Raises
    ------
    MotionError
        The need is one of the other kind of part or empty, or the criterion is unknown.
    """
    if by not in _CRITERIA:
        raise MotionError(
            f'no criterion "{by}"{nearest(by, _CRITERIA)}; criteria: {", ".join(_CRITERIA)}'
        )
    wanted = need.demands()
    if not wanted:
        raise MotionError("selection: no requirement; state at least one property")
    feasible: list[Choice[Part]] = []
    refused: list[Refusal[Part]] = []
    for part in parts:
        foreign = [name for name in wanted if not hasattr(part, name)]
        if foreign:
            raise MotionError(f"{part.name}: {type(part).__name__.lower()}s have no {foreign[0]}")
        reasons = tuple(
            filter(None, (_reason(part, name, value) for name, value in wanted.items()))
        )
        if reasons:
            refused.append(Refusal(part, reasons))
        else:
            reserve = {
                name: _ratio(name, getattr(part, name), value) for name, value in wanted.items()
            }
            tightest = min(reserve, key=reserve.__getitem__)
            feasible.append(Choice(part, reserve[tightest], tightest))
    text, key = _CRITERIA[by]
    feasible.sort(
        key=lambda choice: (_none_last(key(choice.part, choice.reserve)), -choice.reserve)
    )
    return Selection(need, f"{text}; not stated last", tuple(feasible), tuple(refused))


def _none_last(value: float | None) -> float:
    return inf if value is None else value


def _ratio(name: str, offered: float, needed: float) -> float:
    return needed / offered if name in _UPPER_BOUNDED else offered / needed


def _reason(part: AnyPart, name: str, needed: float) -> str | None:
    offered, unit = getattr(part, name), UNITS[name]
    if offered is None:
        return f"{name} not stated, {describe(needed, unit)} needed"
    if _ratio(name, offered, needed) >= 1 - SLACK:
        return None
    sign = ">" if name in _UPPER_BOUNDED else "<"
    return f"{name} {describe(offered, unit)} {sign} {describe(needed, unit)}"
