"""Runs what of a grid is not kept yet, on a cluster where Dask is installed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from platform import python_version
from typing import Any

import numpy as np

from benchmarks.sweep.cell import Cell
from benchmarks.sweep.digest import PACKAGES, Digests, digest
from benchmarks.sweep.grid import Grid
from benchmarks.sweep.result import Result
from benchmarks.sweep.score import score
from benchmarks.sweep.store import Runs, Store, load_runs
from controllers.metrics.attained import planned_at
from controllers.rig import Rig
from kinematics.errors import MotionError
from kinematics.machine import Machine
from planner.cluster import Lost, installed, on_cluster
from planner.parallel import Progress, spread
from planner.trajectory import Trajectory

LANES = 64
"""Runs simulated at once: more gain little, and hold their whole course in memory."""


def sweep(
    grid: Grid,
    rig: Rig,
    folder: Path,
    *,
    address: str | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> Runs:
    """Every run of a grid; what `folder` keeps of earlier sweeps is not run again.

    address: of a Dask scheduler whose workers have this package; None: this computer's cores, through Dask where it is
    installed, else through processes of our own, and `tell` is told so. progress is told how many runs are done, and of
    how many. A worker that dies costs its batch's time: others take it over. Raises MotionError for a task that the
    rig has not, where nothing answers at the address, and, after all others are kept, for runs that no worker
    survived.
    """
    facts = described(grid, rig)  # refuses what the rig has not, before there is a folder
    cells, digests, store = list(grid), Digests(rig), Store(folder)
    keys = [digest(cell, digests) for cell in cells]
    found = {key: store.find(key, cell) for key, cell in zip(keys, cells, strict=True)}
    key_of = dict(zip(cells, keys, strict=True))
    batches = list(_batches([cell for cell, key in key_of.items() if found[key] is None]))
    done = sum(result is not None for result in found.values())
    if progress is not None and cells:
        progress(done, len(found))

    def keep(_: object, results: list[Result]) -> None:
        nonlocal done
        for result in results:
            found[key_of[result.cell]] = result
            store.keep(key_of[result.cell], result)
        done += len(results)
        if progress is not None:
            progress(done, len(found))

    lost = _run(batches, rig, address, keep, tell)
    if lost:
        raise MotionError(f"sweep: {len(lost)} of {len(batches)} batches were lost, all others are kept: {lost[0]}")
    made_with = {"python": python_version(), **digests.libraries}
    record = {"rig": rig.name, "sha256": digests.as_record(), **facts, "versions": made_with}
    store.record(record, keys)
    return load_runs(folder)


def _run(
    batches: Sequence[tuple[Cell, ...]],
    rig: Rig,
    address: str | None,
    keep: Callable[[object, list[Result]], None],
    tell: Callable[[str], None],
) -> list[Lost]:
    lost: list[Lost] = []
    if address is None and (not installed() or len(batches) < 2):
        if len(batches) > 1:
            tell('Dask is not installed (extra "cluster"): the runs are spread over processes of this computer')
        spread(partial(score, rig=rig), batches, keep)
        return lost
    for n, results in on_cluster(score, batches, rig, address, packages=PACKAGES) if batches else ():
        if isinstance(results, Lost):
            lost.append(results)
        else:
            keep(batches[n], results)
    return lost


def _batches(cells: Sequence[Cell]) -> Iterator[tuple[Cell, ...]]:
    """Runs of the same law, gains and task kinds, that are simulated at once."""
    groups: dict[Any, list[Cell]] = {}
    for cell in cells:
        groups.setdefault((cell.setting.law, tuple(name for name, _ in cell.setting.gains), cell.task), []).append(cell)
    for group in groups.values():
        for first in range(0, len(group), LANES):
            yield tuple(group[first : first + LANES])


def described(grid: Grid, rig: Rig) -> dict[str, Any]:
    """What a reader of the runs needs to know of the tasks, and of the grid. Raises MotionError for an unknown task."""
    return {
        "seeds": list(grid.seeds),
        "variations": [variation.name for variation in grid.variations],
        "tasks": {
            name: {
                "duration_s": float(task.motion.duration),
                "dt_s": task.dt,
                "unit": planned.unit,
                "space": planned.path is not None,
                "resolution": resolution(rig.machine, planned.unit),
                "corners": corners(task.motion),
            }
            for name in grid.tasks
            for task in [rig.task(name)]
            for planned in [planned_at(task.motion, rig.machine, np.zeros(1))]
        },
        "axes": {axis.name: axis.unit for axis in rig.machine.axes},
        "pulses": {axis.name: axis.pulse for axis in rig.machine.axes},
    }


def resolution(machine: Machine, unit: str) -> float:
    """The smallest pulse as a distance in m or rad; that of a turning axis in space on the machine's own length."""
    length = machine.characteristic_length
    return min(axis.pulse * (1.0 if axis.unit == unit else length) for axis in machine.axes)


def corners(motion: Any) -> list[dict[str, float]]:
    """Where one piece of the path meets the next: when the plan is there, and how far along; none without a path."""
    if not isinstance(motion, Trajectory):
        return []
    after = np.flatnonzero(np.diff(motion.piece)) + 1
    return [{"t_s": float(motion.knots[k]), "s_m": float(motion.s[k])} for k in after]
