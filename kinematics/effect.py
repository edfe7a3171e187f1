"""What a source of error does to a machine: the plug point of the accuracy budget."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Protocol

from kinematics.array import Array, finite, frozen
from kinematics.errors import MotionError
from kinematics.pose import Pose

if TYPE_CHECKING:
    from kinematics.machine import Machine

UNIFORM, EITHER_END, SINE = 1 / 3, 1.0, 1 / 2
"""Variance of a variable within ±1: of constant density, at one of the two ends, a sine of unknown phase."""


@dataclass(frozen=True, slots=True)
class Effect:
    """What a source does at N poses, by k independent variables, each within ±1 and of mean 0.

    variance  (k,) of the variables
    axes      (N, n, k) change of the axes' true coordinates for each variable at 1, m or rad
    pose      (N, 6, k) the same for what moves the platform without an axis: [shift m, turn rad] in the base frame
    bias      (N, 6) what is there always, as `pose`
    None is nothing.
    """

    variance: Array
    axes: Array | None = None
    pose: Array | None = None
    bias: Array | None = None


class Source(Protocol):
    """Anything with a name and an effect on a machine at N poses of coordinates q (N, n)."""

    @property
    def name(self) -> str: ...

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect: ...


def not_negative(source: Any, skip: tuple[str, ...] = (), per_axis: tuple[str, ...] = ()) -> None:
    """Every number of a source is finite and no less than zero; those in `per_axis` may be one for each axis."""
    for field in fields(source):
        value = getattr(source, field.name)
        if field.name in ("name", *skip) or isinstance(value, bool):
            continue
        if value is None and field.default is None:
            continue
        numbers = finite(value, f"{source.name}: {field.name}", unit="SI units")
        if (numbers < 0).any() or numbers.ndim > 1 or (numbers.ndim and field.name not in per_axis):
            kind = "not negative" if (numbers < 0).any() else "a single number"
            raise MotionError(f"{source.name}: {field.name} {value} must be {kind} (SI units)")
        if numbers.ndim:
            object.__setattr__(source, field.name, tuple(frozen(numbers).tolist()))
