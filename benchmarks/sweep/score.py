"""A batch of runs of one law on one task: simulated at once, each then reduced to its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import isnan

import numpy as np

from benchmarks.sweep.cell import Cell, batched
from benchmarks.sweep.result import Result, Series
from controllers.host import Host
from controllers.laws.law import Law
from controllers.metrics import Metrics, evaluate_runs
from controllers.metrics.attained import Planned, attained_poses, planned_at
from controllers.metrics.evaluate import BATCH_PERIOD
from controllers.rig import Rig, disturbed
from controllers.simulate import Runs, sample, simulate
from kinematics.array import Array
from kinematics.errors import MotionError

SLEEPER = Host("sleep", granularity=1 / 64, jitter=1e-3)
"""ASSUMED of a host that sleeps, where the rig's file states none: the timer of an office computer of the thesis' time
ticks 64 times a second, and what else runs there takes up to a millisecond."""


def score(cells: Sequence[Cell], rig: Rig) -> list[Result]:
    """The results of runs of one law on one task, in order. What a run raises of MotionError is its failure."""
    task, machine = rig.task(cells[0].task), rig.machine
    try:
        law = batched([cell.setting for cell in cells], rig)
        rigs = [_own(rig, law, cell) for cell in cells]
        runs = simulate(sample(task.motion, machine, task.dt), law, rigs)
        metrics = evaluate_runs(runs, task, rigs)
    except MotionError as error:
        if len(cells) == 1:
            return [Result(cells[0], failure=str(error))]
        # one run has stopped all: the halves tell which
        half = len(cells) // 2
        return [*score(cells[:half], rig), *score(cells[half:], rig)]
    planned = planned_at(task.motion, machine, metrics[0].t)
    limit = np.array([drive.torque_limit for drive in rig.drives])
    return [
        _result(cell, of, _series(of, planned, runs, lane, rig, limit))
        for lane, (cell, of) in enumerate(zip(cells, metrics, strict=True))
    ]


def _own(rig: Rig, law: Law, cell: Cell) -> Rig:
    """The rig of one run: its inertia and friction, and the host's timing that the law is meant for, with its seed."""
    host = SLEEPER if law.host == "sleep" and rig.host.timer == "counter" else rig.host
    varied = disturbed(rig, inertia=cell.variation.inertia, friction=cell.variation.friction)
    return replace(varied, host=replace(host, seed=cell.seed))


def _result(cell: Cell, metrics: Metrics, series: Series) -> Result:
    figures = metrics.figures()
    if isnan(figures["contour_rms"]):
        return Result(cell, failure="the axes left what the machine can reach, or its way of standing")
    return Result(cell, {name: value for name, value in figures.items() if not isnan(value)}, series=series)


def _series(metrics: Metrics, planned: Planned, runs: Runs, lane: int, rig: Rig, limit: Array) -> Series:
    machine, path = rig.machine, planned.path
    every = max(1, round(BATCH_PERIOD / (runs.t[1] - runs.t[0])))
    q = machine.home_q + runs.actual[::every, lane] * [axis.pulse for axis in machine.axes]
    if path is None:
        wanted, actual = planned.q, q
    else:
        numbers, attained, _ = attained_poses(q[:, None], planned, path, machine, certify=False)
        wanted, actual = numbers[:, :3], attained[:, 0, :3]
    share = runs.torque[:, lane] / limit
    first = np.arange(0, len(share), every)
    high, low = np.maximum.reduceat(share, first), np.minimum.reduceat(share, first)
    return Series(
        t=metrics.t,
        s=planned.s,
        planned=wanted,
        actual=actual,
        contour=metrics.contour.value,
        tracking=metrics.tracking.value,
        torque=np.where(high > -low, high, low),
    )
