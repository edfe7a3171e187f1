"""Constant tool speed: the largest deviation from a stated speed, proved over continuous time, both
ways.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.facts import Fact
from planner.certificate.cells import Cells, evaluate_in_batches
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

    deviation: the largest share of it by which the tool's speed differs, proved over continuous
    time
    """

    speed: Annotated[float, Fact("speed_m_s")]
    deviation: Annotated[float, Fact("largest_deviation")]
    since: Annotated[Place, Fact("from")]
    until: Annotated[Place, Fact("to")]


def find_stretches(trajectory: Trajectory, use: Array) -> tuple[Stretch, ...]:
    """Return where a motion has the constant speeds that its segments state; use (M,): from its
    certificate.
    """
    path = trajectory.path
    speed = trajectory.constant_speeds
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.isfinite(speed), [False]])))
    stretches = []
    for first, last in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        start, end = (float(trajectory.knots[k]) for k in (first, last + 1))
        s = float(trajectory.s[last] + trajectory.v[last] * (end - trajectory.knots[last]))
        since = path.place(trajectory.s[first], trajectory.piece[first], start)
        until = path.place(s, trajectory.piece[last], end)
        deviation = SPEED_TOLERANCE * float(use[first : last + 1].max())
        stretches.append(Stretch(float(speed[first]), deviation, since, until))
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
        slowest, fastest = (np.sqrt(np.maximum(square, 0.0)) for square in (low, high))
        deviation = np.maximum(np.abs(slowest / speed - 1), np.abs(fastest / speed - 1))
        return np.asarray(deviation / SPEED_TOLERANCE)

    def tight(self, met: Array) -> float:
        """Any bound up to 1 will do."""
        return np.inf


def prove_speed_deviation(trajectory: Trajectory) -> tuple[Array, Array, Place]:
    """Return the share of SPEED_TOLERANCE by which each time piece (M,) deviates: proved, and
    attained; the worst place.
    """
    path = trajectory.path
    limit = SpeedDeviation([path.constant(piece) for piece in range(len(path.breaks) - 1)])
    cells = Cells.cover(trajectory)
    cells = cells[np.isfinite(trajectory.constant_speeds)[cells.k]]
    proof = LimitProof(trajectory, limit, order=2, least_share=MIN_CELL_SHARE)
    bound, attained = evaluate_in_batches(cells, partial(bound_finely, trajectory, [limit], 2))
    proof.run(cells, (bound[0], attained[0]))
    worst = int(np.argmax(proof.use))
    s, piece, t = (values[worst] for values in (trajectory.s, trajectory.piece, trajectory.knots))
    return proof.use, proof.attained, path.place(s, piece, t, "tool")
