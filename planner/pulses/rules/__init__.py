"""Firing rules: one file each, one line here."""

from kinematics.errors import MotionError
from kinematics.registry import nearest
from planner.pulses.rules.nearest import Nearest
from planner.pulses.rules.rule import Rule

RULES: dict[str, type[Rule]] = {
    Nearest.name: Nearest,
}
"""By name; each is made without arguments as the default of its kind."""


def find_rule(name: str) -> Rule:
    """The rule of a name, with its default options. Raises MotionError for an unknown one, with the nearest."""
    if name not in RULES:
        raise MotionError(f'no firing rule is called "{name}"{nearest(name, RULES)}; rules: {", ".join(RULES)}')
    return RULES[name]()


__all__ = ["RULES", "Nearest", "Rule", "find_rule"]
