"""The best command over some steps of nominal axes, within limits of speed and acceleration: a quadratic program."""

from __future__ import annotations

import numpy as np

from controllers.laws.nominal import NominalAxes
from controllers.laws.osqp_ import QuadraticProgram
from controllers.laws.response import response
from kinematics.array import Array
from kinematics.errors import MotionError

INSTANTS = 5
"""Instants in each step at which an error counts: what happens between samples is error too."""
FINE = 25
"""Places in each step where friction may turn: 5 ms apart at the thesis' step, a sixth of the integral time."""


class Horizon:
    """min ‖r − x‖² + ρ ‖w − w₀‖²,  x = O s + Γ w,  |w| ≤ v_max dt,  |Δw| ≤ a_max dt², for n axes over H steps.

    w (n, 2 H)   the command's speeds at the start and the end of each step, times dt: pulses
    x, r         (n, H·m) positions at m = `INSTANTS` instants in each step, pulses; what is reached, and wanted
    s (n, 4)     the state at the start, see `Response`
    Δw           changes of speed within steps, where steps meet, and from the drive's own speed to the first

    Only vectors change from one `best` to the next: the matrices are factorized once.
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, weight: float) -> None:
        n = len(axes)
        loops = np.isfinite(axes.position_gain)
        if not loops.all():
            raise MotionError(
                f"model of the axes: axis {int(np.argmin(loops)) + 1} has no position loop to predict (a stepper); "
                "law feedforward sends it where it is to be"
            )
        self._weight, self._dt = weight, dt
        self.free, self.driven = response(axes, dt, INSTANTS).over(steps)
        """O (n, H·m, 4) and Γ (n, H·m, 2 H)."""
        speed, change = (np.broadcast_to(of, n)[:, None] for of in (axes.max_speed * dt, axes.max_acceleration * dt**2))
        self._top = speed
        size = 2 * steps
        self._bound = np.concatenate([np.repeat(speed, size, 1), np.repeat(change, size, 1)], 1)
        self.hessian = np.swapaxes(self.driven, 1, 2) @ self.driven + weight * np.eye(size)
        """ΓᵀΓ + ρ I, (n, 2 H, 2 H): half of the cost's second derivative."""
        rows = np.concatenate([np.eye(size), np.eye(size) - np.eye(size, k=-1)])
        self._program = QuadraticProgram("law predictive", _blocks(self.hessian), _blocks(np.stack([rows] * n)))

    @staticmethod
    def instants(steps: int) -> Array:
        """(H·m,) the instants of x and r, in steps from the start."""
        return np.arange(1, steps * INSTANTS + 1) / INSTANTS

    def pull(self, state: Array, wanted: Array, guide: Array) -> Array:
        """Γᵀ(r − O s) + ρ w₀, (n, 2 H): the unconstrained best w solves (ΓᵀΓ + ρ I) w = this."""
        error = wanted - (self.free @ state[..., None])[..., 0]
        return np.asarray((np.swapaxes(self.driven, 1, 2) @ error[..., None])[..., 0] + self._weight * guide)

    def best(self, state: Array, wanted: Array, guide: Array) -> Array:
        """The best w (n, 2 H) from s, for r and w₀. Raises MotionError where OSQP finds none."""
        # a drive that runs too fast already is not to make the program impossible
        now = np.clip(state[:, 1:2] * self._dt, -self._top, self._top)
        centre = np.zeros_like(self._bound)
        centre[:, guide.shape[1]] = now[:, 0]
        low, high = (centre - self._bound).ravel(), (centre + self._bound).ravel()
        w = self._program.solve(-self.pull(state, wanted, guide).ravel(), low, high, guide.ravel())
        return w.reshape(guide.shape)


def _blocks(of: Array) -> Array:
    """The block-diagonal matrix of blocks (n, a, b)."""
    n, a, b = of.shape
    whole = np.zeros((n, a, n, b))
    whole[np.arange(n), :, np.arange(n)] = of
    return whole.reshape(n * a, n * b)
