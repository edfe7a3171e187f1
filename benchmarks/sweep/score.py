"""A batch of runs of one law on one task: simulated at once, each then reduced to its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.sweep.cell import NOMINAL, Cell, Variation, batched
from benchmarks.sweep.grid import Bench
from benchmarks.sweep.result import Result, Series
from controllers import evaluate
from controllers.metrics import Metrics
from controllers.rig import Rig
from controllers.simulate import Runs, Tracking, sample, simulate
from controllers.task import Task
from kinematics.array import Array
from kinematics.errors import MotionError

SAMPLES = 2000
"""Instants, about, at which the course of a run is kept."""
LINES = 400
"""Frequencies, about, at which the spectrum of a run is kept."""


def score(cells: Sequence[Cell], bench: Bench) -> list[Result]:
    """The results of runs of one law on one task, in order. What a run raises of MotionError is its failure."""
    task = bench.task(cells[0].task)
    rigs = [varied(bench.rig, cell.variation) for cell in cells]
    try:
        law = batched([cell.setting for cell in cells])
        runs = simulate(sample(task.motion, bench.rig.machine, task.dt), law, rigs)
    except MotionError as error:
        if len(cells) == 1:
            return [Result(cells[0], failure=str(error))]
        # one run has stopped all: the halves tell which
        half = len(cells) // 2
        return [*score(cells[:half], bench), *score(cells[half:], bench)]
    return [_reduced(cell, runs, lane, task, rigs[lane]) for lane, cell in enumerate(cells)]


def varied(rig: Rig, variation: Variation) -> Rig:
    """The rig with its drives' inertia and friction multiplied."""
    return replace(
        rig,
        drives=tuple(
            replace(drive, inertia=drive.inertia * variation.inertia, friction=drive.friction * variation.friction)
            for drive in rig.drives
        ),
    )


def _reduced(cell: Cell, runs: Runs, lane: int, task: Task, rig: Rig) -> Result:
    machine = rig.machine
    pulse = np.array([axis.pulse for axis in machine.axes])
    planned = task.motion.at(np.minimum(runs.t, task.motion.duration)).q
    command, actual = (machine.home_q + of[:, lane] * pulse for of in (runs.command, runs.actual))
    tracking = Tracking(cell.setting.label, task.dt, runs.t, planned, command, actual, runs.pulses[lane])
    try:
        metrics = evaluate(tracking, task.motion, machine)
    except MotionError as error:
        return Result(cell, failure=str(error))
    figures = _figures(metrics)
    return Result(cell, figures, series=_series(metrics, runs, lane, task, rig) if cell.variation == NOMINAL else None)


def _figures(metrics: Metrics) -> dict[str, float]:
    named = {one.name: one for one in metrics.series}
    return {
        f"{name}_{what}": getattr(named[name], what)
        for name in ("contour", "tracking", "orientation")
        for what in ("rms", "p95", "max")
    }


def _series(metrics: Metrics, runs: Runs, lane: int, task: Task, rig: Rig) -> Series:
    """The course of a run, thinned out; what is thinned keeps its largest values where it is a magnitude."""
    machine, path = rig.machine, task.motion.path
    pulse = np.array([axis.pulse for axis in machine.axes])
    every = round((metrics.t[1] - metrics.t[0]) / (runs.t[1] - runs.t[0]))
    planned = task.motion.at(np.minimum(metrics.t, task.motion.duration))
    pose = path.pose_numbers(planned.s, planned.piece)
    actual = machine.forward(machine.home_q + runs.actual[::every, lane] * pulse).pose.translation
    limit = np.array([drive.torque_limit for drive in rig.drives])
    used = np.abs(runs.torque[:, lane] / limit).max(1)
    thin = max(1, len(metrics.t) // SAMPLES)
    blocks = np.arange(0, len(metrics.t), thin)
    frequency, spectrum = _spectrum(actual - pose[:, :3], metrics.t[1] - metrics.t[0])
    return Series(
        t=metrics.t[::thin],
        s=planned.s[::thin],
        planned=pose[::thin, :3],
        actual=actual[::thin],
        contour=metrics.contour.value[::thin],
        tracking=metrics.tracking.value[::thin],
        torque=np.maximum.reduceat(used, blocks * every),
        frequency=frequency,
        spectrum=spectrum,
    )


def _spectrum(error: Array, dt: float) -> tuple[Array, Array]:
    """Frequencies (F,), Hz, and amplitudes of an error (N, n) under a Hann window: the largest of each band.

    A sine of amplitude a shows as a: |X| is divided by half the sum of the window. Of several components √Σ|X|².
    """
    window = np.hanning(len(error))
    amplitude = np.linalg.norm(np.fft.rfft(error * window[:, None], axis=0), axis=1) * 2 / window.sum()
    frequency = np.fft.rfftfreq(len(error), dt)[1:]
    edges = np.unique(np.round(np.geomspace(1, len(frequency), LINES)).astype(int)) - 1
    return frequency[edges], np.maximum.reduceat(amplitude[1:], edges)
