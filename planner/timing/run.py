"""One run from rest to rest, on its way to a motion that holds: posed, solved, tightened, solved again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit, Term
from planner.timing.problem import Block, Problem, Run, grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.second_order import TERMS as SECOND
from planner.timing.second_order import second_order
from planner.timing.smooth import Smoothed
from planner.timing.third_order import third_order

# Intervals of a run at least, for each piece in it, and for each radian that it turns; START is for the order-2 motion
# that starts an order-3 solve.
SECOND_ORDER, THIRD_ORDER, START = (1000, 50, 40), (240, 12, 10), (400, 20, 20)
# Fewer do where the axes' directions q′ hardly change along a run: so many for each change by the whole of themselves,
# rounded up to one of a few sizes, since the problem of each order-3 size is built once. Measured on lines of the
# hexapod: durations stay within 3e-4 of those on 8000 (order 2) and 960 intervals (order 3).
FEWER = {2: (2000, (250, 350, 500, 700)), 3: (600, (160, 200))}
# On such a grid at order 2, each interval at whose ends s̈ steps by this share of the largest is cut in so many.
STEPS, PARTS = 0.2, 8
# Points of each piece at which its directions are looked at.
LOOKED = 17
# A motion that holds once it is so much slower is slowed: that costs no more than another solve would be off.
SLIGHTLY = 2e-5
# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
MORE, MARGIN = 1.1, 2e-7
# How often a run is solved before it is slowed instead.
TRIES = 5
AVERAGED = "averaged"


@dataclass(frozen=True, slots=True)
class Attempt:
    """A problem, the profile that answers it, and the method that gave it.

    tries: how often it was solved. The peaks between grid points heed the room only in part: each try takes off more.
    """

    problem: Problem
    profile: Profile
    method: str
    order: int
    tries: int = 1

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Attempt":
        """Solved again with less room wherever the certificate found a limit exceeded: use per limit and interval.

        Where that does not help, or hardly matters, the same motion slowed as a whole: what holds if anything does.
        """
        if self.tries < TRIES and self.method != AVERAGED and slowness > 1 + SLIGHTLY:
            blocks = []
            for block in self.problem.blocks:
                excess = use[block.name]
                less = block.room / (1 + MORE * self.tries * (excess - 1)) * (1 - MARGIN)
                blocks.append(replace(block, room=np.where(excess > 1, less, block.room)))
            problem = replace(self.problem, blocks=tuple(blocks))
            try:
                profile, method = self._solved(problem)
                return replace(self, problem=problem, profile=profile, method=method, tries=self.tries + 1)
            except MotionError:
                pass
        return replace(self, profile=self.profile.slowed(slowness * (1 + MARGIN)))

    def _solved(self, problem: Problem) -> tuple[Profile, str]:
        if self.order == 2:
            return second_order(problem), "passes"
        return _third(problem, self.profile.columns())


def attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Attempt:
    """The first solve of a run. Raises MotionError when nothing bounds it."""
    if order == 2:
        intervals = size(2, path, run)
        problem = pose_problem(path, limits, *grid(path, run, intervals))
        _need(problem, Term.SDD, "acceleration")
        if intervals < SECOND_ORDER[0]:
            problem = pose_problem(path, limits, *_finer(problem, second_order(problem)))
        return Attempt(problem, second_order(problem), "passes", order)
    problem, start = jerk_problem(path, limits, run)
    try:
        profile, method = _third(problem, start.on(problem.s))
    except MotionError:
        profile, method = start.profile(problem), AVERAGED
    return Attempt(problem, profile, method, order)


def jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> tuple[Problem, Smoothed]:
    """The order-3 problem of a run, on a grid graded for it, and the averaged order-2 motion to start from."""
    coarse = pose_problem(path, limits, *grid(path, run, _whole_size(START, path, run)))
    _need(coarse, Term.SDDD, "jerk")
    coarse, window = _second_order_start(coarse)
    start = Smoothed(second_order(coarse), window)
    shares = (start.spread(size(3, path, run)) - coarse.s[0]) / (coarse.s[-1] - coarse.s[0])
    s, piece = grid(path, run, len(shares) - 1, np.clip(shares, 0.0, 1.0))
    return pose_problem(path, limits, s, piece), start


def _finer(problem: Problem, motion: Profile) -> tuple[Array, np.ndarray]:
    """The grid with every interval cut in PARTS about which s̈ steps: it cannot step inside one, and that takes time."""
    step = np.abs(np.diff(motion.a, prepend=0.0, append=0.0)) > STEPS * np.abs(motion.a).max()
    count = np.where(step[:-1] | step[1:], PARTS, 1)
    first = np.repeat(np.cumsum(count) - count, count)
    share = (np.arange(count.sum()) - first) / np.repeat(count, count)
    s = np.repeat(problem.s[:-1], count) + share * np.repeat(np.diff(problem.s), count)
    return np.append(s, problem.s[-1]), np.repeat(problem.piece, count)


def size(order: int, path: ActuatorPath, run: Run) -> int:
    """Intervals that a run's grid needs."""
    whole = _whole_size(SECOND_ORDER if order == 2 else THIRD_ORDER, path, run)
    per_change, sizes = FEWER[order]
    wanted = per_change * _change(path, run)
    return min([size for size in sizes if size >= wanted], default=whole) if run.first == run.last else whole


def _change(path: ActuatorPath, run: Run) -> float:
    """How much the axes' directions change along a run, as a share of the largest q′."""
    breaks = path.breaks[run.first : run.last + 2]
    s = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.0, 1.0, LOOKED)).ravel()
    slope = path.derivatives(s, np.repeat(np.arange(run.first, run.last + 1), LOOKED))[1]
    return float(np.abs(np.diff(slope, axis=0)).max(1).sum() / np.abs(slope).max())


def _whole_size(rule: tuple[int, int, int], path: ActuatorPath, run: Run) -> int:
    least, per_piece, per_radian = rule
    turn = float(path.turns[run.first : run.last + 1].sum())
    return max(least, per_piece * (run.last - run.first + 1), int(per_radian * turn))


def _third(problem: Problem, guess: Array) -> tuple[Profile, str]:
    """By FATROP, or by IPOPT where that gives no answer; which of them is told."""
    try:
        return third_order(problem, guess), "fatrop"
    except MotionError:
        return third_order(problem, guess, solver="ipopt"), "ipopt"


def _need(problem: Problem, term: Term, name: str) -> None:
    if not any(np.any(block.start.get(term, 0.0)) for block in problem.blocks):
        raise MotionError(
            f"nothing bounds the motion: no axis that moves states a limit of {name}; "
            "state one, or plan at another order"
        )


def _second_order_start(problem: Problem) -> tuple[Problem, float]:
    """The problem without its jerk rows, and the window A/J over which its motion is averaged.

    A is the least of the limit on acceleration and what the jerk lets a motion reach before full speed, √(V J), or
    halfway, (J² L/2)^⅓; speeds, accelerations and jerks are along the path, on average. It shapes the start only,
    never the answer.
    """
    jerk, speed, push = _along(problem, Term.SDDD), _along(problem, Term.SD), _along(problem, Term.SDD)
    reached = min(np.sqrt(speed * jerk), np.cbrt(jerk**2 * (problem.s[-1] - problem.s[0]) / 2))
    if not np.isfinite(reached):
        raise MotionError(
            "nothing bounds the motion: no axis that moves states a limit of speed or acceleration; state one"
        )
    blocks = [block for block in problem.blocks if set(block.start) <= SECOND]
    if reached < push:
        size = np.full((problem.intervals, 1), 1 / reached)
        blocks.append(Block("start", {Term.SDD: size}, {Term.SDD: size}, np.ones(problem.intervals)))
    return replace(problem, blocks=tuple(blocks)), min(reached, push) / jerk


def _along(problem: Problem, term: Term) -> float:
    """How large a term may be along the path by itself, on average; ∞ where no row holds it."""
    size = np.zeros(problem.intervals)
    for block in problem.blocks:
        if term in block.start:
            np.maximum(size, np.abs(block.start[term]).max(1), out=size)
    return 1 / float(size.mean()) if size.any() else float("inf")
