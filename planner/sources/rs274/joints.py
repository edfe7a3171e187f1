"""G-code of joint axes, as `planner.export.formats.g93` writes it: its words are actuators, so its
places are found by forward kinematics of the machine that it is for.

The way is taken over: a straight line from point to point, the rests, and the M codes as triggers.
The times are not: the program is planned as any other.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.program.model import MIN_MOVE, Dwell, Line, Program, Segment, Turn
from planner.program.modifiers import Join, Stop, Trigger
from planner.sources.rs274.words import WORD, Words, blocks
from planner.sources.source import Faults, Imported

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

MARK = "a joint axis, not Cartesian"
_AXIS = re.compile(r"\(([A-Z]) = (.+) in (mm|deg): a joint axis, not Cartesian\)")
_ORIGIN = re.compile(r"\(positions from (home|natural), in the sense of the axes\)")
_STAND = re.compile(r"\(the axes must stand at (.+)\)")
UNIT_FACTORS = {"mm": 1e3, "deg": 180 / pi}
_OUTPUT = re.compile(r"\(output (\d+) = trigger (.*)\)")
_ON, _OFF = ("62", "64"), ("63", "65")
MODES = {("G", "21"), ("G", "90"), ("G", "93"), ("G", "94"), ("M", "2")}
POSE_RESIDUAL = 1e-6
"""m or rad: residual of a pose that has been found, of coordinates with six decimals or more."""


@dataclass(frozen=True, slots=True)
class Header:
    """What a file says of its axes: letter, name and unit of each, and where they stand at first.

    origin  "home" or "natural"; None: it does not say
    """

    letters: tuple[str, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    origin: str | None
    stand: str | None
    line: int


def find_header(text: str) -> Header | None:
    """Return the header of a file of joint axes; None of any other G-code."""
    if MARK not in text:  # a long file is not worth splitting
        return None
    lines = text.split("\n")
    axes = [
        (number, found)
        for number, line in enumerate(lines, 1)
        if (found := _AXIS.fullmatch(line.strip()))
    ]
    if not axes:
        return None
    origin, stand = (
        next((found[1] for line in lines if (found := pattern.fullmatch(line.strip()))), None)
        for pattern in (_ORIGIN, _STAND)
    )
    letters, names, units = (tuple(found[k] for _, found in axes) for k in (1, 2, 3))
    return Header(letters, names, units, origin, stand, axes[0][0])


def read_joints(
    path: Path, text: str, header: Header, machine: str | None, join: Join, faults: Faults
) -> Imported:
    """The program of a file of joint axes on its machine.

    Raises FileError where no machine is told, for another machine than the header's, and for places
    that it cannot come to from home.
    """
    said = ", ".join(
        f"{letter} = {name}" for letter, name in zip(header.letters, header.names, strict=True)
    )
    if machine is None:
        faults.add(
            f"its words are joint axes ({said}), not tool positions: give its machine with the option machine "
            "(--machine), or plan the program that it was exported from",
            header.line,
        )
        faults.refuse()
    from kinematics.machine.machine_file import load_machine

    of = load_machine(machine or "")
    _refuse_other(of, header, said, faults)
    numbers, rows, rests, events = _points(text, header, faults)
    faults.refuse()
    factors = np.array([UNIT_FACTORS[unit] for unit in header.units])
    q = np.array(rows) / factors + (of.home_q if header.origin == "home" else 0.0)
    found = of.forward(q)
    for k in np.flatnonzero((found.residual > POSE_RESIDUAL) | ~found.certified).tolist():
        faults.add(
            f"with axes there {of.name} has no pose that is proved to be connected to home",
            numbers[k],
        )
    faults.refuse()
    turns = bool({"rx", "ry", "rz"} & set(of.freedom))
    segments: list[Segment] = []
    place, turned = found.pose[0].translation, found.pose[0].rotation
    for k in range(1, len(q)):
        pose = found.pose[k]
        moves = float(np.linalg.norm(pose.translation - place)) > MIN_MOVE
        rotates = turns and float((turned.inv() * pose.rotation).magnitude()) > MIN_MOVE
        if moves:
            segments.append(
                Line(
                    pose.translation,
                    pose.rotation if rotates else None,
                    None,
                    join,
                    line_number=numbers[k],
                )
            )
        elif rotates:
            segments.append(Turn(pose.rotation, Stop(), line_number=numbers[k]))
        if moves or rotates:
            place, turned = pose.translation, pose.rotation
        if rests[k] > 0:
            if segments and not isinstance(segments[-1], Dwell):
                segments[-1] = replace(segments[-1], join=Stop())
            segments.append(Dwell(rests[k], line_number=numbers[k]))
        if segments and events[k]:
            segments[-1] = replace(segments[-1], trigger=Trigger(" ".join(events[k])))
    if segments and events[0]:
        before = segments[0].trigger
        names = events[0] if before is None else [*events[0], before.name]
        segments[0] = replace(segments[0], trigger=Trigger(" ".join(names), 0.0))
    if all(isinstance(segment, Dwell) for segment in segments):
        faults.add("nothing moves: all its points are the same")
    faults.refuse()
    named = (
        None if Path(of.name).suffix or machine != of.name else machine
    )  # a path would count from the program
    program = Program(tuple(segments), "base", found.pose[0], named, name=path.stem)
    rested = sum(rest > 0 for rest in rests)
    told = (
        f"its words are joint axes: positions are those of {of.name}, proved to be connected to home ({said})",
        f"straight lines between them deviate from straight lines of the axes by up to {1e6 * _bulge(of, q):.3g} um",
        "its times are ignored: the plan is as fast as possible, or has the duration asked for",
    )
    return Imported(program, {"G1": len(q) - 1 - rested, "G4": rested}, told)


def _refuse_other(machine: "Machine", header: Header, said: str, faults: Faults) -> None:
    from planner.export.formats.g93 import header_name

    axes = machine.axes
    wanted = tuple("mm" if axis.kind == "linear" else "deg" for axis in axes)
    if header.names != tuple(header_name(axis.name) for axis in axes) or header.units != wanted:
        own = ", ".join(f"{axis.name} in {unit}" for axis, unit in zip(axes, wanted, strict=True))
        faults.add(
            f"it is for the axes {said}; machine {machine.name} has {own}: give its own machine",
            header.line,
        )
    if header.origin is None or header.stand is None:
        faults.add(
            "its header does not state the origin and the start of the axes: export it again",
            header.line,
        )
    if corrected := [axis.name for axis in axes if axis.compensate]:
        faults.add(
            f"axes {', '.join(corrected)} of machine {machine.name} compensate play or lead, so that the positions in "
            "the file are their motors' and lead to no pose; plan the program that it was exported from",
            header.line,
        )
    faults.refuse()


Points = tuple[list[int], list[list[float]], list[float], list[list[str]]]


def _points(text: str, header: Header, faults: Faults) -> Points:
    """Return line, positions in the file's units, s of rest and names of triggers of each point.

    The first point is where the axes stand. A trigger belongs to the point before its line.
    """
    start = WORD.findall(header.stand or "")
    numbers, rows, rests = [header.line], [_row(header, start, header.line, faults)], [0.0]
    stated = (_OUTPUT.fullmatch(line.strip()) for line in text.split("\n"))
    outputs = {match[1]: match[2] for match in stated if match is not None}
    events: list[list[str]] = [[]]
    for number, _, found, _ in blocks(text, faults):
        said = [(letter.upper(), value) for letter, value in found]
        if set(said) <= MODES:
            continue
        letters = [letter for letter, _ in said]
        if said[0][0] == "M" and set(letters) <= {"M", "P", "S", "T"}:
            name = _find_trigger(said, outputs)
            events[-1] += [name] if name else []
            continue
        if said[0] == ("G", "1") and letters[1:] == [*header.letters, "F"]:
            rows.append(_row(header, said[1:-1], number, faults))
            rests.append(0.0)
        elif said[0] == ("G", "4") and letters[1:] == ["P"]:
            rows.append(rows[-1])
            rests.append(float(said[1][1]))
        else:
            faults.add(
                f"not a line of a file of joint axes, which has G1 {' '.join(header.letters)} F, and G4 P",
                number,
            )
            continue
        numbers.append(number)
        events.append([])
    return numbers, rows, rests, events


def _find_trigger(words: Words, outputs: dict[str, str]) -> str:
    """Return the name of the trigger of an M code, "" where it switches an output off."""
    code = words[0][1]
    if code in _OFF:
        return ""
    if code in _ON and len(words) == 2:
        return outputs.get(words[1][1], f"output {words[1][1]}")
    return " ".join(f"{letter}{value}" for letter, value in words)


def _row(header: Header, said: Words, number: int, faults: Faults) -> list[float]:
    if [letter for letter, _ in said] != list(header.letters):
        faults.add(f"a point has {' '.join(header.letters)}, in this order", number)
        return [0.0] * len(header.letters)
    return [float(value) for _, value in said]


def _bulge(machine: "Machine", q: Array) -> float:
    """m: how far the middles of the axes' straight lines between points (N, n) are from straight
    lines in space.
    """
    ends = machine.forward(q, certify=False).pose.translation
    middle = machine.forward((q[1:] + q[:-1]) / 2, certify=False).pose.translation
    return float(np.linalg.norm(middle - (ends[1:] + ends[:-1]) / 2, axis=1).max(initial=0.0))


def refuse_options(given: Sequence[str]) -> None:
    """Raise MotionError for options that say something about places, which such a file has none
    of.
    """
    if given:
        raise MotionError(
            f"gcode: {', '.join(given)} does not apply to a file of joint axes; omit it"
        )
