"""What the thesis' laws do on one emulated rig, over their gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.thesis.assumptions import Assumption
from controllers.laws.registry import find_law
from controllers.metrics.ending import BAND
from controllers.metrics.evaluate import evaluate_runs
from controllers.simulate import Runs, sample, simulate
from kinematics.array import Array

LAWS = ("1", "2", "3", "3t", "4", "5", "6", "7", "6r", "7r")
"""The seven, the full trapezoid a sample, and 6 and 7 with the correction in the top speed too."""
PERIOD = 1e-3
SETTLE = 1.0
"""s that are watched after the planned end."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A law with gains, and the figures of its run (`controllers.metrics.figures`)."""

    gains: Mapping[str, float]
    figures: Mapping[str, float]
    stands: float
    """s after the planned end from which all axes stand still, wherever that is: 0 at least, inf if they never do."""

    @property
    def error(self) -> float:
        """m, RMS distance to where the plan is: what decides which law is better."""
        return self.figures["tracking_rms"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """All settings of all laws under one assumption."""

    assumption: Assumption
    settings: Mapping[str, tuple[Setting, ...]]

    def best(self, *laws: str) -> Setting:
        """The setting of the least error of some laws."""
        return min((setting for law in laws for setting in self.settings[law]), key=lambda setting: setting.error)


def outcome(assumption: Assumption) -> Outcome:
    """Runs every law with every gain of its grid, a law's gains in one batch."""
    return Outcome(assumption, {law: _settings(assumption, law) for law in LAWS})


def _settings(assumption: Assumption, number: str) -> tuple[Setting, ...]:
    rig, task = assumption.rig, assumption.task
    grid = find_law(number).grid
    cells = list(product(*grid.values()))
    columns = {gain: np.array([cell[n] for cell in cells])[:, None] for n, gain in enumerate(grid)}
    rigs = [rig] * len(cells)
    runs = simulate(
        sample(task.motion, rig.machine, task.dt), find_law(number, None, **columns), rigs, period=PERIOD, settle=SETTLE
    )
    found = evaluate_runs(runs, task, rigs)
    still = _still(runs, task.motion.duration)
    return tuple(
        Setting(dict(zip(grid, cell, strict=True)), metrics.figures(), float(stands))
        for cell, metrics, stands in zip(cells, found, still, strict=True)
    )


def _still(runs: Runs, duration: float) -> Array:
    """(B,) s after `duration` from which all axes of a run stay within `BAND` of where its record ends.

    inf where that is in the last tenth of a second: what is in swing passes its last place all the time.
    """
    away = (np.abs(runs.actual - runs.actual[-1]) > BAND).any(2)
    last = len(away) - np.argmax(away[::-1], axis=0)
    since = runs.t[np.where(away.any(0), np.minimum(last, len(away) - 1), 0)]
    return np.where(since > runs.t[-1] - 0.1, np.inf, np.maximum(since - duration, 0.0))
