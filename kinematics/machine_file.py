"""Machine files: the schema of each kind's TOML, and the machine that one describes."""

from collections.abc import Callable
from importlib.resources import files
from importlib.resources.abc import Traversable
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal

from numpy.typing import ArrayLike

from kinematics.clearance import Disc
from kinematics.document import read
from kinematics.errors import FileError, MotionError
from kinematics.hexapod import Hexapod, joint_circle
from kinematics.kinds.arm import ArmFile, arm
from kinematics.kinds.axes import LinearAxis, LinearDefaults, axes, named_once, one_pulse
from kinematics.kinds.linkage import LinkageFile, linkage
from kinematics.kinds.poses import Home, Point
from kinematics.kinds.traverser import TraverserFile, traverser
from kinematics.machine import Machine
from kinematics.registry import nearest
from kinematics.schema import Direction, File, Table, build, chosen, either
from kinematics.units import Length, Unit, shown


def read_machine(source: Path | Traversable) -> Machine:
    """The machine that a file describes, named after the file. Raises FileError with every fault of the file."""
    document = read(source)
    kind = document.data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        told = "missing" if kind is None else f"{shown(kind)} is no kind of machine{nearest(str(kind), KINDS)}"
        known = ", ".join(map(shown, KINDS))
        raise FileError(document.file, [document.fault(("kind",), f"{told}; kinds: {known}")])
    schema, construct = KINDS[kind]
    model = build(document, schema, named_once, one_pulse)
    folder = source.parent if isinstance(source, Path) else files("kinematics") / "presets"
    try:
        return construct(model, Path(source.name).stem, folder)
    except MotionError as error:  # what only the whole machine shows, such as a home pose out of reach
        raise FileError(document.file, [document.fault(("geometry",), str(error))]) from error


def _tilt_type(value: object) -> Any:
    return tuple[Tilt, Tilt] if isinstance(value, tuple) else Tilt


def _rest_type(value: object) -> Any:
    return SixDirections if isinstance(value, tuple) and value and isinstance(value[0], tuple) else Direction


Radius = Annotated[float, Unit("m", above=0)]
Thickness = Annotated[float, Unit("m", least=0)]
Gap = Annotated[float, Unit("rad", least=0, most=2 * pi / 3)]
Tilt = Annotated[float, Unit("rad", above=0, most=pi)]
SixPoints = tuple[Point, Point, Point, Point, Point, Point]
SixDirections = tuple[Direction, Direction, Direction, Direction, Direction, Direction]
Rest = Annotated[tuple[Any, ...], chosen(_rest_type)]


class Leg(LinearAxis):
    """What one leg has of its own."""

    name: Literal["leg1", "leg2", "leg3", "leg4", "leg5", "leg6"]


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
    axes: LinearDefaults
    axis: tuple[Leg, ...] = ()


LEGS = tuple(f"leg{n}" for n in range(1, 7))


def _hexapod(file: HexapodFile, name: str, folder: Path | Traversable) -> Hexapod:
    geometry = file.geometry
    base, platform = geometry.joints()
    return Hexapod(
        base,
        platform,
        axes=axes(LEGS, dict.fromkeys(LEGS, file.axes), file.axis),
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


KINDS: dict[str, tuple[type[File], Callable[[Any, str, Path | Traversable], Machine]]] = {
    "hexapod": (HexapodFile, _hexapod),
    "linkage": (LinkageFile, linkage),
    "traverser": (TraverserFile, traverser),
    "arm": (ArmFile, arm),
}
"""Every kind of machine: the schema of its file, and what makes the machine of a valid one, its name and folder."""
