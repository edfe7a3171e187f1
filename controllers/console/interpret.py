"""What words do to a session that stands: (session, words) -> (session, reply, motion).

The self-test runs every axis end to end on the card alone, its pulses counted one by one; the
machine does not move. Cartesian words ask for a line or a synchronised move through the planner,
from where the axes stand, or tell poses. HOME sets the register's zero, which may be any place of
the travel [Sasidhar 1981, F.5]. What the slide may still do is another matter: it is counted from
the switch, so HOME never takes one for the other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from controllers.card import Refused
from controllers.console.grammar import (
    ROTARY,
    Accept,
    Halt,
    Help,
    Home,
    Jog,
    Move,
    Position,
    Switch,
    Where,
    Words,
)
from controllers.console.motion import (
    JOG_SPEED_SHARE,
    WHOLE_TOLERANCE,
    PlannedMotion,
    SessionMotion,
    trapezoid_motion,
)
from controllers.console.session import Session
from kinematics.analysis.forward import RESIDUAL_TOLERANCE
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.names import count_noun
from kinematics.foundation.units import quantity
from kinematics.machine.axis import Axis
from kinematics.machine.pose import Pose
from planner.pulses.schedule import COUNTER


@dataclass(frozen=True, slots=True)
class Answer:
    """reply: to say now; "" where the end of the motion is the answer. motion: to begin; None:
    nothing moves.
    """

    session: Session
    reply: str = ""
    motion: SessionMotion | None = None
    jogging: bool = False


def interpret(session: Session, words: Words, t: float) -> Answer:
    """What follows from words at t (s), no motion being under way.

    Raises MotionError, and then nothing does.
    """
    match words:
        case Jog():
            return _jog(session, words, t)
        case Position():
            return _position(session, words, t)
        case Move():
            motion = plan_move(session, words, t)
            return Answer(session, "DONE") if motion is None else Answer(session, motion=motion)
        case Home():
            changed = set_home(session, words)
            return Answer(changed, describe_homes(changed, [axis for axis, _ in words.places]))
        case Accept():
            return _accept(session, t)
        case Switch(mode):
            changed = replace(session, mode=mode)
            return Answer(
                changed, report(session) if mode == "TEST" else f"{mode}: {_describe_mode(changed)}"
            )
        case Halt():
            return Answer(session, f"STOPPED {session.describe(t)}")
        case Where():
            return Answer(session, describe_registers(session, t))
        case Help():
            return Answer(session, _help(session))


def describe_registers(session: Session, t: float) -> str:
    """The registers, and the tool's place where it stands and all of them count from home."""
    words = session.describe(t)
    if session.motion is None and not session.unknown():
        words += f" = {describe_tool(session)}"
    if session.unknown():
        words += " (?: not counted from home)"
    return words


def describe_offer(session: Session) -> str:
    """What a restart says of the axes: their last known positions, or that none are known."""
    if session.offered is None:
        names = session.drives.names
        return (
            f"position unknown: bring {' '.join(names)} to their switches and say HOME, or say where each stands, "
            f"HOME {names[0]} AT {example(session, 0)}"
        )
    last_known = session.offered
    registers = session.drives.signs * (last_known.counts - last_known.zero)
    listed = list(zip(session.drives.names, registers, last_known.known, strict=True))
    last = " ".join(f"{name} {register}" for name, register, is_known in listed if is_known)
    lost = " ".join(name for name, _, is_known in listed if not is_known)
    return f"last known position {last}: ACCEPT or HOME" + (
        f"; {lost} unknown: HOME" if lost else ""
    )


def _describe_mode(session: Session) -> str:
    if session.mode == "REM":
        names = " ".join(session.unknown())
        lost = f"; {names} not homed, so P limits them by travel length only" if names else ""
        return f"remote control; MAN returns to manual mode{lost}"
    return "manual control"


def _help(session: Session) -> str:
    """The commands, with examples that this machine's axes can do."""
    drives = session.drives
    one, other = 0, min(2, len(drives.names) - 1)
    (a, way), (b, far) = ((drives.names[i], describe_inward_turn(session, i)) for i in (one, other))
    also = f" {b} {far} 20" if other != one else ""
    rotary = f"; {ROTARY} is also THETA" if ROTARY in drives.names else ""
    return (
        f"JOG {a} {way} (a key or STOP ends it); POS {a} {way} 100{also} (steps); "
        "MOVE x y z [rx ry rz] (mm, degrees, from home, in a straight line); "
        "PTP x y z [rx ry rz] (the same pose, axes synchronised, no straight line); "
        f"HOME {a} (sets its register to 0 here; if its position was unknown, it is taken to be at its home switch); "
        f"HOME {a} AT {example(session, one)} (states its distance from the home switch); "
        "ACCEPT (the last known position); WHERE; STOP "
        "(each axis decelerates independently; during a MOVE the tool leaves its line); "
        f"REM, MAN, TEST (modes); the axes are {', '.join(drives.names)}{rotary}"
    )


def _accept(session: Session, t: float) -> Answer:
    if session.offered is None:
        raise Refused(
            "nothing to accept: no position was saved, or an axis has moved since; give HOME"
        )
    last = session.offered
    known = last.known & ~session.homed
    changed = replace(
        session.place_axes(np.flatnonzero(known).tolist(), last.counts),
        zero=np.where(known, last.zero, session.zero),
        offered=None,
    )
    return Answer(changed, f"ACCEPTED {changed.describe(t)}")


def _jog(session: Session, words: Jog, t: float) -> Answer:
    drives, i = session.drives, words.axis
    low, high = session.window()
    target = np.array(session.counts)
    target[i] = (high if words.sign * drives.signs[i] > 0 else low)[i]
    way = target - session.counts
    fine, reason = clear(session, lambda share: session.counts + np.rint(share * way))
    target = session.counts + np.rint(fine * way).astype(np.int64)
    if target[i] == session.counts[i]:
        raise Refused(
            f"axis {drives.names[i]} cannot go further: {reason or 'end of travel'}; jog it the other way"
        )
    return Answer(
        session,
        motion=trapezoid_motion(drives, session.counts, target, drives.speed * JOG_SPEED_SHARE, t),
        jogging=True,
    )


def _position(session: Session, words: Position, t: float) -> Answer:
    drives, target = session.drives, np.array(session.counts)
    for axis, steps in words.steps:
        target[axis] += drives.signs[axis] * steps
    low, high = session.window()
    for i in np.flatnonzero((target < low) | (target > high)):
        name, (first, last) = drives.names[i], ends(session, int(i))
        known = "its travel" if session.homed[i] else "the length of its travel (not homed)"
        elsewhere = (
            f"; if its slide is elsewhere, state where: HOME {name} AT {example(session, int(i))}"
        )
        raise Refused(
            f"axis {name} to {session.read_registers(target)[i]} steps is outside {first} to {last}, {known}"
            f"{elsewhere if session.homed[i] else ''}"
        )
    if (target == session.counts).all():
        return Answer(session, "DONE")
    motion = trapezoid_motion(drives, session.counts, target, drives.speed, t)
    fine, reason = clear(session, lambda share: motion.counts(t + share * (motion.end - t)))
    if fine < 1:
        raise Refused(f"on the path {reason}; MOVE avoids that if a straight line does")
    return Answer(session, motion=motion)


MAX_TEST_STEPS = 200_000
"""Steps that an axis is tested over at most: an endless one would count for weeks."""


def report(session: Session) -> str:
    """A line about each axis: steps over its travel, their rate at most, its ramp, the time, and
    whether all fired.
    """
    drives, lines = (
        session.drives,
        ["TEST: commands are checked but not run; MAN returns to manual mode"],
    )
    for i, (name, axis) in enumerate(zip(drives.names, session.machine.axes, strict=True)):
        steps = int(min(drives.high[i] - drives.low[i], MAX_TEST_STEPS))
        target = np.zeros(len(drives.names), np.int64)
        target[i] = steps
        motion = trapezoid_motion(drives, np.zeros_like(target), target, drives.speed, 0.0)
        fired = int(motion.directions_between(0.0, np.inf)[i].sum())
        verdict = (
            "OK"
            if fired == steps == motion.counts(np.inf)[i]
            else f"FAULT: {count_noun(fired, 'pulse')} fired"
        )
        rate = f"{drives.speed[i]:.6g} steps/s at most after a ramp of {drives.ramp[i]:.0f}"
        lines.append(
            f"{name}: {count_noun(steps, 'step')} of {axis.pulse:.6g} {axis.unit}, {rate}, "
            f"{motion.end:.3f} s: {verdict}"
        )
    return "\n".join(lines)


STANDING_PULSES = 0.5 + WHOLE_TOLERANCE
"""Pulses of every axis within which a pose is the one at which the tool stands: it would be rounded
to it.
"""
MIN_TURN = 1e-9
"""rad from which a line turns the tool."""


def plan_move(session: Session, words: Move, t: float) -> PlannedMotion | None:
    """The certified fastest motion that is asked for; None where the tool is there already, to the
    pulse.

    A way of less than a pulse of every axis is none: with a turn it is a turn in place, not a line
    of nanometres. Raises Refused where an axis is not homed, and whatever the planner refuses with.
    """
    from planner.plan import plan
    from planner.program.model import Line, Program, Synchronised, Turn

    if unknown := session.unknown():
        raise Refused(
            f"{' '.join(unknown)} not homed: a pose needs all axis positions; HOME or ACCEPT on the console first"
        )
    start, end = session.pose(), Rotation.from_euler("XYZ", words.pose[3:])
    there = RigidTransform.from_components(words.pose[:3], end)
    if _pulses(session, there) <= STANDING_PULSES:
        return None
    facing = RigidTransform.from_components(words.pose[:3], start.rotation)
    turning = RigidTransform.from_components(start.translation, end)
    segment: Line | Turn | Synchronised
    if words.synchronised:
        segment = Synchronised(words.pose[:3], end if _has_rotation(session) else None)
    elif _pulses(session, facing) < 1 <= _pulses(session, turning):
        if _pulses(session, facing) <= STANDING_PULSES:
            start = facing  # so that what was rounded does not add up, turn after turn
        segment = Turn(end)
    else:
        turns = _has_rotation(session) and (start.rotation.inv() * end).magnitude() > MIN_TURN
        segment = Line(words.pose[:3], end if turns else None)
    program = Program((segment,), start=start, name="PTP" if words.synchronised else "MOVE")
    found = plan(program, session.machine, clock_hz=session.drives.card.clock_hz)
    begins = [axis.start for axis in found.pulses.axes]
    if begins != session.counts.tolist():
        # the planner counts from the coordinates nearest home; the axes stand a turn or a branch
        # away
        raise Refused(
            f"the plan begins at counts {begins}, the axes stand at {session.counts.tolist()}; go back by POS"
        )
    return PlannedMotion(t, found.pulses, found.trajectory)


def _pulses(session: Session, pose: Pose) -> float:
    """Pulses from where the axes stand to a pose relative to home, of the axis that has the most;
    inf: out of reach.
    """
    machine = session.machine
    try:
        q = machine.inverse(machine.home * pose, session.q())
    except OutOfReach:
        return np.inf
    return float(np.max(np.abs((q - session.q()) / [axis.pulse for axis in machine.axes])))


def describe_tool(session: Session) -> str:
    """Where the tool stands, relative to home: "x 1.5 y 0 z 25 mm rx 0 ry 0 rz 0 deg", of what the
    machine controls.
    """
    pose = session.pose()
    angles = pose.rotation.as_euler("XYZ", degrees=True)
    values = dict(
        zip(("x", "y", "z", "rx", "ry", "rz"), [*(pose.translation * 1e3), *angles], strict=True)
    )
    free = session.machine.freedom
    groups = [
        (unit, [n for n in values if n in free and n.startswith("r") == turn])
        for unit, turn in _GROUPS
    ]
    return " ".join(
        f"{' '.join(f'{n} {round(values[n], 4) + 0.0:.4f}' for n in names)} {unit}"
        for unit, names in groups
        if names
    )


CHECKED_PLACES = 65
"""Places at which joints and clearances are looked at along a way of single axes; what lies between
is not proved.
"""


def clear(session: Session, way: Callable[[float], np.ndarray]) -> tuple[float, str]:
    """The share of a way that keeps joints, clearances and room within their limits, and what the
    next look breaks.

    1 for a machine that states no such limits, or whose axes are not all homed. way: counts (n,) at
    a share of it.
    """
    machine = session.machine
    if session.unknown() or not (
        machine.tilt_names or machine.bodies or np.isfinite(machine.room).any()
    ):
        return 1.0, ""
    counts = np.stack([way(look / (CHECKED_PLACES - 1)) for look in range(1, CHECKED_PLACES)])
    pulse = np.array([axis.pulse for axis in machine.axes])
    try:
        found = machine.forward(machine.home_q + pulse * counts, certify=False)
    except OutOfReach as error:
        return 0.0, str(error)
    fine = machine.check(found.pose).ok & (found.residual <= RESIDUAL_TOLERANCE)
    if fine.all():
        return 1.0, ""
    first = int(np.argmin(fine))
    return first / (CHECKED_PLACES - 1), str(machine.check(found.pose[first]).worst())


_GROUPS = (("mm", False), ("deg", True))


def _has_rotation(session: Session) -> bool:
    return any(name.startswith("r") for name in session.machine.freedom)


SHOWN_UNITS = {"linear": ("mm", 1e3), "rotary": ("deg", 180 / np.pi)}


def set_home(session: Session, words: Home) -> Session:
    """The session with HOME said.

    Raises Refused for a place outside the travel, or one that cannot be the switch.
    """
    counts = np.array(session.counts)
    for axis, said in words.places:
        if said is not None:
            counts[axis] = _parse_place(session, axis, said)
        elif not session.homed[axis]:
            counts[axis] = 0
            _refuse_switch(session, axis)
    return session.place_axes([axis for axis, _ in words.places], counts)


def describe_homes(session: Session, axes: Sequence[int]) -> str:
    """What holds now: "HOME X: register 0; X at 609.6 mm of its travel, 0 to 1219.2 mm, steps
    -38400 to 38400".
    """
    names = " ".join(session.drives.names[axis] for axis in axes)
    return "; ".join(
        [f"HOME {names}: register 0", *(_describe_axis(session, axis) for axis in axes)]
    )


def ends(session: Session, axis: int) -> tuple[int, int]:
    """Between what its register may go."""
    first, last = sorted(int(session.read_registers(end)[axis]) for end in session.window())
    return first, last


def describe_inward_turn(session: Session, axis: int) -> str:
    """The turn of the motor that leads towards the farther end."""
    low, high = session.window()
    up = high[axis] - session.counts[axis] >= session.counts[axis] - low[axis]
    return "CW" if up == (session.drives.signs[axis] > 0) else "CCW"


def example(session: Session, axis: int) -> str:
    """A place that it may have, as HOME takes it."""
    driven = session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    middle = sum(driven.travel) / 2 * scale if np.isfinite(driven.travel).all() else 90.0
    return f"{middle:.3g} {unit}"


def _describe_axis(session: Session, axis: int) -> str:
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    place = f"{name} at {_format_number(session.counts[axis] * driven.pulse * scale)} {unit}"
    if not np.isfinite(driven.travel).all():
        return place
    first, last = ends(session, axis)
    return f"{place} of {_span(driven)}, steps {first} to {last}"


def _format_number(value: float) -> str:
    return f"{round(value, 4) + 0.0:.10g}"


def _parse_place(session: Session, axis: int, said: str) -> int:
    """The counter where the slide stands as was said."""
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    try:
        place = quantity(said, driven.unit)
    except MotionError as error:
        raise Refused(f"HOME {name} AT {said}: {error}") from None
    low, high = min(driven.travel[0], 0.0), max(driven.travel[1], 0.0)
    if (
        not low - WHOLE_TOLERANCE * driven.pulse <= place <= high + WHOLE_TOLERANCE * driven.pulse
        or _is_beyond_counter(place / driven.pulse)
    ):
        raise Refused(f"HOME {name} AT {said} is outside {_span(driven)}")
    first, last = (int(end[axis]) for end in session.drives.reach())
    return min(max(int(np.rint(place / driven.pulse)), first), last)


def _is_beyond_counter(count: float) -> bool:
    return not COUNTER[0] <= count <= COUNTER[1]


def _span(driven: Axis) -> str:
    unit, scale = SHOWN_UNITS[driven.kind]
    if not np.isfinite(driven.travel).all():
        return "what its counter holds"
    low, high = (_format_number(end * scale) for end in driven.travel)
    return f"its travel, {low} to {high} {unit}"


def _refuse_switch(session: Session, axis: int) -> None:
    """Raise Refused where it has been at places that would lie beyond its travel, if this one were
    the switch.
    """
    low, high = session.drives.reach()
    before, beyond = (
        session.least[axis] - session.counts[axis],
        session.most[axis] - session.counts[axis],
    )
    if before >= low[axis] and beyond <= high[axis]:
        return
    name, driven = session.drives.names[axis], session.machine.axes[axis]
    unit, scale = SHOWN_UNITS[driven.kind]
    way = (before if before < low[axis] else beyond) * driven.pulse * scale
    raise Refused(
        f"{name} has been {_format_number(way)} {unit} from here, which is not in {_span(driven)}, so "
        "this is not its switch; "
        f"say where the slide stands: HOME {name} AT {example(session, axis)}"
    )
