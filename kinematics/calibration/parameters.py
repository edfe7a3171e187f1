"""The parameters of a calibration: which there are, and how the parts of a model choose among them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import nearest
from kinematics.kinds.hexapod import Hexapod
from kinematics.machine.machine import Machine

XYZ = ("x", "y", "z")
FRAME = (*XYZ, "rx", "ry", "rz")
DEFAULT = ("factor", "frame-yaw")
"""One common factor, and where the measuring frame stands and how it is turned about z: five parameters."""


@dataclass(frozen=True, slots=True)
class FreeParameter:
    """One free parameter: it moves the entries `moves` of the full vector together."""

    name: str
    unit: str
    moves: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class FullVector:
    """Every number that a model can free, in one vector (k,): factors, offsets, joints (of a hexapod), frame.

    The frame is x, y, z (m) and rx, ry, rz (rad, about the moving axes in turn), in the home pose's frame.
    """

    axes: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array

    @property
    def size(self) -> int:
        return len(self.nominal)

    def factors(self) -> slice:
        return slice(0, len(self.axes))

    def offsets(self) -> slice:
        return slice(len(self.axes), 2 * len(self.axes))

    def joints(self) -> slice:
        """Base joints one after the other, then platform joints; empty for a machine without."""
        return slice(2 * len(self.axes), self.size - 6)

    def frame(self) -> slice:
        return slice(self.size - 6, self.size)


def full_vector(machine: Machine) -> FullVector:
    """The full vector of a machine, as its file has it."""
    n = len(machine.axes)
    joints = np.zeros(0)
    if isinstance(machine, Hexapod):
        joints = np.concatenate([machine.base.ravel(), machine.platform.ravel()])
    names, units = tuple(axis.name for axis in machine.axes), tuple(axis.unit for axis in machine.axes)
    return FullVector(names, units, freeze_array(np.concatenate([np.ones(n), np.zeros(n), joints, np.zeros(6)])))


def free_parameters(vector: FullVector, parts: Sequence[str]) -> tuple[FreeParameter, ...]:
    """The free parameters of a model that consists of `parts`. Raises MotionError for parts that make no model."""
    if isinstance(parts, str) or not isinstance(parts, Sequence):
        raise MotionError(f"calibration model: {parts!r} is no sequence of parts; parts: {', '.join(PARTS)}")
    for part in parts:
        if part not in PARTS:
            raise MotionError(
                f'"{part}" is no part of a calibration model{nearest(part, PARTS)}; parts: {", ".join(PARTS)}'
            )
    for whole, contained in (("factors", "factor"), ("frame", "frame-yaw")):
        if whole in parts and contained in parts:
            raise MotionError(f"calibration model: {contained} is contained in {whole}; give one of them")
    if not parts or len(set(parts)) < len(parts):
        raise MotionError(f"calibration model: needs one part or more, each once, not {list(parts)}")
    if "joints" in parts and vector.size == 2 * len(vector.axes) + len(FRAME):
        raise MotionError("calibration model: joints are identified for hexapods only; leave that part out")
    return tuple(parameter for part in PARTS if part in parts for parameter in PARTS[part](vector))


def selection(vector: FullVector, parameters: Sequence[FreeParameter]) -> Array:
    """S (k, m): full vector = nominal + S · parameters' changes."""
    chosen = np.zeros((vector.size, len(parameters)))
    for column, parameter in enumerate(parameters):
        chosen[list(parameter.moves), column] = 1.0
    return chosen


def _factor(vector: FullVector) -> Iterable[FreeParameter]:
    yield FreeParameter("factor", "", tuple(range(len(vector.axes))))


def _factors(vector: FullVector) -> Iterable[FreeParameter]:
    for k, axis in enumerate(vector.axes):
        yield FreeParameter(f"{axis} factor", "", (k,))


def _offsets(vector: FullVector) -> Iterable[FreeParameter]:
    first = vector.offsets().start
    for k, (axis, unit) in enumerate(zip(vector.axes, vector.units, strict=True)):
        yield FreeParameter(f"{axis} offset", unit, (first + k,))


def _joints(vector: FullVector) -> Iterable[FreeParameter]:
    entry = vector.joints().start
    for end in ("base", "platform"):
        for axis in vector.axes:
            for component in XYZ:
                yield FreeParameter(f"{axis} {end} {component}", "m", (entry,))
                entry += 1


def _frame(vector: FullVector) -> Iterable[FreeParameter]:
    for k, name in enumerate(FRAME):
        yield FreeParameter(f"frame {name}", "m" if name in XYZ else "rad", (vector.frame().start + k,))


def _frame_yaw(vector: FullVector) -> Iterable[FreeParameter]:
    return (parameter for parameter in _frame(vector) if parameter.name not in ("frame rx", "frame ry"))


def calibration_parts() -> tuple[str, ...]:
    """Names of the parts that a model can consist of."""
    return tuple(PARTS)


PARTS: dict[str, Callable[[FullVector], Iterable[FreeParameter]]] = {
    "factor": _factor,
    "factors": _factors,
    "offsets": _offsets,
    "joints": _joints,
    "frame": _frame,
    "frame-yaw": _frame_yaw,
}
"""Parts of a model: a common pulse factor, one per axis; a length offset per axis; the joints' centres; the measuring
frame, whole or turned about z only. factors, offsets and joints of a hexapod are 48 parameters."""
