"""G-code, a subset of RS-274: lines, arcs, canned cycles, modes, origins, feeds, joins, expressions
and subprograms.

| words | meaning here |
|---|---|
| X Y Z | position of the tool from the file's zero: the machine's home pose, moved by the option `origin` |
| A B C | its orientation, degrees: Rx(A) · Ry(B) · Rz(C), by the shortest way where several change at once |
| G0 | a straight line, as fast as the machine can, or with the option `rapid` as its cap |
| G1 | a straight line; F caps the speed of the tool, or where only A B C change of its turning (deg/min) |
| F | the speed in the unit that is active where F is read; a later G20 or G21 leaves it as it is |
| G2 G3 | arcs and helices; I J K from the start (G90.1: absolute), or R, negative for more than half a turn; P turns |
| G73 G74 G81 to G89, G80, G98 G99 | canned cycles (planner.sources.rs274.cycles) |
| G4 P | a rest, in seconds, or with the option `dwell` in ms |
| G17 G18 G19 | plane of arcs: XY, ZX, YZ |
| G20 G21 | inches, mm |
| G90 G91 | absolute, relative |
| G93 G94 | F is 1/minutes of the block, and per minute |
| G61 | passes a join without leaving the path: stops where it is not smooth |
| G61.1 | stops at every join |
| G64 P | fits a smooth curve within P of the path, and rounds the corners that stay (planner.path.fit); with Q or not |
| G64 | without P, or with P0, as the option `fit` or `blend` says |
| G53 | the axes of its block count from the home pose |
| G28 | by way of X Y Z A B C, if any, with these axes to the home pose, else with all |
| G54 to G59.3 | the active system; a file that moves under two of them has to state where they lie |
| G10 L2, L20 | a system's position from home, and its turn R about z; or the numbers of the tool's position in it |
| G92 to G92.3, G52 | a shift of all systems, also of A B C; G92 and G52 alone are refused |
| M70 M72, M73, M71 | save the modes and restore them; restore them when the sub returns; forget them |
| G8 G15 G40 G49 G69 G80 | end of modes: nothing, or no more bare axis words |
| #1 = [2 * #<depth>] | parameters and expressions (planner.sources.rs274.expressions) |
| O1 sub, call, if, while, do, repeat …; O1, M98, M99 | the order in which lines run (planner.sources.rs274.flow) |
| / | a block that the option `block_delete` skips or runs, also after N |
| M3 M4 M5 M7 M8 M9, M62 to M68 | a trigger with its name at that point of the path (planner.sources.rs274.events) |
| M6; M0 M1 M60 | likewise, and the motion stops there; M0, M1 and M60 come after the motion of their block |
| M2 M30 % | the end: the lines after it run only where they are called |
| N ( … ) ; | numbers of lines, and comments |

A file of joint axes, as the export g93 writes it, says so in its header: its positions come from
forward kinematics of the option `machine`, and without that it is refused
(planner.sources.rs274.joints).

Other words of spindle and tool (S T M19 G97) are skipped with a warning that counts them and names
their lines; with the option `strict` these and M3 to M9 are refused. Everything else is a fault
with its line and column. Further words named in the option `ignore` are skipped too if the path
stays as it is without them. Their arguments go with them: of M0 to M9, M19 and M60 the numbers that
are no coordinates, of other M words all words after them, up to the next G or M. Blanks mean
nothing, not even within a number. F is a cap: the machine is as fast as it can under it. Rounded
coordinates make small corners where curves were smooth, at which G61 stops: G64 P passes them.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.options import option
from planner.program.model import Program, Segment, SegmentStream
from planner.program.modifiers import Join, choose_join
from planner.program.validation import MOST_SEGMENTS, check_positive
from planner.sources.rs274.joints import find_header, read_joints, refuse_options
from planner.sources.rs274.run import GcodeRun
from planner.sources.rs274.words import MACHINING_WORDS, is_ignorable
from planner.sources.source import Faults, Imported, decode_text, zero_segment

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


@dataclass(frozen=True, slots=True)
class Gcode:
    """G-code (RS-274): lines, arcs, canned cycles and subprograms; other words are refused with
    line and column.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".ngc", ".nc", ".gcode", ".tap", ".cnc")
    join: Literal["through", "stop"] = option(
        "through",
        "joins until G61, G61.1 or G64: through passes smooth joins, stop rests. Default through",
    )
    blend: float | None = option(
        None, 'round joins within this tolerance instead, as "0.05 mm"', "m", like="0.05 mm"
    )
    fit: float | None = option(
        None, 'fit smooth curves within this tolerance instead, as "0.02 mm"', "m", like="0.02 mm"
    )
    rapid: float | None = option(None, "limit of the tool speed on G0. Default: none", "m/s")
    feed: float | None = option(
        None, "limit of the tool speed before the first F. Default: F is required", "m/s"
    )
    length: Literal["mm", "in"] = option("mm", "unit before G20 or G21. Default mm")
    arc_tolerance: float | None = option(
        None,
        "largest difference of an arc's radii at its ends. Default: that of rounded coordinates",
        "m",
    )
    block_delete: Literal["skip", "run"] | None = option(
        None, "skip or run blocks that begin with /. Default: refuse them"
    )
    dwell: Literal["s", "ms"] = option("s", "unit of P of G4. Default s")
    origin: str | None = option(
        None,
        'position of the file\'s zero from home, as "0 mm, 0 mm, 25 mm" or with three angles. Default: at home',
    )
    ignore: str | None = option(
        None, 'further words to skip with their arguments, as "M48 M205 G43"'
    )
    strict: bool = option(
        False, "refuse spindle, coolant and tool words instead of marking or skipping them"
    )
    machine: str | None = option(
        None, "for a file of joint axes, as written by the export g93: the machine it is for"
    )

    def __post_init__(self) -> None:
        for name, unit in (
            ("blend", "m"),
            ("fit", "m"),
            ("rapid", "m/s"),
            ("feed", "m/s"),
            ("arc_tolerance", "m"),
        ):
            check_positive("gcode", name, getattr(self, name), unit)
        for word in self.ignored_words:
            if not is_ignorable(word):
                raise MotionError(
                    f'ignore "{word}" cannot be ignored: it is not a word, it is supported, or it changes the path; '
                    "words that may be ignored are M, S, T, H, D, E, and G codes without a path, as G54"
                )

    @property
    def ignored_words(self) -> frozenset[str]:
        """The words to skip, without leading zeros."""
        asked = frozenset(_normal(word) for word in (self.ignore or "").replace(",", " ").split())
        return asked if self.strict else asked | MACHINING_WORDS

    @property
    def first_join(self) -> Join:
        """How joins are until a word says otherwise."""
        return choose_join(self.join, self.blend, self.fit)

    def read(self, path: Path) -> Imported:
        """Return the program of a G-code file.

        Raises FileError with its faults, each with its line and column, and for more segments than
        a program holds.
        """
        return self._read(path, hold=True)

    def stream(self, path: Path) -> Imported:
        """Return the program with segments that are read anew whenever they are asked for; all of
        it is checked.
        """
        return self._read(path, hold=False)

    def _read(self, path: Path, hold: bool) -> Imported:
        faults = Faults(str(path))
        text = decode_text(path)
        header = find_header(text)
        if header is not None:
            refuse_options(
                [
                    name
                    for name in ("rapid", "feed", "origin", "ignore")
                    if getattr(self, name) is not None
                ]
            )
            return read_joints(path, text, header, self.machine, self.first_join, faults)
        if self.machine is not None:
            raise MotionError(
                f"gcode: machine is for files of joint axes, which {path.name} is not by its header"
            )
        run = self._run(faults)
        segments: Sequence[Segment]
        if hold:
            if text.count("\n") > MOST_SEGMENTS:  # count first: a million segments take a gigabyte
                deque(_follow_limited(self._run(Faults(str(path))), text), maxlen=0)
            segments = tuple(_follow_limited(run, text))
        else:
            count, marked = 0, False
            for segment in run.follow(text):
                count, marked = count + 1, marked or getattr(segment, "trigger", None) is not None
            digest = sha256(text.encode("utf-8", "surrogateescape")).hexdigest()
            segments = SegmentStream(partial(self._read_again, path, digest), count, marked)
        if not faults and not run.entities.keys() - {"G4"}:
            faults.add("nothing moves: no G0, G1, G2 or G3 moves the tool")
        faults.refuse()
        after = run.count_unread(text)
        program = Program(
            segments, "home", name=path.stem, work=self._work, join_word=run.join_word
        )
        return Imported(
            program, dict(sorted(run.entities.items())), run.warnings(after), frozenset(run.turned)
        )

    def _run(self, faults: Faults) -> GcodeRun:
        return GcodeRun(self, self._work, faults)

    @property
    def _work(self) -> "Pose | None":
        if self.origin is None:
            return None
        from planner.sources.positions import read_frame

        return read_frame(self.origin)

    def _read_again(self, path: Path, digest: str) -> Iterator[Segment]:
        text = decode_text(path)
        if sha256(text.encode("utf-8", "surrogateescape")).hexdigest() != digest:
            raise MotionError(f"{path} was changed while it was read: start again")
        return map(zero_segment, self._run(Faults(str(path))).follow(text))


def _follow_limited(run: GcodeRun, text: str) -> Iterator[Segment]:
    """Yield the segments of a text. Raise FileError for one too many, at the line that it is in."""
    for count, segment in enumerate(run.follow(text), 1):
        if count > MOST_SEGMENTS:
            message = (
                f"more than {MOST_SEGMENTS} segments, which a program does not hold: plan the file as it is, by "
                "pulsepath plan or Gcode().stream, or split it"
            )
            raise FileError(run.faults.file, [Fault("", message, segment.line_number)])
        yield segment


def _normal(word: str) -> str:
    """Return a word without leading zeros, in upper case: M3 of m03."""
    letter, number = word[:1].upper(), word[1:]
    try:
        return f"{letter}{float(number):g}" if number else letter
    except ValueError:
        return word
