"""Saved runs compared: what is better than a baseline, by how much, and at what cost; the gain report."""

from benchmarks.reports.gain.comparison import Comparison, ComparisonRow, SettingEntry, compare
from benchmarks.reports.gain.verdict import Condition, Verdict, read_condition, verdict_of

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
