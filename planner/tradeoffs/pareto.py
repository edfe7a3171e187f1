"""Duration against heat: the motions with the least of either, weighed more and more."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.timing.certified_solve import Solution
from planner.tradeoffs.heat import measure_heat, solve_objective, weigh_axes
from planner.tradeoffs.objective import MOST_WEIGHT, TIME, Objective

WEIGHTS = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
"""Of heat, beside time."""


@dataclass(frozen=True, slots=True)
class Tradeoff(Result):
    """Motions along one path, each with the least of time + weight · heat, certified.

    weights (W,); duration (W,) s, dwells included; heat (W,) of each, as a share of the fastest motion's
    """

    weights: Array
    duration: Array
    heat: Array
    solutions: tuple[Solution, ...] = field(repr=False)

    def tables(self) -> tuple[Table, ...]:
        """Duration and heat by the weight."""
        columns = (
            Column("weight of heat", self.weights, form="g"),
            Column("duration", self.duration, "s", form=".6f"),
            Column("heat, of the fastest motion's", self.heat, form=".4f"),
        )
        return (Table("duration against heat", columns),)


def trade(
    path: ActuatorPath, limits: Sequence[Limit], axes: Sequence[Axis], order: int, weights: Sequence[float] = WEIGHTS
) -> Tradeoff:
    """By weights of heat, 0 for the fastest motion. Raises MotionError as `solve_objective`."""
    if not len(weights) or not all(0 <= weight <= MOST_WEIGHT for weight in weights):
        raise MotionError(f"weights {list(weights)} of heat must be some numbers from 0 to {MOST_WEIGHT:g}")
    of_axes, found, heats = weigh_axes(axes), [], []
    fastest = solve_objective(path, limits, axes, order, TIME)
    for weight in weights:
        best = fastest if weight == 0 else solve_objective(path, limits, axes, order, Objective(weight))
        found.append(best)
        heats.append(measure_heat(best.trajectory, of_axes))
    least = measure_heat(fastest.trajectory, of_axes)
    share = np.array(heats) / least if least > 0 else np.ones(len(heats))
    durations = np.array([each.trajectory.duration for each in found])
    return Tradeoff(np.array(weights, float), durations, share, tuple(found))
