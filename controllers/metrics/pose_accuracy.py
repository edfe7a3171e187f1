"""ISO-style pose accuracy and repeatability: where the machine comes to rest, time after time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class PoseAccuracy(Result):
    """AP and RP of n arrivals in one commanded pose, in the style of ISO 9283; a simulation certifies nothing.

    accuracy       AP = ‖x̄ − x_c‖, m
    repeatability  RP = l̄ + 3 S_l, l_j = ‖x_j − x̄‖, S with n − 1, m
    turn, turn_band  (3,) rad: ᾱ − α_c and 3 S_α about x, y, z of the commanded frame; None where not known
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

    def plot(self, ax: Axes | None = None) -> Axes:
        """Accuracy and repeatability."""
        from kinematics.bars import bars

        figures = [1e6 * self.accuracy, 1e6 * self.repeatability]
        return bars(["accuracy", "repeatability"], figures, "ISO-style pose accuracy (µm)", ax)


def figures_table(title: str, figures: Mapping[str, float]) -> Table:
    """Figures in m or, of angles, in rad; those that are not known are left out."""
    known = {name: value for name, value in figures.items() if np.isfinite(value)}
    units = ["m" if name.endswith(("accuracy", "repeatability")) else "rad" for name in known]
    columns = (Column("figure", [*known]), Column("value", [*known.values()], units, "micro", ".3f"))
    return Table(title, columns)


def pose_accuracy(points: Array, commanded: Array, turned: Array | None = None) -> PoseAccuracy:
    """From attained points (n, 3), m, and the commanded one (3,).

    turned  (n, 3) rad, rotation vectors log(R_cᵀ R) of the attained orientations against the commanded one, or None

    Raises MotionError for fewer than two arrivals, which have no scatter.
    """
    if len(points) < 2:
        raise MotionError(
            f"pose repeatability: {len(points)} arrival has no scatter; run at least 2 (the standard has 30)"
        )
    accuracy = float(np.linalg.norm(points.mean(0) - commanded))
    if turned is None:
        return PoseAccuracy(len(points), accuracy, spread(points))
    turn, band = frozen(turned.mean(0)), frozen(3 * turned.std(0, ddof=1))
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
        figures |= {f"{what}_{kind}_r{axis}": float(value) for axis, value in zip("xyz", largest, strict=True)}
    return figures
