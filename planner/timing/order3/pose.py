"""Problems of order 3 in scaled variables, stage by stage.

Lengths are counted in the length of the run, times in the duration of the guess.
"""

from typing import NamedTuple

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.limits.limit import Term
from planner.timing.order3.stages import Rows, Stages, sum_costs
from planner.timing.problem import Block, Problem

# Weight of the jerk's square, as a share of its limit, averaged over the time of the guess. Where
# many motions take the same time it selects a smooth one, which also exceeds limits less between
# grid points; it costs duration.
JERK_WEIGHT = 2e-3
# Weight of the jerk next to an end with free s̈, where s̈ is to be constant: on one interval q⃛ is
# zero at one grid point, and may peak between two.
FREE_END_JERK_WEIGHT = 1e3
# Least duration of an interval, as a share of its guess: without it, solvers get stuck where
# intervals vanish. It binds in 2 of 100 random runs, for 1e-3 of the duration at most, until the
# next solve starts from there.
SHORTEST = 0.1
SHORTEST_STATED = 0.05
"""Least duration of an interval, as a share of its guess, where the total duration is stated."""
STATED_COST = 10.0
"""Objective of the guess where the duration is stated: that of the solution may be a fraction."""
# The objective is counted in thousandths of the guess' duration, or more finely on more than a
# thousand intervals: the constants of the interior-point method are usual for that size, and μ then
# weighs as much against the time of an interval however long the run is.
OBJECTIVE_SCALE = 1000.0
# Least step between which coefficients are interpolated, as a share of the path length.
MIN_STEP = 1e-15
TERMS = tuple(Term)
"""Terms in the order of their numbers in `Rows`."""
POWERS = {
    Term.ONE: (0, 0),
    Term.SD: (1, 1),
    Term.SD2: (2, 2),
    Term.SD3: (3, 3),
    Term.SDD: (1, 2),
    Term.SDSDD: (2, 3),
    Term.SDDD: (1, 3),
}
"""Unit of each term: (p, q) for L^p / T^q."""


class PosedStages(NamedTuple):
    """Stages and rows, a guess of states (N + 1, 2) and controls (N, 2), units (4,) of v, a, j, h.

    The first and the last states are fixed, except what the stages declare free.
    """

    stages: Stages
    rows: Rows
    states: Array
    controls: Array
    unit: Array

    def columns(self, states: Array, controls: Array) -> Array:
        """Return (4, N) of ṡ, s̈, s⃛, h in their own units."""
        return np.asarray(np.concatenate([states[:-1].T, controls.T]) * self.unit[:, None])


def pose_stages(problem: Problem, guess: Array, start_reward: float = 0.0) -> PosedStages:
    """Return the stages of the fastest motion.

    guess         (4, N) of ṡ, s̈, s⃛, h
    start_reward  value of the first ṡ, counted in its largest; if positive, that ṡ is free
    """
    length = float(problem.s[-1] - problem.s[0])
    time = float(guess[3].sum())
    unit = np.array([length / time, length / time**2, length / time**3, time])
    start = _pass_ends(problem, guess) / unit[:, None]
    # a motion of constant speed has no s̈ and s⃛; from rest to rest they are 4 and 32 at least
    scale = np.maximum(np.abs(start[:3]).max(1), [0.0, 1.0, 1.0])
    jerk_weight = JERK_WEIGHT * jerk_share(problem, unit[2]) ** 2 * start[3]
    controls = np.ascontiguousarray(start[2:].T)
    for end, free in enumerate(problem.free_accelerations):
        if free:
            jerk_weight[-end] = FREE_END_JERK_WEIGHT / scale[2] ** 2
            controls[-end, 0] = 0.0
    rows = _pose_rows(problem, length, time, start_reward > 0)
    states = _pose_states(problem, start, unit)
    if start_reward > 0:
        states[0, 0] = start[0, 0]
        rows.low[0, -2] = 0.0
        rows.high[0, -2] = problem.speeds[0] / unit[0]
    stages = Stages(
        step=np.diff(problem.s) / length,
        scale=scale,
        duration=start[3].copy(),
        free_start=problem.free_accelerations[0],
        free_end=problem.free_accelerations[1],
        start_reward=start_reward / scale[0],
        fixed_time=False,
        jerk_weight=jerk_weight,
        squares=np.zeros((problem.intervals, 2, 0, 5)),
        objective_scale=max(OBJECTIVE_SCALE, float(problem.intervals)),
    )
    return PosedStages(stages, rows, states, controls, unit)


def _pose_states(problem: Problem, start: Array, unit: Array) -> Array:
    states = np.zeros((problem.intervals + 1, 2))
    states[:-1] = start[:2].T
    first, last = problem.ends
    states[0, 0] = first.jerk_limited_speed / unit[0]
    states[-1, 0] = last.jerk_limited_speed / unit[0]
    states[-1, 1] = last.acceleration / unit[1]
    if not problem.free_accelerations[0]:
        states[0, 1] = first.acceleration / unit[1]
    return states


def _pass_ends(problem: Problem, guess: Array) -> Array:
    """Return the guess (4, N), at constant ṡ next to an end that is passed."""
    columns = guess.copy()
    step = np.diff(problem.s)
    nearby = slice(0, problem.intervals // 4)
    for end, along in ((0, slice(None)), (1, slice(None, None, -1))):
        speed = problem.ends[end].passing_speed
        if speed > 0:
            fastest = int(np.argmax(np.minimum(guess[0][along][nearby], speed)))
            constant = np.arange(problem.intervals)[along][:fastest]
            columns[:, constant] = 0.0
            columns[0, constant] = speed
            columns[3, constant] = step[constant] / speed
    return columns


def pose_smoothest(problem: Problem, guess: Array, jerks: Array) -> PosedStages:
    """Return the stages of the motion with the least ∫ Σ r² dt in the time of the guess (4, N).

    jerks (N, 2, A, 3): coefficients of s⃛, 3 ṡs̈ and ṡ³ in r at both ends of each interval.
    """
    # the fastest motion without jerk limits has no jerk, but steps of s̈
    v, a, _, h = guess
    posed = pose_stages(problem, np.stack([v, a, np.diff(a, append=0.0) / h, h]))
    length = posed.unit[0] * posed.unit[3]
    squares = np.zeros((*jerks.shape[:3], 5))
    squares[..., :3] = jerks * [1.0, 3 * length, length**2]
    stages = posed.stages._replace(
        jerk_weight=np.zeros(problem.intervals),
        fixed_time=True,
        squares=squares,
    )
    cost = sum_costs(stages, posed.states, posed.controls)
    if cost > 0:
        stages = stages._replace(squares=squares / np.sqrt(cost / STATED_COST))
    posed.rows.low[:, -1] = SHORTEST_STATED
    return posed._replace(stages=stages)


def pose_weighted(
    problem: Problem,
    guess: Array,
    accelerations: Array,
    price: float,
) -> PosedStages:
    """Return the stages of the motion with the least T + price · ∫ Σ r² dt.

    guess          (4, N) of ṡ, s̈, s⃛, h
    accelerations  (N, 2, A, 2) coefficients of s̈ and ṡ² in r at both ends of each interval
    price          s per unit of the integral
    """
    posed = pose_stages(problem, guess)
    time = posed.unit[3]
    length = posed.unit[0] * time
    squares = np.zeros((*accelerations.shape[:3], 5))
    # r² counts 1/time⁴ and its integral 1/time³; the objective is counted in the guess' time
    squares[..., 3:] = accelerations * np.array([length, length**2]) * np.sqrt(price) / time**2
    stages = posed.stages._replace(squares=squares, jerk_weight=np.zeros(problem.intervals))
    return posed._replace(stages=stages)


def jerk_share(problem: Problem, unit: float) -> Array:
    """Return (N,) the share of the tightest jerk limit that one (scaled) unit of s⃛ uses."""
    share = np.zeros(problem.intervals)
    for block in problem.blocks:
        if Term.SDDD in block.start:
            np.maximum(share, largest_in_rows(np.abs(block.start[Term.SDDD])) * unit, out=share)
    return share


def _pose_rows(problem: Problem, length: float, time: float, free_speed: bool) -> Rows:
    terms = np.zeros((len(problem.blocks), len(TERMS)), int)
    first: list[Array] = []
    second: list[Array] = []
    for block, numbers in zip(problem.blocks, terms, strict=True):
        unit = [length ** POWERS[term][0] / time ** POWERS[term][1] for term in block.start]
        numbers[: len(unit)] = [TERMS.index(term) for term in block.start]
        start = np.stack(list(block.start.values()), axis=-1) * unit
        end = np.stack([block.end[term] for term in block.start], axis=-1) * unit
        start = start.reshape(problem.intervals, -1)
        end = end.reshape(problem.intervals, -1)
        first.append(start)
        has_jerk = Term.SDDD in block.start
        second.append(end if has_jerk else interpolate_middles(problem, start, end))
    low, high = pose_bounds(problem, free_speed)
    return Rows(
        terms=terms,
        lengths=np.array([len(block.start) for block in problem.blocks]),
        size=np.array([block.middle.size for block in problem.blocks]),
        at_end=np.array([Term.SDDD in block.start for block in problem.blocks]),
        first=np.ascontiguousarray(np.concatenate(first, axis=1)),
        second=np.ascontiguousarray(np.concatenate(second, axis=1)),
        low=low,
        high=high,
    )


def interpolate_middles(problem: Problem, start: Array, end: Array) -> Array:
    """Return coefficients (N, m) in the middle of each interval, from those at its start and end.

        c = (c₀ + c₁)/2 − Δs²/8 · c″

    Without c″ a cruise would exceed its speed limit between grid points by Δs² q‴/(8 q′). c″ comes
    from the slopes on adjacent intervals of the same piece; it is 0 for a piece of one interval. Of
    the differences to the interval before and to the one after the smaller counts, and none where
    their signs differ: next to a step of c both would mislead.
    """
    # rounding may leave nothing of an interval, which solvers refuse
    step = np.maximum(np.diff(problem.s), MIN_STEP * problem.s[-1])[:, None]
    change = np.diff((end - start) / step, axis=0) / ((step[1:] + step[:-1]) / 2)
    joined = np.diff(problem.piece)[:, None] == 0
    inner = np.where(joined, change, np.nan)
    none = np.full_like(start[:1], np.nan)
    before = np.concatenate([none, inner])
    after = np.concatenate([inner, none])
    # fmin and fmax ignore the missing side
    least = np.fmin(before, after)
    most = np.fmax(before, after)
    curvature = np.nan_to_num(np.clip(0.0, least, most))
    return np.asarray((start + end) / 2 - step**2 / 8 * curvature)


def pose_bounds(problem: Problem, free_speed: bool = False) -> tuple[Array, Array]:
    """Return the lower and upper bounds (N, 2M + 2) of `Rows`."""
    bounds = []
    for side in (-1, 1):
        parts = [(block.middle + side) * _start_room(block)[:, None] for block in problem.blocks]
        parts += [(block.middle + side) * block.room[:, None] for block in problem.blocks]
        parts.append(np.full((problem.intervals, 2), side * np.inf))
        bounds.append(np.concatenate(parts, axis=1))
    has_jerk = [Term.SDDD in block.start for block in problem.blocks]
    with_jerk = np.repeat(has_jerk, [block.middle.size for block in problem.blocks])
    jerk_rows = np.flatnonzero(with_jerk)
    for side, bound in zip((-1, 1), bounds, strict=True):
        if not free_speed:
            # ṡ and s̈ are given at the start
            bound[0, np.flatnonzero(~with_jerk)] = side * np.inf
        # an end that is passed uses up the jerk limit through q‴ alone
        if problem.ends[0].passing_speed > 0:
            bound[0, jerk_rows] = side * np.inf
        if problem.ends[1].passing_speed > 0:
            bound[-1, len(with_jerk) + jerk_rows] = side * np.inf
    low, high = bounds
    low[1:, -2] = 0.0
    low[:, -1] = SHORTEST
    return low, high


def _start_room(block: Block) -> Array:
    """Return the room (N,) at the starts: without s⃛, that of the interval before counts too."""
    if Term.SDDD in block.start:
        return block.room
    return np.concatenate([block.room[:1], np.minimum(block.room[1:], block.room[:-1])])
