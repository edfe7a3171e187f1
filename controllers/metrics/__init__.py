"""How well a motion was tracked: errors per axis, in space and beside the path, and what they cost the drives."""

from controllers.metrics.evaluate import PERIOD, evaluate, evaluate_runs
from controllers.metrics.figures import FIGURES, Figure
from controllers.metrics.metrics import Metrics
from controllers.metrics.series import ErrorSeries

__all__ = ["FIGURES", "PERIOD", "ErrorSeries", "Figure", "Metrics", "evaluate", "evaluate_runs"]
