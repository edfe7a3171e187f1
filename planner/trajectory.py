"""A motion in time: s(t) in closed-form pieces along an actuator path, and as a series over time, row by row.

What depends on the place alone is the same under every timing: a path walked at unit speed serves for all.
"""

from dataclasses import dataclass, field
from functools import partial
from math import ceil, log10
from typing import Protocol

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
from kinematics.machine.pose import Pose, from_numbers
from planner.path.actuation import ActuatorPath, MachinePath, check_rate


@dataclass(frozen=True, slots=True)
class State:
    """The motion at instants t (N,): path length s, what it is timed by and the rates of that, q, q̇, q̈, q⃛ (N, axes).

    along, sd, sdd, sddd (N,)  what is timed, and its rates: s, but on straight stretches of a path without a machine
                               their way, from the one parameter to the other of their ends
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
        """Path length (N,); of a path without a machine its parameter, as it was given."""
        return self.path.parameter(self.along, self.piece)

    @property
    def qddd(self) -> Array:
        """As it was asked for, or else worked out now: few want it."""
        if self.known is not None:
            return self.known
        _, q1, q2, q3 = self.path.derivatives(self.along, self.piece)
        return _third_derivative(q1, q2, q3, self.sd, self.sdd, self.sddd)

    @property
    def pose(self) -> Pose | None:
        numbers = self.path.pose_numbers(self.along, self.piece)
        return None if numbers is None else from_numbers(numbers)

    @property
    def tool_velocity(self) -> Array:
        """(N, 3) m/s of the tool: of the platform's origin where there is none."""
        return np.asarray(self.tool_rate(1)[:, :3])

    def pose_rate(self, times: int) -> Array:
        """The pose's twelve numbers (N, 12), differentiated by time: ẋ = x′ ṡ, ẍ = x′ s̈ + x″ ṡ², and x⃛ as q⃛.

        Raises MotionError for another order than 0, 1, 2 or 3.
        """
        times = check_rate(times)
        numbers = self.path.pose_numbers(self.along, self.piece) if times == 0 else None
        if numbers is not None:
            return numbers
        along = self.path.pose_derivatives(self.along, self.piece, times)
        if along is None:
            raise MotionError("this motion has no machine, so it has no pose")
        if times == 3:
            _, x1, x2, x3 = along
            return _third_derivative(x1, x2, x3, self.sd, self.sdd, self.sddd)
        v, a = self.sd[:, None], self.sdd[:, None]
        return along[1] * v if times == 1 else along[1] * a + along[2] * v**2

    def distances(self, bodies: Bodies) -> Array:
        """Between the axes of a machine's bodies (N, k), m."""
        return bodies.distances(self.pose_rate(0))

    def tool_rate(self, times: int) -> Array:
        """The same of the tool's numbers: the platform's where there is no tool."""
        rate = self.pose_rate(times)
        return rate if self.path.tool is None else self.path.tool(rate)

    def evaluate(self, expression: Expression, *inputs: Array) -> Array:
        """An expression of quantities of this motion, (N, k) each, one after the other."""
        return expression(np.concatenate(inputs, 1))


@dataclass(frozen=True, slots=True)
class Trajectory(Result):
    """s(t) = s + v τ + a τ²/2 + j τ³/6 with τ = t - knots[k] on piece k, which runs inside path piece `piece[k]`.

    knots  (M+1,) s, from 0 to the duration; never decreasing
    s, v, a, j  (M,) path length, speed, acceleration at the start of each time piece, and its constant jerk
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
        """(M,) m/s that each time piece has throughout because its segment asks for it; NaN elsewhere."""
        asked = [self.path.constant(piece) for piece in range(len(self.path.breaks) - 1)]
        speed = np.array([np.nan if each is None else each for each in asked])[self.piece]
        at_it = (self.v == speed) & (self.a == 0) & (self.j == 0) & (np.diff(self.knots) > 0)
        return np.where(at_it, speed, np.nan)

    def __repr__(self) -> str:
        axes = len(self.path.names)
        return (
            f"<Trajectory: {self.duration:.6g} s, {count_noun(axes, 'axis')}, {count_noun(len(self.s), 'time piece')}>"
        )

    def tables(self) -> tuple[Table, ...]:
        """Between what each axis moves, and the largest of its derivatives that is seen."""

        seen, units = self.at(row_instants(self.duration)), axis_units(self.path)
        rates = (("speed", seen.qd, "/s"), ("acceleration", seen.qdd, "/s^2"), ("jerk", seen.qddd, "/s^3"))
        names = Column("axis", self.path.names)
        ends = (Column(name, of(seen.q, axis=0), units, "human") for name, of in (("from", np.min), ("to", np.max)))
        most = (
            Column(name, np.abs(values).max(0), [f"{unit}{per}" if unit else "" for unit in units], "human")
            for name, values, per in rates
        )
        title = f"motion of {self.duration:.6f} s; the largest that is seen every {period(self.duration) * 1e3:g} ms"
        return (Table(title, (names, *ends, *most)),)

    def data(self) -> Table:
        """The motion every millisecond (above 1000 s, less often): distance, pose, the axes with their derivatives."""

        values = rows(self, row_instants(self.duration))
        columns = (Column(name, values[:, k], unit) for k, (name, unit) in enumerate(column_headings(self.path)))
        return Table(f"motion of {self.duration:.6f} s", tuple(columns))

    def cut(self, first: int, last: int) -> "Trajectory":
        """What it does on time pieces `first` to before `last`: time begins at 0 again, path length goes on."""
        knots, here = self.knots[first : last + 1], slice(first, last)
        return Trajectory(
            self.path, knots - knots[0], self.s[here], self.v[here], self.a[here], self.j[here], self.piece[here]
        )

    def locate(self, t: Array) -> np.ndarray:
        """Index of the time piece of each instant; a knot belongs to the piece that it starts."""
        return np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.s) - 1)

    def at(self, t: ArrayLike) -> State:
        """The state at t (s), one or (N,); before 0 and after the duration the motion rests at its ends.

        q̇ = q′ ṡ;  q̈ = q′ s̈ + q″ ṡ²;  q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³. Raises MotionError for what is no instant.
        """
        return self._at(np.atleast_1d(finite_array(t, "at: t", (), (None,), unit="s")))

    def positions_at(self, t: Array) -> Array:
        """q (N, n) alone, in a third of the time."""
        held = np.clip(t, 0.0, self.duration)
        k = self.locate(held)
        tau = held - self.knots[k]
        s = self.s[k] + tau * (self.v[k] + tau * (self.a[k] / 2 + tau * self.j[k] / 6))
        return self.path.derivatives(s, self.piece[k], 0)[0]

    def axis_at(self, t: Array, axis: int) -> State:
        """The same with the values of one axis only, (N, 1), in a fraction of the time."""
        return self._at(t, jerk=True, axis=axis)

    def _at(self, asked: Array, *, jerk: bool = False, axis: int | None = None) -> State:
        held = np.clip(asked, 0.0, self.duration)
        k = self.locate(held)
        return self.within(k, held - self.knots[k], asked, moving=asked == held, jerk=jerk, axis=axis)

    def within(
        self,
        k: np.ndarray,
        tau: Array,
        t: Array | None = None,
        moving: np.ndarray | None = None,
        *,
        jerk: bool = False,
        axis: int | None = None,
    ) -> State:
        """The state tau after the start of time piece k, each (N,): on a knot, the side is the caller's choice.

        jerk: q⃛ will be asked for too. axis: of this one alone, then always with `jerk`.
        """
        share = np.ones(len(k)) if moving is None else moving.astype(float)
        v0, a0, j0 = self.v[k], self.a[k], self.j[k]
        s = self.s[k] + tau * (v0 + tau * (a0 / 2 + tau * j0 / 6))
        sd, sdd, sddd = share * (v0 + tau * (a0 + tau * j0 / 2)), share * (a0 + tau * j0), share * j0
        derivatives = self.path.derivatives if axis is None else partial(self.path.axis_derivatives, axis)
        q, q1, q2, *q3 = derivatives(s, self.piece[k], 3 if jerk else 2)
        v, a = sd[:, None], sdd[:, None]
        third = _third_derivative(q1, q2, q3[0], sd, sdd, sddd) if jerk else None
        when = self.knots[k] + tau if t is None else t
        return State(when, s, q, q1 * v, q1 * a + q2 * v**2, sd, sdd, sddd, self.path, self.piece[k], third)


def _third_derivative(q1: Array, q2: Array, q3: Array, sd: Array, sdd: Array, sddd: Array) -> Array:
    """q⃛ = q′ s⃛ + 3 q″ ṡ s̈ + q‴ ṡ³."""
    v, a, j = sd[:, None], sdd[:, None], sddd[:, None]
    return np.asarray(q1 * j + 3 * q2 * v * a + q3 * v**3)


ROW_PERIOD = 1e-3
"""s from row to row; the last row is the end of the motion."""
MOST_ROWS = 1_000_000
"""Beyond which rows are ten times as far apart, or a hundred times, and so on."""
QUANTITIES = {"q": "", "qd": "/s", "qdd": "/s^2", "qddd": "/s^3"}


class RowState(AxesState, Protocol):
    """Path length s (N,), and q, q̇, q̈, q⃛ (N, axes) of any motion."""

    @property
    def s(self) -> Array: ...
    @property
    def qddd(self) -> Array: ...


def column_headings(path: ActuatorPath) -> list[tuple[str, str]]:
    """Name and SI unit of each column; of a motion without a machine nothing has a unit but time."""
    units = axis_units(path)
    place = [("t", "s"), ("s", "")]
    if isinstance(path, MachinePath):
        place = [("t", "s"), ("s", "m"), *((name, "m") for name in "xyz"), *((f"r{name}", "rad") for name in "xyz")]
    return place + [
        (f"{name} {q}", f"{unit}{per}" if unit else "")
        for name, unit in zip(path.names, units, strict=True)
        for q, per in QUANTITIES.items()
    ]


def axis_units(path: ActuatorPath) -> tuple[str, ...]:
    """m or rad of each axis, "" without a machine."""
    if isinstance(path, MachinePath):
        return tuple(axis.unit for axis in path.machine.axes)
    return ("",) * len(path.names)


def period(duration: float) -> float:
    """s from row to row: PERIOD, or more of a motion that takes more than MOST_ROWS of it."""
    return ROW_PERIOD * 10.0 ** max(0, ceil(log10(duration / ROW_PERIOD / MOST_ROWS))) if duration > 0 else ROW_PERIOD


def row_instants(duration: float) -> Array:
    """(N,) s, every `period` and the end."""
    step = period(duration)
    rows = ceil(duration / step) + 1
    return np.asarray(np.minimum(np.arange(rows) * step, duration), float)


def rows(trajectory: Trajectory, t: Array) -> Array:
    """(N, columns) at t (N,), rx, ry, rz about the moving axes in turn."""
    state = trajectory.at(t)
    pose = trajectory.path.pose_numbers(state.s, state.piece) if isinstance(trajectory.path, MachinePath) else None
    return put_in_rows(t, state, None if pose is None else from_numbers(pose))


def put_in_rows(t: Array, state: "RowState", poses: Pose | None) -> Array:
    """(N, columns) of what is known at t (N,)."""
    columns = [t, state.s]
    if poses is not None:
        columns += [poses.translation, poses.rotation.as_euler("XYZ", suppress_warnings=True)]
    axes = np.stack([state.q, state.qd, state.qdd, state.qddd], 2).reshape(len(t), -1)
    return np.asarray(np.column_stack([*columns, axes]) + 0.0)  # no row shows −0


# Parts of a piece at least, and for each radian that it turns.
MIN_PARTS, PER_RADIAN = 8, 4


def unit_speed_trajectory(path: ActuatorPath) -> Trajectory:
    """The whole path at ṡ = 1, every piece in equal parts."""
    counts = np.maximum(MIN_PARTS, np.ceil(PER_RADIAN * path.turns)).astype(int)
    s = [np.linspace(path.breaks[k], path.breaks[k + 1], count + 1)[:-1] for k, count in enumerate(counts)]
    knots = np.append(np.concatenate(s), path.breaks[-1])
    nothing = np.zeros(len(knots) - 1)
    piece = np.repeat(np.arange(len(counts)), counts)
    return Trajectory(path, knots - knots[0], knots[:-1], nothing + 1, nothing, nothing, piece)
