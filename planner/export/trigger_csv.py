"""The triggers of a plan as a table: one row per event, in the order of time.

Columns are name, segment, repetition (1 where the program runs once), time, distance along the path, the pose of the
platform in the base frame (rx, ry, rz about the moving axes in turn), and the count of every axis. SI units.
"""

import csv
from pathlib import Path

from planner.plan import Plan


def write(plan: Plan, path: Path) -> None:
    """Write the table: numbers as Python's shortest decimals, which read back as the same floats; line ends \\n."""
    place = [*(f"{name} [m]" for name in "xyz"), *(f"r{name} [rad]" for name in "xyz")]
    counts = [f"{axis.name} [counts]" for axis in plan.machine.axes]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["name", "segment", "repetition", "t [s]", "s [m]", *place, *counts])
        for event in sorted(plan.triggers, key=lambda event: event.time):
            at, angles = event.where, event.pose.rotation.as_euler("XYZ", suppress_warnings=True)
            pose = [value + 0.0 for value in (*event.pose.translation.tolist(), *angles.tolist())]  # no −0
            table.writerow([event.name, at.segment, at.repetition or 1, event.time, at.s, *pose, *event.counts])
