"""What a controller makes of G-code, block by block: its modes, its place, and the segments that it runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from math import cos, degrees, dist, hypot, radians, sin
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.program.model import MIN_MOVE, Arc, Dwell, Line, Segment
from planner.program.modifiers import Blend, Fit, Join, Stop, Through
from planner.sources.rs274.arcs import PLANES, read_arc
from planner.sources.rs274.coordinates import Coordinates, ToolOffsets
from planner.sources.rs274.events import LONG_DWELL, LONG_TOLD, NOWHERE_TOLD, Events, WordLines
from planner.sources.rs274.words import (
    GROUPS,
    MAX_NUMBER,
    WordBlock,
    WordFault,
    Words,
    blocks,
    find_ignored_word,
    is_ignorable,
)
from planner.sources.source import Faults

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

UNIT_METRES = {20.0: 0.0254, 21.0: 1e-3}
AXES = "XYZABC"
VALUE_LETTERS = frozenset("XYZABCIJKRFPNLQ")


class Options(Protocol):
    """What a reader of G-code is told beside the file: the options of `planner.sources.gcode.Gcode`."""

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


class GcodeRun:
    """A controller's state, changed block by block, and the segments that it makes.

    place   x, y, z (m), a, b, c (rad) that the blocks have led to, in the file's numbers
    stands  (3,) where the segments lead to, likewise: an arc may end a rounding beside its place
    held    the last segment, whose join a rest may change; ready: those before it that have not been taken
    number  of the line that was read last
    join_word  the last that asks for the path as it is
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
        self.stands: list[float] = self.place[:3]
        zero = [0.0] * 3 if work is None else work.translation.tolist()
        self.tilted = work is not None and work.rotation.magnitude() > 0
        self.coordinates = Coordinates((zero[0], zero[1], zero[2]))
        self.motion: float | None = None
        self.plane, self.unit = 17.0, UNIT_METRES[20.0 if options.length == "in" else 21.0]
        self.absolute, self.from_start, self.timed = True, True, False
        self.feed: float | None = None
        self.join: Join = options.first_join
        self.join_word = ""

    def follow(self, text: str) -> Iterator[Segment]:
        """The segments of a file, one after the other, up to its end."""
        for block in blocks(text, self.faults, self.options.block_delete):
            self.number = block.number
            self.block(block)
            yield from self.ready
            self.ready.clear()
            if self.ended:
                break
        if self.held is not None:
            yield self.held

    def _add(self, segment: Segment) -> None:
        if self.held is not None:
            self.ready.append(self.held)
        self.held = self.events.begin(segment)

    def block(self, block: WordBlock) -> None:
        """One line's words; what is wrong with them becomes a fault."""
        number, found = block.number, block.words
        try:
            codes, values = self._sort_words(number, found)
            if codes or "F" in values or "P" in values:
                self._modal(codes, values)
            if codes.get("join") == 64:  # whose P is no number of turns
                values = {letter: value for letter, value in values.items() if letter not in "PQ"}
            if "dwell" in codes:
                self._dwell(number, {k: v for k, v in values.items() if k in "PNF" or "motion" not in codes})
                values = {k: v for k, v in values.items() if k != "P" and "motion" in codes}
            if "once" in codes:
                self._once(number, codes["once"], values, "F" in values)
            elif not values.keys() <= {"F", "P", "N"}:
                self._move(number, values, "F" in values)
        except MotionError as wrong:
            key = wrong.word if isinstance(wrong, WordFault) else ""
            nth = [k for k, (letter, text) in enumerate(found) if key in (letter.upper(), letter + text)]
            self.faults.add(str(wrong), number, f"column {block.column(nth[-1] if nth else 0)}")

    def _sort_words(self, number: int, found: Words) -> tuple[dict[str, float], dict[str, float]]:
        """The block's G by group, and the numbers of its other words by letter."""
        codes: dict[str, float] = {}
        values: dict[str, float] = {}
        silent: list[tuple[str, float]] = []
        for given, text in found:
            value = float(text)
            if not -MAX_NUMBER <= value <= MAX_NUMBER:
                raise WordFault(given + text, f"{given}{text[:20]}…: no such number makes sense")
            letter = given.upper()
            if letter in VALUE_LETTERS:
                if letter in values:
                    raise WordFault(letter, f"{letter} appears twice in its block")
                values[letter] = value
            elif letter == "G" and value in GROUPS:
                group = GROUPS[value]
                if group in codes:
                    raise WordFault(given + text, f"G{value:g} and G{codes[group]:g} exclude each other in a block")
                codes[group] = value
            elif letter == "M" and value in (2, 30):
                self.ended = True
            elif (word := find_ignored_word(letter, value, self.options.ignored_words)) is not None:
                self.left_out.add(word, number)
                silent.append((letter, value))
            elif letter == "M" and value in self.events.codes:
                silent.append((letter, value))
            else:
                word = f"{letter}{value:g}"
                every = letter if is_ignorable(letter) and letter != "M" else word
                remedy = f', or skip it by the option ignore="{every}" (--ignore {every})' if is_ignorable(word) else ""
                raise WordFault(given + text, f"{given}{text[:20]} is not supported; take it out{remedy}")
        for letter, owner in (("L", codes.get("once") == 10), ("Q", codes.get("join") == 64)):
            if letter in values and not owner:
                raise WordFault(letter, f"{letter}{values[letter]:g} is not supported; take it out")
        if "G49" in codes:
            silent.append(("G", 49.0))
        if silent:
            self.offsets.block(silent)
            self.held = self.events.read(number, silent, self.held)
        return codes, values

    def _modal(self, codes: dict[str, float], values: dict[str, float]) -> None:
        """What holds from this block on."""
        # after G80 bare axis words mean nothing
        self.motion = codes.get("motion", None if "cycle" in codes else self.motion)
        self.plane = codes.get("plane", self.plane)
        if "length" in codes:
            self.unit, self.unstated = UNIT_METRES[codes["length"]], False
        if "distance" in codes:
            self.absolute = codes["distance"] == 90
        if "centre" in codes:
            self.from_start = codes["centre"] == 91.1
        if "feed" in codes and self.timed != (codes["feed"] == 93):
            self.timed, self.feed = not self.timed, None
        if "F" in values:
            if values["F"] <= 0:
                raise WordFault("F", f"F{values['F']:g} must be above 0")
            self.feed = values["F"] / 60
        if "join" in codes:
            self.join = self._read_join(codes["join"], values)
        if "system" in codes:
            self._renumber(lambda: self.coordinates.choose(codes["system"]))
        stated = "dwell" in codes or codes.get("join") == 64 or codes.get("once") == 10
        if "P" in values and not stated and (self.motion not in (2, 3) or values.keys() <= {"P", "F", "N"}):
            raise WordFault("P", "P belongs to G4 or G64")

    def _read_join(self, code: float, values: dict[str, float]) -> Join:
        if code != 64:
            self.join_word = f"G{code:g}"
            return Through() if code == 61 else Stop()
        if values.get("P", 0.0) < 0 or values.get("Q", 0.0) < 0:
            raise WordFault("G64", "G64 takes P and Q that are not negative")
        if values.get("P", 0.0) > 0:
            return Fit(values["P"] * self.unit)
        # as fast as possible, however far from the path: how far that may be has to be said elsewhere
        first = self.options.first_join
        if not isinstance(first, Fit | Blend):
            raise WordFault(
                "G64",
                "G64 needs P, the tolerance within which the path is followed, above 0, or the option fit or blend",
            )
        return first

    def _renumber(self, change: Callable[[], None]) -> None:
        """Change from where numbers count: the tool stays where it is."""
        before = self.coordinates
        place, stands = before.to_program(self.place[:3]), before.to_program(self.stands)
        change()
        self.place[:3], self.stands = before.from_program(place), before.from_program(stands)

    def _once(self, number: int, code: float, values: dict[str, float], fed: bool) -> None:
        """G10, G28, G53 and G92, which count from home or change from where numbers count."""
        word = f"G{code:g}"
        if self.tilted and code < 92:
            raise WordFault(word, f"{word} with angles in the option origin is not supported")
        if code == 53:
            if self.motion not in (0, 1) or not self.absolute:
                raise WordFault(word, "G53 needs G0 or G1, and G90")
            self._move(number, values, fed, {axis: values[axis] for axis in AXES[:3] if axis in values})
        elif code == 28:
            motion, self.motion = self.motion, 0.0
            if values.keys() & set(AXES):
                self._move(number, values, fed)
            homed = [axis for axis in AXES if axis in values] or list(AXES)
            angles = {axis: 0.0 if self.absolute else -degrees(self.place[3 + k]) for k, axis in enumerate(AXES[3:])}
            turned = {axis: angle for axis, angle in angles.items() if axis in homed}
            self._move(number, turned, fed, dict.fromkeys((axis for axis in AXES[:3] if axis in homed), 0.0))
            self.motion = motion
        elif more := values.keys() - set("XYZNF" + ("LPR" if code == 10 else "")):
            raise WordFault(min(more), f"{min(more)} beside {word} is not supported")
        elif code == 10:
            if values.get("L") not in (2, 20):
                raise WordFault("L", "G10 states systems only, by L2 or L20: tables of tools are not read")
            place = self.coordinates.to_program(self.place[:3])
            self._renumber(lambda: self.coordinates.state(values, self.unit, place))
        else:
            place = list(self.place)
            self._renumber(lambda: self.coordinates.shift(code, values, self.unit, place))

    def _dwell(self, number: int, values: dict[str, float]) -> None:
        if values.get("P", -1.0) < 0:
            raise WordFault("P", f"G4 needs P, the dwell time in {self.options.dwell}, not negative")
        if more := values.keys() - {"P", "N", "F"}:
            raise WordFault(min(more), f"{min(more)} has no meaning beside G4")
        self.entities["G4"] += 1
        if self.held is not None and not isinstance(self.held, Dwell):
            self.held = replace(self.held, join=Stop())
        if (seconds := values["P"] * (1e-3 if self.options.dwell == "ms" else 1)) > 0:
            if seconds > LONG_DWELL:
                self.remarks.add(LONG_TOLD, number)
            self._add(Dwell(seconds, line_number=number))

    def _move(
        self, number: int, values: dict[str, float], fed: bool, from_home: dict[str, float] | None = None
    ) -> None:
        """The way to where the words lead; from_home: X Y Z that count from there."""
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
        if changed := self.offsets.move() if "Z" in values else None:
            raise WordFault(
                "",
                f"it moved under {changed[0]} and moves under {changed[1]}: ignoring both would change the path; "
                "split the program there, or add their offsets to its coordinates",
            )
        end = self._end(values if from_home is None else {k: v for k, v in values.items() if k not in from_home})
        if from_home:
            there = self.coordinates.to_program(end[:3])
            for k, axis in enumerate(AXES[:3]):
                if axis in from_home:
                    there[k] = from_home[axis] * self.unit - self.coordinates.zero[k]
            end[:3] = self.coordinates.from_program(there)
        place, self.place = self.place, end
        # before anything can be wrong, so that what follows is held against what was meant
        stands, self.stands = self.stands, end[:3]
        if self.motion in (2, 3):
            self._arc(number, values, stands, place, end, fed)
        elif more := values.keys() & {"I", "J", "K", "R"}:
            raise WordFault(min(more), f"{min(more)} belongs to G2 or G3")
        elif dist(stands, end[:3]) > MIN_MOVE and end[:3] != place[:3]:
            self._line(number, dist(stands, end[:3]), place, end, fed)
        else:
            turned = dist(place[3:], end[3:]) > MIN_MOVE
            self._turn(number, place, end, fed) if turned else self.remarks.add(NOWHERE_TOLD, number)
            self.stands = stands

    def _line(self, number: int, length: float, place: list[float], end: list[float], fed: bool) -> None:
        speed = self.options.rapid if self.motion == 0 else self._speed(length, self.unit, fed)
        turned = self._find_orientation(place, end)
        there = np.array(self.coordinates.to_program(end[:3]))
        self._add(Line(there, turned, speed, self.join, line_number=number))
        self.entities[f"G{self.motion:.0f}"] += 1

    def _end(self, values: dict[str, float]) -> list[float]:
        """The place that a block leads to."""
        end = list(self.place)
        for k, axis in enumerate(AXES):
            if axis in values:
                said = values[axis] * self.unit if k < 3 else radians(values[axis])
                end[k] = said if self.absolute else end[k] + said
        return end

    def _speed(self, way: float, unit: float, fed: bool) -> float | None:
        """The cap that F makes on a way in m or rad; unit: what F counts, in m or rad."""
        if self.timed:
            if not fed or self.feed is None:
                raise WordFault("", "G93 needs F, 1/minutes of the block, on every block that moves")
            return way * self.feed
        if self.feed is not None:
            return self.feed * unit
        if self.options.feed is None and not self.faults.unread:
            raise WordFault("", "no F is active; add one, or give the option feed")
        return self.options.feed if unit == self.unit else None

    def _find_orientation(self, place: list[float], end: list[float]) -> Rotation | None:
        """The orientation at a block's end; None where it stays."""
        if place[3:] == end[3:]:
            return None
        from planner.sources.rs274.turns import turn_along

        orientation = turn_along(place[3:], end[3:])
        self.several += len([k for k in range(3, 6) if place[k] != end[k]]) > 1
        return orientation

    def _turn(self, number: int, place: list[float], end: list[float], fed: bool) -> None:
        from planner.sources.rs274.turns import turn_on_spot

        turn, angle = turn_on_spot(place[3:], end[3:], self.join, number)
        self.several += turn.about is None
        speed = None if self.motion == 0 else self._speed(abs(angle), radians(1), fed)
        self._add(replace(turn, angular_speed=speed))
        self.entities[f"G{self.motion:.0f}"] += 1

    def _arc(
        self,
        number: int,
        values: dict[str, float],
        begin: list[float],
        place: list[float],
        end: list[float],
        fed: bool,
    ) -> None:
        first, second, normal = PLANES[self.plane]
        points, most = (begin, place, end), self.options.arc_tolerance
        arc = read_arc(values, self.motion == 2, self.plane, self.unit, self.from_start, points, most)
        centre, axis = [0.0] * 3, [0.0] * 3
        centre[first], centre[second], centre[normal] = *arc.centre, begin[normal]
        axis[normal] = 1.0
        rise = end[normal] - begin[normal]
        u, v = begin[first] - arc.centre[0], begin[second] - arc.centre[1]
        speed = self._speed(hypot(hypot(u, v) * arc.angle, rise), self.unit, fed)
        turned = self._find_orientation(place, end)
        axis[0], axis[1] = self.coordinates.turn(axis[0], axis[1])
        about = np.array(self.coordinates.to_program(centre)), np.array(axis)
        self._add(Arc(*about, arc.angle, turned, speed, self.join, rise=rise, line_number=number))
        turn = arc.angle
        self.stands = list(end[:3])
        self.stands[first] = arc.centre[0] + u * cos(turn) - v * sin(turn)
        self.stands[second] = arc.centre[1] + u * sin(turn) + v * cos(turn)
        self.off = max(self.off, arc.off)
        self.entities[f"G{self.motion:.0f}"] += 1

    def warnings(self, after: int) -> tuple[str, ...]:
        """What was taken to mean something, and what was left out; after: lines that stand after the end."""
        told = [f"no G20 or G21: unit {self.options.length} was assumed"] if self.unstated else []
        told += self.events.describe()
        told += [f"skipped: {', '.join(self.left_out.describe())}"] if self.left_out.counts else []
        told += self.remarks.describe()
        if self.several:
            way = "by the shortest rotation, while controllers interpolate each letter"
            told.append(f"{self.several} blocks rotate about several axes at once: {way}")
        if self.off > 1e-9:
            told.append(f"arcs end up to {self.off * 1e6:.3g} um from their end points, because their radii differ")
        if after:
            told.append(f"not read: {count_noun(after, 'line')} after the end of the program")
        return tuple(told)
