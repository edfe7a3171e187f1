"""What the step and direction inputs of a drive ask of the pulses, as data; and the drives that are known by name."""

from dataclasses import dataclass
from math import ceil, floor

from kinematics.array import POSITIVE, finite
from kinematics.errors import BadValue
from kinematics.registry import closest, nearest

ROUNDING = 1e-12
"""Share of a time that decimal fractions of seconds may be off."""
SHORTENED = 1e-3
"""Share of its interval by which whole ticks may shorten one at a stated rate; where a tick is more, they do not."""


@dataclass(frozen=True, slots=True)
class StepTiming:
    """The least times (s) that a drive needs on its inputs, and the most pulses a second.

    high, low    that STEP stays at each level
    setup, hold  that DIR is right before STEP rises, and stays so after it
    max_rate     1/s; None: what high and low allow
    Raises MotionError for a time below 0, or a high or low of 0.
    """

    high: float
    low: float
    setup: float
    hold: float
    max_rate: float | None = None

    def __post_init__(self) -> None:
        for name, least in (("high", POSITIVE), ("low", POSITIVE), ("setup", 0.0), ("hold", 0.0)):
            object.__setattr__(self, name, float(finite(getattr(self, name), f"step timing: {name}", (), least=least)))
        if self.max_rate is not None:
            rate = finite(self.max_rate, "step timing: max_rate", (), least=POSITIVE)
            object.__setattr__(self, "max_rate", float(rate))

    @property
    def rate(self) -> float:
        """1/s: the most pulses one way."""
        levels = 1 / (self.high + self.low)
        return levels if self.max_rate is None else min(levels, self.max_rate)

    @property
    def reversal(self) -> float:
        """s from a pulse to the next one the other way, at least: DIR changes once STEP is low and its hold is over."""
        return max(1 / self.rate, max(self.high, self.hold) + self.setup)

    def ticks(self, clock_hz: int) -> tuple[int, int]:
        """Whole clock ticks from a pulse to the next, and to the next the other way, at least; times are rounded up."""
        levels = whole(self.high + self.low, clock_hz)
        interval = levels if self.max_rate is None else max(levels, rate_ticks(self.max_rate, clock_hz))
        return interval, max(interval, whole(max(self.high, self.hold), clock_hz) + whole(self.setup, clock_hz))


def whole(time: float, clock_hz: int) -> int:
    """Clock ticks that last at least a time (s), but for rounding."""
    return ceil(time * clock_hz * (1 - ROUNDING))


def rate_ticks(rate: float, clock_hz: int, grain: int = 1) -> int:
    """Clock ticks, a multiple of `grain`, from a pulse to the next at a rate (1/s), at least.

    Pulses of just that rate lie on ticks only to one: it is rounded down where that is a thousandth or less, else up.
    """
    grains = clock_hz / (rate * grain)
    if grains * SHORTENED >= 1:
        return grain * floor(grains * (1 + ROUNDING))
    return grain * max(1, ceil(grains * (1 - ROUNDING)))


def _us(high: float, low: float, setup: float, hold: float, max_rate: float | None = None) -> StepTiming:
    return StepTiming(high * 1e-6, low * 1e-6, setup * 1e-6, hold * 1e-6, max_rate)


DRIVES = {
    "A4988": _us(1, 1, 0.2, 0.2),
    "DRV8825": _us(1.9, 1.9, 0.65, 0.65),
    "LV8729": _us(0.5, 0.5, 0.5, 0.5),
    "DRV8884": _us(0.97, 0.97, 0.2, 0.2, 500e3),
    "TMC2209": _us(0.1, 0.1, 0.02, 0.02),
    "Pacific-6410": _us(0.25, 0.25, 50, 0, 2e6),
    "Pacific-6410-filtered": _us(1, 1, 50, 0, 500e3),
    # The sources state no set-up of the direction for the servo inputs. ASSUMPTION: as long as a level of STEP.
    "servo-differential": _us(1, 1, 1, 1, 500e3),
    "servo-open-collector": _us(2.5, 2.5, 2.5, 2.5, 200e3),
    "servo-high-speed": _us(0.125, 0.125, 0.125, 0.125, 4e6),
}
"""By name, as their data sheets state them: Pacific Scientific's in [KMITL 2005], the others in the makers'."""


def find_drive(name: str) -> StepTiming:
    """The timing of a drive. Raises MotionError for an unknown name, with the nearest and all known ones."""
    if name not in DRIVES:
        told = f'no drive is called "{name}"{nearest(name, DRIVES)}; drives: {", ".join(DRIVES)}'
        raise BadValue(told, allowed=", ".join(DRIVES), nearest=closest(name, DRIVES))
    return DRIVES[name]
