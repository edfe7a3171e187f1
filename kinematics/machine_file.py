"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable, Sequence
from importlib.resources.abc import Traversable
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field, ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.array import Array
from kinematics.axis import Axis
from kinematics.errors import FileError, MotionError
from kinematics.files import Direction, Table, build, chosen, either, read, wrong
from kinematics.hexapod import Hexapod, joint_circle
from kinematics.machine import Machine
from kinematics.pose import Pose
from kinematics.registry import nearest
from kinematics.units import Angle, Length, Unit, shown


def read_machine(source: Path | Traversable) -> Machine:
    """The machine that a file describes. Raises FileError with every fault of the file."""
    document = read(source)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "missing" if kind is None else f"{shown(kind)} is no kind of machine{nearest(str(kind), KINDS)}"
        fault = document.fault(("kind",), f"{told}; write kind = one of {', '.join(map(shown, KINDS))}")
        raise FileError(document.file, [fault])
    schema, construct = KINDS[kind]
    model = build(document, schema)
    try:
        return construct(model, Path(source.name).stem)
    except MotionError as error:  # what only the whole machine shows, such as two joints in one place
        raise FileError(document.file, [document.fault((), str(error))]) from error


def _rising(travel: tuple[float, float]) -> tuple[float, float]:
    if not travel[0] < travel[1]:
        raise wrong("empty travel: the first bound must be the smaller")
    return travel


def _falling_curve(points: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(points) < 2 or any(b[0] <= a[0] for a, b in zip(points, points[1:], strict=False)):
        raise wrong("needs two or more [speed, force] points, in the order of rising speed")
    return points


def _named_once(axes: tuple["Leg", ...]) -> tuple["Leg", ...]:
    names = [axis.name for axis in axes]
    again = [n for n, name in enumerate(names) if name in names[:n]]
    if again:
        faults = [{"type": wrong(f"{names[n]} has an [[axis]] already"), "loc": (n, "name"), "input": names[n]} for n in again]
        raise ValidationError.from_exception_data("axis", faults)
    return axes


Travel = Annotated[tuple[Length, Length], AfterValidator(_rising)]
Pulse = Annotated[float, Unit("m", above=0)]
Radius = Annotated[float, Unit("m", above=0)]
Gap = Annotated[float, Unit("rad", least=0, most=2 * pi / 3)]
Tilt = Annotated[float, Unit("rad", above=0, most=pi)]
Force = Annotated[float, Unit("N", least=0)]
Point = tuple[Length, Length, Length]
SixPoints = tuple[Point, Point, Point, Point, Point, Point]
SixDirections = tuple[Direction, Direction, Direction, Direction, Direction, Direction]


class AxisLimits(Table):
    """Limits and wiring of a linear axis, as far as they are stated; no key is an absent limit."""

    travel: Travel | None = None
    pulse: Pulse | None = None
    direction: Literal[1, -1] | None = None
    max_speed: Annotated[float, Unit("m/s", above=0)] | None = None
    max_acceleration: Annotated[float, Unit("m/s^2", above=0)] | None = None
    max_jerk: Annotated[float, Unit("m/s^3", above=0)] | None = None
    max_force: Annotated[float, Unit("N", above=0)] | None = None
    torque_speed: (
        Annotated[
            tuple[tuple[Annotated[float, Unit("m/s", least=0)], Annotated[float, Unit("N", least=0)]], ...],
            AfterValidator(_falling_curve),
        ]
        | None
    ) = None
    max_pulse_rate: Annotated[float, Unit("1/s", above=0)] | None = None
