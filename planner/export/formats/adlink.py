"""The call list of the motion cards PCI-8132 and PCI-8164, as C source or as CSV.

What the numbers mean and how they are chosen: `planner.export.card_calls`. The C source is a
function that waits and calls:

    short pulsepath_run(void (*wait_until)(double seconds))
    {
        wait_until(0.000000);
        DO(_8164_start_ta_move(0, -12, 38.2, 2401.7, 0.01, 0.0)); /* leg3 */
        …
        return 0;
    }

It returns 0, or the error of the first call that failed. `wait_until` is the caller's: it returns
when so many seconds have passed since the start. ASCII, line ends \\n; names stand in comments,
what could end these is escaped. The names are those of the file formats' description; where the
library's _8132_ta_move waits for the end of its move, define it as _8132_start_ta_move [Sahbaz
2007, Table A.1], which returns at once.

The CSV is easy to replay by a program:

    Time[s],Name,Function,Axis,Position[pulses],Start[pulses/s],Max[pulses/s],Tacc[s],Tdec[s]
    0.000000,leg3,_8164_start_ta_move,0,-12,38.2,2401.7,0.01,0.0

One row per call, in the order of time: wait until Time, then call Function(Axis, Position, Start,
Max, Tacc, Tdec). Speeds are the shortest decimals that read back as the same floats. UTF-8, line
ends \\n, decimal points whatever the locale.
"""

import csv
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from json import dumps
from pathlib import Path
from typing import ClassVar

from kinematics.foundation.options import option
from planner.export.card_calls import KINDS, Call, CallList, call_list, replay_error
from planner.export.format import Exported, ExportSource, refuse_shaped

WAIT_LINE = re.compile(r"    wait_until\(([0-9.]+)\);")
CALL_LINE = re.compile(r"    DO\((\w+)\((\d+), (-?\d+), ([^,]+), ([^,]+), ([^,]+), ([^,)]+)\)\);")
HEAD = """\
#ifndef PULSEPATH_CARDS /* define it, and include the cards' own headers before this, where there are any */
{prototypes}#endif

#define DO(call) do {{ short error = (call); if (error != 0) return error; }} while (0)

/* 0, or the error of the first call that failed; wait_until(t) returns t seconds after the start */
short pulsepath_run(void (*wait_until)(double seconds))
{{
"""


@dataclass(frozen=True, slots=True)
class _CallFile(ABC):
    """The options of both, and how the calls that are written are chosen and compared with the
    motion.
    """

    spacing: float | None = option(
        None, "time between calls of an axis. Default: the longest with an error of 1 pulse", "s"
    )
    speed_range: float | None = option(
        None, "full scale of the cards' speed registers. Default: as the motion needs", "1/s"
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        refuse_shaped(source, "adlink")
        made = call_list(source, self.spacing, self.speed_range)
        self._write(source, made, path)
        calls = self._read(source, path)
        against = "the motion, the calls replayed in closed form"
        return Exported(replay_error(source, calls), against, made.notes, len(calls))

    @abstractmethod
    def _write(self, source: ExportSource, made: CallList, path: Path) -> None: ...

    @abstractmethod
    def _read(self, source: ExportSource, path: Path) -> list[Call]: ...


@dataclass(frozen=True, slots=True)
class AdlinkC(_CallFile):
    """Calls of the motion cards ADLINK PCI-8132 and PCI-8164, as C source."""

    suffix: ClassVar[str] = ".c"

    def _write(self, source: ExportSource, made: CallList, path: Path) -> None:
        with path.open("w", encoding="ascii", newline="\n") as file:
            file.writelines(f"{line}\n" for line in _lines(source, made))

    def _read(self, source: ExportSource, path: Path) -> list[Call]:
        kinds = KINDS.items()
        names = {
            (kind.function, a.channel): a.name
            for a in source.machine.axes
            for n, kind in kinds
            if n in str(a.card)
        }
        calls, now = [], 0.0
        for line in path.read_text("ascii").split("\n"):
            if wait := WAIT_LINE.match(line):
                now = float(wait[1])
            elif do := CALL_LINE.match(line):
                axis = int(do[2])
                calls.append(
                    Call(
                        now,
                        names[do[1], axis],
                        do[1],
                        axis,
                        int(do[3]),
                        *map(float, do.groups()[3:]),
                    )
                )
        return calls


def _lines(source: ExportSource, made: CallList) -> Iterator[str]:
    yield f"/* {quote_comment(source.name)} on {quote_comment(source.machine.name)}"
    yield from (f" * {_escape(note)}" for note in made.notes)
    yield " */"
    arguments = "short axis, double pos, double start, double max, double tacc, double tdec"
    used = sorted(
        {call.function for call in made.calls} | {kind.function for kind in KINDS.values()}
    )
    yield HEAD.format(prototypes="".join(f"short {name}({arguments});\n" for name in used)).rstrip(
        "\n"
    )
    now = None
    for call in made.calls:
        if call.time != now:
            now = call.time
            yield f"    wait_until({call.time:.6f});"
        numbers = call.axis, call.position, call.start, call.top, call.tacc, call.tdec
        yield f"    DO({call.function}({', '.join(map(str, numbers))})); /* {quote_comment(call.name)} */"
    yield from ("    (void)wait_until;", "    return 0;", "}")


def quote_comment(name: str) -> str:
    """A name in a comment: ASCII, in quotes, and nothing that begins or ends a comment."""
    return _escape(dumps(name))


def _escape(text: str) -> str:
    """ASCII in which no comment begins or ends, and no trigraph stands."""
    plain = text.encode("ascii", "backslashreplace").decode()
    return plain.replace("*/", "*\\u002f").replace("/*", "\\u002f*").replace("??", "?\\u003f")


HEADER = [
    "Time[s]", "Name", "Function", "Axis", "Position[pulses]", "Start[pulses/s]", "Max[pulses/s]", "Tacc[s]", "Tdec[s]",
]  # fmt: skip


@dataclass(frozen=True, slots=True)
class AdlinkCsv(_CallFile):
    """Calls of the motion cards ADLINK PCI-8132 and PCI-8164, as a table."""

    suffix: ClassVar[str] = ".csv"

    def _write(self, source: ExportSource, made: CallList, path: Path) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(HEADER)
            for call in made.calls:
                move = call.position, call.start, call.top, call.tacc, call.tdec
                table.writerow([f"{call.time:.6f}", call.name, call.function, call.axis, *move])

    def _read(self, source: ExportSource, path: Path) -> list[Call]:
        return read_calls(path)


def read_calls(path: Path) -> list[Call]:
    """The calls of a file written so."""
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.reader(file))[1:]
    return [
        Call(float(t), n, f, int(a), int(p), *map(float, rest)) for t, n, f, a, p, *rest in rows
    ]
