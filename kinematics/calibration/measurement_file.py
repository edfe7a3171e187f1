"""Measurement files: the schema of their TOML, and the measurements that one holds."""

from os import PathLike
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from kinematics.calibration.measurements import (
    AXIS,
    MAX_HOME_DISTANCE,
    POSITION,
    Measurements,
    Noise,
)
from kinematics.files.keys import Chosen, key
from kinematics.files.schema import (
    File,
    TableSchema,
    build,
    one_of_tables,
    read_declared_units,
    unit_validator,
)
from kinematics.files.toml_document import read
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import validation_error
from kinematics.foundation.names import find
from kinematics.foundation.units import Unit
from kinematics.machine.pose import make_pose

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from kinematics.machine.pose import Pose

PLAIN_UNITS = {"length": "m", "angle": "rad", "error": "m"}
"""The declarations that give plain numbers their unit, and the SI unit of each; "error" is of
lengths in errors.
"""
DEFAULT_UNITS = {"length": "mm", "angle": "deg", "error": "um"}
"""What plain numbers are where a file declares nothing: as coordinate measuring machines print
them.
"""
UNIT_LENGTH_TOLERANCE = 5e-3
"""How far the cosines of direction angles may be from a unit vector: angles to 0.3°, or differences
of such.
"""
SAME_ANGLE = np.deg2rad(0.01)
"""How far θ and the direction angles of one command may be apart: half a unit of the second decimal
of a degree.
"""


MeasurementSource = Measurements | str | PathLike[str]
"""Measurements, or what `load_measurements` loads them from."""


def load_measurements(name_or_path: MeasurementSource) -> Measurements:
    """Load measurements of poses.

    Each [[pose]] says what was commanded and what was measured, from the home pose, in one of two
    ways: commanded and measured, both x, y, z, θx, θy, θz (measured: or x, y, z alone); or, as
    coordinate measuring machines see a plane, desired = x, y, z and the direction angles α, β, γ of
    the platform's z axis, and error = desired − measured. Each [[rotation]] is a check that nothing
    is fitted to: direction angles of a turn θ, at the position `at`.

    Parameters
    ----------
    name_or_path
        Name of bundled measurements, or path of a TOML file. Measurements stay as they are.

    Returns
    -------
    Measurements
        Commanded and measured poses, and what is known of their noise.

    Raises
    ------
    FileError
        The file has faults; all of them are told, with their lines.
    MotionError
        The name is unknown; the nearest and all known ones are told.
    """
    if isinstance(name_or_path, Measurements):
        return name_or_path
    source = find("kinematics.calibration", "measurement file", name_or_path)
    document = read(source)
    model = build(
        document,
        MeasurementFile,
        plain=read_declared_units({**DEFAULT_UNITS, **document.data}, PLAIN_UNITS),
    )
    from scipy.spatial.transform import RigidTransform

    entries: list[tuple[str, DirectionPose | WholePose | TurnedAxis]] = [
        (f"pose {k + 1}", entry) for k, entry in enumerate(model.pose)
    ]
    entries += [(f"rotation {k + 1}", entry) for k, entry in enumerate(model.rotation)]
    rows = [entry.row() for _, entry in entries]
    return Measurements(
        commanded=RigidTransform.concatenate([row.commanded for row in rows]),
        measured=RigidTransform.concatenate([row.measured for row in rows]),
        seen=freeze_array([row.seen for row in rows], bool),
        spread=freeze_array([row.spread for row in rows]),
        labels=tuple(
            name if entry.table is None else f"{name} ({entry.table})" for name, entry in entries
        ),
        fit=freeze_array(np.arange(len(rows)) < len(model.pose), bool),
        noise=None if model.noise is None else Noise(model.noise.position, model.noise.rotation),
        name=document.file,
        notes=tuple(
            f"{name}: the file gives no position `at` of the rotation, so home is assumed"
            for name, entry in entries
            if isinstance(entry, TurnedAxis) and "at" not in entry.model_fields_set
        ),
        lines=tuple(
            document.line((kind, k))
            for kind in ("pose", "rotation")
            for k in range(len(getattr(model, kind)))
        ),
        machine=model.machine or "",
    )


class PoseRow(NamedTuple):
    """What a table says of one pose; the last two by `measurements.COMPONENTS`."""

    commanded: "Pose"
    measured: "Pose"
    seen: np.ndarray
    spread: Array


def _unit_direction(angles: tuple[float, ...]) -> Array:
    """The unit vector of direction angles, which are redundant."""
    cosines = np.cos(angles)
    length = float(np.linalg.norm(cosines))
    if abs(length - 1) > UNIT_LENGTH_TOLERANCE:
        shown_angles = ", ".join(f"{angle:.6g}" for angle in np.rad2deg(angles))
        raise validation_error(
            f"{shown_angles} deg are not direction angles of an axis: the sum of cos² is {length**2:.4f} instead of 1"
        )
    return np.asarray(cosines / length)


def _direction_of_six(desired: tuple[float, ...]) -> tuple[float, ...]:
    _unit_direction(desired[3:])
    return desired


def _rotation_to_axis(axis: Array) -> "Rotation":
    """Rx(θx) · Ry(θy), whose z axis is the given one: a direction says nothing of the turn about
    itself.
    """
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("XYZ", [np.arctan2(-axis[1], axis[2]), np.arcsin(axis[0]), 0.0])


def _axis_row(
    at: tuple[float, ...], turn: "Rotation", error: tuple[float, ...], axis: Array, spread: Array
) -> PoseRow:
    """A row with an axis measured, and a position where `error` has one."""
    from scipy.spatial.transform import RigidTransform

    position = np.array(at) - (error[:3] if len(error) == 6 else 0.0)
    # of the measured rotation only its z axis means anything; its x and y name the two components
    # of the axis' error
    measured = RigidTransform.from_components(position, _rotation_to_axis(axis))
    seen = np.arange(8) >= AXIS.start
    seen[POSITION] = len(error) == 6
    return PoseRow(RigidTransform.from_components(at, turn), measured, seen, spread)


def _spread_components(position: tuple[float, ...], angles: tuple[float, ...]) -> Array:
    """An axis near z turns about y by its α and about x by its β."""
    return np.array([*position, np.nan, np.nan, np.nan, angles[1], angles[0]])


def _place_type(value: object) -> Any:
    return Place if isinstance(value, tuple) and len(value) == 3 else PlaceAndTurn


def _require_poses(poses: tuple[Any, ...]) -> tuple[Any, ...]:
    if not poses:
        raise validation_error(f"empty: {_POSE_REMEDY}")
    return poses


_POSE_REMEDY = "give at least one [[pose]] that was measured"

Coordinate = Annotated[
    float, Unit("m", least=-MAX_HOME_DISTANCE, most=MAX_HOME_DISTANCE, plain="length")
]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
ErrorLength = Annotated[
    float, Unit("m", least=-MAX_HOME_DISTANCE, most=MAX_HOME_DISTANCE, plain="error")
]
SpreadLength = Annotated[float, Unit("m", least=0, plain="error")]
SpreadAngle = Annotated[float, Unit("rad", least=0, plain="angle")]
Place = tuple[Coordinate, Coordinate, Coordinate]
Angles = tuple[PlainAngle, PlainAngle, PlainAngle]
PlaceAndTurn = tuple[Coordinate, Coordinate, Coordinate, PlainAngle, PlainAngle, PlainAngle]
PlaceAndAxis = Annotated[PlaceAndTurn, AfterValidator(_direction_of_six)]
Error = tuple[ErrorLength, ErrorLength, ErrorLength, PlainAngle, PlainAngle, PlainAngle]
Spread = tuple[SpreadLength, SpreadLength, SpreadLength, SpreadAngle, SpreadAngle, SpreadAngle]


class PublishedTable(TableSchema):
    """Where a figure was published, and of how many repetitions it is the mean."""

    table: str | None = key("publication and table of the measurement", default=None)
    n: Annotated[int, Field(ge=1)] | None = key("number of repetitions in the mean", default=None)


class DirectionPose(PublishedTable):
    """A pose with the direction of the platform's z axis, as its error from what was commanded."""

    desired: PlaceAndAxis = key("x, y, z and direction angles α, β, γ of the platform's z axis")
    error: Error = key("desired − measured")
    spread: Spread | None = key("largest deviation of repetitions from their mean", default=None)

    @model_validator(mode="after")
    def _measured_axis(self) -> Self:
        self.axis()
        return self

    def axis(self) -> Array:
        return _unit_direction(tuple(np.subtract(self.desired[3:], self.error[3:])))

    def row(self) -> PoseRow:
        spread = (
            np.full(8, np.nan)
            if self.spread is None
            else _spread_components(self.spread[:3], self.spread[3:])
        )
        turn = _rotation_to_axis(_unit_direction(self.desired[3:]))
        return _axis_row(self.desired[:3], turn, self.error, self.axis(), spread)


class WholePose(PublishedTable):
    """A pose as position and rotation, or its position alone."""

    commanded: PlaceAndTurn = key("commanded x, y, z, θx, θy, θz from home")
    measured: Annotated[tuple[float, ...], Chosen(_place_type)] = key(
        "measured x, y, z, θx, θy, θz from home, or x, y, z alone"
    )

    def row(self) -> PoseRow:
        whole = len(self.measured) == 6
        measured = make_pose(self.measured[:3], self.measured[3:] if whole else [0.0, 0.0, 0.0])
        commanded = make_pose(self.commanded[:3], self.commanded[3:])
        return PoseRow(commanded, measured, np.arange(8) < (6 if whole else 3), np.full(8, np.nan))


class TurnedAxis(PublishedTable):
    """The direction of the platform's z axis after a turn θ."""

    theta: Angles = key("θx, θy, θz of the rotation")
    desired: Angles = key("direction angles of z after the rotation")
    error: Angles = key("desired − measured")
    spread: tuple[SpreadAngle, SpreadAngle, SpreadAngle] | None = key(
        "largest deviation of repetitions from their mean", default=None
    )
    at: Place = key("position of the rotation", default=(0.0, 0.0, 0.0))

    @model_validator(mode="after")
    def _same_command(self) -> Self:
        from scipy.spatial.transform import Rotation

        axis, turned = (
            _unit_direction(self.desired),
            Rotation.from_euler("XYZ", self.theta).as_matrix()[:, 2],
        )
        if np.linalg.norm(np.cross(axis, turned)) > SAME_ANGLE:
            angles = np.rad2deg(np.arccos(turned))
            raise validation_error(
                f"desired is not the direction of z after theta, {', '.join(f'{a:.6g}' for a in angles)} deg"
            )
        _unit_direction(tuple(np.subtract(self.desired, self.error)))
        return self

    def row(self) -> PoseRow:
        from scipy.spatial.transform import Rotation

        axis = _unit_direction(tuple(np.subtract(self.desired, self.error)))
        nothing = (np.nan, np.nan, np.nan)
        spread = _spread_components(nothing, self.spread or nothing)
        return _axis_row(self.at, Rotation.from_euler("XYZ", self.theta), self.error, axis, spread)


class InitialPose(PublishedTable):
    """What was measured at home: error = measured − desired; the errors of the poses have it taken
    out already.
    """

    desired: PlaceAndAxis = key(
        "desired home: x, y, z and direction angles α, β, γ of the platform's z axis"
    )
    error: Error = key("measured − desired")
    spread: Spread | None = key("largest deviation of repetitions from their mean", default=None)


class NoiseTable(TableSchema):
    """Standard deviation of one component of a position and of a rotation."""

    position: Annotated[float, Unit("m", above=0, like="5 um")] = key(
        "standard deviation of one component of a position"
    )
    rotation: Annotated[float, Unit("rad", above=0, like="20 urad")] = key(
        "standard deviation of one component of a rotation"
    )


PoseTable = Annotated[DirectionPose | WholePose, one_of_tables(DirectionPose, WholePose)]


class MeasurementFile(File):
    """A measurement file's TOML, key by key."""

    what: ClassVar[str] = "measurement file"
    version: Literal[1] = key(
        "version of the file format; 1 if not stated", default=1, alias="schema"
    )
    length: Annotated[str, unit_validator("m")] | None = key(
        "unit of plain numbers that are lengths; mm if not stated", default=None
    )
    angle: Annotated[str, unit_validator("rad")] | None = key(
        "unit of plain angles; deg if not stated", default=None
    )
    error: Annotated[str, unit_validator("m")] | None = key(
        "unit of plain lengths in errors; um if not stated", default=None
    )
    machine: str | None = key("name of the measured machine; any other is refused", default=None)
    noise: NoiseTable | None = key(
        "standard deviations of the measurement; estimated if not stated", default=None
    )
    initial: InitialPose | None = key("measurement at home", default=None)
    pose: Annotated[tuple[PoseTable, ...], AfterValidator(_require_poses)] = key(
        "poses to which parameters are fitted", remedy=_POSE_REMEDY
    )
    rotation: tuple[TurnedAxis, ...] = key(
        "rotations for checks; nothing is fitted to them", default=()
    )
