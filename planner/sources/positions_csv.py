"""Position lists as CSV: a column for each of x, y, z and three angles, and for rests, its unit in the header.

    # rotation = xyz
    # frame = home
    x [mm], y [mm], z [mm], rx [deg], ry [deg], rz [deg], dwell [s]
    15, 0, 25, 0, 0, 0, 0.2

Lines that begin with # come first, if at all, and say what angles mean and what coordinates are relative to. Columns
may stand in any order and be left out, and are then 0; commas or semicolons part them, and decimals have points.
"""

import csv
import re
from math import degrees
from pathlib import Path

import numpy as np

from kinematics.errors import BadValue, MotionError
from kinematics.registry import closest, nearest
from kinematics.staging import write_whole
from kinematics.toml_text import decimal
from kinematics.units import shown, unit_value
from planner.sources.faults import Faults
from planner.sources.position_list import FARTHEST, PositionList

NAMES = ("x", "y", "z", "rx", "ry", "rz", "dwell")
DWELL = NAMES.index("dwell")
UNITS = ("m",) * 3 + ("rad",) * 3 + ("s",)
COLUMNS = {
    **{name: k for k, name in enumerate(NAMES)},
    **{f"{word}{axis}": 3 + k for word in ("θ", "theta", "theta_") for k, axis in enumerate("xyz")},
}
"""Place of a column's name in a row: of six numbers of a pose, and its rest."""
HEADS = {"rotation": ("xyz", "yzx"), "frame": ("home", "base")}
_HEAD = re.compile(r"#\s*(\w+)\s*=\s*(\w+)\s*")
_COLUMN = re.compile(r"\s*([^\s\[(]+)\s*(?:[\[(]\s*([^\])]+?)\s*[\])])?\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,3})?", re.ASCII)


def read_csv(path: Path, text: str, length: str | None, angle: str | None) -> tuple[PositionList, list[str]]:
    """The list, and what to know of it. length, angle: units of columns that state none.

    Raises FileError with all faults, each with its line.
    """
    faults, heads = Faults(str(path)), {"rotation": "xyz", "frame": "home"}
    lines = text.split("\n")
    begin = next((k for k, line in enumerate(lines) if not line.startswith("#") and line.strip()), len(lines))
    for number, line in enumerate(lines[:begin], 1):
        if line.strip():
            _head(number, line, heads, faults)
    if begin == len(lines):
        faults.add('no header; the first line names the columns and their units, as "x [mm], y [mm], z [mm]"')
        faults.refuse()
    delimiter = ";" if ";" in lines[begin] else ","
    columns = _columns(begin + 1, lines[begin].split(delimiter), length, angle, faults)
    faults.refuse()
    poses = []
    for number, line in enumerate(lines[begin + 1 :], begin + 2):
        if line.strip():
            cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
            poses.append(_row(number, cells, columns, faults))
    if not poses:
        faults.add("no pose: a header, and nothing below it")
    faults.refuse()
    missing = [name for name in ("x", "y", "z") if COLUMNS[name] not in {place for place, _ in columns}]
    told = [f"no column {name}: 0 was taken" for name in missing]
    rows = np.array(poses)
    order, frame = heads["rotation"], heads["frame"]
    return PositionList(rows[:, :DWELL], order, frame, rows[:, DWELL]), told  # type: ignore[arg-type]  # by _head


def _head(number: int, line: str, heads: dict[str, str], faults: Faults) -> None:
    found = _HEAD.fullmatch(line)
    if found is None or found[1] not in HEADS or found[2] not in HEADS[found[1]]:
        known = " or ".join(f'"# {name} = {value}"' for name, values in HEADS.items() for value in values)
        faults.add(f"{shown(line)}: what may stand before the header is {known}", number)
    else:
        heads[found[1]] = found[2]


def _columns(
    number: int, names: list[str], length: str | None, angle: str | None, faults: Faults
) -> list[tuple[int, float]]:
    """Place in a pose and SI value of the unit, column by column."""
    columns: list[tuple[int, float]] = []
    if all(_NUMBER.fullmatch(cell.strip()) for cell in names):
        faults.add('no header: the first line names the columns and their units, as "x [mm], y [mm], z [mm]"', number)
        return columns
    for cell in names:
        found = _COLUMN.fullmatch(cell)
        name = found[1].lower() if found else ""
        if found is None or name not in COLUMNS:
            known = ", ".join(COLUMNS)
            told = f"column {shown(cell.strip())}{nearest(name, COLUMNS)}; known are {known}"
            no = BadValue(told, allowed=known, nearest=closest(name, COLUMNS))
            faults.add(no, number, value=cell.strip())
            continue
        place = COLUMNS[name]
        unit = found[2] or {"m": length, "rad": angle}.get(UNITS[place])
        if any(place == other for other, _ in columns):
            faults.add(f"column {name} stands twice", number)
        elif unit is None:
            like = {"m": f"{name} [mm]", "rad": f"{name} [deg]", "s": f"{name} [s]"}[UNITS[place]]
            option = {"m": ", or give the option length", "rad": ", or give the option angle"}.get(UNITS[place], "")
            faults.add(f'column {name} has no unit: write it as "{like}"{option}', number)
        else:
            try:
                columns.append((place, unit_value(unit, UNITS[place])))
            except MotionError as error:
                faults.add(error, number, f"column {name}", cell.strip())
    return columns


def _row(number: int, cells: list[str], columns: list[tuple[int, float]], faults: Faults) -> list[float]:
    pose = [0.0] * len(NAMES)
    if len(cells) != len(columns):
        faults.add(f"{len(cells)} entries for {len(columns)} columns", number)
        return pose
    for cell, (place, unit) in zip(cells, columns, strict=True):
        text = cell.strip()
        name = NAMES[place]
        if not _NUMBER.fullmatch(text):
            faults.add(f"{shown(text)} is not a number", number, f"column {name}", text)
        elif not abs(float(text) * unit) <= FARTHEST:
            allowed = f"at most {FARTHEST / unit:g} of its unit either way"
            faults.add(BadValue(f"{shown(text)} must be {allowed}", allowed=allowed), number, f"column {name}", text)
        elif place == DWELL and float(text) < 0:
            faults.add(
                BadValue(f"{shown(text)} must be at least 0 s", allowed="at least 0 s"), number, "column dwell", text
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
        cells = [*(decimal(value, 3) for value in pose[:3]), *(repr(degrees(a)) for a in pose[3:])]
        lines.append(",".join([*cells, repr(rest)] if rests else cells))
    return "\n".join(lines) + "\n"


def save_positions(listed: PositionList, path: Path) -> None:
    """Write the text of a list so that it is there complete, or as it was before."""
    write_whole(path, positions_csv(listed))
