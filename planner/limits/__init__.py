"""Limits as data, twice: rows for the solvers, a physical quantity for the certificate."""

from planner.limits.limit import Limit, Rows, Term
from planner.limits.registry import find_unkept_limits, limits_of, usual_order

__all__ = ["Limit", "Rows", "Term", "find_unkept_limits", "limits_of", "usual_order"]
