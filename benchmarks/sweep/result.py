"""What a run is remembered by: its figures, and for some runs how it went over time."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from io import BytesIO

import numpy as np

from benchmarks.sweep.cell import Cell, Setting, Variation
from kinematics.array import Array, frozen


@dataclass(frozen=True, slots=True)
class Series:
    """How a run went, at instants t (N,), s, evenly spaced, settling included.

    s                   (N,) place along the path that was planned for then
    planned, actual     (N, 3) m, or (N, n) axis positions where the motion has no path in space
    contour, tracking   (N,) the distances to the path and to the plan
    torque              (N, n) torque over its limit, of the largest magnitude until the next instant
    """

    t: Array
    s: Array
    planned: Array
    actual: Array
    contour: Array
    tracking: Array
    torque: Array

    def __post_init__(self) -> None:
        for one in fields(self):
            object.__setattr__(self, one.name, frozen(getattr(self, one.name)))

    @staticmethod
    def unpacked(content: bytes) -> Series | None:
        """Of a file that `Result.packed` made; None where the run has none."""
        with np.load(BytesIO(content), allow_pickle=False) as file:
            names = [one.name for one in fields(Series)]
            return Series(*(file[name].astype(float) for name in names)) if names[0] in file else None


@dataclass(frozen=True, slots=True)
class Result:
    """A cell that was run.

    figures  by the names of `controllers.metrics.FIGURES`, SI; none of a run that failed
    failure  why there are none, empty where there are
    """

    cell: Cell
    figures: Mapping[str, float] = field(default_factory=dict)
    failure: str = ""
    series: Series | None = None

    def packed(self) -> bytes:
        """As an .npz file: the record as JSON text, and the arrays in single precision."""
        arrays = {} if self.series is None else {one.name: getattr(self.series, one.name) for one in fields(Series)}
        record = {"cell": asdict(self.cell), "figures": dict(self.figures), "failure": self.failure}
        buffer = BytesIO()
        np.savez_compressed(
            buffer,
            record=np.array(json.dumps(record, ensure_ascii=False)),
            **{name: array.astype(np.float32) for name, array in arrays.items()},
        )
        return buffer.getvalue()

    @staticmethod
    def unpacked(content: bytes) -> Result:
        """What `packed` made, without the series. Raises ValueError, KeyError or OSError for anything else."""
        with np.load(BytesIO(content), allow_pickle=False) as file:
            record = json.loads(str(file["record"]))
        cell, setting = record["cell"], record["cell"]["setting"]
        gains = tuple((name, value) for name, value in setting["gains"])
        made = Cell(Setting(setting["law"], gains), cell["task"], Variation(**cell["variation"]), cell["seed"])
        return Result(made, record["figures"], record["failure"])
