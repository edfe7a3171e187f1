"""What words do to a session that stands: (session, words) -> (session, reply, motion)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.card import Refused
from controllers.console import cartesian, selftest
from controllers.console.drives import JOG
from controllers.console.motion import Motion, to
from controllers.console.session import Session
from controllers.console.words import Accept, Help, Home, Jog, Move, Position, Stop, Switch, Where, Words

HELP = (
    "JOG X CW (a key or STOP ends it); POS X CW 100 Z CCW 20 (steps); MOVE x y z [rx ry rz] (mm, degrees, from home); "
    "HOME X (it stands at home: register 0); ACCEPT (the last known position); WHERE; STOP "
    "(each axis ramps down by itself; during a MOVE the tool leaves its line); "
    "REM, MAN, TEST (modes); the axes are "
)


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
        case Home(axes):
            counts, homed = np.array(session.counts), np.array(session.homed)
            counts[list(axes)], homed[list(axes)] = 0, True
            names = " ".join(session.drives.names[i] for i in axes)
            return Answer(replace(session, counts=counts, homed=homed), f"HOME {names}: register 0")
        case Accept():
            return _accept(session, t)
        case Switch(mode):
            changed = replace(session, mode=mode)
            return Answer(changed, selftest.report(session) if mode == "TEST" else f"{mode}: {_about(mode)}")
        case Stop():
            return Answer(session, f"STOPPED {session.told(t)}")
        case Where():
            return Answer(session, where(session, t))
        case Help():
            return Answer(session, HELP + ", ".join(session.drives.names))


def where(session: Session, t: float) -> str:
    """The registers, and the tool's place where it stands and all of them count from home."""
    told = session.told(t)
    if session.motion is None and not session.unknown():
        told += f" = {cartesian.told(session)}"
    return told


def offer(session: Session) -> str:
    """What a restart says of the axes: their last known positions, or that none are known."""
    if session.offered is None:
        return f"position unknown: bring {' '.join(session.drives.names)} home and say HOME"
    counts, known = session.offered
    listed = list(zip(session.drives.names, session.drives.signs * counts, known, strict=True))
    last = " ".join(f"{name} {register}" for name, register, is_known in listed if is_known)
    lost = " ".join(name for name, _, is_known in listed if not is_known)
    return f"last known position {last}: ACCEPT or HOME" + (f"; {lost} unknown: HOME" if lost else "")


def _about(mode: str) -> str:
    if mode == "REM":
        return "the remote line moves the axes; MAN takes them back"
    return "the console moves the axes"


def _accept(session: Session, t: float) -> Answer:
    if session.offered is None:
        raise Refused("nothing is offered to accept: no position was saved, or an axis has moved since; say HOME")
    counts, known = session.offered
    known = known & ~session.homed
    changed = replace(
        session, counts=np.where(known, counts, session.counts), homed=session.homed | known, offered=None
    )
    return Answer(changed, f"ACCEPTED {changed.told(t)}")


def _jog(session: Session, words: Jog, t: float) -> Answer:
    drives, i = session.drives, words.axis
    low, high = _ends(session)
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
    low, high = _ends(session)
    for i in np.flatnonzero((target < low) | (target > high)):
        ends = sorted(int(drives.signs[i] * end[i]) for end in (low, high))
        known = "its travel" if session.homed[i] else "the length of its travel (not homed)"
        raise Refused(
            f"axis {drives.names[i]} to {drives.signs[i] * target[i]} steps is outside {ends[0]} to {ends[1]}, {known}"
        )
    if (target == session.counts).all():
        return Answer(session, "DONE")
    motion = to(drives, session.counts, target, drives.speed, t)
    fine, reason = cartesian.clear(session, lambda share: motion.counts(t + share * (motion.end - t)))
    if fine < 1:
        raise Refused(f"on the way {reason}; MOVE keeps clear of that if there is a line that does")
    return Answer(session, motion=motion)


def _ends(session: Session) -> tuple[np.ndarray, np.ndarray]:
    """Counts (n,) between which each axis may go: of one that is not homed, a travel's length either way."""
    drives = session.drives
    length = drives.high - drives.low
    low = np.where(session.homed, drives.low, session.counts - length)
    high = np.where(session.homed, drives.high, session.counts + length)
    return drives.within(low, high)
