"""Classical timings of a program: what every saving is measured against."""

from planner.baselines.between import Deviation
from planner.baselines.classical import KINDS, Classical, classical
from planner.baselines.unlike import describe_differences, missing_limits, pick_baseline

__all__ = [
    "KINDS",
    "Classical",
    "Deviation",
    "classical",
    "describe_differences",
    "missing_limits",
    "pick_baseline",
]
