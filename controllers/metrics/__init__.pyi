from .contour import PlannedStates as PlannedStates, sample_plan as sample_plan
from .circular_test import (
    Circle as Circle,
    CircularTest as CircularTest,
    circular_test as circular_test,
)
from .evaluate import (
    BATCH_PERIOD as BATCH_PERIOD,
    PERIOD as PERIOD,
    evaluate as evaluate,
    evaluate_runs as evaluate_runs,
)
from .metrics import (
    ErrorSeries as ErrorSeries,
    FIGURES as FIGURES,
    Figure as Figure,
    Metrics as Metrics,
)
