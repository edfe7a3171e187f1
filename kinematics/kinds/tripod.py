"""The tripod: three arms that move a plate without turning it; its TOML, and its geometry file of
[KMITL 2005].

That file, `Basiclength`, says where the three arms' joints are:

    Past 173.205 0.0000 0.0000
    Pand -86.602 150.000 0.0000
    …
    Pbrd -17.320 -30.000-250.00
    Cent 0.0000  0.0000 -250.00
    Endeffector 50.0000
    Lengtherror 0.0000
    BLU 1.0000

As the source's reader takes it: the first four letters say what a line is; columns 6 to 12, 14 to
20 and 21 to 27 hold x, y and z of a point, columns 13 to 21 a length (5 to 13 after BLU); decimals
have points. Pa*: the joints at the base, Pb*: those of the plate, Cent: its centre, all in the base
frame, as the machine stands at the start; Ende: how far the end point is below the plate's centre,
Leng: how far the plate is below its joints. BLU, the step of a key, moves nothing here.

The source prints the reader, not the file, and none of its numbers. ASSUMPTIONS: units are mm, and
the machine has the drives, travel and limits of the preset `tripod`; joints point the way from base
to plate.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.clearance import Disc
from kinematics.files.keys import key
from kinematics.files.toml_document import bytes_of, refuse_utf16, utf8_fault
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import Fault, FileError, MotionError
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.units import describe_value
from kinematics.kinds.axis_keys import AXES, GEOMETRY, KIND, OWN_AXES, axes
from kinematics.kinds.leg_lengths import LegAxis, refuse_unreachable_home
from kinematics.kinds.legged import (
    BASE_REST,
    PLATFORM_REST,
    Legged,
    Platforms,
    joints,
    legged_geometry,
    rest_axes_type,
)
from kinematics.kinds.load_keys import LEG_MASSES, LegsTable, LoadedFile, Point
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


class Tripod(Legged):
    """Three arms; the plate keeps its orientation at home.

    base, platform  (3, 3) joint centres in the frames of base and plate, m
    tool            (3,) the tool's centre in the plate's frame, m: poses are those of the tool
    Everything else as `Legged` has it; a tripod that hangs has rest axes that point down. Source:
    [KMITL 2005].
    """

    legs = 3
    sorts = ("linear",) * 3
    freedom = ("x", "y", "z")

    def __init__(
        self,
        base: ArrayLike,
        platform: ArrayLike,
        *,
        tool: ArrayLike = (0.0, 0.0, 0.0),
        platform_disc: Disc | None = None,
        **options: Any,
    ) -> None:
        machine = options.get("name") or "tripod"
        self.tool: Array = freeze_array(
            finite_array(tool, f"machine {machine}: tool", (3,), unit="m")
        )
        if isinstance(platform_disc, Disc):
            platform_disc = replace(
                platform_disc, centre=np.asarray(platform_disc.centre) - self.tool
            )
        plate = joints(machine, "platform", platform, self.legs) - self.tool
        super().__init__(base, plate, platform_disc=platform_disc, **options)

    def arm_lengths(self, pose: "Pose") -> Array:
        """‖p + R a − b‖ of each arm at any pose of the tool, turned or not: (N, 3) m, or (3,).

        A simulation, as [KMITL 2005] has it: three arms cannot hold a plate that is turned, so
        `inverse` refuses to.
        """
        joints = (
            self.platform @ np.swapaxes(pose.rotation.as_matrix(), -1, -2)
            + pose.translation[..., None, :]
        )
        return np.asarray(np.linalg.norm(joints - self.base, axis=-1))


ARMS = tuple(f"arm{n}" for n in range(1, 4))


JOINT_ROWS = "give three rows [x, y, z], one for each arm, with decimal points"


class TripodGeometry(Platforms):
    """Joint centres one by one, each in the frame of its platform; tool: its centre in the plate's
    frame.
    """

    base_rest: Annotated[tuple[Any, ...], rest_axes_type(3)] | None = BASE_REST
    platform_rest: Annotated[tuple[Any, ...], rest_axes_type(3)] | None = PLATFORM_REST
    base_joints: tuple[Point, Point, Point] = key(
        "centres of the base joints in the base frame: x, y, z of arm1 to arm3", remedy=JOINT_ROWS
    )
    platform_joints: tuple[Point, Point, Point] = key(
        "centres of the plate's joints in the plate's own frame: x, y, z of arm1 to arm3",
        remedy=JOINT_ROWS,
    )
    tool: Point = key(
        "tool centre point in the plate's frame", '["0 mm", "0 mm", "0 mm"]', (0.0, 0.0, 0.0)
    )

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return self.base_joints, np.asarray(self.platform_joints) - self.tool


class TripodArmTable(LegAxis):
    """What one arm has of its own."""

    name: Literal["arm1", "arm2", "arm3"]


class TripodFile(LoadedFile):
    """A tripod, key by key."""

    first_place = (0, 0, -20)
    kind: Literal["tripod"] = KIND
    geometry: TripodGeometry = GEOMETRY
    axes: LegAxis = AXES
    axis: tuple[TripodArmTable, ...] = OWN_AXES
    legs: LegsTable | None = LEG_MASSES

    def list_freedom(self) -> tuple[str, ...]:
        return Tripod.freedom

    def list_axes(self) -> list[Axis]:
        return axes(
            ARMS, dict.fromkeys(ARMS, self.axes), self.axis, self, self.geometry.home_lengths
        )

    @staticmethod
    def geometry_of(machine: Tripod, complete: bool) -> dict[str, Any]:
        tool = machine.tool if complete or machine.tool.any() else None
        return {**legged_geometry(machine, machine.tool, complete), "tool": tool}


def build_tripod(file: TripodFile, name: str, folder: Path | Traversable) -> Tripod:
    geometry = file.geometry
    machine = Tripod(
        geometry.base_joints,
        geometry.platform_joints,
        axes=file.list_axes(),
        tool=geometry.tool,
        name=name,
        load=file.load(file.legs),
        **geometry.options(),
    )
    refuse_unreachable_home(machine, file.axes, {table.name: table for table in file.axis})
    return machine


UNITS_PER_METRE = 1000.0
"""Of a file in one metre."""
MAX_FILE_BYTES = 1 << 20
"""Bytes of such a file; a real one has some three hundred."""
BASE, PLATE, CENTRE = ("Past", "Pand", "Pard"), ("Pbst", "Pbnd", "Pbrd"), "Cent"
POINTS = (*BASE, *PLATE, CENTRE)
LENGTHS: Mapping[str, tuple[int, int]] = {"Ende": (12, 21), "Leng": (12, 21), "BLU": (4, 13)}
"""First column, from 0, and the one behind the last, of keys that have one number."""
COORDINATES = ((5, 12), (13, 20), (20, 27))
REQUIRED_KEYS = (*POINTS, "Ende")
TEMPLATE_MACHINE = "tripod"
ASSUMED = """[KMITL 2005] prints the reader of such a file, and no numbers.
ASSUMPTIONS: units are mm; drives, travel, limits and tilt are those of the preset "tripod": put in your own."""
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,2})?", re.ASCII)


@dataclass(frozen=True, slots=True)
class _Found:
    """Numbers (1 or 3) of each key, in units, and the faults of the file."""

    values: dict[str, tuple[float, ...]]
    faults: list[Fault]


def is_basic_lengths(source: Path | Traversable) -> bool:
    """Whether a file begins as one of these does, and is no TOML by its suffix.

    Raises FileError where it cannot be read.
    """
    if source.name.lower().endswith(".toml"):
        return False
    return (
        _key(
            bytes_of(source, MAX_FILE_BYTES)
            .removeprefix(b"\xef\xbb\xbf")
            .lstrip()[:4]
            .decode("ascii", "replace")
        )
        is not None
    )


def read_basic_lengths(source: Path | Traversable, like: Machine) -> Tripod:
    """The machine of a file, named after it.

    Raises FileError with every fault, each with its line and columns.
    """
    file = str(source)
    raw = bytes_of(source, MAX_FILE_BYTES)
    refuse_utf16(file, raw)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(file, [utf8_fault(raw, error)]) from None
    found = _read(text)
    missing = [key for key in REQUIRED_KEYS if key not in found.values]
    if missing and not found.faults:
        found.faults.append(
            Fault("", f"missing: {', '.join(missing)}; each begins a line of its own", None)
        )
    if found.faults:
        raise FileError(file, found.faults)
    try:
        return _machine(found.values, Path(source.name).stem, like)
    except MotionError as error:
        raise FileError(file, [Fault("", str(error))]) from error


def _read(text: str) -> _Found:
    found = _Found({}, [])
    for number, whole in enumerate(text.splitlines(), 1):
        line = whole.lstrip()  # as Visual Basic's Input # does
        if not line.strip():
            continue
        key = _key(line)
        if key is None:
            first, known = line.split()[0], (*POINTS, *LENGTHS)
            told = (
                f"{describe_value(first)} begins no line of this file{nearest(first[:4], known)}; known "
                f"are {', '.join(known)}"
            )
            found.faults.append(
                Fault("", told, number, first, ", ".join(known), closest(first[:4], known))
            )
        elif key in found.values:
            found.faults.append(Fault(key, "appears twice", number))
        else:
            found.values[key] = _numbers(key, line, number, found.faults)
    return found


def _numbers(key: str, line: str, number: int, faults: list[Fault]) -> tuple[float, ...]:
    """The numbers in a line's columns; what stands between or behind them, the source's reader
    would drop.
    """
    columns = COORDINATES if key in POINTS else (LENGTHS[key],)
    values = []
    for low, high in columns:
        text = line[low:high].strip()
        if not _NUMBER.fullmatch(text):
            told = (
                f"columns {low + 1} to {high} should hold a number such as 12.3456, and hold "
                f"{describe_value(line[low:high])}"
            )
            faults.append(Fault(key, told, number, text))
            return (0.0,) * len(columns)
        values.append(float(text))
    first = columns[0][0]
    rest = "".join(
        letter
        for n, letter in enumerate(line)
        if n >= first and not any(low <= n < high for low, high in columns)
    )
    if rest.strip():
        told = (
            f"{describe_value(rest.strip())} stands outside the columns that hold its numbers; the "
            "source's reader drops it"
        )
        faults.append(Fault(key, told, number, rest.strip()))
    return tuple(values)


def _key(line: str) -> str | None:
    return next((key for key in (*POINTS, *LENGTHS) if line.startswith(key)), None)


def _machine(values: Mapping[str, tuple[float, ...]], name: str, like: Machine) -> Tripod:
    from scipy.spatial.transform import RigidTransform

    base, plate = (
        np.array([values[key] for key in keys]) / UNITS_PER_METRE for keys in (BASE, PLATE)
    )
    below = np.array([0.0, 0.0, values.get("Leng", (0.0,))[0]]) / UNITS_PER_METRE
    centre = np.array(values[CENTRE]) / UNITS_PER_METRE - below
    tool = np.array([0.0, 0.0, -values["Ende"][0]]) / UNITS_PER_METRE
    rest = _rest(base, plate)
    return Tripod(
        base,
        plate - centre,
        tool=tool,
        axes=like.axes,
        home=RigidTransform.from_translation(centre + tool),
        base_rest=rest,
        platform_rest=rest,
        max_tilt=np.pi / 3,
        name=name,
    )


def _rest(base: Array, plate: Array) -> tuple[float, float, float]:
    """Down where the plate hangs below the base, else up."""
    return (0.0, 0.0, -1.0 if plate[:, 2].mean() < base[:, 2].mean() else 1.0)
