"""One Newton step of the order-3 problem by a Riccati recursion: from the last stage to the first, and back.

In each stage the linearized step Δs takes one control out, h where the interval ends in motion and s⃛ where it ends near
rest; the other is the stage's own choice. A last state that is given is asked for by a price that grows with its miss,
ϱ/2 |miss|², and by its own multiplier, which takes the price's place as the method goes on; it is sought exactly where
the price leaves much of the miss, as a larger price would cost the recursion its digits.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.stages import Misses, Slopes, Stages

CONVEX = 1e-9
"""Least curvature along a stage's own choice, in units of the cost per squared scale."""
PRICE, MISS_LEFT = 1e8, 0.1
"""Of the last state's miss, in units of the cost per squared scale; the share of it that a step may leave."""


class Recursion(NamedTuple):
    """What the backward recursion leaves: the cost to go pᵀx + ½ xᵀPx (P as its three entries), and each choice's law.

    out (N,)        the control that the step takes out: 2 for s⃛, 3 for h
    follow (N, 4)   that control, by ṡ, s̈ and the other one, and by itself
    choice (N, 4)   curvature of the cost along the other one, mixed with ṡ and with s̈, and slope
    """

    quadratic: Array
    linear: Array
    out: np.ndarray
    follow: Array
    choice: Array


class NewtonStep(NamedTuple):
    """Changes of states (N + 1, 2) and of stages (N, 4), and the multipliers of next states and steps after it."""

    states: Array
    stages: Array
    next_force: Array
    step_force: Array


def solve_step(
    stages: Stages,
    misses: Misses,
    slopes: Slopes,
    pulls: Array,
    last_force: Array,
    convexity: float,
    recursion: Recursion,
    step: NewtonStep,
) -> bool:
    """Fill `recursion` and `step`; False where the cost is not convex along a choice, which more `convexity` mends, or
    so little that the step is no number.

    pulls (N, 4): slopes of cost and rows by x. last_force (2,): the last state's multiplier.
    """
    fixed = 1 if stages.free_end else 2

    def remaining(force: Array) -> Array | None:
        """What a step with a multiplier of the last state leaves of its miss, scaled."""
        if not recur(stages, misses, slopes, pulls, force, convexity, recursion):
            return None
        roll(stages, misses, slopes, pulls, convexity, recursion, step)
        return step.states[-1, :fixed] / stages.scale[:fixed]

    left = remaining(last_force)
    if left is None or not np.isfinite(left).all():
        return False
    size = np.abs(left).max()
    if size <= MISS_LEFT * np.abs(misses.next[-1, :fixed] / stages.scale[:fixed]).max():
        return True
    units = PRICE * size / stages.scale[:fixed]
    moved = np.zeros((fixed, fixed))
    for n in range(fixed):
        force = last_force.copy()
        force[n] += units[n]
        moved[:, n] = np.asarray(remaining(force)) - left
    if not np.isfinite(moved).all():  # the price's step is one, though it leaves some of the miss
        remaining(last_force)
        return True
    exact = last_force.copy()
    exact[:fixed] -= units * np.linalg.lstsq(moved, left, rcond=None)[0]
    remaining(exact)
    return True


@kernel
def recur(
    stages: Stages,
    misses: Misses,
    slopes: Slopes,
    pulls: Array,
    last_force: Array,
    convexity: float,
    recursion: Recursion,
) -> bool:
    """Fill `recursion`; False where the cost is not convex along a choice, which more `convexity` mends."""
    count = len(stages.step)
    scale = stages.scale
    whole, product = np.zeros((4, 4)), np.zeros((2, 4))
    quadratic, linear = recursion.quadratic, recursion.linear
    quadratic[count, 0], quadratic[count, 1] = PRICE / scale[0] ** 2, 0.0
    quadratic[count, 2] = 0.0 if stages.free_end else PRICE / scale[1] ** 2
    linear[count, 0], linear[count, 1] = last_force[0], 0.0 if stages.free_end else last_force[1]
    for k in range(count - 1, -1, -1):
        p00, p01, p11 = quadratic[k + 1]
        y0 = linear[k + 1, 0] + p00 * misses.next[k, 0] + p01 * misses.next[k, 1]
        y1 = linear[k + 1, 1] + p01 * misses.next[k, 0] + p11 * misses.next[k, 1]
        along = slopes.next[k]
        for n in range(4):
            product[0, n] = p00 * along[0, n] + p01 * along[1, n]
            product[1, n] = p01 * along[0, n] + p11 * along[1, n]
        for m in range(4):
            for n in range(4):
                whole[m, n] = slopes.bend[k, m, n] + along[0, m] * product[0, n] + along[1, m] * product[1, n]
            whole[m, m] += convexity / (scale[m] if m < 3 else stages.duration[k]) ** 2
        by = slopes.step[k]
        c = 3 if abs(by[3]) * stages.duration[k] >= abs(by[2]) * scale[2] else 2
        o = 5 - c
        f0, f1, f2, f3 = -by[0] / by[c], -by[1] / by[c], -by[o] / by[c], -misses.step[k] / by[c]
        recursion.out[k] = c
        recursion.follow[k, 0], recursion.follow[k, 1] = f0, f1
        recursion.follow[k, 2], recursion.follow[k, 3] = f2, f3
        bend = whole[o, o] + 2 * f2 * whole[o, c] + f2 * f2 * whole[c, c]
        unit = scale[2] if o == 2 else stages.duration[k]
        if not bend * unit * unit > CONVEX:
            return False
        m00 = whole[0, 0] + 2 * f0 * whole[0, c] + f0 * f0 * whole[c, c]
        m01 = whole[0, 1] + f1 * whole[0, c] + f0 * whole[1, c] + f0 * f1 * whole[c, c]
        m11 = whole[1, 1] + 2 * f1 * whole[1, c] + f1 * f1 * whole[c, c]
        m02 = whole[0, o] + f2 * whole[0, c] + f0 * whole[o, c] + f0 * f2 * whole[c, c]
        m12 = whole[1, o] + f2 * whole[1, c] + f1 * whole[o, c] + f1 * f2 * whole[c, c]
        wc = pulls[k, c] + along[0, c] * y0 + along[1, c] * y1 + whole[c, c] * f3
        w0 = pulls[k, 0] + along[0, 0] * y0 + along[1, 0] * y1 + whole[0, c] * f3 + f0 * wc
        w1 = pulls[k, 1] + along[0, 1] * y0 + along[1, 1] * y1 + whole[1, c] * f3 + f1 * wc
        wo = pulls[k, o] + along[0, o] * y0 + along[1, o] * y1 + whole[o, c] * f3 + f2 * wc
        recursion.choice[k, 0], recursion.choice[k, 1] = bend, m02
        recursion.choice[k, 2], recursion.choice[k, 3] = m12, wo
        quadratic[k, 0] = m00 - m02 * m02 / bend
        quadratic[k, 1] = m01 - m02 * m12 / bend
        quadratic[k, 2] = m11 - m12 * m12 / bend
        linear[k, 0], linear[k, 1] = w0 - m02 * wo / bend, w1 - m12 * wo / bend
    if stages.prize > 0 and not quadratic[0, 0] * scale[0] ** 2 > CONVEX:
        return False
    return not stages.free_start or quadratic[0, 2] * scale[1] ** 2 > CONVEX


@kernel
def roll(
    stages: Stages,
    misses: Misses,
    slopes: Slopes,
    pulls: Array,
    convexity: float,
    recursion: Recursion,
    step: NewtonStep,
) -> None:
    """Fill `step`."""
    state_change, next_force = step.states, step.next_force
    state_change[0, 0] = -recursion.linear[0, 0] / recursion.quadratic[0, 0] if stages.prize > 0 else 0.0
    state_change[0, 1] = -recursion.linear[0, 1] / recursion.quadratic[0, 2] if stages.free_start else 0.0
    for k in range(len(stages.step)):
        d0, d1 = state_change[k]
        c = recursion.out[k]
        o = 5 - c
        bend, m02, m12, slope = recursion.choice[k]
        f0, f1, f2, f3 = recursion.follow[k]
        own = -(m02 * d0 + m12 * d1 + slope) / bend
        x = step.stages[k]
        x[0], x[1], x[o], x[c] = d0, d1, own, f0 * d0 + f1 * d1 + f2 * own + f3
        for m in range(2):
            state_change[k + 1, m] = misses.next[k, m]
            for n in range(4):
                state_change[k + 1, m] += slopes.next[k, m, n] * x[n]
        d0, d1 = state_change[k + 1]
        p00, p01, p11 = recursion.quadratic[k + 1]
        next_force[k + 1, 0] = recursion.linear[k + 1, 0] + p00 * d0 + p01 * d1
        next_force[k + 1, 1] = recursion.linear[k + 1, 1] + p01 * d0 + p11 * d1
        # the cost does not change along the control that was taken out
        total = pulls[k, c] + convexity / (stages.scale[2] if c == 2 else stages.duration[k]) ** 2 * x[c]
        for n in range(4):
            total += slopes.bend[k, c, n] * x[n]
        for m in range(2):
            total += slopes.next[k, m, c] * next_force[k + 1, m]
        step.step_force[k] = -total / slopes.step[k, c]
