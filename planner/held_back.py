"""Which limit holds a motion back, and when."""

import numpy as np

from planner.plan import Plan

ACTIVE = 0.99
"""The share of a limit from which on it holds the motion back."""


def active_limits(plan: Plan) -> np.ndarray:
    """(M,) for each time piece the index in `plan.limits` of the limit that holds the motion back; −1 where none does.

    It is the most used one from 99 % on. Geometric limits, which no timing can help, hold nothing back.
    """
    use = np.stack([plan.certificate.use[limit.name] * (not limit.geometric) for limit in plan.limits])
    return np.where(use.max(0) >= ACTIVE, use.argmax(0), -1)
