"""Errors of a machine's axes, and of its temperature: each source as data of the accuracy budget."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array
from kinematics.effect import EITHER_END, SINE, UNIFORM, Effect, not_negative
from kinematics.errors import MotionError
from kinematics.pose import Pose

if TYPE_CHECKING:
    from kinematics.machine import Machine

PerAxis = float | Sequence[float]
"""One number for all axes of a machine (which must then be all linear or all rotary, if it has a unit), or one each."""


@dataclass(frozen=True, slots=True)
class Quantization:
    """Axes stand where whole pulses put them: |count·pulse − (q − home)| ≤ `pulses`·pulse, anywhere within.

    By the rule `nearest`, pulses = ½: of a coordinate that is anywhere between two half-pulse levels with the same
    density, the variance is ∫ e² de / pulse over ±pulse/2, that is pulse²/12.
    """

    pulses: PerAxis = 0.5
    name: str = "quantization"

    def __post_init__(self) -> None:
        not_negative(self, per_axis=("pulses",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        pulse = np.array([axis.pulse for axis in machine.axes])
        return _each(np.broadcast_to(_per_axis(self.pulses, machine, self.name) * pulse, q.shape), UNIFORM)


@dataclass(frozen=True, slots=True)
class PulseLength:
    """A pulse is longer than stated by a share within ±error (2e-6: 2 ppm), of every axis alike or of each its own.

    dq = error (q − home), since pulses count from home.
    """

    error: PerAxis
    common: bool = False
    name: str = "pulse length"

    def __post_init__(self) -> None:
        not_negative(self, per_axis=("error",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        change = _per_axis(self.error, machine, self.name) * (q - machine.home_q)
        return Effect(np.full(1, UNIFORM), change[:, :, None]) if self.common else _each(change, UNIFORM)


@dataclass(frozen=True, slots=True)
class Backlash:
    """Axes that rest at either end of a gap of this width (m or rad): dq = ±width/2, by the last direction.

    None: of the backlash that each axis of the machine states.
    """

    width: PerAxis | None = None
    name: str = "backlash"

    def __post_init__(self) -> None:
        not_negative(self, per_axis=("width",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        stated = [axis.backlash for axis in machine.axes] if self.width is None else self.width
        return _each(np.broadcast_to(_per_quantity(stated, machine, self.name) / 2, q.shape), EITHER_END)


@dataclass(frozen=True, slots=True)
class LeadError:
    """What is left of the screws' errors after compensation.

    rate      share within ± of the travel from home, of each axis its own: dq = rate (q − home)
    periodic  amplitude (m or rad) of the error that returns with every turn, of unknown phase
    """

    rate: PerAxis = 0.0
    periodic: PerAxis = 0.0
    name: str = "lead error"

    def __post_init__(self) -> None:
        not_negative(self, per_axis=("rate", "periodic"))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        steady = _each(_per_axis(self.rate, machine, self.name) * (q - machine.home_q), UNIFORM)
        turning = _each(np.broadcast_to(_per_quantity(self.periodic, machine, self.name), q.shape), SINE)
        return _joined(steady, turning)


@dataclass(frozen=True, slots=True)
class Temperature:
    """A temperature within ±ambient K of that of calibration, everywhere; the linear axes within ±heating K more.

    expansion of axes and frame per K. An axis grows with its whole natural coordinate q (the distance between joint
    centres). The inverse map is homogeneous: a frame that is larger by s shifts the platform by s p, and shortens every
    axis by s relative to it. δ = s_frame (p, 0) + J⁻¹ q (s_axes − s_frame), q of linear axes.
    """

    ambient: float = 0.0
    heating: float = 0.0
    axis_expansion: float = 12e-6
    frame_expansion: float = 12e-6
    name: str = "temperature"

    def __post_init__(self) -> None:
        not_negative(self)

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        length = np.where([axis.kind == "linear" for axis in machine.axes], q, 0.0)
        axes = np.stack(
            [
                self.ambient * (self.axis_expansion - self.frame_expansion) * length,
                self.heating * self.axis_expansion * length,
            ],
            -1,
        )
        shift = np.zeros((len(q), 6, 2))
        shift[:, :3, 0] = self.ambient * self.frame_expansion * pose.translation
        return Effect(np.full(2, UNIFORM), axes, shift)


def _each(change: Array, variance: float) -> Effect:
    """Every axis errs on its own: change (N, n) at 1."""
    return Effect(np.full(change.shape[1], variance), change[:, :, None] * np.eye(change.shape[1]))


def _joined(*effects: Effect) -> Effect:
    """Effects on the axes, of variables independent of each other."""
    return Effect(
        np.concatenate([effect.variance for effect in effects]),
        np.concatenate([effect.axes for effect in effects if effect.axes is not None], -1),
    )


def _per_axis(value: ArrayLike, machine: Machine, name: str) -> Array:
    """(n,) of one number for all axes, or of one each."""
    values, count = np.asarray(value, float), len(machine.axes)
    if values.shape not in ((), (count,)):
        raise MotionError(
            f"{name}: {values.size} numbers for the {count} axes of {machine.name}; give one, or one each"
        )
    return np.broadcast_to(values, count)


def _per_quantity(value: ArrayLike, machine: Machine, name: str) -> Array:
    """The same of numbers with a unit, which linear and rotary axes do not share."""
    if np.ndim(value) == 0 and value and len({axis.kind for axis in machine.axes}) > 1:
        raise MotionError(f"{name}: {machine.name} has linear and rotary axes: give one number (m or rad) for each")
    return _per_axis(value, machine, name)
