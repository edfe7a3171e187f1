"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources.abc import Traversable
from itertools import pairwise
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.axis import Axis
from kinematics.clearance import Disc
from kinematics.document import Key, read
from kinematics.errors import FileError, MotionError
from kinematics.hexapod import Hexapod, joint_circle
from kinematics.machine import Machine
from kinematics.pose import Pose
from kinematics.registry import nearest
from kinematics.schema import Direction, File, Table, build, chosen, either, wrong
from kinematics.units import Angle, Length, Unit, shown


def read_machine(source: Path | Traversable) -> Machine:
    """The machine that a file describes, named after the file. Raises FileError with every fault of the file."""
    document = read(source)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "missing" if kind is None else f"{shown(kind)} is no kind of machine{nearest(str(kind), KINDS)}"
        known = ", ".join(map(shown, KINDS))
        raise FileError(document.file, [document.fault(("kind",), f"{told}; kinds: {known}")])
    schema, construct = KINDS[kind]
    model = build(document, schema, _named_once)
    try:
        return construct(model, Path(source.name).stem)
    except MotionError as error:  # what only the whole machine shows, such as a home pose out of reach
        raise FileError(document.file, [document.fault(("geometry",), str(error))]) from error


def _named_once(data: Mapping[str, Any]) -> Iterator[tuple[Key, str]]:
    """Every [[axis]] table after the first of its name."""
    seen = set()
    tables = data.get("axis", ())
    for n, table in enumerate(tables if isinstance(tables, tuple) else ()):
        name = table.get("name") if isinstance(table, dict) else None
        if isinstance(name, str) and name in seen:
            yield ("axis", n, "name"), f"{shown(name)} has an [[axis]] table already"
        seen.add(name if isinstance(name, str) else None)


def _sign(direction: int) -> int:
    if direction not in (1, -1):
        raise wrong(f"{direction} is neither 1 nor -1")
    return direction


def _rising(travel: tuple[float, float]) -> tuple[float, float]:
    if not travel[0] < travel[1]:
        raise wrong("empty travel: the first bound must be the smaller")
    return travel


def _rising_speeds(curve: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    if len(curve) < 2 or any(after[0] <= before[0] for before, after in pairwise(curve)):
        raise wrong("needs two or more [speed, force] points in the order of rising speed")
    return curve


def _tilt_type(value: object) -> Any:
    return tuple[Tilt, Tilt] if isinstance(value, tuple) else Tilt


def _rest_type(value: object) -> Any:
    return SixDirections if isinstance(value, tuple) and value and isinstance(value[0], tuple) else Direction


Travel = Annotated[tuple[Length, Length], AfterValidator(_rising)]
Pulse = Annotated[float, Unit("m", above=0)]
TorquePoint = tuple[Annotated[float, Unit("m/s", least=0)], Annotated[float, Unit("N", least=0)]]
Radius = Annotated[float, Unit("m", above=0)]
Thickness = Annotated[float, Unit("m", least=0)]
Gap = Annotated[float, Unit("rad", least=0, most=2 * pi / 3)]
Tilt = Annotated[float, Unit("rad", above=0, most=pi)]
Point = tuple[Length, Length, Length]
SixPoints = tuple[Point, Point, Point, Point, Point, Point]
SixDirections = tuple[Direction, Direction, Direction, Direction, Direction, Direction]
Rest = Annotated[tuple[Any, ...], chosen(_rest_type)]


class AxisLimits(Table):
    """Travel, wiring and limits of a linear axis, as far as the file states them; an absent limit is none."""

    travel: Travel | None = None
    pulse: Pulse | None = None
    direction: Annotated[int, AfterValidator(_sign)] | None = None
    max_speed: Annotated[float, Unit("m/s", above=0)] | None = None
    max_acceleration: Annotated[float, Unit("m/s^2", above=0)] | None = None
    max_jerk: Annotated[float, Unit("m/s^3", above=0)] | None = None
    max_force: Annotated[float, Unit("N", above=0)] | None = None
    torque_speed: Annotated[tuple[TorquePoint, ...], AfterValidator(_rising_speeds)] | None = None
    max_pulse_rate: Annotated[float, Unit("1/s", above=0)] | None = None


class AxisDefaults(AxisLimits):
    """What all axes have unless their own table says otherwise."""

    travel: Annotated[Travel, Field(description='write e.g. ["0 mm", "50 mm"]')]
    pulse: Pulse


class Leg(AxisLimits):
    """What one leg has of its own."""

    name: Literal["leg1", "leg2", "leg3", "leg4", "leg5", "leg6"]


class Home(Table):
    """The pose from which travel and pulses count: a position, turned by θx, θy, θz about the moving axes in turn."""

    to: tuple[Length, Length, Length]
    rotate: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0)

    @property
    def pose(self) -> Pose:
        return RigidTransform.from_components(self.to, Rotation.from_euler("XYZ", self.rotate))


class Plate(Table):
    """A platform's disc, in the platform's own frame."""

    radius: Radius
    thickness: Thickness
    centre: Point = (0.0, 0.0, 0.0)
    normal: Direction = (0.0, 0.0, 1.0)

    @property
    def disc(self) -> Disc:
        return Disc(self.radius, self.thickness, self.centre, self.normal)


class Platforms(Table):
    """What a hexapod's geometry has however its joints are given."""

    home: Home
    base_rest: Rest | None = None
    platform_rest: Rest | None = None
    max_tilt: Annotated[float | tuple[float, float], chosen(_tilt_type)] | None = None
    leg_radius: Radius | None = None
    leg_ends: Thickness | None = None
    base_disc: Plate | None = None
    platform_disc: Plate | None = None


class JointCircles(Platforms):
    """Joint centres in pairs on a circle of each platform; heights along z in the platform's own frame."""

    base_radius: Radius
    base_gap: Gap
    base_height: Length
    platform_radius: Radius
    platform_gap: Gap
    platform_height: Length

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return (
            joint_circle(self.base_radius, self.base_gap, self.base_height),
            joint_circle(self.platform_radius, self.platform_gap, self.platform_height),
        )


class JointPoints(Platforms):
    """Joint centres one by one, each in the frame of its platform."""

    base_joints: SixPoints
    platform_joints: SixPoints

    def joints(self) -> tuple[ArrayLike, ArrayLike]:
        return self.base_joints, self.platform_joints


class HexapodFile(File):
    """A hexapod's TOML, key by key."""

    kind: Literal["hexapod"]
    geometry: Annotated[JointCircles | JointPoints, either(JointCircles, JointPoints)]
    axes: AxisDefaults
    axis: tuple[Leg, ...] = ()


def _hexapod(file: HexapodFile, name: str) -> Hexapod:
    geometry = file.geometry
    base, platform = geometry.joints()
    return Hexapod(
        base,
        platform,
        axes=_axes([f"leg{n}" for n in range(1, 7)], file.axes, file.axis),
        home=geometry.home.pose,
        base_rest=geometry.base_rest,
        platform_rest=geometry.platform_rest,
        max_tilt=geometry.max_tilt,
        name=name,
        leg_radius=geometry.leg_radius,
        leg_ends=geometry.leg_ends,
        base_disc=geometry.base_disc.disc if geometry.base_disc else None,
        platform_disc=geometry.platform_disc.disc if geometry.platform_disc else None,
    )


def _axes(names: Sequence[str], defaults: AxisLimits, overrides: Sequence[Leg]) -> list[Axis]:
    common = defaults.model_dump(exclude_none=True)
    own: dict[str, dict[str, Any]] = {override.name: override.model_dump(exclude_none=True) for override in overrides}
    return [Axis(**{"name": name, **common, **own.get(name, {})}) for name in names]


KINDS: dict[str, tuple[type[File], Callable[[Any, str], Machine]]] = {
    "hexapod": (HexapodFile, _hexapod),
}
"""Every kind of machine: the schema of its file, and what makes the machine of a valid one and its name."""
