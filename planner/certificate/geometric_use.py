"""Use of geometric limits, which depends on the place alone: proved once along the path, for every
timing.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from planner.certificate.coarse_use import use_in
from planner.certificate.continuity import MAX_JUMP, piece_end_lengths
from planner.certificate.limit_use import ProvedUse, prove, round_reached_use
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.trajectory import State, Trajectory, unit_speed_trajectory

# Knots at which geometric limits are evaluated first; then all knots around the worst of them.
KNOTS_SAMPLED = 128
# Paths whose proofs are remembered.
REMEMBERED_PATHS = 16


@dataclass(frozen=True, slots=True)
class PathUse:
    """Proved bounds of the use of geometric limits over parts of a path that begin at s (G,)."""

    s: Array
    end: float
    use: dict[str, Array]


_PROVED: dict[Hashable, PathUse] = {}


def prove_path_use(path: ActuatorPath, limits: Sequence[Limit]) -> dict[str, Array]:
    """Return, per geometric limit, the proved bound of its use on every part of
    `unit_speed_trajectory(path)`.
    """
    return _prove_along(path, limits).use if limits else {}


def _prove_along(path: ActuatorPath, limits: Sequence[Limit]) -> PathUse:
    """Prove the use along a path. The last few proofs are remembered: orders, retries and reruns
    share them.
    """
    key = path.content, *(limit.content for limit in limits)
    proved = _PROVED.pop(key, None)
    if proved is None:
        along = unit_speed_trajectory(path)
        use, _ = prove(along, limits, 2)
        use = {name: freeze_array(values) for name, values in use.items()}
        proved = PathUse(along.s, float(path.breaks[-1]), use)
    _PROVED[key] = proved  # the most recent is the last
    while len(_PROVED) > REMEMBERED_PATHS:
        _PROVED.pop(next(iter(_PROVED)), None)
    return proved


def forget_paths() -> None:
    """Forget all proofs along paths, to measure what they take."""
    _PROVED.clear()


def find_geometric_use(trajectory: Trajectory, limits: Sequence[Limit]) -> dict[str, Array]:
    """Return, per geometric limit, the proved bound over each time piece (M,): the largest of the
    parts it passes.
    """
    if not limits:
        return {}
    proved = _prove_along(trajectory.path, limits)
    s = np.append(trajectory.s, piece_end_lengths(trajectory)[-1:])
    slack = MAX_JUMP * (proved.end - proved.s[0])  # by which `find_gaps` lets a motion leave a place out
    first = np.searchsorted(proved.s, np.minimum(s[:-1], s[1:]) - slack, side="right") - 1
    last = np.searchsorted(proved.s, np.maximum(s[:-1], s[1:]) + slack, side="right")
    ranges = np.stack([np.clip(first, 0, len(proved.s) - 1), np.maximum(last, 1)], 1).ravel()
    return {name: np.maximum.reduceat(np.append(values, 0.0), ranges)[::2] for name, values in proved.use.items()}


def use_at_knots(trajectory: Trajectory, limits: Sequence[Limit], known: ProvedUse | None = None) -> dict[str, Array]:
    """Return, per geometric limit, the larger use attained at the two ends of each time piece (M,).

    It says where a limit is used most, and proves nothing: some knots are evaluated, then all
    around the one that uses most. Both sides of a knot are one place. known: earlier results.
    """
    pieces = len(trajectory.s)
    nothing = np.full(pieces, np.nan)
    attained = {limit.name: (nothing if known is None else known.attained[limit.name]).copy() for limit in limits}
    new = np.flatnonzero(np.isnan(attained[limits[0].name])) if limits else np.zeros(0, int)
    if not len(new):
        return attained
    knots = np.union1d(new, new + 1)
    step = -(-len(knots) // KNOTS_SAMPLED)
    sampled = knots[np.unique(np.append(np.arange(0, len(knots), step), len(knots) - 1))]
    states = _state_at_knots(trajectory, sampled)
    for limit in limits:
        use = np.zeros(pieces + 1)
        use[sampled] = use_in(limit, states)
        if step > 1:
            best = int(np.searchsorted(knots, sampled[use[sampled].argmax()]))
            around = knots[max(best - step + 1, 0) : best + step]
            use[around] = use_in(limit, _state_at_knots(trajectory, around))
        attained[limit.name][new] = round_reached_use(np.maximum(use[new], use[new + 1]))
    return attained


def _state_at_knots(trajectory: Trajectory, knots: np.ndarray) -> State:
    last = len(trajectory.s) - 1
    k = np.minimum(knots, last)
    return trajectory.within(k, np.where(knots <= last, 0.0, np.diff(trajectory.knots)[k]))
