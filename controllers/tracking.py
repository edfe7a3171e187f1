"""One machine's axes under tracking laws along a plan: what each was to do, was told to do, and
did.

Laws run beside each other: a batch in which each run has a law of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from os import PathLike
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from controllers.card import Command
from controllers.laws.law import (
    AnyLaw,
    Feedback,
    Memory,
    Reference,
    StatefulLaw,
    begin_law,
    step_law,
)
from controllers.laws.registry import find_law
from controllers.rig import Rig, Timer
from controllers.rig_choice import choose_rig
from controllers.simulate import HOST_STEP, MAX_WAIT, SETTLING_TIME, sample, simulate
from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.parallel import Progress, ignore_progress

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine
    from planner.pulses.motion import AxesMotion
    from planner.shaping.shaped_proof import ShapedProof


@dataclass(frozen=True, slots=True)
class SideBySide:
    """Run b of B is commanded by the b-th law.

    Their hosts keep time alike, and they send the same kind of command.
    """

    laws: tuple[AnyLaw, ...]

    def __post_init__(self) -> None:
        if len({law.host for law in self.laws}) != 1:
            raise MotionError(
                f"laws {self.name} need hosts of different timing: run them separately"
            )

    @property
    def host(self) -> Timer:
        return self.laws[0].host

    @property
    def name(self) -> str:
        return ", ".join(law.name for law in self.laws)

    @property
    def grid(self) -> dict[str, tuple[float, ...]]:
        return {}

    def begin(self, lanes: tuple[int, int]) -> Memory:
        return tuple(each for law in self.laws for each in begin_law(law, lanes))

    def step(
        self, k: int | np.ndarray, reference: Reference, feedback: Feedback, memory: Memory
    ) -> tuple[Command, Memory]:
        commands: list[Command] = []
        left = memory
        after: Memory = ()
        for law in self.laws:
            count = len(begin_law(law, feedback.position.shape))
            command, own = step_law(law, k, reference, feedback, left[:count])
            commands.append(command)
            left, after = left[count:], (*after, *own)
        return self._join(commands, feedback), after

    def _join(self, commands: Sequence[Command], feedback: Feedback) -> Command:
        kind: Any = type(commands[0])
        lanes = feedback.position.shape
        if any(type(command) is not kind for command in commands):
            raise MotionError(f"laws {self.name} send different commands: run them separately")
        own: Command = kind(
            *(
                self._own([getattr(command, of.name) for command in commands], lanes)
                for of in fields(kind)
            )
        )
        return own

    def _own(self, values: Sequence[Any], lanes: tuple[int, ...]) -> Any:
        """Of one value of every law's command, each run's own."""
        if all(isinstance(value, float) for value in values):
            if len(set(values)) != 1:
                raise MotionError(
                    f"laws {self.name} send ramps of different times: run them separately"
                )
            return values[0]
        own = np.empty(lanes)
        for b, value in enumerate(values):
            own[b] = value[b] if value.ndim == len(lanes) else value
        return own


class HasTrajectory(Protocol):
    """A plan: it holds its motion, and where its axes have input shapers, as `shaped`, the one
    behind them.
    """

    @property
    def trajectory(self) -> AxesMotion: ...


@dataclass(frozen=True, slots=True)
class Tracking(Result):
    """Axis motion under a tracking law: times and axis values at (some of) the drive's samples,
    settling included.

    t          (N,) s
    reference, command, actual  (N, n) q in m or rad: planned, as pulsed by the card, and true
    pulses     (n,) int64, fired in either direction
    axes       (n,) name and unit, m or rad
    rig        the name of what it was run on
    lost       (n,) int64, full steps that steppers lost; servos lose none
    """

    law: str
    dt: float
    t: Array = field(repr=False)
    reference: Array = field(repr=False)
    command: Array = field(repr=False)
    actual: Array = field(repr=False)
    pulses: np.ndarray
    axes: tuple[tuple[str, str], ...]
    rig: str
    lost: np.ndarray

    def __post_init__(self) -> None:
        freeze_fields(self, "t", "reference", "command", "actual", "pulses", "lost")

    def __repr__(self) -> str:
        size = f"{count_noun(len(self.axes), 'axis')} at {count_noun(len(self.t), 'instant')}"
        return f"<Tracking under {self.law} on rig {self.rig}: {size}>"

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
            Column("steps lost", self.lost),
        )
        title = f"following error under {self.law} on rig {self.rig}, a command every {1e3 * self.dt:g} ms"
        return (Table(title, columns),)

    def data(self) -> Table:
        """Every instant: what each axis was to do, what the card counted, and what it did."""
        columns = (
            Column(f"{name} {what}", values[:, k], unit)
            for k, (name, unit) in enumerate(self.axes)
            for what, values in (
                ("reference", self.reference),
                ("command", self.command),
                ("actual", self.actual),
            )
        )
        return Table(f"tracking under {self.law}", (Column("t", self.t, "s"), *columns))


def motion_of(plan: AxesMotion | HasTrajectory) -> AxesMotion:
    """The motion that a plan holds, behind its input shapers if there are any, or that is given as
    it is.
    """
    motion = plan.trajectory if hasattr(plan, "trajectory") else plan
    if not hasattr(motion, "duration"):
        raise MotionError(
            f"a plan or its trajectory is needed, not {plan!r:.80}; plan(program, machine) makes one"
        )
    shaped: ShapedProof | None = getattr(plan, "shaped", None)
    return motion if shaped is None else shaped.motion


@check_arguments("plan", "machine", "law", "rig")
def track(
    plan: AxesMotion | HasTrajectory,
    machine: MachineSource,
    law: AnyLaw | str,
    *,
    rig: Rig | str | PathLike[str] | None = None,
    dt: float = HOST_STEP,
    settle: float = SETTLING_TIME,
    period: float | None = None,
    progress: Progress = ignore_progress,
) -> Tracking:
    """Track a plan on a rig, then hold its end for a while, see `controllers.simulate.simulate`.

    Parameters
    ----------
    plan
        The plan, or its trajectory.
    machine
        The machine, its name, or the path of its file.
    law
        The tracking law, or its number or name, with its usual gains.
    rig
        Drives, card and host behind the machine's axes: a `Rig`, or the name or file of one. None:
        the one bundled rig
        that fits the machine (`Tracking.rig` names it); nothing is assumed of a machine that none
        fits.
    dt
        s between two commands of the host.
    settle
        s for which the end is held.
    period
        s between the instants that are kept. None: every sample of the drives.
    progress
        Called with how many samples of the drives are simulated, and of how many.

    Returns
    -------
    Tracking
        What the axes were to do, were told to do, and did.

    Raises
    ------
    MotionError
        The rig does not fit the machine, or none is given and not exactly one fits.
    """
    machine = (
        load_machine(machine)
        if isinstance(machine, str | PathLike) or not hasattr(machine, "axes")
        else machine
    )
    law = find_law(law) if isinstance(law, str) else law
    if isinstance(law, type) or not (isinstance(law, StatefulLaw) or hasattr(law, "command")):
        raise MotionError(
            f"track: a law is needed, or its number or name as a text, not {law!r:.80}"
        )
    return _track_lanes(
        plan, machine, law, [law], rig=rig, dt=dt, settle=settle, period=period, progress=progress
    )[0]


def track_each(
    plan: AxesMotion | HasTrajectory,
    machine: MachineSource,
    laws: Sequence[AnyLaw],
    *,
    rig: Rig | str | PathLike[str] | None = None,
    period: float | None = None,
) -> tuple[Tracking, ...]:
    """The same under each of several laws, in the time of one.

    Raises MotionError for laws that are no `SideBySide`.
    """
    law = SideBySide(tuple(laws))
    return _track_lanes(
        plan,
        load_machine(machine),
        law,
        laws,
        rig=rig,
        dt=HOST_STEP,
        settle=SETTLING_TIME,
        period=period,
    )


def _track_lanes(
    plan: AxesMotion | HasTrajectory,
    machine: Machine,
    law: AnyLaw,
    laws: Sequence[AnyLaw],
    *,
    rig: Rig | str | PathLike[str] | None,
    dt: float,
    settle: float,
    period: float | None,
    progress: Progress = ignore_progress,
) -> tuple[Tracking, ...]:
    """law: that of the batch, of which every run is called by its own of `laws`."""
    motion = motion_of(plan)
    chosen = choose_rig(machine, rig)
    if not 0 < dt <= MAX_WAIT:
        raise MotionError(
            f"track: dt {dt:g} s, the host's step, must be above 0, and at most {MAX_WAIT:g} s"
        )
    rigs = [chosen] * len(laws)
    runs = simulate(
        sample(motion, machine, dt), law, rigs, settle=settle, period=period, progress=progress
    )
    pulse = np.array([axis.pulse for axis in machine.axes])
    planned = motion.at(np.minimum(runs.t, motion.duration)).q
    command, actual = (machine.home_q + of * pulse for of in (runs.command, runs.actual))
    axes = tuple((axis.name, axis.unit) for axis in machine.axes)
    return tuple(
        Tracking(
            own.name,
            dt,
            runs.t,
            planned,
            command[:, b],
            actual[:, b],
            runs.pulses[b],
            axes,
            chosen.name,
            runs.lost[b],
        )
        for b, own in enumerate(laws)
    )
