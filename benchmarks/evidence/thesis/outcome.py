"""What the thesis' laws do on one emulated rig, over their gains.

What the thesis does not print, varied: the rig as stated, and rigs that differ from it by one assumption each.

Of its program [Sahbaz 2007, Appendix E] three things are printed whose meaning is not: `SetContinuousMove(axis, 1)` for
every axis before the first command, v(k − 1) read by `GetCurrentSpeed`, and `SDStop(axis, 0.001)` after the last
sample. The last is done as printed; the others have two readings each (`READINGS`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, cast

import numpy as np

from controllers.laws.law import Reference
from controllers.laws.registry import find_law
from controllers.metrics.evaluate import evaluate_runs
from controllers.rig import Rig, Task, disturb_rig, time_path
from controllers.rig_file import load_rig
from controllers.simulate import Runs, sample, simulate
from kinematics.foundation.arrays import Array
from planner.path.actuation import MachinePath
from planner.trajectory import Trajectory

TASK = "line"
"""The thesis' reference."""
CLOSING_STOP = 1e-3
"""s: `Tacc` of [Sahbaz 2007, Appendix E], within which its program stops the axes after the last sample."""
QUEUED = "SetContinuousMove: commands queue behind a running move"
UNSIGNED = "GetCurrentSpeed: the card's rate without its sign"
BOTH = "both: commands queue, and the rate has no sign"
STATED = "as stated"
READINGS = (STATED, QUEUED, UNSIGNED, BOTH)
"""Assumptions that are readings of what the program prints: a command replaces the running move, or queues behind it;
the rate has the sign of its direction, or none."""


@dataclass(frozen=True, slots=True)
class Assumption:
    """One reading of what is not printed: `rig` runs `task`."""

    name: str
    rig: Rig
    task: Task


def assumptions(rig: Rig | None = None) -> tuple[Assumption, ...]:
    """The rig as it is stated first, then one assumption changed at a time."""
    return tuple(_vary_rig(follow_printed_program(rig or load_rig("servo-rig"))))


def follow_printed_program(rig: Rig) -> Rig:
    """The rig under a host that reads and ends as the printed program does."""
    return replace(rig, host=replace(rig.host, speed_from="card", closing_stop=CLOSING_STOP))


def _vary_rig(rig: Rig) -> Iterator[Assumption]:
    task = rig.task(TASK)

    def other(name: str, changed: Rig, asked: Task = task) -> Assumption:
        return Assumption(name, changed, asked)

    queue = replace(rig.card, while_moving="queue")
    yield other(STATED, rig)
    yield other(QUEUED, replace(rig, card=queue))
    yield other(UNSIGNED, replace(rig, card=replace(rig.card, current_speed="magnitude")))
    yield other(BOTH, replace(rig, card=replace(queue, current_speed="magnitude")))
    encoders = replace(rig, host=replace(rig.host, speed_from="encoder"))
    yield other("the speed of the encoders instead of the card's rate", encoders)
    yield other("no closing stop: laws go on after the end", replace(rig, host=replace(rig.host, closing_stop=None)))
    going_on = replace(rig, card=replace(rig.card, start_from="current"))
    yield other("commands begin at the speed of the instant", going_on)
    in_time = replace(rig, card=replace(rig.card, short_moves="keep time"))
    yield other("moves too short for their ramps keep the ramps' time", in_time)
    yield other("speeds that are not rounded to registers", replace(rig, card=replace(rig.card, speed_range=None)))
    yield other("encoder behind the gear", _vary_drives(rig, feedback=lambda drive: "output"))
    yield other("no play", _vary_drives(rig, play=lambda drive: 0.0))
    yield other("play of 20 arcmin", _vary_drives(rig, play=lambda drive: 10 * drive.play))
    yield other("no friction", disturb_rig(rig, friction=0.0))
    yield other("twice the friction", disturb_rig(rig, friction=2.0))
    yield other("true inertia 30 % less", disturb_rig(rig, inertia=0.7))
    yield other("true inertia 30 % more", disturb_rig(rig, inertia=1.3))
    yield other("drives without delay", _vary_drives(rig, command_delay=lambda drive: 0))
    yield other("drives 5 ms late", _vary_drives(rig, command_delay=lambda drive: 20))
    yield other("a timer of 1 ms instead of 10 ms", replace(rig, host=replace(rig.host, granularity=1e-3)))
    for share in (0.1, 0.5):
        yield other(f"ramps of {100 * share:.0f} % of the time", rig, _change_ramps(task, share))
    yield other("other motions of the joints: the circle", rig, rig.task("circle"))


def _vary_drives(rig: Rig, **changes: Callable[[Any], object]) -> Rig:
    """The rig with fields of its drives made anew from each drive."""
    changed = (
        replace(drive, **cast(Any, {name: make(drive) for name, make in changes.items()})) for drive in rig.drives
    )
    return replace(rig, drives=tuple(changed))


def _change_ramps(task: Task, share: float) -> Task:
    """The task's path in the same time, by ramps of another share of it."""
    motion = cast(Trajectory, task.motion)
    return replace(task, motion=time_path(cast(MachinePath, motion.path), "quarter-sine", share, motion.duration))


LAWS = ("1", "2", "3", "3t", "4", "5", "6", "7", "6r", "7r")
"""The seven, the full trapezoid a sample, and 6 and 7 with the correction in the top speed too."""
PERIOD = 1e-3
SETTLING_TIME = 1.0
"""s that are watched after the planned end."""
LATE_TIME = 0.5
"""s after the planned end at which an axis that is to arrive is looked at: fifteen time constants of a 30 1/s loop."""


@dataclass(frozen=True, slots=True)
class LawSetting:
    """A law with gains, and the figures of its run (`controllers.metrics.metrics`)."""

    gains: Mapping[str, float]
    figures: Mapping[str, float]
    short: float
    """Pulses by which the worst axis is from its goal `LATE_TIME` s after the planned end."""
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
    settings: Mapping[str, tuple[LawSetting, ...]]

    def best(self, *laws: str) -> LawSetting:
        """The setting of the least error of some laws."""
        return min((setting for law in laws for setting in self.settings[law]), key=lambda setting: setting.error)


def run_laws(assumption: Assumption) -> Outcome:
    """Runs every law with every gain of its grid, a law's gains in one batch."""
    return Outcome(assumption, {law: _settings(assumption, law) for law in LAWS})


def _settings(assumption: Assumption, number: str) -> tuple[LawSetting, ...]:
    rig, task = assumption.rig, assumption.task
    grid = find_law(number).grid
    cells = list(product(*grid.values()))
    columns = {gain: np.array([cell[n] for cell in cells])[:, None] for n, gain in enumerate(grid)}
    rigs = [rig] * len(cells)
    reference = sample(task.motion, rig.machine, task.dt)
    runs = simulate(reference, find_law(number, None, **columns), rigs, period=PERIOD, settle=SETTLING_TIME)
    found = evaluate_runs(runs, task, rigs)
    short = _goal_distances(runs, task, reference)
    over = runs.steps[reference.steps] - task.motion.duration
    return tuple(
        LawSetting(dict(zip(grid, cell, strict=True)), metrics.figures(), float(pulses), float(late))
        for cell, metrics, pulses, late in zip(cells, found, short, over, strict=True)
    )


def _goal_distances(runs: Runs, task: Task, reference: Reference) -> Array:
    """(B,) of each run, see `LawSetting.short`."""
    at = int(np.searchsorted(runs.t, task.motion.duration + LATE_TIME))
    return np.asarray(np.abs(runs.actual[at] - reference.position[-1]).max(1))
