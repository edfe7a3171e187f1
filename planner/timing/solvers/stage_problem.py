"""A run's order-3 problem as the interior-point method takes it, and the motion that it leads to."""

import numpy as np

from kinematics.foundation.arrays import Array
from planner.limits.limit import Term
from planner.timing.problem import Block, Problem
from planner.timing.solvers.stages import StageRows, Stages, sum_costs

# A trace for jerk: as a share of its limit, squared and averaged over the guess' time. Where many motions take the same
# time it chooses a calm one, which also strays less between grid points.
JERK_WEIGHT = 2e-3
# What jerk costs beside a free end, where s̈ is to be constant: else q⃛ may peak between grid points, as it is 0 on one.
FREE_END_JERK_WEIGHT = 1e3
# Least duration of an interval, as a share of its guess: without it, solvers get stuck where some intervals vanish. It
# holds the answer back in 2 of 100 random runs, by 1e-3 at most, until the next solve starts from there.
SHORTEST = 0.1
SHORTEST_STATED = 0.05
"""The same where the duration is stated."""
STATED_COST = 10.0
"""What the guess costs then."""
TERMS = tuple(Term)
"""In the order that `stages` counts them in."""
POWERS = {
    Term.ONE: (0, 0),
    Term.SD: (1, 1),
    Term.SD2: (2, 2),
    Term.SD3: (3, 3),
    Term.SDD: (1, 2),
    Term.SDSDD: (2, 3),
    Term.SDDD: (1, 3),
}
"""L^p / T^q of each term, when lengths are counted in L and times in T."""


PosedStages = tuple[Stages, StageRows, Array, Array, Array]
"""Stages, rows, states (N + 1, 2) and controls (N, 2) to start from, and the units (4,) of ṡ, s̈, s⃛ and h."""


def pose_stages(problem: Problem, guess: Array, prize: float = 0.0) -> PosedStages:
    """The fastest motion's stages.

    guess (4, N): ṡ, s̈, s⃛, h. Lengths are counted in the run's, times in the guess' duration.
    prize: what the first ṡ is worth, counted in its largest, where it is to be found up to the problem's.
    """
    length, time = float(problem.s[-1] - problem.s[0]), float(guess[3].sum())
    unit = np.array([length / time, length / time**2, length / time**3, time])
    start = _pass_ends(problem, guess) / unit[:, None]
    # a motion of constant speed has no s̈ and s⃛; from rest to rest they are 4 and 32 at least
    scale = np.maximum(np.abs(start[:3]).max(1), [0.0, 1.0, 1.0])
    calm = JERK_WEIGHT * jerk_share(problem, unit[2]) ** 2 * start[3]
    controls = np.ascontiguousarray(start[2:].T)
    states = np.zeros((problem.intervals + 1, 2))
    states[:-1] = start[:2].T
    first, last = problem.ends
    states[0, 0] = first.jerk_limited_speed / unit[0]
    states[-1, 0] = last.jerk_limited_speed / unit[0]
    states[-1, 1] = last.acceleration / unit[1]
    free_start, free_end = problem.free_accelerations
    if not free_start:
        states[0, 1] = first.acceleration / unit[1]
    for end in np.flatnonzero(problem.free_accelerations):
        calm[-end], controls[-end, 0] = FREE_END_JERK_WEIGHT / scale[2] ** 2, 0.0
    step = np.diff(problem.s) / length
    stages = Stages(
        step,
        calm,
        scale,
        start[3].copy(),
        free_start,
        free_end,
        prize / scale[0],
        False,
        np.zeros((problem.intervals, 2, 0, 3)),
        np.zeros((problem.intervals, 2, 0, 2)),
    )
    rows = _pose_rows(problem, length, time, prize > 0)
    if prize > 0:
        states[0, 0] = start[0, 0]
        rows.low[0, -2], rows.high[0, -2] = 0.0, problem.speeds[0] / unit[0]
    return stages, rows, states, controls, unit


def _pass_ends(problem: Problem, guess: Array) -> Array:
    """The guess (4, N), with ṡ constant from an end that is passed up to where it is reached, or nearly, nearby."""
    columns, step, v = guess.copy(), np.diff(problem.s), guess[0]
    nearby = slice(0, problem.intervals // 4)
    for end, along in ((0, slice(None)), (1, slice(None, None, -1))):
        speed = problem.ends[end].passing_speed
        if speed > 0:
            own = np.arange(problem.intervals)[along][: int(np.argmax(np.minimum(v[along][nearby], speed)))]
            columns[:, own] = 0.0
            columns[0, own], columns[3, own] = speed, step[own] / speed
    return columns


def pose_smoothest(problem: Problem, guess: Array, jerks: Array) -> PosedStages:
    """The stages of the motion with the least ∫ Σ r² dt that takes as long as the guess (4, N).

    jerks (N, 2, A, 3): what r takes of s⃛, 3 ṡs̈ and ṡ³ at the interval's start and end, as an axis' jerk takes q′, q″
    and q‴. The guess costs ten, as the answer may cost a fraction.
    """
    v, a, _, h = guess  # the fastest motion without jerk limits has no jerk, but steps of s̈
    stages, rows, states, controls, unit = pose_stages(problem, np.stack([v, a, np.diff(a, append=0.0) / h, h]))
    length = unit[0] * unit[3]
    scaled = jerks * [1.0, 3 * length, length**2]
    stages = stages._replace(calm=np.zeros(problem.intervals), stated=True, jerks=scaled)
    cost = sum_costs(stages, states, controls)
    stages = stages._replace(jerks=scaled / np.sqrt(cost / STATED_COST) if cost > 0 else scaled)
    rows.low[:, -1] = SHORTEST_STATED
    return stages, rows, states, controls, unit


def pose_weighed(problem: Problem, guess: Array, pushes: Array, price: float) -> PosedStages:
    """The stages of the motion with the least T + price · ∫ Σ r² dt. guess (4, N): ṡ, s̈, s⃛, h.

    pushes (N, 2, A, 2): what r takes of s̈ and ṡ² at the interval's start and end, as an axis' acceleration takes q′ and
    q″; price: s per unit of that.
    """
    stages, rows, states, controls, unit = pose_stages(problem, guess)
    length, time = unit[0] * unit[3], unit[3]
    # r² counts 1/time⁴ and its integral 1/time³; the cost is counted in the guess' time
    scaled = pushes * np.array([length, length**2]) * np.sqrt(price) / time**2
    return stages._replace(pushes=scaled, calm=np.zeros(problem.intervals)), rows, states, controls, unit


def jerk_share(problem: Problem, unit: float) -> Array:
    """(N,) what one (scaled) unit of s⃛ uses of the tightest jerk limit."""
    share = np.zeros(problem.intervals)
    for block in problem.blocks:
        if Term.SDDD in block.start:
            np.maximum(share, np.abs(block.start[Term.SDDD]).max(1) * unit, out=share)
    return share


def _pose_rows(problem: Problem, length: float, time: float, free_speed: bool) -> StageRows:
    terms, counts, sizes, at_end = [], [], [], []
    first: list[Array] = []
    second: list[Array] = []
    for block in problem.blocks:
        own = tuple(block.start)
        end = Term.SDDD in own
        terms.append([TERMS.index(term) for term in own] + [0] * (len(TERMS) - len(own)))
        counts.append(len(own))
        sizes.append(block.start[own[0]].shape[1])
        at_end.append(end)
        unit = [length ** POWERS[term][0] / time ** POWERS[term][1] for term in own]
        start, stop = (np.stack([side[term] for term in own], axis=-1) * unit for side in (block.start, block.end))
        for coefficients, values in ((first, start), (second, stop if end else (start + stop) / 2)):
            coefficients.append(values.reshape(problem.intervals, -1))
    return StageRows(
        np.array(terms),
        np.array(counts),
        np.array(sizes),
        np.array(at_end),
        np.ascontiguousarray(np.concatenate(first, axis=1)),
        np.ascontiguousarray(np.concatenate(second, axis=1)),
        *pose_bounds(problem, free_speed),
    )


def pose_bounds(problem: Problem, free_speed: bool = False) -> tuple[Array, Array]:
    """(N, 2M + 2) what bounds the rows from below and from above, in the order of `StageRows`."""
    bounds = []
    for side, nothing in ((-1, -np.inf), (1, np.inf)):
        parts = [
            (block.middle + side) * room[:, None]
            for rooms in ([_start_room(block) for block in problem.blocks], [block.room for block in problem.blocks])
            for block, room in zip(problem.blocks, rooms, strict=True)
        ]
        bounds.append(np.concatenate([*parts, np.full((problem.intervals, 2), nothing)], axis=1))
    if not free_speed:  # none can be chosen at the very start, where ṡ and s̈ are given
        fixed = np.concatenate([np.full(block.middle.size, Term.SDDD not in block.start) for block in problem.blocks])
        bounds[0][0, : len(fixed)][fixed], bounds[1][0, : len(fixed)][fixed] = -np.inf, np.inf
    at_end = np.concatenate([np.full(block.middle.size, Term.SDDD in block.start) for block in problem.blocks])
    for there, k in ((np.flatnonzero(at_end), 0), (len(at_end) + np.flatnonzero(at_end), -1)):
        if problem.ends[k].passing_speed > 0:  # nor of what q‴ alone uses up there
            bounds[0][k, there], bounds[1][k, there] = -np.inf, np.inf
    bounds[0][1:, -2], bounds[0][:, -1] = 0.0, SHORTEST
    return bounds[0], bounds[1]


def _start_room(block: Block) -> Array:
    """Room of the rows at an interval's start; rows that are kept there only speak for the interval before it too."""
    if Term.SDDD in block.start:
        return block.room
    return np.concatenate([block.room[:1], np.minimum(block.room[1:], block.room[:-1])])
