"""`pulsepath console`: an operator's line interface, and the remote line, to a machine on the virtual card."""

import os
import sys
from pathlib import Path

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.process import supervisor
from pulsepath.process.ending import EndSignal, raise_on_signal
from pulsepath.process.exits import BAD_INPUT
from pulsepath.progress import say

STOPPING_PATIENCE = 50.0
"""Times the usual that an orderly end may take: axes are ramped down, and their registers saved."""


@click.command()
@click.option(
    "--machine",
    metavar="MACHINE",
    required=True,
    help="Preset or file.",
    shell_complete=make_completer(known_names.machines, files=True),
)
@click.option("--serial", metavar="PORT", help="Take remote commands from a serial line (needs the extra: serial).")
@click.option("--baud", type=click.IntRange(110, 115200), default=9600, show_default=True, help="Of the serial line.")
@click.option(
    "--parity",
    type=click.Choice(["none", "even", "odd"]),
    default="none",
    show_default=True,
    help="Of the serial line's characters, of 8 data bits and 1 stop bit; one that fails it spoils its line.",
)
@click.option(
    "--tcp", type=click.IntRange(0, 65535), metavar="PORT", help="Take remote commands from TCP; 0: any free port."
)
@click.option(
    "--listen", metavar="ADDRESS", help="With --tcp: on this address of the machine. Default: loopback alone."
)
@click.option("--state", type=click.Path(path_type=Path), metavar="FILE", help="Registers that outlive the session.")
@click.option("--fast", is_flag=True, help="Motions take no time. Default: as long as they take.")
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
    """Drive MACHINE on the virtual card by typed lines.

    They come from the keyboard, a pipe, a serial line or a socket.

    \b
    JOG X CW                 one axis slowly, until a key, STOP, or the end of its travel
    HOME Y                   its register becomes 0 here; an axis whose place
                             is not known stands at its switch then
    HOME X AT 24 in          its slide stands 24 in from the switch
    POS X CW 100 Z CCW 20    axes by steps, together; a trapezoid each
    MOVE 0 0 25 [0 0 5]      mm and degrees from home, in a straight line
    PTP 0 0 25 [0 0 5]       the same pose, every axis straight to its place,
                             all together; both are planned and proved
    ACCEPT                   the last known position holds
    WHERE  STOP  HELP        and EXIT at the prompt
    REM  MAN  TEST           who drives; TEST checks commands and runs none

    The rotary axis R is also θ, or THETA. Registers count from where HOME was
    said, which may be any place of the travel; how far an axis may go is counted
    from its switch. Before that is known, one travel's length is all it may go.

    On a remote line, in mode REM: P X + 100 Y - 40 Z + 80 and a carriage return, answered by DONE after the motion.

    STOP during a MOVE ramps each axis down by itself: the tool leaves its line.

    Example: pulsepath console --machine traverser --fast

    Exit codes: 0 done, 2 bad input, also a refused line of a script, 3 internal error, 130 interrupted, 143 asked
    to end, 129 hung up: the motion is stopped, the registers are saved.
    """
    from controllers.console import Dispatcher, open_session, snapshot_session
    from controllers.console.interpret import describe_offer
    from controllers.console.links import LOOPBACK, Socket, Transport, pipe, require_pollable, serial_line
    from controllers.console.serve import Clock, Server
    from kinematics import MotionError, load_machine
    from pulsepath import terminal as console_prompt
    from pulsepath.output import register_file

    require_pollable()
    if listen is not None and tcp is None:
        raise MotionError("--listen says where --tcp listens: give --tcp PORT as well")
    driven = load_machine(machine)
    place = state or register_file.usual_place(driven.name)
    with register_file.held(place):
        session = open_session(driven, register_file.read(place))
        remote: list[Transport] = []
        if serial is not None:
            remote.append(serial_line(serial, baud, parity))
            _tell(f"serial line {serial} at {baud} baud, parity {parity}")
        if tcp is not None:
            socket = Socket(tcp, listen or LOOPBACK)
            remote.append(socket)
            _tell(f"TCP {socket.address[0]} port {socket.address[1]}")
        terminal = console_prompt.terminal(session.drives.names) if sys.stdin.isatty() else None

        def tell(text: str) -> None:
            if terminal is not None:
                terminal.screen.wipe()
            _tell(text)

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
        with raise_on_signal():
            try:
                if terminal is not None:
                    console_prompt.prompt(server, terminal.screen)
                else:
                    console_prompt.script(server, bool(remote))
            except EndSignal as end:
                supervisor.tell(patience=STOPPING_PATIENCE)
                server.say("STOP")
                server.finish()
                tell(f"interrupted: {server.desk.session.told(server.clock.now)}, {keeper.told}")
                click.get_current_context().exit(end.code)
        if server.refused and terminal is None:
            click.get_current_context().exit(BAD_INPUT)


def _tell(text: str) -> None:
    try:
        say(text, err=True)
    except OSError:  # nobody looks any more: what is buffered must not fail later either
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())
