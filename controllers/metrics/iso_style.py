"""The ISO-style figures of a batch of cycles of one task: of its path, of its end, and of its speed.

ISO-style accuracy, repeatability and fluctuation of the speed along a path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from controllers.curve import directions, piece_of
from controllers.metrics.evaluate import attained_poses, sample_plan
from controllers.metrics.pose_and_path_accuracy import (
    PathAccuracy,
    PoseAccuracy,
    Stations,
    path_accuracy,
    pose_accuracy,
)
from controllers.rig import Rig, Task
from controllers.simulate import Runs
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class VelocityAccuracy(Result):
    """AV, RV, FV of n cycles at one commanded speed, in the style of ISO 9283; a simulation certifies nothing.

    commanded      v_c, m/s
    accuracy       AV = 100 (v̄ − v_c)/v_c, %, v̄ the mean over the cycles of their mean speeds v̄_j
    repeatability  RV = 100 · 3 S_v/v_c, %, S_v of the v̄_j with n − 1
    fluctuation    FV = max over the cycles of (max v − min v), m/s
    """

    cycles: int
    commanded: float
    accuracy: float
    repeatability: float
    fluctuation: float

    def figures(self) -> dict[str, float]:
        """AV and RV in %, FV in m/s."""
        return {
            "velocity_accuracy": self.accuracy,
            "velocity_repeatability": self.repeatability,
            "velocity_fluctuation": self.fluctuation,
        }

    def tables(self) -> tuple[Table, ...]:
        """Accuracy, repeatability and fluctuation."""
        columns = (
            Column("figure", ["accuracy", "repeatability", "fluctuation"]),
            Column(
                "value",
                [self.accuracy, self.repeatability, self.fluctuation],
                ["%", "%", "m/s"],
                "human",
                ".4f",
            ),
        )
        return (Table(f"ISO-style, {self.cycles} cycles at {1e3 * self.commanded:.6g} mm/s", columns),)

    def plot(self, ax: Axes | None = None) -> Axes:
        """All three as shares of the commanded speed."""
        from kinematics.foundation.figure import draw_bars

        shares = [self.accuracy, self.repeatability, 100 * self.fluctuation / self.commanded]
        return draw_bars(["accuracy", "repeatability", "fluctuation"], shares, "% of the commanded speed", ax)


def velocity_accuracy(speeds: Array, commanded: float) -> VelocityAccuracy:
    """From attained speeds (N, n), m/s, of n cycles where v_c > 0 is commanded.

    Raises MotionError for fewer than two cycles, and for a commanded speed that is none.
    """
    cycles = speeds.shape[1]
    if cycles < 2:
        raise MotionError(
            f"velocity repeatability: {cycles} cycle has no scatter; run at least 2 (the standard has 10)"
        )
    if not commanded > 0:
        raise MotionError(f"velocity accuracy: the commanded speed {commanded} m/s must be above 0")
    mean = speeds.mean(0)
    return VelocityAccuracy(
        cycles,
        commanded,
        float(100 * (mean.mean() - commanded) / commanded),
        float(100 * 3 * mean.std(ddof=1) / commanded),
        float(np.ptp(speeds, axis=0).max()),
    )


STATIONS = 50
"""Along the path, evenly: the standard asks for 10 at least."""
STEADY_SPEED_SHARE = 1e-3
"""Share of the top speed by which the planned speed may be off it where the speed is judged."""


@dataclass(frozen=True, slots=True)
class IsoStyle(Result):
    """Path, pose and velocity accuracy of n cycles, in the style of ISO 9283; no velocity where none is held."""

    path: PathAccuracy
    pose: PoseAccuracy
    velocity: VelocityAccuracy | None

    def figures(self) -> dict[str, float]:
        """All by their names; nan where not known."""
        none = VelocityAccuracy(self.path.cycles, *[np.nan] * 4)
        return self.path.figures() | self.pose.figures() | (self.velocity or none).figures()

    def tables(self) -> tuple[Table, ...]:
        """Of the path, of its end, and of the speed where one is held."""
        return tuple(table for part in (self.path, self.pose, self.velocity) if part for table in part.tables())

    def data(self) -> Table:
        """Every figure by its name: m, rad, m/s, and % of the speed."""
        figures = self.figures()
        return Table("ISO-style", (Column("figure", [*figures]), Column("value", [*figures.values()])))

    def plot(self, ax: Axes | None = None) -> Axes:
        """Accuracy and repeatability of the path, station by station."""
        axes: Axes = self.path.plot(ax)
        return axes


def iso_style(runs: Runs, task: Task, rigs: Sequence[Rig], *, stations: int = STATIONS) -> IsoStyle:
    """From B cycles of one task, every one with a scatter of its own: seeds of the host's timing, or of the rig.

    Stations lie evenly along the path, half their distance from its ends; the pose is that at the end of the record;
    the speed is judged in the middle half of the longest time for which the top speed is planned.

    Raises MotionError for a task without a path in space, and where a pose of a run is not known.
    """
    machine = rigs[0].machine
    planned = sample_plan(task.motion, machine, runs.t)
    if planned.path is None:
        raise MotionError(f"task {task.name} has no path in space; ISO-style figures need one: plan it on a machine")
    actual = machine.home_q + runs.actual * np.array([axis.pulse for axis in machine.axes])
    reference, attained, known = attained_poses(actual, planned, planned.path, machine, certify=False)
    if not known.all():
        run = int(np.argmin(known.all(0)))
        raise MotionError(f"task {task.name}: run {run + 1} has positions that are no pose of machine {machine.name}")
    paths, rotations = attained[..., :3], attained[..., 3:].reshape(*attained.shape[:2], 3, 3)
    ends = planned.curve.breaks[[0, -1]]
    s = ends[0] + (ends[1] - ends[0]) * (np.arange(stations) + 0.5) / stations
    piece = piece_of(planned.curve, s)
    tangents = directions(planned.curve, s, piece)
    moving = np.linalg.norm(tangents, axis=1) > 0
    numbers = planned.path.pose_numbers(s[moving], piece[moving])
    places = Stations(numbers[:, :3], tangents[moving], numbers[:, 3:].reshape(-1, 3, 3))
    last = Rotation.from_matrix(reference[-1, 3:].reshape(3, 3).T @ rotations[-1]).as_rotvec()
    return IsoStyle(
        path_accuracy(paths, places, rotations),
        pose_accuracy(paths[-1], reference[-1, :3], last),
        _velocity(runs.t, reference[:, :3], paths),
    )


def _velocity(t: Array, reference: Array, paths: Array) -> VelocityAccuracy | None:
    """From positions (N, 3) and (N, n, 3) by central differences."""
    planned = np.linalg.norm(np.gradient(reference, t, axis=0), axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], planned >= (1 - STEADY_SPEED_SHARE) * planned.max(), [0]])))
    since, until = max(edges.reshape(-1, 2), key=lambda stretch: int(stretch[1] - stretch[0]))
    quarter = (until - since) // 4
    if quarter < 2 or not planned.max() > 0:
        return None
    held = slice(since + quarter, until - quarter)
    speeds = np.linalg.norm(np.gradient(paths, t, axis=0), axis=2)
    return velocity_accuracy(speeds[held], float(planned[held].mean()))
