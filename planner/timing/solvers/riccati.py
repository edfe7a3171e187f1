"""One Newton step of the order-3 problem by a Riccati recursion: from the last stage to the first, and back.

In each stage the linearized step Δs takes one control out, h where the interval ends in motion and s⃛ where it ends near
rest; the other is the stage's own choice. A last state that is given is asked for by a price that grows with its miss,
ϱ/2 |miss|², and by its own multiplier, which takes the price's place as the method goes on; it is sought exactly where
the price leaves much of the miss, as a larger price would cost the recursion its digits. A stated duration always is.
How both follow their multipliers borders what the recursion has factorized.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.stages import END, Iterate, Misses, Stages, add_bends, reach, slope_place

CONVEX = 1e-9
"""Least curvature along a stage's own choice, in units of the cost per squared scale."""
PRICE, MISS_LEFT = 1e8, 0.1
"""Of the last state's miss, in units of the cost per squared scale; the share of it that a step may leave."""
DEPENDENT = 1e-14
"""Share of what a multiplier takes off its own that is rounding, beside what the others take off."""


class Recursion(NamedTuple):
    """What the backward recursion leaves: the cost to go pᵀx + ½ xᵀPx (P as its three entries), and each choice's law.

    out (N,)        the control that the step takes out: 2 for s⃛, 3 for h
    follow (N, 4)   that control, by ṡ, s̈ and the other one, and by itself
    choice (N, 4)   curvature of the cost along the other one, mixed with ṡ and with s̈, and slope
    border (3, N + 1, 2), lever (3, N)  of the last ṡ and s̈ and of Σ h: slopes by each state and by each choice
    left (3,), more (3,)  how far these are off, and by what their multipliers change
    """

    quadratic: Array
    linear: Array
    out: np.ndarray
    follow: Array
    choice: Array
    border: Array
    lever: Array
    left: Array
    more: Array


class NewtonStep(NamedTuple):
    """Changes of states (N + 1, 2) and of stages (N, 4), and the multipliers of next states and steps after it."""

    states: Array
    stages: Array
    next_force: Array
    step_force: Array


def solve_step(
    stages: Stages,
    motion: Iterate,
    misses: Misses,
    bend: Array,
    pulls: Array,
    last_force: Array,
    excess: float,
    convexity: float,
    recursion: Recursion,
    step: NewtonStep,
) -> float | None:
    """Fill `recursion` and `step`, and return how the duration's multiplier changes. None where the cost is not convex
    along a choice, which more `convexity` mends, or so little that the step is no number.

    bend (N, 4, 4), pulls (N, 4): slopes of cost and rows by x. last_force (2,): the last state's multiplier. excess: by
    how much Σ h is longer than stated.
    """
    fixed = 1 if stages.free_end else 2
    if not recur(stages, motion, misses, bend, pulls, last_force, convexity, recursion):
        return None
    roll(stages, motion, misses, bend, pulls, convexity, recursion, step)
    left, more = recursion.left, recursion.more
    left[0], left[1], left[2] = step.states[-1, 0], step.states[-1, 1], step.stages[:, 3].sum() + excess
    if not np.isfinite(left).all():
        return None
    miss = max(abs(misses.next[-1, n]) / stages.scale[n] for n in range(fixed))
    much = max(abs(left[n]) / stages.scale[n] for n in range(fixed)) > MISS_LEFT * miss
    if not (much or stages.stated):
        return 0.0
    seek(stages, motion, recursion, much, much and fixed == 2, stages.stated)
    change = float(more[2])
    if change != 0:
        pulls = pulls + np.array([0.0, 0.0, 0.0, change])
    roll(stages, motion, misses, bend, pulls, convexity, recursion, step)
    return change if np.isfinite(step.states[-1]).all() else None


@kernel
def recur(
    stages: Stages,
    motion: Iterate,
    misses: Misses,
    bend: Array,
    pulls: Array,
    last_force: Array,
    convexity: float,
    recursion: Recursion,
) -> bool:
    """Fill `recursion`; False where the cost is not convex along a choice, which more `convexity` mends."""
    count = len(stages.step)
    scale = stages.scale
    whole = np.empty((4, 4))
    quadratic, linear = recursion.quadratic, recursion.linear
    quadratic[count, 0], quadratic[count, 1] = PRICE / scale[0] ** 2, 0.0
    quadratic[count, 2] = 0.0 if stages.free_end else PRICE / scale[1] ** 2
    linear[count, 0], linear[count, 1] = last_force[0], 0.0 if stages.free_end else last_force[1]
    more0, more1, more2 = convexity / scale[0] ** 2, convexity / scale[1] ** 2, convexity / scale[2] ** 2
    for k in range(count - 1, -1, -1):
        a, j, h = motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        t, t_square, by_h, push_by_h = slope_place(END, a, j, h)
        p00, p01, p11 = quadratic[k + 1, 0], quadratic[k + 1, 1], quadratic[k + 1, 2]
        miss0, miss1 = misses.next[k, 0], misses.next[k, 1]
        y0, y1 = linear[k + 1, 0] + p00 * miss0 + p01 * miss1, linear[k + 1, 1] + p01 * miss0 + p11 * miss1
        for m in range(4):
            for n in range(m, 4):
                whole[m, n] = bend[k, m, n]
        add_bends(t, t_square, by_h, push_by_h, p00, p01, 0.0, p11, 0.0, 0.0, whole)
        whole[0, 0] += more0
        whole[1, 1] += more1
        whole[2, 2] += more2
        whole[3, 3] += convexity / stages.duration[k] ** 2
        # slopes by x, through the next state too
        x0, x1 = pulls[k, 0] + y0, pulls[k, 1] + t * y0 + y1
        x2, x3 = pulls[k, 2] + t_square * y0 + t * y1, pulls[k, 3] + by_h * y0 + push_by_h * y1
        c, f0, f1, f2, f3 = _take_out(stages, misses, motion, k)
        recursion.out[k] = c
        recursion.follow[k, 0], recursion.follow[k, 1] = f0, f1
        recursion.follow[k, 2], recursion.follow[k, 3] = f2, f3
        if c == 3:
            oo, oc, cc, xo, xc, unit = whole[2, 2], whole[2, 3], whole[3, 3], x2, x3, scale[2]
            w0o, w0c, w1o, w1c = whole[0, 2], whole[0, 3], whole[1, 2], whole[1, 3]
        else:
            oo, oc, cc, xo, xc, unit = whole[3, 3], whole[2, 3], whole[2, 2], x3, x2, stages.duration[k]
            w0o, w0c, w1o, w1c = whole[0, 3], whole[0, 2], whole[1, 3], whole[1, 2]
        curve = oo + 2 * f2 * oc + f2 * f2 * cc
        if not curve * unit * unit > CONVEX:
            return False
        m00 = whole[0, 0] + 2 * f0 * w0c + f0 * f0 * cc
        m01 = whole[0, 1] + f1 * w0c + f0 * w1c + f0 * f1 * cc
        m11 = whole[1, 1] + 2 * f1 * w1c + f1 * f1 * cc
        m02 = w0o + f2 * w0c + f0 * oc + f0 * f2 * cc
        m12 = w1o + f2 * w1c + f1 * oc + f1 * f2 * cc
        xc += cc * f3
        slope0, slope1, slope = x0 + w0c * f3 + f0 * xc, x1 + w1c * f3 + f1 * xc, xo + oc * f3 + f2 * xc
        recursion.choice[k, 0], recursion.choice[k, 1] = curve, m02
        recursion.choice[k, 2], recursion.choice[k, 3] = m12, slope
        share0, share1 = m02 / curve, m12 / curve
        quadratic[k, 0] = m00 - m02 * share0
        quadratic[k, 1] = m01 - m02 * share1
        quadratic[k, 2] = m11 - m12 * share1
        linear[k, 0], linear[k, 1] = slope0 - share0 * slope, slope1 - share1 * slope
    if stages.prize > 0 and not quadratic[0, 0] * scale[0] ** 2 > CONVEX:
        return False
    return not stages.free_start or quadratic[0, 2] * scale[1] ** 2 > CONVEX


@kernel
def _take_out(stages: Stages, misses: Misses, motion: Iterate, k: int) -> tuple[int, float, float, float, float]:
    """The control that the step takes out; and that, by ṡ, s̈ and the other one, and by itself."""
    v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
    by2, by3 = h * h * h / 6, reach(v, a, j, h)[0]
    if abs(by3) * stages.duration[k] >= abs(by2) * stages.scale[2]:
        c, taken, other = 3, by3, by2
    else:
        c, taken, other = 2, by2, by3
    return c, -h / taken, -h * h / 2 / taken, -other / taken, -misses.step[k] * stages.step[k] / taken


@kernel
def roll(
    stages: Stages,
    motion: Iterate,
    misses: Misses,
    bend: Array,
    pulls: Array,
    convexity: float,
    recursion: Recursion,
    step: NewtonStep,
) -> None:
    """Fill `step`."""
    changes, next_force = step.states, step.next_force
    changes[0, 0] = -recursion.linear[0, 0] / recursion.quadratic[0, 0] if stages.prize > 0 else 0.0
    changes[0, 1] = -recursion.linear[0, 1] / recursion.quadratic[0, 2] if stages.free_start else 0.0
    for k in range(len(stages.step)):
        v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        t, t_square, by_h, push_by_h = slope_place(END, a, j, h)
        d0, d1 = changes[k, 0], changes[k, 1]
        choice, follow, c = recursion.choice[k], recursion.follow[k], recursion.out[k]
        own = -(choice[1] * d0 + choice[2] * d1 + choice[3]) / choice[0]
        taken = follow[0] * d0 + follow[1] * d1 + follow[2] * own + follow[3]
        d2, d3 = (own, taken) if c == 3 else (taken, own)
        x = step.stages[k]
        x[0], x[1], x[2], x[3] = d0, d1, d2, d3
        e0 = misses.next[k, 0] + d0 + t * d1 + t_square * d2 + by_h * d3
        e1 = misses.next[k, 1] + d1 + t * d2 + push_by_h * d3
        changes[k + 1, 0], changes[k + 1, 1] = e0, e1
        p00, p01, p11 = recursion.quadratic[k + 1, 0], recursion.quadratic[k + 1, 1], recursion.quadratic[k + 1, 2]
        force0 = recursion.linear[k + 1, 0] + p00 * e0 + p01 * e1
        force1 = recursion.linear[k + 1, 1] + p01 * e0 + p11 * e1
        next_force[k + 1, 0], next_force[k + 1, 1] = force0, force1
        # the cost does not change along the control that was taken out
        if c == 3:
            total = pulls[k, 3] + convexity / stages.duration[k] ** 2 * d3 + by_h * force0 + push_by_h * force1
            total += bend[k, 0, 3] * d0 + bend[k, 1, 3] * d1 + bend[k, 2, 3] * d2 + bend[k, 3, 3] * d3
            slope = reach(v, a, j, h)[0]
        else:
            total = pulls[k, 2] + convexity / stages.scale[2] ** 2 * d2 + t_square * force0 + t * force1
            total += bend[k, 0, 2] * d0 + bend[k, 1, 2] * d1 + bend[k, 2, 2] * d2 + bend[k, 2, 3] * d3
            slope = h * h * h / 6
        step.step_force[k] = -total / slope * stages.step[k]


@kernel
def seek(
    stages: Stages, motion: Iterate, recursion: Recursion, speed_asked: bool, push_asked: bool, time_asked: bool
) -> None:
    """Change the recursion's multipliers of the last ṡ and s̈ and of Σ h, those that are asked for, such that nothing is
    left of them. Where that overflows, none is: the price's step is a number, though it leaves some of the miss.
    """
    count = len(stages.step)
    border, lever, linear, more = recursion.border, recursion.lever, recursion.linear, recursion.more
    border[:, count] = 0.0
    border[0, count, 0] = border[1, count, 1] = 1.0
    taken = np.zeros((3, 3))  # off each by each one's multiplier
    used = np.array([speed_asked, push_asked, time_asked])
    for k in range(count - 1, -1, -1):
        a, j, h = motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        t, t_square, by_h, push_by_h = slope_place(END, a, j, h)
        curve, follow = recursion.choice[k, 0], recursion.follow[k]
        share0, share1 = recursion.choice[k, 1] / curve, recursion.choice[k, 2] / curve
        for i in range(3):
            if not used[i]:
                continue
            g0, g1 = border[i, k + 1, 0], border[i, k + 1, 1]
            by_own, by_taken = t_square * g0 + t * g1, by_h * g0 + push_by_h * g1 + (1.0 if i == 2 else 0.0)
            if recursion.out[k] == 2:
                by_own, by_taken = by_taken, by_own
            by_own += follow[2] * by_taken
            lever[i, k] = by_own
            border[i, k, 0] = g0 + follow[0] * by_taken - share0 * by_own
            border[i, k, 1] = t * g0 + g1 + follow[1] * by_taken - share1 * by_own
            by_own /= curve
            for n in range(i + 1):
                taken[i, n] += by_own * lever[n, k]
    for i in range(3):
        for n in range(i + 1):
            if stages.prize > 0:
                taken[i, n] += border[i, 0, 0] * border[n, 0, 0] / recursion.quadratic[0, 0]
            if stages.free_start:
                taken[i, n] += border[i, 0, 1] * border[n, 0, 1] / recursion.quadratic[0, 2]
            taken[n, i] = taken[i, n]
    left, largest = recursion.left, np.array([taken[0, 0], taken[1, 1], taken[2, 2]])
    for i in range(3):
        used[i] = used[i] and taken[i, i] > DEPENDENT * largest[i]  # no overflow, and not what others ask for
        if used[i]:
            for n in range(i + 1, 3):
                share = taken[n, i] / taken[i, i]
                left[n] -= share * left[i]
                for m in range(i + 1, 3):
                    taken[n, m] -= share * taken[i, m]
    more[:] = 0.0
    for i in range(2, -1, -1):
        if used[i]:
            more[i] = left[i]
            for n in range(i + 1, 3):
                more[i] -= taken[i, n] * more[n]
            more[i] /= taken[i, i]
    if not (more[0] == 0 and more[1] == 0 and more[2] == 0):
        for k in range(count + 1):
            for i in range(3):
                if not used[i]:
                    continue
                linear[k, 0] += more[i] * border[i, k, 0]
                linear[k, 1] += more[i] * border[i, k, 1]
                if k < count:
                    recursion.choice[k, 3] += more[i] * lever[i, k]
