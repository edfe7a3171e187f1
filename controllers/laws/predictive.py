"""Ours: preview model-predictive control with speed and acceleration limits.

The best command over some steps of nominal axes, within these limits, is a quadratic program:
solved by OSQP, which only this file imports. What the Coulomb friction of these axes does where a
motion starts or turns is taken into account.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar

import numpy as np

from controllers.card import TAMove
from controllers.laws.law import Feedback, Gain, Grid, Reference, check_gain, format_gain, ramp
from controllers.laws.nominal import NominalAxes, friction_response, response, usual_axes
from controllers.laws.open_loop import Feedforward
from controllers.rig import Timer
from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError

_INITIAL_RHO = 1.0
"""OSQP's rho at the start of every solve."""
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-6,
    "eps_rel": 1e-9,
    "max_iter": 20_000,
    # by iterations, not by time: the same vectors give the same result on any day
    "adaptive_rho": 1,
    "adaptive_rho_interval": 25,
    # it would print a line of its own for every solve without active limits
    "polishing": False,
}


class QuadraticProgram:
    """A program set up once: P (N, N) positive definite and A (M, N), dense or sparse, are
    factorized here.
    """

    def __init__(self, P: Array, A: Array) -> None:
        import osqp
        from scipy.sparse import csc_matrix, triu

        rows, columns = A.shape
        self._solver = osqp.OSQP()
        self._solver.setup(
            csc_matrix(triu(csc_matrix(P))),
            np.zeros(columns),
            csc_matrix(A),
            np.full(rows, -np.inf),
            np.full(rows, np.inf),
            **_SETTINGS,
        )
        self._still = np.zeros(rows)

    def solve(self, q: Array, low: Array, high: Array, guess: Array) -> Array:
        """Return the minimum w (N,), started from `guess`.

        Where OSQP ends early this is its last iterate, and where it has none, `guess`. The caller
        brings either within the limits.
        """
        # the result is a function of the vectors alone, not of what was solved before
        self._solver.update_settings(rho=_INITIAL_RHO)
        self._solver.update(q=q, l=low, u=high)
        self._solver.warm_start(x=guess, y=self._still)
        result = self._solver.solve(raise_error=False)
        w = np.asarray(result.x, float)
        return w if np.isfinite(w).all() else guess


STEP_INSTANTS = 5
"""m, instants in each step at which an error counts: what happens between samples is error too."""


class Horizon:
    """min ‖r − x‖² + ρ ‖w − w₀‖²,  x = O s + Γ w,  |w| ≤ v_max dt,  |Δw| ≤ a_max dt², for n axes
    over H steps.

    w (n, 2 H)   the command's speeds at the start and the end of each step, times dt: pulses
    x, r         (n, H·m) positions at m instants in each step, pulses; what is reached, and wanted
    s (n, 4)     the state at the start, see `Response`
    Δw           changes of speed within steps, where steps meet, and from the drive's own speed to
                 the first

    Only vectors change from one `best` to the next: the matrices are factorized once.
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, weight: float) -> None:
        n = len(axes)
        loops = np.isfinite(axes.position_gain)
        if not loops.all():
            raise MotionError(
                f"model of the axes: axis {int(np.argmin(loops)) + 1} has no position loop to predict (a stepper); "
                "use law feedforward for it"
            )
        self._weight, self._dt = weight, dt
        self.free, self.driven = response(axes, dt, STEP_INSTANTS).extend(steps)
        """O (n, H·m, 4) and Γ (n, H·m, 2 H)."""
        self.instants = freeze_array(np.arange(1, steps * STEP_INSTANTS + 1) / STEP_INSTANTS)
        """(H·m,) the instants of x and r, in steps from the start."""
        speed, change = (
            np.broadcast_to(of, n)[:, None]
            for of in (axes.max_speed * dt, axes.max_acceleration * dt**2)
        )
        size = 2 * steps
        self._bound = np.concatenate([np.repeat(speed, size, 1), np.repeat(change, size, 1)], 1)
        self.hessian = np.swapaxes(self.driven, 1, 2) @ self.driven + weight * np.eye(size)
        """ΓᵀΓ + ρ I, (n, 2 H, 2 H): half of the cost's second derivative."""
        rows = np.concatenate([np.eye(size), np.eye(size) - np.eye(size, k=-1)])
        self._program = QuadraticProgram(_blocks(self.hessian), _blocks(np.stack([rows] * n)))

    def pull(self, state: Array, wanted: Array, guide: Array) -> Array:
        """Γᵀ(r − O s) + ρ w₀, (n, 2 H): the unconstrained best w solves (ΓᵀΓ + ρ I) w = this."""
        error = wanted - (self.free @ state[..., None])[..., 0]
        return np.asarray(
            (np.swapaxes(self.driven, 1, 2) @ error[..., None])[..., 0] + self._weight * guide
        )

    def best(self, state: Array, wanted: Array, guide: Array) -> Array:
        """Return the best w (n, 2 H) from s, for r and w₀; it always stays within the limits.

        One command of the card runs one way, so steps whose best speeds have two signs are bound to
        one sign and the program is solved once more. The sign is that of a step's mean speed. Where
        the acceleration limit does not allow it, because the axis cannot brake before the step
        begins, the axis brakes within the step instead: the step gets the sign of its start speed.
        Braking to rest and staying there satisfies these signs, so the second program always has a
        solution. A step that turns only in that solution is left to `ramp`.
        """
        size = guide.shape[1]
        pull = -self.pull(state, wanted, guide).ravel()
        speed, change = self._bound[:, :size], self._bound[:, size]
        # a drive that is too fast already, or runs the other way, must not make the program
        # infeasible
        now = np.clip(state[:, 1] * self._dt, -speed[:, 0] - change, speed[:, 0] + change)

        w = self._solve(pull, (-speed, speed), now, guide)
        start, end = w[:, 0::2], w[:, 1::2]
        turns = start * end < 0
        if not turns.any():
            return w

        bounds = _bind(speed, turns, start + end >= 0)
        least, most = self._reach(bounds, now)
        stuck = np.asarray((least > most).any(axis=1))[:, None]
        bounds = _bind(speed, turns, np.where(stuck, start, start + end) >= 0)
        return self._solve(pull, bounds, now, w)

    def _solve(self, pull: Array, bounds: tuple[Array, Array], now: Array, guess: Array) -> Array:
        """Return the best w (n, 2 H) within bounds of speed, from the speeds `now` (n,), starting
        at `guess`.
        """
        change = self._bound[:, guess.shape[1] :]
        centre = np.zeros_like(change)
        centre[:, 0] = now
        low = np.concatenate([bounds[0], centre - change], 1)
        high = np.concatenate([bounds[1], centre + change], 1)
        w = self._program.solve(pull, low.ravel(), high.ravel(), guess.ravel()).reshape(guess.shape)
        return self._limit(w, bounds, now)

    def _reach(self, bounds: tuple[Array, Array], now: Array) -> tuple[Array, Array]:
        """Return the least and largest speeds (n, 2 H) that lie on some motion within all limits;
        least > most: none.

        A speed must be reachable from the one before it, which starts at `now`, and must leave the
        next one reachable.
        """
        change = self._bound[:, bounds[0].shape[1]]
        least, most = bounds[0].copy(), bounds[1].copy()
        before = now, now
        for k in range(least.shape[1]):
            least[:, k] = np.maximum(least[:, k], before[0] - change)
            most[:, k] = np.minimum(most[:, k], before[1] + change)
            before = least[:, k], most[:, k]
        for k in range(least.shape[1] - 2, -1, -1):
            least[:, k] = np.maximum(least[:, k], least[:, k + 1] - change)
            most[:, k] = np.minimum(most[:, k], most[:, k + 1] + change)
        return least, most

    def _limit(self, w: Array, bounds: tuple[Array, Array], now: Array) -> Array:
        """Bring w within all limits, which OSQP meets only to its tolerance, or not at all where it
        ends early.
        """
        change = self._bound[:, w.shape[1]]
        least, most = self._reach(bounds, now)
        limited = np.empty_like(w)
        before = now
        for k in range(w.shape[1]):
            low, high = (
                np.maximum(least[:, k], before - change),
                np.minimum(most[:, k], before + change),
            )
            limited[:, k] = before = np.clip(w[:, k], low, high)
        return limited


def _bind(speed: Array, turns: np.ndarray, forward: np.ndarray) -> tuple[Array, Array]:
    """Return bounds (n, 2 H) of ±`speed`, where both speeds of each step that turns are bound to
    one sign.

    turns, forward  (n, H): which steps turn, and the way that these are to run
    """
    turning, ahead = np.repeat(turns, 2, axis=1), np.repeat(forward, 2, axis=1)
    return np.where(turning & ahead, 0.0, -speed), np.where(turning & ~ahead, 0.0, speed)


def _blocks(of: Array) -> Array:
    """The block-diagonal matrix of blocks (n, a, b)."""
    n, a, b = of.shape
    whole = np.zeros((n, a, n, b))
    whole[np.arange(n), :, np.arange(n)] = of
    return whole.reshape(n * a, n * b)


PLACES_PER_STEP = 25
"""Places in each step where friction may turn: 5 ms apart at the thesis' step, a sixth of the
drives' integral time.
"""


class Friction:
    """x (…, n, M) by what the friction changes over H steps: Σⱼ −γ g(tᵢ − tⱼ) Δhⱼ at M instants tᵢ.

    h is the way an axis runs, ±1, and Δhⱼ its change at place tⱼ; g the response to a unit
    acceleration from outside. The friction at the start is in the drive's integral already.

    instants  (M,) steps from the start, whole multiples of 1/(2 PLACES_PER_STEP)
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, instants: Array) -> None:
        self.places = freeze_array(np.arange(steps * PLACES_PER_STEP + 1) / PLACES_PER_STEP)
        """(H · PLACES_PER_STEP + 1,) where h is to be told, in steps from the start."""
        # a change is seen at the end of the stretch in which it happened, so half a stretch late
        late = instants[:, None] - (self.places[1:] - 0.5 / PLACES_PER_STEP)
        ticks = np.maximum(np.rint(late * 2 * PLACES_PER_STEP), 0).astype(int)
        g = friction_response(axes, dt / (2 * PLACES_PER_STEP), int(ticks.max()))[:, ticks]
        self._effect = -np.broadcast_to(axes.coulomb, len(g))[:, None, None] * g

    def respond(self, heading: Array) -> Array:
        """x (…, n, M) for h (H · PLACES_PER_STEP + 1, …, n)."""
        change = np.moveaxis(np.diff(heading, axis=0), 0, -1)
        return np.asarray((self._effect @ change[..., None])[..., 0])


@dataclass(frozen=True, slots=True)
class Predictive:
    """Preview predictive control: commands over the next H steps that bring a nominal drive closest
    to the reference.

    The program is `Horizon`'s, from the state s = (x, v, i, c) of the moment and around the
    feedforward law's command; its first step is sent, as `ramp`. The state is read anew at each
    step, so that the law keeps none: x from the encoder, c from the card's counter, and v = K (c −
    x), i = β v + r̈, which a speed loop much faster than the step holds to. A dead time is met as
    in `Feedforward`: the undelayed drive is to be where the reference will be.

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
    reads_encoder: ClassVar[bool] = True
    host: ClassVar[Timer] = "counter"
    grid: ClassVar[Grid] = {
        "weight": (1e-3, 1e-2, 1e-1, 1.0),
        "play": (0.0, 1.0),
        "friction": (0.0, 1.0),
    }

    def __post_init__(self) -> None:
        for name in ("weight", "play", "friction"):
            object.__setattr__(
                self,
                name,
                check_gain("predictive", name, getattr(self, name), "0.01 and 1 are usual"),
            )
        if not np.all(np.asarray(self.weight) > 0):
            raise MotionError(
                f"law predictive: weight {format_gain(self.weight)} must be above zero"
            )
        if self.horizon != int(self.horizon) or self.horizon < 1:
            raise MotionError(
                f"law predictive: horizon {self.horizon} must be a whole number of steps, at least 1"
            )

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
            rho: _program(self.axes.key(), lanes[-1], dt, self.horizon, rho)
            for rho in np.unique(weight).tolist()
        }
        wanted = np.moveaxis(
            self._target_motion(step, reference, next(iter(programs.values()))), 0, -1
        )
        guide = np.moveaxis(guide, 0, -1)
        w = np.empty((*lanes, 2))
        for run in np.ndindex(lanes[:-1]):
            horizon, _ = programs[float(weight[run][0])]
            w[run] = horizon.best(state[run], wanted[run], guide[run])[:, :2]
        start, end = w[..., 0], w[..., 1]
        return ramp(
            feedback.counter + (start + end) / 2, start / dt, end / dt, feedback.counter, dt
        )

    def _target_motion(
        self, k: np.ndarray, reference: Reference, of: tuple[Horizon, Friction]
    ) -> Array:
        """Where the undelayed motors are to be (H·m, …, n), but for what friction adds by
        itself.
        """
        axes, dt, (horizon, friction) = self.axes, reference.dt, of

        def at(steps: Array) -> Array:
            return (k + steps.reshape((-1,) + (1,) * k.ndim))[..., None] * dt + axes.delay

        t = at(horizon.instants)
        wanted = reference.between(t)[0] + self.play * axes.play / 2 * reference.heading(t)
        by_itself = friction.respond(reference.heading(at(friction.places)))
        return np.asarray(wanted - self.friction * np.moveaxis(by_itself, -1, 0))

    def _guide(self, k: np.ndarray, reference: Reference) -> Array:
        """The feedforward law's speeds at the start and end of each step, times dt: (2 H, …, n)."""
        law, ahead = (
            Feedforward(axes=self.axes),
            np.arange(self.horizon).reshape((-1,) + (1,) * k.ndim),
        )
        starts, ends = (
            law.target_motion(k + ahead, reference)[1],
            law.target_motion(k + ahead + 1, reference, before=True)[1],
        )
        return (
            np.stack([starts, ends], 1).reshape(2 * self.horizon, *starts.shape[1:]) * reference.dt
        )

    def _state(
        self, k: np.ndarray, reference: Reference, feedback: Feedback, speed: Array
    ) -> Array:
        """s (…, n, 4) of the undelayed drive, which is `delay` ahead of the encoder; `speed` is the
        command's.
        """
        axes, c, x = self.axes, feedback.counter, feedback.position
        v = axes.position_gain * (c - axes.delay * speed - x)
        _, _, bend = reference.between(k[..., None] * reference.dt + axes.delay)
        return np.stack(np.broadcast_arrays(x + axes.delay * v, v, axes.friction * v + bend, c), -1)


@lru_cache(maxsize=64)
def _program(
    key: tuple[tuple[float, ...], ...], n: int, dt: float, steps: int, weight: float
) -> tuple[Horizon, Friction]:
    """What is made once for axes, step, horizon and weight."""
    axes = NominalAxes.from_key(key, n)
    horizon = Horizon(axes, dt, steps, weight)
    return horizon, Friction(axes, dt, steps, horizon.instants)
