"""ROS `trajectory_msgs/JointTrajectory` as YAML: positions, velocities and accelerations at times
from the start.

    joint_names: ["leg1", "leg2"]
    points:
      - positions: [0.2310935915, 0.2370092485]
        velocities: [0.0000000000, 0.0000000000]
        accelerations: [0.1331785200, -0.2000000000]
        effort: []
        time_from_start: {sec: 0, nanosec: 0}

- Metres and radians; natural coordinates (a joint's angle, a leg's length) or, with origin home,
  from the machine's.
- joint_trajectory_controller goes from point to point by the quintic that meets all three at both.
  Where an acceleration jumps, as at order 2 it does, the quintics beside the jump would exceed it
  by 0.374 of the jump, however close the points: of such a motion accelerations are [], so that the
  controller goes by cubics, and points stand at the jumps.
- It refuses a trajectory that ends at a speed, unless allow_nonzero_velocity_at_trajectory_end is
  set.
- Times are whole nanoseconds: sec and nanosec (ROS 2), or secs and nsecs (ROS 1).
- ASCII YAML, names in double quotes with escapes, line ends \\n, decimal points whatever the
  locale.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.options import option
from planner.export.columns import BLOCK_POINTS, Columns, line_blocks, make_columns, origin_option
from planner.export.format import Exported, ExportSource
from planner.export.knots import REST_SPEED, KnotFormat, compare, find_jumps

PER_SECOND = 10**9
ROWS = ("positions", "velocities", "accelerations")
TIMES = {"1": ("secs", "nsecs"), "2": ("sec", "nanosec")}
LINES = 5  # per point


@dataclass(frozen=True, slots=True)
class JointTrajectory(KnotFormat):
    """ROS JointTrajectory as YAML: positions, velocities, accelerations unless they jump; quintic
    or cubic between.
    """

    suffix: ClassVar[str] = ".yaml"
    origin: Literal["home", "natural"] = origin_option("natural")
    ros: Literal["1", "2"] = option(
        "2", "ROS version: 1 names times secs and nsecs, 2 sec and nanosec. Default 2"
    )

    def write(self, source: ExportSource, path: Path) -> Exported:
        axes, motion = source.machine.axes, source.counted
        rows = 2 if find_jumps(motion, axes).any() else 3
        knots = self.knots(source, rows, 1 / PER_SECOND)
        form = make_columns(source, knots.tolerance, origin=self.origin, unit="SI")
        speeds = motion.at(np.array([0.0, motion.duration])).qd
        begins, ends = (
            (abs(row) <= REST_SPEED * np.array([axis.pulse for axis in axes])).all()
            for row in speeds
        )
        whole, rest = TIMES[self.ros]
        with path.open("w", encoding="ascii", newline="") as file:
            names = ", ".join(quote(axis.name) for axis in axes)
            file.write(f"joint_names: [{names}]\npoints:\n")
            at = 0
            for steps, units in form.blocks(source, knots, rows, rest=bool(begins and ends)):
                for lasting, row in zip(steps.tolist(), form.text_rows(units), strict=True):
                    at += lasting
                    given = [row[k::rows] for k in range(rows)] + [[]] * (len(ROWS) - rows)
                    told = (
                        f"{name}: [{', '.join(numbers)}]"
                        for name, numbers in zip(ROWS, given, strict=True)
                    )
                    second, nanosecond = divmod(at, PER_SECOND)
                    file.write("  - " + "\n    ".join(told) + "\n    effort: []\n")
                    file.write(
                        f"    time_from_start: {{{whole}: {second}, {rest}: {nanosecond}}}\n"
                    )
        origin = "of" if self.origin == "natural" else "from home,"
        moving = "" if begins else "; it begins at a speed: send it while the motion before it runs"
        if not ends:
            moving += (
                "; it ends at a speed: allow_nonzero_velocity_at_trajectory_end has to be true"
            )
        notes: tuple[str, ...] = (
            f"positions {origin} the axes, in their sense; in {form.unit}{moving}",
        )
        if rows < len(ROWS):
            notes += (
                "the accelerations jump, so none are given: a quintic would exceed them beside each jump",
            )
        return compare(motion, axes, knots, _points(path, form, rows), notes)


def quote(name: str) -> str:
    """A YAML double-quoted scalar of printable ASCII that stands for any text."""
    plain = (c if " " <= c <= "~" and c not in '"\\' else f"\\U{ord(c):08X}" for c in name)
    return f'"{"".join(plain)}"'


def _points(path: Path, form: Columns, count: int) -> Iterator[tuple[Array, Array]]:
    for lines in line_blocks(path, 2, LINES * BLOCK_POINTS):
        rows = [
            [json.loads(line.partition(":")[2]) for line in lines[k::LINES]] for k in range(count)
        ]
        parts = [
            line.strip("}\n").replace(",", ":").split(":") for line in lines[LINES - 1 :: LINES]
        ]
        t = [int(part[2]) + int(part[4]) / PER_SECOND for part in parts]
        yield np.array(t), form.natural(np.array(rows))
