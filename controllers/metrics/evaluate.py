"""From what the axes did to how well they tracked: of one run, or of a batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain, repeat
from typing import TYPE_CHECKING

import numpy as np

from controllers.metrics.attained import planned_at
from controllers.metrics.effort import Effort, efforts
from controllers.metrics.ending import BAND, endings
from controllers.metrics.metrics import Metrics
from controllers.metrics.series import ErrorSeries
from controllers.metrics.space import SpaceErrors, space_errors
from controllers.metrics.vibration import vibrations
from controllers.rig import Rig
from controllers.simulate import Planned as Plan
from controllers.simulate import Runs, Tracking, motion_of
from controllers.task import Task
from kinematics.array import Array, frozen
from planner.pulses.motion import Motion

if TYPE_CHECKING:
    from kinematics.machine import Machine

PERIOD = 1e-3
"""s between the instants at which errors of one run are taken: a fifth of the time constant of a 30 Hz speed loop."""
BATCH_PERIOD = 5e-3
"""s of a batch: that time constant."""


def evaluate(
    tracking: Tracking, plan: Motion | Plan, machine: Machine, *, period: float = PERIOD, band: float = BAND
) -> Metrics:
    """The errors of a tracked plan, every `period` seconds, settling included; of each pose it is proved that it is it.

    Settling, overshoot and vibration are taken at every sample of the record. band: pulses, see `Ending`.

    Raises MotionError if a tracked position is no pose of the machine; of a motion that has no path in space see
    `planned_at`.
    """
    pulse = np.array([axis.pulse for axis in machine.axes])
    actual = ((tracking.actual - machine.home_q) / pulse)[:, None]
    task = Task(tracking.law, motion_of(plan), tracking.dt)
    return _all([tracking.law], tracking.t, actual, [None], task, machine, period, band, certify=True)[0]


def evaluate_runs(
    runs: Runs,
    task: Task,
    rigs: Sequence[Rig],
    *,
    laws: Sequence[str] | None = None,
    period: float = BATCH_PERIOD,
    band: float = BAND,
) -> tuple[Metrics, ...]:
    """The same of a batch of B runs of one task, each on its own rig, in a fraction of the time for each.

    laws  what each run is called; its number, from 1, by default

    No pose is proved: see `space_errors` for what is checked instead, run by run.
    """
    machine = rigs[0].machine
    names = [f"run {b + 1}" for b in range(len(rigs))] if laws is None else laws
    limit = np.array([[drive.torque_limit for drive in rig.drives] for rig in rigs])
    effort = efforts(runs.torque, limit)
    return _all(names, runs.t, runs.actual, effort, task, machine, period, band, certify=False)


def _all(
    names: Sequence[str],
    t: Array,
    actual: Array,
    effort: Sequence[Effort | None],
    task: Task,
    machine: Machine,
    period: float,
    band: float,
    *,
    certify: bool,
) -> tuple[Metrics, ...]:
    """Of B runs: true positions actual (N, B, n), pulses from home, at t (N,)."""
    pulse = frozen([axis.pulse for axis in machine.axes])
    motion = task.motion
    reference = (motion.at(np.minimum(t, motion.duration)).q - machine.home_q) / pulse
    ending = endings(t, actual, reference, motion.duration, pulse, band)
    vibration = vibrations(t, actual, reference, pulse, task.dt)
    every = max(1, round(period / (t[1] - t[0])))
    seen, few = frozen(t[::every]), machine.home_q + actual[::every] * pulse
    planned = planned_at(motion, machine, seen)
    following = np.moveaxis(few - planned.q[:, None], 0, -1)
    beside = chain.from_iterable(_each(of) for of in space_errors(few, planned, machine, certify=certify))

    def series(name: str, unit: str, value: Array) -> ErrorSeries:
        return ErrorSeries(name, unit, frozen(value), planned.place(int(np.abs(value).argmax())))

    def metrics(b: int, tracking: Array, lag: Array, contour: Array, turned: Array | None) -> Metrics:
        return Metrics(
            law=names[b],
            t=seen,
            following=tuple(
                series(axis.name, axis.unit, of) for axis, of in zip(machine.axes, following[b], strict=True)
            ),
            tracking=series("tracking", planned.unit, tracking),
            lag=series("lag", planned.unit, lag),
            orientation=None if turned is None else series("orientation", "rad", turned),
            contour=series("contour", planned.unit, contour),
            ending=ending[b],
            vibration=vibration[b],
            pulse=pulse,
            effort=effort[b],
        )

    return tuple(metrics(b, *errors) for b, errors in enumerate(beside))


def _each(of: SpaceErrors) -> Iterator[tuple[Array, Array, Array, Array | None]]:
    """Of one run after the other."""
    turned = repeat(None) if of.orientation is None else of.orientation.T
    return zip(of.tracking.T, of.lag.T, of.contour.T, turned, strict=False)
