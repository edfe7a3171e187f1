"""Real lines: a pair of pseudo-terminals, and sockets on the loopback address."""

import os
import select
import socket
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from controllers.console import Dispatcher, open_session, take_line
from controllers.console.links import MAX_CLIENTS, Socket, serial_line
from controllers.console.serve import Clock, Server
from kinematics import MotionError, load_machine

pty, tty = (
    pytest.importorskip("pty"),
    pytest.importorskip("tty"),
)  # not on Windows, where the console is refused


class Hands:
    """A wall's clock, s, that goes on by hand, and by so much whenever it is looked at."""

    def __init__(self, by=0.0):
        self.t, self.by = 0.0, by

    def __call__(self):
        self.t += self.by
        return self.t


@pytest.fixture
def server():
    def serving(*transports, wall=None):
        session = replace(
            open_session(load_machine("traverser")), mode="REM", homed=np.ones(4, bool)
        )
        clock = Clock(fast=True) if wall is None else Clock(read=wall)
        return Server(Dispatcher(session), clock, remote=transports)

    return serving


def serve_until(server, true):
    """Serve until something is true, which it is in time."""
    end = time.monotonic() + 30
    while not true():
        assert time.monotonic() < end
        server.step()


@pytest.fixture
def wire():
    """One end to write to and read from, and the name of the other."""
    here, there = pty.openpty()
    tty.setraw(here)
    yield here, os.ttyname(there)
    os.close(here)
    os.close(there)


def answered(server, here, lines):
    """What comes back along a wire while the server works, up to so many lines."""
    data = b""

    def come():
        nonlocal data
        while select.select([here], [], [], 0)[0]:
            data += os.read(here, 4096)
        return data.count(b"\n") >= lines

    serve_until(server, come)
    return data


@pytest.mark.parametrize("baud", [110, 9600, 115200])
def test_a_serial_line_is_answered_after_the_motion(server, wire, baud):
    here, name = wire
    remote = server(serial_line(name, baud))
    remote.step()
    os.write(here, b"P X + 100 Y + 40 Z + 80\r")
    assert answered(remote, here, 1) == b"DONE\r\n"
    os.write(here, b"P X - 100 Y")
    remote.step()
    os.write(here, b" - 40\r\nP Q + 1\nWHERE\r")
    said = answered(remote, here, 3).split(b"\r\n")
    assert said[0] == b"X 100 Y 40 Z 80 R 0"  # WHERE does not wait
    assert said[1] == b"DONE"
    assert said[2].startswith(b"ERROR Q is not an axis")
    assert remote.desk.session.registers(0.0).tolist() == [0, 0, 80, 0]


def test_motions_take_as_long_as_they_take(server, wire):
    here, name = wire
    wall = Hands()
    remote = server(serial_line(name, 9600), wall=wall)
    remote.step()
    os.write(here, b"P X + 30\r")
    serve_until(remote, lambda: remote.desk.end is not None)
    assert remote.desk.end == pytest.approx(0.5, abs=1e-3)  # 2 √(30/480)
    wall.t = remote.desk.end - 1e-9
    remote.step()
    assert remote.desk.end is not None
    wall.t = remote.desk.end
    assert answered(remote, here, 1) == b"DONE\r\n"


def test_axes_do_not_move_while_they_are_planned_for(monkeypatch):
    wall = Hands()

    def take_long(*args):
        wall.t += 100.0
        return take_line(*args)

    monkeypatch.setattr("controllers.console.serve.take_line", take_long)
    session = replace(open_session(load_machine("hexapod")), homed=np.ones(6, bool))
    server = Server(Dispatcher(session), Clock(read=wall))
    server.say("MOVE 0 0 25")
    server.clock.advance(None)
    motion = server.desk.session.motion
    assert server.clock.now == motion.begun
    assert not motion.counts(motion.begun).any()


def test_a_serial_line_that_cannot_be_opened_is_told(wire):
    with pytest.raises(MotionError, match="nowhere"):
        serial_line("/dev/nowhere", 9600)
    with pytest.raises(MotionError, match="outside 110 to 115200"):
        serial_line(wire[1], 100)


@pytest.mark.parametrize(("parity", "letter"), [("none", "N"), ("even", "E"), ("odd", "O")])
def test_parity_is_sent_and_looked_at(server, wire, monkeypatch, parity, letter):
    """A pseudo-terminal has no parity bits; what the system is asked for can be read back, and 0x00
    is what fails.
    """
    import termios

    import serial

    asked = {}
    real = serial.Serial
    monkeypatch.setattr(
        serial, "Serial", lambda *args, **named: asked.update(named) or real(*args, **named)
    )
    here, name = wire
    remote = server(serial_line(name, 9600, parity))
    assert asked["parity"] == letter
    assert bool(termios.tcgetattr(os.open(name, os.O_RDWR | os.O_NOCTTY))[0] & termios.INPCK) == (
        parity != "none"
    )
    remote.step()
    os.write(here, b"P X + 1\x0000\rP X + 5\r")
    assert answered(remote, here, 2).split(b"\r\n")[:2] == [
        b"ERROR byte 0x00 at 8 of a line is not a character of a command; no motion",
        b"DONE",
    ]
    with pytest.raises(MotionError, match='parity "mark" is not known; there are none, even, odd'):
        serial_line(name, 9600, "mark")


def test_a_socket_listens_on_loopback_alone_and_serves_several_clients(server):
    listener = Socket(0)
    assert listener.address[0] == "127.0.0.1"
    remote = server(listener)
    with (
        socket.create_connection(listener.address) as one,
        socket.create_connection(listener.address) as other,
    ):
        one.sendall(b"P X + 10\r")
        other.sendall(b"P Y + 20\rP Y - 21\r")
        for client in (one, other):
            assert answered(remote, client.fileno(), 1).startswith(b"DONE\r\n")
    assert remote.desk.session.registers(0.0).tolist() == [10, 20, 0, 0]
    listener.close()


def test_a_client_that_vanishes_mid_move(server):
    listener, wall = Socket(0), Hands()
    remote = server(listener, wall=wall)
    client = socket.create_connection(listener.address)
    client.sendall(b"P X + 200\rP X + 1000\rP X + 5")
    serve_until(remote, lambda: remote.desk.waiting)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
    client.close()  # with a reset
    serve_until(remote, lambda: not remote.desk.waiting)
    assert remote.desk.end == pytest.approx(
        1.29, abs=1e-2
    )  # the move is not broken off: 2 √(200/480) s
    wall.t = remote.desk.end
    serve_until(remote, lambda: remote.desk.end is None)
    assert remote.desk.session.registers(0.0).tolist() == [200, 0, 0, 0]
    # the next client is served
    with socket.create_connection(listener.address) as again:
        again.sendall(b"WHERE\n")
        told = answered(remote, again.fileno(), 1)
    assert told == b"X 200 Y 0 Z 0 R 0 = x 3.1750 y 0.0000 z 0.0000 mm rz 0.0000 deg\r\n"
    listener.close()


def heard_back(remote, client):
    """All that comes back until the other end closes."""
    got = []

    def closed():
        with suppress(BlockingIOError):
            got.append(client.recv(4096))
        return got[-1:] == [b""]

    client.setblocking(False)
    serve_until(remote, closed)
    return b"".join(got)


def test_a_client_that_says_no_more_is_answered_all_it_has_said(server):
    listener = Socket(0)
    remote = server(listener, wall=Hands(0.2))
    with socket.create_connection(listener.address) as client:
        client.sendall(
            b"P X + 10\rP X + 10 Y + 5\rP Z + 3\rWHERE"
        )  # as a pipe into netcat, which then half-closes
        client.shutdown(socket.SHUT_WR)
        *done, broken_off, rest = heard_back(remote, client).split(b"\r\n")
    assert done == [b"DONE"] * 3
    assert broken_off.startswith(b"ERROR the input ended within a line")
    assert rest == b""
    assert remote.desk.session.registers(0.0).tolist() == [20, 5, 3, 0]
    listener.close()


@pytest.mark.parametrize(
    "page",
    [
        b"POST / HTTP/1.1\r\nHost: localhost\r\n\r\nP X + 100\r\n",
        b"POST / HTTP/1.1\rP X + 100\r",
        b"GET /chat HTTP/1.1\r\nP X + 100\r\n",
        # a first line that is longer than a line may be
        b"POST /"
        + b"a" * 200
        + b" HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\n\r\nP X + 100\r\n",
        b"\x16\x03\x01\r\rno\rcommand\rP X + 100\r",
    ],
)
def test_a_web_page_moves_nothing(server, page):
    listener = Socket(0)
    remote = server(listener)
    with socket.create_connection(listener.address) as client:
        client.sendall(page)
        assert heard_back(remote, client).splitlines()[-1].endswith(b"; closed")
    assert remote.desk.session.registers(0.0).tolist() == [0, 0, 0, 0]
    assert remote.is_idle
    listener.close()


HELLO = b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"
"""The beginning of a TLS 1.3 connection [RFC 8446, 5.1 and 4.1.2]: its server name and session are
chosen freely.
"""
FOREIGN = {
    "TLS": HELLO + b"\rP X + 1111\r",
    "TLS with line feeds": HELLO + b"\nP X + 1111\n",
    "TLS behind empty lines": b"\r\n \r\n" + HELLO + b"\rP X + 1111\r",
    "SSH": b"SSH-2.0-client\r\n\x00\x00\x05\xdc\x06\x14\rP X + 1111\r",
    "a database": b"\x00\x00\x00\x08\x04\xd2\x16\x2f\rP X + 1111\r",
    "letters beyond ASCII": "größer\rP X + 1111\r".encode(),
    "a long line": b"x" * 121 + b"\rP X + 1111\r",
    "a delete": b"\x7f\rP X + 1111\r",
}


@pytest.mark.parametrize("sent", FOREIGN.values(), ids=FOREIGN)
@pytest.mark.parametrize("size", [1, 7, 4096])
def test_another_protocol_moves_nothing_whatever_it_carries(server, sent, size):
    listener = Socket(0)
    remote = server(listener)
    with socket.create_connection(listener.address) as client:
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with suppress(ConnectionError):
            for first in range(0, len(sent), size):
                client.sendall(sent[first : first + size])
                remote.step()
        with suppress(ConnectionError):
            heard_back(remote, client)
    assert remote.desk.session.registers(0.0).tolist() == [0, 0, 0, 0]
    assert remote.is_idle
    listener.close()


def test_a_hello_is_shut_out_before_its_line_ends(server):
    listener = Socket(0)
    remote = server(listener)
    with socket.create_connection(listener.address) as client:
        client.sendall(HELLO)
        assert heard_back(remote, client) == b"ERROR bytes that are no text; closed\r\n"
    listener.close()


@pytest.mark.parametrize("sent", [b"", b"P X", b"Q\r", b"\r\n\r\n"])
def test_clients_without_a_command_make_way_for_others(server, monkeypatch, sent):
    """One that has given a command may be silent from then on."""
    wall = Hands()
    monkeypatch.setattr("controllers.console.serve.monotonic", wall)
    listener = Socket(0)
    remote = server(listener, wall=lambda: 0.0)
    known = socket.create_connection(listener.address)
    known.sendall(b"WHERE\r")
    answered(remote, known.fileno(), 1)
    silent = [socket.create_connection(listener.address) for _ in range(MAX_CLIENTS - 1)]
    for client in silent:
        client.sendall(sent)
        remote.step()
    wall.t = 9.9
    remote.step()
    with socket.create_connection(listener.address) as turned_away:
        assert heard_back(remote, turned_away) == b""
    wall.t = 10.1
    for client in silent:
        assert heard_back(remote, client).endswith(b"ERROR no command within 10 s; closed\r\n")
    wall.t = 1000.0
    with socket.create_connection(listener.address) as client:
        client.sendall(b"P X + 10\r")
        serve_until(remote, lambda: remote.desk.end is not None)
    known.sendall(b"WHERE\r")
    assert answered(remote, known.fileno(), 1).startswith(b"X 0 Y 0")
    for client in (known, *silent):
        client.close()
    listener.close()


def test_a_serial_line_whose_replies_nobody_reads_can_still_stop_a_motion(server, wire):
    here, name = wire
    remote = server(serial_line(name, 115200), wall=lambda: 0.0)
    remote.step()
    for _ in range(150):  # 24 000 bytes of commands, some 110 000 of replies
        os.write(here, b"WHERE\r\rQ\r" * 16)
        remote.step()
    os.write(here, b"P X + 1000\r")
    serve_until(remote, lambda: remote.desk.end is not None)
    os.write(here, b"STOP\r")
    serve_until(remote, lambda: remote.desk.stopped)
    replies = b""
    while not replies.endswith(b"again\r\n"):
        replies += answered(remote, here, 1)
        if not remote._links[0].unsent:
            break
    lines = replies.split(b"\r\n")
    whole = (b"X 0 Y 0 Z 0 R 0", b"ERROR Q is not")
    assert len(lines) > 100
    assert all(line.startswith(whole) for line in lines[:-1])  # what arrives is whole
    os.write(here, b"WHERE\r")
    assert answered(remote, here, 1).startswith(b"X 0 Y 0 Z 0 R 0")


def test_one_that_has_said_a_command_may_err_and_a_serial_line_is_never_shut(server, wire):
    here, name = wire
    listener = Socket(0)
    remote = server(listener, serial_line(name, 9600))
    with socket.create_connection(listener.address) as client:
        client.sendall(b"Q\rQ\rWHERE\rQ\rQ\rQ\rQ\rP X + 5\r")
        client.shutdown(socket.SHUT_WR)
        assert heard_back(remote, client).endswith(b"DONE\r\n")
    os.write(here, b"Q\rQ\rQ\rQ\rP Y + 5\r")
    assert answered(remote, here, 5).endswith(b"DONE\r\n")
    assert remote.desk.session.registers(0.0).tolist() == [5, 5, 0, 0]
    listener.close()


def test_clients_beyond_a_few_are_turned_away(server):
    listener = Socket(0)
    remote = server(listener)
    clients = []
    for _ in range(MAX_CLIENTS + 1):
        clients.append(socket.create_connection(listener.address))
        remote.step()
    clients[-1].settimeout(1)
    assert clients[-1].recv(1) == b""
    for client in clients:
        client.close()
    listener.close()


def test_a_port_in_use_is_told():
    listener = Socket(0)
    with pytest.raises(MotionError, match=f"port {listener.address[1]}"):
        Socket(listener.address[1])
    listener.close()
