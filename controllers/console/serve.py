"""The one loop over bytes: waits for all links at once, hands their lines to the desk, and its replies back.

Whether a link that anything may have opened speaks the console's language: a web page's POST shall move nothing.
"""

from __future__ import annotations

import re
import select
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic

from controllers.console.dispatcher import CONSOLE, ERROR, Dispatcher, Reply, advance_time, drop_remote, take_line
from controllers.console.grammar import MisreadLine, remote
from controllers.console.links import Link, Partial, TextLine, Transport

MAX_MISREAD_LINES = 3
"""Lines in a row that are no commands, from the first on, after which a link is shut: HTTP has more before its body."""
HTTP = re.compile(r"\s*[A-Z]+ +\S+ +HTTP/", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Trust:
    """What a link's lines have shown so far.

    known    whether one of them was a command: a computer that knows them may err as often as it likes
    misread  how many were none before that
    shut     why the link is to be closed; "": it is not
    """

    known: bool = False
    misread: int = 0
    shut: str = ""

    def after(self, line: TextLine, names: Sequence[str]) -> Trust:
        """With a line; names: of the axes, in capitals."""
        if self.known or self.shut:
            return self
        if not self.misread and HTTP.match(line.text):
            return replace(self, shut="this line speaks no HTTP")
        try:
            if not line.fault:
                remote(line.text, names)
                return replace(self, known=True)
        except MisreadLine:
            pass
        misread = self.misread + 1
        return replace(
            self, misread=misread, shut=f"{misread} lines were no commands" if misread >= MAX_MISREAD_LINES else ""
        )


TICK = 0.05
"""s after which links that have opened are looked for at the latest."""
MAX_UNREAD_BYTES = 65536
"""Bytes that wait for a reader at most: one that takes none of them is shut out."""


class Clock:
    """The session's time, s: that of the wall, without what planning takes; or without any waiting at all (`fast`)."""

    __slots__ = ("_lost", "fast", "now")

    def __init__(self, *, fast: bool = False) -> None:
        self.fast, self.now, self._lost = fast, 0.0, monotonic()

    def advance(self, end: float | None) -> None:
        """To now; a fast clock to the end of the motion, if there is one."""
        if not self.fast:
            self.now = max(self.now, monotonic() - self._lost)
        elif end is not None:
            self.now = max(self.now, end)

    def excuse(self) -> None:
        """Leave out what has passed since it was last advanced: work that axes do not move in."""
        if not self.fast:
            self._lost = monotonic() - self.now


@dataclass(slots=True, eq=False)
class ServedLink:
    """A link while it is served: its number, its line so far, lines it has yet to say, and what it has not taken.

    over   whether it has come to its end: it is still told what becomes of its lines
    trust  what its lines have shown it to be
    """

    link: Link
    who: int
    partial: Partial = field(default_factory=Partial)
    held: tuple[TextLine, ...] = ()
    over: bool = False
    trust: Trust = field(default_factory=Trust)
    unsent: bytes = b""


class Server:
    """A desk and those who talk to it. Holds what changes: the desk, a value, and the open links.

    A pipe is read like a script, each line when what came before is done; STOP, and any line during a jog, at once.

    refused  how many of the console's lines did nothing
    save  is told of the desk and the time whenever a motion begins or ends, or what is known of home changes
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
        self._links = [] if console is None else [ServedLink(console, CONSOLE)]

    @property
    def script_left(self) -> bool:
        """Whether the console has more to say."""
        return any(served.who == CONSOLE and (served.held or not served.over) for served in self._links)

    @property
    def standing(self) -> bool:
        """Whether nothing moves or is about to."""
        return self.desk.end is None and not self.desk.waiting

    def until(self, done: Callable[[Dispatcher], bool]) -> None:
        """Serve until something is true of the desk."""
        while not done(self.desk):
            self.step()

    def step(self) -> None:
        """Wait for bytes, or for time to pass, once."""
        for link in (link for transport in self._remote for link in transport.opened()):
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
            if served.over and not (served.link.script or served.unsent or self._owes(served)):
                self._end(served)

    def say(self, text: str, who: int = CONSOLE) -> None:
        """Hand a line to the desk as if it had come from someone."""
        self.clock.advance(None)
        self._take(take_line(self.desk, who, TextLine(text), self.clock.now))

    def finish(self) -> None:
        """Bring the motion under way to its end, without waiting for it."""
        while self.desk.end is not None:
            self.clock.now = self.desk.end
            self._take(advance_time(self.desk, self.clock.now))

    def _patience(self) -> float:
        end = self.desk.end
        if end is None:
            return 0.0 if any(served.held for served in self._links) else TICK
        return 0.0 if self.clock.fast else min(max(end - self.clock.now, 0.0), TICK)

    def _receive(self, served: ServedLink) -> None:
        if served not in self._links:
            return
        try:
            data = served.link.received()
        except OSError:
            if not served.link.script:
                self._end(served)
                return
            data = None
        served.partial, lines = served.partial.fed(data or b"")
        if data is None:
            served.over, lines = True, served.partial.broken_off()
        served.held = (*served.held, *lines)
        self._hear(served)

    def _hear(self, served: ServedLink) -> None:
        while served.held and served in self._links:
            line, rest = served.held[0], served.held[1:]
            at_once = self.desk.session.jogging or line.text.strip().upper() == "STOP"
            if served.link.script and not (self.standing or at_once):
                return
            served.held = rest
            if served.link.stranger:
                served.trust = served.trust.after(line, self.desk.session.drives.names)
                if served.trust.shut:
                    self._send(served, f"{ERROR} {served.trust.shut}; closed{served.link.line_end}".encode())
                    self._echo(f"{served.link.name} shut out: {served.trust.shut}")
                    self._end(served)
                    return
            self._take(take_line(self.desk, served.who, line, self.clock.now))

    def _owes(self, served: ServedLink) -> bool:
        """Whether someone is still to be answered."""
        return bool(served.held) or served.who in (*self.desk.told, *(who for who, _ in self.desk.waiting))

    def _take(self, done: tuple[Dispatcher, tuple[Reply, ...]]) -> None:
        before, (self.desk, replies) = self.desk.session, done
        after = self.desk.session
        if after.motion is not before.motion or after.counts is not before.counts or after.homed is not before.homed:
            self._save(self.desk, self.clock.now)
        if after.motion is not None and after.motion is not before.motion:
            self.clock.excuse()
        for who, text in replies:
            self.refused += who == CONSOLE and text.startswith(ERROR)
            for served in [served for served in self._links if served.who == who]:
                end = served.link.line_end
                self._send(served, (text.replace("\n", end) + end).encode("ascii", "replace"))

    def _send(self, served: ServedLink, data: bytes) -> None:
        rest = served.link.sent(served.unsent + data) if served.unsent + data else b""
        if rest is None or len(rest) > MAX_UNREAD_BYTES:
            self._end(served)
        else:
            served.unsent = rest

    def _end(self, served: ServedLink) -> None:
        if served in self._links:
            self._links.remove(served)
            served.link.close()
            self.desk = drop_remote(self.desk, served.who)
            self._echo(f"{served.link.name} gone")
