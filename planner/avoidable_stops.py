"""Avoidable stops, which the program does not ask for: count, estimated cost and remedy.

Two motions are estimated, piece by piece: one that rests where the plan rests, and one that passes
these joins at the speed v that a blend of the proposed tolerance allows. The cost is the difference
of their times.

A piece of length l has the largest speed V, acceleration A and jerk J along the path, each the
harmonic mean of that at some of its places. A ramp from v₀ to v₁ takes

    t = Δv/A + A/J, or 2 √(Δv/J) if Δv ≤ A²/J,   and the length t (v₀ + v₁)/2,   with Δv = v₁ − v₀.

The piece ramps from the speed at its first join to its top speed and to the speed at its last join.
The top speed is the largest, up to V, for which both ramps fit into l. The speeds at the joins are
at most those of the joins, and within v₁² ≤ v₀² + 2 A l in both directions.

At a corner a blend that reaches d to both sides has at most

    q″ = 15/16 Δq′/d,   q‴ = 1.443 Δq′/d² + 1.1 Δq″/d,   v² |q″| ≤ A,   v³ |q‴| ≤ J,

where Δ is the jump at the join (planner.path.join_and_blend). d follows from the tolerance, and is
at most half a piece. Resting after a speed v takes max |q′| v/A on each side of the join, and
passing takes max |Δq′| v/A. An axis that turns back saves no time, and one that keeps its speed
saves all of it: so v is multiplied by the share of time saved.
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
from planner.limits.limit import AxisLimit, Limit, Term, order_of
from planner.limits.tool import ToolLimit
from planner.path.actuation import MachinePath, actuate, make_points
from planner.path.chain import walk_path
from planner.program.model import Dwell, Program, SegmentStream
from planner.program.modifiers import Stop

PROPOSED_TOLERANCE = 2e-5
"""Tolerance (m) proposed for paths that are large against it."""
LEAST_COST = 5e-4
"""Cost (s) below which no number is stated: the estimate is no better."""
MOST_OF_PATH = 1e-3
"""Largest proposed tolerance as a share of the path's length."""
# Places of a piece at which its limits are sampled: more take longer and change the estimate
# little.
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
        """Return the count, the saving and the remedy in one line; "" without such stops."""
        if not self.count:
            return ""
        of = f", of {count_noun(self.joins, 'join')}" if self.joins else ""
        return f"{self.count} avoidable{of}: {self.describe_saving()}; to pass them: {self.remedy}"

    def describe_saving(self) -> str:
        """Return the time that passing the stops saves, and the tolerance for that."""
        passing = f"passing them within {1e3 * self.tolerance:g} mm saves"
        assumed = f" {self.assumed}" if self.assumed else ""
        if np.isnan(self.cost):
            return f"{passing} an unknown time"
        if self.cost < LEAST_COST:
            return f"{passing} little time{assumed}"
        return f"{passing} at least about {float(f'{self.cost:.2g}'):g} s{assumed}"

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
    key = f'join = {{ blend = "{length}" }} under each [[segment]] that ends there'
    # --fit would pass the stops that the program asks for, too
    return key if _states_stops(program) else f'--fit "{length}" or {key}'


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


def find_avoidable_stops(
    program: Program,
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
) -> AvoidableStops:
    """Count the avoidable stops of a program's path, and estimate their cost."""
    count = int(path.avoidable_stops(order).sum())
    tolerance = propose_tolerance(float(path.breaks[-1]))
    cost = max(float(cost_legs(path, limits, order, tolerance).sum()), 0.0) if count else 0.0
    keys = [(piece.segment, piece.repetition) for piece in path.pieces]
    ends = np.flatnonzero([one != other for one, other in pairwise(keys)]) + 1
    joins = int((path.dwells[ends] == 0).sum())
    return AvoidableStops(count, joins, cost, tolerance, propose_remedy(program, tolerance))


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
        stops = state_stops(program, count)
    return replace(stops, assumed=assumed)


ASSUMED_MACHINE = "cartesian"
MOST_SEGMENTS = 5000
"""Segments of an imported program that are examined: each takes some 0.4 ms."""


def state_stops(program: Program, count: int) -> AvoidableStops:
    """Return the stops of a program, with the usual tolerance and an unknown cost."""
    remedy = propose_remedy(program, PROPOSED_TOLERANCE)
    return AvoidableStops(count, 0, np.nan, PROPOSED_TOLERANCE, remedy)


def cost_first_stops(
    stops: AvoidableStops,
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
    pieces: int,
) -> AvoidableStops:
    """Return the stops in the first `pieces` of a path, with their estimated cost.

    The path may end where a stop follows. As the piece after that stop is unknown, it costs the
    mean of the others.
    """
    cost = 0.0
    known = int(path.avoidable_stops(order)[: pieces + 1].sum())
    if known:
        costs = cost_legs(path, limits, order, stops.tolerance)[:pieces]
        cost = max(float(costs.sum()), 0.0) * stops.count / known
    return replace(stops, cost=cost)


@dataclass(frozen=True, slots=True)
class _Legs:
    """The pieces of a path: lengths (P,), limits along them (P,), and speeds (P+1,) at the
    joins.
    """

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


def _measure_legs(
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
    tolerance: float,
    stops: np.ndarray,
) -> _Legs:
    count = len(path.breaks) - 1
    batches = [_limit_rates(path, limits, order, pieces) for pieces in _batches(np.arange(count))]
    rates = np.concatenate(batches, axis=1)
    speed, acceleration, jerk = 1 / np.maximum((1 / rates).mean(2), TINY)
    before = np.append(rates[0, :1, 0], rates[0, :, -1])
    after = np.append(rates[0, :, 0], rates[0, -1:, -1])
    passing = np.minimum(before, after)
    for corners in _batches(np.flatnonzero(stops)):
        speeds = _pass_corners(path, limits, order, tolerance, corners)
        passing[corners] = np.minimum(passing[corners], speeds)
    return _Legs(np.diff(path.breaks), speed, acceleration, jerk, passing)


def _batches(indices: np.ndarray) -> list[np.ndarray]:
    return [indices[k : k + LEG_BATCH] for k in range(0, len(indices), LEG_BATCH)]


def _limit_rates(
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
    pieces: np.ndarray,
) -> Array:
    """Return the largest steady ṡ, s̈ from rest, and s⃛ (3, pieces, LEG_PLACES)."""
    piece = np.repeat(pieces, LEG_PLACES)
    share = np.tile(np.linspace(0.0, 1.0, LEG_PLACES), len(pieces))
    s = path.breaks[piece] * (1 - share) + path.breaks[piece + 1] * share
    points = make_points(path, s, piece, order)
    rates = np.full((3, len(s)), np.inf)
    rates[0] = TOP_SPEED
    for limit in limits:
        rows = None if limit.geometric else limit.rows(points)
        if rows is not None and rows.speed_range is not None:
            rows = rows.convex_part  # holds at every speed
        if rows is None:
            continue
        still = rows.coefficients.get(Term.ONE, 0.0)  # a load at rest, as weight, leaves less room
        below = rows.bound if rows.below is None else rows.below
        room = np.maximum(np.minimum(rows.bound - still, below + still), 0.0)
        for term, (kind, root) in _RATES.items():
            if term in rows.coefficients:
                with np.errstate(divide="ignore", invalid="ignore"):
                    ratio = room / np.abs(rows.coefficients[term])
                most = np.nanmin(ratio, axis=1, initial=np.inf)
                rates[kind] = np.minimum(rates[kind], most ** (1 / root))
    return np.asarray(np.maximum(rates, TINY).reshape(3, len(pieces), LEG_PLACES))


_RATES = {Term.SD: (0, 1), Term.SD2: (0, 2), Term.SD3: (0, 3), Term.SDD: (1, 1), Term.SDDD: (2, 1)}
"""Index of the rate that a term limits, and its power in the term."""


def _pass_corners(
    path: MachinePath,
    limits: Sequence[Limit],
    order: int,
    tolerance: float,
    corners: np.ndarray,
) -> Array:
    """Return the ṡ (C,) at which blends of a tolerance pass the breaks `corners`."""
    sides = np.concatenate([corners - 1, corners])  # pieces before, and pieces after
    points = make_points(path, np.tile(path.breaks[corners], 2), sides, order)
    # a rotation by a small angle changes its matrix by √2 times the angle
    size = np.ones(12)
    size[3:] = path.machine.characteristic_length / np.sqrt(2)
    jumps = [_jump(values) * size for values in points.tool_derivatives[1:3]]
    turned, bent = np.linalg.norm(jumps, axis=2)
    half = np.minimum(*np.split(np.diff(path.breaks)[sides], 2)) / 2
    reach = np.minimum(half, tolerance / np.maximum(CORNER_DEVIATION * turned, TINY))
    reach = np.minimum(reach, np.sqrt(tolerance / np.maximum(CURVE_DEVIATION * bent, TINY)))

    first_jump, second_jump = (np.abs(_jump(values)) for values in points.derivatives[1:3])
    span = reach[:, None]
    speed = np.full(len(corners), TOP_SPEED)
    resting = np.full(len(corners), TINY)
    passing = np.zeros(len(corners))
    for limit in limits:
        if isinstance(limit, AxisLimit) and limit.by_axis:
            bound = np.minimum(limit.bounds, limit.below)
            if Term.SDDD in limit.terms:
                twist = TWIST * first_jump / span**2 + CURVE_TWIST * second_jump / span
                speed = np.minimum(speed, np.cbrt(_least(bound, twist)))
            elif Term.SDD in limit.terms:
                bend = BEND * first_jump / span
                speed = np.minimum(speed, np.sqrt(_least(bound, bend)))
                resting += sum(np.split((np.abs(points.derivatives[1]) / bound).max(1), 2))
                passing = (first_jump / bound).max(1)
        elif isinstance(limit, ToolLimit) and Term.SDD in limit.terms:
            cap = np.minimum(*np.split(limit.caps[sides], 2))
            bend = BEND * turned / reach
            speed = np.minimum(speed, np.sqrt(_least(cap[:, None], bend[:, None])))
    saved = np.clip(1 - passing / resting, 0.0, 1.0)
    # under jerk limits more of the ramps overlap: measured on plans with and without blends
    return np.asarray(speed * (np.sqrt(saved) if order_of(limits) == 3 else saved))


def _jump(values: Array) -> Array:
    """Return the values (C, n) after corners, less those before them; values (2 C, n)."""
    before, after = np.split(values, 2)
    return np.asarray(after - before)


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
    ends = np.array([speeds[:-1], speeds[1:]])
    low = ends.max(0)
    high = np.maximum(legs.speed, low)
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        fits = _measure_ramps(legs, ends, middle)[0] <= legs.length
        low = np.where(fits, middle, low)
        high = np.where(fits, high, middle)
    way, ramps = _measure_ramps(legs, ends, low)
    ramped = ramps + (legs.length - way) / np.maximum(low, TINY)
    # ramps that reach over several pieces: the jerk in between is left out
    spanned = 2 * legs.length / np.maximum(ends.sum(0), TINY)
    return np.asarray(np.where(way <= legs.length, ramped, spanned))


def _measure_ramps(legs: _Legs, ends: Array, top: Array) -> tuple[Array, Array]:
    """Return length and time (P,) of the ramps between the speeds (2, P) at the ends and the
    top.
    """
    gain = top - ends
    with np.errstate(over="ignore"):
        full = gain > legs.acceleration**2 / legs.jerk  # the ramp attains the full acceleration
    trapezoid = gain / legs.acceleration + legs.acceleration / legs.jerk
    time = np.where(full, trapezoid, 2 * np.sqrt(gain / legs.jerk))
    return ((top + ends) / 2 * time).sum(0), time.sum(0)
