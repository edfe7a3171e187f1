"""Limits that slowing down cannot fix: reach, control, travel, tilt, clearance, holding; proved before solving.

Control is lost in singular poses, which are excluded cell by cell along the path by guaranteed bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.analysis.virtual_work import invert
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.foundation.taylor_model import Series
from kinematics.machine.motion import describe_singularity
from planner.avoidable_stops import AvoidableStops
from planner.certificate.geometric_use import prove_path_use
from planner.certificate.conditioning import Conditioning, evaluate_jacobian
from planner.certificate.limit_use import round_reached_use
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, MachinePath
from planner.path.outcome import Blended, FitSummary, blend_tables, fit_tables
from planner.path.overshoot import overshoot_tables, overshoot_warnings
from planner.path.point_to_point import Departure, departure_tables
from planner.path.shape import Overshoot
from planner.place import Infeasible, Place
from planner.trajectory import State, Trajectory, unit_speed_trajectory

# Smallest cell, as a share of the part that it is cut from; beyond it a singular pose counts as met.
MIN_CELL_SHARE = 2.0**-12
# Cells that are looked at together: few enough for what their series take.
CELL_BATCH = 1024


def find_singularity(path: MachinePath, ends: Array, piece: np.ndarray) -> tuple[float, int] | None:
    """s and piece of the first place at which the Jacobian is not proved to be nonsingular; None where there is none.

    ends (N+1,), piece (N,): parts of the path, each within a piece. Over a cell with centre c, J = J_c + J_1 τ + J_2 τ²
    with |τ| ≤ 1; with C ≈ J_c⁻¹, ‖|I − C J_c| + |C J_1| + |C| |J_2|‖_∞ < 1 proves J nonsingular all over it. Cells that
    fail are halved.
    """
    low, width = ends[:-1], np.diff(ends)
    least = MIN_CELL_SHARE * width
    met: list[tuple[float, int]] = []
    while len(low):
        batches = (slice(first, first + CELL_BATCH) for first in range(0, len(low), CELL_BATCH))
        fine = np.concatenate([_is_nonsingular(path, low[own], width[own], piece[own]) for own in batches])
        hopeless = ~fine & (width <= least)
        met += zip((low + width / 2)[hopeless].tolist(), piece[hopeless].tolist(), strict=True)
        # only what lies before the first place that is met
        again = ~fine & ~hopeless & (low < min(met, default=(np.inf, 0))[0])
        half = width[again] / 2
        low, width = np.concatenate([low[again], low[again] + half]), np.concatenate([half, half])
        piece, least = np.tile(piece[again], 2), np.tile(least[again], 2)
    return min(met, default=None)


def _is_nonsingular(path: MachinePath, low: Array, width: Array, piece: np.ndarray) -> np.ndarray:
    """(N,) whether the Jacobian is proved to be nonsingular all over each cell."""
    count, half = len(low), width / 2
    # the centres of all cells, then the cells whole
    middle, scale = np.tile(low + half, 2), np.tile(half, 2)
    spread = np.concatenate([np.zeros(count), half])
    s = Series(np.stack([middle, scale]), np.stack([spread, np.zeros(2 * count)]), 2)
    with np.errstate(over="ignore", invalid="ignore"):  # metres beyond reach: unbounded, which proves nothing
        j = path.jacobian(s, np.tile(piece, 2)).pad(2)
    shape = (count, len(path.names), -1)
    at, slope, bend = (
        (j.mid[k, part].reshape(shape), j.rad[k, part].reshape(shape))
        for k, part in ((0, slice(count)), (1, slice(count)), (2, slice(count, None)))
    )
    inverse = invert(at[0])  # about; what cannot be inverted proves nothing
    size = np.abs(inverse)
    with np.errstate(invalid="ignore"):
        whole = np.abs(np.eye(shape[1]) - inverse @ at[0]) + size @ at[1]
        whole = whole + np.abs(inverse @ slope[0]) + size @ (slope[1] + np.abs(bend[0]) + bend[1])
        # a little below 1, for the rounding of these lines themselves
        return np.asarray(whole.sum(-1).max(-1) < 1 - 1e-9)


# Points of a part of the path that are looked at for the worst place.
PART_POINTS = 65


@dataclass(frozen=True, slots=True)
class Standing(Result):
    """All violations, the worst first, and for each limit the largest proven use, and where.

    blends: what became of the program's joins that ask for one; fit: of its chains that became curves
    departures: how far its synchronised moves leave the straight line
    overshoots: how far its splines leave the polygon of their points
    conditioning: the poorest that was found along the path; None where it breaks a limit
    avoidable: its stops at joins that nobody asked for, at the machine's usual order; None likewise
    """

    violations: tuple[MotionError, ...]
    largest: dict[str, tuple[float, Place]]
    blends: tuple[Blended, ...] = ()
    fit: FitSummary | None = None
    departures: tuple[Departure, ...] = ()
    overshoots: tuple[Overshoot, ...] = ()
    conditioning: Conditioning | None = None
    avoidable: AvoidableStops | None = None

    def tables(self) -> tuple[Table, ...]:
        """The largest use of each limit and where, the violations below; the blends."""
        uses = Table(
            "largest use of each limit, proved along the path",
            (
                Column("limit", [*self.largest]),
                Column("bound", [use for use, _ in self.largest.values()], form=".7f", up=True),
                *Place.columns([place for _, place in self.largest.values()]),
            ),
            (*map(str, self.violations), *self.warnings, *self._describe_stops()),
        )
        return (
            uses,
            *fit_tables(self.fit),
            *blend_tables(self.blends),
            *departure_tables(self.departures),
            *overshoot_tables(self.overshoots),
        )

    def _describe_stops(self) -> tuple[str, ...]:
        stops = "" if self.avoidable is None else self.avoidable.describe()
        return (f"stops: {stops}",) if stops else ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that break no limit: a pose near a singular one, a spline far from its points."""
        near = "" if self.conditioning is None else self.conditioning.warning
        return (*((near,) if near else ()), *overshoot_warnings(self.overshoots))


TIE_DIGITS = 9
"""Of a limit's use, beyond which two are the same."""


def prove_feasibility(path: ActuatorPath, limits: Sequence[Limit]) -> Standing:
    """Bound the geometric limits over the path, walked at unit speed: what they use is the same under every timing."""
    along = unit_speed_trajectory(path)
    geometric = [limit for limit in limits if limit.geometric]
    everywhere = np.repeat(np.arange(len(along.s)), 3)
    state = along.within(everywhere, np.tile([0.0, 0.5, 1.0], len(along.s)) * np.diff(along.knots)[everywhere])
    lost = ~np.isfinite(state.q).all(1)
    if lost.any():
        first = int(np.argmax(lost))
        place = path.place(float(state.along[first]), int(state.piece[first]))
        axes = ", ".join(name for name, q in zip(path.names, state.q[first], strict=True) if not np.isfinite(q))
        reach = f"no actuator coordinates reach the path at {place}: there is no position of {axes}"
        error = OutOfReach(f"{reach}; bring it nearer to home").in_segment(place.segment)
        return Standing((error,), {})
    if isinstance(path, MachinePath):
        met = find_singularity(path, np.append(along.s, path.breaks[-1]), along.piece)
        if met is not None:
            place = path.place(*met)
            where = f"the pose at {place} is singular, or too close to a singularity"
            jacobian = evaluate_jacobian(path, np.array(met[:1]), np.array(met[1:]))[0]
            loss = describe_singularity(path.machine, jacobian)
            error = OutOfReach(f"{where}: {loss}; route the path around it").in_segment(place.segment)
            return Standing((error,), {})
    use = prove_path_use(path, geometric)
    largest: dict[str, tuple[float, Place]] = {}
    found: dict[tuple[str, int, int], tuple[float, Infeasible]] = {}
    for limit in geometric:
        bound = use[limit.name]
        worst, broken = int(np.argmax(bound)), np.flatnonzero(bound > 1).tolist()
        for part in {worst, *broken}:
            look = _state_at_points(along, part)
            value = limit.value(look)
            uses = limit.use(value, value, look.piece)
            rows, most = uses.argmax(0), uses.max(0)
            top, piece = int(np.argmax(most)), int(look.piece[0])
            places = [
                path.place(float(look.along[row]), piece, None, name)
                for row, name in zip(rows, limit.channels, strict=True)
            ]
            if part == worst:
                largest[limit.name] = float(bound[part]), places[top]
            # a peak between the points looked at is proved all the same
            for channel in {top, *np.flatnonzero(round_reached_use(most) > 1).tolist()} if part in broken else ():
                if most[channel] > found.get((limit.name, piece, channel), (0.0,))[0]:
                    told = limit_violation(limit, float(value[rows[channel], channel]), channel, piece, places[channel])
                    found[limit.name, piece, channel] = float(most[channel]), told
    # where two pieces meet both are as far out: that is the fault of the one that leads there
    worst_first = sorted(found.items(), key=lambda item: (-round(item[1][0], TIE_DIGITS), item[0][1]))
    return Standing(tuple(told for _, (_, told) in worst_first), largest)


def _state_at_points(along: Trajectory, part: int) -> State:
    span = along.knots[part + 1] - along.knots[part]
    return along.within(np.full(PART_POINTS, part), span * np.linspace(0.0, 1.0, PART_POINTS))


def limit_violation(limit: Limit, value: float, channel: int, piece: int, place: Place) -> Infeasible:
    """What to say where a geometric limit is broken."""
    unit, scale = limit.units[channel]
    reached, allowed = (each * scale for each in limit.report_value(value, channel, piece))
    remedy = limit.remedy(abs(reached - allowed), unit)
    return Infeasible(limit.name, limit.channels[channel], place, reached, allowed, unit, remedy)
