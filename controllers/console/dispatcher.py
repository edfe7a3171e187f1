"""Who says what when: lines of the console and of remote lines, taken in turn, while a motion is under way or not."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

from controllers.console.grammar import (
    Accept,
    Halt,
    Help,
    Home,
    Jog,
    MisreadLine,
    Move,
    Position,
    Switch,
    Where,
    Words,
    parse_operator_line,
    remote,
)
from controllers.console.interpret import describe_registers, interpret
from controllers.console.links import TextLine
from controllers.console.motion import halt_motion
from controllers.console.session import Session
from kinematics.foundation.errors import MotionError

CONSOLE = 0
"""The operator's number; remote lines have numbers from 1 on."""
ERROR = "ERROR"
"""What a line begins with that says why nothing moved."""
WAITING = 16
"""Lines that may wait for a motion to end."""

Reply = tuple[int, str]
"""To whom, and what."""


@dataclass(frozen=True, slots=True)
class Dispatcher:
    """A session, and the lines that wait for its motion to end.

    told     who is told of that end
    waiting  (who, line) each, the first first
    stopped  whether the motion is one that a stop ends
    """

    session: Session
    told: tuple[int, ...] = ()
    waiting: tuple[tuple[int, TextLine], ...] = ()
    stopped: bool = False

    @property
    def end(self) -> float | None:
        """s, when the motion ends; None: there is none."""
        return None if self.session.motion is None else self.session.motion.end


def take_line(desk: Dispatcher, who: int, line: TextLine, t: float) -> tuple[Dispatcher, tuple[Reply, ...]]:
    """With a line that has come from someone at t. It acts when what came before it is done.

    STOP, WHERE and HELP act at once, and so does MAN on the console, which drops what remote lines wait with. Any line
    but WHERE ends a jog.
    """
    desk, replies = advance_time(desk, t)
    words = None
    if not line.fault:
        with suppress(MisreadLine):  # said in its turn
            words = _read(desk.session, who, line)
    outside = who != CONSOLE and desk.session.mode != "REM"  # it neither waits nor ends a jog, but may stop all
    if desk.session.motion is None or (outside and not isinstance(words, Halt)):
        return _prepend_replies(replies, _run(desk, who, line, t))
    match words:
        case Halt():
            return _prepend_replies(replies, _stop(replace(desk, told=tuple(dict.fromkeys((*desk.told, who)))), t))
        case Where():
            return desk, (*replies, (who, describe_registers(desk.session, t)))
        case Help() if not desk.session.jogging:
            return _prepend_replies(replies, _run(desk, who, line, t))
        case Switch() if who == CONSOLE and desk.session.mode == "REM":
            desk, dropped = _drop_waiting(desk, lambda other: other != CONSOLE, "the console")
            return _prepend_replies((*replies, *dropped), _run(desk, who, line, t))
    if desk.session.jogging:
        desk, more = _stop(desk, t)
        replies = (*replies, *more)
    if len(desk.waiting) == WAITING:
        return desk, (*replies, (who, f"{ERROR} {WAITING} commands wait already; no motion"))
    return replace(desk, waiting=(*desk.waiting, (who, line))), replies


def advance_time(desk: Dispatcher, t: float) -> tuple[Dispatcher, tuple[Reply, ...]]:
    """With the time come to t: a motion that ended is told of, and what waited for it is begun, as far as that goes."""
    replies: tuple[Reply, ...] = ()
    while desk.end is not None and desk.end <= t:
        now, session = desk.end, desk.session.ended()
        text = f"STOPPED {session.told(now)}" if desk.stopped or desk.session.jogging else "DONE"
        replies = (*replies, *((who, text) for who in desk.told))
        desk = replace(desk, session=session, told=(), stopped=False)
        while desk.waiting and desk.session.motion is None:
            (who, line), rest = desk.waiting[0], desk.waiting[1:]
            desk, more = _run(replace(desk, waiting=rest), who, line, now)
            replies = (*replies, *more)
    return desk, replies


def drop_remote(desk: Dispatcher, who: int) -> Dispatcher:
    """With a remote line gone: the motion under way goes on, what waits from there is not begun."""
    told = tuple(other for other in desk.told if other != who)
    return replace(desk, told=told, waiting=tuple(pair for pair in desk.waiting if pair[0] != who))


def _read(session: Session, who: int, line: TextLine) -> Words:
    return (parse_operator_line if who == CONSOLE else remote)(line.text, session.drives.names)


def _run(desk: Dispatcher, who: int, line: TextLine, t: float) -> tuple[Dispatcher, tuple[Reply, ...]]:
    session = desk.session
    try:
        if line.fault:
            raise MisreadLine(line.fault)
        words = _read(session, who, line)
        _allow(session, who, words)
        answer = interpret(session, words, t)
    except MotionError as error:
        return desk, ((who, f"{ERROR} {' '.join(str(error).split())}; no motion"),)
    reply = answer.reply
    changed = replace(desk, session=answer.session)
    if session.mode == "TEST" and isinstance(words, (Jog, Position, Move, Home, Accept)):
        told = reply if answer.motion is None else f"{answer.motion.end - t:.3f} s; no motion"
        return desk, ((who, f"TEST {told}"),)
    if answer.motion is not None:
        moving = answer.session.moving(answer.motion, answer.jogging)
        changed = replace(desk, session=moving, told=(who,), stopped=False)
    return changed, ((who, reply),) if reply else ()


def _allow(session: Session, who: int, words: Words) -> None:
    """Raise MotionError where someone may not say this in the mode that is on."""
    if isinstance(words, (Halt, Where, Help)):
        return
    if who != CONSOLE and session.mode != "REM":
        raise MotionError(f"the console is in mode {session.mode}; it hands over by REM")
    if who == CONSOLE and session.mode == "REM" and not isinstance(words, Switch):
        raise MotionError("the remote line has the axes; MAN takes them back")


def _stop(desk: Dispatcher, t: float) -> tuple[Dispatcher, tuple[Reply, ...]]:
    desk, replies = _drop_waiting(desk, lambda _: True, "STOP")
    motion = desk.session.motion
    if motion is None or desk.stopped:
        return desk, replies
    session = desk.session.moving(halt_motion(desk.session.drives, motion, t))
    return replace(desk, session=session, stopped=True), replies


def _drop_waiting(desk: Dispatcher, whose: Callable[[int], bool], by: str) -> tuple[Dispatcher, tuple[Reply, ...]]:
    gone = tuple((who, f"{ERROR} dropped by {by}; no motion") for who, _ in desk.waiting if whose(who))
    kept = tuple(pair for pair in desk.waiting if not whose(pair[0]))
    return replace(desk, waiting=kept), gone


def _prepend_replies(
    replies: tuple[Reply, ...], done: tuple[Dispatcher, tuple[Reply, ...]]
) -> tuple[Dispatcher, tuple[Reply, ...]]:
    return done[0], (*replies, *done[1])
