"""What one run of a sweep is made of, what it is remembered by, and finished runs on disk.

Each run is one file, named by the hash of what it depends on, there whole or not at all.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from hashlib import sha256
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from controllers.laws.law import AnyLaw
from controllers.laws.registry import LAWS, find_law
from controllers.rig import Rig
from kinematics.files.atomic_files import write_whole
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments, split_options
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Setting:
    """A law by its name, and values for all of its gains."""

    law: str
    gains: tuple[tuple[str, float], ...] = ()

    @property
    def text(self) -> str:
        """As `read_setting` reads it: "closed-position:gain=0.7"."""
        return self.law + "".join(
            f"{',' if n else ':'}{name}={value!r}" for n, (name, value) in enumerate(self.gains)
        )

    @property
    def label(self) -> str:
        """For tables and figures: "closed-position gain 0.7"."""
        return " ".join(
            [self.law, *(f"{name.replace('_', ' ')} {value:g}" for name, value in self.gains)]
        )

    def make_law(self, rig: Rig | None = None) -> AnyLaw:
        """The law itself; a law by model knows the axes of the rig, or those that it assumes where
        none is given.
        """
        return find_law(self.law, rig, **dict(self.gains))


@check_arguments()
def read_setting(text: str) -> Setting:
    """The setting of a text such as "closed-position", "6" or "6:gain=0.7"; gains not given have
    the law's defaults.

    Raises MotionError for an unknown law or gain, and for a value that the law refuses.
    """
    name, given = split_options(text, "law")
    values = {}
    for gain, value in given.items():
        try:
            values[gain] = float(finite_array(float(value), f"law {name}: {gain}", ()))
        except ValueError:
            raise MotionError(f'law {name}: {gain}: "{value}" is not a number') from None
    law = find_law(name, None, **values)
    return Setting(_full_name(name), tuple((gain, float(getattr(law, gain))) for gain in law.grid))


@check_arguments()
def settings_of(name: str) -> list[Setting]:
    """List all settings of a law over its gain grid for reports.

    Parameters
    ----------
    name
        Of the law, or its number.

    Returns
    -------
    list
        A Setting for each combination of the gains in the grid.

    Raises
    ------
    MotionError
        The name is unknown; the nearest is told.
    """
    grid = find_law(name).grid
    return [
        Setting(_full_name(name), tuple(zip(grid, values, strict=True)))
        for values in product(*grid.values())
    ]


def setting_columns(settings: Sequence[Setting]) -> tuple[Column, ...]:
    """The law of each setting, and a column for each gain that any of them has; None where a law
    has no such gain.
    """
    values = [dict(setting.gains) for setting in settings]
    names = dict.fromkeys(name for gains in values for name in gains)
    return (
        Column("law", [setting.law for setting in settings]),
        *(Column(name, [gains.get(name) for gains in values]) for name in names),
    )


def _full_name(name: str) -> str:
    return next(known[-1] for known in LAWS if name in known)


def batch_law(settings: Sequence[Setting], rig: Rig) -> AnyLaw:
    """One law whose gains are arrays (B, 1), of B settings of the same law; the rig as stated is
    what it knows of.
    """
    values = {
        gain: np.array([[dict(setting.gains)[gain]] for setting in settings])
        for gain, _ in settings[0].gains
    }
    return find_law(settings[0].law, rig, **values)


@dataclass(frozen=True, slots=True)
class Variation:
    """How a rig differs from what its file states: factors of the inertia and of all friction."""

    name: str
    inertia: float = 1.0
    friction: float = 1.0


NOMINAL = Variation("as stated")
VARIATIONS = (
    NOMINAL,
    Variation("inertia +30 %", inertia=1.3),
    Variation("inertia −30 %", inertia=0.7),
    Variation("friction +30 %", friction=1.3),
    Variation("friction −30 %", friction=0.7),
)
"""The rig as stated, and the rigs that gains must hold on too."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One run.

    seed: added to that of the rig's host, whose timing is drawn by chance where it sleeps.
    """

    setting: Setting
    task: str
    variation: Variation = NOMINAL
    seed: int = 0


class DamagedRun(MotionError):
    """What is no run of a sweep, or no longer."""


@dataclass(frozen=True, slots=True)
class RunSeries:
    """How a run went, at instants t (N,), s, evenly spaced, settling included.

    s                   (N,) place along the path that was planned for then
    planned, actual     (N, 3) m, or (N, n) axis positions where the motion has no path in space
    contour, tracking   (N,) the distances to the path and to the plan
    torque              (N, n) torque over its limit, of the largest magnitude until the next
                        instant
    reference, feedback (N, n) m or rad: where each axis should have been and what its encoder read;
    (N, 0) in runs
                        that were saved before these were kept
    """

    t: Array
    s: Array
    planned: Array
    actual: Array
    contour: Array
    tracking: Array
    torque: Array
    reference: Array
    feedback: Array

    def __post_init__(self) -> None:
        for one in fields(self):
            object.__setattr__(self, one.name, freeze_array(getattr(self, one.name)))

    @staticmethod
    def unpack(content: bytes) -> RunSeries | None:
        """Of a file that `RunResult.pack` made; None where the run has none."""
        with np.load(BytesIO(content), allow_pickle=False) as file:
            if FIRST_SERIES_FIELD not in file:
                return None
            none = np.empty((len(file[FIRST_SERIES_FIELD]), 0))
            names = [one.name for one in fields(RunSeries)]
            return RunSeries(
                *(file[name].astype(float) if name in file else none for name in names)
            )


FIRST_SERIES_FIELD = "t"


@dataclass(frozen=True, slots=True)
class RunResult:
    """A cell that was run.

    figures  by the names of `controllers.metrics.FIGURES`, SI; none of a run that failed
    failure  why there are none, empty where there are
    """

    cell: Cell
    figures: Mapping[str, float] = field(default_factory=dict)
    failure: str = ""
    series: RunSeries | None = None

    def pack(self) -> bytes:
        """As an .npz file: the record as JSON text, and the arrays in single precision."""
        arrays = (
            {}
            if self.series is None
            else {one.name: getattr(self.series, one.name) for one in fields(RunSeries)}
        )
        cell = asdict(self.cell)
        record = {
            "cell": cell,
            "figures": dict(self.figures),
            "failure": self.failure,
            "arrays": sorted(arrays),
        }
        buffer = BytesIO()
        np.savez_compressed(
            buffer,
            record=np.array(json.dumps(record, ensure_ascii=False)),
            **{name: array.astype(np.float32) for name, array in arrays.items()},
        )
        return buffer.getvalue()

    @staticmethod
    def unpack(content: bytes) -> RunResult:
        """What `pack` made, without the series.

        Raises DamagedRun for anything else, were it by a single bit.

        Every array is read, and so held against its checksum: what is damaged is found here, not by
        who uses it.
        """
        try:
            with np.load(BytesIO(content), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file}
            record = json.loads(str(arrays.pop("record")))
            if sorted(arrays) != record.get("arrays", sorted(arrays)):
                raise KeyError(f"arrays {', '.join(sorted(arrays))}")
            cell, setting = record["cell"], record["cell"]["setting"]
            gains = tuple((name, value) for name, value in setting["gains"])
            made = Cell(
                Setting(setting["law"], gains),
                cell["task"],
                Variation(**cell["variation"]),
                cell["seed"],
            )
            return RunResult(made, record["figures"], record["failure"])
        except Exception as error:  # of zipfile, zlib, struct, json or numpy: whatever a byte out of place leads to
            raise DamagedRun(f"no run can be read: {type(error).__name__}: {error}") from error


def figure_unit(figure: str, task: str, record: Mapping[str, Any]) -> str:
    """SI unit of a figure on a path of recorded runs; empty for shares, and where axes of two kinds
    have it.
    """
    from controllers.metrics import FIGURES

    name, _, axis = figure.partition(".")
    unit = next((one.unit for one in FIGURES if one.name == name), "")
    kinds = {record["axes"].get(axis)} if axis else set(record["axes"].values())
    own = kinds.pop() if len(kinds) == 1 else ""
    return (
        unit.replace("path", record["tasks"][task]["unit"])
        .replace("axis", own or "")
        .removeprefix("1")
    )


CELLS, RECORD, KIND = "cells", "runs.json", "pulsepath runs"
DIGESTS = "sha256_of_cells"
SEAL = "sha256_of_this"
"""Of all else in the record; older ones have none."""


class Store:
    """The folder of a sweep.

    Several sweeps may use it at once: what both run, both write, to the same content.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / CELLS).mkdir(parents=True, exist_ok=True)

    def find(self, key: str, cell: Cell | None = None) -> RunResult | None:
        """The run of a key, if it is kept whole; a file that cannot be read, or is of another cell,
        counts as none.
        """
        try:
            found = RunResult.unpack((self.folder / CELLS / f"{key}.npz").read_bytes())
        except (OSError, DamagedRun):
            return None
        return found if cell is None or found.cell == cell else None

    def keep(self, key: str, result: RunResult) -> None:
        """Write a run; its file takes its place when it is complete."""
        write_whole(self.folder / CELLS / f"{key}.npz", result.pack())

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
class SavedRuns(Result):
    """Saved runs that belong together, by the names of their files, and the record of how they were
    made.
    """

    saved_as: ClassVar[str] = "Runs"
    folder: Path
    record: Mapping[str, Any] = field(repr=False)
    results: Mapping[str, RunResult] = field(repr=False)

    @property
    def name(self) -> str:
        return self.folder.resolve().name

    def tables(self) -> tuple[Table, ...]:
        """A row for each run: its error to the path, and why it failed if it did;
        `benchmarks.reports.gain` ranks them.
        """
        return (
            self._table(("contour_rms", "contour_max", "tracking_rms", "end_time", "torque_peak")),
        )

    def data(self) -> Table:
        """A row for each run, with every figure of it."""
        return self._table(
            tuple(dict.fromkeys(name for one in self.results.values() for name in one.figures))
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The largest RMS contour error of each setting over its rigs and seeds, on paths of the
        first one's unit.
        """
        from kinematics.foundation.figure import draw_bars

        runs = [one for one in self.results.values() if one.figures]
        units = [figure_unit("contour_rms", one.cell.task, self.record) for one in runs]
        largest: dict[str, float] = {}
        for one, unit in zip(runs, units, strict=True):
            if unit == units[0]:
                name, error = (
                    f"{one.cell.setting.label}, {one.cell.task}",
                    one.figures["contour_rms"],
                )
                largest[name] = max(largest.get(name, 0.0), 1e6 * error)
        unit = units[0] if units else "m"
        return draw_bars(
            [*largest], [*largest.values()], f"largest RMS contour error (µ{unit})", ax
        )

    def _table(self, figures: Sequence[str]) -> Table:
        runs = [*self.results.values()]
        cells = [one.cell for one in runs]
        columns = (
            *setting_columns([cell.setting for cell in cells]),
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
        return Table(f"{count_noun(len(runs), 'run')} of {self.name}", columns)

    def series(self, key: str) -> RunSeries | None:
        """How a run went over time, read from its file; None of one that failed."""
        return RunSeries.unpack((self.folder / CELLS / f"{key}.npz").read_bytes())


def _seal(record: Mapping[str, Any]) -> str:
    plain = json.dumps({key: value for key, value in record.items() if key != SEAL}, sort_keys=True)
    return sha256(plain.encode()).hexdigest()


def load_runs(folder: Path) -> SavedRuns:
    """The runs of a folder that a sweep wrote.

    Raises MotionError where there are none, or a file is lost.
    """
    hint = "give a folder that a sweep wrote"
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError) as error:
        told = getattr(error, "strerror", None) or error
        raise MotionError(f"{folder} holds no saved runs ({RECORD}: {told}); {hint}") from None
    if not isinstance(record, dict) or record.get("kind") != KIND:
        raise MotionError(f"{folder / RECORD} is not a record of saved runs; {hint}")
    if not isinstance(record.get("cells"), list) or (
        SEAL in record and record[SEAL] != _seal(record)
    ):
        raise MotionError(f"{folder / RECORD} is damaged; run the sweep again, the runs are kept")
    store, results = Store(folder), {}
    for key in record["cells"]:
        found = store.find(key)
        if found is None:
            lost = folder / CELLS / f"{key}.npz"
            raise MotionError(
                f"{lost} is lost or damaged; run the sweep again, the others are kept"
            )
        if store.digest(key) != record.get(DIGESTS, {}).get(key, store.digest(key)):
            changed = folder / CELLS / f"{key}.npz"
            raise MotionError(
                f"{changed} is not the run that was recorded; remove it and run the sweep again"
            )
        results[key] = found
    return SavedRuns(folder, record, results)
