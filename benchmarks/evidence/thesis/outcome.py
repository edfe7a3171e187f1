"""Runs of the thesis' laws on one emulated rig, over their gains."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from benchmarks.evidence.thesis.assumptions import Assumption
from controllers.laws.registry import find_law
from controllers.metrics.evaluate import evaluate_runs
from controllers.simulate import sample, simulate

THESIS_LAWS = ("1", "2", "3", "4", "5", "6", "7")
LAWS = (*THESIS_LAWS, "3t", "6r", "7r")
"""The seven, law 3 with a full trapezoid in each sample, and 6 and 7 with the correction in the top
speed too.
"""
PERIOD = 1e-3
SETTLING_TIME = 1.0
"""s that are simulated after the planned end."""
LATE_TIME = 0.5
"""s after the planned end at which axes should have arrived: fifteen time constants of a 30 1/s
loop.
"""


@dataclass(frozen=True, slots=True)
class LawSetting:
    """A law with gains, and the figures of its run (`controllers.metrics.metrics`).

    distance  pulses of the worst axis from its goal, `LATE_TIME` s after the planned end
    delay     s after the planned end at which the host sends its closing stop
    """

    gains: Mapping[str, float]
    figures: Mapping[str, float]
    distance: float
    delay: float = 0.0

    @property
    def error(self) -> float:
        """RMS distance (m) from the plan, which decides which law is better."""
        return self.figures["tracking_rms"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """All settings of all laws under one assumption."""

    assumption: Assumption
    settings: Mapping[str, tuple[LawSetting, ...]]

    def best(self, *laws: str) -> LawSetting:
        """Return the setting of least error of some laws."""
        settings = (setting for law in laws for setting in self.settings[law])
        return min(settings, key=lambda setting: setting.error)


def run_laws(assumption: Assumption) -> Outcome:
    """Run every law with every gain of its grid, the gains of a law in one batch."""
    return Outcome(assumption, {law: run_law(assumption, law) for law in LAWS})


def run_law(assumption: Assumption, law: str) -> tuple[LawSetting, ...]:
    """Run a law with every gain of its grid."""
    rig, task = assumption.rig, assumption.task
    grid = find_law(law).grid
    cells = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    columns = {gain: np.array([[cell[gain]] for cell in cells]) for gain in grid}
    rigs = [rig] * len(cells)
    reference = sample(task.motion, rig.machine, task.dt)
    batch = find_law(law, None, **columns)
    runs = simulate(reference, batch, rigs, period=PERIOD, settle=SETTLING_TIME)
    late = int(np.searchsorted(runs.t, task.motion.duration + LATE_TIME))
    distances = np.abs(runs.actual[late] - reference.position[-1]).max(1)
    delays = runs.steps[reference.steps] - task.motion.duration
    figures = [metrics.figures() for metrics in evaluate_runs(runs, task, rigs)]
    return tuple(map(LawSetting, cells, figures, distances.tolist(), delays.tolist()))
