"""What a plan does when: the limit that holds its motion back, and the segment of the program."""

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.plan import Plan
from planner.program.model import Dwell
from planner.timing.profile import Profile, sample_limit_use

ACTIVE_SHARE = 0.99
"""The share of a limit from which on it holds the motion back."""


def limit_shares(plan: Plan) -> dict[str, Array]:
    """(M,) the largest share of each limit that the motion is seen to use in each time piece.

    Of limits that do not depend on timing, the proven share. What is proved of the others is as close only where they
    are used most: elsewhere a bound need not be.
    """
    motion = plan.trajectory
    profile = Profile(motion.s, motion.v, motion.a, motion.j, np.diff(motion.knots), motion.piece)
    standing = {limit.name: plan.certificate.use[limit.name] for limit in plan.limits if limit.geometric}
    return standing | sample_limit_use(motion.path, plan.limits, profile)


def active_limits(plan: Plan) -> np.ndarray:
    """(M,) for each time piece the index in `plan.limits` of the limit that holds the motion back; −1 where none does.

    Of those used by 99 % or more it is the one most used in the middle of the piece: a ramp at the largest acceleration
    ends at the largest speed. Geometric limits never do: they do not depend on timing.
    """
    seen, motion = limit_shares(plan), plan.trajectory
    use = np.stack([seen[limit.name] * (not limit.geometric) for limit in plan.limits])
    state = motion.within(np.arange(len(motion.piece)), np.diff(motion.knots) / 2, jerk=plan.order == 3)
    middle = np.zeros_like(use)
    for n, limit in enumerate(plan.limits):
        if not limit.geometric:
            value = limit.value(state)
            middle[n] = largest_in_rows(limit.use(value, value, motion.piece))
    most = np.where(use >= ACTIVE_SHARE, middle, -1.0).argmax(0)
    return np.where(use.max(0) >= ACTIVE_SHARE, most, -1)


def find_segments(plan: Plan) -> list[tuple[int, int]]:
    """The time piece with which each segment begins, and its number in the program, from 1; dwells are segments too."""
    motion, program = plan.trajectory, plan.program.segments
    rests = (motion.v == 0) & (motion.a == 0) & (motion.j == 0) & (np.diff(motion.knots) > 0)
    begins = np.flatnonzero(np.diff(motion.piece, prepend=-1) | np.diff(rests, prepend=False))
    found: list[tuple[int, int]] = []
    for k in begins:
        number = motion.path.segment(int(motion.piece[k]))
        if number is None:
            continue
        after = 0 if k == 0 else number % len(program)  # what rests belongs to the piece before, or to the first
        number = after + 1 if rests[k] and isinstance(program[after], Dwell) else number
        if not found or found[-1][1] != number or k == begins[0]:
            found.append((int(k), number))
    return found
