"""`pulsepath console`: drive a machine on the virtual motion card by operator and remote commands."""

import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import refuse_unknown
from pulsepath.process.ending import EndSignal, allow_time, set_exit_code
from pulsepath.process.exits import BAD_INPUT
from pulsepath.progress import say

if TYPE_CHECKING:
    from controllers.console.serve import Server

# s that the end may take after a signal: axes ramp down, and their registers are saved.
MAX_STOP_TIME = 60.0


@click.command()
@click.option(
    "--machine",
    metavar="MACHINE",
    required=True,
    help="Preset or file.",
    shell_complete=make_completer(known_names.machines, files=True),
)
@click.option("--serial", metavar="PORT", help="Accept remote commands on a serial port (needs the extra: serial).")
@click.option("--baud", type=click.IntRange(110, 115200), default=9600, show_default=True, help="Serial baud rate.")
@click.option(
    "--parity",
    type=click.Choice(["none", "even", "odd"]),
    default="none",
    show_default=True,
    help="Serial parity (8 data bits, 1 stop bit). A character with a parity error invalidates its line.",
)
@click.option(
    "--tcp", type=click.IntRange(0, 65535), metavar="PORT", help="Accept remote commands over TCP; 0: any free port."
)
@click.option("--listen", metavar="ADDRESS", help="With --tcp: address to listen on. Default: loopback only.")
@click.option(
    "--state", type=click.Path(path_type=Path), metavar="FILE", help="Keeps position registers between sessions."
)
@click.option("--fast", is_flag=True, help="Complete motions instantly. Default: in real time.")
def console(
    machine: str,
    serial: str | None,
    baud: int,
    parity: str,
    tcp: int | None,
    listen: str | None,
    state: Path | None,
    fast: bool,
) -> None:
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

    On a remote line in mode REM, send P X + 100 Y - 40 Z + 80 and a carriage return; the reply after motion is DONE.

    STOP during a MOVE decelerates each axis independently, so the tool leaves its line.

    Example: pulsepath console --machine traverser --fast

    Exit codes: 0 done, 2 bad input or a rejected script line, 3 internal error, 130 interrupted, 143 terminated, 129
    hung up. After a signal the motion is stopped and the registers are saved.
    """
    refuse_unknown(machine=machine)
    from kinematics import load_machine
    from kinematics.foundation.errors import MotionError

    if listen is not None and tcp is None:
        raise MotionError("--listen says where --tcp listens: give --tcp PORT as well")
    driven = load_machine(machine)  # faults of its file are told before the rest loads
    from controllers.console import Dispatcher, open_session, snapshot_session
    from controllers.console.interpret import describe_offer
    from controllers.console.links import LOOPBACK, Socket, Transport, pipe, require_pollable, serial_line
    from controllers.console.serve import Clock, Server
    from pulsepath.output import register_file

    require_pollable()
    place = state or register_file.usual_place(driven.name)
    with register_file.lock_file(place):
        session = open_session(driven, register_file.read(place))
        remote: list[Transport] = []
        if serial is not None:
            remote.append(serial_line(serial, baud, parity))
            _tell(f"serial line {serial} at {baud} baud, parity {parity}")
        if tcp is not None:
            socket = Socket(tcp, listen or LOOPBACK)
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
            Clock(fast=fast),
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
            tell(f"interrupted: {server.desk.session.describe(server.clock.now)}, {keeper.describe}")
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
    server.serve_until(
        lambda desk: not server.script_left and server.is_idle and not (remote and desk.session.mode == "REM")
    )


def _tell(text: str) -> None:
    try:
        say(text, err=True)
    except OSError:  # nobody looks any more: what is buffered must not fail later either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
