"""Norm-optimal iterative learning control: the command of one motion, corrected from trial to trial
within limits.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Grid, Reference, ramp
from controllers.laws.nominal import NominalAxes, nominal_axes
from controllers.laws.predictive import Horizon
from controllers.rig import Rig, Task, Timer
from controllers.simulate import sample, simulate
from kinematics.foundation.arrays import Array


@dataclass(frozen=True, slots=True)
class Learned:
    """The corrected table of commands of one motion.

    As a law it sends the table and reads only the card's counter.

    It is valid for the motion and the step of the host on which it was learned.

    position  (N + 1, n) pulses, command at k·dt
    turn      (N, n) pulses/s, change of the speed within step k
    """

    position: Array
    turn: Array
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {}

    @property
    def name(self) -> str:
        return "learned"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        steps = len(self.turn)
        step = np.asarray(k)
        turn = np.where(step[..., None] < steps, self.turn[np.minimum(step, steps - 1)], 0.0)
        target = np.broadcast_to(self.position[np.minimum(step + 1, steps)], feedback.counter.shape)
        return ramp(target, -turn / 2, turn / 2, feedback.counter, reference.dt)


# Steps after the end of the motion that are learned too: the axes come to rest in them.
TAIL_STEPS = 3
# σ, the weight on changes of the command: a larger one takes smaller steps from trial to trial.
CHANGE_WEIGHT = 0.1


@dataclass(frozen=True, slots=True)
class Learning:
    """The law of each trial, the first one uncorrected, and the error that it left.

    laws   (trials + 1,)
    error  (trials + 1, n) pulses, RMS of reference − encoder of each axis
    """

    laws: tuple[Learned, ...]
    error: Array

    @property
    def best(self) -> Learned:
        """The law of the trial with the least error over all axes."""
        return self.laws[int((self.error**2).sum(1).argmin())]


def learn(rig: Rig, task: Task, trials: int, *, plant: Rig | None = None) -> Learning:
    """Run a task, then correct its command and run it again, `trials` times.

    From an error e the next command is

    u⁺ = arg min ‖e − P (u⁺ − u)‖² + σ ‖u⁺ − u‖²  within the limits on speed and acceleration,

    norm-optimal learning with W = I, S = σ I, R = 0 (docs/theory/laws.md). u are the speeds at the
    start and the end of each step (times dt), P the response of the nominal drives to u over the
    whole motion (`Horizon`), e the error of the encoders. The first u is that of the reference.

    rig    gives P and the limits
    plant  the rig on which the trials run; `rig` by default
    """
    dt = task.dt
    reference = sample(task.motion, rig.machine, dt)
    axes = nominal_axes(rig)
    steps = reference.steps + TAIL_STEPS
    program = Horizon(axes, dt, steps, CHANGE_WEIGHT)

    speeds = [np.stack([reference.npuls(k), reference.npuls(k + 1)], -1) for k in range(steps)]
    u = np.moveaxis(np.stack(speeds) * dt, 0, 1).reshape(len(axes), 2 * steps)
    at_rest = np.zeros((len(axes), 4))

    laws: list[Learned] = []
    errors: list[Array] = []
    for trial in range(trials + 1):
        laws.append(_tabulate(reference, u))
        e = _measure_error(reference, laws[-1], plant or rig, axes, program)
        errors.append(np.sqrt(np.mean(e**2, 1)))
        if trial < trials:
            target = e + (program.driven @ u[..., None])[..., 0]
            u = program.best(at_rest, target, u)
    return Learning(tuple(laws), np.stack(errors))


def fit_feedforward(reference: Reference, law: Learned, axes: NominalAxes) -> NominalAxes:
    """Fit the position gain K of each axis to a learned command: K carries over to other motions,
    the table does not.

    Least squares of c(t) − r(t + delay) = ṙ/K over the samples.
    """
    t = np.linspace(axes.delay, reference.steps * reference.dt + axes.delay, reference.steps + 1)
    r, rd, _ = reference.between(t)
    play = axes.play / 2 * reference.heading(t)
    lead = law.position[: reference.steps + 1] - r - play
    return replace(axes, position_gain=(rd**2).sum(0) / (rd * lead).sum(0))


def _tabulate(reference: Reference, u: Array) -> Learned:
    """Return the table of commands for u (n, 2 · steps)."""
    start = u[:, 0::2].T
    end = u[:, 1::2].T
    travel = np.cumsum(np.concatenate([np.zeros((1, len(u))), (start + end) / 2]), 0)
    return Learned(reference.position[0] + travel, (end - start) / reference.dt)


def _measure_error(
    reference: Reference, law: Learned, plant: Rig, axes: NominalAxes, program: Horizon
) -> Array:
    """Return reference − encoder (n, steps · m), pulses, at the instants of `program`.

    Half of the nominal play is added, which the encoders do not see.
    """
    runs = simulate(reference, law, [plant], settle=(TAIL_STEPS + 1) * reference.dt)
    # P has no dead time: the plant is where P says `delay` later
    t = program.instants[:, None] * reference.dt + axes.delay
    index = np.minimum(np.searchsorted(runs.t, t - 1e-9), len(runs.t) - 1)
    encoder = np.take_along_axis(runs.measured[:, 0], index, 0)
    play = axes.play / 2 * reference.heading(t)
    return np.asarray(reference.between(t)[0] + play - encoder).T
