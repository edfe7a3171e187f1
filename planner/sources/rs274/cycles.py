"""Canned cycles of RS-274, G73, G74 and G81 to G89, in the axes of the active plane.

| cycle | from the retract level R |
|---|---|
| G81 | feed to the bottom, rapid out: drilling |
| G82 | with a dwell P at the bottom |
| G83 | in steps of Q, each time out to R and back to 0.254 mm above the last depth |
| G73 | in steps of Q, each time 0.254 mm back |
| G84, G74 | feed in, the spindle turns the other way, a dwell P, feed out: right- and left-hand tapping |
| G85, G89 | feed in and out; G89 with a dwell P |
| G86 | feed in, a dwell P, the spindle stops, rapid out |
| G87 | back boring: off the axis by I J K in the plane, to the bottom, onto the axis, feed up to the level, back |
| G88 | feed in, a dwell P, the spindle stops and the program too; the operator retracts |

Source: LinuxCNC, src/emc/rs274ngc/interp_cycles.cc. A cycle moves in the plane at the level where
its series began, down to R, and at its end to that level again (G98) or to R (G99). R, the bottom,
P, Q, I, J and K hold until another motion. Under G91 the positions in the plane and R are
increments, and the bottom counts from R. L repeats a block.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from planner.program.model import MIN_MOVE
from planner.sources.rs274.words import WordFault

PECK_CLEARANCE = 0.254e-3
"""m above the last depth to which a rapid leads before the next step; D states another."""
MOST_REPEATS, MOST_PECKS = 1000, 10_000
"""Repeats and steps of a block, above which a number is a slip."""
REQUIRED: Mapping[float, str] = {
    **dict.fromkeys((73.0, 83.0), "Q"),
    **dict.fromkeys((82.0, 86.0, 88.0, 89.0), "P"),
    87.0: "IJK",
}
"""Letters that the first block of a cycle needs, with R and the axis across the plane."""
LENGTHS = "XYZIJKRQD"

Point = tuple[float, float, float]
"""A position along the first and second axis of the plane and along its normal, m."""


class Step(NamedTuple):
    """One step of a cycle.

    kind  rapid and feed lead `to` a point; rest: `value` s; event: the M word `value` or, for stop,
          a stop of the program
    """

    kind: Literal["rapid", "feed", "rest", "event", "stop"]
    to: Point = (0.0, 0.0, 0.0)
    value: float = 0.0


@dataclass(frozen=True, slots=True)
class Setting:
    """The modes that a block of a cycle depends on.

    axes   letters of the plane's first and second axis and of its normal; unit: m of the numbers;
           second: s of P
    lowest  whether the tool retracts to R only (G99); spindle: the M word that is active
    """

    axes: Sequence[str]
    unit: float
    second: float
    absolute: bool
    lowest: bool
    spindle: float


@dataclass(frozen=True, slots=True)
class Hole:
    """One hole: its position in the plane and its levels along the normal, m."""

    a: float
    b: float
    retract: float
    clear: float
    bottom: float
    values: Mapping[str, float]


class Cycles:
    """The canned cycles of a file, whose values hold from block to block.

    code     the active cycle; None: none.
    initial  level along the normal where the series began; None: the next block begins one
    """

    def __init__(self) -> None:
        self.code: float | None = None
        self.initial: float | None = None
        self._values: dict[str, float] = {}
        self._unit = 0.0
        self._rest = 0.0  # the last P of any cycle: G74 and G84 without P have it, as in LinuxCNC

    def end(self) -> None:
        """End the series: another motion or G80."""
        self.code = self.initial = None

    def run(
        self,
        code: float,
        words: Mapping[str, float],
        place: Point,
        setting: Setting,
    ) -> Iterator[Step]:
        """Yield the steps of a block. Raises WordFault for words that are missing or do not fit."""
        first, second, normal = setting.axes
        values = self._update(code, words, setting)
        if self.initial is None:
            self.initial = place[2]
        level = self.initial
        stated = [
            words[letter] * setting.unit if letter in words else None for letter in (first, second)
        ]
        if setting.absolute:
            retract, bottom = values["R"], values[normal]
            increments = [0.0, 0.0]
            a, b = (
                at if value is None else value for at, value in zip(place, stated, strict=False)
            )
        else:
            retract = level + values["R"]
            bottom = retract + values[normal]
            increments = [value or 0.0 for value in stated]
            a, b = place[:2]
        if retract < bottom - MIN_MOVE:
            raise WordFault(
                "R",
                f"R leads {1e3 * (bottom - retract):.6g} mm below {normal}, the bottom of the hole",
            )
        height = place[2]
        if level < retract:
            yield Step("rapid", (place[0], place[1], retract))
            level = height = retract
        clear = retract if setting.lowest else level
        count = _count(words)
        if code in (73, 83) and (pecks := count * (retract - bottom) / values["Q"]) > MOST_PECKS:
            raise WordFault("Q", f"Q makes {pecks:.0f} steps in this block; at most {MOST_PECKS}")
        for turn in range(count):
            a, b = a + increments[0], b + increments[1]
            if turn == 0 and height > retract:
                yield Step("rapid", (a, b, height))
                yield Step("rapid", (a, b, retract))
            else:
                yield Step("rapid", (a, b, clear))
                yield Step("rapid", (a, b, retract))
            yield from drill(code, Hole(a, b, retract, clear, bottom, values), setting)

    def _update(
        self,
        code: float,
        words: Mapping[str, float],
        setting: Setting,
    ) -> dict[str, float]:
        """Return the values that hold, m and s, with those of the block."""
        normal = setting.axes[2]
        needed = f"{normal}R{REQUIRED.get(code, '')}"
        if code != self.code and (missing := [letter for letter in needed if letter not in words]):
            raise WordFault(
                "",
                f"G{code:g} needs {', '.join(missing)}: its first block states {', '.join(needed)}",
            )
        before = self._values if code == self.code else {}
        given = {
            letter: value * setting.unit for letter, value in words.items() if letter in LENGTHS
        }
        if "P" in words:
            given["P"] = words["P"] * setting.second
        if self._unit != setting.unit and (
            old := [letter for letter in needed if letter not in given and letter != "P"]
        ):
            raise WordFault(
                "",
                f"the unit changed after {', '.join(old)} of G{code:g}: state them again",
            )
        values = {**before, **given}
        if "Q" in needed and values["Q"] <= 0:
            raise WordFault(
                "Q",
                f"Q{words.get('Q', 0):g} must be above 0: it is the depth of a step",
            )
        if values.get("P", 0.0) < 0:
            raise WordFault("P", f"P{words.get('P', 0):g} must not be negative: it is a dwell")
        if code in (74, 84):
            values.setdefault("P", self._rest)
        self._rest = values.get("P", self._rest)
        self.code, self._unit = code, setting.unit
        self._values = {letter: value for letter, value in values.items() if letter != "D"}
        return values


def _count(words: Mapping[str, float]) -> int:
    """Return how often a block runs. Raises WordFault."""
    count = words.get("L", 1.0)
    if count not in range(1, MOST_REPEATS + 1):
        raise WordFault(
            "L",
            f"L{count:g} must be a whole number from 1 to {MOST_REPEATS}: how often the block runs",
        )
    return int(count)


def drill(code: float, hole: Hole, setting: Setting) -> Iterator[Step]:
    """Yield the steps of one hole from the retract level on. Raises WordFault for too many."""
    values, turning = hole.values, setting.spindle
    rest = Step("rest", value=values.get("P", 0.0))

    def at(level: float) -> Point:
        return (hole.a, hole.b, level)

    if code == 87:
        yield from _bore_back(hole, setting)
        return
    if code in (73, 83):
        yield from _peck(code, hole)
    yield Step("feed", at(hole.bottom))
    if code in (82, 86, 88, 89):
        yield rest
    if code in (74, 84):
        inward, outward = (3.0, 4.0) if code == 84 else (4.0, 3.0)
        yield Step("event", value=5.0)
        yield Step("event", value=outward)
        yield rest
        yield Step("feed", at(hole.clear))
        yield Step("event", value=5.0)
        yield Step("event", value=inward)
    elif code == 89:
        yield Step("feed", at(hole.clear))
    elif code == 85:
        yield Step("feed", at(hole.retract))
        yield Step("rapid", at(hole.clear))
    else:
        if code in (86, 88) and turning != 5:
            yield Step("event", value=5.0)
        if code == 88:
            yield Step("stop")
        yield Step("rapid", at(hole.clear))
        if code in (86, 88) and turning != 5:
            yield Step("event", value=turning)


def _peck(code: float, hole: Hole) -> Iterator[Step]:
    """Yield the steps before the last of a hole that is drilled in steps."""
    step, clearance = hole.values["Q"], hole.values.get("D", PECK_CLEARANCE)
    done = 1
    while (depth := hole.retract - done * step) > hole.bottom + MIN_MOVE:
        yield Step("feed", (hole.a, hole.b, depth))
        if code == 83:
            yield Step("rapid", (hole.a, hole.b, hole.retract))
        yield Step("rapid", (hole.a, hole.b, depth + clearance))
        done += 1


def _bore_back(hole: Hole, setting: Setting) -> Iterator[Step]:
    """Yield the steps of G87: the tool passes the hole off its axis, the spindle stopped."""
    offset = {"X": "I", "Y": "J", "Z": "K"}
    i, j, k = (hole.values[offset[axis]] for axis in setting.axes)
    middle = k if setting.absolute else hole.bottom + k
    aside = (hole.a + i, hole.b + j)
    turning = setting.spindle != 5
    yield Step("rapid", (*aside, hole.retract))
    if turning:
        yield Step("event", value=5.0)
    yield Step("rapid", (*aside, hole.bottom))
    yield Step("rapid", (hole.a, hole.b, hole.bottom))
    if turning:
        yield Step("event", value=setting.spindle)
    yield Step("feed", (hole.a, hole.b, middle))
    yield Step("feed", (hole.a, hole.b, hole.bottom))
    if turning:
        yield Step("event", value=5.0)
    yield Step("rapid", (*aside, hole.bottom))
    yield Step("rapid", (*aside, hole.clear))
    yield Step("rapid", (hole.a, hole.b, hole.clear))
    if turning:
        yield Step("event", value=setting.spindle)
