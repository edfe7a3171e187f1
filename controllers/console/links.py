"""Where bytes come from and go to (keyboard or pipe, serial line, TCP socket), and lines made of
them.

A kind of link is one small method that tells which links have opened since it was last asked; all
are descriptors that can be polled. Bytes become lines whatever comes in, in whatever pieces, with a
bounded memory.
"""

from __future__ import annotations

import os
import re
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from controllers.console.grammar import MisreadLine, remote
from kinematics.foundation.errors import MotionError, NotInstalled

LOOPBACK = "127.0.0.1"
BAUD = (110, 115200)
PARITIES = {"none": "N", "even": "E", "odd": "O"}
MAX_CLIENTS = 4
"""Remote computers on the socket at a time; more are turned away."""
READ_BYTES = 4096
"""Bytes read at a time."""


@dataclass(frozen=True, slots=True)
class Link:
    """An open line.

    reads, writes  descriptors
    name           for messages
    close          what ends it
    script         whether it is the console's pipe: its lines wait for one another
    stranger       whether anything on this computer may have opened it, a web page in a browser too
    """

    reads: int
    writes: int
    name: str
    close: Callable[[], Any]
    script: bool = False
    stranger: bool = False
    line_end: str = "\r\n"

    def read_bytes(self) -> bytes | None:
        """What has come; None: no more will, but it may still be answered.

        Raises OSError where it is broken.
        """
        try:
            return os.read(self.reads, READ_BYTES) or None
        except BlockingIOError:
            return b""

    def send_bytes(self, data: bytes) -> bytes | None:
        """Return the data that could not be sent yet; None: nobody takes it any more.

        Raises OSError where the console's own output cannot be written, as to a full disk.
        """
        try:
            return data[os.write(self.writes, data) :]
        except BlockingIOError:
            return data
        except OSError:
            if self.script:
                raise
            return None


class Transport(ABC):
    """A kind of link."""

    __slots__ = ()

    @abstractmethod
    def accept_links(self) -> tuple[Link, ...]:
        """The links that have opened since this was last asked."""


class OpenTransport(Transport):
    """A link that is there from the beginning."""

    __slots__ = ("_link",)

    def __init__(self, link: Link) -> None:
        self._link: tuple[Link, ...] = (link,)

    def accept_links(self) -> tuple[Link, ...]:
        found, self._link = self._link, ()
        return found


def pipe() -> Link:
    """Standard input and output, where these are no terminal."""
    return Link(
        sys.stdin.fileno(), sys.stdout.fileno(), "console", _leave_open, script=True, line_end="\n"
    )


def _leave_open() -> None:
    pass


def serial_line(port: str, baud: int, parity: str = "none") -> Transport:
    """A serial line, 8 data bits, parity "none", "even" or "odd", 1 stop bit; what came before is
    dropped.

    With a parity, a byte that was received with a wrong one is read as 0x00, which spoils its line.
    """
    require_pollable()
    try:
        import serial
    except ImportError:
        raise NotInstalled("a serial line", "pyserial", "serial") from None
    if parity not in PARITIES:
        raise MotionError(
            f'serial line {port}: parity "{parity}" is not known; there are {", ".join(PARITIES)}'
        )
    if not BAUD[0] <= baud <= BAUD[1]:
        raise MotionError(f"serial line {port}: {baud} baud is outside {BAUD[0]} to {BAUD[1]}")
    try:
        line = serial.Serial(port, baud, timeout=0, exclusive=True, parity=PARITIES[parity])
        if parity != "none":
            _check_parity(line.fileno())
        line.reset_input_buffer()
    except (OSError, ValueError) as error:  # SerialException is an OSError
        raise MotionError(f"serial line {port} at {baud} baud: {error}") from None
    return OpenTransport(Link(line.fileno(), line.fileno(), port, line.close))


def _check_parity(descriptor: int) -> None:
    """Have the system look at the parity bits that come: pyserial only sends them."""
    import termios

    settings = termios.tcgetattr(descriptor)
    settings[0] = settings[0] & ~(termios.IGNPAR | termios.PARMRK) | termios.INPCK
    termios.tcsetattr(descriptor, termios.TCSANOW, settings)


class Socket(Transport):
    """A listening TCP socket: on the loopback address, or on that of an interface if it was told
    one.
    """

    __slots__ = ("_listener", "_open", "address")

    def __init__(self, port: int, host: str = LOOPBACK) -> None:
        require_pollable()
        try:
            family = socket.AF_INET6 if ":" in host else socket.AF_INET
            self._listener = socket.create_server((host, port), family=family, backlog=MAX_CLIENTS)
        except (OSError, OverflowError) as error:
            raise MotionError(f"TCP {host} port {port}: {error}") from None
        self._listener.setblocking(False)
        self._open: list[socket.socket] = []
        self.address: tuple[str, int] = self._listener.getsockname()[:2]

    def accept_links(self) -> tuple[Link, ...]:
        found: list[Link] = []
        self._open = [client for client in self._open if client.fileno() >= 0]
        while True:
            try:
                client, (host, port, *_) = self._listener.accept()
            except OSError:  # nobody, or one that has gone already
                return tuple(found)
            if len(self._open) == MAX_CLIENTS:
                client.close()
                continue
            client.setblocking(False)
            _keep_alive(client)
            self._open.append(client)
            found.append(
                Link(
                    client.fileno(), client.fileno(), f"{host}:{port}", client.close, stranger=True
                )
            )

    def close(self) -> None:
        self._listener.close()


KEEP_ALIVE = {"TCP_KEEPIDLE": 60, "TCP_KEEPINTVL": 15, "TCP_KEEPCNT": 4}
"""s until a silent connection is tested, s between tests, and the number of tests.

Then a computer that is gone is noticed.
"""


def _keep_alive(client: socket.socket) -> None:
    """Have the system close a connection whose other end is gone, so that it does not take a place
    for ever.
    """
    client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in KEEP_ALIVE.items():
        if hasattr(socket, name):  # not on every system
            client.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)


def require_pollable() -> None:
    """Raise MotionError on a system whose serial lines and consoles cannot be waited for
    together.
    """
    if sys.platform == "win32":
        raise MotionError(
            "the console waits for keyboard, serial line and socket at once, which Windows cannot"
        )


MAX_LINE_BYTES = 120
"""Bytes of a line, its end left out."""
THETA = ("θ".encode(), "Θ".encode())
"""The one key of an operator that ASCII does not have; the remote line's language refuses it."""


@dataclass(frozen=True, slots=True)
class TextLine:
    """A line that has come to its end: its text, or else the fault for which it is not read."""

    text: str
    fault: str = ""


@dataclass(frozen=True, slots=True)
class Partial:
    """What has come of a line that has no end yet: up to one byte more than a line may have."""

    held: bytes = b""

    def feed(self, data: bytes) -> tuple[Partial, tuple[TextLine, ...]]:
        """With bytes that have come: lines that end among them.

        CR, LF and both end a line; an empty one is none.
        """
        *ended, rest = data.replace(b"\n", b"\r").split(b"\r")
        lines, held = [], self.held
        for part in ended:
            whole = held + part[: MAX_LINE_BYTES + 1 - len(held)]
            held = b""
            if whole.strip(b" \t"):
                lines.append(_read(whole))
        return Partial(held + rest[: MAX_LINE_BYTES + 1 - len(held)]), tuple(lines)

    @property
    def is_binary(self) -> bool:
        """True if it has a control character, as the first byte of a TLS connection is one."""
        return any(byte < 0x20 and byte != 0x09 for byte in self.held)

    def broken_off(self) -> tuple[TextLine, ...]:
        """What is left when no more comes: a fault, since a line without its end may not be all of
        it.
        """
        return (TextLine("", "the input ended within a line"),) if self.held.strip(b" \t") else ()


def _read(line: bytes) -> TextLine:
    if len(line) > MAX_LINE_BYTES:
        return TextLine("", f"a line is longer than {MAX_LINE_BYTES} characters")
    plain = line
    for key in THETA:
        plain = plain.replace(key, b"T" * len(key))
    for place, byte in enumerate(plain):
        if not (0x20 <= byte < 0x7F or byte == 0x09):
            return TextLine(
                "", f"byte 0x{byte:02X} at {place + 1} of a line is not a character of a command"
            )
    return TextLine(line.decode())


MAX_MISREAD_LINES = 3
"""Lines in a row that are no commands, from the first on, after which a link is shut: HTTP has more
before its body.
"""
HTTP = re.compile(r"\s*[A-Z]+ +\S+ +HTTP/", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Trust:
    """What a link's lines have shown so far.

    known    whether one of them was a command: a computer that knows them may err as often as it
             likes
    misread  how many were no commands before that
    shut     why the link is to be closed; "": it is not
    """

    known: bool = False
    misread: int = 0
    shut: str = ""

    def read_line(self, line: TextLine, names: Sequence[str]) -> Trust:
        """Return the trust after a line; names: of the axes, in capitals.

        A line of other bytes than text, or one that is too long, is of another protocol, whose
        contents may hold what looks like a command.
        """
        if self.known or self.shut:
            return self
        if line.fault:
            return replace(self, shut=line.fault)
        if not self.misread and HTTP.match(line.text):
            return replace(self, shut="HTTP is not accepted on this line")
        with suppress(MisreadLine):
            remote(line.text, names)
            return replace(self, known=True)
        misread = self.misread + 1
        shut = f"{misread} lines were not commands" if misread >= MAX_MISREAD_LINES else ""
        return replace(self, misread=misread, shut=shut)
