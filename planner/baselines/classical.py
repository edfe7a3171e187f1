"""Baseline timings: what a classical profile would take for the same program, beside which every
saving is quoted.

Along the path it is one profile of speed per run, the quickest of its kind, scaled until certified.
What it does otherwise than a plan is said with it, so that like is compared with like.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from weakref import WeakKeyDictionary

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.kernels import Floats1, Floats2, Floats3, Ints1, kernel
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.baselines.moves import (
    Deviation,
    deviation,
    independent_ramps,
    synchronised_ramps,
    time_moves,
)
from planner.baselines.shapes import QUARTER_SINE, S_CURVE, TRAPEZOID, Shapes
from planner.certificate.certify import CROSSING, Certificate, certify
from planner.limits import OwnLimit, limits_of
from planner.limits.geometric import Travel
from planner.limits.limit import Limit, Term
from planner.limits.registry import make_own_limits
from planner.limits.resonance import Resonance
from planner.path.actuation import ActuatorPath, MachinePath, actuate, has_constant_speed
from planner.plan import Plan
from planner.program.joins import stop_at_joins
from planner.program.model import MIN_MOVE, MovingSegment, Program
from planner.timing.certified_solve import solve_goal
from planner.timing.certify_loop import RunCertifier
from planner.timing.grid import Task, make_grid
from planner.timing.order2.closed_form import straight
from planner.timing.problem import Block, Problem, Run
from planner.timing.profile import Profile
from planner.timing.rows import pose_problem
from planner.timing.solution import RunSolution
from planner.timing.tighten import required_slowness
from planner.trajectory import Trajectory


@dataclass(frozen=True, slots=True)
class Course:
    """A program on a machine as it stands before it is timed: its path in the actuators, and the
    limits along it.
    """

    program: Program
    machine: Machine
    path: MachinePath
    limits: tuple[Limit, ...] = field(repr=False)
    own_limits: tuple[OwnLimit, ...] = field(default=(), repr=False)


def course(program: Program, machine: Machine, order: int) -> Course:
    """Of a program in which nothing is left open.

    Raises MotionError for a path that cannot be drawn.
    """
    path = actuate(program, machine)
    return Course(program, machine, path, limits_of(path, machine.axes, order))


# Intervals of a run at least, and for each radian that it turns, at which the limits' rows are
# looked up.
MIN_INTERVALS, PER_RADIAN = 500, 100
# Intervals at which the rows of a line are looked up, which may be constant; and how much the
# lengths of its ramps may differ as shares of themselves: rounding.
STRAIGHT_INTERVALS, EVEN_RAMPS = 16, 1e-6
# Values of each parameter tried at first, by how many parameters there are; then directions tried
# around the best, the share of the step that is left where none of them is better, and the step at
# which the search ends.
GRID_VALUES, SEARCH_DIRECTIONS, STEP_SHRINK, MIN_SEARCH_STEP = (
    {1: 32, 2: 12},
    {1: 2, 2: 8},
    0.6,
    3e-4,
)
# By how much the directions turn after each look: a valley with a kink in it is never missed for
# long.
GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
# Instants of a piece of a profile, and more for the share of the way that it makes.
PIECE_INSTANTS, INSTANTS_PER_SHARE = 8, 400
# By how much the first motion is too fast: a quantity's use goes with a power of time, so the proof
# of a motion that breaks a limit tells exactly by how much to slow it.
SPEED_EXCESS, SLOWING_MARGIN = 1e-2, 1e-6
# Where a limit has terms of several powers of time it tells that only nearly: a finer grid, and
# less haste.
GRID_REFINEMENT, FINE_SPEED_EXCESS = 6, 1e-4
BISECTIONS_OF_SPEED = 50


@dataclass(frozen=True, slots=True)
class ClassicalFamily:
    """The goal "quickest profile of a family". It has no estimate of the least duration."""

    shapes: Shapes
    uniform: bool = True

    def solve(self, task: Task) -> RunSolution:
        path, limits, run = task.path, task.limits, task.run
        if (
            self.shapes in (TRAPEZOID, S_CURVE)
            and (exact := _find_straight(path, limits, run)) is not None
        ):
            return RunSolution("solved", exact, maker=self.shapes.name)
        intervals = max(MIN_INTERVALS, int(PER_RADIAN * path.turns[run.first : run.last + 1].sum()))
        problem = pose_problem(path, limits, *make_grid(path, run, intervals))
        rows = _Rows(problem)
        if rows.mixed:
            rows = _Rows(
                pose_problem(path, limits, *make_grid(path, run, GRID_REFINEMENT * intervals))
            )
        unit = self.shapes.draw(*_find_quickest(self.shapes, rows))
        breaks = path.breaks[run.first : run.last + 2]
        duration = (
            1 - (FINE_SPEED_EXCESS if rows.mixed else SPEED_EXCESS)
        ) * rows.required_duration(unit)
        return RunSolution(
            "solved", unit.stretch(breaks, run.first, duration), maker=self.shapes.name
        )

    def tighten(self, task: Task, solution: RunSolution, use: Mapping[str, Array]) -> RunSolution:
        """The same shape, slower: only time scales it."""
        slowness = required_slowness(task.limits, use) * (1 + SLOWING_MARGIN)
        return replace(solution, profile=solution.profile.slowed(slowness))


def _find_straight(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> Profile | None:
    """Return the quickest trapezoid or s-curve in closed form; None where the run is not straight
    in the actuators.

    Where limits differ by direction the closed form has ramps of different lengths, which no
    profile of a family has.
    """
    if path.turns[run.first : run.last + 1].any():
        return None
    solution = straight(pose_problem(path, limits, *make_grid(path, run, STRAIGHT_INTERVALS)))
    if solution is None or not solution.solved:
        return None
    lengths = solution.profile.h
    return (
        solution.profile if np.allclose(lengths, lengths[::-1], rtol=EVEN_RAMPS, atol=0.0) else None
    )


def _find_quickest(shapes: Shapes, rows: "_Rows") -> tuple[float, ...]:
    """The parameters of the profile that takes the least time: the best of a grid, then whatever is
    better around it.

    On logarithmic scales. The time is the largest of several, so it has kinks, and no slope is
    relied on.
    """
    low, high = np.log(shapes.spans).T

    def time(point: Array, least: float) -> float:
        return rows.required_duration(shapes.draw(*np.exp(point)), least)

    axes = [np.linspace(*ends, GRID_VALUES[len(low)]) for ends in zip(low, high, strict=True)]
    best, least = np.array([each[0] for each in axes]), np.inf
    for point in map(np.array, product(*axes)):
        if (duration := time(point, least)) < least:
            best, least = point, duration
    step, turned = float(axes[0][1] - axes[0][0]), 0.0
    while step > MIN_SEARCH_STEP:
        angles = (
            turned
            + 2 * np.pi * np.arange(SEARCH_DIRECTIONS[len(low)]) / SEARCH_DIRECTIONS[len(low)]
        )
        ways = (
            np.stack([np.cos(angles), np.sin(angles)], 1)
            if len(low) == 2
            else np.array([[1.0], [-1.0]])
        )
        around = [np.clip(best + step * way, low, high) for way in ways]
        times = [time(point, least) for point in around]
        if min(times) < least:
            least, best = min(times), around[int(np.argmin(times))]
        else:
            step *= STEP_SHRINK
        turned += GOLDEN_ANGLE
    return tuple(np.exp(best))


class _Rows:
    """A problem's rows, as they ask for time: each of one power of it, and the blocks whose terms
    have several.
    """

    def __init__(self, problem: Problem) -> None:
        self.s = problem.s
        powers = [{term.per_time for term in block.start} for block in problem.blocks]
        self.mixed = [
            block for block, own in zip(problem.blocks, powers, strict=True) if len(own) > 1
        ]
        single = [
            (block, own.pop())
            for block, own in zip(problem.blocks, powers, strict=True)
            if len(own) == 1
        ]
        # what acts at rest asks for no time
        timed = [(block, power) for block, power in single if power]
        rows = [len(block.middle) for block, _ in timed]
        self._coefficients = np.zeros((problem.intervals, len(TERMS), sum(rows)))
        first = 0
        for (block, _), count in zip(timed, rows, strict=True):
            for term, values in block.start.items():
                self._coefficients[:, TERMS.index(term), first : first + count] = values
            first += count
        self._middle = np.concatenate([np.zeros(0), *(block.middle for block, _ in timed)])
        self._power = np.repeat([power for _, power in timed], rows).astype(np.int64)

    def required_duration(self, unit: Profile, most: float = np.inf) -> float:
        """s that a unit profile must take over a run so that every row is kept, as nearly as the
        grid shows it.

        Of a profile that must take longer than `most`, some time above that: it is not looked at to
        its end.
        """
        ends = np.append(unit.s[1:], 1.0)
        counts = PIECE_INSTANTS + np.ceil(INSTANTS_PER_SHARE * (ends - unit.s)).astype(np.int64)
        motion = np.stack([unit.s, unit.v, unit.a, unit.j, unit.h])
        enough = most ** np.arange(1.0, 4.0)
        uses = _find_largest_uses(
            self.s, motion, counts, self._coefficients, self._middle, self._power, enough
        )
        least: float = max(use ** (1 / power) for power, use in enumerate(uses.tolist(), 1))
        if not self.mixed:
            return least
        share = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])
        k = np.repeat(np.arange(len(counts)), counts)
        s, v, a, j = unit.at(k, share * unit.h[k])
        length = self.s[-1] - self.s[0]
        interval = (
            np.searchsorted(self.s, self.s[0] + length * s, side="right").clip(1, len(self.s) - 1)
            - 1
        )
        v, a, j = length * v, length * a, length * j
        values = dict(zip(TERMS, (v, v**2, v**3, a, v * a, j), strict=True)) | {
            Term.ONE: np.ones(len(s))
        }
        return max(least, *(_block_time(block, interval, values, v) for block in self.mixed))


TERMS = (Term.SD, Term.SD2, Term.SD3, Term.SDD, Term.SDSDD, Term.SDDD)


@kernel
def _find_largest_uses(
    s: Floats1,
    motion: Floats2,
    counts: Ints1,
    coefficients: Floats3,
    middle: Floats1,
    power: Ints1,
    enough: Floats1,
) -> Array:
    """(3,) of rows of each power of time, the largest share of their bounds that a unit profile has
    over a run.

    s (N+1,) grid; motion (5, K) s, ṡ, s̈, s⃛ and duration of the profile's pieces, with counts (K,)
    of instants each; coefficients (N, 6, R) of TERMS, middle (R,) and power (R,) of the rows;
    enough (3,): shares from which on nobody needs to know more
    """
    largest = np.zeros(3)
    length, terms, k = s[-1] - s[0], np.zeros(coefficients.shape[1]), 0
    for piece in range(len(counts)):
        s0, v0, a0, j, h = motion[:, piece]
        for n in range(counts[piece]):
            t = h * n / (counts[piece] - 1)
            at = s[0] + length * (s0 + t * (v0 + t * (a0 / 2 + t * j / 6)))
            v, a = length * (v0 + t * (a0 + t * j / 2)), length * (a0 + t * j)
            while k < len(s) - 2 and s[k + 1] <= at:
                k += 1
            terms[0], terms[1], terms[2], terms[3], terms[4], terms[5] = (
                v,
                v * v,
                v * v * v,
                a,
                v * a,
                length * j,
            )
            for row in range(len(middle)):
                value = 0.0
                for term in range(len(terms)):
                    value += coefficients[k, term, row] * terms[term]
                use = value / (1 + middle[row]) if value > 0 else -value / (1 - middle[row])
                if use > largest[power[row] - 1]:
                    largest[power[row] - 1] = use
                    if use > enough[power[row] - 1]:
                        return largest
    return largest


def _block_time(
    block: Block, interval: np.ndarray, values: Mapping[Term, Array], v: Array
) -> float:
    """s of a block whose terms have several powers of time."""
    parts: dict[int, Array] = {}
    for term, coefficients in block.start.items():
        part = coefficients[interval] * values[term][:, None]
        parts[term.per_time] = parts[term.per_time] + part if term.per_time in parts else part
    # the use falls with time until only what acts at rest remains
    low, high = 1e-9, 1e9
    for _ in range(BISECTIONS_OF_SPEED):
        time = float(np.sqrt(low * high))
        total: Array = np.sum([part / time**power for power, part in parts.items()], axis=0)
        if block.speed_range is not None:  # rows that count near some motions only
            low_v, high_v = (values[interval] for values in block.speed_range[:2])
            total = np.where(
                (low_v <= v[:, None] / time) & (v[:, None] / time < high_v), total, 0.0
            )
        kept = block.share(total).max() <= 1
        low, high = (low, time) if kept else (time, high)
    return high


# Along the path: one profile of speed for each run from rest to rest.
PATH_SHAPES = {shapes.name: shapes for shapes in (TRAPEZOID, S_CURVE, QUARTER_SINE)}
# Between poses: every axis on its own from the end of one segment to the end of the next.
MOVE_RAMPS = {"synchronised": synchronised_ramps, "independent": independent_ramps}
KINDS = (*PATH_SHAPES, *MOVE_RAMPS)


@dataclass(frozen=True, slots=True)
class Classical(Result):
    """A baseline motion of a classical kind, with its own certificate.

    order      to which its proof goes: 2 where its acceleration steps, so that no jerk limit could
               hold
    deviation  how far it leaves the programmed curve; None: it follows it
    """

    kind: str
    order: int
    trajectory: Trajectory
    certificate: Certificate
    deviation: Deviation | None = None

    @property
    def duration(self) -> float:
        return self.trajectory.duration

    def tables(self) -> tuple[Table, ...]:
        """How long it takes, how far it leaves the path, and its certificate."""
        off = 0.0 if self.deviation is None else self.deviation.distance
        columns = (
            Column("timing", [self.kind]),
            Column("order", [self.order]),
            Column("duration", [self.duration], "s", form=".6f"),
            Column("off the path", [off], "m", "human", ".3f"),
        )
        return Table("baseline timing", columns), *self.certificate.tables()

    def data(self) -> Table:
        """The motion over time."""
        return self.trajectory.data()


@check_arguments()
def classical(plan: Plan | Course, kind: str = "trapezoid") -> Classical:
    """Find the baseline timing of a program, planned or not, as fast as its kind allows within the
    same limits.

    Along the path: "trapezoid", "s-curve" (seven pieces of constant jerk) and "quarter-sine", in
    arc length, each run the quickest of its kind, scaled until certified; all but the s-curve at
    order 2, since their accelerations step. Between poses: "synchronised" [Sahbaz 2007] and
    "independent" [Sasidhar 1981], trapezoids of every axis at its own limits of speed and
    acceleration, certified for these and for travel; the deviation says how far they leave the
    path. Every join is a stop, from rest to rest, also where the program begins or ends at a speed,
    and no speed is kept constant.

    Parameters
    ----------
    plan
        A plan, or the course of a program that is not timed.
    kind
        One of those above.

    Returns
    -------
    Classical
        Trajectory and certificate.

    Raises
    ------
    MotionError
        The kind is unknown, an s-curve has no jerk limits, or no proof is found.
    """
    if kind in MOVE_RAMPS:
        return _time_moves(plan, kind)
    if kind not in PATH_SHAPES:
        raise MotionError(f'baseline timing "{kind}" is not known; there are {", ".join(KINDS)}')
    shapes = PATH_SHAPES[kind]
    if shapes.order == 3 and all(axis.max_jerk is None for axis in plan.machine.axes):
        raise MotionError(
            f"baseline timing {kind}: no axis states a jerk limit; state one, or choose another kind"
        )
    path, standing = _stopping_path(plan)
    limits = _reuse_limits(
        standing, limits_of(path, _axes(plan), shapes.order, _own(plan, path, shapes.order))
    )
    certifier = RunCertifier(path, limits, shapes.order, ClassicalFamily(shapes))
    solution = solve_goal(certifier).require_proof()
    return Classical(kind, shapes.order, solution.trajectory, solution.certificate)


_STOPPING_PATHS: WeakKeyDictionary[MachinePath, tuple[MachinePath, tuple[Limit, ...]]] = (
    WeakKeyDictionary()
)


def _stopping_path(plan: Plan | Course) -> tuple[MachinePath, tuple[Limit, ...]]:
    """The path with a stop at every join and no constant speeds, and its violations that slowing
    down cannot fix.

    It is one path for all kinds, and the plan's own if that stops so, since what place alone asks
    is proved once for each path.
    """
    free = not has_constant_speed(plan.path)
    if free and plan.path.stops(2).all() and plan.path.end_speeds == (0.0, 0.0):
        return plan.path, tuple(limit for limit in plan.limits if limit.geometric)
    if plan.path not in _STOPPING_PATHS:
        program = stop_at_joins(plan.program)
        segments = tuple(
            replace(segment, speed_constant=False)
            if isinstance(segment, MovingSegment) and segment.speed_constant
            else segment
            for segment in program.segments
        )
        path = actuate(
            replace(program, segments=segments, start_speed=0.0, end_speed=0.0), plan.machine
        )
        limits = limits_of(path, plan.machine.axes, 2, _own(plan, path, 2))
        _STOPPING_PATHS[plan.path] = path, tuple(limit for limit in limits if limit.geometric)
    return _STOPPING_PATHS[plan.path]


def _reuse_limits(standing: Sequence[Limit], limits: Sequence[Limit]) -> tuple[Limit, ...]:
    """The limits; geometric ones as already evaluated."""
    known = {limit.name: limit for limit in standing}
    return tuple(known.get(limit.name, limit) for limit in limits)


def _own(plan: Plan | Course, path: MachinePath, order: int) -> list[Limit]:
    """A caller's own limits, as far as a motion of an order can keep them: of jerk only at order
    3.
    """
    return [
        limit
        for limit in make_own_limits(path, plan.own_limits)
        if order == 3 or Term.SDDD not in limit.terms
    ]


def _axes(plan: Plan | Course) -> list[Axis]:
    # baseline timings know no way round a resonance band: what a timed crossing would cost them is
    # left out
    return [
        replace(axis, resonance=None, resonance_time=None) if axis.resonance_time else axis
        for axis in plan.machine.axes
    ]


def _time_moves(plan: Plan | Course, kind: str) -> Classical:
    machine, (path, _), axes = plan.machine, _stopping_path(plan), _axes(plan)
    trajectory, begins = time_moves(path, axes, MOVE_RAMPS[kind])
    travel = Travel(machine.axes, machine.home_q)
    limits = [
        *limits_of(trajectory.path, axes, 2),
        *([travel] if (travel.bounds < float("inf")).any() else []),
    ]
    certificate = certify(trajectory, limits)
    return Classical(kind, 2, trajectory, certificate, deviation(machine, path, trajectory, begins))


def missing_limits(plan: Plan, timing: Classical) -> tuple[str, ...]:
    """What the plan is proved to keep, and the timing is not, as certificates call it: left out of
    it, or broken.
    """
    kept = _list_kept_limits(timing)
    missing = [name for name in plan.certificate.worst if name not in kept]
    return tuple(name for name in missing if name != CROSSING or Resonance.name not in missing)


def describe_differences(plan: Plan, timing: Classical) -> tuple[str, ...]:
    """What else than its shape of speed is not as in the plan, each in a few words; nothing where
    all is alike.
    """
    told = []
    if missing := missing_limits(plan, timing):
        told.append(f"without {', '.join(missing)}")
    if more := [name for name in _list_kept_limits(timing) if name not in plan.certificate.worst]:
        told.append(f"keeps {', '.join(more)} too")
    if not timing.certificate.holds:
        told.append("not certified")
    if timing.deviation is not None and timing.deviation.distance > MIN_MOVE:
        told.append(f"leaves the path by up to {1e3 * timing.deviation.distance:.3g} mm")
    if plan.path.fit is not None:
        rounded = sum(not blend.stop for blend in plan.path.blends)
        told += (
            [f"stops at {count_noun(rounded, 'corner')} that the plan rounds"] if rounded else []
        )
    elif (
        not plan.path.stops(plan.order).all()
        and len({(p.repetition, p.segment) for p in plan.path.pieces}) > 1
    ):
        told.append("stops at every join")
    if plan.path.end_speeds != (0.0, 0.0):
        told.append("from rest to rest")
    return tuple(told)


def _list_kept_limits(timing: Classical) -> list[str]:
    return [name for name, worst in timing.certificate.worst.items() if worst <= 1]


def pick_baseline(plan: Plan, timings: Sequence[Classical]) -> Classical:
    """Of the timings along the path the one that leaves out the fewest of the plan's limits; of
    several, the quickest.

    It is what a saving is told against: under the same limits wherever there is such a timing.
    """
    along = [timing for timing in timings if timing.deviation is None and timing.certificate.holds]
    return min(along, key=lambda timing: (len(missing_limits(plan, timing)), timing.duration))
