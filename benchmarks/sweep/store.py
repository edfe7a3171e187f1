"""Finished runs on disk: one file each, named by the hash of what it depends on, there whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.sweep.result import Cell, DamagedRun, RunResult, RunSeries, figure_unit
from kinematics.files.atomic_files import write_whole
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result as Shown
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CELLS, RECORD, KIND = "cells", "runs.json", "pulsepath runs"
DIGESTS = "sha256_of_cells"
SEAL = "sha256_of_this"
"""Of all else in the record; older ones have none."""


class Store:
    """The folder of a sweep. Several sweeps may use it at once: what both run, both write, to the same content."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / CELLS).mkdir(parents=True, exist_ok=True)

    def find(self, key: str, cell: Cell | None = None) -> RunResult | None:
        """The run of a key, if it is kept whole; a file that cannot be read, or is of another cell, counts as none."""
        try:
            found = RunResult.unpacked((self.folder / CELLS / f"{key}.npz").read_bytes())
        except (OSError, DamagedRun):
            return None
        return found if cell is None or found.cell == cell else None

    def keep(self, key: str, result: RunResult) -> None:
        """Write a run; its file takes its place when it is complete."""
        write_whole(self.folder / CELLS / f"{key}.npz", result.packed())

    def digest(self, key: str) -> str | None:
        """SHA-256 of the file of a run; None where there is none."""
        try:
            return sha256((self.folder / CELLS / f"{key}.npz").read_bytes()).hexdigest()
        except OSError:
            return None

    def record(self, record: Mapping[str, Any], keys: Sequence[str]) -> None:
        """Write down which runs belong together, and what they were made with."""
        digests = {key: self.digest(key) for key in keys}
        whole = {"schema": 1, "kind": KIND, **record, "cells": list(keys), DIGESTS: digests}
        text = json.dumps({**whole, SEAL: _seal(whole)}, indent=2, ensure_ascii=False)
        write_whole(self.folder / RECORD, text + "\n")


@dataclass(frozen=True, slots=True)
class SavedRuns(Shown):
    """Saved runs that belong together, by the names of their files, and the record of how they were made."""

    folder: Path
    record: Mapping[str, Any] = field(repr=False)
    results: Mapping[str, RunResult] = field(repr=False)

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    def tables(self) -> tuple[Table, ...]:
        """A row for each run: its error to the path, and why it failed if it did; `benchmarks.reports.gain` ranks
        them."""
        return (self._table(("contour_rms", "contour_max", "tracking_rms", "end_time", "torque_peak")),)

    def data(self) -> Table:
        """A row for each run, with every figure of it."""
        return self._table(tuple(dict.fromkeys(name for one in self.results.values() for name in one.figures)))

    def plot(self, ax: Axes | None = None) -> Axes:
        """The largest RMS contour error of each setting over its rigs and seeds, on paths of the first one's unit."""
        from kinematics.foundation.figure import draw_bars

        runs = [one for one in self.results.values() if one.figures]
        units = [figure_unit("contour_rms", one.cell.task, self.record) for one in runs]
        largest: dict[str, float] = {}
        for one, unit in zip(runs, units, strict=True):
            if unit == units[0]:
                name, error = f"{one.cell.setting.label}, {one.cell.task}", one.figures["contour_rms"]
                largest[name] = max(largest.get(name, 0.0), 1e6 * error)
        unit = units[0] if units else "m"
        return draw_bars([*largest], [*largest.values()], f"largest RMS contour error (µ{unit})", ax)

    def _table(self, figures: Sequence[str]) -> Table:
        runs = [*self.results.values()]
        cells = [one.cell for one in runs]
        columns = (
            Column("setting", [cell.setting.text for cell in cells]),
            Column("path", [cell.task for cell in cells]),
            Column("rig", [cell.variation.name for cell in cells]),
            Column("seed", [cell.seed for cell in cells]),
            *(
                Column(
                    name,
                    [one.figures.get(name) for one in runs],
                    [figure_unit(name, cell.task, self.record) for cell in cells],
                    "human",
                )
                for name in figures
            ),
            Column("failure", [one.failure for one in runs]),
        )
        return Table(f"{len(runs)} runs of {self.name}", columns)

    def series(self, key: str) -> RunSeries | None:
        """How a run went over time, read from its file; None of one that failed."""
        return RunSeries.unpacked((self.folder / CELLS / f"{key}.npz").read_bytes())


def _seal(record: Mapping[str, Any]) -> str:
    plain = json.dumps({key: value for key, value in record.items() if key != SEAL}, sort_keys=True)
    return sha256(plain.encode()).hexdigest()


def load_runs(folder: Path) -> SavedRuns:
    """The runs of a folder that a sweep wrote. Raises MotionError where there are none, or a file is lost."""
    hint = "give a folder that a sweep wrote"
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError) as error:
        told = getattr(error, "strerror", None) or error
        raise MotionError(f"{folder} holds no saved runs ({RECORD}: {told}); {hint}") from None
    if not isinstance(record, dict) or record.get("kind") != KIND:
        raise MotionError(f"{folder / RECORD} is no record of saved runs; {hint}")
    if not isinstance(record.get("cells"), list) or (SEAL in record and record[SEAL] != _seal(record)):
        raise MotionError(f"{folder / RECORD} is damaged; run the sweep again, the runs are kept")
    store, results = Store(folder), {}
    for key in record["cells"]:
        found = store.find(key)
        if found is None:
            lost = folder / CELLS / f"{key}.npz"
            raise MotionError(f"{lost} is lost or damaged; run the sweep again, the others are kept")
        if store.digest(key) != record.get(DIGESTS, {}).get(key, store.digest(key)):
            changed = folder / CELLS / f"{key}.npz"
            raise MotionError(f"{changed} is not the run that was recorded; remove it and run the sweep again")
        results[key] = found
    return SavedRuns(folder, record, results)
