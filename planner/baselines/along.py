"""Classical timings along the path: one profile of speed per run, the quickest of its kind, scaled until certified."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from kinematics.array import Array
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit, Term
from planner.timing.problem import Block, Problem, Run, grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.shapes import Shapes

# Intervals of a run at least, and for each radian that it turns, at which the limits' rows are looked up.
INTERVALS, PER_RADIAN = 500, 100
# Values of each parameter tried at first, by how many parameters there are; then directions tried around the best, the
# share of the step that is left where none of them is better, and the step at which the search ends.
FIRST, DIRECTIONS, SHRINK, LEAST = {1: 32, 2: 12}, {1: 2, 2: 8}, 0.6, 3e-4
# By how much the directions turn after each look: a valley with a kink in it is never missed for long.
GOLDEN = np.pi * (3 - np.sqrt(5))
# Instants of a piece of a profile, and more for the share of the way that it makes.
LOOKED, PER_WAY = 8, 400
# By how much the first motion is too fast: a quantity's use goes with a power of time, so the proof of a motion that
# breaks a limit tells exactly by how much to slow it.
HASTE, MARGIN = 1e-2, 1e-6
# Where a limit has terms of several powers of time it tells that only nearly: a finer grid, and less haste.
FINER, LITTLE = 6, 1e-4
BISECTIONS = 50


@dataclass(frozen=True, slots=True)
class Slowed:
    """A profile of a given shape, which only time scales."""

    profile: Profile
    method: str

    @property
    def floor(self) -> float:
        """None: of the least time of any motion it knows nothing."""
        return 0.0

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Slowed":
        return replace(self, profile=self.profile.slowed(slowness * (1 + MARGIN)))


@dataclass(frozen=True, slots=True)
class Along:
    """The quickest profile of a family along a run: what `planner.solve.proved` asks of a timing."""

    shapes: Shapes

    def __call__(self, path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Slowed:
        intervals = max(INTERVALS, int(PER_RADIAN * path.turns[run.first : run.last + 1].sum()))
        problem = pose_problem(path, limits, *grid(path, run, intervals))
        mixed = any(len({term.per_time for term in block.start}) > 1 for block in problem.blocks)
        if mixed:
            problem = pose_problem(path, limits, *grid(path, run, FINER * intervals))
        best = _quickest(self.shapes, problem)
        unit = self.shapes.draw(*best)
        breaks = path.breaks[run.first : run.last + 2]
        return Slowed(
            unit.over(breaks, run.first, (1 - (LITTLE if mixed else HASTE)) * _time(problem, unit)), self.shapes.name
        )


def _quickest(shapes: Shapes, problem: Problem) -> tuple[float, ...]:
    """The parameters of the profile that takes the least time: the best of a grid, then whatever is better around it.

    On logarithmic scales. The time is the largest of several, so it has kinks, and no slope is relied on.
    """
    low, high = np.log(shapes.spans).T

    def time(point: Array) -> float:
        return _time(problem, shapes.draw(*np.exp(point)))

    axes = [np.linspace(*ends, FIRST[len(low)]) for ends in zip(low, high, strict=True)]
    best = min((np.array(point) for point in product(*axes)), key=time)
    least, step, turned = time(best), float(axes[0][1] - axes[0][0]), 0.0
    while step > LEAST:
        angles = turned + 2 * np.pi * np.arange(DIRECTIONS[len(low)]) / DIRECTIONS[len(low)]
        ways = np.stack([np.cos(angles), np.sin(angles)], 1) if len(low) == 2 else np.array([[1.0], [-1.0]])
        around = [np.clip(best + step * way, low, high) for way in ways]
        times = [time(point) for point in around]
        if min(times) < least:
            least, best = min(times), around[int(np.argmin(times))]
        else:
            step *= SHRINK
        turned += GOLDEN
    return tuple(np.exp(best))


def _time(problem: Problem, unit: Profile) -> float:
    """s that a unit profile must take over a run so that every row is kept, as nearly as the grid shows it."""
    length = problem.s[-1] - problem.s[0]
    ends = np.append(unit.s[1:], 1.0)
    counts = LOOKED + np.ceil(PER_WAY * (ends - unit.s)).astype(int)
    k = np.repeat(np.arange(len(counts)), counts)
    share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])
    s, v, a, j = unit.at(k, share * unit.h[k])
    interval = np.searchsorted(problem.s, problem.s[0] + length * s, side="right").clip(1, problem.intervals) - 1
    v, a, j = length * v, length * a, length * j
    values = {
        Term.ONE: np.ones(len(s)),
        Term.SD: v,
        Term.SD2: v**2,
        Term.SD3: v**3,
        Term.SDD: a,
        Term.SDSDD: v * a,
        Term.SDDD: j,
    }
    return max(_block_time(block, interval, values, v) for block in problem.blocks)


def _block_time(block: Block, interval: np.ndarray, values: Mapping[Term, Array], v: Array) -> float:
    parts: dict[int, Array] = {}
    for term, coefficients in block.start.items():
        part = coefficients[interval] * values[term][:, None]
        parts[term.per_time] = parts[term.per_time] + part if term.per_time in parts else part
    if len(parts) == 1:
        ((power, part),) = parts.items()
        return float(block.share(part).max()) ** (1 / power) if power else 0.0
    # terms of several powers of time: the use falls with time until only what acts at rest remains
    low, high = 1e-9, 1e9
    for _ in range(BISECTIONS):
        time = float(np.sqrt(low * high))
        total: Array = np.sum([part / time**power for power, part in parts.items()], axis=0)
        if block.about is not None:  # rows that speak near some motions only
            low_v, high_v = (values[interval] for values in block.about[:2])
            total = np.where((low_v <= v[:, None] / time) & (v[:, None] / time < high_v), total, 0.0)
        kept = block.share(total).max() <= 1
        low, high = (low, time) if kept else (time, high)
    return high
