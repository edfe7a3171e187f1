"""Modal state of a G-code program, which holds until a word changes it, and its copies by M70."""

from dataclasses import dataclass, replace
from math import radians

from planner.program.modifiers import Join
from planner.sources.rs274.events import Running

UNIT_METRES = {20.0: 0.0254, 21.0: 1e-3}
"""m of the numbers under G20 and G21."""


@dataclass(frozen=True, slots=True)
class Feed:
    """The speeds that an F word states where it is read: a later G20 or G21 leaves them.

    speed    of the tool along the path, m/s;  turning: where only A, B and C change, rad/s
    inverse  blocks per second, under G93
    """

    speed: float
    turning: float
    inverse: float


def read_feed(value: float, unit: float) -> Feed:
    """Return the speeds of an F word in a unit of length, m."""
    return Feed(value * unit / 60, radians(value) / 60, value / 60)


@dataclass(slots=True)
class Modes:
    """The modes of a program, but its motion, which M72 does not restore.

    plane   17, 18 or 19;  unit: m of the numbers
    absolute, from_start  G90 and not G91; G91.1 and not G90.1
    timed   G93;  feed: None before the first F
    retract  98 or 99; LinuxCNC begins with 99
    """

    unit: float
    join: Join
    plane: float = 17.0
    absolute: bool = True
    from_start: bool = True
    timed: bool = False
    feed: Feed | None = None
    retract: float = 99.0

    def copy(self) -> "Modes":
        """Return a copy that later words do not change."""
        return replace(self)


@dataclass(frozen=True, slots=True)
class Saved:
    """The state that M70 and M73 save.

    system   54 to 59.3;  shifted: whether the shift of G52 or G92 applies
    offset   words of the tool's;  running: spindle and coolant
    """

    modes: Modes
    system: float
    shifted: bool
    offset: str
    running: Running
