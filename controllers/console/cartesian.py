"""Cartesian words: a line or a synchronised move through the planner, from where the axes stand; and poses told."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from controllers.card import Refused
from controllers.console.drives import WHOLE
from controllers.console.motion import PlannedMotion
from controllers.console.session import Session
from controllers.console.words import Move
from kinematics.errors import OutOfReach
from kinematics.forward import CONVERGED
from kinematics.pose import Pose

STANDS = 0.5 + WHOLE
"""Pulses of every axis within which a pose is the one at which the tool stands: it would be rounded to it."""
TURNED = 1e-9
"""rad from which a line turns the tool."""


def planned(session: Session, words: Move, t: float) -> PlannedMotion | None:
    """The certified fastest motion that is asked for; None where the tool is there already, to the pulse.

    A way of less than a pulse of every axis is none: with a turn it is a turn in place, not a line of nanometres.
    Raises Refused where an axis is not homed, and whatever the planner refuses with.
    """
    from planner.plan import plan
    from planner.program import Line, Program, Synchronised, Turn

    if unknown := session.unknown():
        raise Refused(f"{' '.join(unknown)} not homed: a pose needs all places; HOME or ACCEPT on the console first")
    start, end = session.pose(), Rotation.from_euler("XYZ", words.pose[3:])
    there = RigidTransform.from_components(words.pose[:3], end)
    if _pulses(session, there) <= STANDS:
        return None
    facing = RigidTransform.from_components(words.pose[:3], start.rotation)
    turning = RigidTransform.from_components(start.translation, end)
    segment: Line | Turn | Synchronised
    if words.synchronised:
        segment = Synchronised(words.pose[:3], end if _turns(session) else None)
    elif _pulses(session, facing) < 1 <= _pulses(session, turning):
        if _pulses(session, facing) <= STANDS:
            start = facing  # so that what was rounded does not add up, turn after turn
        segment = Turn(end)
    else:
        turns = _turns(session) and (start.rotation.inv() * end).magnitude() > TURNED
        segment = Line(words.pose[:3], end if turns else None)
    program = Program((segment,), start=start, name="PTP" if words.synchronised else "MOVE")
    found = plan(program, session.machine, clock_hz=session.drives.card.clock_hz)
    begins = [axis.start for axis in found.pulses.axes]
    if begins != session.counts.tolist():
        # the planner counts from the coordinates nearest home; the axes stand a turn or a branch away
        raise Refused(
            f"the plan begins at counts {begins}, the axes stand at {session.counts.tolist()}; go back by POS"
        )
    return PlannedMotion(t, found.pulses, found.trajectory)


def _pulses(session: Session, pose: Pose) -> float:
    """Pulses from where the axes stand to a pose relative to home, of the axis that has the most; inf: out of reach."""
    machine = session.machine
    try:
        q = machine.inverse(machine.home * pose, session.q())
    except OutOfReach:
        return np.inf
    return float(np.max(np.abs((q - session.q()) / [axis.pulse for axis in machine.axes])))


def told(session: Session) -> str:
    """Where the tool stands, relative to home: "x 1.5 y 0 z 25 mm rx 0 ry 0 rz 0 deg", of what the machine controls."""
    pose = session.pose()
    angles = pose.rotation.as_euler("XYZ", degrees=True)
    values = dict(zip(("x", "y", "z", "rx", "ry", "rz"), [*(pose.translation * 1e3), *angles], strict=True))
    free = session.machine.freedom
    groups = [(unit, [n for n in values if n in free and n.startswith("r") == turn]) for unit, turn in _GROUPS]
    return " ".join(
        f"{' '.join(f'{n} {round(values[n], 4) + 0.0:.4f}' for n in names)} {unit}" for unit, names in groups if names
    )


LOOKS = 65
"""Places at which joints and clearances are looked at along a way of single axes; what lies between is not proved."""


def clear(session: Session, way: Callable[[float], np.ndarray]) -> tuple[float, str]:
    """The share of a way that keeps joints and clearances within their limits, and what the next look at it breaks.

    1 for a machine that states no such limits, or whose axes are not all homed. way: counts (n,) at a share of it.
    """
    machine = session.machine
    if session.unknown() or not (machine.tilt_names or machine.bodies):
        return 1.0, ""
    counts = np.stack([way(look / (LOOKS - 1)) for look in range(1, LOOKS)])
    pulse = np.array([axis.pulse for axis in machine.axes])
    try:
        found = machine.forward(machine.home_q + pulse * counts, certify=False)
    except OutOfReach as error:
        return 0.0, str(error)
    fine = machine.check(found.pose).ok & (found.residual <= CONVERGED)
    if fine.all():
        return 1.0, ""
    first = int(np.argmin(fine))
    return first / (LOOKS - 1), str(machine.check(found.pose[first]).worst())


_GROUPS = (("mm", False), ("deg", True))


def _turns(session: Session) -> bool:
    return any(name.startswith("r") for name in session.machine.freedom)
