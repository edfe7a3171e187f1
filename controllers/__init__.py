"""Emulated hardware and tracking: motion card, servo, tracking laws, simulation, error metrics."""

from controllers.laws.registry import find_law, law_names
from controllers.metrics import Metrics, evaluate
from controllers.rig import Rig, load_rig, rig_names
from controllers.tracking import Tracking, track

__all__ = ["Metrics", "Rig", "Tracking", "evaluate", "find_law", "law_names", "load_rig", "rig_names", "track"]
