"""A sweep: the runs of a grid that are not kept yet are made, on a cluster where Dask is installed.

Runs of one law on one task are simulated at once, as a batch, and each is then reduced to its
figures. What a run depends on is one hash: the same hash, the same result.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache, partial
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from math import isnan
from os import PathLike
from pathlib import Path
from platform import python_version
from typing import Any

import numpy as np

from benchmarks.sweep.result import (
    VARIATIONS,
    Cell,
    RunResult,
    RunSeries,
    SavedRuns,
    Setting,
    Store,
    Variation,
    batch_law,
    load_runs,
)
from controllers.drives.servo import Servo
from controllers.drives.stepper import Stepper
from controllers.laws.registry import find_law
from controllers.metrics import BATCH_PERIOD, Metrics, evaluate_runs
from controllers.metrics.contour import PlannedStates, directions, sample_plan
from controllers.metrics.metrics import torque_limits
from controllers.rig import Rig, Task, disturb_rig
from controllers.rig_file import load_rig
from controllers.simulate import sample, simulate
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments, check_fields
from kinematics.machine.machine import Machine
from planner.cluster import LostTask, is_installed, run_on_cluster
from planner.environment import LIBRARIES
from planner.parallel import Progress, spread
from planner.path.actuation import MachinePath
from planner.trajectory import Trajectory

SAMPLE_PERIOD = 1e-3
"""s between the instants at which a motion is hashed."""
PACKAGES = ("kinematics", "planner", "controllers", "benchmarks.sweep")
"""Whose source makes the results."""


def digest(cell: Cell, of: Digests) -> str:
    """SHA-256 of the cell, its rig, its task, the code, its libraries and Python, as 32 hexadecimal
    digits.
    """
    return _hash([cell, of.rig, of.tasks[cell.task], of.code, of.libraries, of.python])[:32]


class Digests:
    """The hashes that the cells on a rig share."""

    def __init__(self, rig: Rig) -> None:
        self.rig = _hash(replace(rig, tasks=()))
        self.tasks = {task.name: _hash(task) for task in rig.tasks}
        self.code = code()
        self.libraries = versions(LIBRARIES)
        self.python = python_version()

    def as_record(self) -> dict[str, Any]:
        return {"rig": self.rig, "tasks": self.tasks, "code": self.code}


@cache
def code() -> str:
    """Of the source that makes the results: another simulator, other runs."""
    found = sha256()
    for package in PACKAGES:
        pending = [files(package)]
        while pending:
            entries = sorted(pending.pop().iterdir(), key=lambda entry: entry.name)
            pending += [
                entry for entry in entries if entry.is_dir() and entry.name != "__pycache__"
            ]
            for entry in entries:
                if entry.name.endswith(".py"):
                    found.update(entry.read_bytes())
    return found.hexdigest()


def versions(packages: Sequence[str]) -> dict[str, str]:
    """Of the packages that are installed, and which are not."""
    found = {}
    for package in packages:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _hash(value: object) -> str:
    found = sha256()
    _feed(value, found)
    return found.hexdigest()


def _feed(value: object, found: Any) -> None:
    """Types and contents, so that no two values are taken for one another."""
    match value:
        case None | bool() | int() | float() | str() | bytes():
            found.update(f"{type(value).__name__}:{value!r};".encode())
        case np.generic():
            _feed(value.item(), found)
        case np.ndarray():
            found.update(f"array:{value.dtype}{value.shape};".encode())
            found.update(np.ascontiguousarray(value).tobytes())
        case Machine():
            home = value.home.as_matrix()
            # the map from poses to axes enters by its slope here, and by the task's own poses and
            # positions
            _feed(
                (
                    type(value).__name__,
                    value.name,
                    value.axes,
                    home,
                    value.home_q,
                    value.jacobian(value.home),
                ),
                found,
            )
        case Task():
            _feed((value.name, value.dt, _motion(value.motion)), found)
        case dict():
            _feed(sorted(value.items()), found)
        case tuple() | list():
            found.update(f"{len(value)}(".encode())
            for one in value:
                _feed(one, found)
        case _ if is_dataclass(value):
            found.update(f"{type(value).__qualname__}(".encode())
            for field in fields(value):
                _feed((field.name, getattr(value, field.name)), found)
        case _:
            raise MotionError(
                f"sweep: {type(value).__name__} {value!r:.80} has no hash; give rigs plain data"
            )


def _motion(motion: Any) -> list[Any]:
    t = np.append(np.arange(0.0, motion.duration, SAMPLE_PERIOD), motion.duration)
    state = motion.at(t)
    found = [t, state.q, state.qd]
    if isinstance(motion, Trajectory) and isinstance(motion.path, MachinePath):
        found += [state.s, motion.path.pose_numbers(state.s, state.piece)]
    return found


@dataclass(frozen=True, slots=True)
class Grid:
    """Every setting on every task, rig variation and seed; equal runs are made once (`list_cells`).

    settings    as `settings_of` and `read_setting` make them
    tasks       names of tasks of the rig
    variations  of the rig's inertia and friction
    seeds       whole numbers, of what the host's timer draws
    Lists do as well as tuples. Raises MotionError for what is none of these.
    """

    settings: tuple[Setting, ...]
    tasks: tuple[str, ...]
    variations: tuple[Variation, ...] = VARIATIONS
    seeds: tuple[int, ...] = (0,)

    def __post_init__(self) -> None:
        for each in fields(self):
            if isinstance(given := getattr(self, each.name), list):
                object.__setattr__(self, each.name, tuple(given))
        check_fields(self)
        if any(seed < 0 for seed in self.seeds):
            raise MotionError(f"grid: seeds {list(self.seeds)} must be whole numbers from 0 on")

    def __iter__(self) -> Iterator[Cell]:
        return (
            Cell(setting, task, variation, seed)
            for setting in dict.fromkeys(self.settings)
            for task in dict.fromkeys(self.tasks)
            for variation in dict.fromkeys(self.variations)
            for seed in dict.fromkeys(self.seeds)
        )


def list_cells(grid: Grid, rig: Rig) -> list[Cell]:
    """List the runs of a grid on a rig, each once: of several that are equal only the first.

    A seed changes nothing where the law and the host draw nothing by chance. Friction that the rig
    does not have stays the same by any factor.
    """
    equal, random = find_equal_rigs(grid, rig), set(find_random_laws(grid, rig))
    first = grid.seeds[:1]
    return [
        cell
        for cell in grid
        if cell.variation.name not in equal and (cell.setting.law in random or cell.seed in first)
    ]


def find_equal_rigs(grid: Grid, rig: Rig) -> dict[str, str]:
    """Return the variations that do not change the rig, or change it as an earlier one does: name
    -> earlier name.
    """
    names: dict[str, str] = {}
    equal = {}
    for variation in dict.fromkeys(grid.variations):
        varied = disturb_rig(rig, inertia=variation.inertia, friction=variation.friction)
        earlier = names.setdefault(_hash(varied.drives), variation.name)
        if earlier != variation.name:
            equal[variation.name] = earlier
    return equal


def find_random_laws(grid: Grid, rig: Rig) -> list[str]:
    """List the laws whose runs depend on the seed: their host sleeps, and wakes at times drawn by
    chance.
    """
    laws = dict.fromkeys(setting.law for setting in grid.settings)
    return [law for law in laws if rig.host.draws(find_law(law).host)]


def score(cells: Sequence[Cell], rig: Rig) -> list[RunResult]:
    """The results of runs of one law on one task, in order.

    What a run raises of MotionError is its failure.
    """
    task, machine = rig.task(cells[0].task), rig.machine
    try:
        law = batch_law([cell.setting for cell in cells], rig)
        rigs = [_vary_rig(rig, cell) for cell in cells]
        runs = simulate(sample(task.motion, machine, task.dt), law, rigs)
        metrics = evaluate_runs(runs, task, rigs)
    except MotionError as error:
        if len(cells) == 1:
            return [RunResult(cells[0], failure=str(error))]
        # one run has stopped all: the halves tell which
        half = len(cells) // 2
        return [*score(cells[:half], rig), *score(cells[half:], rig)]
    share = runs.torque / torque_limits(rigs)
    every = max(1, round(BATCH_PERIOD / (runs.t[1] - runs.t[0])))
    read = machine.home_q + runs.measured[::every] * [axis.pulse for axis in machine.axes]
    return [
        _reduce_run(
            cell, of, sample_plan(task.motion, machine, of.t), read[:, lane], share[:, lane], every
        )
        for lane, (cell, of) in enumerate(zip(cells, metrics, strict=True))
    ]


def _vary_rig(rig: Rig, cell: Cell) -> Rig:
    """The rig of one run: its inertia and friction, and its host's seed."""
    varied = disturb_rig(rig, inertia=cell.variation.inertia, friction=cell.variation.friction)
    return replace(varied, host=replace(rig.host, seed=rig.host.seed + cell.seed))


def _reduce_run(
    cell: Cell, metrics: Metrics, planned: PlannedStates, read: Array, share: Array, every: int
) -> RunResult:
    """read (K, n): by the encoders; share (N, n): torque over its limit at all samples, of which
    the metrics see one in `every`.
    """
    figures = metrics.figures()
    if isnan(figures["contour_rms"]):
        return RunResult(cell, failure="the axes left the machine's reach, or its assembly mode")
    first = np.arange(len(metrics.t)) * every
    high, low = np.maximum.reduceat(share, first), np.minimum.reduceat(share, first)
    series = RunSeries(
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
    return RunResult(
        cell, {name: value for name, value in figures.items() if not isnan(value)}, series=series
    )


MIN_CLUSTER_BATCHES = 8
"""Fewer are done by processes of our own, of which there are none where there is little to do,
before a cluster of this computer has started.
"""
MAX_LANES = 64
"""Runs simulated at once: more gain little, and hold their whole course in memory."""


@check_arguments()
def sweep(
    grid: Grid,
    rig: Rig | str | PathLike[str],
    folder: str | PathLike[str],
    *,
    address: str | None = None,
    progress: Progress | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> SavedRuns:
    """Run a grid of settings and save the runs; saved runs are reused.

    A worker that dies costs its batch's time: others take it over.

    Parameters
    ----------
    grid
        Laws, gains, tasks and variations.
    rig
        As stated, by its name, or by the path of its file.
    folder
        That keeps the runs.
    address
        Of a Dask scheduler whose workers have this package. None: this computer's cores, through
        Dask where it is
        installed and there is much to do, else through processes of our own.
    progress
        Called with how many runs are done, and of how many.
    tell
        Called with where it is run.

    Returns
    -------
    SavedRuns
        Every run of the grid.

    Raises
    ------
    MotionError
        The rig does not have a task, nothing answers at the address, or, after all others are kept,
        no worker survived
        some runs.
    """
    rig, folder = load_rig(rig), Path(folder)
    facts = described(grid, rig)  # refuses what the rig has not, before there is a folder
    cells, digests, store = list_cells(grid, rig), Digests(rig), Store(folder)
    keys = [digest(cell, digests) for cell in cells]
    found = {key: store.find(key, cell) for key, cell in zip(keys, cells, strict=True)}
    key_of = dict(zip(cells, keys, strict=True))
    batches = list(_batches([cell for cell, key in key_of.items() if found[key] is None]))
    done = sum(result is not None for result in found.values())
    if progress is not None and cells:
        progress(done, len(found))

    def keep(_: object, results: list[RunResult]) -> None:
        nonlocal done
        for result in results:
            found[key_of[result.cell]] = result
            store.keep(key_of[result.cell], result)
        done += len(results)
        if progress is not None:
            progress(done, len(found))

    lost = _run(batches, rig, address, keep, tell)
    if lost:
        raise MotionError(
            f"sweep: {len(lost)} of {len(batches)} batches were lost, all others are kept: {lost[0]}"
        )
    made_with = {"python": python_version(), **digests.libraries}
    record = {"rig": rig.name, "sha256": digests.as_record(), **facts, "versions": made_with}
    store.record(record, keys)
    return load_runs(folder)


def _run(
    batches: Sequence[tuple[Cell, ...]],
    rig: Rig,
    address: str | None,
    keep: Callable[[object, list[RunResult]], None],
    tell: Callable[[str], None],
) -> list[LostTask]:
    """Run the batches here, in processes or on a cluster, and save the results.

    Return the batches a cluster lost.
    """
    lost: list[LostTask] = []
    if not batches:
        return lost
    bound = _explain_bound(rig)
    if bound and address is not None:
        raise MotionError(f"sweep: {bound}; leave out the address: then this process does the runs")
    if bound:
        tell(f"{bound}: this process does all runs")
    few = len(batches) < MIN_CLUSTER_BATCHES
    if address is None and (bound or few or not is_installed()):
        if len(batches) > 1 and not bound and not is_installed():
            tell(
                'Dask is not installed (extra "cluster"): the runs are spread over processes of this computer'
            )
        spread(partial(score, rig=rig), batches, keep)
        return lost
    for n, results in run_on_cluster(score, batches, rig, address, packages=PACKAGES):
        if isinstance(results, LostTask):
            lost.append(results)
        else:
            keep(batches[n], results)
    return lost


def _explain_bound(rig: Rig) -> str:
    """Say why a rig cannot leave this process; empty where it can."""
    try:
        pickle.dumps(rig)
    except Exception as error:  # pickle raises whatever an object's own code does
        return f"rig {rig.name} cannot be sent to other processes ({error})"
    return ""


def _batches(cells: Sequence[Cell]) -> Iterator[tuple[Cell, ...]]:
    """Runs of the same law, gains and task kinds, that are simulated at once."""
    groups: dict[Any, list[Cell]] = {}
    for cell in cells:
        groups.setdefault(
            (cell.setting.law, tuple(name for name, _ in cell.setting.gains), cell.task), []
        ).append(cell)
    for group in groups.values():
        for first in range(0, len(group), MAX_LANES):
            yield tuple(group[first : first + MAX_LANES])


def described(grid: Grid, rig: Rig) -> dict[str, Any]:
    """Return what a reader of the runs needs to know of the tasks, the rig and the grid.

    "equal_rigs" and "random_laws" say which runs stand for others, see `list_cells`. Raises
    MotionError for an unknown task.
    """
    cells = list_cells(grid, rig)
    return {
        "seeds": list(dict.fromkeys(cell.seed for cell in cells)),
        "variations": list(dict.fromkeys(cell.variation.name for cell in cells)),
        "equal_rigs": find_equal_rigs(grid, rig),
        "random_laws": find_random_laws(grid, rig),
        "tasks": {
            name: {
                "duration_s": float(task.motion.duration),
                "dt_s": task.dt,
                "unit": planned.unit,
                "space": planned.path is not None,
                "resolution": resolution(rig.machine, planned.unit),
                "corners": find_corners(task.motion, rig.machine),
            }
            for name in grid.tasks
            for task in [rig.task(name)]
            for planned in [sample_plan(task.motion, rig.machine, np.zeros(1))]
        },
        "axes": {axis.name: axis.unit for axis in rig.machine.axes},
        "pulses": {axis.name: axis.pulse for axis in rig.machine.axes},
        "drives": {
            axis.name: {"kind": type(drive).__name__.lower(), "encoder": reads_encoder(drive)}
            for axis, drive in zip(rig.machine.axes, rig.drives, strict=True)
        },
    }


def reads_encoder(drive: Servo | Stepper) -> bool:
    """Whether the host reads of a drive more than the pulses that it sent."""
    return not isinstance(drive, Stepper) or drive.encoder > 0


def resolution(machine: Machine, unit: str) -> float:
    """The smallest pulse as a distance in m or rad; that of a turning axis in space on the
    machine's own length.
    """
    length = machine.characteristic_length
    return min(axis.pulse * (1.0 if axis.unit == unit else length) for axis in machine.axes)


CORNER_ANGLE = 1e-3
"""rad: by less the direction of a path is not seen to change."""


def find_corners(motion: Any, machine: Machine) -> list[dict[str, float]]:
    """List the corners of a planned path: when the plan is there, and how far along the path.

    At a corner the path changes its direction, or the plan rests. The points of a spline and the
    ends of a blend are none, since the path is smooth there; a motion without a path has none.
    """
    if not isinstance(motion, Trajectory):
        return []
    after = np.flatnonzero(np.diff(motion.piece)) + 1
    if not len(after):
        return []
    planned = sample_plan(motion, machine, motion.knots[after])
    s, piece = motion.s[after], motion.piece[after]
    arriving, leaving = (directions(planned.curve, s, side) for side in (piece - 1, piece))
    turns = np.linalg.norm(leaving - arriving, axis=1) > CORNER_ANGLE
    rests = ~np.abs(motion.at(motion.knots[after]).qd).any(axis=1)
    corners = after[turns | rests]
    return [{"t_s": float(motion.knots[k]), "s_m": float(motion.s[k])} for k in corners]
