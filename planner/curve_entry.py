"""The schema of a segment by equations.

    [[segment]]
    curve = { x = "r*cos(t)", y = "r*sin(t)", z = 25, from = 0, to = "2*pi", constants = { r = 15 } }

t is a number without a unit, and sin, cos and tan take radians, whatever the file declares. The equations must begin
where the path stands, and be smooth.
"""

from typing import Annotated, Self

from casadi import SX
from pydantic import AfterValidator, Field, PlainValidator, ValidationInfo, model_validator

from kinematics.errors import MotionError
from kinematics.schema import Number, Table, wrong
from kinematics.units import shown
from planner.entry import Drawn
from planner.formula import check_names, constant, formula
from planner.program import Curve, Segment


def _constants(given: dict[str, float]) -> dict[str, float]:
    try:
        check_names(given)
    except MotionError as no:
        raise wrong(no) from None
    return given


def _text(value: object) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return repr(float(value))
        except OverflowError:
            raise wrong(f"{shown(value)}: not a finite number") from None
    if not isinstance(value, str):
        raise wrong(f'{shown(value)} is no formula: write e.g. "15*cos(t)"')
    return value


def _of_t(declared: str, unit: str) -> PlainValidator:
    """Validator of a formula of t whose values are plain numbers of a declared unit: its text, and the unit in SI."""

    def validate(value: object, info: ValidationInfo) -> tuple[str, float]:
        text = _text(value)
        try:
            formula(text, info.data.get("constants", {}), SX.sym("t"))
        except MotionError as no:
            raise wrong(no) from None
        scales = info.context or {}
        if declared not in scales:
            raise wrong(f'values without a unit: add the line {declared} = "{unit}" at the top')
        return text, scales[declared]

    return PlainValidator(validate)


def _without_t(value: object, info: ValidationInfo) -> float:
    try:
        return constant(_text(value), info.data.get("constants", {}))
    except MotionError as no:
        raise wrong(no) from None


Length = Annotated[tuple[str, float], _of_t("length", "mm")]
Angle = Annotated[tuple[str, float], _of_t("angle", "deg")]
Bound = Annotated[float, PlainValidator(_without_t)]


class CurveTable(Table):
    """A curve by equations.

    x, y, z     formulas of t, or numbers, in the unit of `length`
    rx, ry, rz  likewise of the orientation, Rx · Ry · Rz, in the unit of `angle`; 0 where some are given, else kept
    from, to    where t begins and ends: numbers, or formulas without t
    constants   names of numbers, for all of them
    """

    # first: the others are read with them
    constants: Annotated[dict[str, Number], AfterValidator(_constants)] = Field(default_factory=dict)
    x: Length
    y: Length
    z: Length
    rx: Angle | None = None
    ry: Angle | None = None
    rz: Angle | None = None
    begin: Bound = Field(alias="from")
    end: Bound = Field(alias="to")

    @model_validator(mode="after")
    def _some_way(self) -> Self:
        if self.begin == self.end:
            raise wrong(f"t runs from {self.begin:g} to {self.end:g}: the two must not be the same")
        return self


class CurveEntry(Drawn):
    curve: CurveTable

    def segment(self, line_number: int | None) -> Segment:
        table = self.curve
        turns = [given for given in (table.rx, table.ry, table.rz) if given is not None]
        rx, ry, rz = ("0" if given is None else given[0] for given in (table.rx, table.ry, table.rz))
        return Curve(
            (table.x[0], table.y[0], table.z[0]),
            table.begin,
            table.end,
            (rx, ry, rz) if turns else None,
            **self.said,
            constants=tuple(table.constants.items()),
            length=table.x[1],
            angle=turns[0][1] if turns else 1.0,
            line_number=line_number,
        )
