"""The one loop over bytes, and who says what when.

It waits for all links at once, hands their lines to the dispatcher, and its replies back. Lines of
the console and of remote lines are taken in turn, while a motion is under way or not. A link that
anything may have opened is first asked to speak the console's language: a web page's POST shall
move nothing.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from time import monotonic

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
from controllers.console.links import Link, Partial, TextLine, Transport, Trust
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


def take_line(
    desk: Dispatcher, who: int, line: TextLine, t: float
) -> tuple[Dispatcher, tuple[Reply, ...]]:
    """With a line that has come from someone at t. It acts when what came before it is done.

    STOP, WHERE and HELP act at once, and so does MAN on the console, which drops what remote lines
    wait with. Any line but WHERE ends a jog.
    """
    desk, replies = advance_time(desk, t)
    words = None
    if not line.fault:
        with suppress(MisreadLine):  # said in its turn
            words = _read(desk.session, who, line)
    outside = (
        who != CONSOLE and desk.session.mode != "REM"
    )  # it neither waits nor ends a jog, but may stop all
    if desk.session.motion is None or (outside and not isinstance(words, Halt)):
        return _prepend_replies(replies, _run(desk, who, line, t))
    match words:
        case Halt():
            return _prepend_replies(
                replies, _stop(replace(desk, told=tuple(dict.fromkeys((*desk.told, who)))), t)
            )
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
    """With the time come to t: a motion that ended is told of, and what waited for it is begun, as
    far as that goes.
    """
    replies: tuple[Reply, ...] = ()
    while desk.end is not None and desk.end <= t:
        now, session = desk.end, desk.session.finish_motion()
        text = (
            f"STOPPED {session.describe(now)}" if desk.stopped or desk.session.jogging else "DONE"
        )
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


def _run(
    desk: Dispatcher, who: int, line: TextLine, t: float
) -> tuple[Dispatcher, tuple[Reply, ...]]:
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
        moving = answer.session.begin_motion(answer.motion, answer.jogging)
        changed = replace(desk, session=moving, told=(who,), stopped=False)
    return changed, ((who, reply),) if reply else ()


def _allow(session: Session, who: int, words: Words) -> None:
    """Raise MotionError where someone may not say this in the mode that is on."""
    if isinstance(words, (Halt, Where, Help)):
        return
    if who != CONSOLE and session.mode != "REM":
        raise MotionError(
            f"the console is in mode {session.mode}; give REM there for remote control"
        )
    if who == CONSOLE and session.mode == "REM" and not isinstance(words, Switch):
        raise MotionError("the remote line has control; MAN returns to manual mode")


def _stop(desk: Dispatcher, t: float) -> tuple[Dispatcher, tuple[Reply, ...]]:
    desk, replies = _drop_waiting(desk, lambda _: True, "STOP")
    motion = desk.session.motion
    if motion is None or desk.stopped:
        return desk, replies
    session = desk.session.begin_motion(halt_motion(desk.session.drives, motion, t))
    return replace(desk, session=session, stopped=True), replies


def _drop_waiting(
    desk: Dispatcher, whose: Callable[[int], bool], by: str
) -> tuple[Dispatcher, tuple[Reply, ...]]:
    gone = tuple(
        (who, f"{ERROR} dropped by {by}; no motion") for who, _ in desk.waiting if whose(who)
    )
    kept = tuple(pair for pair in desk.waiting if not whose(pair[0]))
    return replace(desk, waiting=kept), gone


def _prepend_replies(
    replies: tuple[Reply, ...], done: tuple[Dispatcher, tuple[Reply, ...]]
) -> tuple[Dispatcher, tuple[Reply, ...]]:
    return done[0], (*replies, *done[1])


MAX_WAIT = 0.05
"""s after which links that have opened are looked for at the latest."""
MAX_UNREAD_BYTES = 65536
"""Bytes that wait for a reader at most.

A client that takes none of them is shut out; of a serial line, which cannot be opened again,
further replies are dropped, and it is read on: its next line may be STOP.
"""
FIRST_COMMAND_TIME = 10.0
"""s that a client has for its first command: there are few places, and a silent client keeps others
out.
"""


class Clock:
    """The session's time, s: that of the wall, without what planning takes; or without any waiting
    at all (`fast`).

    read  the wall's, s
    """

    __slots__ = ("_lost", "_read", "fast", "now")

    def __init__(self, *, fast: bool = False, read: Callable[[], float] = monotonic) -> None:
        self.fast, self.now, self._read, self._lost = fast, 0.0, read, read()

    def advance(self, end: float | None) -> None:
        """To now; a fast clock to the end of the motion, if there is one."""
        if not self.fast:
            self.now = max(self.now, self._read() - self._lost)
        elif end is not None:
            self.now = max(self.now, end)

    def excuse(self) -> None:
        """Leave out what has passed since it was last advanced: work that axes do not move in."""
        if not self.fast:
            self._lost = self._read() - self.now


@dataclass(slots=True, eq=False)
class ServedLink:
    """A link while it is served: its number, its line so far, lines it has yet to say, and what it
    has not taken.

    over   whether it has come to its end: it is still told what becomes of its lines
    trust  what its lines have shown it to be
    opened  s, by the system's clock
    """

    link: Link
    who: int
    partial: Partial = field(default_factory=Partial)
    held: tuple[TextLine, ...] = ()
    over: bool = False
    trust: Trust = field(default_factory=Trust)
    unsent: bytes = b""
    opened: float = field(default_factory=lambda: monotonic())


class Server:
    """A desk and those who talk to it. Holds what changes: the desk, a value, and the open links.

    A pipe is read like a script, each line when what came before is done; STOP, and any line during
    a jog, at once.

    refused  how many of the console's lines did nothing
    unwritten  why the console's replies cannot be written any more; None: they can
    save  is told of the desk and the time whenever a motion begins or ends, or what is known of
          home changes
    echo  is told what happens to remote lines: connected, gone
    """

    def __init__(
        self,
        desk: Dispatcher,
        clock: Clock,
        *,
        console: Link | None = None,
        remote: Sequence[Transport] = (),
        save: Callable[[Dispatcher, float], None] = lambda desk, t: None,
        echo: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.desk, self.clock, self._save, self._echo = desk, clock, save, echo
        self._remote, self._next = tuple(remote), CONSOLE + 1
        self.refused = 0
        self.unwritten: OSError | None = None
        self._links = [] if console is None else [ServedLink(console, CONSOLE)]

    @property
    def script_left(self) -> bool:
        """Whether the console has more to say."""
        return any(
            served.who == CONSOLE and (served.held or not served.over) for served in self._links
        )

    @property
    def is_idle(self) -> bool:
        """Whether nothing moves or is about to."""
        return self.desk.end is None and not self.desk.waiting

    def serve_until(self, done: Callable[[Dispatcher], bool]) -> None:
        """Serve until something is true of the desk."""
        while not done(self.desk):
            self.step()

    def step(self) -> None:
        """Wait for bytes, or for time to pass, once."""
        for link in (link for transport in self._remote for link in transport.accept_links()):
            self._links.append(ServedLink(link, self._next))
            self._next += 1
            self._echo(f"{link.name} connected")
        reading = {s.link.reads: s for s in self._links if not (s.held or s.over)}
        writing = {served.link.writes: served for served in self._links if served.unsent}
        try:
            ready, free, _ = select.select(list(reading), list(writing), [], self._patience())
        except (OSError, ValueError):  # one was closed behind our back: reading it tells which
            ready, free = list(reading), []
        self.clock.advance(None if ready else self.desk.end)
        for descriptor in free:
            self._send(writing[descriptor], b"")
        for descriptor in ready:
            self._receive(reading[descriptor])
        self._take(advance_time(self.desk, self.clock.now))
        for served in tuple(self._links):
            self._hear(served)
            self._close_silent(served)
            if served.over and not (served.link.script or served.unsent or self._owes(served)):
                self._end(served)

    def say(self, text: str, who: int = CONSOLE) -> None:
        """Hand a line to the desk as if it had come from someone; an empty one is none."""
        self.clock.advance(None)
        for line in Partial().feed(text.encode(errors="replace") + b"\n")[1]:
            self._take(take_line(self.desk, who, line, self.clock.now))

    def finish(self) -> None:
        """Bring the motion under way to its end, without waiting for it."""
        while self.desk.end is not None:
            self.clock.now = self.desk.end
            self._take(advance_time(self.desk, self.clock.now))

    def _patience(self) -> float:
        end = self.desk.end
        if end is None:
            return 0.0 if any(served.held for served in self._links) else MAX_WAIT
        return 0.0 if self.clock.fast else min(max(end - self.clock.now, 0.0), MAX_WAIT)

    def _receive(self, served: ServedLink) -> None:
        if served not in self._links:
            return
        try:
            data = served.link.read_bytes()
        except OSError:
            if not served.link.script:
                self._end(served)
                return
            data = None
        served.partial, lines = served.partial.feed(data or b"")
        if data is None:
            served.over, lines = True, served.partial.broken_off()
        served.held = (*served.held, *lines)
        self._hear(served)
        if served.link.stranger and not served.trust.known and served.partial.is_binary:
            self._shut_out(served, "bytes that are no text")

    def _close_silent(self, served: ServedLink) -> None:
        """Close a client that has given no command for too long."""
        unknown = served.link.stranger and not (served.trust.known or served.over)
        if unknown and monotonic() - served.opened > FIRST_COMMAND_TIME:
            self._shut_out(served, f"no command within {FIRST_COMMAND_TIME:g} s")

    def _shut_out(self, served: ServedLink, reason: str) -> None:
        """Close a link, and say why on it and on the console."""
        if served in self._links:
            self._send(served, f"{ERROR} {reason}; closed{served.link.line_end}".encode())
            self._echo(f"{served.link.name} shut out: {reason}")
            self._end(served)

    def _hear(self, served: ServedLink) -> None:
        while served.held and served in self._links:
            line, rest = served.held[0], served.held[1:]
            at_once = self.desk.session.jogging or line.text.strip().upper() == "STOP"
            if served.link.script and not (self.is_idle or at_once):
                return
            served.held = rest
            if served.link.stranger:
                served.trust = served.trust.read_line(line, self.desk.session.drives.names)
                if served.trust.shut:
                    self._shut_out(served, served.trust.shut)
                    return
            self._take(take_line(self.desk, served.who, line, self.clock.now))

    def _owes(self, served: ServedLink) -> bool:
        """Whether someone is still to be answered."""
        return bool(served.held) or served.who in (
            *self.desk.told,
            *(who for who, _ in self.desk.waiting),
        )

    def _take(self, done: tuple[Dispatcher, tuple[Reply, ...]]) -> None:
        before, (self.desk, replies) = self.desk.session, done
        after = self.desk.session
        if (
            after.motion is not before.motion
            or after.counts is not before.counts
            or after.homed is not before.homed
        ):
            self._save(self.desk, self.clock.now)
        if after.motion is not None and after.motion is not before.motion:
            self.clock.excuse()
        for who, text in replies:
            self.refused += who == CONSOLE and text.startswith(ERROR)
            for served in [served for served in self._links if served.who == who]:
                end = served.link.line_end
                self._send(served, (text.replace("\n", end) + end).encode("ascii", "replace"))

    def _send(self, served: ServedLink, data: bytes) -> None:
        """Send what waits and a reply, as much as the link takes now."""
        waiting = served.unsent + data
        try:
            rest = served.link.send_bytes(waiting) if waiting else b""
        except OSError as error:
            self.unwritten, rest = error, None
        if rest is None or (served.link.stranger and len(rest) > MAX_UNREAD_BYTES):
            self._end(served)
            return
        if len(rest) > MAX_UNREAD_BYTES and len(rest) > len(data):
            rest = rest[: -len(data)]  # only whole replies are dropped
        served.unsent = rest

    def _end(self, served: ServedLink) -> None:
        if served in self._links:
            self._links.remove(served)
            served.link.close()
            self.desk = drop_remote(self.desk, served.who)
            self._echo(f"{served.link.name} gone")
