"""`pulsepath console`: drive the virtual motion card by operator and remote commands."""

import os
import sys
from dataclasses import MISSING, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from planner.request import option
from pulsepath.options import MAX_PORT, refuse_unknown
from pulsepath.process.ending import EndSignal, allow_time, set_exit_code
from pulsepath.process.exits import BAD_INPUT
from pulsepath.progress import say
from pulsepath.request_options import with_request

if TYPE_CHECKING:
    from controllers.console import Dispatcher
    from controllers.console.serve import Server

# s that the end may take after a signal: axes ramp down, and their registers are saved.
MAX_STOP_TIME = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleRequest:
    """A machine, and the lines on which it accepts commands."""

    machine: str = option(
        MISSING,
        "Preset or file.",
        metavar="MACHINE",
        names="machines",
        files=True,
    )
    serial: str | None = option(
        None,
        "Accept remote commands on a serial port (needs the extra: serial).",
        metavar="PORT",
    )
    baud: int = option(9600, "Serial baud rate.", least=110, most=115200)
    parity: str = option(
        "none",
        "Serial parity (8 data bits, 1 stop bit). A character with a parity error invalidates its line.",
        choices=("none", "even", "odd"),
    )
    tcp: int | None = option(
        None,
        "Accept remote commands over TCP; 0: any free port.",
        least=0,
        most=MAX_PORT,
        metavar="PORT",
    )
    listen: str | None = option(
        None,
        "With --tcp: address to listen on. Default: loopback only.",
        metavar="ADDRESS",
        needs="tcp",
    )
    state: Path | None = option(
        None,
        "Keeps position registers between sessions.",
        metavar="FILE",
    )
    fast: bool = option(False, "Complete motions instantly. Default: in real time.")


@click.command()
@with_request(ConsoleRequest)
def console(request: ConsoleRequest) -> None:
    """Drive MACHINE on the virtual motion card with typed commands.

    Commands come from the keyboard, a pipe, a serial port or a socket.

    \b
    JOG X CW                 jog one axis until a key, STOP, or the end of travel
    HOME Y                   set its register to 0 here; an axis whose position
                             is unknown is taken to be at its home switch
    HOME X AT 24 in          the slide is 24 in from its home switch
    POS X CW 100 Z CCW 20    move axes by steps, each on a trapezoidal profile
    MOVE 0 0 25 [0 0 5]      straight line to a pose: mm and degrees from home
    PTP 0 0 25 [0 0 5]       the same pose, axes synchronised, no straight line;
                             both are planned and proved
    ACCEPT                   accept the last known position
    WHERE  STOP  HELP        and EXIT at the prompt
    REM  MAN  TEST           control mode; TEST checks commands, runs none

    The rotary axis R may also be written θ or THETA. Registers count from where
    HOME was given, which may be anywhere in the travel; travel limits count from
    the home switch. Until the switch position is known, an axis may move by one
    travel length at most.

    On a remote line in mode REM, send P X + 100 Y - 40 Z + 80 and a carriage return; the reply
    after motion is DONE.

    STOP during a MOVE decelerates each axis independently, so the tool leaves its line.

    Example: pulsepath console --machine traverser --fast

    Exit codes: 0 done, 2 bad input or a rejected script line, 3 internal error, 130 interrupted,
    143 terminated, 129 hung up. After a signal the motion is stopped and the registers are saved.
    """
    refuse_unknown(machine=request.machine)
    from kinematics import load_machine

    driven = load_machine(request.machine)  # faults of its file are reported before the rest loads
    from controllers.console import Dispatcher, open_session, snapshot_session
    from controllers.console.interpret import describe_offer
    from controllers.console.links import (
        LOOPBACK,
        Socket,
        Transport,
        pipe,
        require_pollable,
        serial_line,
    )
    from controllers.console.serve import Clock, Server
    from pulsepath.output import register_file

    require_pollable()
    place = request.state or register_file.usual_place(driven.name)
    with register_file.lock_file(place):
        session = open_session(driven, register_file.read(place))
        remote: list[Transport] = []
        if request.serial is not None:
            remote.append(serial_line(request.serial, request.baud, request.parity))
            _tell(f"serial line {request.serial} at {request.baud} baud, parity {request.parity}")
        if request.tcp is not None:
            socket = Socket(request.tcp, request.listen or LOOPBACK)
            remote.append(socket)
            _tell(f"TCP {socket.address[0]} port {socket.address[1]}")
        terminal = None
        if sys.stdin.isatty():
            from pulsepath.terminal import open_terminal

            terminal = open_terminal(session.drives.names)

        def tell(text: str) -> None:
            if terminal is None:
                _tell(text)
            else:
                terminal.show(partial(_tell, text))

        keeper = register_file.Keeper(place, tell)
        server = Server(
            Dispatcher(session),
            Clock(fast=request.fast),
            console=terminal or pipe(),
            remote=remote,
            save=lambda desk, t: keeper.save(snapshot_session(desk.session, t)),
            echo=tell,
        )
        _tell(f"{driven.name}: {describe_offer(session)}")
        try:
            if terminal is not None:
                terminal.prompt(server)
            else:
                _run_script(server, bool(remote))
        except EndSignal as end:
            allow_time(MAX_STOP_TIME)
            server.say("STOP")
            server.finish()
            tell(
                f"interrupted: {server.desk.session.describe(server.clock.now)}, {keeper.describe}"
            )
            set_exit_code(end.code)
            click.get_current_context().exit(end.code)
        if server.unwritten is not None:
            raise OSError(server.unwritten.errno, server.unwritten.strerror, "standard output")
        if server.refused and terminal is None:
            click.get_current_context().exit(BAD_INPUT)


def _run_script(server: "Server", remote: bool) -> None:
    """Serve until the script has ended and all motion has stopped.

    With a remote line in mode REM, serve until interrupted.
    """

    def is_done(desk: "Dispatcher") -> bool:
        awaits_remote = remote and desk.session.mode == "REM"
        return not server.script_left and server.is_idle and not awaits_remote

    server.serve_until(is_done)


def _tell(text: str) -> None:
    try:
        say(text, err=True)
    except OSError:  # nobody looks any more: what is buffered must not fail later either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
