"""Keys of input shapers: `shaper` of an axis, and `[[vibration]]` of what the machine carries along a direction."""

from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import AfterValidator, AllowInfNan, Field

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Direction, TableSchema
from kinematics.foundation.errors import MotionError, validation_error
from kinematics.foundation.units import Unit
from kinematics.machine.shaper import (
    LEAST_FREQUENCY,
    MOST_DAMPING,
    MOST_FREQUENCY,
    MOST_TOLERANCE,
    Shaper,
    ShaperKind,
    ShaperSeries,
    join_shapers,
)


class ShaperTable(TableSchema):
    """The shaper of an axis, and the vibration that it is for."""

    kind: ShaperKind = key("zv, mzv, zvd or ei: from the shortest to the most robust", '"zv"')
    frequency: Annotated[
        float, Unit("Hz", least=LEAST_FREQUENCY, most=MOST_FREQUENCY, like="35 Hz", file_unit="Hz")
    ] = key("of the vibration", '"35 Hz"')
    damping: Annotated[float, Field(ge=0, le=MOST_DAMPING), AllowInfNan(False)] = key("its damping ratio", "0.05", 0.0)
    tolerance: Annotated[float, Field(ge=0, le=MOST_TOLERANCE), AllowInfNan(False)] | None = key(
        "of ei: the share of the vibration that may be left; 0.05 if not stated", default=None
    )

    @property
    def shaper(self) -> Shaper:
        return Shaper(**self.model_dump(include=set(ShaperTable.model_fields), exclude_none=True))


NO_SHAPER = "none"
"""What an axis says that has not the shaper that all have."""


S = TypeVar("S", bound=ShaperTable)


def _check_tolerance(stated: S) -> S:
    if stated.tolerance is not None and stated.kind != "ei":
        raise validation_error(f"tolerance is of the shaper ei, not of {stated.kind}: omit it")
    return stated


OneShaper = Annotated[ShaperTable, AfterValidator(_check_tolerance)]


def _pick_shaper(value: Any) -> Any:
    if isinstance(value, str):
        if value in get_args(ShaperKind):
            told = f'"{value}" needs the frequency of the vibration: write {{ kind = "{value}", frequency = "35 Hz" }}'
            raise validation_error(told)
        return Literal["none"]
    return tuple[OneShaper, ...] if isinstance(value, tuple) else OneShaper


def _join(stated: Any) -> Shaper | ShaperSeries | str:
    if stated == NO_SHAPER:
        return NO_SHAPER
    try:
        return join_shapers([each.shaper for each in (stated if isinstance(stated, tuple) else (stated,))]) or NO_SHAPER
    except MotionError as error:
        raise validation_error(error) from None


StatedShaper = Annotated[Any, Chosen(_pick_shaper), AfterValidator(_join)]


class VibrationTable(ShaperTable):
    """A vibration along a direction: every axis that moves the platform along it has this shaper beside its own."""

    direction: Direction = key("of the vibration, in the base frame", "[1, 0, 0]", remedy="write e.g. [1, 0, 0]")


Vibration = Annotated[VibrationTable, AfterValidator(_check_tolerance)]
