"""Ours: preview model-predictive control with speed and acceleration limits.

What the Coulomb friction of nominal axes does to their positions where a motion starts or turns.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.horizon import Horizon
from controllers.laws.law import Feedback, Gain, Grid, Reference, Timer, check_gain, format_gain, ramp
from controllers.laws.nominal import NominalAxes, friction_response, usual_axes
from controllers.laws.open_loop import Feedforward
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError

PLACES_PER_STEP = 25
"""Places in each step where friction may turn: 5 ms apart at the thesis' step, a sixth of the drives' integral time."""


class Friction:
    """x (…, n, M) by what the friction changes over H steps: Σⱼ −γ g(tᵢ − tⱼ) Δhⱼ at M instants tᵢ.

    h is the way an axis runs, ±1, and Δhⱼ its change at place tⱼ; g the response to a unit acceleration from outside.
    The friction at the start is in the drive's integral already.

    instants  (M,) steps from the start, whole multiples of 1/(2 FINE)
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, instants: Array) -> None:
        self.places = freeze_array(np.arange(steps * PLACES_PER_STEP + 1) / PLACES_PER_STEP)
        """(H · FINE + 1,) where h is to be told, in steps from the start."""
        # a change is seen at the end of the stretch in which it happened, so half a stretch late
        late = instants[:, None] - (self.places[1:] - 0.5 / PLACES_PER_STEP)
        ticks = np.maximum(np.rint(late * 2 * PLACES_PER_STEP), 0).astype(int)
        g = friction_response(axes, dt / (2 * PLACES_PER_STEP), int(ticks.max()))[:, ticks]
        self._effect = -np.broadcast_to(axes.coulomb, len(g))[:, None, None] * g

    def of(self, heading: Array) -> Array:
        """x (…, n, M) for h (H · FINE + 1, …, n)."""
        change = np.moveaxis(np.diff(heading, axis=0), 0, -1)
        return np.asarray((self._effect @ change[..., None])[..., 0])


@dataclass(frozen=True, slots=True)
class Predictive:
    """At each step, of the commands over the next H steps, that which brings a nominal drive nearest to the reference.

    The program is `Horizon`'s, from the state s = (x, v, i, c) of the moment and around the feedforward law's command;
    its first step is sent, as `ramp`. The state is read anew at each step, so that the law keeps none: x from the
    encoder, c from the card's counter, and v = K (c − x), i = β v + r̈, which a speed loop much faster than the step
    holds to. A dead time is met as in `Feedforward`: the undelayed drive is to be where the reference will be.

    play     share of half the play that is added to the reference, as in `Feedforward`
    weight   ρ of `Horizon`: small follows the model and the encoder, large the feedforward
    friction  share of the nominal Coulomb friction that is foreseen where axes start and turn
    horizon  H steps
    """

    weight: Gain = 0.01
    play: Gain = 1.0
    friction: Gain = 1.0
    horizon: int = 4
    axes: NominalAxes = field(default_factory=usual_axes)
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {"weight": (1e-3, 1e-2, 1e-1, 1.0), "play": (0.0, 1.0), "friction": (0.0, 1.0)}

    def __post_init__(self) -> None:
        for name in ("weight", "play", "friction"):
            object.__setattr__(self, name, check_gain("predictive", name, getattr(self, name), "0.01 and 1 are usual"))
        if not np.all(np.asarray(self.weight) > 0):
            raise MotionError(f"law predictive: weight {format_gain(self.weight)} must be above zero")
        if self.horizon != int(self.horizon) or self.horizon < 1:
            raise MotionError(f"law predictive: horizon {self.horizon} must be a whole number of steps, at least 1")

    @property
    def name(self) -> str:
        gains = f"rho={format_gain(self.weight)} play={format_gain(self.play)} friction={format_gain(self.friction)}"
        return f"predictive {gains} H={self.horizon}"

    def command(self, k: int | np.ndarray, reference: Reference, feedback: Feedback) -> TAMove:
        lanes, dt = feedback.position.shape, reference.dt
        step = np.broadcast_to(k, lanes[:-1])
        guide = self._guide(step, reference)
        state = self._state(step, reference, feedback, guide[0] / dt)
        weight = np.broadcast_to(self.weight, (*lanes[:-1], 1))
        programs = {
            rho: _program(self.axes.key(), lanes[-1], dt, self.horizon, rho) for rho in np.unique(weight).tolist()
        }
        wanted = np.moveaxis(self._wanted(step, reference, next(iter(programs.values()))), 0, -1)
        guide = np.moveaxis(guide, 0, -1)
        w = np.empty((*lanes, 2))
        for run in np.ndindex(lanes[:-1]):
            horizon, _ = programs[float(weight[run][0])]
            w[run] = horizon.best(state[run], wanted[run], guide[run])[:, :2]
        start, end = w[..., 0], w[..., 1]
        return ramp(feedback.counter + (start + end) / 2, start / dt, end / dt, feedback.counter, dt)

    def _wanted(self, k: np.ndarray, reference: Reference, of: tuple[Horizon, Friction]) -> Array:
        """Where the undelayed motors are to be (H·m, …, n), but for what friction adds by itself."""
        axes, dt, (horizon, friction) = self.axes, reference.dt, of

        def at(steps: Array) -> Array:
            return (k + steps.reshape((-1,) + (1,) * k.ndim))[..., None] * dt + axes.delay

        t = at(horizon.instants)
        wanted = reference.between(t)[0] + self.play * axes.play / 2 * reference.heading(t)
        by_itself = friction.of(reference.heading(at(friction.places)))
        return np.asarray(wanted - self.friction * np.moveaxis(by_itself, -1, 0))

    def _guide(self, k: np.ndarray, reference: Reference) -> Array:
        """The feedforward law's speeds at the start and end of each step, times dt: (2 H, …, n)."""
        law, ahead = Feedforward(axes=self.axes), np.arange(self.horizon).reshape((-1,) + (1,) * k.ndim)
        starts, ends = law.wanted(k + ahead, reference)[1], law.wanted(k + ahead + 1, reference, before=True)[1]
        return np.stack([starts, ends], 1).reshape(2 * self.horizon, *starts.shape[1:]) * reference.dt

    def _state(self, k: np.ndarray, reference: Reference, feedback: Feedback, speed: Array) -> Array:
        """s (…, n, 4) of the undelayed drive, which is `delay` ahead of the encoder; `speed` is the command's."""
        axes, c, x = self.axes, feedback.counter, feedback.position
        v = axes.position_gain * (c - axes.delay * speed - x)
        _, _, bend = reference.between(k[..., None] * reference.dt + axes.delay)
        return np.stack(np.broadcast_arrays(x + axes.delay * v, v, axes.friction * v + bend, c), -1)


@lru_cache(maxsize=64)
def _program(
    key: tuple[tuple[float, ...], ...], n: int, dt: float, steps: int, weight: float
) -> tuple[Horizon, Friction]:
    """What is made once for axes, step, horizon and weight."""
    axes = NominalAxes.of(key, n)
    horizon = Horizon(axes, dt, steps, weight)
    return horizon, Friction(axes, dt, steps, horizon.instants)
