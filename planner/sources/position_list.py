"""Position lists: poses that an operator records one by one, to be run all, or from one to another;
and their CSV.

A column for each of x, y, z and three angles, and for rests, its unit in the header:

    # rotation = xyz
    # frame = home
    x [mm], y [mm], z [mm], rx [deg], ry [deg], rz [deg], dwell [s]
    15, 0, 25, 0, 0, 0, 0.2

Lines that begin with # come first, if at all, and say what angles mean and what coordinates are
relative to. Columns may stand in any order and be left out, and are then 0; commas or semicolons
part them, and decimals have points.
"""

import csv
import re
from dataclasses import dataclass, replace
from math import degrees
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.files.atomic_files import require_folder, write_whole
from kinematics.files.toml_document import format_decimal
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import BadValue, MotionError
from kinematics.foundation.names import closest, count_noun, nearest
from kinematics.foundation.options import check_arguments, check_fields
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.foundation.units import describe_value, unit_value
from planner.program.model import Frame
from planner.sources.source import Faults

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

Order = Literal["xyz", "yzx"]
"""How three angles combine: Rx · Ry · Rz, or Ry · Rz · Rx as [KMITL 2005] has it."""
MAX_COORDINATE = 1e5
"""m and rad; nothing that means something is listed beyond."""
MAX_DWELL = 1e5
"""s of a rest, likewise."""


@dataclass(frozen=True, slots=True, eq=False)
class PositionList(Result):
    """Poses, numbered from 1. Every method returns a new list.

    poses  (N, 6) x, y, z in m, θx, θy, θz in rad
    order   how the angles combine;  frame  "home": coordinates are relative to the machine's home
            pose, or "base"
    dwells  (N,) s of rest at each pose; None: none
    Raises MotionError for what is no pose, and for a number that the list does not have.
    """

    poses: Array
    order: Order = "xyz"
    frame: Frame = "home"
    dwells: Array | None = None

    def __post_init__(self) -> None:
        check_fields(self, "poses", "dwells")
        poses = finite_array(
            self.poses,
            "position list: poses",
            (None, 6),
            least=-MAX_COORDINATE,
            most=MAX_COORDINATE,
        )
        object.__setattr__(self, "poses", freeze_array(poses))
        given = np.zeros(len(poses)) if self.dwells is None else self.dwells
        dwells = finite_array(
            given, "position list: dwells", (len(poses),), least=0.0, most=MAX_DWELL, unit="s"
        )
        object.__setattr__(self, "dwells", freeze_array(dwells))

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def rotations(self) -> "Rotation":
        """The N orientations."""
        from scipy.spatial.transform import Rotation

        axes = ["XYZ".index(letter) for letter in self.order.upper()]
        return Rotation.from_euler(self.order.upper(), self.poses[:, 3:][:, axes])

    @property
    def rests(self) -> Array:
        """(N,) s of rest at each pose."""
        assert self.dwells is not None  # filled in when it was made
        return self.dwells

    def tables(self) -> tuple[Table, ...]:
        """Each pose by its number; how long it rests there, if it does anywhere."""
        meaning = "·".join(f"R{axis}" for axis in self.order)
        columns = (
            Column("pose", range(1, len(self) + 1)),
            *(Column(name, self.poses[:, k], "m", "human") for k, name in enumerate("xyz")),
            *(
                Column(f"θ{name}", self.poses[:, 3 + k], "rad", "human")
                for k, name in enumerate("xyz")
            ),
            *([Column("dwell", self.rests, "s", form="g")] if self.rests.any() else []),
        )
        return (Table(f"{count_noun(len(self), 'pose')} from {self.frame}, {meaning}", columns),)

    @check_arguments()
    def record(self, pose: ArrayLike, dwell: float = 0.0) -> "PositionList":
        """With one more pose at the end, and s of rest there."""
        return self._insert(len(self), pose, dwell)

    @check_arguments()
    def insert(self, number: int, pose: ArrayLike, dwell: float = 0.0) -> "PositionList":
        """With a pose that gets a number, and s of rest there; what had it, and all after that,
        move up by one.
        """
        if number != len(self) + 1:
            self._check_number(number)
        return self._insert(number - 1, pose, dwell)

    @check_arguments()
    def remove(self, first: int, last: int | None = None) -> "PositionList":
        """Without one pose, or those from one to another; what comes after moves down."""
        self._check_range(first, first if last is None else last)
        gone = slice(first - 1, last or first)
        return replace(
            self, poses=np.delete(self.poses, gone, axis=0), dwells=np.delete(self.rests, gone)
        )

    @check_arguments()
    def part(self, first: int | None = None, last: int | None = None) -> "PositionList":
        """Those from one number to another, both included; None: from the first, to the last."""
        first, last = 1 if first is None else first, len(self) if last is None else last
        self._check_range(first, last)
        return replace(
            self, poses=self.poses[first - 1 : last], dwells=self.rests[first - 1 : last]
        )

    def _insert(self, place: int, pose: ArrayLike, dwell: float) -> "PositionList":
        one = finite_array(
            pose,
            "position list: a pose (x, y, z, θx, θy, θz)",
            (6,),
            least=-MAX_COORDINATE,
            most=MAX_COORDINATE,
        )
        return replace(
            self,
            poses=np.insert(self.poses, place, one, axis=0),
            dwells=np.insert(self.rests, place, dwell),
        )

    def _check_number(self, number: int) -> None:
        if not 1 <= number <= len(self):
            held = f"poses 1 to {len(self)}" if len(self) else "no pose yet"
            raise MotionError(f"position list: no pose {number}; it has {held}")

    def _check_range(self, first: int, last: int) -> None:
        self._check_number(first)
        self._check_number(last)
        if first > last:
            raise MotionError(
                f"position list: from {first} to {last} is not a range of it; give the lower number first"
            )


NAMES = ("x", "y", "z", "rx", "ry", "rz", "dwell")
DWELL_INDEX = NAMES.index("dwell")
UNITS = ("m",) * 3 + ("rad",) * 3 + ("s",)
COLUMNS = {
    **{name: k for k, name in enumerate(NAMES)},
    **{f"{word}{axis}": 3 + k for word in ("θ", "theta", "theta_") for k, axis in enumerate("xyz")},
}
"""Place of a column's name in a row: of six numbers of a pose, and its rest."""
HEAD_VALUES = {"rotation": ("xyz", "yzx"), "frame": ("home", "base")}
_HEAD = re.compile(r"#\s*(\w+)\s*=\s*(\w+)\s*")
_COLUMN = re.compile(r"\s*([^\s\[(]+)\s*(?:[\[(]\s*([^\])]+?)\s*[\])])?\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)


def read_csv(
    path: Path, text: str, length: str | None, angle: str | None
) -> tuple[PositionList, list[str]]:
    """The list, and what to know of it. length, angle: units of columns that state none.

    Raises FileError with all faults, each with its line.
    """
    faults, heads = Faults(str(path)), {"rotation": "xyz", "frame": "home"}
    lines = text.split("\n")
    begin = next(
        (k for k, line in enumerate(lines) if not line.startswith("#") and line.strip()), len(lines)
    )
    for number, line in enumerate(lines[:begin], 1):
        if line.strip():
            _head(number, line, heads, faults)
    if begin == len(lines):
        faults.add(
            'no header; the first line names the columns and their units, as "x [mm], y [mm], z [mm]"'
        )
        faults.refuse()
    delimiter = ";" if ";" in lines[begin] else ","
    columns = _columns(begin + 1, lines[begin].split(delimiter), length, angle, faults)
    faults.refuse()
    poses = []
    for number, line in enumerate(lines[begin + 1 :], begin + 2):
        if line.strip():
            try:
                cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
            except csv.Error as error:  # such as a cell of more than 131072 characters
                faults.add(f"not CSV: {error}", number)
                continue
            poses.append(_row(number, cells, columns, faults))
    if not poses and not faults:
        faults.add("no pose: a header, and nothing below it")
    faults.refuse()
    missing = [
        name for name in ("x", "y", "z") if COLUMNS[name] not in {place for place, _ in columns}
    ]
    told = [f"no column {name}: 0 was taken" for name in missing]
    rows = np.array(poses)
    order, frame = heads["rotation"], heads["frame"]
    return PositionList(rows[:, :DWELL_INDEX], order, frame, rows[:, DWELL_INDEX]), told  # type: ignore[arg-type]  # by _head


def _head(number: int, line: str, heads: dict[str, str], faults: Faults) -> None:
    found = _HEAD.fullmatch(line)
    if found is None or found[1] not in HEAD_VALUES or found[2] not in HEAD_VALUES[found[1]]:
        known = " or ".join(
            f'"# {name} = {value}"' for name, values in HEAD_VALUES.items() for value in values
        )
        faults.add(f"{describe_value(line)}: what may stand before the header is {known}", number)
    else:
        heads[found[1]] = found[2]


def _columns(
    number: int, names: list[str], length: str | None, angle: str | None, faults: Faults
) -> list[tuple[int, float]]:
    """Place in a pose and SI value of the unit, column by column."""
    columns: list[tuple[int, float]] = []
    if all(_NUMBER.fullmatch(cell.strip()) for cell in names):
        faults.add(
            'no header: the first line names the columns and their units, as "x [mm], y [mm], z [mm]"',
            number,
        )
        return columns
    for cell in names:
        found = _COLUMN.fullmatch(cell)
        name = found[1].lower() if found else ""
        if found is None or name not in COLUMNS:
            known = ", ".join(COLUMNS)
            told = (
                f"column {describe_value(cell.strip())}{nearest(name, COLUMNS)}; known are {known}"
            )
            no = BadValue(told, allowed=known, nearest=closest(name, COLUMNS))
            faults.add(no, number, value=cell.strip())
            continue
        place = COLUMNS[name]
        unit = found[2] or {"m": length, "rad": angle}.get(UNITS[place])
        if any(place == other for other, _ in columns):
            faults.add(f"column {name} appears twice", number)
        elif unit is None:
            like = {"m": f"{name} [mm]", "rad": f"{name} [deg]", "s": f"{name} [s]"}[UNITS[place]]
            option = {"m": ", or give the option length", "rad": ", or give the option angle"}.get(
                UNITS[place], ""
            )
            faults.add(f'column {name} has no unit: write it as "{like}"{option}', number)
        else:
            with faults.collect(number, f"column {name}", cell.strip()):
                columns.append((place, unit_value(unit, UNITS[place])))
    return columns


def _row(
    number: int, cells: list[str], columns: list[tuple[int, float]], faults: Faults
) -> list[float]:
    pose = [0.0] * len(NAMES)
    if len(cells) != len(columns):
        faults.add(
            f"{count_noun(len(cells), 'entry')} for {count_noun(len(columns), 'column')}", number
        )
        return pose
    for cell, (place, unit) in zip(cells, columns, strict=True):
        text = cell.strip()
        name = NAMES[place]
        if not _NUMBER.fullmatch(text):
            faults.add(f"{describe_value(text)} is not a number", number, f"column {name}", text)
        elif not abs(float(text) * unit) <= MAX_COORDINATE:
            allowed = f"at most {MAX_COORDINATE / unit:g} of its unit either way"
            faults.add(
                BadValue(f"{describe_value(text)} must be {allowed}", allowed=allowed),
                number,
                f"column {name}",
                text,
            )
        elif place == DWELL_INDEX and float(text) < 0:
            faults.add(
                BadValue(f"{describe_value(text)} must be at least 0 s", allowed="at least 0 s"),
                number,
                "column dwell",
                text,
            )
        else:
            pose[place] = float(text) * unit
    return pose


def positions_csv(listed: PositionList) -> str:
    """The text of a list: mm, degrees, and s where it rests anywhere.

    Lengths are read back within a unit in the last place, and so are angles.
    """
    lines = [f"# rotation = {listed.order}", f"# frame = {listed.frame}"]
    rests = bool(listed.rests.any())
    heads = [*(f"{name} [mm]" for name in "xyz"), *(f"r{name} [deg]" for name in "xyz")]
    lines.append(",".join([*heads, "dwell [s]"] if rests else heads))
    for pose, rest in zip(listed.poses.tolist(), listed.rests.tolist(), strict=True):
        cells = [
            *(format_decimal(value, 3) for value in pose[:3]),
            *(repr(degrees(a)) for a in pose[3:]),
        ]
        lines.append(",".join([*cells, repr(rest)] if rests else cells))
    return "\n".join(lines) + "\n"


@check_arguments()
def save_positions(listed: PositionList, path: str | PathLike[str]) -> None:
    """Write a position list as CSV, atomically: complete, or the file is unchanged.

    Parameters
    ----------
    listed
        What is written, in mm and degrees, and s where it rests anywhere.
    path
        Of the CSV file, in a folder that exists.

    Raises
    ------
    MotionError
        There is no such folder, or it cannot be written to.
    """
    require_folder(f"save {path}", Path(path))
    write_whole(Path(path), positions_csv(listed))
