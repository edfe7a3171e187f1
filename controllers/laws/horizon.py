"""The best command over some steps of nominal axes, within limits of speed and acceleration: a quadratic program, by
OSQP, which only this file imports.
"""

from __future__ import annotations

import numpy as np

from controllers.laws.nominal import NominalAxes, response
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
    """A program set up once: P (N, N) positive definite and A (M, N), dense or sparse, are factorized here."""

    def __init__(self, what: str, P: Array, A: Array) -> None:
        import osqp
        from scipy.sparse import csc_matrix, triu

        self._what = what
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
        """The minimum w (N,), started from `guess`. Raises MotionError where OSQP finds none within the limits."""
        # the result is a function of the vectors alone, not of what was solved before
        self._solver.update_settings(rho=_INITIAL_RHO)
        self._solver.update(q=q, l=low, u=high)
        self._solver.warm_start(x=guess, y=self._still)
        result = self._solver.solve(raise_error=False)
        if result.info.status != "solved":
            raise MotionError(
                f"{self._what}: OSQP ends with {result.info.status!r} after {result.info.iter} iterations; "
                "loosen the speed or acceleration limits, or slow the motion down"
            )
        return np.asarray(result.x)


INSTANTS = 5
"""m, instants in each step at which an error counts: what happens between samples is error too."""


class Horizon:
    """min ‖r − x‖² + ρ ‖w − w₀‖²,  x = O s + Γ w,  |w| ≤ v_max dt,  |Δw| ≤ a_max dt², for n axes over H steps.

    w (n, 2 H)   the command's speeds at the start and the end of each step, times dt: pulses
    x, r         (n, H·m) positions at m instants in each step, pulses; what is reached, and wanted
    s (n, 4)     the state at the start, see `Response`
    Δw           changes of speed within steps, where steps meet, and from the drive's own speed to the first

    Only vectors change from one `best` to the next: the matrices are factorized once.
    """

    def __init__(self, axes: NominalAxes, dt: float, steps: int, weight: float, instants: int = INSTANTS) -> None:
        n = len(axes)
        loops = np.isfinite(axes.position_gain)
        if not loops.all():
            raise MotionError(
                f"model of the axes: axis {int(np.argmin(loops)) + 1} has no position loop to predict (a stepper); "
                "use law feedforward for it"
            )
        self._weight, self._dt = weight, dt
        self.free, self.driven = response(axes, dt, instants).over(steps)
        """O (n, H·m, 4) and Γ (n, H·m, 2 H)."""
        self.instants = freeze_array(np.arange(1, steps * instants + 1) / instants)
        """(H·m,) the instants of x and r, in steps from the start."""
        speed, change = (np.broadcast_to(of, n)[:, None] for of in (axes.max_speed * dt, axes.max_acceleration * dt**2))
        size = 2 * steps
        self._bound = np.concatenate([np.repeat(speed, size, 1), np.repeat(change, size, 1)], 1)
        self.hessian = np.swapaxes(self.driven, 1, 2) @ self.driven + weight * np.eye(size)
        """ΓᵀΓ + ρ I, (n, 2 H, 2 H): half of the cost's second derivative."""
        rows = np.concatenate([np.eye(size), np.eye(size) - np.eye(size, k=-1)])
        self._program = QuadraticProgram("law predictive", _blocks(self.hessian), _blocks(np.stack([rows] * n)))

    def pull(self, state: Array, wanted: Array, guide: Array) -> Array:
        """Γᵀ(r − O s) + ρ w₀, (n, 2 H): the unconstrained best w solves (ΓᵀΓ + ρ I) w = this."""
        error = wanted - (self.free @ state[..., None])[..., 0]
        return np.asarray((np.swapaxes(self.driven, 1, 2) @ error[..., None])[..., 0] + self._weight * guide)

    def best(self, state: Array, wanted: Array, guide: Array) -> Array:
        """The best w (n, 2 H) from s, for r and w₀. Raises MotionError where OSQP finds none.

        One command of the card runs one way. A step whose best speeds are of two signs is bound to the sign of their
        mean, and all is solved once more: not always the best of all signs, but always one that the card can run.
        """
        size = guide.shape[1]
        pull, speed = -self.pull(state, wanted, guide).ravel(), self._bound[:, :size]
        low, high = -speed, speed
        w = self._solve(pull, low, high, state, guide)
        start, end = w[:, 0::2], w[:, 1::2]
        turns = np.repeat(start * end < 0, 2, axis=1)
        if turns.any():
            ahead = np.repeat(start + end >= 0, 2, axis=1)
            low, high = np.where(turns & ahead, 0.0, low), np.where(turns & ~ahead, 0.0, high)
            w = self._solve(pull, low, high, state, w)
        return w

    def _solve(self, pull: Array, low: Array, high: Array, state: Array, guess: Array) -> Array:
        change = self._bound[:, guess.shape[1] :]
        # a drive that runs too fast already, or the other way, is not to make the program impossible
        now = np.clip(state[:, 1] * self._dt, low[:, 0] - change[:, 0], high[:, 0] + change[:, 0])
        centre = np.zeros_like(change)
        centre[:, 0] = now
        lowest, highest = np.concatenate([low, centre - change], 1), np.concatenate([high, centre + change], 1)
        return self._program.solve(pull, lowest.ravel(), highest.ravel(), guess.ravel()).reshape(guess.shape)


def _blocks(of: Array) -> Array:
    """The block-diagonal matrix of blocks (n, a, b)."""
    n, a, b = of.shape
    whole = np.zeros((n, a, n, b))
    whole[np.arange(n), :, np.arange(n)] = of
    return whole.reshape(n * a, n * b)
