"""A trajectory as a table: one row per instant, for spreadsheets and plots; the exact pieces are in motion.json.

Columns are time, distance along the path, the pose of the platform in the base frame (rx, ry, rz about the moving axes
in turn), and position (natural coordinate), speed, acceleration and jerk of every axis. SI units, as the header says.
"""

import csv
from pathlib import Path

import numpy as np

from planner.series import headings, instants, rows
from planner.trajectory import Trajectory

BLOCK = 1 << 13
"""Rows computed and written together, so that memory stays bounded."""


def write(trajectory: Trajectory, path: Path) -> None:
    """Write the table: 12 significant digits, line ends \\n, decimal points whatever the locale."""
    t = instants(trajectory)
    header = [f"{name} [{unit}]" if unit else name for name, unit in headings(trajectory.path)]
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(header)
        for first in range(0, len(t), BLOCK):
            np.savetxt(file, rows(trajectory, t[first : first + BLOCK]), fmt="%.12g", delimiter=",")
