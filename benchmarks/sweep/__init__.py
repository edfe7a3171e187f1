"""Grids of closed-loop runs: law × gains × task × rig × seed, run once and kept."""

from benchmarks.sweep.cell import VARIATIONS, Cell, Setting, Variation, read_setting, settings_of
from benchmarks.sweep.grid import Grid
from benchmarks.sweep.result import Result, Series
from benchmarks.sweep.run import described, sweep
from benchmarks.sweep.store import Runs, load_runs

__all__ = [
    "VARIATIONS",
    "Cell",
    "Grid",
    "Result",
    "Runs",
    "Series",
    "Setting",
    "Variation",
    "described",
    "load_runs",
    "read_setting",
    "settings_of",
    "sweep",
]
