"""What a run is remembered by: its figures, and for some runs how it went over time.

The SI unit of a figure of recorded runs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from io import BytesIO
from typing import Any

import numpy as np

from benchmarks.sweep.cell import Cell, Setting, Variation
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError


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
