"""A few runs between stops, solved, certified and tightened by themselves: what any process can do with a part.

A motion that exceeds a limit is solved again with less room there, or slowed as a whole.

Of equal runs one is timed and proved, and the others have its motion. Runs are equal if the numbers of their pieces and
of their limits are equal, bit for bit. A copy is then the same function of time, but for the path length at which it
begins. Path lengths are rounded: measured from the start of its piece, a place of the copy is within `PLACE_ROUNDING`
times the length of the path of the place that it copies. The proof encloses every motion whose places are that near
(`planner.certificate.enclosure.expand_motion`), so that it holds for the copy. That copies join without a jump or a gap
is proved of the whole motion, as always.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from planner.certificate.geometric_use import use_at_knots
from planner.certificate.limit_use import ProvedUse, prove
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit
from planner.limits.lowered import ALL
from planner.limits.registry import PLACELESS
from planner.limits.resonance import BAND_MARGIN, Resonance, SpeedCap
from planner.limits.tool import ToolLimit
from planner.path.actuation import ActuatorPath, MachinePath
from planner.timing.discretization import cut_intervals
from planner.timing.problem import Block, Run, leave_out_idle
from planner.timing.profile import (
    AVERAGED,
    BRIEF_RAMPS,
    CRUISE,
    FEED_LIMITED,
    MIN_WATCHED_USE,
    STRAIGHT,
    WITH_RESTS,
    Profile,
    RunSolution,
    sample_limit_use,
)
from planner.timing.solvers.second_order import second_order
from planner.timing.solvers.third_order import solve_jerk_limited

# Room taken off: this share of the excess, more with every try, and a little for the solver's own tolerance.
EXCESS_FACTOR, SOLVER_MARGIN = 1.1, 2e-7
# How often a leg is solved before it is slowed instead.
MAX_TRIES = 6
# Excess over a limit between grid points from which an interval is cut in so many where it is solved again. What is
# left after two tries with less room lies between grid points, where room does not reach: cut from far less on.
MIN_CUT_EXCESS, MIN_LATE_CUT_EXCESS, CUT_PARTS = 1.03, 1.0003, 4
# Excess from which what is solved again is not among the nearest.
MIN_NEAR_EXCESS = 1 + 1e-3
# What a look at instants may miss of a peak of a jerk-limited motion: slowed for one that is seen, it is slowed by so
# much more.
UNSEEN_EXCESS = 1 + 2e-6
# A motion that only so much slowness keeps from holding is slowed: solving again would cost more than it gains.
MAX_CHEAP_SLOWNESS = 1 + 3e-5


def required_slowness(limits: Sequence[Limit], use: Mapping[str, Array]) -> float:
    """How many times slower a motion that uses so much of the limits must be, to keep them all."""
    return max(limit.slowness(float(use[limit.name].max())) for limit in limits if limit.name in use)


def tighten_run(
    path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
) -> RunSolution:
    """A motion that exceeds the limits less, each of its legs by itself. use (M,): of each time piece, per limit."""
    parts, first = [], 0
    joined = solution.maker if solution.maker == FEED_LIMITED else WITH_RESTS
    for part in solution.parts or (solution,):
        last = first + len(part.profile.h)
        proved = {name: values[first:last] for name, values in use.items()}
        aimed_use = part.aimed(proved)
        slowness, first = required_slowness(limits, aimed_use), last
        exceeds = slowness > 1 + SOLVER_MARGIN or not solution.parts
        if exceeds and part.maker == CRUISE:
            return RunSolution.refused(MotionError("the capped tool speed exceeds another limit"))
        if exceeds and part.parts:
            part = tighten_run(path, limits, part, proved)
        elif exceeds:
            part = tighten_leg(path, limits, part, aimed_use, slowness)
        parts.append(part)
    return RunSolution.joined(parts, joined)


def tighten_until_kept(path: ActuatorPath, limits: Sequence[Limit], leg: RunSolution) -> RunSolution:
    """Solved again, or slowed where that costs next to nothing, until no limit is seen to be exceeded.

    A proof takes far longer than a look: most runs need one only. Loads that a problem has no rows of are far from
    their limits: they are left to the proof.
    """
    watched = limits if leg.problem is None else leave_out_idle(limits, leg.problem)
    looked = None
    while leg.solved and leg.tries < MAX_TRIES:
        looked = leg.profile, leg.seen or sample_limit_use(path, watched, leg.profile, looked)
        use = leg.aimed(looked[1])
        slowness = required_slowness(watched, use)
        watched = [limit for limit in watched if limit.name in use and use[limit.name].max() > MIN_WATCHED_USE]
        if slowness <= 1 + SOLVER_MARGIN:
            break
        unseen = 1.0 if leg.maker in ("passes", "toppra") else UNSEEN_EXCESS
        before, leg = leg, tighten_leg(path, limits, leg, use, slowness * unseen)
        if leg.problem is before.problem:  # slowed as a whole: that holds
            break
    return leg


def tighten_leg(
    path: ActuatorPath, limits: Sequence[Limit], leg: RunSolution, use: Mapping[str, Array], slowness: float
) -> RunSolution:
    """Solved again with less room wherever a limit was found exceeded: use per limit and interval, as `aimed`.

    What exceeds them by much, though it had less room already, does so between grid points: these intervals are cut.
    Where that does not help, or would cost more than it gains, the same motion slowed as a whole: what holds wherever
    anything does. Only a leg from rest to rest can be slowed: another is tried on.
    """
    solved = leg.maker not in (AVERAGED, BRIEF_RAMPS, STRAIGHT) and leg.slowness == 1
    problem = leg.problem
    worth = leg.has_end_speed or (slowness > MAX_CHEAP_SLOWNESS and leg.tries < MAX_TRIES)
    if problem is not None and solved and worth:
        blocks = tuple(
            tighten_block(block, use[block.name], leg.tries) if block.name in use else block  # START_GRID is none
            for block in problem.blocks
        )
        tighter = replace(problem, blocks=blocks)
        if leg.maker in ("passes", "toppra"):
            found = second_order(tighter, solver="passes" if leg.maker == "passes" else "toppra")
        else:
            guess = leg.profile.columns()
            excess = np.max([use[block.name] for block in problem.blocks if block.name in use], axis=0)
            least = MIN_LATE_CUT_EXCESS if leg.tries > 2 else MIN_CUT_EXCESS
            if leg.tries > 1 and excess.max() > least:
                tighter = cut_intervals(path, limits, tighter, np.where(excess > least, CUT_PARTS, 1))
                guess = leg.profile.on(tighter.s)
            found = solve_jerk_limited(tighter, guess, "near" if excess.max() > MIN_NEAR_EXCESS else "nearer")
        if found.solved:
            return replace(found, bound=leg.bound, tries=leg.tries + 1)
        if leg.has_end_speed:
            return found
    if leg.has_end_speed:
        start, end = float(leg.profile.v[0]), max(leg.profile.last_speed, 0.0)
        return RunSolution.refused(
            MotionError(
                f"no motion from {start:.6g} to {end:.6g} along the path was found "
                "that respects every limit; use slower end speeds"
            )
        )
    return leg.slowed(slowness)


def tighten_block(block: Block, excess: Array, tries: int) -> Block:
    """With less room where there was an excess (N,): of the part of it that holding still does not use."""
    less = block.aimed((1 - SOLVER_MARGIN) / (1 + EXCESS_FACTOR * tries * (excess - 1) / (1 - block.holding_use)))
    return replace(block, room=np.where(excess > 1 + SOLVER_MARGIN, less.room, block.room))


# How often a run is solved until its proof holds, before it is slowed as a whole; and how often it is slowed.
MAX_CERTIFY_ROUNDS, MAX_SLOWINGS = 8, 3
# How often axes are held below resonance bands: so often where they stay in them too long, then over their whole run,
# at last all of them; each time more of the same by so much farther below, as a grid lets a motion peak beside it.
MAX_HOLDINGS, STRETCH_ROUNDS, ALL_HOLDINGS, MARGIN_GROWTH = 8, 2, 6, 4.0
# What is slowed is slowed a little more: rounding.
SLOWING_MARGIN = 1e-6


@dataclass(frozen=True, slots=True)
class Timing:
    """How runs are timed: `solve` finds a motion, and `tighten` one that exceeds the limits less.

    use, the last of what tighten is given: what is proved of each time piece (M,), per limit. In the end only a fastest
    motion is slowed as a whole, which no other may be. uniform: equal runs have equal motions.
    """

    solve: Callable[[ActuatorPath, Sequence[Limit], Run], RunSolution]
    tighten: Callable[[ActuatorPath, Sequence[Limit], RunSolution, Mapping[str, Array]], RunSolution]
    uniform: bool = False


@dataclass(frozen=True, slots=True)
class CertifiedRun:
    """A run's motion and what it uses of each limit for certain.

    held: where its axes are held below resonance bands
    room: by limit what was left of it on each time piece (M,); None of a motion that was not just solved for
    tightened, holdings, slowed: how often it was tightened, solved with axes held back, and slowed as a whole
    """

    run: Run
    solution: RunSolution
    known: ProvedUse
    held: tuple[SpeedCap, ...] = ()
    tightened: int = 0
    holdings: int = 0
    slowed: int = 0
    room: Mapping[str, Array] | None = None

    @property
    def rounds(self) -> int:
        """How often it was timed."""
        return 1 + self.tightened + self.holdings + self.slowed


@dataclass(frozen=True, slots=True)
class RunCertifier:
    """Runs -> their motions, each proved to keep every limit on time.

    What does not in MAX_CERTIFY_ROUNDS is slowed until it does.
    Given up is only what cannot be slowed: between stated speeds, or in a stated duration. A refusal of the first run
    that has one is returned, not raised.
    """

    path: ActuatorPath
    limits: tuple[Limit, ...]
    order: int
    timing: Timing

    def __call__(self, runs: Sequence[Run]) -> list[CertifiedRun] | MotionError:
        found: list[CertifiedRun] = []
        for run in runs:
            solution = self.timing.solve(self.path, self.limits, run)
            if solution.refusal is not None:
                return solution.refusal
            found.append(CertifiedRun(run, solution, NOTHING_KNOWN))
        pending = list(range(len(runs)))
        while pending:
            for n, known in zip(pending, self._certify([found[n].solution for n in pending]), strict=True):
                found[n] = replace(found[n], known=known)
            changed = []
            for n in pending:
                better = self._tighten(found[n])
                if isinstance(better, MotionError):
                    return better
                if better is not None:
                    found[n] = better
                    changed.append(n)
            pending = changed
        return [replace(one, solution=one.solution.bare(), room=_find_room(one.solution)) for one in found]

    def _certify(self, solutions: Sequence[RunSolution]) -> list[ProvedUse]:
        """All in one go: what each uses of the limits."""
        profiles = [one.profile for one in solutions]
        motion = Profile.joined(profiles).along(self.path)
        use, attained = prove(motion, self._timed_limits, self.order)
        attained |= use_at_knots(motion, [limit for limit in self.limits if limit.geometric])
        ends = np.cumsum([len(profile.h) for profile in profiles])[:-1]
        parts = [{name: np.split(values, ends) for name, values in each.items()} for each in (use, attained)]
        used, met = (
            [{name: values[n] for name, values in part.items()} for n in range(len(profiles))] for part in parts
        )
        return [ProvedUse(*each) for each in zip(used, met, (one.numbers() for one in profiles), strict=True)]

    def _tighten(self, one: CertifiedRun) -> CertifiedRun | MotionError | None:
        """Timed anew where it does not hold; None where it does, or where nothing is left to try."""
        staying = self._find_stays(one.solution.profile)
        if staying:
            return self._hold_back(one, self._choose_caps(staying, one))
        # a use without a bound is nothing that another motion mends
        if not 1 < max(float(one.known.use[limit.name].max()) for limit in self._timed_limits) < np.inf:
            return None
        if one.tightened + 1 < MAX_CERTIFY_ROUNDS:
            solution = self.timing.tighten(self.path, self.limits, one.solution, one.known.use)
            if solution.refusal is not None and one.solution.maker == FEED_LIMITED:
                solution = self._solve_whole(one.run)
            return solution.refusal or replace(one, solution=solution, tightened=one.tightened + 1)
        if one.solution.maker == FEED_LIMITED:
            return replace(one, solution=self._solve_whole(one.run), tightened=0)
        return self._slow(one, required_slowness(self._timed_limits, one.known.use) * (1 + SLOWING_MARGIN))

    def _solve_whole(self, run: Run) -> RunSolution:
        """Solve a run as one problem, where its cruises or their ramps cannot be proved."""
        return self.timing.solve(self.path, self.limits, replace(run, whole=True))

    def _hold_back(self, one: CertifiedRun, more: Sequence[SpeedCap]) -> CertifiedRun | MotionError | None:
        """A run solved with axes held in more places; where that is of no use, slowed below all bands."""
        if one.holdings < MAX_HOLDINGS:
            held = (*one.held, *more)
            solution = self.timing.solve(self.path, hold_axes(self.limits, held), one.run)
            if solution.refusal is None:
                return replace(one, solution=solution, held=held, holdings=one.holdings + 1)
            if one.holdings + 1 < ALL_HOLDINGS:  # all that is held may leave a solver more room than a part of it
                one = replace(one, holdings=ALL_HOLDINGS)
                return self._hold_back(one, self._choose_caps((), one))
            if not one.solution.fastest:
                return solution.refusal
        bands = [limit for limit in self.limits if isinstance(limit, Resonance)]
        use = sample_limit_use(self.path, [limit.kept_below() for limit in bands], one.solution.profile)
        return self._slow(one, required_slowness(bands, use) * (1 + BAND_MARGIN))

    def _slow(self, one: CertifiedRun, slowness: float) -> CertifiedRun | None:
        """The same motion, slower as a whole, if that has not been tried too often."""
        if one.slowed >= MAX_SLOWINGS or not one.solution.fastest or one.solution.has_end_speed:
            return None
        return replace(one, solution=one.solution.slowed(slowness), slowed=one.slowed + 1)

    def _find_stays(self, profile: Profile) -> list[SpeedCap]:
        """Where an axis stays in a resonance band too long."""
        motion, found = profile.along(self.path), []
        for limit in self.limits:
            for stay in find_stays(motion, limit) if isinstance(limit, Resonance) else ():
                if stay.use > 1:
                    first, last = motion.at(np.array([stay.start, stay.end])).along.tolist()
                    found.append(SpeedCap(stay.band, first, last))
        return found

    def _choose_caps(self, staying: Sequence[SpeedCap], one: CertifiedRun) -> list[SpeedCap]:
        """Where to hold axes: where they stay, or over the whole run; at last all of them."""
        if one.holdings < STRETCH_ROUNDS:
            return list(staying)
        first, last = one.run.breaks(self.path)[[0, -1]].tolist()
        bands = dict.fromkeys(each.band for each in staying)
        if one.holdings >= ALL_HOLDINGS:
            bands = dict.fromkeys(band for limit in self.limits if isinstance(limit, Resonance) for band in limit.bands)
        found = []
        for band in bands:
            before = sum(each.band == band and (each.first, each.last) == (first, last) for each in one.held)
            found.append(SpeedCap(band, first, last, BAND_MARGIN * MARGIN_GROWTH**before))
        return found

    @property
    def _timed_limits(self) -> list[Limit]:
        """The limits that depend on timing; the others have one value for every timing."""
        return [limit for limit in self.limits if not limit.geometric]


def _find_room(solution: RunSolution) -> Mapping[str, Array] | None:
    """By limit the room that a motion had on each of its time pieces, where these are a problem's intervals."""
    problem = solution.problem
    if problem is None or solution.parts or solution.slowness != 1 or len(problem.piece) != len(solution.profile.h):
        return None
    return {block.name: block.room for block in problem.blocks}


NOTHING_KNOWN = ProvedUse({}, {}, np.zeros((6, 0)))


def hold_axes(limits: Sequence[Limit], held: Sequence[SpeedCap]) -> tuple[Limit, ...]:
    """The limits, with axes held below resonance bands in more places."""
    return tuple(limit.hold_more(held) if held and isinstance(limit, Resonance) else limit for limit in limits)


# Different runs that are remembered at a time: a path without repetition must not fill the memory with its numbers.
MOST_REMEMBERED = 1024


def find_first_equals(path: ActuatorPath, limits: Sequence[Limit], runs: Sequence[Run]) -> list[int]:
    """Return for each run the index of an earlier run that equals it, or else its own index."""
    firsts = list(range(len(runs)))
    if not isinstance(path, MachinePath):
        return firsts
    # most runs differ from all others in the numbers of their first piece
    begins = [path.pieces[run.first].parameters.tobytes() for run in runs]
    if len(set(begins)) == len(runs) or not all(map(ignores_place, limits)):
        return firsts
    caps = [limit.caps for limit in limits if isinstance(limit, ToolLimit)]
    remembered: dict[Hashable, int] = {}
    for n, run in enumerate(runs):
        # a run that continues a motion has that motion's numbers as well
        if run.continuation is not None:
            continue
        key = _describe_run(path, caps, run)
        firsts[n] = remembered.pop(key, n)
        remembered[key] = firsts[n]  # now the last that is forgotten
        if len(remembered) > MOST_REMEMBERED:
            del remembered[next(iter(remembered))]
    return firsts


def ignores_place(limit: Limit) -> bool:
    """Return whether a limit is the same for equal pieces of path, wherever they are on the path.

    A limit of a caller's own may look at the number of the piece. Shares are lowered at stated path lengths, and so
    are the speeds of axes that are held below a band of resonance.
    """
    if type(limit) not in PLACELESS:
        return False
    if isinstance(limit, Resonance) and (limit.bands or limit.held):
        return False
    return limit.shares is ALL


def _describe_run(path: MachinePath, caps: Sequence[Array], run: Run) -> Hashable:
    """Return all that decides the motion of a run, except where on the path it is."""
    pieces = slice(run.first, run.last + 1)
    return (
        replace(run, first=0, last=run.last - run.first),
        path.describe_pieces(run.first, run.last),
        tuple(cap[pieces].tobytes() for cap in caps),
    )


def move_run(path: ActuatorPath, one: CertifiedRun, run: Run) -> CertifiedRun:
    """Return the motion and the proof of a run for another run that equals it."""
    profile, onward = one.solution.profile, run.first - one.run.first
    piece = profile.piece + onward
    # the break itself stays exact: motions rest there
    s = path.breaks[piece] + (profile.s - path.breaks[profile.piece])
    moved = replace(profile, s=s, piece=piece)
    known = ProvedUse(one.known.use, one.known.attained, moved.numbers())
    return replace(one, run=run, solution=replace(one.solution, profile=moved), known=known)
