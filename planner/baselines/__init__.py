"""Classical timings of a program: what every saving is measured against."""

from planner.baselines.between import Deviation
from planner.baselines.classical import KINDS, Classical, classical

__all__ = ["KINDS", "Classical", "Deviation", "classical"]
