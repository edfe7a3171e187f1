"""`pulsepath pose`: axes and joints of a machine at a pose, or the pose of axis coordinates."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, pi
from typing import TYPE_CHECKING

import click

from planner.request import option
from pulsepath.commands.common import print_result
from pulsepath.options import ALLOW_MINUS, json_option, machine_argument, refuse_unknown
from pulsepath.process.exits import INFEASIBLE
from pulsepath.progress import note_doubts, say
from pulsepath.request_options import find_flag, with_request

if TYPE_CHECKING:
    from kinematics import Machine
    from kinematics.foundation.arrays import Array

# Unit of plain numbers.
PLAIN = {"m": "mm", "rad": "deg"}
NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)
COUNT = re.compile(r"[+-]?\d{1,15}", re.ASCII)
TURN = ("θx", "θy", "θz")
# An angle in degrees may be rounded when it is converted.
WHOLE_TURN = 2 * pi * (1 + 1e-12)


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseRequest:
    """A pose of a machine, or the coordinates of its axes in one of three ways."""

    machine: str
    pose: str | None = None
    turn: str | None = option(
        None,
        "Angles about the moving axes x, y, z in turn. Default: 0,0,0.",
        metavar="A,B,C",
    )
    frame: str = option("home", "Frame of POSE, as in programs.", choices=("home", "base"))
    lengths: str | None = option(
        None,
        "Instead of POSE: leg lengths between joints, positions or angles.",
        metavar="Q1,Q2,…",
    )
    travel: str | None = option(
        None,
        "Instead of POSE: the same, relative to home.",
        metavar="Q1,Q2,…",
    )
    counts: str | None = option(
        None,
        "Instead of POSE: pulse counts from home, in axis direction.",
        metavar="N1,N2,…",
    )

    def find_coordinates(self) -> tuple[str, str] | None:
        """Return option and text of coordinates of axes. Raises MotionError for more than one."""
        from kinematics.foundation.errors import MotionError

        texts = {find_flag(name): getattr(self, name) for name in ("lengths", "travel", "counts")}
        coordinates = [(flag, text) for flag, text in texts.items() if text is not None]
        has_pose = self.pose is not None or self.turn is not None
        if len(coordinates) > 1 or (coordinates and has_pose):
            flags = " and ".join(flag for flag, _ in coordinates)
            with_pose = " beside a POSE" if len(coordinates) == 1 else ""
            choices = ", ".join(texts)
            raise MotionError(f"pose: {flags}{with_pose}: give a POSE, or one of {choices}")
        return coordinates[0] if coordinates else None


@click.command(context_settings=ALLOW_MINUS)
@machine_argument
@click.argument("pose", required=False)
@with_request(PoseRequest)
@json_option
def pose(request: PoseRequest, as_json: bool) -> None:
    """Show all axes and joints of MACHINE at a POSE.

    POSE is "x,y,z"; default: home. Plain numbers are mm and degrees; write other units out ("0.2
    in"). Shows lengths, pulses, tilts, the platform's direction angles α β γ, margins, and whether
    the pose is proved reachable from home. With --lengths, --travel or --counts, computes the pose
    from the axes instead.

    Exit code 1 if the pose is out of reach, violates a limit or is not certified: "limits kept" is
    of the limits alone.

    Example: pulsepath pose hexapod 5,5,35 --turn 3,-4,2
    """
    refuse_unknown(machine=request.machine)
    coordinates = request.find_coordinates()
    position = None
    if request.pose is not None:
        position = _read_values("POSE", request.pose, ("m",) * 3, ("x", "y", "z"))
    turn = None if request.turn is None else _read_turn(request.turn)
    from kinematics import load_machine

    machine = load_machine(request.machine)
    note_doubts(machine, request.machine)
    q = None if coordinates is None else _read_coordinates(machine, *coordinates)
    from kinematics.analysis.posture import posture_of_axes, posture_of_numbers
    from pulsepath.output import record, tables

    if q is not None:
        result = posture_of_axes(machine, q)
    else:
        result = posture_of_numbers(machine, _find_numbers(machine, position, turn, request.frame))
    print_result(record.record_posture(result), tables.list_tables(result), as_json)
    if violations := result.violations:
        count = len(violations)
        many = f"{count} limits are violated, the worst is " if count > 1 else ""
        say(f"infeasible: {many}{violations[0]}", err=True)
    elif not result.certified:
        say(f"infeasible: not certified: {result.doubt}", err=True)
    if not result.margins.ok.all() or not result.certified:
        click.get_current_context().exit(INFEASIBLE)


def _read_turn(text: str) -> list[float]:
    """Return θx, θy, θz in rad."""
    from kinematics.foundation.errors import MotionError

    angles = _read_values("--turn", text, ("rad",) * 3, TURN)
    for angle, name in zip(angles, TURN, strict=True):
        if abs(angle) > WHOLE_TURN:
            raise MotionError(
                f"--turn: {name} of {degrees(angle):.6g}° is more than a whole turn, which a pose "
                "does not tell from none; give the rest of it, or the axes by --travel",
            )
    return angles


def _find_numbers(
    machine: "Machine",
    position: list[float] | None,
    turn: list[float] | None,
    frame: str,
) -> "Array":
    """Return pose numbers (1, 12) in the base frame, with home's position and a turn of 0 where
    they are omitted.

    Numbers, because SciPy's poses take longer to load than all else here. Raises MotionError for a
    coordinate that the machine does not control.
    """
    import numpy as np

    from kinematics.analysis.posture import refuse_dependent
    from kinematics.foundation.rotations import turn_axes

    angles = turn or [0.0] * 3
    refuse_dependent(machine, dict(zip(("rx", "ry", "rz"), angles, strict=True)))
    (home,) = machine.home_numbers
    home_turn = home[3:].reshape(3, 3)
    (turned,) = turn_axes(np.array([angles]))
    if frame == "home":
        place = home[:3] + home_turn @ (position or [0.0] * 3)
        return np.concatenate([place, (home_turn @ turned).ravel()])[None]
    controls_turn = bool({"rx", "ry", "rz"} & set(machine.freedom))
    if turn is None and not controls_turn:  # the angles are fixed, or follow from the position
        turned = home_turn
    return np.concatenate([position or home[:3], turned.ravel()])[None]


def _read_coordinates(machine: "Machine", option: str, text: str) -> list[float]:
    """Return the coordinates of the axes, (n,) in SI: leg lengths and angles."""
    axes = machine.axes
    names = [axis.name for axis in axes]
    homes = machine.home_q.tolist()
    if option == "--counts":
        counts = map(_read_count, _split(option, text, names))
        values = [count * axis.pulse for count, axis in zip(counts, axes, strict=True)]
    else:
        values = _read_values(option, text, [axis.unit for axis in axes], names)
    if option == "--lengths":
        return values
    return [home + value for home, value in zip(homes, values, strict=True)]


def _read_values(what: str, text: str, units: Sequence[str], names: Sequence[str]) -> list[float]:
    """Return the SI values of a list. Plain numbers are mm and degrees."""
    from kinematics.foundation.errors import locate_errors
    from kinematics.foundation.units import quantity

    parts = _split(what, text, names)
    values = []
    with locate_errors(what):
        for part, unit in zip(parts, units, strict=True):
            written = f"{part} {PLAIN[unit]}" if NUMBER.fullmatch(part) else part
            values.append(quantity(written, unit))
    return values


def _split(what: str, text: str, names: Sequence[str]) -> list[str]:
    """Return the entries of a list. Raises MotionError unless there is one for each name."""
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.names import count_noun
    from kinematics.foundation.units import describe_value

    parts = [part.strip() for part in text.split(",")]
    if len(parts) != len(names):
        raise MotionError(
            f"{what} {describe_value(text)}: {count_noun(len(parts), 'entry')}; write "
            f"{len(names)}, with commas between: {', '.join(names)}",
        )
    return parts


def _read_count(text: str) -> int:
    from kinematics.foundation.errors import MotionError
    from kinematics.foundation.units import describe_value

    if not COUNT.fullmatch(text):
        raise MotionError(f"--counts: {describe_value(text)} is not a whole number of pulses")
    return int(text)
