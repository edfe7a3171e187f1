"""Program files, read: the program that one describes (its schema: planner.entries)."""

from os import PathLike
from pathlib import Path

from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.document import read
from kinematics.errors import Fault, FileError, MotionError
from kinematics.pose import Pose
from kinematics.registry import find, presets
from kinematics.schema import build, declared
from planner.entries import ProgramFile
from planner.program import Program

PLAIN_UNITS = {"length": "m", "angle": "rad"}
"""The declarations that give plain numbers their unit, and the SI unit of each."""


def load_program(name_or_path: str | PathLike[str]) -> Program:
    """The program of a preset's name or of a TOML file.

    Raises FileError with every fault of the file; MotionError for an unknown name, with the nearest and all known ones.
    """
    source = find("planner", "program", name_or_path)
    try:
        document = read(source)
    except FileError as error:
        raise _elsewhere(Path(source.name), error) from None
    model = build(document, ProgramFile, plain=declared(document.data, PLAIN_UNITS))
    segments = [entry.segment(document.line(("segment", n))) for n, entry in enumerate(model.segment)]
    return Program(
        tuple(segments),
        model.frame,
        _pose(model.start),
        model.machine,
        Path(source.name).stem,
        duration=model.duration,
        speed=model.speed,
        acceleration=model.acceleration,
        angular_speed=model.angular_speed,
        tool=None if model.tool is None else model.tool.pose,
        work=None if model.work is None else model.work.pose,
        repeat=model.repeat,
        start_speed=model.start_speed,
        end_speed=model.end_speed,
        file=document.file,
    )


def _elsewhere(path: Path, error: FileError) -> FileError:
    """The error, with what to do where the file's suffix is that of a format that programs are imported from."""
    from planner.sources.registry import source_name

    try:
        told = f"by its suffix it is {source_name(path)}: make a program of it by pulsepath import"
    except MotionError:
        return error
    return FileError(error.file, [*error.faults, Fault("", told, error.faults[-1].line)])


def program_names() -> tuple[str, ...]:
    """Names of the bundled programs."""
    return tuple(presets("planner"))


def _pose(start: tuple[float, ...] | None) -> Pose | None:
    if start is None:
        return None
    angles = start[3:] or (0.0, 0.0, 0.0)
    return RigidTransform.from_components(start[:3], Rotation.from_euler("XYZ", angles))
