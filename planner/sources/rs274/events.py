"""Events of G-code as triggers: stops, changes of the tool, spindle, coolant and outputs.

As in LinuxCNC, the events of a block come before its motion, except M0, M1 and M60, which come
after it. An event is a trigger at the end of the segment before it, which may be a dwell; before
the first segment, or where that one marks its start, it is one at the start of the next segment.
The motion stops at a change of the tool, at M0, M1 and M60, and where M66 waits for an input.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from planner.program.model import Dwell, Segment
from planner.program.modifiers import Stop, Trigger
from planner.sources.rs274.words import find_ignored_word

TOOL_CHANGE = 6.0
STOPS = (0.0, 1.0, 60.0)
"""The M words after whose block the program waits for its operator."""
OUTPUTS = {62.0: "P", 63.0: "P", 64.0: "P", 65.0: "P", 66.0: "PELQ", 67.0: "EQ", 68.0: "EQ"}
"""Outputs and the wait for an input, with the letters of their arguments, which follow them in
their block."""
WAIT = 66.0
"""The M word that waits for an input, unless it has L0 or no L."""
EVENTS = (TOOL_CHANGE, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0, *OUTPUTS, *STOPS)
"""The M words that are events. Those of a block come in its order, but a change of the tool
first."""
MOST_LINES = 5
"""Lines that a warning names."""


@dataclass(slots=True)
class WordLines:
    """How often words occur in a file, on which lines first, and on which last."""

    counts: dict[str, int] = field(default_factory=dict)
    lines: dict[str, list[int]] = field(default_factory=dict)
    last: dict[str, int] = field(default_factory=dict)

    def add(self, word: str, line: int) -> None:
        self.last[word] = line
        self.counts[word] = self.counts.get(word, 0) + 1
        first = self.lines.setdefault(word, [])
        if len(first) < MOST_LINES and line not in first:  # a line may run again
            first.append(line)

    def describe(self) -> list[str]:
        """Return each word, as M5 (7x: lines 3, 8, 12, 20, 31 and 2 more)."""
        texts = []
        for word, count in sorted(self.counts.items()):
            first = self.lines[word]
            more = f" and {count - len(first)} more" if count > len(first) else ""
            texts.append(
                f"{word} ({count}x: line{'s' * (len(first) > 1)} {', '.join(map(str, first))}{more})",
            )
        return texts


LONG_DWELL = 100.0
"""s above which a dwell is warned of: controllers differ in whether P counts seconds or
milliseconds."""
LONG_TOLD = f"dwells above {LONG_DWELL:g} s, of which P may be meant in ms (option dwell)"
NOWHERE_TOLD = "blocks that end where they start were skipped"

Event = tuple[float, str]
"""An M word and the text of its arguments, as (62, " P1")."""
Running = dict[str, float]
"""The M words that are active: of the spindle, of mist and of flood."""


class Events:
    """The events of a file: those that wait for the next segment, and the lines of all.

    codes    the M words that are events, but for words that are left out; under `strict` without
             spindle, coolant and tool
    running  the active words of spindle and coolant
    """

    def __init__(self, ignored: frozenset[str], strict: bool) -> None:
        codes = (*OUTPUTS, *STOPS) if strict else EVENTS
        self.codes = [code for code in codes if not find_ignored_word("M", code, ignored)]
        self.waiting: list[tuple[str, str, int]] = []  # name, word and line
        self.rested = False  # the waiting events come after a dwell that marks its own start
        self.tool, self.spindle = "", ""
        self.running: Running = {"spindle": 5.0, "mist": 9.0, "flood": 9.0}
        self.marked = WordLines()

    def note(self, letter: str, value: float) -> None:
        """Take the tool or the spindle's speed of a block, for the names of its triggers."""
        if letter == "T":
            self.tool = f" T{value:g}"
        elif letter == "S":
            self.spindle = f" S{value:g}"

    def read(self, line: int, events: Sequence[Event], last: Segment | None) -> Segment | None:
        """Return the last segment with the events of a block."""
        for code, text in sorted(events, key=lambda event: event[0] != TOOL_CHANGE):
            self._run(code)
            if code == TOOL_CHANGE:
                text = self.tool
            elif code in (3.0, 4.0):
                text += self.spindle
            waits = code == WAIT and " L" in text and " L0 " not in f"{text} "
            stops = waits or code in (TOOL_CHANGE, *STOPS)
            last = self._mark(line, f"M{code:g}", text, last, stops)
        return last

    def restore(self, line: int, running: Running, last: Segment | None) -> Segment | None:
        """Return the last segment with the events that bring back active words (M72)."""
        codes = [running[name] for name in running if running[name] != self.running[name]]
        return self.read(
            line,
            [(code, "") for code in dict.fromkeys(codes) if code in self.codes],
            last,
        )

    def _run(self, code: float) -> None:
        if code in (3, 4, 5):
            self.running["spindle"] = code
        if code in (7, 9):
            self.running["mist"] = code
        if code in (8, 9):
            self.running["flood"] = code

    def _mark(
        self,
        line: int,
        word: str,
        setting: str,
        last: Segment | None,
        stops: bool,
    ) -> Segment | None:
        if last is not None and not isinstance(last, Dwell) and stops:
            last = replace(last, join=Stop())
        before = None if last is None else last.trigger
        if last is None or (before is not None and before.at < 1):
            self.rested = isinstance(last, Dwell)
            self.waiting.append((word + setting, word, line))
            return last
        self.marked.add(word, line)
        name = word + setting if before is None else f"{before.name} {word}{setting}"
        return replace(last, trigger=Trigger(name))

    def begin(self, segment: Segment) -> Segment:
        """Return a new segment with the events that waited for it."""
        if not self.waiting:
            return segment
        name = " ".join(called for called, _, _ in self.waiting)
        for _, word, line in self.waiting:
            self.marked.add(word, line)
        self.waiting.clear()
        after, self.rested = self.rested and not isinstance(segment, Dwell), False
        return replace(segment, trigger=Trigger(name, 0.0, after))

    def describe(self) -> list[str]:
        """Return the warnings about events."""
        stopping = tuple(f"M{code:g} " for code in (TOOL_CHANGE, *STOPS))
        marked = self.marked.describe()
        stops = [text for text in marked if text.startswith(stopping)]
        others = [text for text in marked if text not in stops]
        texts = [f"the motion stops, and a trigger marks it: {', '.join(stops)}"] if stops else []
        texts += [f"marked by triggers: {', '.join(others)}"] if others else []
        for called, _, line in self.waiting:
            texts.append(
                f"{called} (line {line}): NO TRIGGER, as the last segment has one at its start already",
            )
        return texts
