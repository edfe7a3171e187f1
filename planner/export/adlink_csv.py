"""The call list of the motion cards as CSV, easy to replay by a program.

    Time[s],Name,Function,Axis,Position[pulses],Start[pulses/s],Max[pulses/s],Tacc[s],Tdec[s]
    0.000000,leg3,_8164_start_ta_move,0,-12,38.2,2401.7,0.01,0.0

One row per call, in the order of time: wait until Time, then call Function(Axis, Position, Start, Max, Tacc, Tdec).
Speeds are the shortest decimals that read back as the same floats. UTF-8, line ends \\n, decimal points whatever the
locale. What the numbers mean and how they are chosen: `planner.export.card_calls`.
"""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from planner.export.card_calls import call_list
from planner.export.card_replay import Call, error
from planner.export.format import Exported, Source, option

HEADER = [
    "Time[s]", "Name", "Function", "Axis", "Position[pulses]", "Start[pulses/s]", "Max[pulses/s]", "Tacc[s]", "Tdec[s]",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class AdlinkCsv:
    """Calls of the motion cards ADLINK PCI-8132 and PCI-8164, as a table."""

    suffix: ClassVar[str] = ".csv"
    spacing: float | None = option(None, "between the calls of an axis; default: the longest that errs by 1 pulse", "s")
    speed_range: float | None = option(None, "top of the cards' speed registers; default: as the motion needs", "1/s")

    def write(self, source: Source, path: Path) -> Exported:
        made = call_list(source, self.spacing, self.speed_range)
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(HEADER)
            for call in made.calls:
                move = call.position, call.start, call.top, call.tacc, call.tdec
                table.writerow([f"{call.time:.6f}", call.name, call.function, call.axis, *move])
        against = "the motion, the calls replayed in closed form"
        calls = read_calls(path)
        return Exported(error(source, calls), against, made.notes, len(calls))


def read_calls(path: Path) -> list[Call]:
    """The calls of a file written so."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
    return [Call(float(t), n, f, int(a), int(p), *map(float, rest)) for t, n, f, a, p, *rest in rows]
