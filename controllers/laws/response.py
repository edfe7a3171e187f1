"""What nominal axes do with a command of straight-line speeds: positions as a linear map of the speeds, exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers.laws.nominal import NominalAxes
from kinematics.array import Array, frozen

STATE = 4
"""Numbers of an axis' state: position x, speed v, integral i of the speed loop, command c."""


@dataclass(frozen=True, slots=True)
class Response:
    """One step of n axes from the state s = (x, v, i, c): s⁺ = F s + G w, and at m instants x = C s + D w.

    w = (v₀, v₁)·dt, pulses: the command's speeds at the step's start and end; c runs c₀ + (w₀ u + (w₁ − w₀) u²/2) over
    the share u of the step. The m instants divide the step, the last is its end.

    F (n, 4, 4)  G (n, 4, 2)  C (n, m, 4)  D (n, m, 2)
    """

    F: Array
    G: Array
    C: Array
    D: Array

    def over(self, steps: int) -> tuple[Array, Array]:
        """The positions (n, steps·m) over several steps, O s + Γ w: O (n, steps·m, 4), Γ (n, steps·m, 2·steps)."""
        n, m, _ = self.C.shape
        through = np.zeros((n, STATE, STATE + 2 * steps))
        through[:, :, :STATE] = np.eye(STATE)
        rows = np.zeros((n, steps * m, STATE + 2 * steps))
        for k in range(steps):
            here, mine = slice(k * m, (k + 1) * m), slice(STATE + 2 * k, STATE + 2 * k + 2)
            rows[:, here] = self.C @ through
            rows[:, here, mine] += self.D
            through = self.F @ through
            through[:, :, mine] += self.G
        return frozen(rows[:, :, :STATE]), frozen(rows[:, :, STATE:])


def response(axes: NominalAxes, dt: float, instants: int) -> Response:
    """The exact response over a step of dt seconds: the exponential of `NominalAxes`' equations with c a quadratic.

    Without the axes' delay, which shifts all of it in time, and without Coulomb friction, see `friction_response`.
    """
    n = len(axes)
    # x, v, i, c and the command's speed and acceleration
    rates = np.zeros((n, 6, 6))
    rates[:, :STATE, :STATE] = _rates(axes)
    rates[:, 3, 4] = rates[:, 4, 5] = 1.0
    flow = _flow(rates, dt / instants, instants)[:, 1:]
    # command's speed w₀/dt, acceleration (w₁ − w₀)/dt²
    enter = np.array([[1 / dt, 0.0], [-1 / dt**2, 1 / dt**2]])
    held, driven = flow[..., :STATE, :STATE], flow[..., :STATE, STATE:] @ enter
    return Response(frozen(held[:, -1]), frozen(driven[:, -1]), frozen(held[:, :, 0]), frozen(driven[:, :, 0]))


def friction_response(axes: NominalAxes, tick: float, count: int) -> Array:
    """x (n, count + 1) of axes at rest, every `tick` seconds after an outer torque of unit acceleration has set in."""
    n = len(axes)
    rates = np.zeros((n, STATE + 1, STATE + 1))
    rates[:, :STATE, :STATE] = _rates(axes)
    rates[:, 1, STATE] = 1.0
    return frozen(_flow(rates, tick, count)[:, :, 0, STATE])


def _rates(axes: NominalAxes) -> Array:
    """The derivative (n, 4, 4) of the state by itself."""
    n = len(axes)
    gain, loop, integral, friction = (
        np.broadcast_to(of, n) for of in (axes.position_gain, axes.speed_loop, axes.integral_time, axes.friction)
    )
    rates = np.zeros((n, STATE, STATE))
    rates[:, 0, 1] = rates[:, 1, 2] = 1.0
    for row, strength in ((1, loop), (2, loop / integral)):
        rates[:, row, 0], rates[:, row, 3] = -strength * gain, strength * gain
        rates[:, row, 1] = -strength
    rates[:, 1, 1] -= friction
    return rates


def _flow(rates: Array, tick: float, count: int) -> Array:
    """The exponentials (n, count + 1, ·, ·) of rates (n, ·, ·) over 0, 1, … ticks."""
    from scipy.linalg import expm

    one = expm(rates * tick)
    flow = np.empty((len(rates), count + 1, *one.shape[1:]))
    flow[:, 0] = np.eye(one.shape[1])
    for k in range(count):
        flow[:, k + 1] = one @ flow[:, k]
    return flow
