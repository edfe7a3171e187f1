"""Saved runs compared: what is better than a baseline, by how much, and at what cost; the gain report."""

from benchmarks.compare.condition import Condition, read_condition
from benchmarks.compare.table import Comparison, Entry, Row, compare
from benchmarks.compare.verdict import Verdict, verdict_of

__all__ = ["Comparison", "Condition", "Entry", "Row", "Verdict", "compare", "read_condition", "verdict_of"]
