"""What the check holds each firing rule to: written down again from what the rules state, without their code."""

from planner.pulses.check.crossings import Crossings
from planner.pulses.check.listed import Listed
from planner.pulses.check.looks import Looks
from planner.pulses.check.loose import Loose
from planner.pulses.check.search import Standard
from planner.pulses.motion import Motion
from planner.pulses.schedule import PulseSchedule

REACHED = 0.002  # pulses before a whole count where `floor` counts it as reached
PERIOD, TIMER = 2e-5, 2e6  # s and 1/s: what `sampled` and `timer` do where they state nothing else
SPACING, COUNT = 1e-2, 50  # and `dda`: s and pulses; it always states its rate
SAME = 1e-9  # of a bound


def standard(schedule: PulseSchedule, k: int, motion: Motion) -> Standard:
    """What axis k of a schedule is held to: its rule where its bound is the rule's, else its bound alone."""
    name, _, rest = schedule.rule.partition(":")
    try:
        pairs = (part.partition("=") for part in rest.split(",") if part)
        stated = {key.strip(): float(value.strip().partition(" ")[0]) for key, _, value in pairs}
    except ValueError:  # not as schedules state their rules: a number in SI, a space, its unit
        return Loose()
    axis = schedule.axes[k]
    bound = axis.bound - sum(one.error for one in schedule.moves if one.axis == axis.name)
    if name == "nearest":
        late = stated.get("hysteresis", 0.0)
        if abs(bound - 0.5 - late) <= SAME:
            return Crossings(0.5, late)
    if name == "floor" and abs(bound - 1 + REACHED) <= SAME:
        return Crossings(1 - REACHED)
    if name == "timer" and bound >= 0.5:
        return Crossings(0.5, grain=round(schedule.clock_hz / stated.get("clock", TIMER)))
    if name == "sampled" and bound >= 0.5:
        return Looks(round(stated.get("period", PERIOD) * schedule.clock_hz))
    if name == "dda" and bound >= 0.5 and "rate" in stated:
        count = round(stated.get("pulses_per_count", COUNT))
        return Listed.of(motion, k, schedule, stated.get("spacing", SPACING), count, stated["rate"])
    return Loose()
