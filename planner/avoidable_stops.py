"""Avoidable stops, which the program does not ask for: count, estimated cost and remedy.

Two motions are estimated, piece by piece, within the limits on speed, acceleration and jerk along
the path: one that rests where the plan rests, and one that passes these joins at the speed v that
a blend of the proposed tolerance allows. The cost is the difference of their times. At a corner a
blend that reaches d to both sides has at most

    q″ = 15/16 Δq′/d,   q‴ = 1.443 Δq′/d² + 1.1 Δq″/d,   v² |q″| ≤ A,   v³ |q‴| ≤ J,

where Δ is the jump at the join (planner.path.join_and_blend). d follows from the tolerance, and is
at most half a piece.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from math import floor, log10

import numpy as np

from kinematics.files.plain_text import finite_or_none
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.machine.machine_file import load_machine
from planner.limits import limits_of, usual_order
from planner.limits.limit import AxisLimit, Limit, Rows, Term, order_of
from planner.limits.tool import ToolLimit
from planner.path.actuation import MachinePath, Points, actuate, make_points
from planner.path.chain import walk_path
from planner.program.model import Dwell, Program, SegmentStream
from planner.program.modifiers import Stop

PROPOSED_TOLERANCE = 2e-5
"""Tolerance (m) proposed for paths that are large against it."""
LEAST_COST = 5e-4
"""Cost (s) below which no number is stated: the estimate is no better."""
MOST_OF_PATH = 1e-3
"""Largest proposed tolerance as a share of the path's length."""
# Places of a piece at which its limits are sampled: more take longer and change the estimate little.
LEG_PLACES = 5
# Pieces sampled together: more need more memory, fewer more time.
LEG_BATCH = 4096
# Blend that reaches d: its largest second and third derivative where the direction jumps, as
# multiples of 1/d and 1/d², and its third where the curvature jumps, as a multiple of 1/d.
BEND = 15 / 16
TWIST = 1.443
CURVE_TWIST = 1.1
# Its distance from the join, as multiples of d and of d².
CORNER_DEVIATION = 5 / 32
CURVE_DEVIATION = 0.0122
# Halvings of the range in which the largest speed of a piece lies: 40 leave rounding.
BISECTIONS = 40
# m/s, or /s; the largest speed of a piece without limits.
TOP_SPEED = 1e3
TINY = 1e-300


@dataclass(frozen=True, slots=True)
class AvoidableStops:
    """Stops between moving segments without a dwell, a join, a trigger or a reversal as the reason.

    count      number of stops
    joins      number of joins between moving segments; 0 if they were not counted
    cost       s, estimated; NaN if unknown
    tolerance  m, within which the motion would pass the joins
    remedy     option, word or key that lets the motion pass them
    assumed    assumption for the cost, as the machine of a program that names none; or ""
    """

    count: int
    joins: int
    cost: float
    tolerance: float
    remedy: str
    assumed: str = ""

    def describe(self) -> str:
        """Return the count, the cost and the remedy in one line; "" without such stops."""
        if not self.count:
            return ""
        of = f", of {count_noun(self.joins, 'join')}" if self.joins else ""
        cost = "" if np.isnan(self.cost) else f": they cost {self.describe_cost()}"
        return f"{self.count} that nobody asked for{of}{cost}; to avoid them: {self.remedy}"

    def describe_cost(self) -> str:
        """Return the cost, and the motion it is compared with."""
        seconds = "hardly any time"
        if self.cost >= LEAST_COST:
            seconds = f"about {float(f'{self.cost:.2g}'):g} s"
        assumed = f" {self.assumed}" if self.assumed else ""
        return f"{seconds}{assumed} against passing within {1e3 * self.tolerance:g} mm"

    def record(self) -> dict[str, object]:
        """Return a record of the stops, in SI units, with null for an unknown cost."""
        return {
            "count": self.count,
            "joins": self.joins or None,
            "cost_s": finite_or_none(self.cost),
            "cost_method": COST_METHOD,
            "assumed": self.assumed or None,
            "tolerance_m": self.tolerance,
            "remedy": self.remedy if self.count else None,
        }

    def __add__(self, other: "AvoidableStops") -> "AvoidableStops":
        """Return the stops of two parts of a path."""
        return replace(self, count=self.count + other.count, cost=self.cost + other.cost)


COST_METHOD = (
    "the time along the path with these rests, less the time without them: both estimated from the limits on speed, "
    "acceleration and jerk, and each join passed at the speed that a blend of the tolerance allows"
)
"""Method of the cost estimate."""


def propose_remedy(program: Program, tolerance: float) -> str:
    """Return the option, word or key that lets the motion pass its joins."""
    length = f"{1e3 * tolerance:g} mm"
    if program.join_word:
        return f"G64 P{1e3 * tolerance:g} (mm) in place of {program.join_word}"
    if not program.file:
        return f'--fit "{length}" or --blend "{length}"'
    key = f'join = {{ blend = "{length}" }}'
    # --fit would pass the stops that the program asks for, too
    return f"{key} there" if _states_stops(program) else f'--fit "{length}" or {key}'


def _states_stops(program: Program) -> bool:
    if isinstance(program.segments, SegmentStream):
        return False
    joins = (segment.join for segment in program.segments[:-1] if not isinstance(segment, Dwell))
    return any(isinstance(join, Stop) and join.stated for join in joins)


def propose_tolerance(length: float) -> float:
    """Return the tolerance (m) to propose: the usual one, or 1, 2 or 5 times a power of ten."""
    most = MOST_OF_PATH * length
    if most >= PROPOSED_TOLERANCE or most <= 0:
        return PROPOSED_TOLERANCE
    power: float = 10.0 ** floor(log10(most))
    return next((step * power for step in (5.0, 2.0) if step * power <= most), power)


def find_avoidable_stops(program: Program, path: MachinePath, limits: Sequence[Limit], order: int) -> AvoidableStops:
    """Count the avoidable stops of a program's path, and estimate their cost."""
    stops = path.avoidable_stops(order)
    tolerance = propose_tolerance(float(path.breaks[-1]))
    keys = [(piece.segment, piece.repetition) for piece in path.pieces]
    ends = np.flatnonzero([one != other for one, other in pairwise(keys)]) + 1
    joins = int((path.dwells[ends] == 0).sum())
    cost = float(max(cost_legs(path, limits, order, tolerance).sum(), 0.0)) if stops.any() else 0.0
    return AvoidableStops(int(stops.sum()), joins, cost, tolerance, propose_remedy(program, tolerance))


def find_stops_of_import(program: Program) -> AvoidableStops:
    """Count the stops of a program and estimate their cost, for a machine with jerk limits.

    The machine is the program's, or else ASSUMED_MACHINE. The cost is NaN if it cannot follow the
    path. In a long program only the first MOST_SEGMENTS count.
    """
    name = program.machine or ASSUMED_MACHINE
    machine = load_machine(name)
    assumed = "" if program.machine else f"on the bundled machine {name}"
    if program.repeat * len(program.segments) > MOST_SEGMENTS:
        first = tuple(islice(program.segments, MOST_SEGMENTS))
        program = replace(program, segments=first, repeat=1)
        assumed = f"in the first {MOST_SEGMENTS} segments {assumed}".rstrip()
    order = max(usual_order(machine.axes), 3)
    try:
        path = actuate(program, machine)
        stops = find_avoidable_stops(program, path, limits_of(path, machine.axes, order), order)
    except MotionError:
        count = sum(step.avoidable for step in walk_path(program, machine))
        stops = AvoidableStops(count, 0, np.nan, PROPOSED_TOLERANCE, propose_remedy(program, PROPOSED_TOLERANCE))
    return replace(stops, assumed=assumed)


ASSUMED_MACHINE = "cartesian"
MOST_SEGMENTS = 5000
"""Segments of an imported program that are examined: each takes some 0.4 ms."""


def find_stops_of_part(
    program: Program,
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
    pieces: int,
    count: int,
) -> AvoidableStops:
    """Estimate the cost of the stops in the first `pieces` of a part of a program's path.

    count: number of these stops, with any at the part's end. The part does not contain the piece
    after its end: that stop costs the mean of the others.
    """
    tolerance = PROPOSED_TOLERANCE
    cost = 0.0
    known = int(path.avoidable_stops(order)[: pieces + 1].sum())
    if known:
        costs = cost_legs(path, limits, order, tolerance)[:pieces]
        cost = max(float(costs.sum()), 0.0) * count / known
    return AvoidableStops(count, 0, cost, tolerance, propose_remedy(program, tolerance))


@dataclass(frozen=True, slots=True)
class _Legs:
    """The pieces of a path: lengths (P,), limits along them (P,), and speeds (P+1,) at the joins."""

    length: Array
    speed: Array
    acceleration: Array
    jerk: Array
    passing: Array


def cost_legs(path: MachinePath, limits: Sequence[Limit], order: int, tolerance: float) -> Array:
    """Estimate the time (P,) s that avoidable stops add to each piece of a path."""
    stops = path.avoidable_stops(order)
    legs = _measure_legs(path, limits, order, tolerance, stops)
    required = path.stops(order) & ~stops
    without = np.where(required, 0.0, legs.passing)
    without[[0, -1]] = np.minimum(path.end_speeds, legs.passing[[0, -1]])
    return _time_legs(legs, np.where(stops, 0.0, without)) - _time_legs(legs, without)


def _measure_legs(path: MachinePath, limits: Sequence[Limit], order: int, tolerance: float, stops: np.ndarray) -> _Legs:
    count = len(path.breaks) - 1
    along = np.empty((3, count))
    passing = np.full(count + 1, TOP_SPEED)
    for first in range(0, count, LEG_BATCH):
        # with the piece before, whose end meets the first
        begin = max(first - 1, 0)
        last = min(first + LEG_BATCH, count)
        piece = np.repeat(np.arange(begin, last), LEG_PLACES)
        share = np.tile(np.linspace(0.0, 1.0, LEG_PLACES), last - begin)
        s = path.breaks[piece] * (1 - share) + path.breaks[piece + 1] * share
        points = make_points(path, s, piece, order)
        rates = _limit_rates(points, limits, last - begin)
        along[:, begin:last] = 1 / np.maximum((1 / rates).mean(2), TINY)
        passing[begin + 1 : last] = np.minimum(rates[0, :-1, -1], rates[0, 1:, 0])
        corners = np.flatnonzero(stops[begin + 1 : last])
        at = begin + 1 + corners
        passing[at] = np.minimum(passing[at], _pass_corners(points, limits, tolerance, corners))
        passing[begin] = min(passing[begin], rates[0, 0, 0])
        passing[last] = rates[0, -1, -1]
    speed, acceleration, jerk = along
    return _Legs(np.diff(path.breaks), speed, acceleration, jerk, passing)


def _limit_rates(points: Points, limits: Sequence[Limit], count: int) -> Array:
    """Return the largest steady ṡ, s̈ from rest, and s⃛ (3, count, LEG_PLACES)."""
    rates = np.full((3, len(points.s)), np.inf)
    rates[0] = TOP_SPEED
    for limit in limits:
        rows = None if limit.geometric else _unconditional(limit.rows(points))
        if rows is None:
            continue
        still = rows.coefficients.get(Term.ONE, 0.0)  # a load at rest, as weight, leaves less room
        below = rows.bound if rows.below is None else rows.below
        room = np.maximum(np.minimum(rows.bound - still, below + still), 0.0)
        for term, (kind, root) in _RATES.items():
            if term in rows.coefficients:
                with np.errstate(divide="ignore", invalid="ignore"):
                    most = np.nanmin(room / np.abs(rows.coefficients[term]), axis=1, initial=np.inf)
                rates[kind] = np.minimum(rates[kind], most ** (1 / root))
    return np.asarray(np.maximum(rates, TINY).reshape(3, count, LEG_PLACES))


_RATES = {Term.SD: (0, 1), Term.SD2: (0, 2), Term.SD3: (0, 3), Term.SDD: (1, 1), Term.SDDD: (2, 1)}
"""Index of the rate that a term limits, and its power in the term."""


def _unconditional(rows: Rows) -> Rows | None:
    """Return the rows that hold at every speed; None if there are none."""
    return rows if rows.about is None else rows.hull


def _pass_corners(points: Points, limits: Sequence[Limit], tolerance: float, corners: np.ndarray) -> Array:
    """Return the ṡ (C,) at which blends of a tolerance pass the ends of the pieces `corners`."""
    after = LEG_PLACES * (corners + 1)
    before = after - 1
    path = points.path
    assert isinstance(path, MachinePath)
    size = np.concatenate([np.ones(3), np.full(9, path.machine.characteristic_length / np.sqrt(2))])
    turned, bent = (
        np.linalg.norm((values[after] - values[before]) * size, axis=1) for values in points.tool_derivatives[1:3]
    )
    half = np.diff(path.breaks)[[points.piece[before], points.piece[after]]].min(0) / 2
    reach = np.minimum(half, tolerance / np.maximum(CORNER_DEVIATION * turned, TINY))
    reach = np.minimum(reach, np.sqrt(tolerance / np.maximum(CURVE_DEVIATION * bent, TINY)))
    jumps = [np.abs(values[after] - values[before]) for values in points.derivatives[1:3]]
    speed = np.full(len(corners), TOP_SPEED)
    for limit in limits:
        if _limits_axes(limit) and _limits_acceleration(limit):
            bend = BEND * jumps[0] / reach[:, None]
            speed = np.minimum(speed, np.sqrt(_least(_find_lesser_bounds(limit), bend)))
        elif _limits_axes(limit) and Term.SDDD in limit.terms:
            twist = TWIST * jumps[0] / reach[:, None] ** 2 + CURVE_TWIST * jumps[1] / reach[:, None]
            speed = np.minimum(speed, np.cbrt(_least(_find_lesser_bounds(limit), twist)))
        elif isinstance(limit, ToolLimit) and _limits_acceleration(limit):
            cap = np.minimum(limit.caps[points.piece[before]], limit.caps[points.piece[after]])
            bend = (BEND * turned / reach)[:, None]
            speed = np.minimum(speed, np.sqrt(_least(cap[:, None], bend)))
    return speed * _share_saved(points, limits, before, after)


def _share_saved(points: Points, limits: Sequence[Limit], before: np.ndarray, after: np.ndarray) -> Array:
    """Return the share (C,) of the ramps to and from rest that passing a corner saves.

    At a speed v resting takes max |q′| v/A on each side, and passing max |Δq′| v/A. An axis that
    turns back saves no time; one that keeps its speed saves all of it.
    """
    resting = np.full(len(before), TINY)
    passing = np.zeros(len(before))
    slope = points.derivatives[1]
    for limit in limits:
        if _limits_axes(limit) and _limits_acceleration(limit):
            bound = _find_lesser_bounds(limit)
            resting += sum((np.abs(slope[side]) / bound).max(1) for side in (before, after))
            passing = (np.abs(slope[after] - slope[before]) / bound).max(1)
    share = np.clip(1 - passing / resting, 0.0, 1.0)
    # under jerk limits more of the ramps overlap: measured on plans with and without blends
    return np.asarray(np.sqrt(share) if order_of(limits) == 3 else share)


def _limits_axes(limit: Limit) -> bool:
    """Return whether a limit bounds a derivative of each axis; forces, for one, depend on more."""
    return isinstance(limit, AxisLimit) and limit.by_axis


def _find_lesser_bounds(limit: Limit) -> Array:
    """Return the lesser bound (n,) of each axis' two directions."""
    assert isinstance(limit, AxisLimit)
    return np.asarray(np.minimum(limit.bounds, limit.below))


def _limits_acceleration(limit: Limit) -> bool:
    return Term.SDD in limit.terms and Term.SDDD not in limit.terms


def _least(bound: Array, size: Array) -> Array:
    return np.asarray((bound / np.maximum(size, TINY)).min(1))


def _time_legs(legs: _Legs, passing: Array) -> Array:
    """Estimate the time (P,) s of each piece, with ramps between the speeds at its ends.

    passing (P+1,): largest speeds at the joins, which acceleration may lower.
    """
    speeds = passing.tolist()
    gains = (2 * legs.acceleration * legs.length).tolist()
    for k, gain in enumerate(gains):
        speeds[k + 1] = min(speeds[k + 1], (speeds[k] ** 2 + gain) ** 0.5)
    for k in range(len(gains) - 1, -1, -1):
        speeds[k] = min(speeds[k], (speeds[k + 1] ** 2 + gains[k]) ** 0.5)
    first = np.array(speeds[:-1])
    last = np.array(speeds[1:])
    low = np.maximum(first, last)
    high = np.maximum(legs.speed, low)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        fits = _ramp_lengths(legs, first, last, middle)[0] <= legs.length
        low = np.where(fits, middle, low)
        high = np.where(fits, high, middle)
    way, ramps = _ramp_lengths(legs, first, last, low)
    ramped = ramps + (legs.length - way) / np.maximum(low, TINY)
    # ramps that reach over several pieces: the jerk in between is left out
    spanned = 2 * legs.length / np.maximum(first + last, TINY)
    return np.asarray(np.where(way <= legs.length, ramped, spanned))


def _ramp_lengths(legs: _Legs, first: Array, last: Array, top: Array) -> tuple[Array, Array]:
    """Return length and time (P,) of the ramps from the first speed to the top and to the last."""
    way = np.zeros(len(top))
    time = np.zeros(len(top))
    with np.errstate(invalid="ignore", over="ignore"):
        # change of speed up to which the ramp does not attain the full acceleration
        jerky = legs.acceleration**2 / legs.jerk
        for end in (first, last):
            gain = top - end
            ramp = np.where(
                gain > np.nan_to_num(jerky, nan=np.inf),
                gain / legs.acceleration + legs.acceleration / legs.jerk,
                2 * np.sqrt(gain / legs.jerk),
            )
            way = way + (top + end) / 2 * ramp
            time = time + ramp
    return way, time
