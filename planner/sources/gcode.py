"""G-code, a subset of RS-274: G0 to G4, planes, units, absolute and relative, feeds, ways to join.

| words | meaning here |
|---|---|
| X Y Z | where the tool goes, from where the file's zero lies: the machine's home pose, moved by the option `origin` |
| A B C | its orientation, degrees: Rx(A) · Ry(B) · Rz(C), by the shortest way where several change at once |
| G0 | a straight line, as fast as the machine can, or with the option `rapid` as its cap |
| G1 | a straight line; F caps the speed of the tool, or where only A B C change of its turning (deg/min) |
| G2 G3 | arcs and helices; I J K from the start (G90.1: absolute), or R, negative for more than half a turn |
| G4 P | a rest, in seconds, or with the option `dwell` in ms |
| G17 G18 G19 | plane of arcs: XY, ZX, YZ |
| G20 G21 | inches, mm |
| G90 G91 | absolute, relative |
| G93 G94 | F is 1/minutes of the block, and per minute |
| G61 | passes a join without leaving the path: stops where it is not smooth |
| G61.1 | stops at every join |
| G64 P | rounds joins within a tolerance of P |
| M2 M30 % | the end: what follows is not read |
| N ( … ) ; | numbers of lines, and comments |

A file of joint axes, as the export g93 writes it, says so in its header: its places are found by forward kinematics of
the option `machine`, and without that it is refused (planner.sources.gcode_joints).

Everything else is a fault with its line and column; words named in the option `ignore` are left out and counted, where
leaving them out leaves the path as it is. F is a cap: the machine is as fast as it can under it. Coordinates that are
rounded make small corners where curves were smooth, at which G61 stops: G64 P passes them.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from kinematics.errors import MotionError
from planner.program import Blend, Dwell, Join, Program, Stop, Through
from planner.sources.faults import Faults
from planner.sources.gcode_ignored import ignorable
from planner.sources.gcode_joints import find_header, read_joints, refuse_options
from planner.sources.gcode_run import Run
from planner.sources.gcode_words import words
from planner.sources.placed import placed
from planner.sources.source import Imported, option
from planner.sources.texts import text_of
from planner.wanted import positive


@dataclass(frozen=True, slots=True)
class Gcode:
    """G-code (RS-274): lines, arcs, helices and dwells; anything else is refused with line and column."""

    suffixes: ClassVar[tuple[str, ...]] = (".ngc", ".nc", ".gcode", ".tap", ".cnc")
    join: Literal["through", "stop"] = option(
        "through", "joins until G61, G61.1 or G64: through passes where smooth, stop rests. Default through"
    )
    blend: float | None = option(None, 'instead: round joins within so much, as "0.05 mm"', "m")
    rapid: float | None = option(None, "cap of the tool's speed on G0. Default: none", "m/s")
    feed: float | None = option(None, "cap of the tool's speed before the first F. Default: F is asked for", "m/s")
    length: Literal["mm", "in"] = option("mm", "unit before G20 or G21. Default mm")
    dwell: Literal["s", "ms"] = option("s", "unit of P of G4. Default s")
    origin: str | None = option(
        None, 'where the file\'s zero lies from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home'
    )
    ignore: str | None = option(None, 'words to leave out, as "S T M3 M5 G54"')
    machine: str | None = option(
        None, "of a file of joint axes, as the export g93 writes it: the machine whose axes they are"
    )

    def __post_init__(self) -> None:
        for name, unit in (("blend", "m"), ("rapid", "m/s"), ("feed", "m/s")):
            positive("gcode", name, getattr(self, name), unit)
        for word in self.ignored:
            if not ignorable(word):
                raise MotionError(
                    f'ignore "{word}": leaving it out would change the path, or it is no word, or one that is '
                    "understood; what may be left out is M, S, T, H, D, and G without a path of its own, as G54"
                )

    @property
    def ignored(self) -> frozenset[str]:
        """The words to leave out, without leading zeros."""
        return frozenset(_normal(word) for word in (self.ignore or "").replace(",", " ").split())

    @property
    def first_join(self) -> Join:
        """How joins are until a word says otherwise."""
        return Blend(self.blend) if self.blend is not None else Stop() if self.join == "stop" else Through()

    def read(self, path: Path) -> Imported:
        """The program of a G-code file. Raises FileError with its faults, each with its line and column."""
        faults = Faults(str(path))
        work = None if self.origin is None else placed(self.origin)
        text = text_of(path)
        header = find_header(text)
        if header is not None:
            refuse_options([name for name in ("rapid", "feed", "origin", "ignore") if getattr(self, name) is not None])
            return read_joints(path, text, header, self.machine, self.first_join, faults)
        if self.machine is not None:
            raise MotionError(f"gcode: machine is for files of joint axes, which {path.name} is not by its header")
        run = Run(self, work, faults)
        number = 0
        for number, line, found in words(text, faults):
            run.block(number, line, found)
            if run.ended:
                break
        if not faults and all(isinstance(part, Dwell) for part in run.segments):
            faults.add("nothing moves: it has no G0, G1, G2 or G3 that leads anywhere")
        faults.refuse()
        after = sum(line.strip() not in ("", "%") for line in text.split("\n")[number:])
        program = Program(tuple(run.segments), "home", name=path.stem, work=work)
        return Imported(program, dict(sorted(run.entities.items())), run.warnings(after))


def _normal(word: str) -> str:
    """M03 as M3, g54 as G54."""
    letter, number = word[:1].upper(), word[1:]
    try:
        return f"{letter}{float(number):g}" if number else letter
    except ValueError:
        return word
