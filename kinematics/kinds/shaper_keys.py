"""The key `shaper` of an axis: which input shaper it has, and against which vibration."""

from typing import Annotated, Any

from pydantic import AfterValidator, AllowInfNan, Field

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import TableSchema
from kinematics.foundation.errors import validation_error
from kinematics.foundation.units import Unit
from kinematics.machine.shaper import (
    LEAST_FREQUENCY,
    MOST_DAMPING,
    MOST_FREQUENCY,
    MOST_TOLERANCE,
    Shaper,
    ShaperKind,
)


class ShaperTable(TableSchema):
    """The shaper of an axis, and the vibration that it is for."""

    kind: ShaperKind = key("zv, zvd, mzv or ei: from the shortest to the most robust")
    frequency: Annotated[
        float, Unit("Hz", least=LEAST_FREQUENCY, most=MOST_FREQUENCY, like="35 Hz", file_unit="Hz")
    ] = key("of the vibration")
    damping: Annotated[float, Field(ge=0, le=MOST_DAMPING), AllowInfNan(False)] = key("its damping ratio", default=0.0)
    tolerance: Annotated[float, Field(ge=0, le=MOST_TOLERANCE), AllowInfNan(False)] | None = key(
        "of ei: the share of the vibration that may be left; 0.05 if not stated", default=None
    )


def _shaper(stated: ShaperTable) -> Shaper:
    if stated.tolerance is not None and stated.kind != "ei":
        raise validation_error(f"tolerance is of the shaper ei, not of {stated.kind}: omit it")
    return Shaper(**stated.model_dump(exclude_none=True))


StatedShaper = Annotated[Any, Chosen(lambda _: ShaperTable), AfterValidator(_shaper)]
