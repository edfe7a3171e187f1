"""Constant tool speed: the largest deviation from a stated speed, proved over continuous time."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.facts import Fact
from planner.certificate.cells import (
    Cells,
    evaluate_in_batches,
    find_sequences,
)
from planner.certificate.limit_use import LimitProof, bound_finely
from planner.limits.limit import Limit, LimitState, Term
from planner.limits.tool import squared_norm
from planner.place import Place
from planner.trajectory import Trajectory

CONSTANT_SPEED = "constant speed"
"""Name in a certificate: the largest proved deviation, over the allowed one."""
SPEED_TOLERANCE = 1e-9
"""Share by which a constant speed may differ from the stated one."""
# Refinement ends at this share of a time piece.
MIN_CELL_SHARE = 2.0**-12


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a motion at exactly `speed` (m/s), from one place to another.

    deviation  largest share by which the tool's speed differs from it, proved
    """

    speed: Annotated[float, Fact("speed_m_s")]
    deviation: Annotated[float, Fact("largest_deviation")]
    since: Annotated[Place, Fact("from")]
    until: Annotated[Place, Fact("to")]


def find_stretches(
    trajectory: Trajectory,
    use: Array,
) -> tuple[Stretch, ...]:
    """Return where a motion has the constant speeds that its segments state.

    use (M,): from its certificate
    """
    path = trajectory.path
    speed = trajectory.constant_speeds
    knots = trajectory.knots
    stretches = []
    for first, last in find_sequences(np.isfinite(speed)):
        start = float(knots[first])
        end = float(knots[last + 1])
        s = float(trajectory.s[last] + trajectory.v[last] * (end - knots[last]))
        stretch = Stretch(
            speed=float(speed[first]),
            deviation=SPEED_TOLERANCE * float(use[first : last + 1].max()),
            since=path.place(trajectory.s[first], trajectory.piece[first], start),
            until=path.place(s, trajectory.piece[last], end),
        )
        stretches.append(stretch)
    return tuple(stretches)


class SpeedDeviation(Limit):
    """||ṗ|/v − 1| ≤ SPEED_TOLERANCE on path pieces that state a speed v. Bounded by |ṗ|², which is
    smooth.
    """

    name = CONSTANT_SPEED
    channels = ("tool",)
    terms = frozenset({Term.SD})

    def __init__(self, speeds: Iterable[float | None]) -> None:
        self.speeds = np.array([np.nan if speed is None else speed for speed in speeds])

    def value(self, motion: LimitState) -> Any:
        return squared_norm(motion.tool_rate(1), range(3))

    def use(self, low: Array, high: Array, piece: np.ndarray) -> Array:
        speed = self.speeds[piece][:, None]
        speeds = np.sqrt(np.maximum([low, high], 0.0))
        return np.asarray(np.abs(speeds / speed - 1).max(0) / SPEED_TOLERANCE)

    def tight(self, met: Array) -> float:
        """Any bound up to 1 will do."""
        return np.inf


def prove_speed_deviation(
    trajectory: Trajectory,
) -> tuple[Array, Array, Place]:
    """Return the deviation of each time piece (M,), proved and attained, and the worst place.

    Deviations are shares of SPEED_TOLERANCE.
    """
    path = trajectory.path
    limit = SpeedDeviation([path.constant(piece) for piece in range(len(path.breaks) - 1)])
    cells = Cells.cover(trajectory)
    cells = cells[np.isfinite(trajectory.constant_speeds)[cells.k]]
    proof = LimitProof(trajectory, limit, order=2, least_share=MIN_CELL_SHARE)
    bound, attained = evaluate_in_batches(cells, partial(bound_finely, trajectory, [limit], 2))
    proof.run(cells, (bound[0], attained[0]))
    worst = int(np.argmax(proof.use))
    place = path.place(
        trajectory.s[worst],
        trajectory.piece[worst],
        trajectory.knots[worst],
        "tool",
    )
    return proof.use, proof.attained, place
