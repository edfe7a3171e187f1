"""Keys of input shapers: `shaper` of an axis, and `[[vibration]]` of what the machine carries along
a direction.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import AfterValidator, AllowInfNan, Field, ValidationInfo, field_validator

from kinematics.files.keys import Chosen, key
from kinematics.files.schema import Direction, TableSchema
from kinematics.foundation.arrays import unit_vectors
from kinematics.foundation.errors import BadValue, MotionError, validation_error
from kinematics.foundation.names import closest, nearest
from kinematics.foundation.units import Unit, describe_value
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

    kind: ShaperKind = key("zv, mzv, zvd or ei, from the shortest to the most robust", '"zv"')
    frequency: Annotated[
        float, Unit("Hz", least=LEAST_FREQUENCY, most=MOST_FREQUENCY, like="35 Hz", file_unit="Hz")
    ] = key("frequency of the vibration", '"35 Hz"')
    damping: Annotated[float, Field(ge=0, le=MOST_DAMPING), AllowInfNan(False)] = key(
        "damping ratio of the vibration", "0.05", 0.0
    )
    tolerance: Annotated[float, Field(ge=0, le=MOST_TOLERANCE), AllowInfNan(False)] | None = key(
        "for ei: share of the vibration that may remain; 0.05 if not stated", default=None
    )

    @field_validator("tolerance")
    @classmethod
    def _check_tolerance(cls, tolerance: float | None, info: ValidationInfo) -> float | None:
        kind = info.data.get("kind", "ei")  # of one that is none, that alone is told
        if tolerance is not None and kind != "ei":
            raise validation_error(
                f'tolerance is of the shaper ei, not of {kind}: omit it, or write kind = "ei"'
            )
        return tolerance

    @property
    def shaper(self) -> Shaper:
        return Shaper(**self.model_dump(include=set(ShaperTable.model_fields), exclude_none=True))


NO_SHAPER = "none"
"""What an axis says that has not the shaper that all have."""


def _show_table(kind: str) -> str:
    return f'{{ kind = "{kind}", frequency = "35 Hz" }}'


def _pick_shaper(value: Any) -> Any:
    if isinstance(value, str) and value != NO_SHAPER:
        if value in get_args(ShaperKind):
            raise validation_error(
                f'"{value}" needs the frequency of the vibration: write {_show_table(value)}'
            )
        near = nearest(value, (NO_SHAPER, *get_args(ShaperKind)))
        told = f'is neither "{NO_SHAPER}" nor a table{near}: write "{NO_SHAPER}", or e.g. {_show_table("zv")}'
        raise validation_error(
            BadValue(f"{describe_value(value)} {told}", nearest=closest(value, (NO_SHAPER,)))
        )
    if value == ():
        raise validation_error(
            f'[] names no shaper: omit the key, or write "{NO_SHAPER}" where all other axes have one'
        )
    if isinstance(value, tuple):
        return tuple[Annotated[Any, Chosen(_pick_table)], ...]
    return Literal["none"] if isinstance(value, str) else _pick_table(value)


def _pick_table(value: Any) -> Any:
    if not isinstance(value, dict):
        raise validation_error(
            f"{describe_value(value)} is not a table: write e.g. {_show_table('zv')}"
        )
    return ShaperTable


def _join(stated: Any) -> Shaper | ShaperSeries | str:
    if stated == NO_SHAPER:
        return NO_SHAPER
    try:
        return (
            join_shapers(
                [each.shaper for each in (stated if isinstance(stated, tuple) else (stated,))]
            )
            or NO_SHAPER
        )
    except MotionError as error:
        raise validation_error(error) from None


StatedShaper = Annotated[Any, Chosen(_pick_shaper), AfterValidator(_join)]


class VibrationTable(ShaperTable):
    """A vibration along a direction: every axis that moves the platform along it has this shaper
    beside its own.
    """

    direction: Direction = key(
        "direction of the vibration in the base frame", "[1, 0, 0]", remedy="write e.g. [1, 0, 0]"
    )


SAME_SHARE = 1e-3
"""Of a frequency, a damping ratio and a direction's angle (rad), by which two vibrations are one:
far below what any measurement tells apart.
"""


def find_repeated(vibrations: Sequence[VibrationTable]) -> tuple[int, int] | None:
    """The first two that are one and the same, which would be shaped against twice; None where
    there are none.

    A direction and its opposite are the same.
    """
    lines = [unit_vectors(each.direction, "direction", (3,)) for each in vibrations]
    for k, later in enumerate(vibrations):
        for n, one in enumerate(vibrations[:k]):
            near = abs(later.frequency - one.frequency) <= SAME_SHARE * one.frequency
            near &= abs(later.damping - one.damping) <= SAME_SHARE
            if (
                near
                and later.kind == one.kind
                and np.linalg.norm(np.cross(lines[n], lines[k])) <= SAME_SHARE
            ):
                return n, k
    return None
