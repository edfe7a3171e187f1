"""A traverser's TOML."""

from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated, Any, Literal

from kinematics.kinds.axes import LinearAxis, LinearDefaults, RotaryAxis, axes
from kinematics.kinds.masses import LoadedFile
from kinematics.kinds.poses import Home
from kinematics.schema import Direction, Table, chosen
from kinematics.traverser import Traverser
from kinematics.units import Unit

SLIDES, ROTARY = ("X", "Y", "Z"), "R"


class Geometry(Table):
    """How a traverser is built.

    home        the pose from which travel and pulses count
    directions  of the slides X, Y and Z in the base frame; the base axes if not stated
    length      that counts as one radian where lengths and angles meet
    """

    home: Home
    directions: tuple[Direction, Direction, Direction] | None = None
    length: Annotated[float, Unit("m", above=0)] = 0.1


class OwnSlide(LinearAxis):
    name: Literal["X", "Y", "Z"]


class OwnRotary(RotaryAxis):
    name: Literal["R"]


def _own(value: Any) -> type[Table]:
    return OwnRotary if isinstance(value, dict) and value.get("name") == ROTARY else OwnSlide


class TraverserFile(LoadedFile):
    """A traverser, key by key: `axes` is what the slides have, `rotary` what the turning axis has."""

    kind: Literal["traverser"]
    geometry: Geometry
    axes: LinearDefaults
    rotary: RotaryAxis
    axis: tuple[Annotated[Any, chosen(_own)], ...] = ()


def traverser(file: TraverserFile, name: str, folder: Path | Traversable) -> Traverser:
    return Traverser(
        axes=axes((*SLIDES, ROTARY), dict.fromkeys(SLIDES, file.axes) | {ROTARY: file.rotary}, file.axis, file),
        home=file.geometry.home.pose,
        directions=file.geometry.directions,
        length=file.geometry.length,
        name=name,
        load=file.load(),
    )
