"""The order-3 problem's optimality conditions, stage by stage, in compiled loops.

Their errors and slopes, how slacks and forces follow a step, and where a share of it leads.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.stages import (
    END,
    MIDDLE,
    START,
    TERM_COUNT,
    Iterate,
    Misses,
    Slopes,
    StageRows,
    Stages,
    add_bends,
    add_jerks,
    evaluate,
    reach,
    slope_place,
    sum_costs,
    sum_terms,
)

UNDERFLOW = 1e-200
"""Where a product of slacks is taken the logarithm of, before it vanishes."""
LEAST_SHARE = 1e-10
"""Of μ over a slack, and its inverse: how far the force may be from it."""


@kernel
def _weigh(
    low: float, high: float, value: float, slack_low: float, force_low: float, slack_high: float, force_high: float
) -> tuple[float, float, float, float, float, float, float]:
    """A row's forces over slacks; its force, that taken out to first order, and by μ; miss, least and most product."""
    stiff = force = pull = centre = missed = most = 0.0
    least = np.inf
    if low > -np.inf:
        inverse, miss = 1 / slack_low, value - low - slack_low
        stiff = force_low * inverse
        force, pull, centre = -force_low, stiff * miss, -inverse
        missed = abs(miss)
        least = most = slack_low * force_low
    if high < np.inf:
        inverse, miss, product = 1 / slack_high, high - value - slack_high, slack_high * force_high
        stiff += force_high * inverse
        force += force_high
        pull -= force_high * inverse * miss
        centre += inverse
        missed, least, most = max(missed, abs(miss)), min(least, product), max(most, product)
    return stiff, force, pull, centre, missed, least, most


@kernel
def linearize(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    next_force: Array,
    step_force: Array,
    time_force: float,
    weight: float,
    slopes: Slopes,
) -> tuple[float, float, float, float, float]:
    """Fill `slopes`. The errors of the optimality conditions: of rows and of slopes; the least and the largest
    slack · force; and the sum of forces.

    next_force (N + 1, 2), step_force (N,), time_force  multipliers of the next states, the steps and the duration
    """
    count, last = len(stages.step), rows.low.shape[1] - 1
    low, high, values = rows.low, rows.high, misses.values
    slack_low, slack_high, force_low, force_high = motion[2:]
    kinds = rows.terms
    # of each term at each place: by ṡ, s̈ and s⃛, and by ṡṡ and ṡs̈
    by = np.zeros((3, TERM_COUNT, 5))
    by[:, 1, 0] = by[:, 4, 1] = by[:, 6, 2] = by[:, 5, 4] = 1.0
    by[:, 2, 3] = 2.0
    # by ṡ, s̈, s⃛ at each place: of the rows and what is reached with their forces, with these taken out to first order,
    # and by μ; and of the cost; and second ones
    sums, bends = np.empty((4, 3, 3)), np.empty((3, 6))
    reached, mapped = np.empty((3, 2)), np.empty((4, 4))
    row_error = slope_error = forces = most = 0.0
    least = np.inf
    for k in range(count):
        v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        reached[START, 0], reached[START, 1] = v, a
        reached[MIDDLE, 0], reached[MIDDLE, 1] = reach(v, a, j, h / 2)
        reached[END, 0], reached[END, 1] = reach(v, a, j, h)
        sums[:], bends[:] = 0.0, 0.0
        for place in range(3):
            pv, pa = reached[place, 0], reached[place, 1]
            by[place, 2, 0], by[place, 3, 0], by[place, 5, 0] = 2 * pv, 3 * pv * pv, pa
            by[place, 5, 1], by[place, 3, 3] = pv, 6 * pv
        row = 0
        for half in range(2):
            coefficients = rows.first if half == 0 else rows.second
            at = 0
            for b in range(len(rows.size)):
                place = START if half == 0 else (END if rows.at_end[b] else MIDDLE)
                length = rows.lengths[b]
                push_v = push_a = push_j = pull_v = pull_a = pull_j = centre_v = centre_a = centre_j = 0.0
                bend_vv = bend_va = bend_vj = bend_aa = bend_aj = bend_jj = 0.0
                one, two, three = by[place, kinds[b, 0]], by[place, kinds[b, 1]], by[place, kinds[b, 2]]
                for _ in range(rows.size[b]):
                    first = coefficients[k, at]
                    second = coefficients[k, at + 1] if length > 1 else 0.0
                    third = coefficients[k, at + 2] if length > 2 else 0.0
                    by_v = first * one[0] + second * two[0] + third * three[0]
                    by_a = first * one[1] + second * two[1] + third * three[1]
                    by_j = first * one[2] + second * two[2] + third * three[2]
                    by_vv = first * one[3] + second * two[3] + third * three[3]
                    by_va = first * one[4] + second * two[4] + third * three[4]
                    for t in range(3, length):
                        own, rest = coefficients[k, at + t], by[place, kinds[b, t]]
                        by_v += own * rest[0]
                        by_a += own * rest[1]
                        by_j += own * rest[2]
                        by_vv += own * rest[3]
                        by_va += own * rest[4]
                    at += length
                    push_low, push_high = force_low[k, row], force_high[k, row]
                    stiff, force, pull, centre, missed, smaller, larger = _weigh(
                        low[k, row],
                        high[k, row],
                        values[k, row],
                        slack_low[k, row],
                        push_low,
                        slack_high[k, row],
                        push_high,
                    )
                    row_error, least, most = max(row_error, missed), min(least, smaller), max(most, larger)
                    forces += push_low + push_high
                    row += 1
                    push_v += force * by_v
                    push_a += force * by_a
                    push_j += force * by_j
                    pull_v += pull * by_v
                    pull_a += pull * by_a
                    pull_j += pull * by_j
                    centre_v += centre * by_v
                    centre_a += centre * by_a
                    centre_j += centre * by_j
                    bend_vv += stiff * by_v * by_v + force * by_vv
                    bend_va += stiff * by_v * by_a + force * by_va
                    bend_vj += stiff * by_v * by_j
                    bend_aa += stiff * by_a * by_a
                    bend_aj += stiff * by_a * by_j
                    bend_jj += stiff * by_j * by_j
                sums[0, place, 0] += push_v
                sums[0, place, 1] += push_a
                sums[0, place, 2] += push_j
                sums[1, place, 0] += pull_v
                sums[1, place, 1] += pull_a
                sums[1, place, 2] += pull_j
                sums[2, place, 0] += centre_v
                sums[2, place, 1] += centre_a
                sums[2, place, 2] += centre_j
                bends[place, 0] += bend_vv
                bends[place, 1] += bend_va
                bends[place, 2] += bend_vj
                bends[place, 3] += bend_aa
                bends[place, 4] += bend_aj
                bends[place, 5] += bend_jj
        sums[0, END, 0] += next_force[k + 1, 0]
        sums[0, END, 1] += next_force[k + 1, 1]
        rough = add_jerks(stages.jerks[k], reached, j, weight * h, sums, bends) if stages.stated else 0.0
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
        for n in range(2):  # the bounds of ṡ and h
            r, x, unit = last - 1 + n, 3 * n, 1.0 if n == 0 else 1 / stages.duration[k]
            push_low, push_high = force_low[k, r], force_high[k, r]
            stiff, force, pull, centre, missed, smaller, larger = _weigh(
                low[k, r], high[k, r], values[k, r], slack_low[k, r], push_low, slack_high[k, r], push_high
            )
            row_error, least, most = max(row_error, missed), min(least, smaller), max(most, larger)
            forces += push_low + push_high
            mapped[0, x] += force * unit
            mapped[1, x] += pull * unit
            mapped[2, x] += centre * unit
            bend[x, x] += stiff * unit * unit
        if stages.stated:
            for n in range(4):
                bend[n, 3] += mapped[3, n] / h * (2 if n == 3 else 1)
            mapped[3, 3] += weight * rough
        else:
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
def follow_step(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    slopes: Slopes,
    change: Array,
    mu: float,
    terms: Array,
    gains: Array,
    pushes: Array,
) -> tuple[float, float, float]:
    """Fill how values (N, 2M + 2) and forces (2, N, 2M + 2), below and above, follow a change (N, 4) of x.

    Returns the largest shares that leave slacks and forces positive, and the slope of the barrier's cost.
    """
    last = rows.low.shape[1] - 1
    low, high, values = rows.low, rows.high, misses.values
    primal = dual = 1.0
    slope = 0.0
    keep = max(0.99, 1 - mu)
    for k in range(len(stages.step)):
        v, a, j, h = motion.states[k, 0], motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        dv, da, dj, dh = change[k, 0], change[k, 1], change[k, 2], change[k, 3]
        for place in range(3):
            t, t_square, by_h, push_by_h = slope_place(place, a, j, h)
            pv, pa = reach(v, a, j, t)
            gain_v, gain_a = dv + t * da + t_square * dj + by_h * dh, da + t * dj + push_by_h * dh
            own = terms[k, place]
            own[0], own[1], own[2], own[3] = 0.0, gain_v, 2 * pv * gain_v, 3 * pv * pv * gain_v
            own[4], own[5], own[6] = gain_a, gain_v * pa + pv * gain_a, dj
        gains[k, last - 1], gains[k, last] = dv, dh / stages.duration[k]
        for n in range(4):
            slope += slopes.cost[k, n] * change[k, n]
        if dh * primal < -0.9 * h:
            primal = -0.9 * h / dh
    sum_terms(rows, terms, gains)
    for k in range(len(stages.step)):
        centred = 0.0
        for r in range(last + 1):
            value, gain = values[k, r], gains[k, r]
            if low[k, r] > -np.inf:
                slack, force = motion.slack_low[k, r], motion.force_low[k, r]
                inverse, step = 1 / slack, value - low[k, r] - slack + gain
                push = (mu - force * step) * inverse - force
                pushes[0, k, r] = push
                centred += step * inverse
                if step * primal < -keep * slack:
                    primal = -keep * slack / step
                if push * dual < -keep * force:
                    dual = -keep * force / push
            if high[k, r] < np.inf:
                slack, force = motion.slack_high[k, r], motion.force_high[k, r]
                inverse, step = 1 / slack, high[k, r] - value - slack - gain
                push = (mu - force * step) * inverse - force
                pushes[1, k, r] = push
                centred += step * inverse
                if step * primal < -keep * slack:
                    primal = -keep * slack / step
                if push * dual < -keep * force:
                    dual = -keep * force / push
        slope -= mu * centred
    return primal, dual, slope


@kernel
def try_share(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    state_change: Array,
    change: Array,
    terms: Array,
    gains: Array,
    share: float,
    weight: float,
    trial: Iterate,
    tried: Misses,
) -> tuple[float, float, float, float]:
    """Fill states, controls and slacks of `trial` with the motion changed by a share, and what it misses.

    Returns what a line search weighs: the sum of all misses, the cost, the sum of the slacks' logarithms; and Σ h.
    """
    count, last = len(stages.step), rows.low.shape[1] - 1
    low, high, values, slack_low, slack_high = rows.low, rows.high, tried.values, trial.slack_low, trial.slack_high
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
    if stages.stated:
        missed += abs(time - 1)
    evaluate(stages, rows, trial.states, trial.controls, terms, values)
    for k in range(count):
        below = above = 1.0  # a logarithm of a product is cheaper than the sum of logarithms
        missed_below = missed_above = 0.0
        for r in range(last + 1):
            value = values[k, r]
            if low[k, r] > -np.inf:
                slack = motion.slack_low[k, r]
                slack += share * (misses.values[k, r] - low[k, r] - slack + gains[k, r])
                slack_low[k, r] = slack
                below *= slack
                missed_below += abs(value - low[k, r] - slack)
            if high[k, r] < np.inf:
                slack = motion.slack_high[k, r]
                slack += share * (high[k, r] - misses.values[k, r] - slack - gains[k, r])
                slack_high[k, r] = slack
                above *= slack
                missed_above += abs(high[k, r] - value - slack)
            if min(below, above) < UNDERFLOW or max(below, above) > 1 / UNDERFLOW:
                logarithms += np.log(below) + np.log(above)
                below = above = 1.0
        logarithms += np.log(below) + np.log(above)
        missed += missed_below + missed_above
    return missed, weight * sum_costs(stages, trial.states, trial.controls), logarithms, time


@kernel
def push_forces(rows: StageRows, motion: Iterate, pushes: Array, share: float, mu: float) -> None:
    """Change the rows' forces by a share of `pushes`, and keep them near μ over their slacks."""
    smallest, largest = mu * LEAST_SHARE, mu / LEAST_SHARE
    for k in range(rows.low.shape[0]):
        for r in range(rows.low.shape[1]):
            if rows.low[k, r] > -np.inf:
                force, slack = motion.force_low[k, r] + share * pushes[0, k, r], motion.slack_low[k, r]
                if force * slack < smallest:
                    force = smallest / slack
                elif force * slack > largest:
                    force = largest / slack
                motion.force_low[k, r] = force
            if rows.high[k, r] < np.inf:
                force, slack = motion.force_high[k, r] + share * pushes[1, k, r], motion.slack_high[k, r]
                if force * slack < smallest:
                    force = smallest / slack
                elif force * slack > largest:
                    force = largest / slack
                motion.force_high[k, r] = force
