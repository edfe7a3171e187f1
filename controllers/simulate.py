"""Runs a motion under a tracking law: reference -> law -> card -> drives, all axes and runs of a batch at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import TYPE_CHECKING, Protocol

import numpy as np

from controllers.card import PCI_8132, Card, at_rest, send
from controllers.laws.law import Feedback, Law, Reference
from controllers.rig import Rig
from controllers.servo import Servo, drive, drives, leg_servo, measured, standing
from kinematics.array import Array, frozen
from kinematics.errors import MotionError

if TYPE_CHECKING:
    from kinematics.machine import Machine
    from planner.pulses.motion import Motion

HOST_STEP = 5e-3
"""s. Between two commands the card's speed is a straight line, which leaves the plan by dt²/12 of what the acceleration
changes by: at most 1.3 pulses of 0.75 µm between ±225 mm/s², the hexapod's. A host that polls the card can keep it."""
SETTLE = 0.5
"""s after the end of the plan: fifteen time constants of a 30 1/s position loop."""


class Planned(Protocol):
    """A plan: it holds its motion."""

    @property
    def trajectory(self) -> Motion: ...


@dataclass(frozen=True, slots=True)
class Tracking:
    """What the axes did under a law; times and axis values at the drive's samples, settling included.

    t          (N,) s
    reference, command, actual  (N, n) q in m or rad: planned, as pulsed by the card, and true
    pulses     (n,) int64, fired in either direction
    """

    law: str
    dt: float
    t: Array
    reference: Array
    command: Array
    actual: Array
    pulses: np.ndarray

    def __post_init__(self) -> None:
        for name in ("t", "reference", "command", "actual", "pulses"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def motion_of(plan: Motion | Planned) -> Motion:
    """The motion that a plan holds, or that is given as it is."""
    return plan.trajectory if hasattr(plan, "trajectory") else plan


def sample(motion: Motion, machine: Machine, dt: float) -> Reference:
    """The motion at k·dt, up to the first sample at or after its end, in pulses from home."""
    steps = max(ceil(motion.duration / dt - 1e-9), 1)
    state = motion.at(np.minimum(np.arange(steps + 1) * dt, motion.duration))
    pulse = np.array([axis.pulse for axis in machine.axes])
    return Reference(dt, (state.q - machine.home_q) / pulse, state.qd / pulse)


@dataclass(frozen=True, slots=True)
class Runs:
    """What a batch of B runs did, at the drives' samples t (N,), s, settling included.

    command, actual  (N, B, n) pulses from home: the card's counters, and where the axes truly are
    torque           (N, B, n) N or N·m
    pulses           (B, n) int64, fired in either direction
    """

    t: Array
    command: Array
    actual: Array
    torque: Array
    pulses: np.ndarray

    def __post_init__(self) -> None:
        for name in ("t", "command", "actual", "torque", "pulses"):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def simulate(reference: Reference, law: Law, rigs: Sequence[Rig], *, settle: float = SETTLE) -> Runs:
    """B = len(rigs) runs of a reference under a law, whose gains are numbers or arrays (B, 1); a run is on its own rig.

    Every dt the host reads the encoders (in pulses), asks the law, and sends its command, which the card takes at once.
    The drives follow the card's counters at their own sample time, of which dt must be a whole multiple. The rigs share
    one machine and one model of card.

    Raises MotionError for a dt that does not fit the drives, and Refused by the card for a command outside its range.
    """
    machine, card, dt = rigs[0].machine, rigs[0].card, reference.dt
    model = drives([rig.drives for rig in rigs])
    inner = round(dt / model.sample) if 0 < dt < float("inf") else 0
    if inner < 1 or abs(inner * model.sample - dt) > 1e-9 * dt:
        raise MotionError(
            f"track: the host's step {dt * 1e3:g} ms is no whole multiple of the drives' sample time "
            f"{model.sample * 1e3:g} ms; use {max(inner, 1) * model.sample * 1e3:g} ms"
        )
    if not 0 <= settle < float("inf"):
        raise MotionError(f"track: settling time {settle} s must be zero or more")
    pulse = np.array([axis.pulse for axis in machine.axes])
    lanes = (len(rigs), len(pulse))
    counts = np.broadcast_to(reference.ang(0), lanes).astype(np.int64)
    state, servos = at_rest(counts), standing(counts * pulse)
    steps = reference.steps + ceil(settle / dt)
    inside = np.arange(inner) * model.sample
    command, actual, torque = (np.empty((steps * inner, *lanes)) for _ in range(3))
    before = measured(model, servos.x) / pulse
    for k in range(steps):
        position = measured(model, servos.x) / pulse
        counter = state.counter(k * dt)[0]
        told = law.command(k, reference, Feedback(position, (position - before) / dt, counter))
        before, state = position, send(card, state, told, k * dt)
        here = slice(k * inner, (k + 1) * inner)
        command[here] = state.counter(k * dt + inside)
        response = drive(model, servos, command[here] * pulse)
        actual[here], torque[here], servos = response.position / pulse, response.torque, response.state
    t = (np.arange(steps)[:, None] * dt + inside).ravel()
    return Runs(t, command, actual, torque, state.pulses(steps * dt))


def track(
    plan: Motion | Planned,
    machine: Machine,
    law: Law,
    *,
    servo: Servo | Sequence[Servo] | None = None,
    card: Card = PCI_8132,
    dt: float = HOST_STEP,
    settle: float = SETTLE,
) -> Tracking:
    """Tracks a plan (or its trajectory) and then holds its end for `settle` seconds, see `simulate`.

    servo  one for all axes or one per axis; `leg_servo` by default
    card   one model; as many cards of it as the axes need
    """
    motion = motion_of(plan)
    rig = Rig(machine, tuple(_per_axis(servo, machine)), card)
    if not 0 < dt < float("inf"):
        raise MotionError(f"track: the host's step {dt * 1e3:g} ms must be above zero")
    runs = simulate(sample(motion, machine, dt), law, [rig], settle=settle)
    pulse = np.array([axis.pulse for axis in machine.axes])
    planned = motion.at(np.minimum(runs.t, motion.duration)).q
    command, actual = (machine.home_q + of[:, 0] * pulse for of in (runs.command, runs.actual))
    return Tracking(law.name, dt, runs.t, planned, command, actual, runs.pulses[0])


def _per_axis(servo: Servo | Sequence[Servo] | None, machine: Machine) -> list[Servo]:
    if servo is None:
        return [leg_servo(axis) for axis in machine.axes]
    return [servo] * len(machine.axes) if isinstance(servo, Servo) else list(servo)
