"""One run, on its way to a motion that holds: posed, solved, tightened, solved again; with rests if need be."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.place import Infeasible
from planner.timing.brief import ramped
from planner.timing.ends import TooFast, largest_there
from planner.timing.floor import floor
from planner.timing.leg import AVERAGED, HARDLY, MARGIN, STRAIGHT, TRIES, Leg, jerk_limited, slowest
from planner.timing.posing import START, brief_problem, jerk_problem, order_2_problem, order_3_coarse, refined
from planner.timing.problem import EXACTLY, Problem, Run
from planner.timing.profile import Profile
from planner.timing.second_order import TERMS as SECOND
from planner.timing.second_order import second_order
from planner.timing.seen import seen
from planner.timing.straight import straight
from planner.timing.third_order import third_order

# A leg that has to be this much slower as a whole is tried in two, with a rest between: what is slow there stays there.
WORTH = 1.01
# Shares of the largest speed at an end without a jerk limit, from which the largest with one is sought.
SHARES = (0.9, 0.5, 0.2)
# From its answer a solver finds a larger one still, as the grid is made for the motion to start from: until it changes
# by no more than this share, and so often at most.
SETTLED, AGAIN = 1e-4, 3
# Shares of the largest speed that a solver finds for an end, tried in turn until one leads to a motion that holds; then
# halvings between that and the one before it.
NEARLY, HALVINGS = (0.9995, 0.998, 0.99, 0.95, 0.8, 0.5), 3


@dataclass(frozen=True, slots=True)
class Attempt:
    """A motion along a run: one leg, or several with a rest between each two."""

    legs: tuple[Leg, ...]
    limits: tuple[Limit, ...] = field(repr=False)

    @property
    def profile(self) -> Profile:
        return Profile.joined([leg.profile for leg in self.legs])

    @property
    def method(self) -> str:
        """What gave the motion, whether it was slowed, and whether it rests where the path does not ask for it."""
        told = list(dict.fromkeys(leg.method for leg in self.legs))
        return ", ".join(told if len(self.legs) == 1 else [*told, "with rests"])

    @property
    def floor(self) -> float:
        """An estimate of the least time that the run can take (s): of a motion without the rests between legs."""
        return sum(leg.floor for leg in self.legs)

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Attempt":
        """Every leg that exceeds a limit made to exceed it less: use per limit and time piece."""
        legs, first = [], 0
        for leg in self.legs:
            last = first + len(leg.profile.h)
            own = leg.aimed({name: values[first:last] for name, values in use.items()})
            slower, first = slowest(self.limits, own), last
            legs.append(leg.tightened(own, slower) if slower > 1 + MARGIN or len(self.legs) == 1 else leg)
        return replace(self, legs=tuple(legs))

    def slowed(self, slowness: float) -> "Attempt | None":
        """The same motion, so many times as long; None for one that does not begin and end at rest."""
        if any(max(leg.problem.speeds) > 0 for leg in self.legs):
            return None
        legs = (
            replace(leg, profile=leg.profile.slowed(slowness), slowness=leg.slowness * slowness) for leg in self.legs
        )
        return replace(self, legs=tuple(legs))


def attempt(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, probing: bool = False) -> Attempt:
    """The first solve of a run. Raises Infeasible for end speeds that cannot be, MotionError if nothing bounds it.

    probing: just that one solve, for whoever has other runs to try if it gives no answer or none that holds.
    """
    try:
        legs = [_solved(path, limits, run, order)] if probing else [*_legs(path, limits, run, order)]
        return Attempt(tuple(legs), tuple(limits))
    except TooFast as no:
        end = (run.first, run.last)[no.end]
        place = path.place(float(run.breaks(path)[-no.end]), end)
        unit, scale = ("mm/s", 1e3) if place.segment is not None else ("/s", 1.0)
        remedy = f"{no.largest * scale:.6g} {unit} is the largest that the limits leave room for"
        remedy += ", from rest or to rest at the other end: both are too high" if no.both else ""
        raise Infeasible(no.name, "path", place, no.speed * scale, no.largest * scale, unit, remedy) from None


def _legs(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Iterator[Leg]:
    """The run in one leg; in two, and so on, where a solver has no answer for it or none that holds unslowed."""
    try:
        leg = _settled(path, limits, _solved(path, limits, run, order))
    except TooFast:
        if order == 3:
            straight(order_3_coarse(path, limits, run))  # what that refuses, it refuses exactly
            _refuse_ends(path, limits, run)
        raise
    except MotionError:
        if order == 2:
            raise
        _refuse_ends(path, limits, run)
        yield from _patient(path, limits, run) or _parted(path, limits, run) or [_averaged(path, limits, run)]
        return
    if order == 3 and leg.slowness > WORTH:
        others = [_parted(path, limits, run)]
        if max(run.speeds) == 0:  # what the solver started from may be faster than its answer, slowed
            others.append([_averaged(path, limits, run)])
        yield from min([[leg], *filter(None, others)], key=lambda legs: sum(part.profile.duration for part in legs))
        return
    yield leg


def _patient(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> list[Leg]:
    """Between speeds that are not refused: by whatever solver finds a motion. Empty where none does."""
    if max(run.speeds) == 0:
        return []
    try:
        return [_settled(path, limits, _solved(path, limits, run, 3, patient=True))]
    except MotionError:
        return []


def _solved(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, *, patient: bool | None = None) -> Leg:
    """The run in one leg, solved once; patient: as `jerk_limited` has it."""
    if order == 2:
        problem = order_2_problem(path, limits, run)
        profile = straight(problem) if run.solver == "passes" else None
        if profile is not None:
            return Leg(run, problem, profile, STRAIGHT, order, EXACTLY * profile.duration)
        profile = second_order(problem, solver=run.solver)
        finer = refined(path, limits, problem, profile)
        if finer is not None:
            problem, profile = finer, second_order(finer, solver=run.solver)
        least = floor(problem, profile if run.solver == "passes" else None)
        return Leg(run, problem, profile, run.solver, order, least)
    coarse = order_3_coarse(path, limits, run)
    profile = straight(coarse)
    if profile is not None:
        return Leg(run, coarse, profile, STRAIGHT, order, EXACTLY * profile.duration)
    leg = _ramped(path, limits, run, coarse)
    if leg is not None and slowest(limits, leg.aimed(seen(path, limits, leg.profile))) <= HARDLY:
        return leg
    problem, start = jerk_problem(path, limits, run, coarse)
    profile, by = jerk_limited(problem, start.on(problem.s), patient=patient)
    return Leg(run, problem, profile, by, order, floor(coarse))


def _ramped(path: ActuatorPath, limits: Sequence[Limit], run: Run, coarse: Problem) -> Leg | None:
    """The order-2 motion with ramps of s̈ that are brief beside it, where they are: no longer than it by more."""
    brief = brief_problem(path, limits, run, coarse)
    if brief is None:
        return None
    problem, window = brief
    sharp = Leg(run, problem, second_order(problem), run.solver, 2, 0.0)
    sharp = _settled(path, [limit for limit in limits if limit.terms <= SECOND], sharp)
    profile = ramped(sharp.profile, window, run.breaks(path), run.first)
    if profile is None:
        return None
    stated = replace(problem, blocks=tuple(block for block in problem.blocks if block.name != START))
    return Leg(run, problem, profile, AVERAGED, 3, floor(stated))


def _settled(path: ActuatorPath, limits: Sequence[Limit], leg: Leg) -> Leg:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only.
    """
    while leg.tries < TRIES:
        use = leg.aimed(seen(path, limits, leg.profile))
        slowness = slowest(limits, use)
        if slowness <= 1 + MARGIN:
            break
        before, leg = leg, leg.tightened(use, slowness)
        if leg.problem is before.problem:  # slowed as a whole: that holds
            break
    return leg


def _averaged(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Leg:
    """What an order-3 solve starts from: a motion whatever solvers do, though it has to be slowed."""
    coarse = order_3_coarse(path, limits, run)
    leg = _ramped(path, limits, run, coarse)
    if leg is None:
        problem, start = jerk_problem(path, limits, run, coarse)
        leg = Leg(run, problem, start.profile(problem), AVERAGED, 3, floor(coarse))
    return _settled(path, limits, leg)


def _parted(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> list[Leg]:
    """The run with a rest about its middle, at the break where it is slowest anyway. Empty where that is no way."""
    if run.first == run.last:
        return []
    try:
        problem, start = jerk_problem(path, limits, run)
        pieces = run.last - run.first + 1
        inner = run.breaks(path)[1:-1][(pieces - 1) // 4 : pieces - 1 - (pieces - 1) // 4]
        speed = start.on(problem.s)[0, np.searchsorted(problem.s, inner)]
        rest = run.first + 1 + (pieces - 1) // 4 + int(np.argmin(speed))
        parts = (
            replace(run, last=rest - 1, end_speed=0.0, until=None, stands=(run.stands[0], False)),
            replace(run, first=rest, start_speed=0.0, since=None, stands=(False, run.stands[1])),
        )
        return [leg for part in parts for leg in _legs(path, limits, part, 3)]
    except MotionError:  # no room for a rest beside a speed at an end
        return []


def _refuse_ends(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> None:
    """Raise TooFast where the jerk leaves no room for a speed at an end: beside the other's, else beside a rest."""
    for beside in (run, None):
        for end in (0, 1):
            asked = run.speeds[end]
            largest = _largest_end(path, limits, beside or _with_end(run, 1 - end, 0.0), end) if asked > 0 else 0.0
            if 0 < largest < asked:
                raise TooFast(end, asked, largest, beside is None)
        if min(run.speeds) == 0:  # beside a rest already
            return


def _largest_end(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int) -> float:
    """The largest speed up to the run's that is found for an end of it and leads to a motion; 0 if none does."""
    bound, most = largest_there(order_3_coarse(path, limits, run), end), 0.0
    for share in SHARES:
        if share * bound > most:
            most = max(most, _fastest_end(path, limits, _with_end(run, end, share * bound), end, bound))
    for _ in range(AGAIN if most > 0 else 0):
        before, again = most, _fastest_end(path, limits, _with_end(run, end, NEARLY[1] * most), end, bound)
        most = again or before
        if abs(most / before - 1) < SETTLED:
            break
    high = 1.0
    for low in NEARLY if most > 0 else ():
        if _holds(path, limits, _with_end(run, end, low * most)):
            break
        high = low
    else:
        return 0.0
    for _ in range(HALVINGS if high < 1 else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if _holds(path, limits, _with_end(run, end, middle * most)) else (low, middle)
    return low * most


def _holds(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> bool:
    """Whether a motion is found along a run, between its speeds, that is seen to keep every limit."""
    try:
        leg = _settled(path, limits, _solved(path, limits, run, 3))
    except MotionError:
        return False
    return slowest(limits, leg.aimed(seen(path, limits, leg.profile))) <= 1 + MARGIN


def _with_end(run: Run, end: int, speed: float) -> Run:
    return replace(run, start_speed=speed) if end == 0 else replace(run, end_speed=speed)


def _fastest_end(path: ActuatorPath, limits: Sequence[Limit], run: Run, end: int, bound: float) -> float:
    """The largest speed at an end, up to the bound, that a solver finds from a motion with the run's; 0 if none."""
    try:
        problem, start = jerk_problem(path, limits, run)
        guess = start.on(problem.s)
        if not problem.settled:
            v, a, j, h = guess
            speed = v + h / 2 * (a + h * j / 4)
            problem = problem.around(speed, speed)
        speeds = (bound, run.end_speed) if end == 0 else (run.start_speed, bound)
        profile = third_order(replace(problem, speeds=speeds), guess, fast_end=end)
    except MotionError:
        return 0.0
    v, a, j, h = (values[-end] for values in (profile.v, profile.a, profile.j, profile.h))
    return float(v if end == 0 else v + h * (a + h * j / 2))
