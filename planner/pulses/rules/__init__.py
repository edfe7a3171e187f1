"""Firing rules: one file each, one line here."""

from kinematics import registry  # by its module: `nearest` here is the rule's
from kinematics.errors import MotionError
from planner.option import read_options, split_options
from planner.pulses.rules.dda import Dda
from planner.pulses.rules.floor import Floor
from planner.pulses.rules.nearest import Nearest
from planner.pulses.rules.rule import Rule
from planner.pulses.rules.sampled import Sampled
from planner.pulses.rules.timer import Timer

RULES: dict[str, type[Rule]] = {
    Nearest.name: Nearest,
    Floor.name: Floor,
    Sampled.name: Sampled,
    Dda.name: Dda,
    Timer.name: Timer,
}
"""By name; each is made without arguments as the default of its kind."""


def find_rule(text: str) -> Rule:
    """The rule of a name, or of a name and options: "sampled", "sampled:period=50us", "dda:spacing=2ms,rate=200kHz".

    Raises MotionError for an unknown name or option, with the nearest, and for a value that the rule refuses.
    """
    name, given = split_options(text, "firing rule")
    if name not in RULES:
        raise MotionError(
            f'no firing rule is called "{name}"{registry.nearest(name, RULES)}; rules: {", ".join(RULES)}'
        )
    return RULES[name](**read_options(RULES[name], given, f"firing rule {name}"))


__all__ = ["RULES", "Dda", "Floor", "Nearest", "Rule", "Sampled", "Timer", "find_rule"]
