"""Rotations that a machine cannot make, because that angle of its platform follows from its other
axes.

The platform's orientation is Rx(θx) · Ry(θy) · Rz(θz). On a machine whose rz follows, as a
five-axis mill that turns its tool about two axes, no axis moves for a change of θz alone.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.rotations import find_angles
from kinematics.machine.machine import Machine
from planner.program.model import Program, SegmentStream, Turn

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

ANGLES = ("rx", "ry", "rz")
LEAST_TURN = 1e-9
"""rad: a smaller change of an angle is rounding."""
PART_TURN = 0.1
"""rad of a turn by which its angles are compared."""
POLE = 1e-6
"""Of |cos θy|: below it θx and θz are no angles of their own."""


def find_changed_angles(before: "Rotation", after: "Rotation") -> frozenset[str]:
    """Return which of θx, θy and θz differ between two orientations; none at the pole of θy."""
    matrices = np.stack([before.as_matrix(), after.as_matrix()])
    if (np.hypot(matrices[:, 0, 0], matrices[:, 0, 1]) < POLE).any():
        return frozenset()
    one, other = find_angles(matrices)
    change: Array = np.remainder(other - one + np.pi, 2 * np.pi) - np.pi
    return frozenset(
        name for name, angle in zip(ANGLES, change, strict=True) if abs(angle) > LEAST_TURN
    )


def find_turned_angles(turn: Turn, before: "Rotation") -> frozenset[str]:
    """Return the angles that a turn on the spot changes, also one by a whole number of turns."""
    if turn.about is None:
        return find_changed_angles(before, before if turn.to is None else turn.to)
    return find_changed_angles(before, begin_turn(turn.angle, np.asarray(turn.about)) * before)


def begin_turn(angle: float, axis: Array) -> "Rotation":
    """Return the first part of a turn about an axis (3,), as a whole turn ends where it starts."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(min(abs(angle), PART_TURN) * axis)


def refuse_lost_turn(before: "Rotation", after: "Rotation", machine: Machine) -> None:
    """Raise MotionError if only angles that follow differ between two orientations: no axis moves
    for that."""
    changed = find_changed_angles(before, after)
    if changed and changed <= frozenset(machine.follows):
        names = ", ".join(sorted(changed))
        raise MotionError(
            f"it changes only {names}, which the other axes of {machine.name} decide: no axis moves; omit it"
        )


def list_turned_angles(program: Program) -> frozenset[str]:
    """Return the angles that a program's orientations change. A file that is read again and again
    counts as none."""
    from scipy.spatial.transform import Rotation

    if isinstance(program.segments, SegmentStream):
        return frozenset()
    here = Rotation.identity() if program.start is None else program.start.rotation
    changed: set[str] = set()
    for segment in program.segments:
        stated = getattr(segment, "rotate", None)
        if stated is None:
            stated = getattr(segment, "to", None)
        if isinstance(stated, Rotation):
            for after in [stated] if stated.single else stated:
                changed |= find_changed_angles(here, after)
                here = after
        elif isinstance(segment, Turn) and segment.about is not None:
            changed |= find_turned_angles(segment, here)
            here = Rotation.from_rotvec(segment.angle * np.asarray(segment.about)) * here
    return frozenset(changed)


def describe_lost_angles(turned: Iterable[str], machine: Machine) -> str:
    """Return a warning of angles that a program changes and that follow on its machine; "": there
    are none."""
    lost = [name for name in ANGLES if name in turned and name in machine.follows]
    if not lost:
        return ""
    letters = ", ".join(f"{name} ({'ABC'[ANGLES.index(name)]})" for name in lost)
    return f"the other axes of {machine.name} decide {letters}: the program's rotations by it have no effect"
