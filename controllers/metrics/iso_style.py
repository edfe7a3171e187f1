"""ISO-style accuracy and repeatability of a batch of cycles of one task: along its path, and of
poses at rest.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table


@dataclass(frozen=True, slots=True)
class PoseAccuracy(Result):
    """AP and RP of n arrivals in one commanded pose, in the style of ISO 9283; a simulation
    certifies nothing.

    accuracy       AP = ‖x̄ − x_c‖, m
    repeatability  RP = l̄ + 3 S_l, l_j = ‖x_j − x̄‖, S with n − 1, m
    turn, turn_band  (3,) rad: ᾱ − α_c and 3 S_α about x, y, z of the commanded frame; None where
                     not known
    """

    cycles: int
    accuracy: float
    repeatability: float
    turn: Array | None = None
    turn_band: Array | None = None

    def figures(self) -> dict[str, float]:
        """AP and RP in m, and of the three angles in rad, nan where not known."""
        return {
            "pose_accuracy": self.accuracy,
            "pose_repeatability": self.repeatability,
            **angle_figures("pose", self.turn, self.turn_band),
        }

    def tables(self) -> tuple[Table, ...]:
        """The figures that are known."""
        return (figures_table(f"ISO-style, {self.cycles} arrivals", self.figures()),)


def figures_table(title: str, figures: Mapping[str, float]) -> Table:
    """Figures in m or, of angles, in rad; those that are not known are left out."""
    known = {name: value for name, value in figures.items() if np.isfinite(value)}
    units = ["m" if name.endswith(("accuracy", "repeatability")) else "rad" for name in known]
    columns = (
        Column("figure", [*known]),
        Column("value", [*known.values()], units, "micro", ".3f"),
    )
    return Table(title, columns)


def pose_accuracy(points: Array, commanded: Array, turned: Array | None = None) -> PoseAccuracy:
    """From attained points (n, 3), m, and the commanded one (3,).

    turned  (n, 3) rad, rotation vectors log(R_cᵀ R) of the attained orientations against the
            commanded one, or None

    Raises MotionError for fewer than two arrivals, which have no scatter.
    """
    if len(points) < 2:
        raise MotionError(
            f"pose repeatability: {len(points)} arrival has no scatter; run at least 2 (the standard has 30)"
        )
    accuracy = float(np.linalg.norm(points.mean(0) - commanded))
    if turned is None:
        return PoseAccuracy(len(points), accuracy, spread(points))
    turn, band = freeze_array(turned.mean(0)), freeze_array(3 * turned.std(0, ddof=1))
    return PoseAccuracy(len(points), accuracy, spread(points), turn, band)


def spread(points: Array) -> float:
    """l̄ + 3 S_l of points (n, 3): l_j = ‖x_j − x̄‖ and S² = Σ (l_j − l̄)²/(n − 1)."""
    away = np.linalg.norm(points - points.mean(0), axis=1)
    return float(away.mean() + 3 * away.std(ddof=1))


def angle_figures(what: str, turn: Array | None, band: Array | None) -> dict[str, float]:
    """Accuracy and repeatability (…, 3) of the three angles, the largest of all stations, rad."""
    figures: dict[str, float] = {}
    for kind, values in (("accuracy", turn), ("repeatability", band)):
        largest = np.full(3, np.nan) if values is None else np.abs(values).reshape(-1, 3).max(0)
        figures |= {
            f"{what}_{kind}_r{axis}": float(value)
            for axis, value in zip("xyz", largest, strict=True)
        }
    return figures


@dataclass(frozen=True, slots=True)
class PathAccuracy(Result):
    """AT and RT of n cycles at m stations, in the style of ISO 9283; a simulation certifies
    nothing.

    offset  (m,) m, ‖x̄ᵢ − x_cᵢ‖;  band (m,) m, l̄ᵢ + 3 S_lᵢ
    turn, turn_band  (m, 3) rad, ᾱᵢ − α_cᵢ and 3 S_αᵢ about x, y, z of the commanded frame; None
                     where not known
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

    def tables(self) -> tuple[Table, ...]:
        """The figures that are known."""
        title = f"ISO-style, {count_noun(self.cycles, 'cycle')}, {count_noun(len(self.offset), 'station')}"
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
    """From attained paths (N, n, 3), m, of n cycles, and their rotations (N, n, 3, 3) where the
    stations have theirs.

    x_ij is the point where cycle j passes the plane normal to the commanded path at station i,
    going forward; of several the nearest to the station; linear between the samples. Angles are
    those of the rotation vector log(R_cᵢᵀ R_ij).

    Raises MotionError for fewer than two cycles, which have no scatter, and for a path that misses
    a station's plane.
    """
    cycles = paths.shape[1]
    if cycles < 2:
        raise MotionError(
            f"path repeatability: {cycles} cycle has no scatter; run at least 2 (the standard has 10)"
        )
    x, turned = [], []
    for i in range(len(stations.points)):
        index, share = _find_crossing(paths, stations, i)
        x.append(_interpolate(paths, index, share))
        if rotations is not None and stations.rotations is not None:
            near = slice(index.min(), index.max() + 2)
            turned.append(
                _interpolate(
                    _vectors(stations.rotations[i], rotations[near]), index - near.start, share
                )
            )
    return PathAccuracy(
        cycles,
        freeze_array(
            [
                np.linalg.norm(of.mean(0) - station)
                for of, station in zip(x, stations.points, strict=True)
            ]
        ),
        freeze_array([spread(of) for of in x]),
        freeze_array([of.mean(0) for of in turned]) if turned else None,
        freeze_array([3 * of.std(0, ddof=1) for of in turned]) if turned else None,
    )


def _vectors(commanded: Array, rotations: Array) -> Array:
    turns = commanded.T @ rotations
    return Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(*turns.shape[:-2], 3)


def _find_crossing(paths: Array, stations: Stations, i: int) -> tuple[np.ndarray, Array]:
    """Sample (n,) before the plane of station i, and share of the way to the next, of each
    cycle.
    """
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


def _interpolate(values: Array, index: np.ndarray, share: Array) -> Array:
    """(n, 3) of values (N, n, 3) between samples."""
    lane = np.arange(values.shape[1])
    before, after = values[index, lane], values[index + 1, lane]
    return np.asarray(before + share[:, None] * (after - before))
