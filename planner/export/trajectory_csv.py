"""A trajectory as a table: one row per instant, for spreadsheets and plots; the exact pieces are in motion.json.

Columns are time, distance along the path, the pose of the platform in the base frame (rx, ry, rz about the moving axes
in turn), and position (natural coordinate), speed, acceleration and jerk of every axis. SI units, as the header says.
"""

import csv
from math import ceil
from pathlib import Path

import numpy as np

from kinematics.array import Array
from kinematics.pose import from_numbers
from planner.plan import Plan

PERIOD = 1e-3
"""s from row to row; the last row is the end of the motion."""
BLOCK = 1 << 13
"""Rows computed and written together, so that memory stays bounded."""


def write(plan: Plan, path: Path) -> None:
    """Write the table: 12 significant digits, line ends \\n, decimal points whatever the locale."""
    rows = ceil(plan.trajectory.duration / PERIOD) + 1
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(_header(plan))
        for first in range(0, rows, BLOCK):
            t = np.minimum(np.arange(first, min(first + BLOCK, rows)) * PERIOD, plan.trajectory.duration)
            np.savetxt(file, _rows(plan, t), fmt="%.12g", delimiter=",")


def _header(plan: Plan) -> list[str]:
    place = ["t [s]", "s [m]", *(f"{name} [m]" for name in "xyz"), *(f"r{name} [rad]" for name in "xyz")]
    quantities = {"q": "", "qd": "/s", "qdd": "/s^2", "qddd": "/s^3"}
    return place + [
        f"{axis.name} {q} [{axis.unit}{per}]" for axis in plan.machine.axes for q, per in quantities.items()
    ]


def _rows(plan: Plan, t: Array) -> Array:
    state = plan.trajectory.at(t)
    pose = from_numbers(plan.path.pose_numbers(state.s, state.piece))
    angles = pose.rotation.as_euler("XYZ", suppress_warnings=True)
    axes = np.stack([state.q, state.qd, state.qdd, state.qddd], 2).reshape(len(t), -1)
    return np.column_stack([t, state.s, pose.translation, angles, axes]) + 0.0  # no row shows −0
