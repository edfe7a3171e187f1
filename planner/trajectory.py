"""A motion in time: s(t) in closed-form pieces along an actuator path, and its rows over time.

Quantities that depend on the place alone are the same under every timing. They are evaluated on the
path at unit speed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, log10
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from kinematics.analysis.clearance import Bodies
from kinematics.foundation.arrays import Array, finite_array, freeze_fields
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.result import Result
from kinematics.foundation.short_repr import short_repr
from kinematics.foundation.table import Column, Table
from kinematics.machine.motion import AxesState
from kinematics.machine.pose import from_numbers
from planner.path.actuation import ActuatorPath, MachinePath, check_rate

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose


@dataclass(frozen=True, slots=True)
class State:
    """The motion at instants t (N,): path length s and q, q̇, q̈, q⃛ (N, axes).

    along, sd, sdd, sddd (N,)  the timed coordinate and its rates. It is s, except on straight
                               pieces of a path without a machine: there it is the distance, scaled
                               to run from the parameter of one end to that of the other.
    pose is None without a machine.
    """

    __repr__ = short_repr
    t: Array
    along: Array
    q: Array
    qd: Array
    qdd: Array
    sd: Array
    sdd: Array
    sddd: Array
    path: ActuatorPath
    piece: np.ndarray
    known: Array | None = None

    @property
    def s(self) -> Array:
        """Path length (N,); without a machine, the parameter of the caller's path."""
        return self.path.parameter(self.along, self.piece)

    @property
    def qddd(self) -> Array:
        """Third derivative, computed at the first request unless it is `known`."""
        if self.known is not None:
            return self.known
        _, *slopes = self.path.derivatives(self.along, self.piece)
        return _third_derivative(slopes, (self.sd, self.sdd, self.sddd))

    @property
    def pose(self) -> "Pose | None":
        numbers = self.path.pose_numbers(self.along, self.piece)
        return None if numbers is None else from_numbers(numbers)

    @property
    def tool_velocity(self) -> Array:
        """Velocity (N, 3) m/s of the tool; of the platform's origin if there is no tool."""
        return np.asarray(self.tool_rate(1)[:, :3])

    def pose_rate(self, times: int) -> Array:
        """Return a time derivative of the pose's twelve numbers (N, 12).

        ẋ = x′ ṡ; ẍ = x′ s̈ + x″ ṡ²; x⃛ as q⃛. Raises MotionError unless `times` is 0, 1, 2 or 3.
        """
        times = check_rate(times)
        numbers = self.path.pose_numbers(self.along, self.piece) if times == 0 else None
        if numbers is not None:
            return numbers
        along = self.path.pose_derivatives(self.along, self.piece, times)
        if along is None:
            raise MotionError("this motion has no machine, so it has no pose")
        if times == 3:
            return _third_derivative(along[1:], (self.sd, self.sdd, self.sddd))
        v = self.sd[:, None]
        a = self.sdd[:, None]
        return along[1] * v if times == 1 else along[1] * a + along[2] * v**2

    def distances(self, bodies: Bodies) -> Array:
        """Return the distances (N, k) m between the axes of a machine's bodies."""
        return bodies.distances(self.pose_rate(0))

    def tool_rate(self, times: int) -> Array:
        """Return `pose_rate` of the tool; of the platform if there is no tool."""
        rate = self.pose_rate(times)
        return rate if self.path.tool is None else self.path.tool(rate)

    def evaluate(self, expression: Expression, *inputs: Array) -> Array:
        """Evaluate an expression at quantities of this motion, each (N, k), concatenated."""
        return expression(np.concatenate(inputs, 1))


@dataclass(frozen=True, slots=True)
class Trajectory(Result):
    """A motion s(t) = s + v τ + a τ²/2 + j τ³/6 with τ = t - knots[k] on time piece k.

    Time piece k lies inside path piece `piece[k]`.

    knots  (M+1,) s, from 0 to the duration; never decreasing
    s, v, a, j  (M,) path length, speed, acceleration at the start of each time piece, and its jerk
    piece  (M,) index of the path piece
    """

    path: ActuatorPath = field(repr=False)
    knots: Array
    s: Array = field(repr=False)
    v: Array = field(repr=False)
    a: Array = field(repr=False)
    j: Array = field(repr=False)
    piece: np.ndarray = field(repr=False)

    def __post_init__(self) -> None:
        freeze_fields(self, "knots", "s", "v", "a", "j", "piece")

    @property
    def duration(self) -> float:
        return float(self.knots[-1])

    @property
    def constant_speeds(self) -> Array:
        """Constant speed (M,) m/s of each time piece that its segment requires; NaN elsewhere."""
        required = [self.path.constant(piece) for piece in range(len(self.path.breaks) - 1)]
        speed = np.array([np.nan if each is None else each for each in required])[self.piece]
        at_it = (self.v == speed) & (self.a == 0) & (self.j == 0) & (np.diff(self.knots) > 0)
        return np.where(at_it, speed, np.nan)

    @property
    def resting(self) -> np.ndarray:
        """True (M,) for each time piece without motion, even if it takes no time."""
        return np.asarray((self.v == 0) & (self.a == 0) & (self.j == 0))

    def __repr__(self) -> str:
        axes = count_noun(len(self.path.names), "axis")
        return (
            f"<Trajectory: {self.duration:.6g} s, {axes}, {count_noun(len(self.s), 'time piece')}>"
        )

    def tables(self) -> tuple[Table, ...]:
        """Return the range of each axis, and the largest sampled values of its derivatives."""
        state = self.at(row_instants(self.duration))
        units = axis_units(self.path)
        columns = [
            Column("axis", self.path.names),
            Column("from", state.q.min(0), units, "human"),
            Column("to", state.q.max(0), units, "human"),
        ]
        rates = (
            ("speed", state.qd, "/s"),
            ("acceleration", state.qdd, "/s^2"),
            ("jerk", state.qddd, "/s^3"),
        )
        for name, values, per in rates:
            rate_units = [f"{unit}{per}" if unit else "" for unit in units]
            columns.append(Column(name, np.abs(values).max(0), rate_units, "human"))
        step = f"{period(self.duration) * 1e3:g} ms"
        title = f"motion of {self.duration:.6f} s; the largest that is seen every {step}"
        return (Table(title, tuple(columns)),)

    def data(self) -> Table:
        """Return the motion every millisecond (above 1000 s, less often): distance, pose and
        axes.
        """
        values = rows(self, row_instants(self.duration))
        headings = column_headings(self.path)
        columns = (Column(name, values[:, k], unit) for k, (name, unit) in enumerate(headings))
        return Table(f"motion of {self.duration:.6f} s", tuple(columns))

    def cut(self, first: int, last: int) -> "Trajectory":
        """Return time pieces `first` to before `last`: time begins at 0, path length continues."""
        knots = self.knots[first : last + 1] - self.knots[first]
        arrays = (self.s, self.v, self.a, self.j, self.piece)
        return Trajectory(self.path, knots, *(values[first:last] for values in arrays))

    def locate(self, t: Array) -> np.ndarray:
        """Return the index of the time piece of each instant; a knot belongs to its later piece."""
        return np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.s) - 1)

    def at(self, t: ArrayLike) -> State:
        """Return the state at t (s), one or (N,). Before 0 and after the duration the motion rests.

        q̇ = q′ ṡ;  q̈ = q′ s̈ + q″ ṡ²;  q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³.

        Raises MotionError unless t is a finite instant or a list of them.
        """
        return self._at(np.atleast_1d(finite_array(t, "at: t", (), (None,), unit="s")))

    def positions_at(self, t: Array) -> Array:
        """Return q (N, n) alone, in a third of the time of `at`."""
        inside = np.clip(t, 0.0, self.duration)
        k = self.locate(inside)
        tau = inside - self.knots[k]
        s, _, _ = self.advance(k, tau)
        return self.path.derivatives(s, self.piece[k], 0)[0]

    def axis_at(self, t: Array, axis: int) -> State:
        """Return the state with one axis only, (N, 1), in a fraction of the time of `at`."""
        return self._at(t, jerk=True, axis=axis)

    def _at(self, t: Array, *, jerk: bool = False, axis: int | None = None) -> State:
        inside = np.clip(t, 0.0, self.duration)
        k = self.locate(inside)
        state = self.within(k, inside - self.knots[k], jerk=jerk, axis=axis)
        moves = t == inside
        if moves.all():
            return replace(state, t=t)
        rates = {name: getattr(state, name) * moves for name in ("sd", "sdd", "sddd")}
        rates |= {name: getattr(state, name) * moves[:, None] for name in ("qd", "qdd")}
        known = None if state.known is None else state.known * moves[:, None]
        return replace(state, t=t, known=known, **rates)

    def advance(self, k: np.ndarray | slice, tau: Array) -> tuple[Array, Array, Array]:
        """Return s, ṡ, s̈ (N,) at `tau` (s) after the start of time pieces k."""
        v, a, j = self.v[k], self.a[k], self.j[k]
        s = self.s[k] + tau * (v + tau * (a / 2 + tau * j / 6))
        return s, v + tau * (a + tau * j / 2), a + tau * j

    def within(
        self,
        k: np.ndarray,
        tau: Array,
        *,
        jerk: bool = False,
        axis: int | None = None,
    ) -> State:
        """Return the state `tau` (s) after the start of time piece k, each (N,).

        On a knot the caller chooses the side by k. jerk: compute q⃛ at once, with the others. axis:
        of this axis alone, always with `jerk`.
        """
        s, sd, sdd = self.advance(k, tau)
        j = self.j[k]
        derivatives = self.path.derivatives
        if axis is not None:
            derivatives = partial(self.path.axis_derivatives, axis)
        q, *slopes = derivatives(s, self.piece[k], 3 if jerk else 2)
        qd = slopes[0] * sd[:, None]
        qdd = slopes[0] * sdd[:, None] + slopes[1] * sd[:, None] ** 2
        third = _third_derivative(slopes, (sd, sdd, j)) if jerk else None
        t = self.knots[k] + tau
        return State(t, s, q, qd, qdd, sd, sdd, j, self.path, self.piece[k], third)


def _third_derivative(slopes: Sequence[Array], rates: Iterable[Array]) -> Array:
    """Return q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³ for q′, q″, q‴ and ṡ, s̈, s⃛."""
    q1, q2, q3 = slopes
    v, a, j = (rate[:, None] for rate in rates)
    return np.asarray(q1 * j + 3 * q2 * v * a + q3 * v**3)


ROW_PERIOD = 1e-3
"""s from row to row; the last row is the end of the motion."""
MOST_ROWS = 1_000_000
"""Largest number of rows: for more, the period is multiplied by 10, 100, … It bounds file sizes."""
QUANTITIES = {"q": "", "qd": "/s", "qdd": "/s^2", "qddd": "/s^3"}


class RowState(AxesState, Protocol):
    """Path length s (N,), and q, q̇, q̈, q⃛ (N, axes) of any motion."""

    @property
    def s(self) -> Array: ...
    @property
    def qddd(self) -> Array: ...


def column_headings(path: ActuatorPath) -> list[tuple[str, str]]:
    """Return name and SI unit of each column; without a machine only time has a unit."""
    units = axis_units(path)
    place = [("t", "s"), ("s", "")]
    if isinstance(path, MachinePath):
        place[1] = ("s", "m")
        place += [(name, "m") for name in "xyz"]
        place += [(f"r{name}", "rad") for name in "xyz"]
    return place + [
        (f"{name} {q}", f"{unit}{per}" if unit else "")
        for name, unit in zip(path.names, units, strict=True)
        for q, per in QUANTITIES.items()
    ]


def axis_units(path: ActuatorPath) -> tuple[str, ...]:
    """Return the unit of each axis, m or rad; "" without a machine."""
    if isinstance(path, MachinePath):
        return tuple(axis.unit for axis in path.machine.axes)
    return ("",) * len(path.names)


def period(duration: float) -> float:
    """Return the time (s) from row to row: ROW_PERIOD, or more if there were over MOST_ROWS."""
    if duration <= 0:
        return ROW_PERIOD
    return ROW_PERIOD * 10.0 ** max(0, ceil(log10(duration / ROW_PERIOD / MOST_ROWS)))


def row_instants(duration: float) -> Array:
    """Return the instants (N,) s of the rows: every `period`, and the end."""
    step = period(duration)
    rows = ceil(duration / step) + 1
    return np.asarray(np.minimum(np.arange(rows) * step, duration), float)


def rows(trajectory: Trajectory, t: Array) -> Array:
    """Return rows (N, columns) at t (N,); rx, ry, rz about the moving axes in turn."""
    state = trajectory.at(t)
    return put_in_rows(t, state, state.pose if isinstance(trajectory.path, MachinePath) else None)


def put_in_rows(t: Array, state: "RowState", poses: "Pose | None") -> Array:
    """Return the rows (N, columns) of states and poses at t (N,)."""
    columns = [t, state.s]
    if poses is not None:
        columns += [poses.translation, poses.rotation.as_euler("XYZ", suppress_warnings=True)]
    axes = np.stack([state.q, state.qd, state.qdd, state.qddd], 2).reshape(len(t), -1)
    return np.asarray(np.column_stack([*columns, axes]) + 0.0)  # no row shows −0


# Least number of parts of a piece, and number per radian that it turns: more parts give tighter
# bounds of geometric limits and take proportionally longer.
MIN_PARTS = 8
PER_RADIAN = 4


def unit_speed_trajectory(path: ActuatorPath) -> Trajectory:
    """Return the motion along the whole path at ṡ = 1, each piece in equal parts."""
    counts = np.maximum(MIN_PARTS, np.ceil(PER_RADIAN * path.turns)).astype(int)
    ends = zip(path.breaks[:-1], path.breaks[1:], counts, strict=True)
    s = [np.linspace(first, last, count + 1)[:-1] for first, last, count in ends]
    knots = np.append(np.concatenate(s), path.breaks[-1])
    zeros = np.zeros(len(knots) - 1)
    piece = np.repeat(np.arange(len(counts)), counts)
    return Trajectory(path, knots - knots[0], knots[:-1], zeros + 1, zeros, zeros, piece)
