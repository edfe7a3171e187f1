"""State of a controller, changed by G-code block by block, and the segments that it makes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import cos, dist, hypot, sin
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.program.model import MIN_MOVE, Arc, Dwell, Line, Segment
from planner.program.modifiers import Blend, Fit, Join, Stop, Through
from planner.sources.rs274.arcs import PLANES, Way, read_arc
from planner.sources.rs274.coordinates import AXES, Coordinates, ToolOffsets, to_metres
from planner.sources.rs274.cycles import Cycles, Setting, Step
from planner.sources.rs274.events import (
    LONG_DWELL,
    LONG_TOLD,
    NOWHERE_TOLD,
    OUTPUTS,
    STOPS,
    Event,
    Events,
    WordLines,
)
from planner.sources.rs274.expressions import Parameters
from planner.sources.rs274.flow import Flow
from planner.sources.rs274.modes import UNIT_METRES, Modes, Saved, read_feed
from planner.sources.rs274.words import (
    ARGUMENTS,
    CYCLES,
    GROUPS,
    MAX_NUMBER,
    SHIFTING_M,
    TEXT_WORDS,
    WordBlock,
    WordFault,
    Words,
    argument_letters,
    blocks,
    find_ignored_word,
    is_ignorable,
    split_lines,
)
from planner.sources.source import Faults

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

VALUE_LETTERS = frozenset("XYZABCIJKRFPNLQ")
USER_LETTERS = frozenset("STEHD$")
"""Letters that no motion takes, so that they belong to an M word before them in any block."""
CONTEXT_M = (70.0, 71.0, 72.0, 73.0)
PROGRESS_LETTERS = frozenset("PRSQCDL")
"""Letters with which M73 is a printer's report of its progress, not the M73 of LinuxCNC, which
takes none."""
SPINDLE_WORDS = frozenset({("M", 3.0), ("M", 4.0), ("M", 5.0), ("M", 19.0), ("G", 97.0)})
"""Words that $ selects the spindle of; S too."""
FEED_UNIT_TOLD = "F in one block with a change of G20 or G21 counts in the new unit, as for Grbl; for LinuxCNC in the old"
LEVEL_TOLD = (
    "without G98 or G99 cycles retract to R, as in LinuxCNC, and not to the level before them"
)
STEPS_TOLD = "G88 retracts by a rapid, where an operator would by hand"


class Options(Protocol):
    """The options of `planner.sources.gcode.Gcode` that the run depends on."""

    @property
    def length(self) -> str: ...
    @property
    def dwell(self) -> str: ...
    @property
    def rapid(self) -> float | None: ...
    @property
    def feed(self) -> float | None: ...
    @property
    def ignored_words(self) -> frozenset[str]: ...
    @property
    def strict(self) -> bool: ...
    @property
    def first_join(self) -> Join: ...
    @property
    def arc_tolerance(self) -> float | None: ...
    @property
    def block_delete(self) -> Literal["skip", "run"] | None: ...


class BlockWords:
    """The words of one block, sorted.

    codes     its G words by modal group;  values: the numbers of its other words by letter
    silent    words that are read but change no motion, as S, T and H
    events, stops  M words that become triggers before and after its motion
    contexts  M70 to M73
    owner     the word whose arguments follow, None: no word; taken: their letters, None: all
    owned     arguments that only some controllers give a word
    """

    __slots__ = (
        "codes", "contexts", "events", "owned", "owner", "silent", "stops", "taken", "values",
    )  # fmt: skip

    def __init__(self) -> None:
        self.codes: dict[str, float] = {}
        self.values: dict[str, float] = {}
        self.silent: list[tuple[str, float]] = []
        self.events: list[Event] = []
        self.stops: list[Event] = []
        self.contexts: list[float] = []
        self.owner: tuple[str, float] | None = None
        self.taken: frozenset[str] | None = None
        self.owned: list[str] = []

    def begin_arguments(self, letter: str, value: float, taken: frozenset[str] | None) -> None:
        """Take the words that follow for arguments of a word, as far as their letters allow."""
        self.owner, self.taken = (letter, value), taken

    def is_argument(self, letter: str) -> bool:
        """Return whether a letter is an argument of the owner, which the next G or M ends."""
        if self.owner is None:
            return False
        if letter in "GM" and self.owner[1] not in TEXT_WORDS:
            self.owner = None
            return False
        return self.taken is None or letter in self.taken


class GcodeRun:
    """A controller's state, changed block by block, and the segments that it makes.

    place   x, y, z (m), a, b, c (rad) that the blocks have led to, in the file's numbers
    tool  (3,) where the segments lead to, likewise: an arc may end a rounding from its place
    held    the last segment, whose join a rest may change; ready: those before it that have not
            been taken
    number  of the line that was read last;  turned: the angles that blocks have changed, of rx, ry
            and rz
    join_word  the last word that asks for the path as it is
    """

    def __init__(self, options: Options, work: Pose | None, faults: Faults) -> None:
        self.options, self.faults = options, faults
        self.held: Segment | None = None
        self.ready: list[Segment] = []
        self.number = 0
        self.entities: Counter[str] = Counter()
        self.left_out, self.events = WordLines(), Events(options.ignored_words, options.strict)
        self.remarks, self.several, self.off, self.unstated = WordLines(), 0, 0.0, True
        self.ended, self.offsets = False, ToolOffsets()
        self.place = [0.0] * 6
        if work is not None:
            start = work.inv()
            self.place = [*start.translation.tolist(), *start.rotation.as_euler("XYZ").tolist()]
        self.tool: list[float] = self.place[:3]
        zero = [0.0] * 3 if work is None else work.translation.tolist()
        self.tilted = work is not None and work.rotation.magnitude() > 0
        self.coordinates = Coordinates((zero[0], zero[1], zero[2]))
        self.motion: float | None = None
        self.modes = Modes(
            UNIT_METRES[20.0 if options.length == "in" else 21.0], options.first_join
        )
        self.cycles = Cycles()
        self.turned: set[str] = set()
        self.join_word, self.unstated_level, self.fed = "", True, False
        self.parameters = Parameters()
        self.flow: Flow | None = None

    def follow(self, text: str) -> Iterator[Segment]:
        """Yield the segments of a file, up to its end."""
        options = self.options
        self.flow = Flow(text, self.parameters, self.faults, options.block_delete)
        for block in blocks(
            text,
            self.faults,
            options.block_delete,
            options.ignored_words,
            self.flow,
        ):
            self.number = block.number
            self.block(block)
            yield from self.ready
            self.ready.clear()
            if self.ended:
                break
        if self.held is not None:
            yield self.held

    def count_unread(self, text: str) -> int:
        """Return how many lines after the end of the program never ran."""
        if self.flow is not None and self.flow.used:
            return self.flow.count_unread(self.number)
        lines = enumerate(split_lines(text), 1)
        return sum(number > self.number and line.strip() not in ("", "%") for number, line in lines)

    def _add(self, segment: Segment) -> None:
        if self.held is not None:
            self.ready.append(self.held)
        self.held = self.events.begin(segment)

    def block(self, block: WordBlock) -> None:
        """Run one line's words. A fault of them becomes a fault of the file."""
        number, words = block.number, block.words
        try:
            if self.parameters.ended:
                self._end_calls()
            self._run_block(number, self._sort_words(number, words))
        except MotionError as error:
            key = error.word if isinstance(error, WordFault) else ""
            nth = [
                k
                for k, (letter, text) in enumerate(words)
                if key in (letter.upper(), letter + text)
            ]
            self.faults.add(str(error), number, f"column {block.column(nth[-1] if nth else 0)}")

    def _run_block(self, number: int, words: BlockWords) -> None:
        codes, values = words.codes, words.values
        self.fed = "F" in values
        if words.silent or words.events:
            self.offsets.block([*words.silent, *((("M", code)) for code, _ in words.events)])
            self.held = self.events.read(number, words.events, self.held)
        for code in words.contexts:
            self._save_or_restore(code)
        if codes or "F" in values or "P" in values:
            self._modal(number, codes, values)
        if codes.get("join") == 64:  # whose P is no number of turns
            values = {letter: value for letter, value in values.items() if letter not in "PQ"}
        if "dwell" in codes:
            self._dwell(
                number,
                {k: v for k, v in values.items() if k in "PNF" or "motion" not in codes},
            )
            values = {k: v for k, v in values.items() if k != "P" and "motion" in codes}
        if "once" in codes:
            self._once(number, codes["once"], values)
        elif not values.keys() <= {"F", "P", "N"} or codes.get("motion") in CYCLES:
            self._move(number, values)
        if words.stops:
            self.held = self.events.read(number, words.stops, self.held)

    def _sort_words(self, number: int, words: Words) -> BlockWords:
        """Sort the words of a block. Raises WordFault for one that is unknown or does not fit."""
        block = BlockWords()
        for given, text in words:
            letter, value = given.upper(), float(text)
            if block.is_argument(letter):
                self._own(number, block, given, text)
            elif not -MAX_NUMBER <= value <= MAX_NUMBER:
                raise WordFault(given + text, f"{given}{text[:20]}…: no such number makes sense")
            elif letter in VALUE_LETTERS:
                if letter in block.values:
                    raise WordFault(letter, f"{letter} appears twice in its block")
                block.values[letter] = value
            elif letter == "G" and value in GROUPS:
                self._sort_code(block, given, text)
            elif letter == "D" and self._pecks(words):
                block.values["D"] = value
            elif not (letter == "M" and self._sort_m_word(number, block, value, words)):
                self._skip(number, block, given, text)
        if block.owned or block.silent or block.values.keys() & {"L", "Q"}:
            self._check_words(block, words)
        for letter, value in block.silent:
            self.events.note(letter, value)
        if "G49" in block.codes:
            block.silent.append(("G", 49.0))
        return block

    def _sort_code(self, block: BlockWords, given: str, text: str) -> None:
        value = float(text)
        group = GROUPS[value]
        if group in block.codes:
            other = block.codes[group]
            raise WordFault(
                given + text,
                f"G{value:g} and G{other:g} exclude each other in a block",
            )
        block.codes[group] = value

    def _sort_m_word(self, number: int, block: BlockWords, value: float, words: Words) -> bool:
        """Take an M word that ends the program, saves modes or is an event; return if it does."""
        ignored = find_ignored_word("M", value, self.options.ignored_words) is not None
        if value in (2, 30):
            self.ended = True
        elif value == 73 and any(letter.upper() in PROGRESS_LETTERS for letter, _ in words):
            self.left_out.add("M73", number)
            block.begin_arguments("M", value, None)
        elif value in CONTEXT_M:
            block.contexts.append(value)
        elif value in self.events.codes and not ignored:
            (block.stops if value in STOPS else block.events).append((value, ""))
            if value in OUTPUTS:
                block.begin_arguments("M", value, frozenset(OUTPUTS[value]))
        else:
            return False
        return True

    def _skip(self, number: int, block: BlockWords, given: str, text: str) -> None:
        """Take a word that is left out. Raise WordFault for any other."""
        letter, value = given.upper(), float(text)
        word = find_ignored_word(letter, value, self.options.ignored_words)
        if word is not None:
            self._leave_out(number, word, (letter, value))
            if letter in "GM":
                block.begin_arguments(letter, value, argument_letters(letter, value))
        elif letter != "$":
            raise WordFault(given + text, _describe_unsupported(given, text))
        block.silent.append((letter, value))

    def _own(self, number: int, block: BlockWords, given: str, text: str) -> None:
        """Take an argument of a word that is left out, or of an output, whose trigger it names."""
        letter, value = given.upper(), float(text)
        owner, stated = block.owner or ("", 0.0), ""
        if block.taken is not None:
            stated = ARGUMENTS.get(f"{owner[0]}{owner[1]:g}", OUTPUTS.get(owner[1], ""))
        if letter not in stated:
            block.owned.append(given + text)
        elif block.events and owner == ("M", block.events[-1][0]):
            code, arguments = block.events[-1]
            block.events[-1] = (code, f"{arguments} {letter}{value:g}")
        else:  # it may say something of the tool
            block.silent.append((letter, value))
            name = find_ignored_word(letter, value, self.options.ignored_words)
            if name is not None:
                self.left_out.add(name, number)

    def _pecks(self, words: Words) -> bool:
        """Return whether a block is of a cycle that drills in steps: D is its clearance."""
        stated = [
            float(text)
            for letter, text in words
            if letter.upper() == "G" and GROUPS.get(float(text)) == "motion"
        ]
        return (stated[0] if stated else self.motion) in (73, 83)

    def _leave_out(self, number: int, word: str, whole: tuple[str, float]) -> None:
        letter, value = whole
        if letter == "M" and value in SHIFTING_M and (self.entities.keys() - {"G4"}):
            raise WordFault(
                f"M{value:g}",
                f"M{value:g} moves the origin after the tool has moved: leaving it out would change the "
                "path; split the program there",
            )
        self.left_out.add(word, number)

    def _check_words(self, block: BlockWords, words: Words) -> None:
        """Raise WordFault for words of a block that have no owner, or more than one."""
        codes, values = block.codes, block.values
        motion = codes.get("motion", self.motion)
        cycle = motion in CYCLES and codes.keys().isdisjoint({"once", "cycle"})
        fits = {"L": cycle or codes.get("once") == 10, "Q": cycle or codes.get("join") == 64}
        for letter, fit in fits.items():
            if letter in values and not fit:
                raise WordFault(letter, f"{letter}{values[letter]:g} is not supported; take it out")
        others = codes.keys() & {"once", "dwell", "cycle", "join"}
        straight = motion in (0, 1) and not others
        curved = not straight and bool(values.keys() & set(AXES))
        if block.owned and (others or "motion" in codes or curved):
            user = USER_LETTERS | (frozenset("KLPQR") if straight else frozenset())
            if doubtful := [word for word in block.owned if word[0].upper() not in user]:
                raise WordFault(
                    doubtful[0],
                    f"{doubtful[0]} may belong to the word that is left out or to its block's G "
                    "word: put the word that is left out on a line of its own",
                )
        spindle = any(letter == "$" for letter, _ in block.silent)
        if spindle and not any(
            letter.upper() == "S" or (letter.upper(), float(text)) in SPINDLE_WORDS
            for letter, text in words
        ):
            raise WordFault(
                "$",
                "$ selects a spindle: it needs S, M3, M4, M5 or M19 in its block; take it out",
            )

    def _modal(self, number: int, codes: Mapping[str, float], values: Mapping[str, float]) -> None:
        """Change the modes that hold from this block on."""
        modes = self.modes
        # after G80 bare axis words mean nothing
        self.motion = codes.get("motion", None if "cycle" in codes else self.motion)
        if "cycle" in codes or ("motion" in codes and self.motion not in CYCLES):
            self.cycles.end()
        modes.plane = codes.get("plane", modes.plane)
        if "length" in codes:
            unit = UNIT_METRES[codes["length"]]
            if "F" in values and unit != modes.unit and not self.unstated and not modes.timed:
                self.remarks.add(FEED_UNIT_TOLD, number)
            if (
                "F" not in values
                and unit != modes.unit
                and self.unstated
                and modes.feed is not None
            ):
                self.remarks.add(
                    f"F before the first G20 or G21 counts in {self.options.length} (option length)",
                    number,
                )
            modes.unit, self.unstated = unit, False
        if "distance" in codes:
            modes.absolute = codes["distance"] == 90
        if "centre" in codes:
            modes.from_start = codes["centre"] == 91.1
        if "retract" in codes:
            modes.retract, self.unstated_level = codes["retract"], False
        if "feed" in codes and modes.timed != (codes["feed"] == 93):
            modes.timed, modes.feed = not modes.timed, None
        if "F" in values:
            if values["F"] <= 0:
                raise WordFault("F", f"F{values['F']:g} must be above 0")
            modes.feed = read_feed(values["F"], modes.unit)
        if "join" in codes:
            modes.join = self._read_join(codes["join"], values)
        if "system" in codes:
            self._renumber(lambda: self.coordinates.choose(codes["system"]))
        stated = (
            "dwell" in codes
            or codes.get("join") == 64
            or codes.get("once") == 10
            or self.motion in CYCLES
        )
        if (
            "P" in values
            and not stated
            and (self.motion not in (2, 3) or values.keys() <= {"P", "F", "N"})
        ):
            raise WordFault("P", "P belongs to G4 or G64")

    def _read_join(self, code: float, values: Mapping[str, float]) -> Join:
        if code != 64:
            self.join_word = f"G{code:g}"
            return Through() if code == 61 else Stop()
        if values.get("P", 0.0) < 0 or values.get("Q", 0.0) < 0:
            raise WordFault("G64", "G64 takes P and Q that are not negative")
        if values.get("P", 0.0) > 0:
            return Fit(values["P"] * self.modes.unit)
        # as fast as possible, however far from the path: an option has to say how far
        first = self.options.first_join
        if not isinstance(first, Fit | Blend):
            raise WordFault(
                "G64",
                "G64 needs P, the tolerance within which the path is followed, above 0, or the option fit or blend",
            )
        return first

    def _save_or_restore(self, code: float) -> None:
        """Run M70 to M73. Raises WordFault where nothing was saved."""
        context = self.parameters.context
        if code in (70, 73):
            context["saved"] = Saved(
                modes=self.modes.copy(),
                system=self.coordinates.active,
                shifted=self.coordinates.shifted,
                offset=self.offsets.active,
                running=dict(self.events.running),
            )
            context["restores"] = code == 73
        elif code == 71:
            context.clear()
        else:
            saved = context.get("saved")
            if not isinstance(saved, Saved):
                raise WordFault(
                    "M72",
                    "M72 restores what M70 or M73 saved, which this program or sub has not yet",
                )
            self._restore(saved)

    def _restore(self, saved: Saved) -> None:
        """Bring back the saved modes, origin, tool offset, spindle and coolant."""
        self.modes = saved.modes.copy()
        if self.coordinates.active != saved.system:
            self._renumber(lambda: self.coordinates.choose(saved.system))
        if self.coordinates.shifted != saved.shifted:
            self._shift(92.3 if saved.shifted else 92.2, {})
        self.offsets.active = saved.offset
        self.held = self.events.restore(self.number, saved.running, self.held)

    def _end_calls(self) -> None:
        """Restore what M73 saved in subs that have returned."""
        ended = list(self.parameters.ended)
        self.parameters.ended.clear()
        for context in ended:
            saved = context.get("saved")
            if context.get("restores") and isinstance(saved, Saved):
                self._restore(saved)

    def _renumber(self, change: Callable[[], None]) -> None:
        """Change from where numbers count: the tool stays where it is."""
        before = self.coordinates
        place, tool = before.to_program(self.place[:3]), before.to_program(self.tool)
        angles = self._angles(self.place)
        change()
        self.place[:3], self.tool = before.from_program(place), before.from_program(tool)
        self.place[3:] = [angle - zero for angle, zero in zip(angles, before.angles, strict=True)]

    def _angles(self, place: Sequence[float]) -> list[float]:
        """Return the angles (3,) of a place in the program's frame, rad."""
        return [
            angle + zero for angle, zero in zip(place[3:], self.coordinates.angles, strict=True)
        ]

    def _once(self, number: int, code: float, values: dict[str, float]) -> None:
        """Run a word that counts from home or changes the origin: G10, G28, G52, G53 and G92."""
        word = f"G{code:g}"
        if self.tilted and code in (10, 28, 53):
            raise WordFault(word, f"{word} with angles in the option origin is not supported")
        axes = {axis: values[axis] for axis in AXES if axis in values}
        if code in (10, 11) and values.keys() <= {"N", "F"}:
            if self.options.strict:
                raise WordFault(
                    word,
                    f"{word} without arguments moves a printer's material; take it out",
                )
            self.left_out.add(word, number)
        elif code == 11:
            raise WordFault(word, "G11 with arguments is not supported; take it out")
        elif code == 53:
            if self.motion not in (0, 1) or not self.modes.absolute:
                raise WordFault(word, "G53 needs G0 or G1, and G90")
            self._move(number, values, axes)
        elif code == 28:
            motion, self.motion = self.motion, 0.0
            if axes:
                self._move(number, values)
            self._move(number, {}, dict.fromkeys(axes or AXES, 0.0))
            self.motion = motion
        elif code in (92.1, 92.2, 92.3):
            self._shift(code, {})
            if axes:  # which belong to the active motion, as in LinuxCNC
                self._move(number, values)
        elif more := values.keys() - set("XYZABCNF" + ("LPR" if code == 10 else "")):
            raise WordFault(min(more), f"{min(more)} beside {word} is not supported")
        elif code in (52, 92):
            if axes:
                self._shift(code, values)
            elif not self._extrudes(number):
                printer = " (a printer zeroes all axes)" if code == 92 else ""
                raise WordFault(
                    word,
                    f"{word} without axes has no meaning{printer}: state them, as {word} X0 Y0 Z0",
                )
        else:
            if values.get("L") not in (2, 20):
                raise WordFault(
                    "L",
                    "G10 states systems only, by L2 or L20: tables of tools are not read",
                )
            place = [*self.coordinates.to_program(self.place[:3]), *self._angles(self.place)]
            self._renumber(lambda: self.coordinates.state(values, self.modes.unit, place))

    def _shift(self, code: float, values: dict[str, float]) -> None:
        place = list(self.place)
        self._renumber(lambda: self.coordinates.shift(code, values, self.modes.unit, place))

    def _extrudes(self, number: int) -> bool:
        """Return whether a block has an E word that is left out: an axis of a printer."""
        return self.left_out.last.get("E") == number

    def _dwell(self, number: int, values: dict[str, float]) -> None:
        if values.get("P", -1.0) < 0:
            raise WordFault(
                "P",
                f"G4 needs P, the dwell time in {self.options.dwell}, not negative",
            )
        if more := values.keys() - {"P", "N", "F"}:
            raise WordFault(min(more), f"{min(more)} has no meaning beside G4")
        self.entities["G4"] += 1
        self._rest(number, values["P"] * self._second)

    @property
    def _second(self) -> float:
        """s of P."""
        return 1e-3 if self.options.dwell == "ms" else 1.0

    def _rest(self, number: int, seconds: float) -> None:
        if self.held is not None and not isinstance(self.held, Dwell):
            self.held = replace(self.held, join=Stop())
        if seconds > 0:
            if seconds > LONG_DWELL:
                self.remarks.add(LONG_TOLD, number)
            self._add(Dwell(seconds, line_number=number))

    def _move(
        self,
        number: int,
        values: dict[str, float],
        from_home: Mapping[str, float] | None = None,
    ) -> None:
        """Add the way to the point of the words; from_home: axes whose numbers count from there."""
        if self.motion is None:
            if self.faults.unread:  # it may stand in a line that was left out
                return
            raise WordFault("", "no G0, G1, G2 or G3 is active")
        if changed := self.coordinates.move():
            raise WordFault(
                "",
                f"it moved under {changed[0]} and moves under {changed[1]}, and does not say where they lie: state "
                "both by G10 L2 before, or split the program there",
            )
        cycle = self.motion in CYCLES
        if changed := self.offsets.move() if "Z" in values or cycle else None:
            raise WordFault(
                "",
                f"it moved under {changed[0]} and moves under {changed[1]}: ignoring both would change the path; "
                "split the program there, or add their offsets to its coordinates",
            )
        if cycle:
            self._cycle(number, self.motion, values)
            return
        end = self._end(
            values if from_home is None else {k: v for k, v in values.items() if k not in from_home}
        )
        if from_home:
            self._count_from_home(end, from_home)
        way = self._lead(end)
        if self.motion in (2, 3):
            self._arc(number, values, way)
        elif more := values.keys() & {"I", "J", "K", "R", "D"}:
            raise WordFault(min(more), f"{min(more)} belongs to G2 or G3")
        elif not self._line(number, way, self.motion == 0):
            self.remarks.add(NOWHERE_TOLD, number)

    def _lead(self, end: list[float]) -> Way:
        """Return the way to a block's end, which is taken over before a fault can be found.

        So the next block starts from there.
        """
        way = Way(self.tool, self.place, end)
        self.place, self.tool = end, end[:3]
        return way

    def _count_from_home(self, end: list[float], from_home: Mapping[str, float]) -> None:
        """Replace the numbers of an end by those of axes that count from the home pose."""
        given = to_metres(from_home, self.modes.unit)
        there = self.coordinates.to_program(end[:3])
        for k, value in given.items():
            if k < 3:
                there[k] = value - self.coordinates.zero[k]
            else:
                end[k] = value - self.coordinates.angles[k - 3]
        end[:3] = self.coordinates.from_program(there)

    def _line(self, number: int, way: Way, rapid: bool) -> bool:
        """Add a line, or a turn on the spot; return whether there is a way to go."""
        place, end = way.start, way.end
        length = dist(way.tool, end[:3])
        word = f"G{self.motion:.0f}"
        if length > MIN_MOVE and end[:3] != place[:3]:
            speed = self.options.rapid if rapid else self._find_speed(length)
            turned = self._find_orientation(way)
            there = np.array(self.coordinates.to_program(list(end[:3])))
            self._add(Line(there, turned, speed, self.modes.join, line_number=number))
            self.entities[word] += 1
            return True
        self.tool = list(way.tool)
        if dist(place[3:], end[3:]) <= MIN_MOVE:
            return False
        self._turn(number, way, rapid)
        self.entities[word] += 1
        return True

    def _end(self, values: Mapping[str, float]) -> list[float]:
        """Return the place that a block leads to."""
        end = list(self.place)
        for k, value in to_metres(values, self.modes.unit).items():
            end[k] = value if self.modes.absolute else end[k] + value
        return end

    def _find_speed(self, length: float) -> float | None:
        """Return the cap of the tool's speed on a way of a length, m."""
        feed = self.modes.feed
        if self.modes.timed:
            return length * self._read_inverse()
        if feed is not None:
            return feed.speed
        self._check_feed()
        return self.options.feed

    def _find_turning(self, angle: float) -> float | None:
        """Return the cap of the speed of a turn on the spot, rad/s."""
        feed = self.modes.feed
        if self.modes.timed:
            return angle * self._read_inverse()
        if feed is not None:
            return feed.turning
        self._check_feed()
        return None

    def _read_inverse(self) -> float:
        feed = self.modes.feed
        if not self.fed or feed is None:
            raise WordFault("", "G93 needs F, 1/minutes of the block, on every block that moves")
        return feed.inverse

    def _check_feed(self) -> None:
        if self.options.feed is None and not self.faults.unread:
            raise WordFault("", "no F is active; add one, or give the option feed")

    def _find_orientation(self, way: Way) -> Rotation | None:
        """Return the orientation at a block's end; None where it stays."""
        place, end = way.start, way.end
        if place[3:] == end[3:]:
            return None
        from planner.sources.rs274.turns import turn_along

        self._note_turned(way)
        orientation = turn_along(self._angles(place), self._angles(end))
        self.several += len([k for k in range(3, 6) if place[k] != end[k]]) > 1
        return orientation

    def _note_turned(self, way: Way) -> None:
        """Note the angles that a block changes: A, B and C are rx, ry and rz."""
        changed = (
            name for name, k in (("rx", 3), ("ry", 4), ("rz", 5)) if way.start[k] != way.end[k]
        )
        self.turned.update(changed)

    def _turn(self, number: int, way: Way, rapid: bool) -> None:
        from planner.sources.rs274.turns import turn_on_spot

        self._note_turned(way)
        begin, end = self._angles(way.start), self._angles(way.end)
        turn, angle = turn_on_spot(begin, end, self.modes.join, number)
        self.several += turn.about is None
        speed = None if rapid else self._find_turning(abs(angle))
        self._add(replace(turn, angular_speed=speed))

    def _cycle(self, number: int, code: float, values: dict[str, float]) -> None:
        """Add the moves, rests and events of a block of a canned cycle."""
        if self.modes.timed:
            raise WordFault("", f"G{code:g} needs G94: G93 states the time of one move")
        if more := values.keys() & {"A", "B", "C"}:
            raise WordFault(
                min(more),
                f"{min(more)} has no place in a canned cycle: turn before it",
            )
        if not values.keys() & set("XYZ"):
            raise WordFault("", f"G{code:g} needs X, Y or Z in each of its blocks")
        order = PLANES[self.modes.plane]
        place = (self.place[order[0]], self.place[order[1]], self.place[order[2]])
        setting = Setting(
            axes=[AXES[k] for k in order],
            unit=self.modes.unit,
            second=self._second,
            absolute=self.modes.absolute,
            lowest=self.modes.retract == 99,
            spindle=self.events.running["spindle"],
        )
        if code == 88:
            self.remarks.add(STEPS_TOLD, number)
        join = self.modes.join
        self.modes.join = join if isinstance(join, Stop) else Through()
        try:
            for step in self.cycles.run(code, values, place, setting):
                self._run_step(number, step, order)
        finally:
            self.modes.join = join
        level = self.cycles.initial
        if self.unstated_level and level is not None and level > self.place[order[2]] + MIN_MOVE:
            self.remarks.add(LEVEL_TOLD, number)

    def _run_step(self, number: int, step: Step, order: tuple[int, int, int]) -> None:
        if step.kind == "rest":
            self._rest(number, step.value)
        elif step.kind == "stop":
            self.held = self.events.read(number, [(0.0, "")], self.held)
        elif step.kind == "event":
            if step.value in self.events.codes:
                self.held = self.events.read(number, [(step.value, "")], self.held)
        else:
            end = list(self.place)
            for k, value in zip(order, step.to, strict=True):
                end[k] = value
            self._line(number, self._lead(end), step.kind == "rapid")

    def _arc(self, number: int, values: dict[str, float], way: Way) -> None:
        modes, begin, end = self.modes, way.tool, way.end
        first, second, normal = PLANES[modes.plane]
        arc = read_arc(values, self.motion == 2, way, modes, self.options.arc_tolerance)
        centre, axis = [0.0] * 3, [0.0] * 3
        centre[first], centre[second], centre[normal] = *arc.centre, begin[normal]
        axis[normal] = 1.0
        rise = end[normal] - begin[normal]
        u, v = begin[first] - arc.centre[0], begin[second] - arc.centre[1]
        speed = self._find_speed(hypot(hypot(u, v) * arc.angle, rise))
        turned = self._find_orientation(way)
        axis[0], axis[1] = self.coordinates.turn(axis[0], axis[1])
        about = np.array(self.coordinates.to_program(centre)), np.array(axis)
        self._add(Arc(*about, arc.angle, turned, speed, modes.join, rise=rise, line_number=number))
        turn = arc.angle
        self.tool = list(end[:3])
        self.tool[first] = arc.centre[0] + u * cos(turn) - v * sin(turn)
        self.tool[second] = arc.centre[1] + u * sin(turn) + v * cos(turn)
        self.off = max(self.off, arc.off)
        self.entities[f"G{self.motion:.0f}"] += 1

    def warnings(self, after: int) -> tuple[str, ...]:
        """Return the assumptions and the words that were left out.

        after  number of lines after the end that never ran
        """
        texts = [f"no G20 or G21: unit {self.options.length} was assumed"] if self.unstated else []
        texts += self.events.describe()
        texts += [f"skipped: {', '.join(self.left_out.describe())}"] if self.left_out.counts else []
        texts += self.remarks.describe()
        if self.several:
            way = "by the shortest rotation, while controllers interpolate each letter"
            texts.append(f"{self.several} blocks rotate about several axes at once: {way}")
        if self.off > 1e-9:
            texts.append(
                f"arcs end up to {self.off * 1e6:.3g} um from their end points, because their radii differ",
            )
        if self.flow is not None and self.flow.restarts:
            texts.append(
                f"M99 in line {self.flow.restarts} ends the program, where a controller would start it again",
            )
        if after:
            texts.append(f"not read: {count_noun(after, 'line')} after the end of the program")
        return tuple(texts)


def _describe_unsupported(given: str, text: str) -> str:
    """Return the fault of an unknown word, with the option that leaves it out if one may."""
    letter, value = given.upper(), float(text)
    word = f"{letter}{value:g}"
    every = letter if is_ignorable(letter) and letter != "M" else word
    remedy = (
        f', or skip it by the option ignore="{every}" (--ignore {every})'
        if is_ignorable(word)
        else ""
    )
    return f"{given}{text[:20]} is not supported; take it out{remedy}"
