"""Saved runs compared: what is better than a baseline, by how much, and at what cost; the gain report."""

from benchmarks.reports.gain.comparison import Comparison, ComparisonRow, SettingEntry, compare
from benchmarks.reports.gain.condition import Condition, read_condition
from benchmarks.reports.gain.verdict import Verdict, verdict_of

__all__ = [
    "Comparison",
    "ComparisonRow",
    "Condition",
    "SettingEntry",
    "Verdict",
    "compare",
    "read_condition",
    "verdict_of",
]
