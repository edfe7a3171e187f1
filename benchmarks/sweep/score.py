"""A batch of runs of one law on one task: simulated at once, each then reduced to its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isnan

import numpy as np

from benchmarks.sweep.cell import Cell, batched
from benchmarks.sweep.result import Result, Series
from controllers.metrics import BATCH_PERIOD, Metrics, evaluate_runs
from controllers.metrics.attained import Planned, planned_at
from controllers.metrics.effort import torque_limits
from controllers.rig import Rig, disturbed
from controllers.simulate import sample, simulate
from kinematics.array import Array
from kinematics.errors import MotionError


def score(cells: Sequence[Cell], rig: Rig) -> list[Result]:
    """The results of runs of one law on one task, in order. What a run raises of MotionError is its failure."""
    task, machine = rig.task(cells[0].task), rig.machine
    try:
        law = batched([cell.setting for cell in cells], rig)
        rigs = [_own(rig, cell) for cell in cells]
        runs = simulate(sample(task.motion, machine, task.dt), law, rigs)
        metrics = evaluate_runs(runs, task, rigs)
    except MotionError as error:
        if len(cells) == 1:
            return [Result(cells[0], failure=str(error))]
        # one run has stopped all: the halves tell which
        half = len(cells) // 2
        return [*score(cells[:half], rig), *score(cells[half:], rig)]
    share = runs.torque / torque_limits(rigs)
    every = max(1, round(BATCH_PERIOD / (runs.t[1] - runs.t[0])))
    read = machine.home_q + runs.measured[::every] * [axis.pulse for axis in machine.axes]
    return [
        _result(cell, of, planned_at(task.motion, machine, of.t), read[:, lane], share[:, lane], every)
        for lane, (cell, of) in enumerate(zip(cells, metrics, strict=True))
    ]


def _own(rig: Rig, cell: Cell) -> Rig:
    """The rig of one run: its inertia and friction, and its host's seed."""
    varied = disturbed(rig, inertia=cell.variation.inertia, friction=cell.variation.friction)
    return replace(varied, host=replace(rig.host, seed=rig.host.seed + cell.seed))


def _result(cell: Cell, metrics: Metrics, planned: Planned, read: Array, share: Array, every: int) -> Result:
    """read (K, n): by the encoders; share (N, n): torque over its limit at all samples, of which the metrics see one in
    `every`."""
    figures = metrics.figures()
    if isnan(figures["contour_rms"]):
        return Result(cell, failure="the axes left what the machine can reach, or its way of standing")
    first = np.arange(len(metrics.t)) * every
    high, low = np.maximum.reduceat(share, first), np.minimum.reduceat(share, first)
    series = Series(
        t=metrics.t,
        s=planned.s,
        planned=metrics.planned,
        actual=metrics.attained,
        contour=metrics.contour.value,
        tracking=metrics.tracking.value,
        torque=np.where(high > -low, high, low),
        reference=planned.q,
        feedback=read[: len(metrics.t)],
    )
    return Result(cell, {name: value for name, value in figures.items() if not isnan(value)}, series=series)
