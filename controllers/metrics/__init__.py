"""How well a motion was tracked: errors per axis, in space and beside the path, and what they cost the drives."""

from controllers.metrics.attained import PlannedStates, sample_plan
from controllers.metrics.circular_test import Circle, CircularTest, circular_test
from controllers.metrics.evaluate import BATCH_PERIOD, PERIOD, evaluate, evaluate_runs
from controllers.metrics.iso_style import IsoStyle, iso_style
from controllers.metrics.metrics import FIGURES, ErrorSeries, Figure, Metrics

__all__ = [
    "BATCH_PERIOD",
    "FIGURES",
    "PERIOD",
    "Circle",
    "CircularTest",
    "ErrorSeries",
    "Figure",
    "IsoStyle",
    "Metrics",
    "PlannedStates",
    "circular_test",
    "evaluate",
    "evaluate_runs",
    "iso_style",
    "sample_plan",
]
