"""Real lines: a pair of pseudo-terminals, and sockets on the loopback address."""

import os
import select
import socket
import time
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from controllers.console import Dispatcher, open_session
from controllers.console.links import MAX_CLIENTS, Socket, serial_line
from controllers.console.serve import Clock, Server
from kinematics import MotionError, load_machine

pty, tty = pytest.importorskip("pty"), pytest.importorskip("tty")  # not on Windows, where the console is refused


@pytest.fixture
def server():
    def serving(*transports, fast=True):
        session = replace(open_session(load_machine("traverser")), mode="REM", homed=np.ones(4, bool))
        return Server(Dispatcher(session), Clock(fast=fast), remote=transports)

    return serving


def served(server, seconds=5.0, until=None):
    """Serve for a time, or until something is true."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and not (until and until()):
        server.step()


@pytest.fixture
def wire():
    """One end to write to and read from, and the name of the other."""
    here, there = pty.openpty()
    tty.setraw(here)
    yield here, os.ttyname(there)
    os.close(here)
    os.close(there)


def answered(server, here, lines, seconds=5.0):
    """What comes back along a wire while the server works, up to so many lines."""
    data = b""
    end = time.monotonic() + seconds
    while data.count(b"\n") < lines and time.monotonic() < end:
        server.step()
        while select.select([here], [], [], 0)[0]:
            data += os.read(here, 4096)
    return data


@pytest.mark.parametrize("baud", [110, 9600, 115200])
def test_a_serial_line_is_answered_after_the_motion(server, wire, baud):
    here, name = wire
    remote = server(serial_line(name, baud))
    served(remote, 0.1)
    os.write(here, b"P X + 100 Y + 40 Z + 80\r")
    assert answered(remote, here, 1) == b"DONE\r\n"
    os.write(here, b"P X - 100 Y")
    served(remote, 0.1)
    os.write(here, b" - 40\r\nP Q + 1\nWHERE\r")
    said = answered(remote, here, 3).split(b"\r\n")
    assert said[0] == b"X 100 Y 40 Z 80 R 0"  # WHERE does not wait
    assert said[1] == b"DONE"
    assert said[2].startswith(b"ERROR Q is not an axis")
    assert remote.desk.session.registers(0.0).tolist() == [0, 0, 80, 0]


def test_motions_take_as_long_as_they_take(server, wire):
    here, name = wire
    remote = server(serial_line(name, 9600), fast=False)
    served(remote, 0.1)
    begin = time.monotonic()
    os.write(here, b"P X + 30\r")
    assert answered(remote, here, 1) == b"DONE\r\n"
    # 2 √(30/480) = 0.5 s, seen at most a tick late; a machine with other work may be later still
    assert 0.5 - 1e-3 <= time.monotonic() - begin < 1.5


def test_axes_do_not_move_while_they_are_planned_for():
    session = replace(open_session(load_machine("hexapod")), homed=np.ones(6, bool))
    server = Server(Dispatcher(session), Clock())
    begin = time.monotonic()
    server.say("MOVE 0 0 25")
    planned = time.monotonic() - begin
    server.clock.advance(None)
    motion = server.desk.session.motion
    assert server.clock.now - motion.begun < 0.2 * planned
    assert not motion.counts(motion.begun).any()


def test_a_serial_line_that_cannot_be_opened_is_told(wire):
    with pytest.raises(MotionError, match="nowhere"):
        serial_line("/dev/nowhere", 9600)
    with pytest.raises(MotionError, match="outside 110 to 115200"):
        serial_line(wire[1], 100)


@pytest.mark.parametrize(("parity", "letter"), [("none", "N"), ("even", "E"), ("odd", "O")])
def test_parity_is_sent_and_looked_at(server, wire, monkeypatch, parity, letter):
    """A pseudo-terminal has no parity bits; what the system is asked for can be read back, and 0x00 is what fails."""
    import termios

    import serial

    asked = {}
    real = serial.Serial
    monkeypatch.setattr(serial, "Serial", lambda *args, **named: asked.update(named) or real(*args, **named))
    here, name = wire
    remote = server(serial_line(name, 9600, parity))
    assert asked["parity"] == letter
    assert bool(termios.tcgetattr(os.open(name, os.O_RDWR | os.O_NOCTTY))[0] & termios.INPCK) == (parity != "none")
    served(remote, 0.1)
    os.write(here, b"P X + 1\x0000\rP X + 5\r")
    assert answered(remote, here, 2).split(b"\r\n")[:2] == [
        b"ERROR byte 0x00 at 8 of a line is no character of a command; no motion",
        b"DONE",
    ]
    with pytest.raises(MotionError, match='parity "mark" is not known; there are none, even, odd'):
        serial_line(name, 9600, "mark")


def test_a_socket_listens_on_loopback_alone_and_serves_several_clients(server):
    listener = Socket(0)
    assert listener.address[0] == "127.0.0.1"
    remote = server(listener)
    with socket.create_connection(listener.address) as one, socket.create_connection(listener.address) as other:
        one.sendall(b"P X + 10\r")
        other.sendall(b"P Y + 20\rP Y - 21\r")
        for client, wanted in ((one, b"DONE\r\n"), (other, b"DONE\r\n")):
            client.settimeout(0.01)
            got = b""
            end = time.monotonic() + 5
            while not got.endswith(b"\n") and time.monotonic() < end:
                served(remote, 0.05)
                with suppress(TimeoutError):
                    got += client.recv(4096)
            assert got.startswith(wanted)
    assert remote.desk.session.registers(0.0).tolist() == [10, 20, 0, 0]
    listener.close()


def test_a_client_that_vanishes_mid_move(server):
    listener = Socket(0)
    remote = server(listener, fast=False)
    client = socket.create_connection(listener.address)
    client.sendall(b"P X + 200\rP X + 1000\rP X + 5")
    served(remote, until=lambda: remote.desk.end is not None)
    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\x01\x00\x00\x00\x00\x00\x00\x00")
    client.close()  # with a reset
    served(remote, 1.0, until=lambda: not remote.desk.waiting)
    assert remote.desk.end is not None  # the move is not broken off: 2 √(200/480) = 1.29 s
    served(remote, until=lambda: remote.desk.end is None)
    assert remote.desk.session.registers(0.0).tolist() == [200, 0, 0, 0]
    # the next client is served
    with socket.create_connection(listener.address) as again:
        again.sendall(b"WHERE\n")
        served(remote, 0.3)
        assert again.recv(100) == (b"X 200 Y 0 Z 0 R 0 = x 3.1750 y 0.0000 z 0.0000 mm rz 0.0000 deg\r\n")
    listener.close()


def heard_back(remote, client, seconds=5.0):
    """All that comes back until the other end closes."""
    got, end = b"", time.monotonic() + seconds
    client.settimeout(0.01)
    while time.monotonic() < end:
        remote.step()
        with suppress(TimeoutError):
            data = client.recv(4096)
            if not data:
                return got
            got += data
    raise AssertionError(f"not closed after {got!r}")


def test_a_client_that_says_no_more_is_answered_all_it_has_said(server):
    listener = Socket(0)
    remote = server(listener, fast=False)
    with socket.create_connection(listener.address) as client:
        client.sendall(b"P X + 10\rP X + 10 Y + 5\rP Z + 3\rWHERE")  # as a pipe into netcat, which then half-closes
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
        b"POST /" + b"a" * 200 + b" HTTP/1.1\r\nHost: localhost\r\nAccept: */*\r\n\r\nP X + 100\r\n",
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
    assert remote.standing
    listener.close()


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
        served(remote, 0.06)
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
