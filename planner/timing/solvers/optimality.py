"""The order-3 problem's optimality conditions, stage by stage: their errors, slopes, steps and line search, in
compiled loops.
"""

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.kernels import kernel
from planner.timing.solvers.stages import DURATION, END, MIDDLE, SPEED, Iterate, Misses, Slopes, StageRows, Stages

UNDERFLOW = 1e-200
"""Where a product of slacks is taken the logarithm of, before it vanishes."""


@kernel
def _point_map(place: int, a: float, j: float, h: float, out: Array) -> None:
    """out (3, 4): (ṡ, s̈, s⃛) at a point of a stage by x."""
    for m in range(3):
        for n in range(4):
            out[m, n] = 1.0 if m == n else 0.0
    if place == MIDDLE:
        out[0, 1], out[0, 2], out[0, 3] = h / 2, h * h / 8, a / 2 + h * j / 4
        out[1, 2], out[1, 3] = h / 2, j / 2
    elif place == END:
        out[0, 1], out[0, 2], out[0, 3] = h, h * h / 2, a + h * j
        out[1, 2], out[1, 3] = h, j


@kernel
def linearize(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    slopes: Slopes,
    next_force: Array,
    step_force: Array,
    mu: float,
    weight: float,
) -> tuple[float, float, float, float]:
    """Fill `cost` and `bend` of `slopes`; the errors of the optimality conditions: of rows, costs, complementarity.

    next_force (N + 1, 2), step_force (N,)  multipliers of the next states and the steps
    """
    half_size = slopes.rows.shape[2] // 2
    weights, pushes, bends = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 2))
    maps, product = np.zeros((3, 4)), np.zeros((3, 4))
    row_error = cost_error = slack_error = forces = 0.0
    count = 0
    for k in range(len(stages.step)):
        a, j, h = motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1]
        weights[:], pushes[:], bends[:] = 0.0, 0.0, 0.0
        cost, bend = slopes.cost[k], slopes.bend[k]
        cost[:], bend[:] = 0.0, 0.0
        for r in range(2 * half_size + 2):
            w = force = 0.0
            if rows.low[k, r] > -np.inf:
                slack, own = motion.slack_low[k, r], motion.force_low[k, r]
                w += own / slack
                force -= own
                slack_error = max(slack_error, abs(slack * own - mu))
                row_error = max(row_error, abs(misses.values[k, r] - rows.low[k, r] - slack))
                forces += own
                count += 1
            if rows.high[k, r] < np.inf:
                slack, own = motion.slack_high[k, r], motion.force_high[k, r]
                w += own / slack
                force += own
                slack_error = max(slack_error, abs(slack * own - mu))
                row_error = max(row_error, abs(rows.high[k, r] - misses.values[k, r] - slack))
                forces += own
                count += 1
            place = rows.place[r]
            if place == SPEED:
                cost[0] += force
                bend[0, 0] += w
            elif place == DURATION:
                cost[3] += force / stages.duration[k]
                bend[3, 3] += w / stages.duration[k] ** 2
            elif w > 0:
                by_v, by_a, by_j = slopes.rows[k, 0, r], slopes.rows[k, 1, r], slopes.rows[k, 2, r]
                weights[place, 0] += w * by_v * by_v
                weights[place, 1] += w * by_v * by_a
                weights[place, 2] += w * by_v * by_j
                weights[place, 3] += w * by_a * by_a
                weights[place, 4] += w * by_a * by_j
                weights[place, 5] += w * by_j * by_j
                pushes[place, 0] += force * by_v
                pushes[place, 1] += force * by_a
                pushes[place, 2] += force * by_j
                bends[place, 0] += force * slopes.rows[k, 3, r]
                bends[place, 1] += force * slopes.rows[k, 4, r]
        for place in range(3):
            w0, w1, w2, w3, w4, w5 = weights[place]
            w0 += bends[place, 0]
            w1 += bends[place, 1]
            _point_map(place, a, j, h, maps)
            for n in range(4):
                m0, m1, m2 = maps[0, n], maps[1, n], maps[2, n]
                product[0, n] = w0 * m0 + w1 * m1 + w2 * m2
                product[1, n] = w1 * m0 + w3 * m1 + w4 * m2
                product[2, n] = w2 * m0 + w4 * m1 + w5 * m2
                cost[n] += pushes[place, 0] * m0 + pushes[place, 1] * m1 + pushes[place, 2] * m2
            for m in range(4):
                for n in range(m, 4):
                    for i in range(3):
                        bend[m, n] += maps[i, m] * product[i, n]
        if k == 0:
            cost[0] -= weight * stages.prize
        cost[2] += 2 * weight * stages.calm[k] * j
        cost[3] += weight
        bend[2, 2] += 2 * weight * stages.calm[k]
        # the middle, the end and the step are themselves bent
        mid_v, mid_a = pushes[MIDDLE, 0], pushes[MIDDLE, 1]
        end_v, end_a = pushes[END, 0] + next_force[k + 1, 0], pushes[END, 1] + next_force[k + 1, 1]
        own = step_force[k] / stages.step[k]
        bend[0, 3] += own
        bend[1, 3] += mid_v / 2 + end_v + own * h
        bend[2, 3] += mid_v * h / 4 + mid_a / 2 + end_v * h + end_a + own * h * h / 2
        bend[3, 3] += mid_v * j / 4 + end_v * j + own * (a + h * j)
        for m in range(4):
            for n in range(m):
                bend[m, n] = bend[n, m]
        for n in range(4):
            total = cost[n] + step_force[k] * slopes.step[k, n]
            total += next_force[k + 1, 0] * slopes.next[k, 0, n] + next_force[k + 1, 1] * slopes.next[k, 1, n]
            if n < 2 and k > 0:
                total -= next_force[k, n]
            elif (n == 0 and stages.prize == 0) or (n == 1 and not stages.free_start):
                total = 0.0
            cost_error = max(cost_error, abs(total) * (stages.scale[n] if n < 3 else stages.duration[k]))
        row_error = max(row_error, abs(misses.step[k]), abs(misses.next[k, 0]) / stages.scale[0])
        if k < len(stages.step) - 1 or not stages.free_end:
            row_error = max(row_error, abs(misses.next[k, 1]) / stages.scale[1])
    return row_error, cost_error, slack_error, forces / max(count, 1)


@kernel
def pull(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    slopes: Slopes,
    mu: float,
    weight: float,
    out: Array,
) -> None:
    """out (N, 4): the slopes of cost and rows by x, the rows' forces taken out to first order."""
    half_size = slopes.rows.shape[2] // 2
    pushes, maps = np.zeros((3, 3)), np.zeros((3, 4))
    for k in range(len(stages.step)):
        pushes[:], out[k] = 0.0, 0.0
        for r in range(2 * half_size + 2):
            force = 0.0
            if rows.low[k, r] > -np.inf:
                slack = motion.slack_low[k, r]
                force -= (mu - motion.force_low[k, r] * (misses.values[k, r] - rows.low[k, r] - slack)) / slack
            if rows.high[k, r] < np.inf:
                slack = motion.slack_high[k, r]
                force += (mu - motion.force_high[k, r] * (rows.high[k, r] - misses.values[k, r] - slack)) / slack
            place = rows.place[r]
            if place == SPEED:
                out[k, 0] += force
            elif place == DURATION:
                out[k, 3] += force / stages.duration[k]
            else:
                for n in range(3):
                    pushes[place, n] += force * slopes.rows[k, n, r]
        for place in range(3):
            _point_map(place, motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1], maps)
            for n in range(4):
                for i in range(3):
                    out[k, n] += pushes[place, i] * maps[i, n]
        out[k, 2] += 2 * weight * stages.calm[k] * motion.controls[k, 0]
        out[k, 3] += weight
    out[0, 0] -= weight * stages.prize


@kernel
def change_slacks(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    misses: Misses,
    slopes: Slopes,
    change: Array,
    mu: float,
    weight: float,
    steps: Array,
) -> tuple[float, float, float]:
    """Fill `steps` (4, N, 2M + 2) of slacks and forces, below and above, for a change (N, 4) of x.

    Returns the largest shares of them that leave slacks and forces positive, and the slope of the barrier's cost.
    """
    half_size = slopes.rows.shape[2] // 2
    primal = dual = 1.0
    slope = -weight * stages.prize * change[0, 0]
    keep = max(0.99, 1 - mu)
    moved, maps = np.zeros((3, 3)), np.zeros((3, 4))
    for k in range(len(stages.step)):
        for place in range(3):
            _point_map(place, motion.states[k, 1], motion.controls[k, 0], motion.controls[k, 1], maps)
            for i in range(3):
                moved[place, i] = 0.0
                for n in range(4):
                    moved[place, i] += maps[i, n] * change[k, n]
        slope += weight * (change[k, 3] + 2 * stages.calm[k] * motion.controls[k, 0] * change[k, 2])
        if change[k, 3] * primal < -0.9 * motion.controls[k, 1]:
            primal = -0.9 * motion.controls[k, 1] / change[k, 3]
        for r in range(2 * half_size + 2):
            place = rows.place[r]
            if place == SPEED:
                gain = change[k, 0]
            elif place == DURATION:
                gain = change[k, 3] / stages.duration[k]
            else:
                gain = slopes.rows[k, 0, r] * moved[place, 0]
                gain += slopes.rows[k, 1, r] * moved[place, 1] + slopes.rows[k, 2, r] * moved[place, 2]
            for side in range(2):
                if side == 0:
                    if rows.low[k, r] == -np.inf:
                        continue
                    slack, force = motion.slack_low[k, r], motion.force_low[k, r]
                    step = misses.values[k, r] - rows.low[k, r] - slack + gain
                else:
                    if rows.high[k, r] == np.inf:
                        continue
                    slack, force = motion.slack_high[k, r], motion.force_high[k, r]
                    step = rows.high[k, r] - misses.values[k, r] - slack - gain
                push = (mu - force * step) / slack - force
                steps[side, k, r], steps[2 + side, k, r] = step, push
                slope -= mu * step / slack
                if step * primal < -keep * slack:
                    primal = -keep * slack / step
                if push * dual < -keep * force:
                    dual = -keep * force / push
    return primal, dual, slope


@kernel
def try_change(
    stages: Stages,
    rows: StageRows,
    motion: Iterate,
    state_change: Array,
    change: Array,
    steps: Array,
    share: float,
    trial: Iterate,
) -> None:
    """Fill states, controls and slacks of `trial` with the motion changed by a share."""
    count = len(stages.step)
    for k in range(count):
        for n in range(2):
            trial.states[k, n] = motion.states[k, n] + share * state_change[k, n]
            trial.controls[k, n] = motion.controls[k, n] + share * change[k, 2 + n]
        for r in range(motion.slack_low.shape[1]):
            if rows.low[k, r] > -np.inf:
                trial.slack_low[k, r] = motion.slack_low[k, r] + share * steps[0, k, r]
            if rows.high[k, r] < np.inf:
                trial.slack_high[k, r] = motion.slack_high[k, r] + share * steps[1, k, r]
    if stages.free_end:
        trial.states[count, 1] = motion.states[count, 1] + share * state_change[count, 1]


@kernel
def push_forces(rows: StageRows, motion: Iterate, steps: Array, share: float, mu: float) -> None:
    """Change the rows' forces by a share, and keep them near μ over their slacks."""
    for k in range(motion.slack_low.shape[0]):
        for r in range(motion.slack_low.shape[1]):
            if rows.low[k, r] > -np.inf:
                middle = mu / motion.slack_low[k, r]
                force = motion.force_low[k, r] + share * steps[2, k, r]
                motion.force_low[k, r] = min(max(force, middle * 1e-10), middle * 1e10)
            if rows.high[k, r] < np.inf:
                middle = mu / motion.slack_high[k, r]
                force = motion.force_high[k, r] + share * steps[3, k, r]
                motion.force_high[k, r] = min(max(force, middle * 1e-10), middle * 1e10)


@kernel
def measure(
    stages: Stages, rows: StageRows, motion: Iterate, misses: Misses, mu: float, weight: float
) -> tuple[float, float]:
    """The sum of all misses, and the cost with its barrier: what a line search weighs."""
    count = len(stages.step)
    missed, cost = 0.0, -weight * stages.prize * motion.states[0, 0]
    for k in range(count):
        cost += weight * (motion.controls[k, 1] + stages.calm[k] * motion.controls[k, 0] ** 2)
        missed += abs(misses.step[k]) + abs(misses.next[k, 0]) / stages.scale[0]
        if k < count - 1 or not stages.free_end:
            missed += abs(misses.next[k, 1]) / stages.scale[1]
        product = 1.0  # a logarithm of a product is cheaper than the sum of logarithms
        for r in range(motion.slack_low.shape[1]):
            if rows.low[k, r] > -np.inf:
                product *= motion.slack_low[k, r]
                missed += abs(misses.values[k, r] - rows.low[k, r] - motion.slack_low[k, r])
            if rows.high[k, r] < np.inf:
                product *= motion.slack_high[k, r]
                missed += abs(rows.high[k, r] - misses.values[k, r] - motion.slack_high[k, r])
            if product < UNDERFLOW or product > 1 / UNDERFLOW:
                cost -= mu * np.log(product)
                product = 1.0
        cost -= mu * np.log(product)
    return missed, cost


@kernel
def complementarity_error(rows: StageRows, motion: Iterate, mu: float) -> float:
    """The largest |slack · force − μ|."""
    error = 0.0
    for k in range(motion.slack_low.shape[0]):
        for r in range(motion.slack_low.shape[1]):
            if rows.low[k, r] > -np.inf:
                error = max(error, abs(motion.slack_low[k, r] * motion.force_low[k, r] - mu))
            if rows.high[k, r] < np.inf:
                error = max(error, abs(motion.slack_high[k, r] * motion.force_high[k, r] - mu))
    return error
