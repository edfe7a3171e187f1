"""Conditioning of a path: how near it comes to singular poses, at many places.

It serves warnings and the search of a remedy. That the path meets no singular pose is proved by
`planner.certificate.feasibility.find_singularity`.
"""

from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.taylor_model import Series
from planner.path.actuation import MachinePath
from planner.place import Place
from planner.trajectory import unit_speed_trajectory

POOR_CONDITIONING = 0.01
"""Conditioning below which a motion gets a warning: one direction moves the axes a hundredth of
what another does.
"""
# Sampled places of a part of a path, its ends among them.
PART_SHARES = np.linspace(0.0, 1.0, 9)


@dataclass(frozen=True, slots=True)
class Conditioning:
    """The poorest conditioning σ_min/σ_max of the Jacobian at sampled places of a path, and where.

    The columns of rotations are divided by the machine's characteristic length: 1 at best, 0 in a
    singular pose.
    """

    value: float
    place: Place

    @property
    def warning(self) -> str:
        """The warning of a poor conditioning, else ""."""
        if self.value >= POOR_CONDITIONING:
            return ""
        return (
            f"near a singular pose at {self.place}: conditioning {self.value:.2g}, below "
            f"{POOR_CONDITIONING:g}; small errors of the axes are large errors of the tool there, "
            "or small motions of the tool large ones of the axes"
        )


def find_poorest(path: MachinePath) -> Conditioning:
    """Return the poorest conditioning of a path that has no singular pose."""
    s, piece, jacobian = sample_jacobian(path)
    finite = np.where(np.isfinite(jacobian), jacobian, 0.0)
    singular = np.linalg.svd(finite, compute_uv=False)
    largest = singular[:, 0]
    ratio = singular[:, -1] / np.where(largest > 0, largest, 1.0)
    worst = int(ratio.argmin())
    return Conditioning(float(ratio[worst]), path.place(s[worst], piece[worst]))


def has_one_sign(path: MachinePath) -> bool:
    """Return whether the Jacobian's determinant has one sign at all sampled places.

    Otherwise a pose is singular.
    """
    *_, jacobian = sample_jacobian(path)
    sign, _ = np.linalg.slogdet(jacobian)
    return bool(abs(sign.sum()) == len(sign))


def sample_jacobian(path: MachinePath) -> tuple[Array, np.ndarray, Array]:
    """Return s (N,), piece (N,) and Jacobian (N, n, n) at many places of a path."""
    along = unit_speed_trajectory(path)
    part = np.repeat(np.arange(len(along.s)), len(PART_SHARES))
    width = np.diff(np.append(along.s, path.breaks[-1]))
    s = along.s[part] + np.tile(PART_SHARES, len(along.s)) * width[part]
    piece = along.piece[part]
    return s, piece, evaluate_jacobian(path, s, piece)


def evaluate_jacobian(
    path: MachinePath,
    s: Array,
    piece: np.ndarray,
) -> Array:
    """Return J (N, n, n) at s (N,) in pieces (N,).

    Columns of rotation are divided by the characteristic length.
    """
    with np.errstate(all="ignore"):  # beyond reach there are no numbers
        series = path.jacobian(Series.constant(s, 2), piece)
    return np.asarray(series.mid[0]).reshape(len(s), len(path.names), -1)
