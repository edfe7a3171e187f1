"""`pulsepath pose`: axes and joints of a machine at a pose, or the pose at given axis coordinates."""

import re
from math import degrees, pi
from typing import TYPE_CHECKING

import click

from pulsepath import known_names
from pulsepath.known_names import make_completer
from pulsepath.options import ALLOW_MINUS, json_option, refuse_unknown
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import say

if TYPE_CHECKING:
    from kinematics import Machine, Pose

PLAIN = {"m": "mm", "rad": "deg"}
"""The unit of plain numbers."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)


@click.command(context_settings=ALLOW_MINUS)
@click.argument("machine", shell_complete=make_completer(known_names.machines, files=True))
@click.argument("pose", required=False)
@click.option("--turn", metavar="A,B,C", help="Angles about the moving axes x, y, z in turn. Default: 0,0,0.")
@click.option(
    "--frame",
    type=click.Choice(["home", "base"]),
    default="home",
    show_default=True,
    help="Frame of POSE, as in programs.",
)
@click.option("--lengths", metavar="Q1,Q2,…", help="Instead of POSE: leg lengths between joints, positions or angles.")
@click.option("--travel", metavar="Q1,Q2,…", help="Instead of POSE: the same, relative to home.")
@click.option("--counts", metavar="N1,N2,…", help="Instead of POSE: pulse counts from home, in axis direction.")
@json_option
def pose(
    machine: str,
    pose: str | None,
    turn: str | None,
    frame: str,
    lengths: str | None,
    travel: str | None,
    counts: str | None,
    as_json: bool,
) -> None:
    """Show all axes and joints of MACHINE at a POSE.

    POSE is "x,y,z"; default: home. Plain numbers are mm and degrees; write other units out ("0.2 in"). Shows lengths,
    pulses, tilts, the platform's direction angles α β γ, margins, and whether the pose is proved reachable from home.
    With --lengths, --travel or --counts, computes the pose from the axes instead.

    Exit code 1 if the pose is out of reach, violates a limit or is not certified: "limits kept" is of the limits alone.

    Example: pulsepath pose hexapod 5,5,35 --turn 3,-4,2
    """
    refuse_unknown(machine=machine)
    from kinematics.foundation.errors import MotionError

    axes = {"--lengths": lengths, "--travel": travel, "--counts": counts}
    given = [option for option, text in axes.items() if text is not None]
    if len(given) > 1 or (given and (pose is not None or turn is not None)):
        beside = " beside a POSE" if len(given) == 1 else ""
        raise MotionError(f"pose: {' and '.join(given)}{beside}: give a POSE, or one of {', '.join(axes)}")
    place = None if pose is None else _read_values("POSE", pose, ("m",) * 3, "x, y, z")
    angles = None if turn is None else _read_turn(turn)
    from kinematics import load_machine

    of = load_machine(machine)
    coordinates = _read_coordinates(of, given[0], axes[given[0]] or "") if given else None
    from kinematics.analysis.posture import posture_of_axes, posture_of_pose
    from pulsepath.output import record, tables

    if coordinates is not None:
        result = posture_of_axes(of, coordinates)
    else:
        result = posture_of_pose(of, _place(of, place, angles, frame))
    if as_json:
        click.echo(record.as_json(record.of_posture(result)), nl=False)
    else:
        tables.show(tables.of_results(result))
    if broken := result.violations:
        many = f"{len(broken)} limits are violated, the worst is " if len(broken) > 1 else ""
        say(f"infeasible: {many}{broken[0]}", err=True)
    elif not result.certified:
        say(f"infeasible: not certified: {result.doubt}", err=True)
    if not result.margins.ok.all() or not result.certified:
        click.get_current_context().exit(INFEASIBLE)


def _read_turn(text: str) -> list[float]:
    """θx, θy, θz, rad."""
    from kinematics.foundation.errors import MotionError

    angles = _read_values("--turn", text, ("rad",) * 3, "θx, θy, θz")
    for angle, name in zip(angles, ("θx", "θy", "θz"), strict=True):
        if abs(angle) > 2 * pi * (1 + 1e-12):
            raise MotionError(
                f"--turn: {name} of {degrees(angle):.6g}° is more than a whole turn, which a pose does not tell from "
                "none; give the rest of it, or the axes by --travel"
            )
    return angles


def _place(machine: "Machine", position: list[float] | None, turn: list[float] | None, frame: str) -> "Pose":
    """Return the pose in the base frame. Raises MotionError for a coordinate that the machine does not control."""
    from scipy.spatial.transform import RigidTransform

    from kinematics.analysis.posture import refuse_dependent
    from kinematics.machine.pose import make_pose

    home = [0.0] * 3 if frame == "home" else machine.home.translation.tolist()
    place, angles = home if position is None else position, turn or [0.0] * 3
    refuse_dependent(machine, dict(zip(("rx", "ry", "rz"), angles, strict=True)))
    stated = make_pose(place, angles)
    if frame == "home":
        return machine.home * stated
    if turn is None and not {"rx", "ry", "rz"} & set(machine.freedom):  # as it is held, or follows
        return RigidTransform.from_components(place, machine.home.rotation)
    return stated


def _read_coordinates(machine: "Machine", option: str, text: str) -> list[float]:
    """(n,) coordinates of the axes, natural, in SI."""
    axes = machine.axes
    names = ", ".join(axis.name for axis in axes)
    if option == "--counts":
        numbers = _split(option, text, len(axes), names)
        ways = [_read_count(number) * axis.pulse for number, axis in zip(numbers, axes, strict=True)]
        return [home + way for home, way in zip(machine.home_q.tolist(), ways, strict=True)]
    given = _read_values(option, text, tuple(axis.unit for axis in axes), names)
    homes = machine.home_q.tolist() if option == "--travel" else [0.0] * len(axes)
    return [home + value for home, value in zip(homes, given, strict=True)]


def _read_values(what: str, text: str, units: tuple[str, ...], names: str) -> list[float]:
    """SI values of numbers that are parted by commas: plain ones in mm and degrees."""
    from kinematics.foundation.errors import BadValue
    from kinematics.foundation.units import quantity

    values = []
    for part, unit in zip(_split(what, text, len(units), names), units, strict=True):
        try:
            values.append(quantity(f"{part} {PLAIN[unit]}" if _NUMBER.fullmatch(part) else part, unit))
        except BadValue as error:
            raise BadValue(f"{what}: {error}", allowed=error.allowed, nearest=error.nearest) from None
    return values


def _split(what: str, text: str, count: int, names: str) -> list[str]:
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.names import count_noun
    from kinematics.foundation.units import describe_value

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != count:
        raise MotionError(
            f"{what} {describe_value(text)}: {count_noun(len(parts), 'entry')}; write {count}, with "
            f"commas between: {names}"
        )
    return parts


def _read_count(text: str) -> int:
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.units import describe_value

    if not re.fullmatch(r"[+-]?\d{1,15}", text, re.ASCII):
        raise MotionError(f"--counts: {describe_value(text)} is not a whole number of pulses")
    return int(text)
