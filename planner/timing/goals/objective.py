"""What a motion is to have least of: its duration, or a weighed sum of that and the heat of its motors.

How such a motion is found is in planner.timing.goals.heat.
"""

import re
from dataclasses import dataclass

from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.options import check_fields

_SUM = re.compile(r"\s*time\s*(?:\+\s*(?P<weight>[\d.]+(?:[eE][+-]?\d+)?)?\s*\*?\s*heat\s*)?")
# What heat may weigh: above, a motion is so slow that other losses matter more.
MOST_WEIGHT = 1e3


@dataclass(frozen=True, slots=True)
class Objective:
    """What a motion is to have least of: its duration, and heat with a weight, both counted in the fastest motion's."""

    heat: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if not 0 <= self.heat <= MOST_WEIGHT:
            raise MotionError(f"objective: heat {self.heat:g}, a weight, must be from 0 to {MOST_WEIGHT:g}")

    def __str__(self) -> str:
        return "time" if self.heat == 0 else "time + heat" if self.heat == 1 else f"time + {self.heat:.15g} heat"


TIME = Objective()


def read_objective(text: str) -> Objective:
    """Of "time", "time + heat" or "time + 0.2 heat". Raises BadValue for what is none of these."""
    found = _SUM.fullmatch(text)
    if found is None:
        known = 'there are "time", "time + heat" and, weighed, "time + 0.2 heat"'
        raise BadValue(f"objective {text!r} is not known; {known}")
    if "heat" not in text:
        return TIME
    try:
        weight = 1.0 if found["weight"] is None else float(found["weight"])
    except ValueError:
        raise BadValue(f"objective {text!r}: {found['weight']} is not a number") from None
    if not 0 <= weight <= MOST_WEIGHT:
        raise BadValue(f"objective {text!r}: the weight {weight:g} of heat must be from 0 to {MOST_WEIGHT:g}")
    return Objective(weight)
