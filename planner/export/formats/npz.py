"""The pulse schedule itself, in parts that follow each other in time: one file that numpy.load
opens.

    schedule.json                schema, kind, clock_hz, duration (s), rule, parts, pulses, and of
                                 each axis: name, start (count), pulse and home (m or rad), bound
                                 (pulses), pulses (how many)
    000000/axis1.ticks.npy       int64: the pulses of axis 1 in the first part, at ticks / clock_hz
                                 from time 0
    000000/axis1.direction.npy   int8: +1/-1 in q
    000000/axis2.ticks.npy       …

numpy.load(FILE)["000000/axis1.ticks"] is one array; an axis' arrays of all parts, one after the
other, are its pulses. Every part ends at one tick for all axes, so they can be sent to a machine
one by one. Axes are numbered as in schedule.json (UTF-8). A zip archive without compression;
little-endian, 9 bytes a pulse. The same schedule always gives the same bytes.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar
from zipfile import BadZipFile, ZipFile, ZipInfo

import numpy as np
from numpy.typing import NDArray

from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.options import option
from planner.export.format import Exported, ExportSource
from planner.parallel import Progress, ignore_progress
from planner.pulses.schedule import AxisPulses, PulseSchedule, holds_same_pulses, join_schedules

INDEX, SCHEMA, KIND = "schedule.json", 1, "pulse schedule"
MAX_PART_PULSES = 1 << 20
ARRAYS = {"ticks": "<i8", "direction": "|i1"}


@dataclass(frozen=True, slots=True)
class Npz:
    """Ticks and directions of every axis as arrays, in parts, for numpy.load."""

    suffix: ClassVar[str] = ".npz"
    part: int = option(MAX_PART_PULSES, "largest number of pulses per axis and part")

    def write(self, source: ExportSource, path: Path) -> Exported:
        write(source.pulses, path, self.part, source.tell)
        exact = holds_same_pulses(source.pulses, parts(path))
        return Exported(
            0.0 if exact else np.inf, "the pulses, tick for tick", moves=source.pulses.total
        )


def write(
    schedule: PulseSchedule,
    path: str | PathLike[str],
    part: int = MAX_PART_PULSES,
    tell: Progress = ignore_progress,
) -> None:
    """Write a schedule in parts, in memory that does not grow with it.

    Raises MotionError for parts without pulses.
    """
    if part < 1:
        raise MotionError(f"parts of {part} pulses: give 1 or more")
    windows = list(_windows(schedule, part))
    axes = [
        {
            "name": a.name,
            "start": a.start,
            "pulse": a.pulse,
            "home": a.home,
            "bound": a.bound,
            "pulses": len(a),
        }
        for a in schedule.axes
    ]
    index = {
        "schema": SCHEMA,
        "kind": KIND,
        "clock_hz": schedule.clock_hz,
        "duration": schedule.duration,
        "rule": schedule.rule,
        "parts": len(windows),
        "pulses": schedule.total,
        "axes": axes,
    }
    with ZipFile(path, "w") as archive:
        archive.writestr(ZipInfo(INDEX), json.dumps(index, indent=2, ensure_ascii=False) + "\n")
        for number, window in enumerate(windows):
            for k, (axis, pulses) in enumerate(zip(schedule.axes, window, strict=True)):
                for what, kind in ARRAYS.items():
                    member = ZipInfo(_member(number, k, what))  # dated 1980, whenever it is written
                    with archive.open(member, "w", force_zip64=True) as file:
                        np.lib.format.write_array(
                            file, getattr(axis, what)[pulses].astype(kind, copy=False)
                        )
            tell(number + 1, len(windows))


def parts(path: str | PathLike[str]) -> Iterator[PulseSchedule]:
    """The parts of a file, one after the other: each begins with the counts that the one before
    ends with.

    Ticks count from the start of the motion, and the duration is its. Raises FileError for a file
    that is not whole.
    """
    name = str(path)
    try:
        with ZipFile(path) as archive:
            index = json.loads(archive.read(INDEX))
            if (index["schema"], index["kind"]) != (SCHEMA, KIND):
                raise FileError(name, [Fault(INDEX, f"is no {KIND} of schema {SCHEMA}")])
            starts = [axis["start"] for axis in index["axes"]]
            for number in range(index["parts"]):
                axes = tuple(
                    AxisPulses(
                        about["name"],
                        _array(archive, _member(number, k, "ticks"), "<i8"),
                        _array(archive, _member(number, k, "direction"), "|i1"),
                        start,
                        about["pulse"],
                        about["home"],
                        about["bound"],
                    )
                    for k, (about, start) in enumerate(zip(index["axes"], starts, strict=True))
                )
                starts = [axis.final for axis in axes]
                yield PulseSchedule(index["clock_hz"], axes, index["duration"], index["rule"])
    except (BadZipFile, KeyError, ValueError, TypeError) as error:
        raise FileError(
            name, [Fault("contents", f"is no {KIND} in parts, or not all of it: {error}")]
        ) from error


def read(path: str | PathLike[str]) -> PulseSchedule:
    """The whole schedule. Raises FileError as `parts` does."""
    return join_schedules(parts(path))


def _windows(schedule: PulseSchedule, part: int) -> Iterator[tuple[slice, ...]]:
    """Of each part, the pulses of every axis: no more than `part` of any, and at least one part."""
    marks = np.unique(np.concatenate([axis.ticks[part::part] for axis in schedule.axes]))
    cuts = [[0, *np.searchsorted(axis.ticks, marks).tolist(), len(axis)] for axis in schedule.axes]
    for number in range(len(marks) + 1):
        yield tuple(slice(cut[number], cut[number + 1]) for cut in cuts)


def _member(number: int, axis: int, what: str) -> str:
    return f"{number:06d}/axis{axis + 1}.{what}.npy"


def _array(archive: ZipFile, member: str, kind: str) -> NDArray[Any]:
    with archive.open(member) as file:
        array: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
    if array.dtype != np.dtype(kind) or array.ndim != 1:
        raise ValueError(
            f"{member} holds {array.ndim}-dimensional {array.dtype}, not a row of {np.dtype(kind)}"
        )
    array.flags.writeable = False
    return array
