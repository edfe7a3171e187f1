"""ISO-style path accuracy and repeatability: where the attained paths pass the stations of the commanded one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from controllers.metrics.pose_accuracy import angle_figures, figures_table, spread
from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class PathAccuracy(Result):
    """AT and RT of n cycles at m stations, in the style of ISO 9283; a simulation certifies nothing.

    offset  (m,) m, ‖x̄ᵢ − x_cᵢ‖;  band (m,) m, l̄ᵢ + 3 S_lᵢ
    turn, turn_band  (m, 3) rad, ᾱᵢ − α_cᵢ and 3 S_αᵢ about x, y, z of the commanded frame; None where not known
    """

    cycles: int
    offset: Array
    band: Array
    turn: Array | None = None
    turn_band: Array | None = None

    @property
    def at_p(self) -> float:
        """AT_p = maxᵢ ‖x̄ᵢ − x_cᵢ‖, m."""
        return float(self.offset.max())

    @property
    def rt_p(self) -> float:
        """RT_p = maxᵢ (l̄ᵢ + 3 S_lᵢ), l_ij = ‖x_ij − x̄ᵢ‖, m."""
        return float(self.band.max())

    def figures(self) -> dict[str, float]:
        """AT_p, RT_p in m; AT and RT of the three angles in rad, nan where not known."""
        return {
            "path_accuracy": self.at_p,
            "path_repeatability": self.rt_p,
            **angle_figures("path", self.turn, self.turn_band),
        }

    def plot(self, ax: Axes | None = None) -> Axes:
        """Accuracy and repeatability station by station."""
        from controllers.plots import path_accuracy

        return path_accuracy(self, ax)

    def tables(self) -> tuple[Table, ...]:
        """The figures that are known."""
        title = f"ISO-style, {self.cycles} cycles, {len(self.offset)} stations"
        return (figures_table(title, self.figures()),)

    def data(self) -> Table:
        """Offset and repeatability station by station."""
        columns = (
            Column("station", range(1, len(self.offset) + 1)),
            Column("accuracy", self.offset, "m"),
            Column("repeatability", self.band, "m"),
        )
        return Table("ISO-style path accuracy", columns)


@dataclass(frozen=True, slots=True)
class Stations:
    """m places of a commanded path: points (m, 3), m, unit tangents (m, 3), rotations (m, 3, 3)."""

    points: Array
    tangents: Array
    rotations: Array | None = None


def path_accuracy(paths: Array, stations: Stations, rotations: Array | None = None) -> PathAccuracy:
    """From attained paths (N, n, 3), m, of n cycles, and their rotations (N, n, 3, 3) where the stations have theirs.

    x_ij is the point where cycle j passes the plane normal to the commanded path at station i, going forward; of
    several the nearest to the station; linear between the samples. Angles are those of the rotation vector
    log(R_cᵢᵀ R_ij).

    Raises MotionError for fewer than two cycles, which have no scatter, and for a path that misses a station's plane.
    """
    cycles = paths.shape[1]
    if cycles < 2:
        raise MotionError(f"path repeatability: {cycles} cycle has no scatter; run at least 2 (the standard has 10)")
    x, turned = [], []
    for i in range(len(stations.points)):
        index, share = _crossing(paths, stations, i)
        x.append(_between(paths, index, share))
        if rotations is not None and stations.rotations is not None:
            near = slice(index.min(), index.max() + 2)
            turned.append(_between(_vectors(stations.rotations[i], rotations[near]), index - near.start, share))
    return PathAccuracy(
        cycles,
        frozen([np.linalg.norm(of.mean(0) - station) for of, station in zip(x, stations.points, strict=True)]),
        frozen([spread(of) for of in x]),
        frozen([of.mean(0) for of in turned]) if turned else None,
        frozen([3 * of.std(0, ddof=1) for of in turned]) if turned else None,
    )


def _vectors(commanded: Array, rotations: Array) -> Array:
    turns = commanded.T @ rotations
    return Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(*turns.shape[:-2], 3)


def _crossing(paths: Array, stations: Stations, i: int) -> tuple[np.ndarray, Array]:
    """Sample (n,) before the plane of station i, and share of the way to the next, of each cycle."""
    station = stations.points[i]
    ahead = (paths - station) @ stations.tangents[i]
    passing = (ahead[:-1] < 0) & (ahead[1:] >= 0)
    missed = ~passing.any(0)
    if missed.any():
        raise MotionError(
            f"path accuracy: cycle {int(np.argmax(missed)) + 1} does not pass station {i + 1} at "
            f"{station * 1e3} mm; leave out the ends of the path, which no cycle passes"
        )
    away = np.where(passing, np.linalg.norm(paths[:-1] - station, axis=2), np.inf)
    index = np.argmin(away, axis=0)
    lane = np.arange(paths.shape[1])
    before, after = ahead[index, lane], ahead[index + 1, lane]
    return index, before / (before - after)


def _between(values: Array, index: np.ndarray, share: Array) -> Array:
    """(n, 3) of values (N, n, 3) between samples."""
    lane = np.arange(values.shape[1])
    before, after = values[index, lane], values[index + 1, lane]
    return np.asarray(before + share[:, None] * (after - before))
