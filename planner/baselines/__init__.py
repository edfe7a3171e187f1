"""Classical timings of a program: what every saving is measured against."""

from planner.baselines.classical import KINDS, Classical, classical, describe_differences, missing_limits, pick_baseline
from planner.baselines.moves import Deviation

__all__ = [
    "KINDS",
    "Classical",
    "Deviation",
    "classical",
    "describe_differences",
    "missing_limits",
    "pick_baseline",
]
