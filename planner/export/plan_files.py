"""The files of a plan's motion: trajectory.csv and triggers.csv, as tables.

trajectory.csv has one row per instant, for spreadsheets and plots. Columns are time, distance along
the path, the pose of the platform in the base frame (rx, ry, rz about the moving axes in turn), and
position (natural coordinate), speed, acceleration and jerk of every axis. SI units, as the header
says.

triggers.csv has one row per event, in the order of time. Columns are name, segment, repetition (1
where the program runs once), time, distance along the path, the pose of the platform in the base
frame, and the count of every axis. SI units.
"""

import csv
import io
from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from kinematics import Axis
from kinematics.foundation.table import Column, Table
from planner.pulses.triggers import Triggered
from planner.shaping.shaped_motion import ShapedMotion, rows_of_shaped
from planner.trajectory import Trajectory, column_headings, row_instants, rows

BLOCK_ROWS = 1 << 13
"""Rows computed and written together, so that memory stays bounded."""
MOST_TRIGGERS = 50
"""That are read for a page."""


def write_trajectory_csv(
    trajectory: Trajectory, path: Path, shaped: ShapedMotion | None = None
) -> None:
    """Write the table: 12 significant digits, line ends \\n, decimal points whatever the locale.

    shaped: what the axes do behind input shapers, and the pose that they reach, instead of the
    trajectory itself; the distance along the path is that of the trajectory, as late as the shapers
    make it
    """
    t = row_instants((trajectory if shaped is None else shaped).duration)
    header = [
        f"{name} [{unit}]" if unit else name for name, unit in column_headings(trajectory.path)
    ]
    with path.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(header)
        for first in range(0, len(t), BLOCK_ROWS):
            some = t[first : first + BLOCK_ROWS]
            table = (
                rows(trajectory, some)
                if shaped is None
                else rows_of_shaped(trajectory, shaped, some)
            )
            np.savetxt(file, table, fmt="%.12g", delimiter=",")


def write_trigger_csv(triggers: Sequence[Triggered], axes: Sequence[Axis], path: Path) -> None:
    """Write the table: numbers as Python's shortest decimals, which read back as the same floats;
    line ends \\n.
    """
    with path.open("wb") as file:
        TriggerWriter(file, axes).add(triggers)


class TriggerWriter:
    """Writes the same table part by part."""

    def __init__(self, file: BinaryIO, axes: Sequence[Axis]) -> None:
        """Write the headings of the columns."""
        self._file = file
        place = [*(f"{name} [m]" for name in "xyz"), *(f"r{name} [rad]" for name in "xyz")]
        counts = [f"{axis.name} [counts]" for axis in axes]
        file.write(
            _as_lines([["name", "segment", "repetition", "t [s]", "s [m]", *place, *counts]])
        )

    def add(self, triggers: Sequence[Triggered]) -> None:
        """Write the triggers of another part."""
        self._file.write(_trigger_lines(triggers))


def tabulate_trigger_csv(path: Path, count: int) -> Table:
    """The first triggers of a table that was written, MOST_TRIGGERS of `count` at most."""
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = [*islice(reader, MOST_TRIGGERS)]
        counted = [name for name in reader.fieldnames or () if name.endswith(" [counts]")]
    repetitions = [int(row["repetition"]) for row in rows]
    columns = [
        Column("trigger", [row["name"] for row in rows]),
        Column("segment", [int(row["segment"]) for row in rows]),
        *([Column("repetition", repetitions)] if max(repetitions, default=1) > 1 else []),
        Column("at", [float(row["s [m]"]) for row in rows], "m", "human", ".3f"),
        Column("time", [float(row["t [s]"]) for row in rows], "s", form=".7f"),
        *(
            Column(name.replace("[counts]", "(counts)"), [int(row[name]) for row in rows])
            for name in counted
        ),
    ]
    left = f"the other {count - len(rows)} are in {path.name}"
    told = "times at which the motion passes the positions marked in the program, with the counts of every axis"
    return Table(told, tuple(columns), (left,) if count > len(rows) else ())


def _trigger_lines(triggers: Sequence[Triggered]) -> bytes:
    rows: list[list[Any]] = []
    for event in sorted(triggers, key=lambda event: event.time):
        at, angles = event.where, event.pose.rotation.as_euler("XYZ", suppress_warnings=True)
        pose = [
            value + 0.0 for value in (*event.pose.translation.tolist(), *angles.tolist())
        ]  # no −0
        rows.append(
            [event.name, at.segment, at.repetition or 1, event.time, at.s, *pose, *event.counts]
        )
    return _as_lines(rows)


def _as_lines(rows: Sequence[Sequence[Any]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
