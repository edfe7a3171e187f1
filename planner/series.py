"""A motion as a series over time: distance, pose and the axes with their derivatives, row by row."""

from math import ceil, log10

import numpy as np

from kinematics.array import Array
from kinematics.pose import from_numbers
from planner.actuation import ActuatorPath, MachinePath
from planner.trajectory import Trajectory

PERIOD = 1e-3
"""s from row to row; the last row is the end of the motion."""
MOST_ROWS = 1_000_000
"""Beyond which rows are ten times as far apart, or a hundred times, and so on."""
QUANTITIES = {"q": "", "qd": "/s", "qdd": "/s^2", "qddd": "/s^3"}


def headings(path: ActuatorPath) -> list[tuple[str, str]]:
    """Name and SI unit of each column; of a motion without a machine nothing has a unit but time."""
    units = axis_units(path)
    place = [("t", "s"), ("s", "")]
    if isinstance(path, MachinePath):
        place = [("t", "s"), ("s", "m"), *((name, "m") for name in "xyz"), *((f"r{name}", "rad") for name in "xyz")]
    return place + [
        (f"{name} {q}", f"{unit}{per}" if unit else "")
        for name, unit in zip(path.names, units, strict=True)
        for q, per in QUANTITIES.items()
    ]


def axis_units(path: ActuatorPath) -> tuple[str, ...]:
    """m or rad of each axis, "" without a machine."""
    if isinstance(path, MachinePath):
        return tuple(axis.unit for axis in path.machine.axes)
    return ("",) * len(path.names)


def period(duration: float) -> float:
    """s from row to row: PERIOD, or more of a motion that takes more than MOST_ROWS of it."""
    return PERIOD * 10.0 ** max(0, ceil(log10(duration / PERIOD / MOST_ROWS))) if duration > 0 else PERIOD


def instants(trajectory: Trajectory) -> Array:
    """(N,) s, every `period` and the end."""
    step = period(trajectory.duration)
    rows = ceil(trajectory.duration / step) + 1
    return np.asarray(np.minimum(np.arange(rows) * step, trajectory.duration), float)


def rows(trajectory: Trajectory, t: Array) -> Array:
    """(N, columns) at t (N,), rx, ry, rz about the moving axes in turn."""
    state = trajectory.at(t)
    columns = [t, state.s]
    pose = trajectory.path.pose_numbers(state.s, state.piece) if isinstance(trajectory.path, MachinePath) else None
    if pose is not None:
        poses = from_numbers(pose)
        columns += [poses.translation, poses.rotation.as_euler("XYZ", suppress_warnings=True)]
    axes = np.stack([state.q, state.qd, state.qdd, state.qddd], 2).reshape(len(t), -1)
    return np.asarray(np.column_stack([*columns, axes]) + 0.0)  # no row shows −0
