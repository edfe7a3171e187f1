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

# Intervals of a run at least, and for each piece in it; of the order-2 motion that starts an order-3 solve.
SECOND_ORDER, THIRD_ORDER, START = (1000, 50), (240, 12), (400, 20)
# Room taken off: this share of the excess more than the excess, and a little for the solver's own tolerance. It saves
# rounds.
MORE, MARGIN = 1.1, 2e-7


@dataclass(frozen=True, slots=True)
class Attempt:
    """A problem, the profile that answers it, and the method that gave it.

    fallback: a jerk-limited motion that is feasible once slowed by `slowness`, for when the solver gives no answer.
    """

    problem: Problem
    profile: Profile
    method: str
    fallback: Smoothed | None = None
    slowness: float = 1.0

    def tightened(self, use: Mapping[str, Array]) -> "Attempt":
        """Solved again with less room wherever the certificate found a limit exceeded: use per limit and interval."""
        if self.method == "averaged":
            return self._slowed(use)
        blocks = []
        for block in self.problem.blocks:
            excess = use[block.name]
            less = block.room / (1 + MORE * (excess - 1)) * (1 - MARGIN)
            blocks.append(replace(block, room=np.where(excess > 1, less, block.room)))
        problem = replace(self.problem, blocks=tuple(blocks))
        if self.fallback is None:
            return replace(self, problem=problem, profile=second_order(problem))
        return _solve_third(problem, self.profile.columns(), self.fallback)

    def _slowed(self, use: Mapping[str, Array]) -> "Attempt":
        """The fallback, slowed as a whole until it holds: by k, a term of order n in 1/time falls by kⁿ."""
        assert self.fallback is not None
        powers = {block.name: min(term.per_time for term in block.start) for block in self.problem.blocks}
        more = max(float(use[name].max()) ** (1 / power) for name, power in powers.items())
        slowness = self.slowness * max(1.0, more) * (1 + MARGIN)
        return replace(self, slowness=slowness, profile=self.fallback.profile(slowness, self.problem))


def attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Attempt:
    """The first solve of a run. Raises MotionError when nothing bounds it."""
    if order == 2:
        problem = pose_problem(path, limits, *grid(path, run, _size(SECOND_ORDER, run.last - run.first + 1)))
        _need(problem, Term.SDD, "acceleration")
        return Attempt(problem, second_order(problem), "toppra")
    problem, start = jerk_problem(path, limits, run)
    return _solve_third(problem, start.on(problem.s), start)


def jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> tuple[Problem, Smoothed]:
    """The order-3 problem of a run, on a grid graded for it, and the averaged order-2 motion to start from."""
    pieces = run.last - run.first + 1
    coarse = pose_problem(path, limits, *grid(path, run, _size(START, pieces)))
    _need(coarse, Term.SDDD, "jerk")
    coarse, window = _second_order_start(coarse)
    start = Smoothed(second_order(coarse), window)
    shares = (start.spread(_size(THIRD_ORDER, pieces)) - coarse.s[0]) / (coarse.s[-1] - coarse.s[0])
    s, piece = grid(path, run, len(shares) - 1, np.clip(shares, 0.0, 1.0))
    return pose_problem(path, limits, s, piece), start


def _size(rule: tuple[int, int], pieces: int) -> int:
    return max(rule[0], rule[1] * pieces)


def _solve_third(problem: Problem, guess: Array, fallback: Smoothed) -> Attempt:
    for solver in ("fatrop", "ipopt"):
        try:
            return Attempt(problem, third_order(problem, guess, solver=solver), solver, fallback)
        except MotionError:
            continue
    return Attempt(problem, fallback.profile(1.0, problem), "averaged", fallback)


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
