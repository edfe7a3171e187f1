"""What one run of a sweep is made of, and what it is remembered by: figures, of some its course too."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from io import BytesIO
from itertools import product
from typing import Any

import numpy as np

from controllers.laws.law import Law
from controllers.laws.registry import LAWS, find_law
from controllers.rig import Rig
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from planner.options import split_options


@dataclass(frozen=True, slots=True)
class Setting:
    """A law by its name, and values for all of its gains."""

    law: str
    gains: tuple[tuple[str, float], ...] = ()

    @property
    def text(self) -> str:
        """As `read_setting` reads it: "closed-position:gain=0.7"."""
        return self.law + "".join(f"{',' if n else ':'}{name}={value!r}" for n, (name, value) in enumerate(self.gains))

    @property
    def label(self) -> str:
        """For tables and figures: "closed-position gain 0.7"."""
        return " ".join([self.law, *(f"{name.replace('_', ' ')} {value:g}" for name, value in self.gains)])

    def made(self, rig: Rig | None = None) -> Law:
        """The law itself; a law by model knows the axes of the rig, or those that it assumes where none is given."""
        return find_law(self.law, rig, **dict(self.gains))


def read_setting(text: str) -> Setting:
    """The setting of "closed-position", "6" or "6:gain=0.7"; a gain that is not given has the law's own value.

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


def settings_of(name: str) -> list[Setting]:
    """A law over the grid of gains that it states for reports."""
    grid = find_law(name).grid
    return [Setting(_full_name(name), tuple(zip(grid, values, strict=True))) for values in product(*grid.values())]


def _full_name(name: str) -> str:
    return next(known[-1] for known in LAWS if name in known)


def batch_law(settings: Sequence[Setting], rig: Rig) -> Law:
    """One law whose gains are arrays (B, 1), of B settings of the same law; the rig as stated is what it knows of."""
    values = {gain: np.array([[dict(setting.gains)[gain]] for setting in settings]) for gain, _ in settings[0].gains}
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
    """One run. seed: added to that of the rig's host, whose timing is drawn by chance where it sleeps."""

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
    torque              (N, n) torque over its limit, of the largest magnitude until the next instant
    reference, feedback (N, n) m or rad: where each axis should have been and what its encoder read; (N, 0) in runs
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
    def unpacked(content: bytes) -> RunSeries | None:
        """Of a file that `RunResult.packed` made; None where the run has none."""
        with np.load(BytesIO(content), allow_pickle=False) as file:
            if FIRST_SERIES_FIELD not in file:
                return None
            none = np.empty((len(file[FIRST_SERIES_FIELD]), 0))
            names = [one.name for one in fields(RunSeries)]
            return RunSeries(*(file[name].astype(float) if name in file else none for name in names))


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

    def packed(self) -> bytes:
        """As an .npz file: the record as JSON text, and the arrays in single precision."""
        arrays = {} if self.series is None else {one.name: getattr(self.series, one.name) for one in fields(RunSeries)}
        cell = asdict(self.cell)
        record = {"cell": cell, "figures": dict(self.figures), "failure": self.failure, "arrays": sorted(arrays)}
        buffer = BytesIO()
        np.savez_compressed(
            buffer,
            record=np.array(json.dumps(record, ensure_ascii=False)),
            **{name: array.astype(np.float32) for name, array in arrays.items()},
        )
        return buffer.getvalue()

    @staticmethod
    def unpacked(content: bytes) -> RunResult:
        """What `packed` made, without the series. Raises Damaged for anything else, were it by a single bit.

        Every array is read, and so held against its checksum: what is damaged is found here, not by who uses it.
        """
        try:
            with np.load(BytesIO(content), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file}
            record = json.loads(str(arrays.pop("record")))
            if sorted(arrays) != record.get("arrays", sorted(arrays)):
                raise KeyError(f"arrays {', '.join(sorted(arrays))}")
            cell, setting = record["cell"], record["cell"]["setting"]
            gains = tuple((name, value) for name, value in setting["gains"])
            made = Cell(Setting(setting["law"], gains), cell["task"], Variation(**cell["variation"]), cell["seed"])
            return RunResult(made, record["figures"], record["failure"])
        except Exception as error:  # of zipfile, zlib, struct, json or numpy: whatever a byte out of place leads to
            raise DamagedRun(f"no run can be read: {type(error).__name__}: {error}") from error


def figure_unit(figure: str, task: str, record: Mapping[str, Any]) -> str:
    """SI unit of a figure on a path of recorded runs; empty for shares, and where axes of two kinds have it."""
    from controllers.metrics import FIGURES

    name, _, axis = figure.partition(".")
    unit = next((one.unit for one in FIGURES if one.name == name), "")
    kinds = {record["axes"].get(axis)} if axis else set(record["axes"].values())
    own = kinds.pop() if len(kinds) == 1 else ""
    return unit.replace("path", record["tasks"][task]["unit"]).replace("axis", own or "").removeprefix("1")
