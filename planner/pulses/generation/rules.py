"""The table of the firing rules. It loads without the generation of pulses, for lists."""

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
