"""A simulation: reference -> law -> card -> drives, all axes and runs of a batch at once.

Axes of each kind of drive are run side by side. What a batch does is kept as it happens: every so
many samples of the drives, in pulses.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any

import numpy as np

from controllers.card import DStop, at_rest, current_speed, send
from controllers.drives.axes import Axes, AxesResponse
from controllers.drives.servo import Servo, servo_axes
from controllers.drives.stepper import Stepper, stepper_axes
from controllers.laws.law import AnyLaw, Feedback, Reference, begin_law, step_law
from controllers.rig import Rig, instants
from kinematics.foundation.arrays import Array, freeze_fields
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from planner.parallel import Progress, ignore_progress

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine
    from planner.pulses.motion import AxesMotion

KINDS: dict[type, Callable[[Any, float], Axes]] = {Servo: servo_axes, Stepper: stepper_axes}
"""What makes lanes of B rows of drives of a kind, and their sample time."""


@dataclass(frozen=True, slots=True)
class Bank:
    """Groups of axes of one kind of drive each, and their columns of the lanes; itself what `Axes`
    is.
    """

    sample: float
    groups: tuple[tuple[np.ndarray, Axes], ...]

    def standing(self, x: Array) -> tuple[Any, ...]:
        return tuple(axes.standing(x[:, columns]) for columns, axes in self.groups)

    def reading(self, state: tuple[Any, ...]) -> Array:
        return self._join_columns(
            [axes.reading(own) for (_, axes), own in zip(self.groups, state, strict=True)]
        )

    def run(
        self, state: tuple[Any, ...], command: Array, kept: np.ndarray
    ) -> tuple[AxesResponse, tuple[Any, ...]]:
        if len(self.groups) == 1:
            response, own = self.groups[0][1].run(state[0], command, kept)
            return response, (own,)
        runs = [
            axes.run(own, command[:, :, columns], kept)
            for (columns, axes), own in zip(self.groups, state, strict=True)
        ]
        parts = (
            self._join_columns([getattr(response, name) for response, _ in runs])
            for name in AxesResponse.__slots__
        )
        return AxesResponse(*parts), tuple(own for _, own in runs)

    def count_lost_steps(self, state: tuple[Any, ...]) -> np.ndarray:
        return self._join_columns(
            [axes.count_lost_steps(own) for (_, axes), own in zip(self.groups, state, strict=True)]
        )

    def _join_columns(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        order = np.argsort(np.concatenate([columns for columns, _ in self.groups]))
        return np.concatenate(parts, axis=-1)[..., order]


def bank(rigs: Sequence[Sequence[Servo | Stepper]]) -> Bank:
    """The drives of B rigs.

    Raises MotionError if sample times differ, or the kinds of drive behind an axis.
    """
    samples = sorted({drive.sample for drives in rigs for drive in drives})
    if len(samples) != 1:
        raise MotionError(
            f"drives: sample times {samples} s differ; the drives of one batch share one"
        )
    kinds = [type(drive) for drive in rigs[0]]
    if any([type(drive) for drive in drives] != kinds for drives in rigs):
        raise MotionError(
            "drives: the rigs of one batch differ in the kinds of their drives; run them one by one"
        )
    groups = []
    for kind, lanes in KINDS.items():
        columns = np.array([n for n, own in enumerate(kinds) if own is kind], int)
        if len(columns):
            groups.append(
                (columns, lanes([[drives[n] for n in columns] for drives in rigs], samples[0]))
            )
    return Bank(samples[0], tuple(groups))


class Recorder:
    """Records (K, B, n) of samples 0, every, 2 every, …; they are filled from the first to the
    last, block by block.
    """

    def __init__(self, samples: int, every: int, pulse: Array, lanes: tuple[int, int]) -> None:
        self.every, self.pulse = every, pulse
        shape = (-(-samples // every), *lanes)
        self.command, self.actual, self.measured, self.speed, self.torque = (
            np.empty(shape) for _ in range(5)
        )

    def select_kept(self, first: int, count: int) -> np.ndarray:
        """Which of the `count` samples from `first` on are kept, from 0."""
        return np.arange(-first % self.every, count, self.every)

    def put(self, first: int, counter: np.ndarray, told: AxesResponse) -> None:
        """The card's counter (N, B, n) at the samples from `first` on, and what the axes told of
        those kept.
        """
        at = self.select_kept(first, len(counter))
        row = -(-first // self.every)
        rows = slice(row, row + len(at))
        self.command[rows] = counter[at]
        np.divide(told.position, self.pulse, out=self.actual[rows])
        np.divide(told.reading, self.pulse, out=self.measured[rows])
        np.divide(told.speed, self.pulse, out=self.speed[rows])
        self.torque[rows] = told.torque

    def finish(self) -> dict[str, Array]:
        """The records by name, read-only from now on."""
        records = {
            name: getattr(self, name)
            for name in ("command", "actual", "measured", "speed", "torque")
        }
        for record in records.values():
            record.setflags(write=False)
        return records


HOST_STEP = 5e-3
"""s. Between two commands the card's speed is a straight line, which leaves the plan by dt²/12 of
what the acceleration changes by: at most 1.3 pulses of 0.75 µm between ±225 mm/s², the hexapod's. A
host that polls the card can keep it.
"""
MAX_WAIT = 3600.0
"""s: the longest step of a host, settling and interval between records; longer ones are slips of
the unit.
"""
SETTLING_TIME = 0.5
"""s after the end of the plan: fifteen time constants of a 30 1/s position loop."""


def sample(motion: AxesMotion, machine: Machine, dt: float) -> Reference:
    """The motion at k·dt, up to the first sample at or after its end, in pulses from home."""
    steps = max(ceil(motion.duration / dt - 1e-9), 1)
    state = motion.at(np.minimum(np.arange(steps + 1) * dt, motion.duration))
    pulse = np.array([axis.pulse for axis in machine.axes])
    return Reference(dt, (state.q - machine.home_q) / pulse, state.qd / pulse)


@dataclass(frozen=True, slots=True)
class Runs:
    """What a batch of B runs did, at instants t (K,), s, settling included.

    command, actual  (K, B, n) pulses from home: the card's counters, and where the axes' outputs
                     truly are
    measured         (K, B, n) pulses from home: what the encoders read, at the motors or at the
                     outputs
    speed            (K, B, n) pulses/s, of the motors
    torque           (K, B, n) N or N·m
    pulses           (B, n) int64, fired in either direction
    lost             (B, n) int64, full steps that steppers lost; servos lose none
    steps            (S + 1, B) s at which each run's host began its steps, and the end of the last
                     one
    """

    t: Array
    command: Array
    actual: Array
    measured: Array
    speed: Array
    torque: Array
    pulses: np.ndarray
    lost: np.ndarray
    steps: Array

    def __post_init__(self) -> None:
        freeze_fields(self, *Runs.__slots__)

    @property
    def end(self) -> Array:
        """(B,) s: where the settling of each run ends.

        What is later is there for other runs of the batch.
        """
        return np.asarray(self.steps[-1])


def simulate(
    reference: Reference,
    law: AnyLaw,
    rigs: Sequence[Rig],
    *,
    settle: float = SETTLING_TIME,
    period: float | None = None,
    progress: Progress = ignore_progress,
) -> Runs:
    """B = len(rigs) runs of a reference under a law, whose gains are numbers or arrays (B, 1); a
    run is on its own rig.

    Every dt by its own clock (`Rig.host`, `Law.host`) a host reads the encoders (in pulses), asks
    the law, and sends its command, which the card takes at once; a step that falls between two
    samples of the drives begins at the later of them. The drives follow the card's counters at
    their own sample time, of which dt must be a whole multiple where a host polls the card's
    counter. A host with a closing stop sends that at the last sample, and is silent from then on.
    The rigs share one machine, one model of card and the kinds of their drives.

    period  s between the instants that are kept, brought to whole samples of the drives; None:
            every sample
    progress  is told how many samples of the drives are done, and of how many

    Raises MotionError for a dt that does not fit the drives, and Refused by the card for a command
    outside its range.
    """
    _refuse(reference, rigs)
    machine, card, dt = rigs[0].machine, rigs[0].card, reference.dt
    axes = bank([rig.drives for rig in rigs])
    h = axes.sample
    exact = law.host == "counter" and any(rig.host.timer == "counter" for rig in rigs)
    _refuse_times(dt, h, exact, settle, period)
    pulse = np.array([axis.pulse for axis in machine.axes])
    lanes = (len(rigs), len(pulse))
    counts = np.broadcast_to(reference.ang(0), lanes).astype(np.int64)
    state, drives = at_rest(counts), axes.standing(counts * pulse)
    steps = reference.steps + ceil(settle / dt)
    begin = instants([rig.host for rig in rigs], law.host, dt, steps)
    # as whole samples; 1e-6 of one is rounding
    at = np.ceil(begin / h - 1e-6).astype(np.int64)
    every = 1 if period is None else max(round(period / h), 1)
    recorder = Recorder(int(at[-1].max()), every, pulse, lanes)
    runs, k = np.arange(len(rigs)), np.zeros(len(rigs), np.int64)
    rates = np.array([rig.host.speed_from == "card" for rig in rigs])
    closing = np.array(
        [np.nan if rig.host.closing_stop is None else rig.host.closing_stop for rig in rigs]
    )
    before, last = axes.reading(drives) / pulse, at[0]
    memory = begin_law(law, lanes)
    pulses, lost = np.empty((2, *lanes), np.int64)
    moments = np.unique(at).tolist()
    for start, stop in pairwise([*moments, moments[-1]]):
        due, over, now = (at[k, runs] == start) & (k < steps), at[-1] == start, start * h
        if over.any():  # whatever the rest of the batch goes on to do
            pulses[over], lost[over] = state.pulses(now)[over], axes.count_lost_steps(drives)[over]
        if due.any():
            position = axes.reading(drives) / pulse
            took = np.maximum(start - last, 1)[:, None] * h
            speed = (position - before) / took
            if rates.any():
                speed = np.where(rates[:, None], current_speed(card, state, now), speed)
            here = Feedback(position, speed, state.counter(now)[0])
            asked = due & ~((k >= reference.steps) & np.isfinite(closing))
            if asked.any():
                told, after = step_law(
                    law, int(k[0]) if (k == k[0]).all() else k, reference, here, memory
                )
                memory = tuple(
                    map(partial(_choose_runs, asked), after, memory)
                )  # of the others as it was
                state = send(card, state, told, now, None if asked.all() else asked[:, None])
            ends = due & (k == reference.steps)
            for tdec in np.unique(closing[ends & np.isfinite(closing)]).tolist():
                state = send(card, state, DStop(tdec), now, (ends & (closing == tdec))[:, None])
            before, last, k = (
                np.where(due[:, None], position, before),
                np.where(due, start, last),
                k + due,
            )
        block = max(BLOCK_VALUES // counts.size, 1)
        for first in range(start, stop, block):
            counter = state.counter(np.arange(first, min(first + block, stop)) * h)
            response, drives = axes.run(
                drives, counter * pulse, recorder.select_kept(first, len(counter))
            )
            recorder.put(first, counter, response)
            progress(min(first + block, stop), moments[-1])
    records = recorder.finish()
    t = np.asarray(np.arange(len(records["command"])) * (every * h), float)
    return Runs(t=t, **records, pulses=pulses, lost=lost, steps=begin)


def _choose_runs(chosen: np.ndarray, one: Array, other: Array) -> Array:
    """(B, …) one where a run is chosen (B,), else the other."""
    return np.where(chosen.reshape(-1, *(1,) * (one.ndim - 1)), one, other)


BLOCK_VALUES = 1 << 15
"""Values of a quantity that are worked on at once: 256 kB, so that they stay near the processor."""


def _refuse(reference: Reference, rigs: Sequence[Rig]) -> None:
    """Raise MotionError for what cannot be one batch."""
    if not rigs:
        raise MotionError("track: a batch needs a rig for each of its runs, and has none")
    axes, card = rigs[0].machine.axes, rigs[0].card
    if any(rig.machine.axes != axes or rig.card != card for rig in rigs):
        raise MotionError(
            "track: the rigs of one batch differ in their machine or card; run them separately"
        )
    columns = reference.position.shape[1]
    if columns != len(axes):
        raise MotionError(
            f"track: the reference has {columns} columns, the rig {count_noun(len(axes), 'axis')}"
        )


def _refuse_times(
    dt: float, sample: float, exact: bool, settle: float, period: float | None
) -> None:
    inner = round(dt / sample) if 0 < dt < float("inf") else 0
    if inner < 1 or (exact and abs(inner * sample - dt) > 1e-9 * dt):
        raise MotionError(
            f"track: the host's step {dt * 1e3:g} ms is not a whole multiple of the drives' sample time "
            f"{sample * 1e3:g} ms; use {max(inner, 1) * sample * 1e3:g} ms"
        )
    if not 0 <= settle <= MAX_WAIT:
        raise MotionError(f"track: settle {settle:g} s must be from 0 to {MAX_WAIT:g} s")
    if period is not None and not 0 < period <= MAX_WAIT:
        raise MotionError(f"track: period {period:g} s must be above 0, and at most {MAX_WAIT:g} s")
