"""Norm-optimal iterative learning control: a motion's command, corrected from trial to trial within limits, and the law
that plays the learned command open loop.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Grid, Reference, ramp
from controllers.laws.nominal import NominalAxes, nominal_axes
from controllers.laws.predictive import Horizon
from controllers.rig import Rig, Task, Timer
from controllers.simulate import sample, simulate
from kinematics.foundation.arrays import Array, freeze_array, freeze_fields
from kinematics.foundation.errors import MotionError


@dataclass(frozen=True, slots=True)
class Learned:
    """The corrected position table of one motion, sent as `ramp` from step to step, whatever the reference says.

    `controllers.learning.learn` makes it. It is right for the motion and the host's step it was learned on, and for no
    other. Of the feedback only the card's own counter is read.

    position  (N + 1, n) pulses, command at k·dt
    turn      (N, n) pulses/s, by how much the speed grows within step k
    """

    position: Array
    turn: Array
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    def __post_init__(self) -> None:
        freeze_fields(self, "position", "turn", dtype=np.float64)

    @property
    def name(self) -> str:
        return "learned"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        steps = len(self.turn)
        turn = np.where(np.asarray(k)[..., None] < steps, self.turn[np.minimum(k, steps - 1)], 0.0)
        target = np.broadcast_to(self.position[np.minimum(np.asarray(k) + 1, steps)], feedback.counter.shape)
        return ramp(target, -turn / 2, turn / 2, feedback.counter, reference.dt)


TAIL_STEPS = 3
"""Steps after the end of the motion that are learned too, in which the axes come to rest."""


@dataclass(frozen=True, slots=True)
class Learning:
    """What trials brought: the law of each, the first being the uncorrected one, and what error each left.

    laws   (trials + 1,)
    error  (trials + 1, n) pulses, RMS of reference − encoder of each axis `STEP_INSTANTS` times a step
    """

    laws: tuple[Learned, ...]
    error: Array

    @property
    def best(self) -> Learned:
        """The law of the trial with the least error over all axes."""
        return self.laws[int((self.error**2).sum(1).argmin())]


def learn(rig: Rig, task: Task, trials: int, *, plant: Rig | None = None, change: float = 0.1) -> Learning:
    """Runs a task, and again after each correction: e of a trial gives the command u⁺ of the next,

    min ‖e − P (u⁺ − u)‖² + s ‖u⁺ − u‖²  within the speeds and accelerations of the machine,

    so u⁺ = u + (PᵀP + s I)⁻¹ Pᵀ e where no limit is active: norm-optimal learning with W = I, S = s I, R = 0, whose
    error falls with every trial as long as P is the plant. u are the speeds at the start and end of each step (times
    dt), P the nominal drives' response to them over the whole motion (`Horizon`); e what the host reads of the encoders
    while it waits, `STEP_INSTANTS` times a step, less the nominal play that they do not see. The first u is the
    reference, as law 3 has it.

    rig     as stated: P and the limits
    plant   what the trials run on, `rig` by default
    change  s: the larger, the smaller the steps from trial to trial
    """
    if trials < 1:
        raise MotionError(f"learning: {trials} trials; at least one is needed")
    if not 0 < change < float("inf"):
        raise MotionError(f"learning: change {change} must be a positive finite number")
    plant, dt = plant or rig, task.dt
    reference = sample(task.motion, rig.machine, dt)
    axes, steps = nominal_axes(rig), reference.steps + TAIL_STEPS
    program = Horizon(axes, dt, steps, change)
    u = np.stack([np.stack([reference.npuls(i), reference.npuls(i + 1)], -1) for i in range(steps)]) * dt
    u = np.moveaxis(u, 0, 1).reshape(len(axes), 2 * steps)
    laws, errors = [], []
    for trial in range(trials + 1):
        laws.append(_law(reference, u))
        e = _errors(reference, laws[-1], plant, axes, program)
        errors.append(np.sqrt(np.mean(e**2, 1)))
        if trial < trials:
            aim = e + (program.driven @ u[..., None])[..., 0]
            u = program.best(np.zeros((len(axes), 4)), aim, u)
    return Learning(tuple(laws), freeze_array(np.stack(errors)))


def fit_feedforward(reference: Reference, law: Learned, axes: NominalAxes) -> NominalAxes:
    """The axes whose feedforward comes nearest to a learned command: what can be taken to another motion.

    Least squares of c(t) − r(t + delay) = ṙ/K at the samples, for K of each axis: a table fits one motion, the gain of
    the drive fits all.
    """
    t = np.linspace(axes.delay, reference.steps * reference.dt + axes.delay, reference.steps + 1)
    r, rd, _ = reference.between(t)
    taken = axes.play / 2 * reference.heading(t)
    lead = law.position[: reference.steps + 1] - r - taken
    return replace(axes, position_gain=(rd**2).sum(0) / (rd * lead).sum(0))


def _law(reference: Reference, u: Array) -> Learned:
    """The table of commands of u (n, 2 · steps)."""
    start, end = u[:, 0::2].T, u[:, 1::2].T
    way = np.cumsum(np.concatenate([np.zeros((1, u.shape[0])), (start + end) / 2]), 0)
    return Learned(reference.position[0] + way, (end - start) / reference.dt)


def _errors(reference: Reference, law: Learned, plant: Rig, axes: NominalAxes, program: Horizon) -> Array:
    """Reference and half the nominal play − encoder (n, steps · m), pulses, at the program's instants."""
    runs = simulate(reference, law, [plant], settle=(TAIL_STEPS + 1) * reference.dt)
    # the undelayed model is where the axes will be
    t = program.instants[:, None] * reference.dt + axes.delay
    at = np.minimum(np.searchsorted(runs.t, t - 1e-9), len(runs.t) - 1)
    read = np.take_along_axis(runs.measured[:, 0], at, 0)
    return np.asarray(reference.between(t)[0] + axes.play / 2 * reference.heading(t) - read).T
