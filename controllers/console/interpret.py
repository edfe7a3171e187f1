"""What words do to a session that stands: (session, words) -> (session, reply, motion)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card import Refused
from controllers.console import cartesian, homing, selftest
from controllers.console.drives import JOG
from controllers.console.grammar import ROTARY
from controllers.console.motion import Motion, to
from controllers.console.session import Session
from controllers.console.words import Accept, Help, Home, Jog, Move, Position, Stop, Switch, Where, Words


@dataclass(frozen=True, slots=True)
class Answer:
    """reply: to say now; "" where the end of the motion is the answer. motion: to begin; None: nothing moves."""

    session: Session
    reply: str = ""
    motion: Motion | None = None
    jogging: bool = False


def interpret(session: Session, words: Words, t: float) -> Answer:
    """What follows from words at t (s), no motion being under way. Raises MotionError, and then nothing does."""
    match words:
        case Jog():
            return _jog(session, words, t)
        case Position():
            return _position(session, words, t)
        case Move():
            motion = cartesian.planned(session, words, t)
            return Answer(session, "DONE") if motion is None else Answer(session, motion=motion)
        case Home():
            changed = homing.placed(session, words)
            return Answer(changed, homing.told(changed, [axis for axis, _ in words.places]))
        case Accept():
            return _accept(session, t)
        case Switch(mode):
            changed = replace(session, mode=mode)
            return Answer(changed, selftest.report(session) if mode == "TEST" else f"{mode}: {_about(changed)}")
        case Stop():
            return Answer(session, f"STOPPED {session.told(t)}")
        case Where():
            return Answer(session, where(session, t))
        case Help():
            return Answer(session, _help(session))


def where(session: Session, t: float) -> str:
    """The registers, and the tool's place where it stands and all of them count from home."""
    told = session.told(t)
    if session.motion is None and not session.unknown():
        told += f" = {cartesian.told(session)}"
    return told


def offer(session: Session) -> str:
    """What a restart says of the axes: their last known positions, or that none are known."""
    if session.offered is None:
        names = session.drives.names
        return (
            f"position unknown: bring {' '.join(names)} to their switches and say HOME, or say where each stands, "
            f"HOME {names[0]} AT {homing.example(session, 0)}"
        )
    last_known = session.offered
    registers = session.drives.signs * (last_known.counts - last_known.zero)
    listed = list(zip(session.drives.names, registers, last_known.known, strict=True))
    last = " ".join(f"{name} {register}" for name, register, is_known in listed if is_known)
    lost = " ".join(name for name, _, is_known in listed if not is_known)
    return f"last known position {last}: ACCEPT or HOME" + (f"; {lost} unknown: HOME" if lost else "")


def _about(session: Session) -> str:
    if session.mode == "REM":
        names = " ".join(session.unknown())
        lost = f"; {names} not homed, so P knows the length of their travel alone" if names else ""
        return f"the remote line moves the axes; MAN takes them back{lost}"
    return "the console moves the axes"


def _help(session: Session) -> str:
    """The commands, with examples that this machine's axes can do."""
    drives = session.drives
    one, other = 0, min(2, len(drives.names) - 1)
    (a, inward), (b, onward) = ((drives.names[i], homing.inward(session, i)) for i in (one, other))
    also = f" {b} {onward} 20" if other != one else ""
    rotary = f"; {ROTARY} is also THETA" if ROTARY in drives.names else ""
    return (
        f"JOG {a} {inward} (a key or STOP ends it); POS {a} {inward} 100{also} (steps); "
        "MOVE x y z [rx ry rz] (mm, degrees, from home, in a straight line); "
        "PTP x y z [rx ry rz] (the same pose, every axis straight to its place, all together); "
        f"HOME {a} (its register is 0 here; where its place was not known, it stands at its switch); "
        f"HOME {a} AT {homing.example(session, one)} (so far from its switch, whatever was known); "
        "ACCEPT (the last known position); WHERE; STOP "
        "(each axis ramps down by itself; during a MOVE the tool leaves its line); "
        f"REM, MAN, TEST (modes); the axes are {', '.join(drives.names)}{rotary}"
    )


def _accept(session: Session, t: float) -> Answer:
    if session.offered is None:
        raise Refused("nothing is offered to accept: no position was saved, or an axis has moved since; say HOME")
    last = session.offered
    known = last.known & ~session.homed
    changed = replace(
        session.placed(np.flatnonzero(known).tolist(), last.counts),
        zero=np.where(known, last.zero, session.zero),
        offered=None,
    )
    return Answer(changed, f"ACCEPTED {changed.told(t)}")


def _jog(session: Session, words: Jog, t: float) -> Answer:
    drives, i = session.drives, words.axis
    low, high = session.window()
    target = np.array(session.counts)
    target[i] = (high if words.sign * drives.signs[i] > 0 else low)[i]
    way = target - session.counts
    fine, reason = cartesian.clear(session, lambda share: session.counts + np.rint(share * way))
    target = session.counts + np.rint(fine * way).astype(np.int64)
    if target[i] == session.counts[i]:
        raise Refused(f"axis {drives.names[i]} stands at its end: {reason or 'of travel'}; jog it the other way")
    return Answer(session, motion=to(drives, session.counts, target, drives.speed * JOG, t), jogging=True)


def _position(session: Session, words: Position, t: float) -> Answer:
    drives, target = session.drives, np.array(session.counts)
    for axis, steps in words.steps:
        target[axis] += drives.signs[axis] * steps
    low, high = session.window()
    for i in np.flatnonzero((target < low) | (target > high)):
        name, (first, last) = drives.names[i], homing.ends(session, int(i))
        known = "its travel" if session.homed[i] else "the length of its travel (not homed)"
        elsewhere = f"; if its slide stands elsewhere, say where: HOME {name} AT {homing.example(session, int(i))}"
        raise Refused(
            f"axis {name} to {session.registered(target)[i]} steps is outside {first} to {last}, {known}"
            f"{elsewhere if session.homed[i] else ''}"
        )
    if (target == session.counts).all():
        return Answer(session, "DONE")
    motion = to(drives, session.counts, target, drives.speed, t)
    fine, reason = cartesian.clear(session, lambda share: motion.counts(t + share * (motion.end - t)))
    if fine < 1:
        raise Refused(f"on the way {reason}; MOVE keeps clear of that if there is a line that does")
    return Answer(session, motion=motion)
