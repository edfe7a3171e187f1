"""Systems of coordinates of a G-code file, their shift, and the tool offsets that are left out.

p = Rz(R) · (u + g) + o − w, with u a block's numbers (m), g the shift of G92 or G52, o and R the
offset and the turn of the active system, and w the position of the file's zero (option `origin`),
all measured from home but p, which is in the program's frame. The angles of A, B and C are α = u +
g + o: a system's turn does not change them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import cos, radians, sin

from kinematics.foundation.errors import MotionError
from planner.sources.rs274.words import SYSTEMS

AXES = "XYZABC"
Point = tuple[float, float, float]
Shift = tuple[float, float, float, float, float, float]
"""Of X, Y, Z in m and A, B, C in rad."""
NO_SHIFT: Shift = (0.0,) * 6


@dataclass(frozen=True, slots=True)
class System:
    """One of G54 to G59.3.

    stated  whether the file states it, so that it does not depend on the controller's table
    """

    offset: Shift
    turn: float = 0.0
    stated: bool = False


class Coordinates:
    """The active system of a file and its shift.

    zero     (3,) from home to the file's zero, m
    shifted  whether the shift of G52 or G92 applies: G92.2 suspends it
    """

    def __init__(self, zero: Point) -> None:
        self.zero = zero
        self._systems = {code: System((*zero, 0.0, 0.0, 0.0)) for code in SYSTEMS}
        self._active, self._said, self._moved = SYSTEMS[0], False, 0.0
        self._shift: Shift = NO_SHIFT
        self.shifted = False
        self._plain = True

    @property
    def active(self) -> float:
        """The active system, 54 to 59.3."""
        return self._active

    def to_program(self, u: list[float]) -> list[float]:
        """Return the program's point (3,) of a block's numbers."""
        if self._plain:
            return u
        return self._transform(self._systems[self._active], u)

    def _transform(self, system: System, u: Sequence[float]) -> list[float]:
        gap, offset, zero = self._gap, system.offset, self.zero
        x, y = rotate(u[0] + gap[0], u[1] + gap[1], system.turn)
        return [
            x + offset[0] - zero[0],
            y + offset[1] - zero[1],
            u[2] + gap[2] + offset[2] - zero[2],
        ]

    def from_program(self, p: list[float]) -> list[float]:
        """Return the numbers of a program's point (3,)."""
        if self._plain:
            return p
        return self._invert(self._systems[self._active], p)

    def _invert(self, system: System, p: Sequence[float]) -> list[float]:
        gap, offset, zero = self._gap, system.offset, self.zero
        x, y = rotate(p[0] + zero[0] - offset[0], p[1] + zero[1] - offset[1], -system.turn)
        return [x - gap[0], y - gap[1], p[2] + zero[2] - offset[2] - gap[2]]

    def turn(self, x: float, y: float) -> tuple[float, float]:
        """Return a direction of the active system in the program's frame."""
        return rotate(x, y, self._systems[self._active].turn)

    @property
    def angles(self) -> Point:
        """The angles (3,) rad at which A, B and C are 0."""
        gap, offset = self._gap, self._systems[self._active].offset
        return (gap[3] + offset[3], gap[4] + offset[4], gap[5] + offset[5])

    @property
    def _gap(self) -> Shift:
        return self._shift if self.shifted else NO_SHIFT

    def _settle(self) -> None:
        system = self._systems[self._active]
        self._plain = system.offset[:3] == self.zero and not system.turn and not any(self._gap[:3])

    def choose(self, code: float) -> None:
        """Activate one of G54 to G59.3."""
        self._active, self._said = code, True
        self._settle()

    def move(self) -> tuple[str, str] | None:
        """Note that the tool moves.

        Return the system of the last move and the active one, if they differ and neither is stated.
        """
        if not self._said or self._systems[self._active].stated:
            return None
        before, self._moved = (
            self._moved or self._active,
            self._active,
        )  # so that a change is reported once
        return None if before == self._active else (f"G{before:g}", f"G{self._active:g}")

    def state(self, values: Mapping[str, float], unit: float, place: Sequence[float]) -> None:
        """Run G10: L2 states a system's offset and turn, L20 the numbers of the tool in it.

        place  (6,) of the tool in the program's frame. Under L20, letters that are missing keep
               their numbers.
        Raises MotionError for words that do not fit.
        """
        number = values.get("P", -1.0)
        if number not in range(len(SYSTEMS) + 1):
            raise MotionError(
                "G10 needs P, the system: 1 for G54 to 9 for G59.3, or 0 for the active one",
            )
        code = SYSTEMS[int(number) - 1] if number else self._active
        before = self._systems[code]
        given = to_metres(values, unit)
        offset = list(before.offset)
        turn = before.turn
        if values["L"] == 2:
            turn = radians(values["R"]) if "R" in values else turn
            for k, value in given.items():
                offset[k] = value
        else:
            if "R" in values:
                raise MotionError("G10 L20 takes no R: state the turn by G10 L2")
            numbers = [
                *self._invert(before, place),
                *(place[k] - before.offset[k] - self._gap[k] for k in (3, 4, 5)),
            ]
            named = [given.get(k, number) for k, number in enumerate(numbers)]
            point = self._transform(before, named)
            for k in range(3):
                offset[k] += place[k] - point[k]
            for k in range(3, 6):
                offset[k] += numbers[k] - named[k]
        self._systems[code] = System(_six(offset), turn, stated=True)
        self._settle()

    def shift(
        self,
        code: float,
        values: Mapping[str, float],
        unit: float,
        u: Sequence[float],
    ) -> None:
        """Run G92, the place of the tool has these numbers, and G52, the zero is shifted by them.

        u  (6,) numbers that the tool has now. G92.1 ends the shift, G92.2 suspends it, G92.3 brings
           it back.
        G52 and G92 state the same shift, as in LinuxCNC.
        """
        if code in (52, 92):
            gap = list(self._gap)
            for k, value in to_metres(values, unit).items():
                gap[k] = value if code == 52 else gap[k] + u[k] - value
            self._shift = _six(gap)
        elif code == 92.1:
            self._shift = NO_SHIFT
        self.shifted = code in (52, 92, 92.3)
        self._settle()


def rotate(x: float, y: float, angle: float) -> tuple[float, float]:
    """Return a direction turned about z by an angle, rad."""
    if not angle:
        return (x, y)
    return (cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y)


def to_metres(values: Mapping[str, float], unit: float) -> dict[int, float]:
    """Return the numbers of axis words, m and rad, by the axis' place in XYZABC."""
    return {
        k: values[axis] * unit if k < 3 else radians(values[axis])
        for k, axis in enumerate(AXES)
        if axis in values
    }


def _six(values: Sequence[float]) -> Shift:
    x, y, z, a, b, c = values
    return (x, y, z, a, b, c)


class ToolOffsets:
    """The tool offset that words state which are left out.

    A program that moves under two offsets is another path without them: the offset of each move is
    compared with that of
    the move before. As long as no word states one, any offset is as good.

    active  the words that state the offset, as G43 H1; empty: none
    """

    def __init__(self) -> None:
        self.active = self._moved = ""
        self._tool = self._loaded = ""

    def block(self, left_out: list[tuple[str, float]]) -> None:
        """Take the words of a block that are left out, letters and numbers, and G49."""
        number = {letter: value for letter, value in left_out if letter != "G" and letter != "M"}
        self._tool = f"T{number['T']:g}" if "T" in number else self._tool
        if ("M", 6.0) in left_out:
            self._loaded = self._tool
        for letter, value in left_out:
            if letter == "G" and value == 49:
                self.active = "G49"
            elif letter == "G" and value == 43:
                self.active = (
                    f"G43 H{number['H']:g}" if "H" in number else f"G43 {self._loaded}".strip()
                )

    def move(self) -> tuple[str, str] | None:
        """Return the offset of the last move and the active one, if they differ."""
        if not self.active:
            return None
        before, self._moved = (
            self._moved or self.active,
            self.active,
        )  # so that a change is reported once
        return None if before == self.active else (before, self.active)
