"""An import format: HPGL, what pen plotters and vinyl cutters are sent."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from kinematics.foundation.arrays import freeze_array
from kinematics.foundation.options import option
from kinematics.foundation.units import describe_value
from planner.program.model import Line, Program
from planner.program.modifiers import Through
from planner.sources.source import Faults, Imported, decode_text

UNIT = 25e-6
"""m: a plotter's unit is 0.025 mm."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
MOVES = {"PU": "pen up", "PD": "pen down", "PA": "as it is"}
LEFT_OUT = ("IN", "SP")
"""Set-up, and choice of a pen: no motion."""


@dataclass(frozen=True, slots=True)
class Hpgl:
    """HPGL drawings: PU, PD and PA with absolute coordinates; the pen is lifted by an option."""

    suffixes: ClassVar[tuple[str, ...]] = (".hpgl", ".plt")
    lift: float = option(2e-3, "how far the pen is lifted. Default 2 mm", "m")

    def read(self, path: Path) -> Imported:
        """The drawing as lines, in the home frame. Raises FileError with all faults, each with its line."""
        faults = Faults(str(path))
        here = np.zeros(3)
        segments: list[Line] = []
        entities: dict[str, int] = {}
        for number, line in enumerate(decode_text(path).split("\n"), 1):
            for word in filter(None, (part.strip() for part in line.split(";"))):
                verb, values = word[:2].upper(), word[2:].replace(",", " ").split()
                if verb not in (*MOVES, *LEFT_OUT):
                    faults.add(
                        f"{describe_value(word)} is none of {', '.join((*MOVES, *LEFT_OUT))}",
                        number,
                    )
                    continue
                entities[verb] = entities.get(verb, 0) + 1
                if verb in LEFT_OUT:
                    continue
                if len(values) % 2 or not all(map(NUMBER.fullmatch, values)):
                    faults.add(
                        f"{describe_value(word)}: coordinates come in pairs of numbers", number
                    )
                    continue
                height = {"PU": self.lift, "PD": 0.0, "PA": here[2]}[verb]
                points = np.array(values, float).reshape(-1, 2) * UNIT
                for place in ([*here[:2], height], *([*point, height] for point in points)):
                    if np.linalg.norm(place - here) > 1e-9:
                        segments.append(Line(freeze_array(place), join=Through()))
                        here = segments[-1].to
        if not segments and not faults:
            faults.add("nothing is drawn")
        faults.refuse()
        return Imported(Program(tuple(segments), name=path.stem), entities)
