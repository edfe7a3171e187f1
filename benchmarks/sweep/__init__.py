"""Grids of closed-loop runs: law × gains × task × rig × seed, run once and kept."""

from benchmarks.sweep.result import (
    VARIATIONS,
    Cell,
    RunResult,
    RunSeries,
    Setting,
    Variation,
    read_setting,
    settings_of,
)
from benchmarks.sweep.run import Grid, described, sweep
from benchmarks.sweep.store import SavedRuns, load_runs

__all__ = [
    "VARIATIONS",
    "Cell",
    "Grid",
    "RunResult",
    "RunSeries",
    "SavedRuns",
    "Setting",
    "Variation",
    "described",
    "load_runs",
    "read_setting",
    "settings_of",
    "sweep",
]
