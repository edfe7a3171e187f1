"""From where the numbers of a G-code file count: its systems, what shifts them, and the offsets that are left out.

p = Rz(R) · (u + g) + o − w, with u a block's numbers (m), g the shift of G92, o and R the offset and the turn of the
active system, and w where the option `origin` puts the file's zero. All from home but p, which is a program's.
"""

from dataclasses import dataclass
from math import cos, radians, sin

from kinematics.foundation.errors import MotionError
from planner.sources.rs274.words import SYSTEMS

Point = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class System:
    """One of G54 to G59.3; stated: by the file itself, so that its place does not depend on the controller's table."""

    offset: Point
    turn: float = 0.0
    stated: bool = False


class Coordinates:
    """What holds of a file's systems; zero (3,): from home to where the file's zero is put, m."""

    def __init__(self, zero: Point) -> None:
        self.zero = zero
        self._systems = {code: System(zero) for code in SYSTEMS}
        self._active, self._said, self._moved = SYSTEMS[0], False, 0.0
        self._shift: Point = (0.0, 0.0, 0.0)
        self._shifted = True
        self._plain = True

    @property
    def turned(self) -> bool:
        """Whether the active system is turned about z."""
        return self._systems[self._active].turn != 0

    def to_program(self, u: list[float]) -> list[float]:
        """The program's point (3,) of a block's numbers."""
        if self._plain:
            return u
        x, y, z = (a + b for a, b in zip(u, self._gap, strict=True))
        x, y = self.turn(x, y)
        o, w = self._systems[self._active].offset, self.zero
        return [x + o[0] - w[0], y + o[1] - w[1], z + o[2] - w[2]]

    def from_program(self, p: list[float]) -> list[float]:
        """The numbers of a program's point (3,)."""
        if self._plain:
            return p
        o, w, gap = self._systems[self._active].offset, self.zero, self._gap
        x, y = self.turn(p[0] + w[0] - o[0], p[1] + w[1] - o[1], -1)
        return [x - gap[0], y - gap[1], p[2] + w[2] - o[2] - gap[2]]

    def turn(self, x: float, y: float, way: int = 1) -> tuple[float, float]:
        """A direction of the active system, in the program's."""
        angle = way * self._systems[self._active].turn
        return (cos(angle) * x - sin(angle) * y, sin(angle) * x + cos(angle) * y) if angle else (x, y)

    @property
    def _gap(self) -> Point:
        return self._shift if self._shifted else (0.0, 0.0, 0.0)

    def _settle(self) -> None:
        system = self._systems[self._active]
        self._plain = system.offset == self.zero and not system.turn and not any(self._gap)

    def choose(self, code: float) -> None:
        """G54 to G59.3."""
        self._active, self._said = code, True
        self._settle()

    def move(self) -> tuple[str, str] | None:
        """The tool moves: two systems whose places the file does not state under which it has, if there are two."""
        if not self._said or self._systems[self._active].stated:
            return None
        before, self._moved = self._moved or self._active, self._active  # which is told once
        return None if before == self._active else (f"G{before:g}", f"G{self._active:g}")

    def state(self, values: dict[str, float], unit: float, place: list[float]) -> None:
        """G10 L2 and L20 P: a system's offset and turn, or where the tool stands in it; place: in the program.

        Raises MotionError with what does not fit.
        """
        number = values.get("P", -1.0)
        if number not in range(len(SYSTEMS) + 1):
            raise MotionError("G10 needs P, the system: 1 for G54 to 9 for G59.3, or 0 for the active one")
        code = SYSTEMS[int(number) - 1] if number else self._active
        before = self._systems[code]
        turn = radians(values.get("R", 0.0)) if "R" in values else before.turn
        offset = list(before.offset)
        for k, axis in enumerate("XYZ"):
            if axis in values:
                offset[k] = values[axis] * unit
                if values["L"] == 20:
                    offset[k] = place[k] + self.zero[k] - offset[k] - self._gap[k]
        if values["L"] == 20 and turn:
            raise MotionError("G10 L20 of a system that is turned is not supported: state its offset by G10 L2")
        self._systems[code] = System((offset[0], offset[1], offset[2]), turn, stated=True)
        self._settle()

    def shift(self, code: float, values: dict[str, float], unit: float, u: list[float]) -> None:
        """G92 X Y Z: the tool stands at these numbers, which it has as u; G92.1: no more, .2: not now, .3: again."""
        if code == 92:
            gap = list(self._gap)
            for k, axis in enumerate("XYZ"):
                if axis in values:
                    gap[k] += u[k] - values[axis] * unit
            self._shift, self._shifted = (gap[0], gap[1], gap[2]), True
        elif code == 92.1:
            self._shift = (0.0, 0.0, 0.0)
        else:
            self._shifted = code == 92.3
        self._settle()


class ToolOffsets:
    """What words that are left out say of the tool's offset.

    A program that moves under two of them is another path without them: what holds when it moves is compared with what
    held before. Where it has said nothing yet, any is as good.
    """

    def __init__(self) -> None:
        self._said = self._moved = ""
        self._tool = self._loaded = ""

    def block(self, left_out: list[tuple[str, float]]) -> None:
        """The words of a block that are left out, letters and numbers, and G49."""
        number = {letter: value for letter, value in left_out if letter != "G" and letter != "M"}
        self._tool = f"T{number['T']:g}" if "T" in number else self._tool
        if ("M", 6.0) in left_out:
            self._loaded = self._tool
        for letter, value in left_out:
            if letter == "G" and value == 49:
                self._said = "G49"
            elif letter == "G" and value == 43:
                self._said = f"G43 H{number['H']:g}" if "H" in number else f"G43 {self._loaded}".strip()

    def move(self) -> tuple[str, str] | None:
        """Two offsets, the one under which it moved and the one under which it moves now, if they are not the same."""
        if not self._said:
            return None
        before, self._moved = self._moved or self._said, self._said  # which is told once
        return None if before == self._said else (before, self._said)
