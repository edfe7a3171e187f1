"""G-code in inverse time: on every G1 line F is 1 / minutes, so each straight piece lasts exactly
what it says.

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

- The words are the machine's axes, joints, not the position of the tool: in mm or degrees from
  home, or natural coordinates. Axes go straight and evenly from point to point, which has speeds
  jump a little at every one.
- The axes stand where the file begins: a stop that begins in motion is refused.
- A rest is G4 with P in seconds, since controllers take no time for a G1 that does not move.
- The controller has to keep the path (exact path mode, G61) and to be able to follow: one that
  plans its own accelerations stretches the times.
- A trigger is an M code at its place, where a piece ends for it. One whose name is made of the
  words M0, M1, M3 to M9, M60, M100 to M199, T and S is written as it is called: "M3 S1200". Any
  other name has a digital output, which the header states: M62 P0 before the piece that follows,
  M63 P0 before the next; at a rest and at the end M64 P0 and M65 P0, since the others wait for a
  motion.
- F has 12 digits, so an hour of pieces is off by less than 10 ns.
- `planner.sources.gcode` reads it again, as the program of the places, where it is told the
  machine.
- ASCII, line ends \\n, decimal points whatever the locale; brackets in names show as square ones.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.units import describe_value
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
from planner.export.knots import KnotFormat, Steps, compare, refuse_moving_ends, rows_at
from planner.pulses.triggers import Triggered

TIME_STEP = 1e-6
SQUARE_BRACKETS = str.maketrans("()", "[]")


@dataclass(frozen=True, slots=True)
class InverseTime(KnotFormat):
    """G-code in inverse time (G93): joint axes, straight between points."""

    suffix: ClassVar[str] = ".ngc"
    from_rest: ClassVar[str] = "G-code in inverse time"
    triggered: ClassVar[bool] = True
    origin: Literal["home", "natural"] = origin_option("home")
    letters: str | None = letters_option()

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        refuse_moving_ends(
            motion, axes, self.from_rest
        )  # a controller starts a file from standstill
        letters = assign_letters(axes, self.letters, LETTERS, "G-code")
        knots = self.knots(source, 1, TIME_STEP)
        marks = np.rint(
            np.array([event.time for event in source.triggers], float) / TIME_STEP
        ).astype(np.int64)
        if self.spacing is None:
            # a trigger within a step of a point is at it, as at the end of the motion
            apart = abs(marks - knots.steps[_find_nearest(knots.steps, marks)])
            knots = replace(knots, steps=np.union1d(knots.steps, marks[apart > 1]))
        codes = MarkedCodes(source.triggers, marks, knots.steps)
        form = make_columns(source, knots.tolerance, origin=self.origin)
        with path.open("w", encoding="ascii", newline="") as file:
            about = [f"pulsepath: {source.name}"]
            for letter, axis, unit in zip(letters, axes, form.units, strict=True):
                about.append(f"{letter} = {axis.name} in {unit}: a joint axis, not Cartesian")
            about.append(f"positions from {self.origin}, in the sense of the axes")
            about += codes.describe_outputs()
            file.writelines(f"({header_name(text)})\n" for text in about)
            before, knot = "", 0
            for steps, units in form.blocks(source, knots, 1):
                for lasting, row in zip(
                    (steps * TIME_STEP).tolist(), form.text_rows(units), strict=True
                ):
                    words = " ".join(map("".join, zip(letters, row, strict=True)))
                    if not before:
                        file.write(f"(the axes must stand at {words})\nG21 G90 G93\n")
                    elif words == before:
                        file.write(codes.at(knot - 1, moving=False) + f"G4 P{lasting:.6f}\n")
                    else:
                        file.write(
                            codes.at(knot - 1, moving=True) + f"G1 {words} F{60 / lasting:.12g}\n"
                        )
                    before = words
                    knot += 1
            file.write(codes.at(knot - 1, moving=False) + "G94\nM2\n")
        notes = (
            describe_letters(axes, letters),
            f"joint axes, positions from {self.origin}, in the sense of the axes",
            *codes.notes(),
        )
        return compare(motion, axes, knots, _points(source, form, path), notes)


def _find_nearest(steps: Steps, marks: Steps) -> Steps:
    """Return the index of the knot nearest to each mark; there are two knots or more."""
    after = np.clip(np.searchsorted(steps, marks), 1, len(steps) - 1)
    return np.where(marks - steps[after - 1] <= steps[after] - marks, after - 1, after)


class MarkedCodes:
    """M codes of triggers, by the knot at which each fires.

    triggers  of the motion, and `marks` (N,), the time steps of each
    steps     (K,) of the knots, of which each trigger takes the nearest
    """

    def __init__(self, triggers: Sequence[Triggered], marks: Steps, steps: Steps) -> None:
        nearest = _find_nearest(steps, marks)
        self.off = int(abs(steps[nearest] - marks).max(initial=0))
        self.count = len(triggers)
        others = dict.fromkeys(event.name for event in triggers if not is_machine_code(event.name))
        self.outputs = {name: number for number, name in enumerate(others)}
        self._names: dict[int, list[str]] = {}
        for event, knot in zip(triggers, nearest.tolist(), strict=True):
            self._names.setdefault(knot, []).append(event.name)
        self._high: list[int] = []

    def describe_outputs(self) -> list[str]:
        """Return a line of the header for each name that has an output."""
        return [f"output {number} = trigger {name}" for name, number in self.outputs.items()]

    def at(self, knot: int, *, moving: bool) -> str:
        """Return the lines of a knot; moving: a motion follows, not a rest or the end.

        To be called in order.
        """
        names = self._names.get(knot, [])
        rising = list(dict.fromkeys(self.outputs[name] for name in names if name in self.outputs))
        lines = [word for name in names if name not in self.outputs for word in split_codes(name)]
        on, off = ("M62", "M63") if moving else ("M64", "M65")
        lines += [f"{off} P{number}" for number in self._high if number not in rising]
        lines += [f"{on} P{number}" for number in rising]
        self._high = rising
        if not moving:  # these take effect at once
            lines += [f"{off} P{number}" for number in rising]
            self._high = []
        return "".join(f"{line}\n" for line in lines)

    def notes(self) -> tuple[str, ...]:
        """Return how triggers are written, and by how much they are off; nothing without
        triggers.
        """
        if not self.count:
            return ()
        off = (
            f", off by up to {1e3 * self.off * TIME_STEP:.4g} ms, as points are"
            if self.off > 1
            else ""
        )
        outputs = [
            f"{describe_value(name)} is output {number}" for name, number in self.outputs.items()
        ]
        return ("; ".join([f"triggers: {self.count} as M codes{off}", *outputs]),)


CODE = re.compile(r"(?:M0*(?:[013-9]|60|1\d\d)|[TS]\d+(?:\.\d+)?)")
"""Words of M codes that a controller takes between motions. M2 and M30 would end the program."""


def is_machine_code(name: str) -> bool:
    """Return True for a name made of M codes, with T and S: "M3 S1200", "M6 T2 M3 S500"."""
    words = name.split()
    return bool(words) and words[0][0] == "M" and all(CODE.fullmatch(word) for word in words)


def split_codes(name: str) -> list[str]:
    """Return the M codes of a name, each with the words that follow it, for a line of its own."""
    lines: list[str] = []
    for word in name.split():
        if word[0] == "M":
            lines.append(word)
        else:
            lines[-1] += f" {word}"
    return lines


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
