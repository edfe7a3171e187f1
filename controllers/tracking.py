"""One machine's axes under tracking laws along a plan: what each was to do, was told to do, and did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from controllers.card import PCI_8132, Card
from controllers.laws.law import Law
from controllers.laws.side_by_side import SideBySide
from controllers.rig import Drive, Rig
from controllers.servo import leg_servo
from controllers.simulate import HOST_STEP, SETTLE, sample, simulate
from kinematics.array import Array, frozen
from kinematics.errors import MotionError
from kinematics.result import Result
from kinematics.table import Column, Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from kinematics.machine import Machine
    from planner.pulses.motion import Motion


class Planned(Protocol):
    """A plan: it holds its motion."""

    @property
    def trajectory(self) -> Motion: ...


@dataclass(frozen=True, slots=True)
class Tracking(Result):
    """What the axes did under a law; times and axis values at the drive's samples, or some of them, settling included.

    t          (N,) s
    reference, command, actual  (N, n) q in m or rad: planned, as pulsed by the card, and true
    pulses     (n,) int64, fired in either direction
    axes       (n,) name and unit, m or rad
    """

    law: str
    dt: float
    t: Array = field(repr=False)
    reference: Array = field(repr=False)
    command: Array = field(repr=False)
    actual: Array = field(repr=False)
    pulses: np.ndarray
    axes: tuple[tuple[str, str], ...]

    def __post_init__(self) -> None:
        for name in ("t", "reference", "command", "actual", "pulses"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    def tables(self) -> tuple[Table, ...]:
        """The following error of each axis, and its pulses; `controllers.evaluate` tells more."""
        names, units = zip(*self.axes, strict=True)
        error = self.actual - self.reference
        columns = (
            Column("axis", names),
            Column("RMS", np.sqrt((error**2).mean(0)), units, "micro", ".3f"),
            Column("max", np.abs(error).max(0), units, "micro", ".3f"),
            Column("at the end", error[-1], units, "micro", ".3f"),
            Column("pulses", self.pulses),
        )
        return (Table(f"following error under {self.law}, a command every {1e3 * self.dt:g} ms", columns),)

    def data(self) -> Table:
        """Every instant: what each axis was to do, what the card counted, and what it did."""
        columns = (
            Column(f"{name} {what}", values[:, k], unit)
            for k, (name, unit) in enumerate(self.axes)
            for what, values in (("reference", self.reference), ("command", self.command), ("actual", self.actual))
        )
        return Table(f"tracking under {self.law}", (Column("t", self.t, "s"), *columns))

    def plot(self, ax: Axes | None = None) -> Axes:
        """The following error of every axis that shares the first one's unit."""
        from controllers.plots import tracked

        return tracked(self, ax)


def motion_of(plan: Motion | Planned) -> Motion:
    """The motion that a plan holds, or that is given as it is."""
    return plan.trajectory if hasattr(plan, "trajectory") else plan


def track(
    plan: Motion | Planned,
    machine: Machine,
    law: Law,
    *,
    servo: Drive | Sequence[Drive] | None = None,
    card: Card = PCI_8132,
    dt: float = HOST_STEP,
    settle: float = SETTLE,
    period: float | None = None,
) -> Tracking:
    """Tracks a plan (or its trajectory) and then holds its end for `settle` seconds, see `simulate`.

    servo   drive, one for all axes or one per axis, such as a rig's; `leg_servo` by default
    card    one model; as many cards of it as the axes need
    period  s between the instants that are kept; None: every sample of the drives
    """
    return _tracked(plan, machine, law, [law], servo=servo, card=card, dt=dt, settle=settle, period=period)[0]


def track_each(
    plan: Motion | Planned, machine: Machine, laws: Sequence[Law], *, period: float | None = None
) -> tuple[Tracking, ...]:
    """The same under each of several laws, in the time of one. Raises MotionError for laws that are no `SideBySide`."""
    return _tracked(plan, machine, SideBySide(tuple(laws)), laws, period=period)


def _tracked(
    plan: Motion | Planned,
    machine: Machine,
    law: Law,
    laws: Sequence[Law],
    *,
    servo: Drive | Sequence[Drive] | None = None,
    card: Card = PCI_8132,
    dt: float = HOST_STEP,
    settle: float = SETTLE,
    period: float | None,
) -> tuple[Tracking, ...]:
    """law: that of the batch, of which every run is called by its own of `laws`."""
    motion = motion_of(plan)
    rig = Rig(machine, tuple(_per_axis(servo, machine)), card)
    if not 0 < dt < float("inf"):
        raise MotionError(f"track: the host's step {dt * 1e3:g} ms must be above zero")
    runs = simulate(sample(motion, machine, dt), law, [rig] * len(laws), settle=settle, period=period)
    pulse = np.array([axis.pulse for axis in machine.axes])
    planned = motion.at(np.minimum(runs.t, motion.duration)).q
    command, actual = (machine.home_q + of * pulse for of in (runs.command, runs.actual))
    axes = tuple((axis.name, axis.unit) for axis in machine.axes)
    return tuple(
        Tracking(own.name, dt, runs.t, planned, command[:, b], actual[:, b], runs.pulses[b], axes)
        for b, own in enumerate(laws)
    )


def _per_axis(servo: Drive | Sequence[Drive] | None, machine: Machine) -> list[Drive]:
    if servo is None:
        return [leg_servo(axis) for axis in machine.axes]
    return [servo] * len(machine.axes) if isinstance(servo, Drive) else list(servo)
