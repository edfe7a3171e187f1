"""The order-3 problem's optimality conditions, stage by stage, in compiled loops.

Their errors and slopes, how slacks and forces follow a step, and where a share of it leads.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.sides import Sides
from planner.timing.solvers.stages import (
    END,
    MIDDLE,
    OWN,
    PLACE_COUNT,
    START,
    Iterate,
    Misses,
    Slopes,
    Stages,
    add_bends,
    add_jerks,
    add_pushes,
    reach,
    slope_place,
    sum_costs,
)

UNDERFLOW = 1e-200
"""Where a product of slacks is taken the logarithm of, before it vanishes."""
LEAST_SHARE = 1e-10
"""Of μ over a slack, and its inverse: how far the force may be from it."""


@kernel
def linearize(
    stages: Stages,
    sides: Sides,
    motion: Iterate,
    misses: Misses,
    next_force: Array,
    step_force: Array,
    time_force: float,
    weight: float,
    slopes: Slopes,
) -> tuple[float, float, float, float, float]:
    """Fill `slopes`. The errors of the optimality conditions: of sides and of slopes; the least and the largest
    slack · force; and the sum of forces.

    next_force (N + 1, 2), step_force (N,), time_force  multipliers of the next states, the steps and the duration
    """
    count = len(stages.step)
    begin, coefficients, missing = sides.begin, sides.coefficients, misses.side
    slacks, pushes = motion.slack, motion.force
    spread = stages.jerks.shape[2] + stages.pushes.shape[2] > 0
    # by ṡ, s̈, s⃛ at each place: of the sides and what is reached with their forces, with these taken out to first
    # order, and by μ; and of the cost; and second ones
    sums, bends = np.empty((4, 3, 3)), np.empty((3, 6))
    reached, mapped = np.empty((3, 2)), np.empty((4, 4))
    row_error = slope_error = forces = most = 0.0
    least = np.inf
    for k in range(count):
        v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        reached[START, 0], reached[START, 1] = v, a
        reached[MIDDLE, 0], reached[MIDDLE, 1] = reach(v, a, j, h / 2)
        reached[END, 0], reached[END, 1] = reach(v, a, j, h)
        sums[3] = 0.0
        for place in range(3):
            pv, pa = reached[place, 0], reached[place, 1]
            push_v = push_a = push_j = pull_v = pull_a = pull_j = centre_v = centre_a = centre_j = 0.0
            bend_vv = bend_va = bend_vj = bend_aa = bend_aj = bend_jj = 0.0
            for i in range(begin[PLACE_COUNT * k + place], begin[PLACE_COUNT * k + place + 1]):
                square, cube, cross = coefficients[i, 2], coefficients[i, 3], coefficients[i, 5]
                by_v = coefficients[i, 1] + (2 * square + 3 * pv * cube) * pv + pa * cross
                by_a, by_j = coefficients[i, 4] + pv * cross, coefficients[i, 6]
                slack, force, miss = slacks[i], pushes[i], missing[i]
                inverse, product = 1 / slack, slack * force
                stiff = force * inverse
                pull = -stiff * miss
                row_error, least, most = max(row_error, abs(miss)), min(least, product), max(most, product)
                forces += force
                push_v += force * by_v
                push_a += force * by_a
                push_j += force * by_j
                pull_v += pull * by_v
                pull_a += pull * by_a
                pull_j += pull * by_j
                centre_v += inverse * by_v
                centre_a += inverse * by_a
                centre_j += inverse * by_j
                bend_vv += stiff * by_v * by_v + force * (2 * square + 6 * pv * cube)
                bend_va += stiff * by_v * by_a + force * cross
                bend_vj += stiff * by_v * by_j
                bend_aa += stiff * by_a * by_a
                bend_aj += stiff * by_a * by_j
                bend_jj += stiff * by_j * by_j
            sums[0, place, 0], sums[0, place, 1], sums[0, place, 2] = push_v, push_a, push_j
            sums[1, place, 0], sums[1, place, 1], sums[1, place, 2] = pull_v, pull_a, pull_j
            sums[2, place, 0], sums[2, place, 1], sums[2, place, 2] = centre_v, centre_a, centre_j
            bends[place, 0], bends[place, 1], bends[place, 2] = bend_vv, bend_va, bend_vj
            bends[place, 3], bends[place, 4], bends[place, 5] = bend_aa, bend_aj, bend_jj
        sums[0, END, 0] += next_force[k + 1, 0]
        sums[0, END, 1] += next_force[k + 1, 1]
        rough = 0.0
        if spread:
            rough = add_jerks(stages.jerks[k], reached, j, weight * h, sums, bends)
            rough += add_pushes(stages.pushes[k], reached, weight * h, sums, bends)
        bend = slopes.bend[k]
        bend[:], mapped[:] = 0.0, 0.0
        for place in range(3):
            t, t_square, by_h, push_by_h = slope_place(place, a, j, h)
            for m in range(4):
                g_v, g_a, g_j = sums[m, place, 0], sums[m, place, 1], sums[m, place, 2]
                mapped[m, 0] += g_v
                mapped[m, 1] += g_v * t + g_a
                mapped[m, 2] += g_v * t_square + g_a * t + g_j
                mapped[m, 3] += g_v * by_h + g_a * push_by_h
            b = bends[place]
            add_bends(t, t_square, by_h, push_by_h, b[0], b[1], b[2], b[3], b[4], b[5], bend)
            if place != START:  # what is reached is itself bent
                part = 0.5 if place == MIDDLE else 1.0
                g_v, g_a = sums[0, place, 0] + sums[3, place, 0], sums[0, place, 1] + sums[3, place, 1]
                bend[1, 3] += g_v * part
                bend[2, 3] += (g_v * t + g_a) * part
                bend[3, 3] += g_v * part * part * j
        for i in range(begin[PLACE_COUNT * k + OWN], begin[PLACE_COUNT * k + OWN + 1]):
            unit = coefficients[i, 1] / stages.duration[k]
            slack, force, miss = slacks[i], pushes[i], missing[i]
            inverse, product = 1 / slack, slack * force
            row_error, least, most = max(row_error, abs(miss)), min(least, product), max(most, product)
            forces += force
            mapped[0, 3] += force * unit
            mapped[1, 3] -= force * inverse * miss * unit
            mapped[2, 3] += inverse * unit
            bend[3, 3] += force * inverse * unit * unit
        if spread:
            for n in range(4):
                bend[n, 3] += mapped[3, n] / h * (2 if n == 3 else 1)
            mapped[3, 3] += weight * rough
        if not stages.stated:
            mapped[3, 2] += 2 * weight * stages.calm[k] * j
            mapped[3, 3] += weight
            bend[2, 2] += 2 * weight * stages.calm[k]
            if k == 0:
                mapped[3, 0] -= weight * stages.prize
        own = step_force[k] / stages.step[k]
        bend[0, 3] += own
        bend[1, 3] += own * h
        bend[2, 3] += own * h * h / 2
        bend[3, 3] += own * reached[END, 1]
        mapped[0, 0] += own * h
        mapped[0, 1] += own * h * h / 2
        mapped[0, 2] += own * h * h * h / 6
        mapped[0, 3] += own * reached[END, 0] + time_force
        for n in range(4):
            slopes.cost[k, n], slopes.centre[k, n] = mapped[3, n], mapped[2, n]
            slopes.pull[k, n] = mapped[1, n] + mapped[3, n]
            total = mapped[0, n] + mapped[3, n]
            if n < 2 and k > 0:
                total -= next_force[k, n]
            elif (n == 0 and stages.prize == 0) or (n == 1 and not stages.free_start):
                total = 0.0
            slope_error = max(slope_error, abs(total) * (stages.scale[n] if n < 3 else stages.duration[k]))
        row_error = max(row_error, abs(misses.step[k]), abs(misses.next[k, 0]) / stages.scale[0])
        if k < count - 1 or not stages.free_end:
            row_error = max(row_error, abs(misses.next[k, 1]) / stages.scale[1])
    return row_error, slope_error, least, most, forces


@kernel
def _sum_terms(
    coefficients: Array, i: int, v: float, v_square: float, v_cube: float, a: float, va: float, j: float
) -> float:
    value: float = coefficients[i, 1] * v + coefficients[i, 2] * v_square + coefficients[i, 3] * v_cube
    value += coefficients[i, 4] * a + coefficients[i, 5] * va + coefficients[i, 6] * j
    return value


@kernel
def follow_step(
    stages: Stages,
    sides: Sides,
    motion: Iterate,
    misses: Misses,
    slopes: Slopes,
    change: Array,
    mu: float,
    steps: Array,
    pushes: Array,
) -> tuple[float, float, float]:
    """Fill how slacks and forces (K,) follow a change (N, 4) of x.

    Returns the largest shares that leave slacks and forces positive, and the slope of the barrier's cost.
    """
    begin, coefficients = sides.begin, sides.coefficients
    slacks, forces, missing = motion.slack, motion.force, misses.side
    least, slope = 1.0, 0.0
    keep = max(0.99, 1 - mu)
    for k in range(len(stages.step)):
        v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        dv, da, dj, dh = change[k, 0], change[k, 1], change[k, 2], change[k, 3]
        for n in range(4):
            slope += slopes.cost[k, n] * change[k, n]
        if dh * least < -0.9 * h:
            least = -0.9 * h / dh
        for place in range(3):
            t, t_square, by_h, push_by_h = slope_place(place, a, j, h)
            pv, pa = reach(v, a, j, t)
            gain_v, gain_a = dv + t * da + t_square * dj + by_h * dh, da + t * dj + push_by_h * dh
            gain_square, gain_cube, gain_cross = 2 * pv * gain_v, 3 * pv * pv * gain_v, gain_v * pa + pv * gain_a
            for i in range(begin[PLACE_COUNT * k + place], begin[PLACE_COUNT * k + place + 1]):
                steps[i] = missing[i] - _sum_terms(
                    coefficients, i, gain_v, gain_square, gain_cube, gain_a, gain_cross, dj
                )
        for i in range(begin[PLACE_COUNT * k + OWN], begin[PLACE_COUNT * k + OWN + 1]):
            steps[i] = missing[i] - coefficients[i, 1] * dh / stages.duration[k]
    primal, dual, centred = 0.0, 0.0, 0.0
    for i in range(len(slacks)):
        force, step = forces[i], steps[i]
        inverse = 1 / slacks[i]
        push = (mu - force * step) * inverse - force
        pushes[i] = push
        step *= inverse
        centred += step
        primal, dual = max(primal, -step), max(dual, -push / force)
    # shares that take a slack or a force down to 1 − keep of itself
    if primal * least > keep:
        least = keep / primal
    return least, (keep / dual if dual > keep else 1.0), slope - mu * centred


@kernel
def try_share(
    stages: Stages,
    sides: Sides,
    motion: Iterate,
    state_change: Array,
    change: Array,
    steps: Array,
    share: float,
    weight: float,
    trial: Iterate,
    tried: Misses,
) -> tuple[float, float, float, float]:
    """Fill states, controls and slacks of `trial` with the motion changed by a share, and what it misses.

    Returns what a line search weighs: the sum of all misses, the cost, the sum of the slacks' logarithms; and Σ h.
    """
    count = len(stages.step)
    begin, coefficients, bound, missing = sides.begin, sides.coefficients, sides.bound, tried.side
    trial.states[0, 0] = motion.states[0, 0] + share * state_change[0, 0]
    trial.states[0, 1] = motion.states[0, 1] + share * state_change[0, 1]
    missed = logarithms = time = 0.0
    for k in range(count):
        v, a = trial.states[k, 0], trial.states[k, 1]
        j, h = motion.controls[k, 0] + share * change[k, 2], motion.controls[k, 1] + share * change[k, 3]
        trial.controls[k, 0], trial.controls[k, 1] = j, h
        v_next, a_next = motion.states[k + 1, 0], motion.states[k + 1, 1]
        if k < count - 1:
            v_next += share * state_change[k + 1, 0]
        if k < count - 1 or stages.free_end:
            a_next += share * state_change[k + 1, 1]
        trial.states[k + 1, 0], trial.states[k + 1, 1] = v_next, a_next
        v_end, a_end = reach(v, a, j, h)
        tried.next[k, 0], tried.next[k, 1] = v_end - v_next, a_end - a_next
        tried.step[k] = h * (v + h * (a / 2 + h * j / 6)) / stages.step[k] - 1
        missed += abs(tried.step[k]) + abs(tried.next[k, 0]) / stages.scale[0]
        if k < count - 1 or not stages.free_end:
            missed += abs(tried.next[k, 1]) / stages.scale[1]
        time += h
        for place in range(3):
            pv, pa = reach(v, a, j, h * place / 2)
            for i in range(begin[PLACE_COUNT * k + place], begin[PLACE_COUNT * k + place + 1]):
                value = coefficients[i, 0] + _sum_terms(coefficients, i, pv, pv * pv, pv * pv * pv, pa, pv * pa, j)
                missing[i] = bound[i] - value
        for i in range(begin[PLACE_COUNT * k + OWN], begin[PLACE_COUNT * k + OWN + 1]):
            missing[i] = bound[i] - coefficients[i, 1] * h / stages.duration[k]
    if stages.stated:
        missed += abs(time - 1)
    product = 1.0  # a logarithm of a product is cheaper than the sum of logarithms
    for i in range(len(bound)):
        slack = motion.slack[i] + share * steps[i]
        trial.slack[i] = slack
        missing[i] -= slack
        missed += abs(missing[i])
        product *= slack
        if product < UNDERFLOW or product > 1 / UNDERFLOW:
            logarithms += np.log(product)
            product = 1.0
    return missed, weight * sum_costs(stages, trial.states, trial.controls), logarithms + np.log(product), time


@kernel
def push_forces(motion: Iterate, pushes: Array, share: float, mu: float) -> None:
    """Change the sides' forces by a share of `pushes`, and keep them near μ over their slacks."""
    smallest, largest = mu * LEAST_SHARE, mu / LEAST_SHARE
    for i in range(len(pushes)):
        centre = 1 / motion.slack[i]
        motion.force[i] = min(max(motion.force[i] + share * pushes[i], smallest * centre), largest * centre)
