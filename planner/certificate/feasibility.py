"""Feasibility: limits that slowing down cannot fix, proved first.

These are reach, control, travel, tilt, clearance and holding.
Control is lost in singular poses, which are excluded cell by cell along the path by guaranteed
bounds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.analysis.virtual_work import invert
from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, OutOfReach
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from kinematics.foundation.taylor_model import EPS
from kinematics.machine.motion import describe_singularity
from planner.avoidable_stops import AvoidableStops
from planner.certificate.cells import (
    Cells,
    Values,
    refine,
    sample_pieces,
)
from planner.certificate.conditioning import Conditioning, evaluate_jacobian
from planner.certificate.enclosure import cover_places
from planner.certificate.limit_use import LIMIT_ROUNDING, prove_path_use, tabulate_uses
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath, MachinePath
from planner.path.outcome import (
    Blended,
    FitSummary,
    blend_tables,
    fit_tables,
)
from planner.path.overshoot import overshoot_tables, overshoot_warnings
from planner.path.point_to_point import Departure, departure_tables
from planner.path.shape import Overshoot
from planner.place import Infeasible, Place
from planner.trajectory import Trajectory, unit_speed_trajectory

# Smallest cell as a share of a part of the path: if it is not proved, it counts as singular.
MIN_CELL_SHARE = 2.0**-12
# Shares of a part of the path at which the worst place is sought.
PLACES = np.linspace(0.0, 1.0, 65)
TIE_DIGITS = 9
"""Decimals of a use beyond which two count as equal."""


def find_singularity(
    path: MachinePath,
    ends: Array,
    piece: np.ndarray,
) -> tuple[float, int] | None:
    """Return s and piece of the first place where the Jacobian is not proved nonsingular, or None.

    ends (N+1,), piece (N,): parts of the path, each within a piece. Cells that fail are halved.
    """
    width = np.diff(ends)
    first = np.inf

    def prove(cells: Cells) -> Values:
        middle = ends[cells.k] + (cells.lo + cells.hi) / 2
        return (
            middle,
            _is_nonsingular(path, middle, cells.lengths / 2, piece[cells.k]),
        )

    def find_loose(cells: Cells, values: Values) -> tuple[np.ndarray, int]:
        nonlocal first
        middle, proved = values
        small = cells.lengths <= MIN_CELL_SHARE * width[cells.k]
        first = min(first, middle[~proved & small].min(initial=np.inf))
        # cells beyond the first place that counts as singular do not matter
        return ~proved & ~small & (ends[cells.k] + cells.lo < first), 2

    parts = np.arange(len(width))
    cells = Cells(parts, np.zeros_like(width), width)
    cells, (middle, _) = refine(cells, prove, find_loose)
    if not np.isfinite(first):
        return None
    part = cells.k[np.argmax(middle == first)]
    return float(first), int(piece[part])


def _is_nonsingular(
    path: MachinePath,
    middle: Array,
    half: Array,
    piece: np.ndarray,
) -> np.ndarray:
    """Return whether the Jacobian is proved nonsingular over each cell (N,).

    About the centre, J = J₀ + J₁ τ + J₂ τ² with |τ| ≤ 1 and J₂ over the whole cell. With C ≈ J₀⁻¹,
    ‖|1 − C J₀| + |C J₁| + |C| |J₂|‖_∞ < 1 proves it.
    """
    count = len(middle)
    half = half + 4 * EPS * np.abs(middle)
    s = cover_places(middle, half, 2)
    # metres beyond reach it is unbounded, and the proof fails
    with np.errstate(over="ignore", invalid="ignore"):
        jacobian = path.jacobian(s, np.tile(piece, 2)).pad(2)
    shape = (3, 2, count, len(path.names), -1)
    mid = jacobian.mid.reshape(shape)
    rad = jacobian.rad.reshape(shape)
    at, slope = mid[:2, 0]
    rad_at, rad_slope = rad[:2, 0]
    bend = np.abs(mid[2, 1]) + rad[2, 1]
    inverse = invert(at)  # approximate; with a singular matrix the proof fails
    size = np.abs(inverse)
    with np.errstate(invalid="ignore"):
        total = np.abs(np.eye(at.shape[1]) - inverse @ at)
        total += size @ rad_at
        total += np.abs(inverse @ slope)
        total += size @ (rad_slope + bend)
        # a little below 1, for the rounding of these lines themselves
        return np.asarray(total.sum(-1).max(-1) < 1 - 1e-9)


@dataclass(frozen=True, slots=True)
class Standing(Result):
    """All violations, the worst first, and for each limit the largest proven use, and where.

    blends: outcome of the program's joins that state a blend; fit: of its chains that became curves
    departures: how far its synchronised moves leave the straight line
    overshoots: how far its splines leave the polygon of their points
    conditioning: the poorest along the path; None if the path exceeds a limit
    avoidable: its stops at joins that nobody stated, at the machine's usual order; None likewise
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
        """Return the largest use of each limit and where, the violations below; the blends."""
        bounds = {name: use for name, (use, _) in self.largest.items()}
        places = {name: place for name, (_, place) in self.largest.items()}
        notes = [*map(str, self.violations), *self.warnings]
        stops = "" if self.avoidable is None else self.avoidable.describe()
        if stops:
            notes.append(f"stops: {stops}")
        title = "largest use of each limit, proved along the path"
        return (
            tabulate_uses(title, bounds, places, notes),
            *fit_tables(self.fit),
            *blend_tables(self.blends),
            *departure_tables(self.departures),
            *overshoot_tables(self.overshoots),
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that break no limit: a pose near a singular one, a spline far from its
        points.
        """
        near = "" if self.conditioning is None else self.conditioning.warning
        return tuple(filter(None, (near, *overshoot_warnings(self.overshoots))))


def prove_feasibility(
    path: ActuatorPath,
    limits: Sequence[Limit],
) -> Standing:
    """Bound the geometric limits along the path at unit speed: their use is the same under every
    timing.
    """
    along = unit_speed_trajectory(path)
    error = _find_lost_reach(path, along)
    if error is None and isinstance(path, MachinePath):
        error = _find_lost_control(path, along)
    if error is not None:
        return Standing((error,), {})
    geometric = [limit for limit in limits if limit.geometric]
    use = prove_path_use(path, geometric)
    largest: dict[str, tuple[float, Place]] = {}
    violations: list[_Violation] = []
    for limit in geometric:
        bound = use[limit.name]
        worst = int(np.argmax(bound))
        largest[limit.name] = (
            float(bound[worst]),
            _sample_part(along, limit, worst)[0].place,
        )
        for part in np.flatnonzero(bound > 1).tolist():
            samples = _sample_part(along, limit, part)
            # the first exceeds the limit, at a peak between the samples at least: that is proved
            violations += samples[:1]
            violations += [each for each in samples[1:] if each.use > 1 + LIMIT_ROUNDING]
    return Standing(_sort_violations(violations), largest)


def _find_lost_reach(
    path: ActuatorPath,
    along: Trajectory,
) -> OutOfReach | None:
    """Return the error of the first sampled place that the actuators do not reach."""
    state = sample_pieces(along, np.arange(len(along.s)), (0.0, 0.5, 1.0))
    lost = ~np.isfinite(state.q).all(1)
    if not lost.any():
        return None
    first = int(np.argmax(lost))
    place = path.place(state.along[first], state.piece[first])
    finite = np.isfinite(state.q[first])
    axes = ", ".join(np.array(path.names)[~finite])
    reach = f"no actuator coordinates reach the path at {place}: there is no position of {axes}"
    return OutOfReach(f"{reach}; bring it nearer to home").in_segment(place.segment)


def _find_lost_control(
    path: MachinePath,
    along: Trajectory,
) -> OutOfReach | None:
    """Return the error of the first singular pose."""
    singular = find_singularity(path, np.append(along.s, path.breaks[-1]), along.piece)
    if singular is None:
        return None
    s, piece = singular
    place = path.place(s, piece)
    jacobian = evaluate_jacobian(path, np.array([s]), np.array([piece]))[0]
    loss = describe_singularity(path.machine, jacobian)
    where = f"the pose at {place} is singular, or too close to a singularity"
    return OutOfReach(f"{where}: {loss}; route the path around it").in_segment(place.segment)


@dataclass(frozen=True, slots=True)
class _Violation:
    """The largest sampled use of one channel of a limit on a part of the path."""

    limit: Limit
    channel: int
    piece: int
    use: float
    value: float
    place: Place

    @property
    def key(self) -> tuple[str, int, int]:
        return self.limit.name, self.piece, self.channel

    def make_error(self) -> Infeasible:
        return limit_violation(self.limit, self.value, self.channel, self.piece, self.place)


def _sample_part(
    along: Trajectory,
    limit: Limit,
    part: int,
) -> "list[_Violation]":
    """Return the largest use of each channel of a limit at the PLACES of a part of the path.

    The channel that uses most is the first.
    """
    state = sample_pieces(along, np.array([part]), PLACES)
    value = limit.value(state)
    uses = limit.use(value, value, state.piece)
    piece = int(state.piece[0])
    channels = []
    for channel, row in enumerate(uses.argmax(0).tolist()):
        place = along.path.place(state.along[row], piece, None, limit.channels[channel])
        use = float(uses[row, channel])
        channels.append(
            _Violation(
                limit,
                channel,
                piece,
                use,
                float(value[row, channel]),
                place,
            )
        )
    return sorted(channels, key=lambda each: -each.use)


def _sort_violations(
    violations: Sequence[_Violation],
) -> tuple[Infeasible, ...]:
    """Return the errors, the worst first: one for each limit, piece and channel.

    Where two pieces meet both exceed a limit as much: the one that leads there comes first.
    """
    worst: dict[tuple[str, int, int], _Violation] = {}
    for each in violations:
        if each.key not in worst or each.use > worst[each.key].use:
            worst[each.key] = each
    ordered = sorted(
        worst.values(),
        key=lambda each: (-round(each.use, TIE_DIGITS), each.key),
    )
    return tuple(each.make_error() for each in ordered)


def limit_violation(
    limit: Limit,
    value: float,
    channel: int,
    piece: int,
    place: Place,
) -> Infeasible:
    """Return the error of a geometric limit that is exceeded."""
    unit, scale = limit.units[channel]
    reached, allowed = (each * scale for each in limit.report_value(value, channel, piece))
    remedy = limit.remedy(abs(reached - allowed), unit)
    return Infeasible(
        limit.name,
        limit.channels[channel],
        place,
        reached,
        allowed,
        unit,
        remedy,
    )
