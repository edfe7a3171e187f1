"""Events of G-code: a change of the tool, spindle and coolant, as stops and triggers where the path has come to.

As in LinuxCNC, the events of a block come before its motion. An event is a trigger at the end of the segment before
it, which may be a dwell; before the first segment, or where that one marks its start, it is one at the start of the
segment behind it. The motion stops at a change of the tool.
"""

from dataclasses import dataclass, field, replace

from planner.program.model import Dwell, Segment
from planner.program.modifiers import Stop, Trigger
from planner.sources.rs274.words import find_ignored_word

TOOL_CHANGE = 6.0
EVENTS = (TOOL_CHANGE, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0)
"""The M that are events. Those of a block come in its order, but a change of the tool first."""
MOST_LINES = 5
"""Lines that a warning names."""


@dataclass(slots=True)
class WordLines:
    """How often words stand in a file, and on which lines first."""

    counts: dict[str, int] = field(default_factory=dict)
    lines: dict[str, list[int]] = field(default_factory=dict)

    def add(self, word: str, line: int) -> None:
        self.counts[word] = self.counts.get(word, 0) + 1
        first = self.lines.setdefault(word, [])
        if len(first) < MOST_LINES and line not in first:  # a line may run again
            first.append(line)

    def describe(self) -> list[str]:
        """Each word, as M5 (7x: lines 3, 8, 12, 20, 31 and 2 more)."""
        told = []
        for word, count in sorted(self.counts.items()):
            first = self.lines[word]
            more = f" and {count - len(first)} more" if count > len(first) else ""
            told.append(f"{word} ({count}x: line{'s' * (len(first) > 1)} {', '.join(map(str, first))}{more})")
        return told


LONG_DWELL = 100.0
"""s above which a dwell is warned of: controllers differ in whether P counts seconds or milliseconds."""
LONG_TOLD = f"dwells above {LONG_DWELL:g} s, of which P may be meant in ms (option dwell)"
NOWHERE_TOLD = "blocks that end where they start were skipped"


class Events:
    """The events of a file: those that wait for the next segment, and the lines of all.

    codes  the M that are events here: none of those that are to be left out; strict: none at all
    """

    def __init__(self, ignored: frozenset[str], strict: bool) -> None:
        self.codes = [] if strict else [code for code in EVENTS if not find_ignored_word("M", code, ignored)]
        self.waiting: list[tuple[str, str, int]] = []  # what it is called, its word and line
        self.rested = False  # those that wait came behind a dwell that marks its own start
        self.tool, self.spindle = "", ""
        self.marked = WordLines()

    def read(self, line: int, words: list[tuple[str, float]], held: Segment | None) -> Segment | None:
        """The last segment with the events of a block; words: those of it that are no motion."""
        for letter, value in words:
            if letter == "T":
                self.tool = f" T{value:g}"
            elif letter == "S":
                self.spindle = f" S{value:g}"
        codes = [value for letter, value in words if letter == "M" and value in self.codes]
        for code in sorted(codes, key=lambda code: code != TOOL_CHANGE):
            setting = self.tool if code == TOOL_CHANGE else self.spindle if code in (3.0, 4.0) else ""
            held = self._mark(line, f"M{code:g}", setting, held)
        return held

    def _mark(self, line: int, word: str, setting: str, held: Segment | None) -> Segment | None:
        if held is not None and not isinstance(held, Dwell) and word == f"M{TOOL_CHANGE:g}":
            held = replace(held, join=Stop())
        before = None if held is None else held.trigger
        if held is None or (before is not None and before.at < 1):
            self.rested = isinstance(held, Dwell)
            self.waiting.append((word + setting, word, line))
            return held
        self.marked.add(word, line)
        name = word + setting if before is None else f"{before.name} {word}{setting}"
        return replace(held, trigger=Trigger(name))

    def begin(self, segment: Segment) -> Segment:
        """A new segment, with the events that waited for it."""
        if not self.waiting:
            return segment
        name = " ".join(called for called, _, _ in self.waiting)
        for _, word, line in self.waiting:
            self.marked.add(word, line)
        self.waiting.clear()
        after, self.rested = self.rested and not isinstance(segment, Dwell), False
        return replace(segment, trigger=Trigger(name, 0.0, after))

    def describe(self) -> list[str]:
        """What became of them, for warnings."""
        marked = self.marked.describe()
        stops = [text for text in marked if text.startswith(f"M{TOOL_CHANGE:g} ")]
        others = [text for text in marked if text not in stops]
        told = [f"the motion stops, and a trigger marks it: {', '.join(stops)}"] if stops else []
        told += [f"marked by triggers: {', '.join(others)}"] if others else []
        for called, _, line in self.waiting:
            told.append(f"{called} (line {line}): NO TRIGGER, as the last segment has one at its start already")
        return told
