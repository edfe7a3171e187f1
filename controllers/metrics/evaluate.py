"""From what the axes did to how well they tracked: of one run, or of a batch.

Errors count against the path: in space where the motion has a path there, else in the space of its
axes. For that it is worked out where a motion plans the machine to be, and which poses it really
had.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from controllers.metrics.contour import PlannedStates, contour_error, directions, sample_plan
from controllers.metrics.metrics import (
    END_BAND,
    Effort,
    Ending,
    ErrorSeries,
    Metrics,
    Vibration,
    efforts,
    endings,
    torque_limits,
    vibrations,
)
from controllers.rig import Rig, Task
from controllers.simulate import Runs
from controllers.tracking import HasTrajectory, Tracking, motion_of
from kinematics.analysis.forward import RESIDUAL_TOLERANCE, iterate_newton
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.machine.machine_file import MachineSource, load_machine
from kinematics.machine.pose import from_numbers
from planner.parallel import Progress, ignore_progress, share_progress
from planner.path.actuation import MachinePath
from planner.pulses.motion import AxesMotion

if TYPE_CHECKING:
    from kinematics.machine.machine import Machine

SAME_BRANCH = 0.1
"""Share of the machine's characteristic length by which a platform on legs may be away from its
planned place to be taken for the one that Newton finds from there: other assemblies of the same
legs are about that length away.
"""


def attained_poses(
    actual: Array,
    planned: PlannedStates,
    path: MachinePath,
    machine: Machine,
    *,
    certify: bool,
    tell: Progress = ignore_progress,
) -> tuple[Array, Array, np.ndarray]:
    """Numbers of the planned poses (N, 12), of those attained at axis positions (N, B, n), (N, B,
    12), and which (N, B) of them are known.

    certify  every pose is proved to be the one that the machine is in, and a MotionError names the
             first that is not. Otherwise what is checked is that the pose has the coordinates (to
             1e-9 m or rad), and of machines on legs that the platform is near its planned place
             (`SAME_BRANCH`); what fails there is put at its planned pose.
    """
    n, runs, axes = actual.shape
    reference = path.pose_numbers(planned.s, planned.piece)
    # the planned pose is as near to the attained one as any: a short way to go, and to certify
    q, start = actual.reshape(-1, axes), np.repeat(reference, runs, axis=0)
    x, known = (
        _prove_poses(q, start, planned, machine, tell)
        if certify
        else _estimate_poses(q, start, machine)
    )
    return reference, x.reshape(n, runs, 12), known.reshape(n, runs)


def _prove_poses(
    q: Array, start: Array, planned: PlannedStates, machine: Machine, tell: Progress
) -> tuple[Array, np.ndarray]:
    """Numbers (M, 12) of poses that are all proved."""
    x = np.empty_like(start)
    for first in range(0, len(q), PROVED_AT_ONCE):
        some = slice(first, first + PROVED_AT_ONCE)
        found = machine.forward(q[some], near=from_numbers(start[some]))
        if not found.certified.all():
            lost = (first + int(np.argmin(found.certified))) * len(planned.t) // len(q)
            raise MotionError(
                f"metrics: the axis positions at t = {planned.t[lost]:.4g} s are not a certain pose of machine "
                f"{machine.name}; the tracking left the machine's reach: slow the motion down, or use a law that "
                "tracks it"
            )
        x[some] = found.numbers
        tell(min(first + PROVED_AT_ONCE, len(q)), len(q))
    return x, np.ones(len(q), bool)


def _estimate_poses(q: Array, start: Array, machine: Machine) -> tuple[Array, np.ndarray]:
    """Numbers (M, 12) of the poses found, and which of them (M,) pass the checks; the others are as
    planned.
    """
    x, residual = iterate_newton(machine, q, start)
    sure = residual < RESIDUAL_TOLERANCE
    if machine.lengths:
        sure &= (
            np.linalg.norm(x[:, :3] - start[:, :3], axis=1)
            < SAME_BRANCH * machine.characteristic_length
        )
    return np.where(sure[:, None], x, start), sure


BLOCK_POSES = 1 << 17
"""Poses worked on together: they take some hundred megabytes."""
PROVED_AT_ONCE = 1 << 12
"""Poses proved between two words of progress: some tenths of a second."""


@dataclass(frozen=True, slots=True)
class SpaceErrors:
    """‖e‖, t̂ᵀe, ε and ‖log(R_rᵀ R)‖ of runs, (N, runs); no orientation where there is no pose.

    planned (N, d), attained (N, runs, d): where the platform's origin was to be and was, or the
    axes
    """

    planned: Array
    attained: Array
    tracking: Array
    lag: Array
    contour: Array
    orientation: Array | None


def space_errors(
    actual: Array,
    planned: PlannedStates,
    machine: Machine,
    *,
    certify: bool,
    progress: Progress = ignore_progress,
) -> Iterator[SpaceErrors]:
    """Of axis positions (N, B, n), some runs at a time; certify as in `attained_poses`.

    A run with a pose that is not known has nan throughout.
    """
    n, runs, _ = actual.shape
    at_once, path = max(1, BLOCK_POSES // n), planned.path
    for start in range(0, runs, at_once):
        some = actual[:, start : start + at_once]
        tell = share_progress(progress, start // at_once, -(-runs // at_once))
        yield (
            _curve_errors(some, planned.q, planned, None)
            if path is None
            else _pose_errors(some, planned, path, machine, certify, tell)
        )
        tell(1, 1)


def _pose_errors(
    actual: Array,
    planned: PlannedStates,
    path: MachinePath,
    machine: Machine,
    certify: bool,
    tell: Progress,
) -> SpaceErrors:
    reference, attained, known = attained_poses(
        actual, planned, path, machine, certify=certify, tell=tell
    )
    turned = _angles(reference[:, None, 3:], attained[..., 3:])
    errors = _curve_errors(attained[..., :3], reference[:, :3], planned, turned)
    sure = np.asarray(known.all(0))
    if sure.all():
        return errors
    figures = (
        np.where(sure, of, np.nan) for of in (errors.tracking, errors.lag, errors.contour, turned)
    )
    return SpaceErrors(errors.planned, np.where(sure[:, None], errors.attained, np.nan), *figures)


def _curve_errors(
    actual: Array, reference: Array, planned: PlannedStates, orientation: Array | None
) -> SpaceErrors:
    error = actual - reference[:, None]
    along = directions(planned.curve, planned.s, planned.piece)
    return SpaceErrors(
        reference,
        actual,
        np.linalg.norm(error, axis=2),
        np.einsum("nbd,nd->nb", error, along),
        contour_error(actual, planned.s, planned.curve).error,
        orientation,
    )


def _angles(reference: Array, actual: Array) -> Array:
    """‖log(R_rᵀ R)‖ = atan2(‖v‖, tr M − 1) with v = vee(M − Mᵀ), M = R_rᵀ R, of rotations by rows
    (…, 9).

    Exact for small angles too.
    """
    before, after = (of.reshape(*of.shape[:-1], 3, 3) for of in (reference, actual))
    turn = before.swapaxes(-1, -2) @ after
    v = (turn - turn.swapaxes(-1, -2))[..., [2, 0, 1], [1, 2, 0]]
    return np.asarray(
        np.arctan2(np.linalg.norm(v, axis=-1), np.trace(turn, axis1=-2, axis2=-1) - 1)
    )


PERIOD = 1e-3
"""s between the instants at which errors of one run are taken: a fifth of the time constant of a 30
Hz speed loop.
"""
BATCH_PERIOD = 5e-3
"""s of a batch: that time constant."""


@check_arguments("plan", "machine")
def evaluate(
    tracking: Tracking,
    plan: AxesMotion | HasTrajectory,
    machine: MachineSource,
    *,
    period: float = PERIOD,
    band: float = END_BAND,
    progress: Progress = ignore_progress,
) -> Metrics:
    """Errors of a tracked plan, settling included; every pose is certified.

    Parameters
    ----------
    tracking
        What `track` gave.
    plan, machine
        As they were given to `track`.
    period
        s between the instants at which errors are taken; settling, overshoot and vibration are
        taken at every sample
        of the record.
    band
        Pulses around the end in which an axis has arrived, see `Ending`.
    progress
        Called with how many poses are worked out, and of how many.

    Returns
    -------
    Metrics
        Following, tracking, contour and orientation errors over time, and what follows from them.

    Raises
    ------
    MotionError
        A tracked position is no pose of the machine; of a motion that has no path in space see
        `sample_plan`.
    """
    return evaluate_each([tracking], plan, machine, period=period, band=band, progress=progress)[0]


def evaluate_each(
    tracked: Sequence[Tracking],
    plan: AxesMotion | HasTrajectory,
    machine: MachineSource,
    *,
    period: float = PERIOD,
    band: float = END_BAND,
    progress: Progress = ignore_progress,
) -> tuple[Metrics, ...]:
    """The same of several trackings at the same instants (`track_each`), in less time for each."""
    machine = (
        load_machine(machine)
        if isinstance(machine, str | PathLike) or not hasattr(machine, "axes")
        else machine
    )
    first = tracked[0]
    pulse = np.array([axis.pulse for axis in machine.axes])
    actual = np.stack([(each.actual - machine.home_q) / pulse for each in tracked], 1)
    end = np.repeat(2 * first.t[-1:] - first.t[-2:-1], len(tracked))
    task = Task(first.law, motion_of(plan), first.dt)
    names = [each.law for each in tracked]
    lanes = _RunRecords(first.t, actual, end, lost=np.stack([each.lost for each in tracked]))
    return _build_metrics(
        names, lanes, task, machine, period, band, certify=True, progress=progress
    )


def evaluate_runs(
    runs: Runs,
    task: Task,
    rigs: Sequence[Rig],
    *,
    laws: Sequence[str] | None = None,
    period: float = BATCH_PERIOD,
    band: float = END_BAND,
) -> tuple[Metrics, ...]:
    """The same of a batch of B runs of one task, each on its own rig, in a fraction of the time for
    each.

    laws  what each run is called; its number, from 1, by default

    No pose is proved: `attained_poses` says what is checked instead. A run of which a pose is not
    known has nan for its errors in space; the others are not touched by it.
    """
    names = [f"run {b + 1}" for b in range(len(rigs))] if laws is None else laws
    lanes = _RunRecords(runs.t, runs.actual, runs.end, runs.torque, torque_limits(rigs), runs.lost)
    return _build_metrics(names, lanes, task, rigs[0].machine, period, band, certify=False)


@dataclass(frozen=True, slots=True)
class _RunRecords:
    """Records of B runs: true positions actual (N, B, n), pulses from home, at t (N,) s; run b ends
    at end[b].
    """

    t: Array
    actual: Array
    end: Array
    torque: Array | None = None
    limit: Array | None = None
    lost: np.ndarray | None = None

    def samples(self, every: int = 1) -> np.ndarray:
        """(B,) how many of every so many samples lie before the end."""
        return np.asarray(
            np.searchsorted(self.t[::every], self.end - 1e-6 * (self.t[1] - self.t[0]))
        )


def _build_metrics(
    names: Sequence[str],
    lanes: _RunRecords,
    task: Task,
    machine: Machine,
    period: float,
    band: float,
    *,
    certify: bool,
    progress: Progress = ignore_progress,
) -> tuple[Metrics, ...]:
    t = lanes.t
    pulse = freeze_array([axis.pulse for axis in machine.axes])
    if not 0 < period < float("inf"):
        raise MotionError(f"evaluate: period {period} s must be above zero")
    if not 0 <= band < float("inf"):
        raise MotionError(f"evaluate: band {band} must be 0 pulses or more")
    shafts = _shafts(lanes, task, machine, pulse, band)
    every = max(1, round(period / (t[1] - t[0])))
    few, planned = (
        machine.home_q + lanes.actual[::every] * pulse,
        sample_plan(task.motion, machine, t[::every]),
    )
    following, until = few - planned.q[:, None], lanes.samples(every)
    found: list[Metrics] = []
    for errors in space_errors(few, planned, machine, certify=certify, progress=progress):
        for lane in range(errors.tracking.shape[1]):
            b = len(found)
            own = slice(until[b])

            def series(name: str, unit: str, value: Array, own: slice = own) -> ErrorSeries:
                return ErrorSeries(
                    name,
                    unit,
                    freeze_array(value[own]),
                    planned.place(int(np.abs(value[own]).argmax())),
                )

            ending, vibration, effort = shafts[b]
            turned = errors.orientation
            found.append(
                Metrics(
                    law=names[b],
                    t=freeze_array(planned.t[own]),
                    following=tuple(
                        series(axis.name, axis.unit, following[:, b, i])
                        for i, axis in enumerate(machine.axes)
                    ),
                    tracking=series("tracking", planned.unit, errors.tracking[:, lane]),
                    lag=series("lag", planned.unit, errors.lag[:, lane]),
                    orientation=None
                    if turned is None
                    else series("orientation", "rad", turned[:, lane]),
                    contour=series("contour", planned.unit, errors.contour[:, lane]),
                    ending=ending,
                    vibration=vibration,
                    pulse=pulse,
                    planned=freeze_array(errors.planned[own]),
                    attained=freeze_array(errors.attained[own, lane]),
                    effort=effort,
                    lost_steps=None
                    if lanes.lost is None
                    else freeze_array(lanes.lost[b], np.float64),
                )
            )
    return tuple(found)


def _shafts(
    lanes: _RunRecords, task: Task, machine: Machine, pulse: Array, band: float
) -> list[tuple[Ending, Vibration, Effort | None]]:
    """What is taken of each shaft at every sample; of runs with equally many samples together."""
    motion, counts = task.motion, lanes.samples()
    reference = (motion.at(np.minimum(lanes.t, motion.duration)).q - machine.home_q) / pulse
    found: dict[int, tuple[Ending, Vibration, Effort | None]] = {}
    for count in np.unique(counts).tolist():
        alike = np.flatnonzero(counts == count)
        some = slice(None) if len(alike) == len(counts) else alike
        t, actual, planned = lanes.t[:count], lanes.actual[:count, some], reference[:count]
        effort: Sequence[Effort | None] = [None] * len(alike)
        if lanes.torque is not None and lanes.limit is not None:
            effort = efforts(lanes.torque[:count, some], lanes.limit[some])
        ending = endings(t, actual, planned, motion.duration, pulse, band)
        vibration = vibrations(t, actual, planned, pulse, task.dt)
        found.update(zip(alike.tolist(), zip(ending, vibration, effort, strict=True), strict=True))
    return [found[b] for b in range(len(counts))]
