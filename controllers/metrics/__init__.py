"""How well a motion was tracked: errors per axis, in space and beside the path, and what they cost the drives."""

from controllers.metrics.attained import Planned, planned_at
from controllers.metrics.circular_test import Circle, CircularTest, circular_test
from controllers.metrics.evaluate import BATCH_PERIOD, PERIOD, evaluate, evaluate_runs
from controllers.metrics.figures import FIGURES, Figure
from controllers.metrics.iso_style import IsoStyle, iso_style
from controllers.metrics.metrics import Metrics
from controllers.metrics.series import ErrorSeries

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
    "Planned",
    "circular_test",
    "evaluate",
    "evaluate_runs",
    "iso_style",
    "planned_at",
]
