"""What the thesis' laws do on one emulated rig, over their gains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.thesis.assumptions import Assumption
from controllers.laws.law import Reference
from controllers.laws.registry import find_law
from controllers.metrics.evaluate import evaluate_runs
from controllers.simulate import Runs, sample, simulate
from controllers.task import Task
from kinematics.array import Array

LAWS = ("1", "2", "3", "3t", "4", "5", "6", "7", "6r", "7r")
"""The seven, the full trapezoid a sample, and 6 and 7 with the correction in the top speed too."""
PERIOD = 1e-3
SETTLE = 1.0
"""s that are watched after the planned end."""
LATE = 0.5
"""s after the planned end at which an axis that is to arrive is looked at: fifteen time constants of a 30 1/s loop."""


@dataclass(frozen=True, slots=True)
class Setting:
    """A law with gains, and the figures of its run (`controllers.metrics.figures`)."""

    gains: Mapping[str, float]
    figures: Mapping[str, float]
    short: float
    """Pulses by which the worst axis is from its goal `LATE` s after the planned end."""
    over: float = 0.0
    """s after the planned end at which the host comes to the last sample, and sends its closing stop."""

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
    reference = sample(task.motion, rig.machine, task.dt)
    runs = simulate(reference, find_law(number, None, **columns), rigs, period=PERIOD, settle=SETTLE)
    found = evaluate_runs(runs, task, rigs)
    short = _short(runs, task, reference)
    over = runs.steps[reference.steps] - task.motion.duration
    return tuple(
        Setting(dict(zip(grid, cell, strict=True)), metrics.figures(), float(pulses), float(late))
        for cell, metrics, pulses, late in zip(cells, found, short, over, strict=True)
    )


def _short(runs: Runs, task: Task, reference: Reference) -> Array:
    """(B,) of each run, see `Setting.short`."""
    at = int(np.searchsorted(runs.t, task.motion.duration + LATE))
    return np.asarray(np.abs(runs.actual[at] - reference.position[-1]).max(1))
