"""One run, on its way to a motion that holds: posed, solved, tightened, solved again."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit, Term
from planner.place import Infeasible
from planner.timing.ends import TooFast
from planner.timing.problem import Block, Problem, Run, grid, pose_problem
from planner.timing.profile import Profile
from planner.timing.second_order import TERMS as SECOND
from planner.timing.second_order import second_order
from planner.timing.seen import seen
from planner.timing.smooth import Smoothed
from planner.timing.straight import straight
from planner.timing.third_order import third_order

# Intervals of a run at least, for each piece in it, and for each radian that it turns; START is for the order-2 motion
# that starts an order-3 solve.
SECOND_ORDER, THIRD_ORDER, START = (1000, 50, 40), (160, 16, 15), (400, 20, 20)
# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
MORE, MARGIN = 1.1, 2e-7
# How often a run is solved before it is slowed instead.
TRIES = 5
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
CHEAP = 1 + 3e-5
AVERAGED, STRAIGHT = "averaged", "straight"
# Window of the average, as a share of what the run allows, where a gentle start finds no way between two speeds.
BRIEF = 1e-2
# How near the largest speed at an end is told, and the share of a bound below which none is looked for.
NEARLY, VANISHING = 1e-3, 1e-2


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
        """Solved again with less room wherever a limit was found exceeded: use per limit and interval.

        Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds
        wherever anything does. Only a run from rest to rest can be slowed: another is tried on.
        """
        moving, solved = max(self.problem.speeds) > 0, self.method not in (AVERAGED, STRAIGHT)
        if solved and (moving or (slowness > CHEAP and self.tries < TRIES)):
            blocks = []
            for block in self.problem.blocks:
                excess = use[block.name]
                less = block.room / (1 + MORE * self.tries * (excess - 1)) * (1 - MARGIN)
                blocks.append(replace(block, room=np.where(excess > 1 + MARGIN, less, block.room)))
            problem = replace(self.problem, blocks=tuple(blocks))
            try:
                profile, method = self._solved(problem)
                return replace(self, problem=problem, profile=profile, method=method, tries=self.tries + 1)
            except MotionError:
                if moving:
                    raise
        if moving:
            raise MotionError(
                f"no motion from {self.problem.speeds[0]:.6g} to {self.problem.speeds[1]:.6g} along the path was found "
                "that keeps every limit; ask for slower ends"
            )
        return replace(self, profile=self.profile.slowed(slowness * (1 + MARGIN)))

    def _solved(self, problem: Problem) -> tuple[Profile, str]:
        if self.order == 2:
            return second_order(problem), "passes"
        return _third(problem, self.profile.columns())


def attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, probing: bool = False) -> Attempt:
    """The first solve of a run. Raises Infeasible for end speeds that cannot be, MotionError if nothing bounds it.

    probing: just that one solve, for whoever has other runs to try if it gives no answer or none that holds.
    """
    try:
        first = _attempt(path, limits, run, order, probing)
        return first if probing else _settled(path, limits, first)
    except TooFast as no:
        end = (run.first, run.last)[no.end]
        place = path.place(float(run.breaks(path)[-no.end]), end)
        unit, scale = ("mm/s", 1e3) if place.segment is not None else ("/s", 1.0)
        remedy = f"{no.largest * scale:.6g} {unit} is the largest that the limits leave room for"
        raise Infeasible(no.name, "path", place, no.speed * scale, no.largest * scale, unit, remedy) from None


def _settled(path: ActuatorPath, limits: Sequence[Limit], tried: Attempt) -> Attempt:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only.
    """
    while tried.tries < TRIES:
        use = seen(path, limits, tried.profile)
        slowness = max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)
        if slowness <= 1 + MARGIN:
            break
        before, tried = tried, tried.tightened(use, slowness)
        if tried.problem is before.problem:  # slowed as a whole: that holds
            break
    return tried


def _attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, probing: bool) -> Attempt:
    if order == 2:
        problem = pose_problem(path, limits, *_grid(SECOND_ORDER, path, run), run.speeds)
        _need(problem, Term.SDD, "acceleration")
        profile = straight(problem)
        if profile is not None:
            return Attempt(problem, profile, STRAIGHT, order)
        return Attempt(problem, second_order(problem), "passes", order)
    coarse = pose_problem(path, limits, *_grid(START, path, run), run.speeds)
    _need(coarse, Term.SDDD, "jerk")
    profile = straight(coarse)
    if profile is not None:
        return Attempt(coarse, profile, STRAIGHT, order)
    try:
        problem, start = jerk_problem(path, limits, run)
    except TooFast as no:
        if not probing:
            _refuse_ends(path, limits, run, no)
        raise
    try:
        profile, method = _third(problem, start.on(problem.s))
    except MotionError:
        if probing:
            raise
        _refuse_ends(path, limits, run)
        profile, method = start.profile(problem), AVERAGED
    return Attempt(problem, profile, method, order)


def _refuse_ends(path: ActuatorPath, limits: Sequence[Limit], run: Run, known: TooFast | None = None) -> None:
    """Raise TooFast where the jerk leaves no room for a speed at an end; known: what leaves none even without jerk."""
    for end in (0, 1):
        asked = run.speeds[end]
        bound = known.largest if known is not None and known.end == end else asked
        largest = _largest_end(path, limits, run, end, bound) if asked > 0 else 0.0
        if 0 < largest < asked:
            raise TooFast(end, asked, largest)


def _largest_end(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int, bound: float) -> float:
    """The largest speed below the bound that is found for one end of a run, by halving; 0 where there is none."""
    low, high = 0.0, bound
    while high - low > NEARLY * high:
        middle = (low + high) / 2
        slower = replace(run, start_speed=middle) if end == 0 else replace(run, end_speed=middle)
        try:
            problem, start = jerk_problem(path, limits, slower)
            third_order(problem, start.on(problem.s))
            low = middle
        except MotionError:
            high = middle
        if high < VANISHING * bound:
            return 0.0
    return low


def jerk_problem(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> tuple[Problem, Smoothed]:
    """The order-3 problem of a run, on a grid graded for it, and the averaged order-2 motion to start from."""
    coarse = pose_problem(path, limits, *_grid(START, path, run), run.speeds)
    _need(coarse, Term.SDDD, "jerk")
    start = _smoothed(coarse)
    shares = (start.spread(_size(THIRD_ORDER, path, run)) - coarse.s[0]) / (coarse.s[-1] - coarse.s[0])
    s, piece = _grid(THIRD_ORDER, path, run, np.clip(shares, 0.0, 1.0))
    return pose_problem(path, limits, s, piece, run.speeds), start


def _grid(
    rule: tuple[int, int, int], path: ActuatorPath, run: Run, spread: Array | None = None
) -> tuple[Array, np.ndarray]:
    """A run's grid by a rule, of which every piece by itself has its share."""
    least = np.maximum(rule[1], rule[2] * path.turns[run.first : run.last + 1])
    return grid(path, run, _size(rule, path, run), spread, least=least)


def _size(rule: tuple[int, int, int], path: ActuatorPath, run: Run) -> int:
    least, per_piece, per_radian = rule
    turn = float(path.turns[run.first : run.last + 1].sum())
    return max(least, per_piece * (run.last - run.first + 1), int(per_radian * turn))


def _third(problem: Problem, guess: Array, **options: Any) -> tuple[Profile, str]:
    """By FATROP, or by IPOPT where that gives no answer; which of them is told."""
    try:
        return third_order(problem, guess, **options), "fatrop"
    except MotionError:
        return third_order(problem, guess, solver="ipopt", **options), "ipopt"


def _need(problem: Problem, term: Term, name: str) -> None:
    if not any(np.any(block.start.get(term, 0.0)) for block in problem.blocks):
        raise MotionError(
            f"nothing bounds the motion: no axis that moves states a limit of {name}; "
            "state one, or plan at another order"
        )


def _smoothed(coarse: Problem) -> Smoothed:
    """The averaged order-2 motion over a run; begun and ended at a speed, of a shorter one."""
    gentle, window = _second_order_start(coarse)
    onward = sum(coarse.speeds)
    if onward == 0:
        return Smoothed(second_order(gentle), window)
    whole = (coarse.s[-1] - coarse.s[0]) / onward
    try:
        return _averaged(gentle, min(window, whole))
    except MotionError:
        blocks = tuple(block for block in coarse.blocks if set(block.start) <= SECOND)
        return _averaged(replace(coarse, blocks=blocks), BRIEF * whole)


def _averaged(problem: Problem, window: float) -> Smoothed:
    low = problem.s[0] + problem.speeds[0] * window / 2
    high = problem.s[-1] - problem.speeds[1] * window / 2
    sliver = 1e-9 * (high - low)
    kept = np.flatnonzero((problem.s[1:] > low + sliver) & (problem.s[:-1] < high - sliver))
    chosen = slice(kept[0], kept[-1] + 1)
    s = problem.s[kept[0] : kept[-1] + 2].copy()
    s[0], s[-1] = low, high
    blocks = tuple(
        Block(
            block.name,
            {term: values[chosen] for term, values in block.start.items()},
            {term: values[chosen] for term, values in block.end.items()},
            block.room[chosen],
            block.middle,
        )
        for block in problem.blocks
    )
    return Smoothed(
        second_order(replace(problem, s=s, piece=problem.piece[chosen], blocks=blocks)), window, problem.speeds
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
        blocks.append(Block("start", {Term.SDD: size}, {Term.SDD: size}, np.ones(problem.intervals), np.zeros(1)))
    return replace(problem, blocks=tuple(blocks)), min(reached, push) / jerk


def _along(problem: Problem, term: Term) -> float:
    """How large a term may be along the path by itself, on average; ∞ where no row holds it."""
    size = np.zeros(problem.intervals)
    for block in problem.blocks:
        if term in block.start:
            np.maximum(size, np.abs(block.start[term]).max(1), out=size)
    return 1 / float(size.mean()) if size.any() else float("inf")
