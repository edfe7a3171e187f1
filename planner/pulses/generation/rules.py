"""The firing rules by name."""

from kinematics.foundation.names import unknown_name
from kinematics.foundation.options import read_options, split_options
from planner.pulses.generation.dda import Dda
from planner.pulses.generation.firing_rule import Floor, Nearest, Rule
from planner.pulses.generation.sampled import Sampled
from planner.pulses.generation.timer import Timer

RULES: dict[str, type[Rule]] = {
    "nearest": Nearest,
    "floor": Floor,
    "sampled": Sampled,
    "dda": Dda,
    "timer": Timer,
}
"""Class of each rule. Without arguments it makes the rule with its default options."""


def find_rule(text: str) -> Rule:
    """Return the rule of a name with or without options.

    Examples: "sampled", "sampled:period=50us", "dda:spacing=2ms,rate=200kHz".

    Raises MotionError for an unknown name or option, with the nearest, and for a value that the rule refuses.
    """
    name, given = split_options(text, "firing rule")
    if name not in RULES:
        raise unknown_name("firing rule", name, RULES)
    return RULES[name](**read_options(RULES[name], given, f"firing rule {name}"))
