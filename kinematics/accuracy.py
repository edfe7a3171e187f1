"""The accuracy budget: what every source of error does to the pose, as covariance and as worst case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from kinematics.array import Array, finite, frozen
from kinematics.effect import Source
from kinematics.errors import MotionError
from kinematics.freedom import COMPONENTS
from kinematics.pose import Pose, from_numbers, numbers
from kinematics.result import Result
from kinematics.sensitivity import sensitivity
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kinematics.machine import Machine


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one source does to N poses: bias (N, 6), covariance (N, 6, 6) about it, spread (N, 6) to each side of it."""

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
        """(N, 6) largest size that each component of the error can have; each is attained, not all at once."""
        return np.abs(self.bias) + self.spread


@dataclass(frozen=True)
class Budget(Result):
    """The error of N poses, [dx, dy, dz, rx, ry, rz] in the base frame (m, rad), source by source and in total.

    Sources are independent of each other.
    """

    machine: str
    contributions: tuple[Contribution, ...]

    @cached_property
    def total(self) -> Contribution:
        """bias = Σ biasₛ, covariance = Σ Σₛ, spread = Σ spreadₛ: together the worst case is |bias| + spread."""
        return Contribution(
            "total",
            frozen(sum(part.bias for part in self.contributions)),
            frozen(sum(part.covariance for part in self.contributions)),
            frozen(sum(part.spread for part in self.contributions)),
        )

    def __len__(self) -> int:
        return len(self.total.bias)

    def tables(self) -> tuple[Table, ...]:
        """Per source and component, standard deviation and worst case, the largest over the poses, rounded upwards."""
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

    def plot(self, ax: Axes | None = None) -> Axes:
        """The position error by source: along the poses, or as bars for one; kinematics.plots has more."""
        from kinematics.plots import position_error

        return position_error(self, ax)


def error_budget(
    machine: Machine,
    pose: Pose,
    sources: Sequence[Source],
    *,
    near: ArrayLike | None = None,
    tool: ArrayLike | None = None,
) -> Budget:
    """The error budget of a machine at N poses, such as those along a path, to first order in the errors.

    Every source gives the error A z of the axes and B z + bias of the platform, for independent variables |z| ≤ 1 of
    variance v. With J of what the machine controls (what it holds gets no error from the axes, what follows follows):

        δ = G z + bias,  G = J⁻¹ A + B,  Σ = G diag(v) Gᵀ,  spreadᵢ = Σⱼ |Gᵢⱼ|, attained at a vertex of |z| ≤ 1.

    For the quantization by the pulse p that is Σ = J⁻¹ (p²/12) J⁻ᵀ and spreadᵢ = Σⱼ |J⁻¹ᵢⱼ| p/2.

    near  (n,) branch and turn of the poses, as in `machine.inverse`
    tool  (3,) m: the point in the platform's frame whose error is asked for; its origin by default. It is not part of
          what `Temperature` lets grow.
    Raises OutOfReach for a pose off the machine, MotionError for a singular one, and what the sources raise.
    """
    if not isinstance(sources, Sequence) or not all(hasattr(source, "effect") for source in sources):
        raise MotionError(
            f"error budget of {machine.name}: sources must be a list such as [Quantization()], not {sources!r}"
        )
    if not sources:
        raise MotionError(f"error budget of {machine.name}: no sources; give at least one, e.g. Quantization()")
    x = numbers(pose)
    if not len(x):
        raise MotionError(f"error budget of {machine.name}: no poses")
    q = np.atleast_2d(machine.inverse(pose, near))
    if machine.follows:
        x = machine.carried_map(machine.inputs(x, q))
    poses, inverse = from_numbers(x), sensitivity(machine, x, q)
    carry = _carried_to(machine, tool, poses)
    return Budget(machine.name, tuple(_contribution(source, machine, poses, q, inverse, carry) for source in sources))


def _contribution(source: Source, machine: Machine, pose: Pose, q: Array, inverse: Array, carry: Array) -> Contribution:
    effect = source.effect(machine, pose, q)
    influence = np.zeros((len(q), 6, len(effect.variance)))
    if effect.axes is not None:
        influence += inverse @ effect.axes
    if effect.pose is not None:
        influence += effect.pose
    influence = carry @ influence
    bias = np.zeros((len(q), 6)) if effect.bias is None else (carry @ effect.bias[:, :, None])[:, :, 0]
    covariance = influence * effect.variance @ influence.swapaxes(1, 2)
    return Contribution(source.name, frozen(bias), frozen(covariance), frozen(np.abs(influence).sum(-1)))


def _carried_to(machine: Machine, tool: ArrayLike | None, pose: Pose) -> Array:
    """(N, 6, 6) from the twist at the platform's origin to that at the tool: v + ω × R t."""
    point = np.zeros(3) if tool is None else finite(tool, f"error budget of {machine.name}: tool", (3,), unit="m")
    arm = pose.rotation.apply(point)
    carry = np.broadcast_to(np.eye(6), (len(arm), 6, 6)).copy()
    # ω × r = −[r]× ω
    x, y, z = arm.T
    carry[:, 0, 4], carry[:, 0, 5] = z, -y
    carry[:, 1, 3], carry[:, 1, 5] = -z, x
    carry[:, 2, 3], carry[:, 2, 4] = y, -x
    return carry
