"""Program files: the schema of their TOML, and the program that one describes."""

from os import PathLike
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, Field
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.errors import FileError, MotionError
from kinematics.files import Document, Number, Table, build, chosen, either, read, wrong
from kinematics.pose import Pose
from kinematics.registry import find, presets
from kinematics.units import Unit, quantity
from planner.program import Arc, Blend, Dwell, Frame, Join, Line, Program, Segment, Stop, Turn

PLAIN_UNITS = {"length": "m", "angle": "rad"}
"""The declarations that give plain numbers their unit, and the SI unit of each."""

Coordinate = Annotated[float, Unit("m", plain="length")]
PlainAngle = Annotated[float, Unit("rad", plain="angle")]
ToolSpeed = Annotated[float, Unit("m/s", above=0)]
Position = tuple[Coordinate, Coordinate, Coordinate]
Orientation = tuple[PlainAngle, PlainAngle, PlainAngle]


def load_program(name_or_path: str | PathLike[str]) -> Program:
    """The program of a preset's name or of a TOML file.

    Raises FileError with every fault of the file; MotionError for an unknown name, with the nearest and all known ones.
    """
    source = find("planner", "program", name_or_path)
    document = read(source)
    scales = {name: _scale(document.data[name], unit) for name, unit in PLAIN_UNITS.items() if name in document.data}
    model = build(document, ProgramFile, scales)
    return model.program(document, Path(source.name).stem)


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    return tuple(presets("planner"))


def _scale(declared: object, unit: str) -> float:
    """SI value of one declared unit; 1 for a faulty declaration, which is a fault of its own."""
    try:
        return quantity(f"1 {declared}", unit)
    except MotionError:
        return 1.0


def _unit_of(unit: str) -> AfterValidator:
    def validate(name: str) -> str:
        try:
            quantity(f"1 {name}", unit)
        except MotionError as error:
            raise wrong(str(error)) from None
        return name

    return AfterValidator(validate)
