"""The objective of a motion: its duration, or a weighted sum of that and the heat of its motors.

`planner.timing.goals.heat` finds the motion with the least of it.
"""

import re
from dataclasses import dataclass

from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.options import check_fields

_SUM = re.compile(r"\s*time\s*(?:\+\s*(?:(?P<weight>[\d.]+(?:[eE][+-]?\d+)?)\s*\*?\s*)?heat\s*)?")
# What heat may weigh: above, a motion is so slow that other losses matter more.
MOST_WEIGHT = 1e3


@dataclass(frozen=True, slots=True)
class Objective:
    """Weighted sum of duration and heat, each as a multiple of the fastest motion's.

    heat  weight of the heat; 0: duration alone
    """

    heat: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if not 0 <= self.heat <= MOST_WEIGHT:
            raise MotionError(
                f"objective: heat {self.heat:g}, a weight, must be from 0 to {MOST_WEIGHT:g}"
            )

    def __str__(self) -> str:
        if self.heat == 0:
            return "time"
        weight = "" if self.heat == 1 else f"{self.heat:.15g} "
        return f"time + {weight}heat"


TIME = Objective()


def read_objective(text: str) -> Objective:
    """Read "time", "time + heat" or "time + 0.2 heat". Raises BadValue for any other text."""
    match = _SUM.fullmatch(text)
    if match is None:
        known = 'there are "time", "time + heat" and, weighed, "time + 0.2 heat"'
        raise BadValue(f"objective {text!r} is not known; {known}")
    if "heat" not in text:
        return TIME
    try:
        weight = 1.0 if match["weight"] is None else float(match["weight"])
    except ValueError:
        raise BadValue(f"objective {text!r}: {match['weight']} is not a number") from None
    if not 0 <= weight <= MOST_WEIGHT:
        raise BadValue(
            f"objective {text!r}: the weight {weight:g} of heat must be from 0 to {MOST_WEIGHT:g}"
        )
    return Objective(weight)
