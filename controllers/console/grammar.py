"""From a line of text to its words, or an English diagnostic: a line that is not wholly understood
does nothing.

Operator [Sasidhar 1981, Appendix F]:   JOG X CW | POS X CW 100 Z CCW 20 | HOME Y | REM | MAN | TEST
  the key θ, or THETA                   is the rotary axis R, as on its keyboard; the remote line
                                        says R
  added here:                           STOP | WHERE | ACCEPT | HELP | MOVE x y z [rx ry rz], mm and
                                        degrees from home PTP x y z [rx ry rz], synchronised [Sahbaz
                                        2007, 5.2.3] HOME X AT 24 in Y AT 600 mm R AT 90 deg
Remote:                                 P X + 100 Y - 40 Z + 80
  added here:                           STOP | WHERE | MOVE … | PTP …
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError

Mode = Literal["MAN", "REM", "TEST"]


@dataclass(frozen=True, slots=True)
class Jog:
    """One axis slowly, clockwise (+1) or counterclockwise (−1) of its motor, until it is stopped or
    at its end.
    """

    axis: int
    sign: int


@dataclass(frozen=True, slots=True)
class Position:
    """Axes by signed steps, clockwise positive, all starting together: (axis, steps) each."""

    steps: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True)
class Move:
    """The tool to a pose relative to home: x y z in m, turns about x y z in rad, Rx·Ry·Rz; along a
    straight line.

    synchronised  from point to point instead: every axis straight to its place, all together
    """

    pose: Array
    synchronised: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", freeze_array(self.pose, float))


@dataclass(frozen=True, slots=True)
class Home:
    """Axes whose registers become zero where they stand, and what that says of their slides.

    Nothing moves.

    places  (axis, quantity) each: the slide stands there in its travel, as "24 in". None says
            nothing of one whose place is known; one whose place is not known then stands at its
            switch, where travel is 0
    """

    places: tuple[tuple[int, str | None], ...]


@dataclass(frozen=True, slots=True)
class Accept:
    """The last known registers, which a restart offers, hold. Nothing moves."""


@dataclass(frozen=True, slots=True)
class Switch:
    """Another mode."""

    mode: Mode


@dataclass(frozen=True, slots=True)
class Halt:
    """All axes ramp down, and what waits is dropped."""


@dataclass(frozen=True, slots=True)
class Where:
    """The registers, asked for."""


@dataclass(frozen=True, slots=True)
class Help:
    """The commands, asked for."""


Words = Jog | Position | Move | Home | Accept | Switch | Halt | Where | Help


ROTARY, ROTARY_KEYS = "R", ("Θ", "THETA")
"""The rotary axis' name on the remote line, and what stands for it on the operator's [Sasidhar
1981, F.2, F.4].
"""
TURNS = {"CW": 1, "CCW": -1}
SIGNS = {"+": 1, "-": -1}
STEPS = re.compile(r"[0-9]{1,9}", re.ASCII)
NUMBER = re.compile(r"[+-]?([0-9]{1,6}(\.[0-9]{0,9})?|\.[0-9]{1,9})", re.ASCII)
PLAIN_COMMANDS: dict[str, Words] = {
    "STOP": Halt(),
    "WHERE": Where(),
    "ACCEPT": Accept(),
    "HELP": Help(),
    "REM": Switch("REM"),
    "MAN": Switch("MAN"),
    "TEST": Switch("TEST"),
}
OPERATOR_COMMANDS = ("JOG", "POS", "MOVE", "PTP", "HOME", *PLAIN_COMMANDS)
REMOTE_COMMANDS = ("P", "MOVE", "PTP", "STOP", "WHERE")


class MisreadLine(MotionError):
    """A line that is no command, and why."""


def parse_operator_line(line: str, names: Sequence[str]) -> Words:
    """A line of the operator, in capitals or not; names: of the axes, in capitals.

    Raises MisreadLine.
    """
    words = ["THETA" if word in ROTARY_KEYS else word for word in line.upper().split()]
    if ROTARY in names and "THETA" not in names:
        words = [ROTARY if word == "THETA" else word for word in words]
    return _read(words, names, OPERATOR_COMMANDS)


def remote(line: str, names: Sequence[str]) -> Words:
    """A line of the remote computer, in capitals. Raises MisreadLine."""
    return _read(line.split(), names, REMOTE_COMMANDS)


def _read(words: list[str], names: Sequence[str], known: Sequence[str]) -> Words:
    if not words:
        raise MisreadLine(f"an empty line; commands: {', '.join(known)}")
    first, rest = words[0], words[1:]
    if first not in known:
        raise MisreadLine(f"{first} is not a command; commands: {', '.join(known)}")
    if first in PLAIN_COMMANDS:
        if rest:
            raise MisreadLine(f"{first} takes no arguments, not {' '.join(rest)}")
        return PLAIN_COMMANDS[first]
    match first:
        case "JOG":
            if len(rest) != 2:
                raise MisreadLine("JOG takes an axis and CW or CCW, as JOG X CW")
            return Jog(_axis(rest[0], names), _sign(rest[1], TURNS))
        case "HOME":
            return _home(rest, names)
        case "MOVE" | "PTP":
            if len(rest) not in (3, 6) or not all(NUMBER.fullmatch(word) for word in rest):
                raise MisreadLine(
                    f"{first} takes x y z in mm, and may take rx ry rz in degrees, as {first} 0 0 25.5 or -1.5"
                )
            numbers = [float(word) for word in rest] + [0.0] * (6 - len(rest))
            return Move(np.array(numbers) * ([1e-3] * 3 + [np.pi / 180] * 3), first == "PTP")
        case _:
            return _position(first, rest, names, TURNS if first == "POS" else SIGNS)


def _home(rest: list[str], names: Sequence[str]) -> Home:
    places: list[tuple[int, str | None]] = []
    while rest:
        axis, rest = _axis(rest[0], names), rest[1:]
        place = None
        if rest[:1] == ["AT"]:
            # "24 in" and "24in"
            count = 3 if len(rest) > 1 and NUMBER.fullmatch(rest[1]) else 2
            if len(rest) < count or not NUMBER.match(rest[1]):
                raise MisreadLine(
                    f"AT takes where the slide stands, as HOME {names[axis]} AT 24 in"
                )
            place, rest = " ".join(rest[1:count]).lower(), rest[count:]
        places.append((axis, place))
    if not places:
        raise MisreadLine(
            f"HOME takes axes, and may take where they stand, as HOME {names[0]} or HOME {names[0]} AT 24 in"
        )
    _refuse_repeated([axis for axis, _ in places], names)
    return Home(tuple(places))


def _position(first: str, rest: list[str], names: Sequence[str], signs: dict[str, int]) -> Position:
    one, other = signs
    if not rest or len(rest) % 3:
        raise MisreadLine(
            f"{first} takes an axis, {one} or {other}, and steps, for each axis: {first} {names[0]} {one} 100"
        )
    steps = []
    for axis, sign, number in zip(rest[::3], rest[1::3], rest[2::3], strict=True):
        if not STEPS.fullmatch(number):
            raise MisreadLine(
                f"{number} is not a number of steps: at most nine digits, and nothing else"
            )
        steps.append((_axis(axis, names), _sign(sign, signs) * int(number)))
    _refuse_repeated([axis for axis, _ in steps], names)
    return Position(tuple(steps))


def _axis(word: str, names: Sequence[str]) -> int:
    if word not in names:
        raise MisreadLine(f"{word} is not an axis; axes: {', '.join(names)}")
    return names.index(word)


def _sign(word: str, signs: dict[str, int]) -> int:
    if word not in signs:
        raise MisreadLine(f"{word} is not a direction; directions: {' and '.join(signs)}")
    return signs[word]


def _refuse_repeated(axes: Sequence[int], names: Sequence[str]) -> None:
    for axis in axes:
        if axes.count(axis) > 1:
            raise MisreadLine(f"axis {names[axis]} is given twice; give each once")
