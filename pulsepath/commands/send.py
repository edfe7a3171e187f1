"""`pulsepath send`: a file of G-code to grbl, grblHAL or FluidNC on a serial port, and a safe stop on trouble."""

import time
from pathlib import Path

import click

from pulsepath.process import supervisor
from pulsepath.progress import note, say, step

PLACE_IT = "move it there, or set the work offset (G10 L20 P1)"
FIND_IT = "it has lost steps, or does not move: home it before it moves again"
"""Remedies for an axis that is elsewhere before the first line, and after the last."""


@click.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path, exists=True, dir_okay=False))
@click.option("--port", metavar="PORT", required=True, help="Serial port of the controller (needs the extra: serial).")
@click.option("--baud", type=click.IntRange(110), default=115200, show_default=True, help="Serial baud rate.")
@click.option(
    "--buffer",
    type=click.IntRange(32),
    default=127,
    show_default=True,
    help="Bytes of the controller's receive buffer: grblHAL and FluidNC have more.",
)
@click.option(
    "--line",
    type=click.IntRange(16),
    default=79,
    show_default=True,
    help="Longest line that the controller accepts, in characters: up to 255 for grblHAL and FluidNC.",
)
@click.option(
    "--anywhere", is_flag=True, help="Start from any position: do not compare the axes with the file's header."
)
def send(file: Path, port: str, baud: int, buffer: int, line: int, anywhere: bool) -> None:
    """Send FILE, written by export --format g93, to grbl.

    Also works with grblHAL and FluidNC. Checks every line and the position of the axes before anything moves, and
    returns when the motion has ended. After an error, an alarm or Ctrl-C it sends no further line, decelerates the axes
    (feed hold) and discards the rest (soft reset).

    Example: pulsepath send out/mine/g93.ngc --port /dev/ttyUSB0

    Exit codes: 0 moved, 2 bad input, or a line was refused, 130 interrupted.
    """
    from controllers.console.grbl import PATIENCE, STOP_PATIENCE, Controller, open_port, read_gcode, refuse_elsewhere
    from kinematics import MotionError
    from kinematics.foundation.names import count_noun

    if line >= buffer:
        raise MotionError(f"--line {line}: a line and its end have to fit the --buffer of {buffer} bytes; give less")
    program = read_gcode(file, line, anywhere)
    device = open_port(port, baud)
    try:
        controller = Controller(device, port, buffer)
        controller.wake()
        if program.start and not anywhere:
            refuse_elsewhere(controller.find_place(), program.start, "before the first line", PLACE_IT)
        begin = time.monotonic()
        try:
            with step(f"sending {file}") as tell:
                controller.stream(program.lines, tell)
                controller.wait_idle()
        except BaseException:
            supervisor.tell(patience=STOP_PATIENCE + PATIENCE)
            rest = controller.stop()
            note(f"{port}: feed hold and soft reset: {'the axes stand' if rest else 'it does not tell of a rest'}")
            raise
        lasted = time.monotonic() - begin
        place = controller.find_place()
        if program.end and not anywhere:
            refuse_elsewhere(place, program.end, "after the last line", FIND_IT)
    except OSError as error:
        raise MotionError(f"serial port {port}: {error}; its axes may still move: stop them by hand") from None
    finally:
        device.close()
    at = " ".join(f"{letter}{value:.3f}" for letter, value in place.items())
    say(
        f"{file}: {count_noun(len(program.lines), 'line')} taken and moved in {lasted:.1f} s; the "
        f"axes stand at {at or '?'}"
    )
