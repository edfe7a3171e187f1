from .result import (
    Cell as Cell,
    RunResult as RunResult,
    RunSeries as RunSeries,
    Setting as Setting,
    VARIATIONS as VARIATIONS,
    Variation as Variation,
    read_setting as read_setting,
    settings_of as settings_of,
)
from .run import (
    Grid as Grid,
    described as described,
    list_cells as list_cells,
    sweep as sweep,
)
from .result import SavedRuns as SavedRuns, load_runs as load_runs
