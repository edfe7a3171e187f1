"""Cartesian words: a straight line through the planner, from where the axes stand; and poses told in its units."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from controllers.card import Refused
from controllers.console.motion import PlannedMotion
from controllers.console.session import Session
from controllers.console.words import Move
from kinematics.errors import OutOfReach
from kinematics.forward import CONVERGED

NEAR = 1e-9
"""m and rad within which a pose is the one at which the tool stands."""


def planned(session: Session, words: Move, t: float) -> PlannedMotion | None:
    """The certified fastest motion along the line; None where the tool is there already.

    Raises Refused where an axis is not homed, and whatever the planner refuses with.
    """
    from planner.plan import plan
    from planner.program import Line, Program, Turn

    if unknown := session.unknown():
        raise Refused(f"{' '.join(unknown)} not homed: a line needs to know where all axes are; HOME or ACCEPT first")
    start, end = session.pose(), Rotation.from_euler("XYZ", words.pose[3:])
    way = np.linalg.norm(words.pose[:3] - start.translation)
    turn = (start.rotation.inv() * end).magnitude() if _turns(session) else 0.0
    if way <= NEAR and turn <= NEAR:
        return None
    rotate = end if turn > NEAR else None
    segment = Turn(end) if way <= NEAR else Line(words.pose[:3], rotate)
    program = Program((segment,), start=start, name="MOVE")
    found = plan(program, session.machine, clock_hz=session.drives.card.clock_hz)
    begins = [axis.start for axis in found.pulses.axes]
    if begins != session.counts.tolist():
        # the planner counts from the coordinates nearest home; the axes stand a turn or a branch away
        raise Refused(
            f"the plan begins at counts {begins}, the axes stand at {session.counts.tolist()}; go back by POS"
        )
    return PlannedMotion(t, found.pulses, found.trajectory)


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


def clear(session: Session, counts: np.ndarray) -> tuple[int, str]:
    """How many of the counts (N, n), in order, keep joints and clearances within limits, and what the next breaks.

    All of a machine that states no such limits, or whose axes are not all homed. What lies between is not looked at.
    """
    machine = session.machine
    if session.unknown() or not (machine.tilt_names or machine.bodies):
        return len(counts), ""
    pulse = np.array([axis.pulse for axis in machine.axes])
    try:
        found = machine.forward(machine.home_q + pulse * counts, certify=False)
    except OutOfReach as error:
        return 0, str(error)
    fine = machine.check(found.pose).ok & (found.residual <= CONVERGED)
    if fine.all():
        return len(counts), ""
    first = int(np.argmin(fine))
    return first, str(machine.check(found.pose[first]).worst())


_GROUPS = (("mm", False), ("deg", True))


def _turns(session: Session) -> bool:
    return any(name.startswith("r") for name in session.machine.freedom)
