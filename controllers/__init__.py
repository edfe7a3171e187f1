"""Emulated hardware and tracking: motion card, servo, tracking laws, simulation, error metrics."""

from controllers.laws.registry import find_law, law_names
from controllers.metrics import Metrics, evaluate
from controllers.simulate import Tracking, track

__all__ = ["Metrics", "Tracking", "evaluate", "find_law", "law_names", "track"]
