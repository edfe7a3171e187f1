"""Limits as data, twice: rows for the solvers, a physical quantity for the certificate."""

from planner.limits.limit import Limit, Rows, Term
from planner.limits.registry import limits_of, unkept, usual_order

__all__ = ["Limit", "Rows", "Term", "limits_of", "unkept", "usual_order"]
