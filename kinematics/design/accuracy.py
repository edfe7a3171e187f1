"""The accuracy budget: what every source of error does to the pose, as covariance and as worst
case.

A source of error is one small class (the plug point); those of a machine's axes and of its
temperature stand here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.singularity import sensitivity
from kinematics.foundation.arrays import Array, finite_array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import COMPONENTS, Pose, PoseLike, from_numbers, to_numbers

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

UNIFORM, EITHER_END, SINE = 1 / 3, 1.0, 1 / 2
"""Variance of a variable within ±1: of constant density, at one of the two ends, a sine of unknown
phase.
"""


@dataclass(frozen=True, slots=True)
class Effect:
    """What a source does at N poses, by k independent variables, each within ±1 and of mean 0.

    variance  (k,) of the variables
    axes      (N, n, k) change of the axes' true coordinates for each variable at 1, m or rad
    pose      (N, 6, k) the same for what moves the platform without an axis: [shift m, turn rad] in
              the base frame
    bias      (N, 6) what is there always, as `pose`
    None is nothing.
    """

    variance: Array
    axes: Array | None = None
    pose: Array | None = None
    bias: Array | None = None


class ErrorSource(Protocol):
    """Anything with a name and an effect on a machine at N poses of coordinates q (N, n)."""

    @property
    def name(self) -> str: ...

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect: ...


def require_nonnegative(
    source: Any, skip: tuple[str, ...] = (), per_axis: tuple[str, ...] = ()
) -> None:
    """Every number of a source is finite and no less than zero; those in `per_axis` may be one for
    each axis.
    """
    if not isinstance(source.name, str) or not source.name:
        raise MotionError(
            f"{type(source).__name__}: name is {source.name!r:.60}; expected a text that is not empty"
        )
    for field in fields(source):
        value = getattr(source, field.name)
        if isinstance(field.default, bool) and not isinstance(value, bool):
            raise MotionError(
                f"{source.name}: {field.name} is {value!r:.60}; expected True or False"
            )
        if field.name in ("name", *skip) or isinstance(field.default, bool):
            continue
        if value is None and field.default is None:
            continue
        numbers = finite_array(value, f"{source.name}: {field.name}", unit="SI units")
        if not numbers.size:
            raise MotionError(
                f"{source.name}: {field.name} is empty; give one number, or one for each axis (SI units)"
            )
        if (numbers < 0).any() or numbers.ndim > 1 or (numbers.ndim and field.name not in per_axis):
            kind = "not negative" if (numbers < 0).any() else "a single number"
            raise MotionError(f"{source.name}: {field.name} {value} must be {kind} (SI units)")
        if numbers.ndim:
            object.__setattr__(source, field.name, tuple(freeze_array(numbers).tolist()))


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one source does to N poses: bias (N, 6), covariance (N, 6, 6) about it, spread (N, 6) to
    each side of it.
    """

    name: str
    bias: Array
    covariance: Array
    spread: Array

    @property
    def sigma(self) -> Array:
        """(N, 6) standard deviation of each component."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def worst(self) -> Array:
        """(N, 6) largest size that each component of the error can have; each is attained, not all
        at once.
        """
        return np.abs(self.bias) + self.spread


@dataclass(frozen=True)
class Budget(Result):
    """Errors of N poses, [dx, dy, dz, rx, ry, rz] in the base frame (m, rad), per source and in
    total.

    Sources are independent of each other.
    """

    machine: str
    contributions: tuple[Contribution, ...]

    @cached_property
    def total(self) -> Contribution:
        """bias = Σ biasₛ, covariance = Σ Σₛ, spread = Σ spreadₛ: together the worst case is |bias|
        + spread.
        """
        return Contribution(
            "total",
            freeze_array(sum(part.bias for part in self.contributions)),
            freeze_array(sum(part.covariance for part in self.contributions)),
            freeze_array(sum(part.spread for part in self.contributions)),
        )

    def __len__(self) -> int:
        return len(self.total.bias)

    def tables(self) -> tuple[Table, ...]:
        """Per source and component, standard deviation and worst case, the largest over the poses,
        rounded upwards.
        """
        most = partial(np.max, axis=0)
        rows = [
            (part.name, what, *values)
            for part in (*self.contributions, self.total)
            for what, values in (
                ("sigma", most(part.sigma)),
                ("bias", most(np.abs(part.bias))),
                ("worst", most(part.worst)),
            )
            if what != "bias" or part.bias.any()
        ]
        poses = f"the largest over {len(self)} poses" if len(self) > 1 else "at one pose"
        source, figure, *values = zip(*rows, strict=True)
        components = (
            Column(name, value, "m" if k < 3 else "rad", "micro", ".3f", up=True)
            for k, (name, value) in enumerate(zip(COMPONENTS, values, strict=True))
        )
        title = f"error budget of {self.machine}, {poses}"
        return (Table(title, (Column("source", source), Column("figure", figure), *components)),)


@check_arguments("machine", "pose")
def error_budget(
    machine: MachineSource,
    pose: PoseLike,
    sources: Sequence[ErrorSource],
    *,
    near: ArrayLike | None = None,
    tool: ArrayLike | None = None,
) -> Budget:
    """Find the error budget of a machine at N poses, such as along a path, to first order in the
    errors.

    Every source gives the error A z of the axes and B z + bias of the platform, for independent
    variables |z| ≤ 1 of variance v. With J of what the machine controls (what it holds gets no
    error from the axes, what follows follows):

        δ = G z + bias,  G = J⁻¹ A + B,  Σ = G diag(v) Gᵀ,  spreadᵢ = Σⱼ |Gᵢⱼ|, attained at a vertex
                         of |z| ≤ 1.

    For the quantization by the pulse p that is Σ = J⁻¹ (p²/12) J⁻ᵀ and spreadᵢ = Σⱼ |J⁻¹ᵢⱼ| p/2.

    Parameters
    ----------
    machine
        The machine, its name, or the path of its file.
    pose
        One or N in the base frame.
    sources
        Of error, such as `Quantization`.
    near
        (n,) branch and turn of the poses, as in `machine.inverse`.
    tool
        (3,) m: the point in the platform's frame whose error is asked for; its origin by default.
        It is not part of
        what `Temperature` lets grow.

    Returns
    -------
    Budget
        Errors by source and in total.

    Raises
    ------
    OutOfReach
        A pose is off the machine.
    MotionError
        A pose is singular; and what the sources raise.
    """
    machine = load_machine(machine)
    if not isinstance(sources, Sequence) or not all(
        hasattr(source, "effect") for source in sources
    ):
        raise MotionError(
            f"error budget of {machine.name}: sources must be a list such as [Quantization()], not {sources!r}"
        )
    if not sources:
        raise MotionError(
            f"error budget of {machine.name}: no sources; give at least one, e.g. Quantization()"
        )
    x = to_numbers(machine.read_pose(pose))
    if not len(x):
        raise MotionError(f"error budget of {machine.name}: no poses")
    q = np.atleast_2d(machine.inverse(pose, near))
    if machine.follows:
        x = machine.carried_map(machine.inputs(x, q))
    poses, inverse = from_numbers(x), sensitivity(machine, x, q)
    carry = _twist_transfer(machine, tool, poses)
    return Budget(
        machine.name,
        tuple(_contribution(source, machine, poses, q, inverse, carry) for source in sources),
    )


def _contribution(
    source: ErrorSource, machine: Machine, pose: Pose, q: Array, inverse: Array, carry: Array
) -> Contribution:
    effect = source.effect(machine, pose, q)
    influence = np.zeros((len(q), 6, len(effect.variance)))
    if effect.axes is not None:
        influence += inverse @ effect.axes
    if effect.pose is not None:
        influence += effect.pose
    influence = carry @ influence
    bias = (
        np.zeros((len(q), 6)) if effect.bias is None else (carry @ effect.bias[:, :, None])[:, :, 0]
    )
    covariance = influence * effect.variance @ influence.swapaxes(1, 2)
    return Contribution(
        source.name,
        freeze_array(bias),
        freeze_array(covariance),
        freeze_array(np.abs(influence).sum(-1)),
    )


def _twist_transfer(machine: Machine, tool: ArrayLike | None, pose: Pose) -> Array:
    """(N, 6, 6) from the twist at the platform's origin to that at the tool: v + ω × R t."""
    point = (
        np.zeros(3)
        if tool is None
        else finite_array(tool, f"error budget of {machine.name}: tool", (3,), unit="m")
    )
    arm = pose.rotation.apply(point)
    carry = np.broadcast_to(np.eye(6), (len(arm), 6, 6)).copy()
    # ω × r = −[r]× ω
    x, y, z = arm.T
    carry[:, 0, 4], carry[:, 0, 5] = z, -y
    carry[:, 1, 3], carry[:, 1, 5] = -z, x
    carry[:, 2, 3], carry[:, 2, 4] = y, -x
    return carry


PerAxis = float | Sequence[float]
"""One number for all axes of a machine (which must then be all linear or all rotary, if it has a
unit), or one each.
"""


@dataclass(frozen=True, slots=True)
class Quantization:
    """Rounding of axes to whole pulses: |count·pulse − (q − home)| ≤ `pulses`·pulse, uniformly
    distributed.

    By the rule `nearest`, pulses = ½: of a coordinate that is anywhere between two half-pulse
    levels with the same density, the variance is ∫ e² de / pulse over ±pulse/2, that is pulse²/12.
    """

    pulses: PerAxis = 0.5
    name: str = "quantization"

    def __post_init__(self) -> None:
        require_nonnegative(self, per_axis=("pulses",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        pulse = np.array([axis.pulse for axis in machine.axes])
        return _independent_effect(
            np.broadcast_to(_per_axis(self.pulses, machine, self.name) * pulse, q.shape), UNIFORM
        )


@dataclass(frozen=True, slots=True)
class PulseLength:
    """Relative error of the pulse length within ±error (2e-6: 2 ppm), common to all axes or of each
    axis.

    dq = error (q − home), since pulses count from home.
    """

    error: PerAxis
    common: bool = False
    name: str = "pulse length"

    def __post_init__(self) -> None:
        require_nonnegative(self, per_axis=("error",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        change = _per_axis(self.error, machine, self.name) * (q - machine.home_q)
        return (
            Effect(np.full(1, UNIFORM), change[:, :, None])
            if self.common
            else _independent_effect(change, UNIFORM)
        )


@dataclass(frozen=True, slots=True)
class Backlash:
    """Backlash of `width` (m or rad): dq = ±width/2, depending on the last direction.

    None: of the backlash that each axis of the machine states.
    """

    width: PerAxis | None = None
    name: str = "backlash"

    def __post_init__(self) -> None:
        require_nonnegative(self, per_axis=("width",))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        stated = [axis.backlash for axis in machine.axes] if self.width is None else self.width
        return _independent_effect(
            np.broadcast_to(_per_quantity(stated, machine, self.name) / 2, q.shape), EITHER_END
        )


@dataclass(frozen=True, slots=True)
class LeadError:
    """Lead error of the screws that remains after compensation.

    rate      share within ± of the travel from home, of each axis its own: dq = rate (q − home)
    periodic  amplitude (m or rad) of the error that returns with every turn, of unknown phase
    """

    rate: PerAxis = 0.0
    periodic: PerAxis = 0.0
    name: str = "lead error"

    def __post_init__(self) -> None:
        require_nonnegative(self, per_axis=("rate", "periodic"))

    def effect(self, machine: Machine, pose: Pose, q: Array) -> Effect:
        steady = _independent_effect(
            _per_axis(self.rate, machine, self.name) * (q - machine.home_q), UNIFORM
        )
        turning = _independent_effect(
            np.broadcast_to(_per_quantity(self.periodic, machine, self.name), q.shape), SINE
        )
        return _join_effects(steady, turning)


@dataclass(frozen=True, slots=True)
class Temperature:
    """Temperature within ±ambient K of calibration everywhere; linear axes within ±heating K more.

    expansion of axes and frame per K. An axis grows with its whole natural coordinate q (the
    distance between joint centres). The inverse map is homogeneous: a frame that is larger by s
    shifts the platform by s p, and shortens every axis by s relative to it. δ = s_frame (p, 0) +
    J⁻¹ q (s_axes − s_frame), q of linear axes.
    """

    ambient: float = 0.0
    heating: float = 0.0
    axis_expansion: float = 12e-6
    frame_expansion: float = 12e-6
    name: str = "temperature"

    def __post_init__(self) -> None:
        require_nonnegative(self)

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


def _independent_effect(change: Array, variance: float) -> Effect:
    """Every axis errs on its own: change (N, n) at 1."""
    return Effect(np.full(change.shape[1], variance), change[:, :, None] * np.eye(change.shape[1]))


def _join_effects(*effects: Effect) -> Effect:
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
            f"{name}: {count_noun(values.size, 'number')} for the {count} axes of {machine.name}; give one, or one each"
        )
    return np.broadcast_to(values, count)


def _per_quantity(value: ArrayLike, machine: Machine, name: str) -> Array:
    """The same of numbers with a unit, which linear and rotary axes do not share."""
    if np.ndim(value) == 0 and value and len({axis.kind for axis in machine.axes}) > 1:
        raise MotionError(
            f"{name}: {machine.name} has linear and rotary axes: give one number (m or rad) for each"
        )
    return _per_axis(value, machine, name)
