"""G-code in inverse time: on every G1 line F is 1 / minutes, so each straight piece lasts exactly what it says.

    (pulsepath: circle)
    (X = leg1 in mm: a joint axis, not Cartesian)
    (Y = leg2 in mm: a joint axis, not Cartesian)
    (Z = leg3 in mm: a joint axis, not Cartesian)
    (positions from home, in the sense of the axes)
    (the axes must stand at X21.0935915 Y27.0092485 Z25.7989127)
    G21 G90 G93
    G1 X21.0947185 Y27.0050374 Z25.7935812 F3000
    G4 P0.2
    G94
    M2

- The words are the machine's axes, joints, not the tool's place: positions in mm or degrees from home, or natural
  coordinates. Axes go straight and evenly from point to point, which has speeds jump a little at every one.
- The axes stand where the file begins: a stop that begins in motion is refused.
- A rest is G4 with P in seconds, since controllers take no time for a G1 that does not move.
- The controller has to keep the path (exact path mode, G61) and to be able to follow: one that plans its own
  accelerations stretches the times.
- F has 12 digits, so an hour of pieces is off by less than 10 ns.
- `planner.sources.gcode` reads it again, as the program of the places, where it is told the machine.
- ASCII, line ends \\n, decimal points whatever the locale; brackets in names show as square ones.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import Array
from planner.export.columns import (
    LETTERS,
    Columns,
    assign_letters,
    describe_letters,
    letters_option,
    line_blocks,
    make_columns,
    origin_option,
    plain,
)
from planner.export.format import Exported, ExportSource
from planner.export.knots import KnotFormat, compare, refuse_moving_ends, rows_at

TIME_STEP = 1e-6
SQUARE_BRACKETS = str.maketrans("()", "[]")


@dataclass(frozen=True, slots=True)
class InverseTime(KnotFormat):
    """G-code in inverse time (G93): joint axes, straight between points."""

    suffix: ClassVar[str] = ".ngc"
    from_rest: ClassVar[str] = "G-code in inverse time"
    origin: Literal["home", "natural"] = origin_option("home")
    letters: str | None = letters_option()

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        refuse_moving_ends(motion, axes, self.from_rest)  # a controller starts a file from standstill
        letters = assign_letters(axes, self.letters, LETTERS, "G-code")
        knots = self.knots(source, 1, TIME_STEP)
        form = make_columns(source, knots.tolerance, origin=self.origin)
        with path.open("w", encoding="ascii", newline="") as file:
            about = [f"pulsepath: {source.name}"]
            for letter, axis, unit in zip(letters, axes, form.units, strict=True):
                about.append(f"{letter} = {axis.name} in {unit}: a joint axis, not Cartesian")
            about.append(f"positions from {self.origin}, in the sense of the axes")
            file.writelines(f"({header_name(text)})\n" for text in about)
            before = ""
            for steps, units in form.blocks(source, knots, 1):
                for lasting, row in zip((steps * TIME_STEP).tolist(), form.text_rows(units), strict=True):
                    words = " ".join(map("".join, zip(letters, row, strict=True)))
                    if not before:
                        file.write(f"(the axes must stand at {words})\nG21 G90 G93\n")
                    elif words == before:
                        file.write(f"G4 P{lasting:.6f}\n")
                    else:
                        file.write(f"G1 {words} F{60 / lasting:.12g}\n")
                    before = words
            file.write("G94\nM2\n")
        notes = (describe_letters(axes, letters), f"joint axes, positions from {self.origin}, in the sense of the axes")
        return compare(motion, axes, knots, _points(source, form, path), notes)


def header_name(text: str) -> str:
    """A text as a comment of the header has it, so that its reader knows a name again."""
    return plain(text).translate(SQUARE_BRACKETS)


def _points(source: ExportSource, form: Columns, path: Path) -> Iterator[tuple[Array, Array]]:
    """Where the lines lead from where the axes stand."""
    at = rows_at(source.counted, np.zeros(1), 1)
    yield np.zeros(1), at
    t, place = 0.0, ((at[0, 0] - form.zero) * form.factor).tolist()
    for lines in line_blocks(path):
        times, places = [], []
        for line in lines:
            code, *words = line.split()
            if code == "G1":
                t += 60 / float(words[-1][1:])
                place = [float(word[1:]) for word in words[:-1]]
            elif code == "G4":
                t += float(words[0][1:])
            if code in ("G1", "G4"):
                times.append(t)
                places.append(place)
        if times:
            yield np.array(times), form.natural(np.array(places)[None])
