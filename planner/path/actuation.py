"""Paths in coordinates of the actuators: q and its derivatives, as numbers and as Taylor models.

Where a pose has several coordinates, a path starts near those at home and follows them without a
jump, through several turns.
"""

from collections import OrderedDict
from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.casadi_function import Expression
from kinematics.foundation.errors import MotionError, NotFree
from kinematics.foundation.taylor_model import Series
from kinematics.machine.kind import columns, refuse_uncontrolled
from kinematics.machine.machine import Machine
from kinematics.machine.pose import column
from planner.path.chain import chain_pieces
from planner.path.outcome import Blended, summarise_fits
from planner.path.shape import Fitted, Overshoot, Piece, Shape, differentiate, pose_map, tool_map
from planner.place import Place
from planner.program.model import Program

if TYPE_CHECKING:
    from kinematics.machine.pose import Pose

# Points at which a piece is sampled: as many as an axis needs to turn by at most MAX_TURN_STEP
# (rad) from one to the next.
FIRST_POINTS = 65
MAX_POINTS = 2**16 + 1
MAX_TURN_STEP = np.pi / 4
# Angle (rad) by which an axis may turn along a part of a piece: more than π from the coordinates in
# its middle, those of another turn would be nearer.
MAX_PART_TURN = 1.5 * np.pi


def split_turns(
    machine: Machine, pieces: Sequence[Piece], here: Array
) -> tuple[list[list[Piece]], list[Array]]:
    """Cut pieces so that coordinates near one point identify the turns of axes along each part.

    A pose does not say in which turn an axis is, or to which side an elbow points. Returns the
    parts of each piece, and the coordinates (n,) to which those of each part are nearest. Pieces of
    a machine without turns and elbows are not cut.

    here  coordinates (n,) near which the path starts
    """
    if not machine.branched:
        return [[piece] for piece in pieces], [machine.home_q] * len(pieces)
    rotary = np.array([axis.kind == "rotary" for axis in machine.axes])
    parts: list[list[Piece]] = []
    near: list[Array] = []
    for piece in pieces:
        q = _follow_coordinates(machine, piece, here, rotary)
        if not np.isfinite(q).all():  # out of reach: the proof of feasibility says where
            parts.append([piece])
            near.append(here)
            continue
        here = q[-1]
        count = 1
        while count < len(q) // 2 and _find_turn(q[:, rotary], count) > MAX_PART_TURN:
            count *= 2
        parts.append(piece.cut(count))
        near += [(cell.min(0) + cell.max(0)) / 2 for cell in _split_equally(q, count)]
    return parts, near


def _follow_coordinates(machine: Machine, piece: Piece, here: Array, rotary: np.ndarray) -> Array:
    """Return coordinates (M, n) along a piece, without jumps, from those near `here` on."""
    points = FIRST_POINTS
    while True:
        x = _poses(piece, points)
        first = machine.inverse_map(machine.inputs(x[:1], here))
        q = machine.inverse_map(machine.inputs(x, first[0]))
        q[:, rotary] = np.unwrap(q[:, rotary], axis=0)
        steps = np.abs(np.diff(q[:, rotary], axis=0))
        if points >= MAX_POINTS or not steps.max(initial=0.0) > MAX_TURN_STEP:
            return q
        points = 2 * points - 1


def _find_turn(q: Array, count: int) -> float:
    """Return the largest turn (rad) of an axis along any of `count` equal parts."""
    return max(float(np.ptp(part, axis=0).max(initial=0.0)) for part in _split_equally(q, count))


def _split_equally(q: Array, count: int) -> list[Array]:
    """Return equal parts, each with both ends; the number of steps is a multiple of `count`."""
    step = (len(q) - 1) // count
    return [q[k * step : (k + 1) * step + 1] for k in range(count)]


def _poses(piece: Piece, points: int) -> Array:
    return piece.poses(piece.start + np.linspace(0.0, piece.length, points))


# Points of each piece at which its pose is compared with what the machine controls.
FREEDOM_POINTS = 17

Derivatives = tuple[Array, ...]
"""q, q′, q″, q‴ by path length, up to the order that was asked for, each (N, n)."""


HIGHEST_RATE = 3
"""Highest derivative of a pose: limits on jerk need it."""


def check_rate(times: int) -> int:
    """Return the order of a derivative of the pose.

    Raises MotionError for one that is not supported.
    """
    if isinstance(times, bool) or times not in range(HIGHEST_RATE + 1):
        raise MotionError(f"derivative {times!r:.20} of a pose is not supported: give 0, 1, 2 or 3")
    return int(times)


@dataclass(frozen=True, slots=True)
class Points:
    """N points of a path at s (N,) on pieces (N,), for the rows of limits.

    derivatives  q, q′, q″, and q‴ where jerk is limited
    """

    path: "ActuatorPath"
    s: Array
    piece: np.ndarray
    derivatives: Derivatives

    @property
    def pose_derivatives(self) -> Derivatives:
        """Numbers of the pose and their first two derivatives by path length, each (N, 12)."""
        every = self.path.pose_derivatives(self.s, self.piece, 2)
        assert every is not None  # only machines have limits on their pose
        return every

    @property
    def tool_derivatives(self) -> Derivatives:
        """Numbers of the tool and their derivatives: the platform's where there is no tool."""
        tool = self.path.tool
        if tool is None:
            return self.pose_derivatives
        return tuple(tool(values) for values in self.pose_derivatives)

    def pose_derivative(self, times: int) -> Array:
        """Return a derivative (N, 12) of the pose's numbers by path length, of order 0, 1, 2 or 3.

        Raises MotionError for another order.
        """
        times = check_rate(times)
        every = self.path.pose_derivatives(self.s, self.piece, times)
        assert every is not None  # only machines have limits on their pose
        return every[times]

    def tool_derivative(self, times: int) -> Array:
        """Return this derivative of the tool's numbers: the platform's where there is no tool."""
        numbers = self.pose_derivative(times)
        tool = self.path.tool
        return numbers if tool is None else tool(numbers)


def make_points(path: "ActuatorPath", s: Array, piece: np.ndarray, highest: int = 3) -> Points:
    return Points(path, s, piece, path.derivatives(s, piece, highest))


class ActuatorPath(Protocol):
    """q(s) of n axes: P smooth pieces between `breaks` (P+1,).

    For s on a break the piece's index tells the side.
    """

    @property
    def breaks(self) -> Array: ...
    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def dwells(self) -> Array:
        """Rest (P+1,) in s at each break."""

    @property
    def turns(self) -> Array:
        """Angle (P,) in rad by which each piece bends or turns: more turn, finer grids."""

    @property
    def end_speeds(self) -> tuple[float, float]:
        """ṡ with which a motion begins and ends: 0 is rest."""

    @property
    def end_accelerations(self) -> tuple[float, float]:
        """s̈ with which a motion under jerk limits begins and ends.

        0, unless it continues another motion, or another continues it.
        """

    def constant(self, piece: int) -> float | None:
        """Return ṡ that is required on a piece, except on ramps at its segment's ends; or None."""

    def stops(self, order: int) -> np.ndarray:
        """Return at which breaks (P+1,) a motion of an order has to rest.

        Order 2 limits acceleration, order 3 jerk.
        """

    @property
    def content(self) -> Hashable:
        """All that defines its geometry: paths of equal content lead through the same places."""

    @property
    def tool(self) -> Expression | None:
        """Map from the platform's twelve numbers, or their rates, to the tool's; None: equal."""

    def segment(self, piece: int) -> int | None:
        """Return the number of a piece's segment, from 1; None without a program."""

    def place(self, s: float, piece: int, t: float | None = None, axis: str = "") -> Place:
        """Return the place at path length s of a piece, for messages."""

    def parameter(self, s: Array, piece: np.ndarray) -> Array:
        """Return the parameter (N,) of the given path: s, unless that was redrawn by its length."""

    def derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives: ...
    def axis_derivatives(
        self, axis: int, s: Array, piece: np.ndarray, highest: int = 3
    ) -> Derivatives:
        """Return the derivatives of one axis, each (N, 1), in a fraction of the time."""

    def pose_numbers(self, s: Array, piece: np.ndarray) -> Array | None:
        """Return the numbers (N, 12) of the pose, or None without a machine."""

    def pose_derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives | None:
        """Return x, x′, x″, x‴ of the pose by path length, each (N, 12); None: no machine."""

    def enclose(self, s: Series, piece: np.ndarray) -> Series:
        """Return q (order+1, N, n) as a series in the variable of the series s (order+1, N)."""

    def enclose_pose(self, s: Series, piece: np.ndarray) -> Series | None:
        """Return the pose's numbers (order+1, N, 12) as a series, or None without a machine."""


def has_constant_speed(path: ActuatorPath) -> bool:
    """Return whether a path states a constant speed for any of its pieces."""
    return any(path.constant(piece) is not None for piece in range(len(path.breaks) - 1))


# Maps of a machine that are retained, those used last: a formula has a shape of its own.
MOST_MAPS = 512


class _Maps(OrderedDict[Hashable, Expression]):
    """Maps of a machine along paths, by what makes them, and for which shape and settings.

    They depend on its geometry alone, so that copies of the machine share them. Other processes
    make their own.
    """

    def __init__(self, machine: Machine) -> None:
        super().__init__()
        self.machine = machine

    def __reduce__(self) -> tuple[type["_Maps"], tuple[Machine]]:
        return _Maps, (self.machine,)


def _find_map(
    machine: Machine,
    make: Callable[..., Expression],
    *settings: Hashable,
) -> Expression:
    """Return what a function makes of a machine, a shape and settings; made once."""
    maps = machine.derive(_Maps)
    key = (make, *settings)
    made = maps.pop(key, None)
    if made is None:
        made = make(maps.machine, *settings)
    maps[key] = made  # the most recent is the last
    while len(maps) > MOST_MAPS:
        maps.popitem(last=False)
    return made


def _make_symbols(machine: Machine, shape: Shape) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return symbols of s, of a shape's parameters, and of near coordinates."""
    s = ca.SX.sym("s")
    return s, ca.SX.sym("parameters", shape.size), ca.SX.sym("near", len(machine.axes))


def _actuator_map(machine: Machine, shape: Shape, highest: int) -> Expression:
    """Compose the inverse map with a shape: (s, parameters, near) -> q, q′, q″, q‴."""
    s, parameters, near = _make_symbols(machine, shape)
    q = machine.symbolic(column(*shape.motion(s, parameters)), near)
    return differentiate(f"{shape.name}_actuated", q, s, ca.vertcat(s, parameters, near), highest)


def _axis_map(machine: Machine, shape: Shape, highest: int, axis: int) -> Expression:
    """Select one axis of an actuator map."""
    width = len(machine.axes)
    return _find_map(machine, _actuator_map, shape, highest).select_rows(
        range(axis, (highest + 1) * width, width)
    )


def _pose_numbers_map(machine: Machine, shape: Shape, highest: int) -> Expression:
    """Return the map (s, parameters, near) -> the pose's numbers x, x′, x″, x‴.

    Components of the pose that follow the others, as on a tripod, are filled in.
    """
    s, parameters, near = _make_symbols(machine, shape)
    position, rotation = shape.motion(s, parameters)
    if machine.follows:
        q = machine.symbolic(column(position, rotation), near)
        position, rotation = machine.fill_pose(position, rotation, q)
    inputs = ca.vertcat(s, parameters, near)
    return differentiate(f"{shape.name}_posed", column(position, rotation), s, inputs, highest)


def _position_map(machine: Machine, shape: Shape) -> Expression:
    """Select the position and its first derivative, without the work for the rotation."""
    return _find_map(machine, _pose_numbers_map, shape, 1).select_rows([0, 1, 2, 12, 13, 14])


class MachinePath:
    """A path in space, in the coordinates of a machine's actuators."""

    def __repr__(self) -> str:
        length = f"{1e3 * self.breaks[-1]:.6g} mm"
        return f"<MachinePath on {self.machine.name}: {length}, pieces: {len(self.pieces)}>"

    def __init__(
        self,
        machine: Machine,
        pieces: Sequence[Piece],
        stops: np.ndarray,
        dwells: Array,
        blends: Sequence[Blended] = (),
        fits: Sequence[Fitted] = (),
        overshoots: Sequence[Overshoot] = (),
        *,
        tool: "Pose | None" = None,
        end_speeds: tuple[float, float] = (0.0, 0.0),
        end_accelerations: tuple[float, float] = (0.0, 0.0),
        near: Array | None = None,
        origin: tuple[float, float] = (0.0, 0.0),
        avoidable: Collection[int] = (),
    ) -> None:
        """Place P pieces one after the other.

        stops       (P+1,) order from which on a motion rests at an end of pieces: 0 never, 1
                    always, as at the first and the last end
        dwells      (P+1,) s, rest at each end
        blends      outcomes of the joins that ask for a blend
        fits        outcomes of the chains of segments that ask for curves
        overshoots  distances of splines from their polygons
        tool        frame of the tool in the platform's; None: the platform's. Pieces that are
                    drawn by length are measured along the tool's path
        end_speeds, end_accelerations  ṡ and s̈ with which a motion begins and ends
        near        (n,) coordinates near which it starts; None: those at home
        origin      path length and time (s) at which it begins as a part of another path: names of
                    places count from there
        avoidable   numbers, from 1, of the given pieces that end in an avoidable stop
        """
        self.end_speeds = end_speeds
        self.end_accelerations = end_accelerations
        self.origin = origin
        self.tool = None if tool is None else tool_map(tool)
        self._enclosed: tuple[Series, np.ndarray, Series] | None = None
        parts, nearest = split_turns(machine, pieces, machine.home_q if near is None else near)
        self.machine = machine
        self.pieces = tuple(part for each in parts for part in each)
        self.blends = tuple(blends)
        self.fit = summarise_fits(fits, blends)
        self.overshoots = tuple(overshoots)
        self.breaks: Array = freeze_array(
            np.concatenate([[0.0], np.cumsum([piece.length for piece in self.pieces])])
        )
        self.ends = ends = np.concatenate([[0], np.cumsum([len(each) for each in parts])])
        self._stops = freeze_array(_pad_part_ends(ends, stops))
        self.dwells = freeze_array(_pad_part_ends(ends, dwells))
        self.names = tuple(axis.name for axis in machine.axes)
        self.turns: Array = freeze_array([piece.turn for piece in self.pieces])
        self._near = np.array(nearest)
        self._start = np.array([piece.start for piece in self.pieces])
        self._shapes = list({piece.shape: None for piece in pieces})
        self._shape_of = np.array([self._shapes.index(piece.shape) for piece in self.pieces])
        self._inputs = [self._tabulate_inputs(shape) for shape in self._shapes]
        self._avoidable = frozenset(avoidable)
        self._refuse()

    def _tabulate_inputs(self, shape: Shape) -> Array:
        """Return the inputs (P, k) of a shape's maps: 0 for s, its parameters, and near.

        Pieces of other shapes have parameters of 0.
        """
        other = np.zeros(shape.size)
        parameters = [piece.parameters if piece.shape == shape else other for piece in self.pieces]
        return np.column_stack([np.zeros(len(parameters)), parameters, self._near])

    def _refuse(self) -> None:
        """Raise NotFree for a path that moves what the machine does not control."""
        piece = np.repeat(np.arange(len(self.pieces)), FREEDOM_POINTS)
        s = (
            self.breaks[:-1, None]
            + np.diff(self.breaks)[:, None] * np.linspace(0, 1, FREEDOM_POINTS)
        ).ravel()
        shares = self._evaluate(pose_map, s, piece)

        def find_place(k: int) -> Place:
            return self.place(float(s[k]), int(piece[k]))

        try:
            refuse_uncontrolled(self.machine, shares, lambda k: f"the path at {find_place(k)}")
        except NotFree as error:
            raise error.in_segment(find_place(error.pose).segment) from None

    @property
    def content(self) -> Hashable:
        maps = self.machine.inverse_map, self.machine.carried_map if self.machine.follows else None
        numbers = self.breaks, self.turns, self._start, self._shape_of, *self._inputs
        return maps, tuple(self._shapes), tuple(each.tobytes() for each in numbers)

    def describe_pieces(self, first: int, last: int) -> Hashable:
        """Return all that defines geometry and caps of pieces first … last, but no places."""
        pieces = tuple(piece.content for piece in self.pieces[first : last + 1])
        return (
            pieces,
            self._near[first : last + 1].tobytes(),
            self._stops[first + 1 : last + 1].tobytes(),
        )

    def constant(self, piece: int) -> float | None:
        return self.pieces[piece].tool_speed if self.pieces[piece].constant else None

    @property
    def joins(self) -> np.ndarray:
        """Order (P+1,) from which on a motion rests at each break: 0 never, 1 always."""
        return self._stops

    def stops(self, order: int) -> np.ndarray:
        return np.asarray((self._stops > 0) & (self._stops <= order))

    def avoidable_stops(self, order: int) -> np.ndarray:
        """Return at which breaks (P+1,) a motion of an order rests without a stated reason.

        Reasons are a dwell, a stated stop, a trigger at a stop, and a reversal of the path.
        """
        avoidable = np.zeros(len(self._stops), bool)
        avoidable[self.ends[sorted(self._avoidable)]] = True
        return np.asarray(self.stops(order) & avoidable)

    def segment(self, piece: int) -> int:
        return self.pieces[piece].segment

    def place(self, s: float, piece: int, t: float | None = None, axis: str = "") -> Place:
        length, time = self.origin
        return Place(
            float(length + s),
            self.pieces[piece].segment,
            None if t is None else float(time + t),
            axis,
            self.pieces[piece].repetition,
        )

    def parameter(self, s: Array, piece: np.ndarray) -> Array:
        return s

    def derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives:
        every = self._evaluate(self._maps(_actuator_map, highest), s, piece)
        return _split_columns(every, highest + 1)

    def axis_derivatives(
        self, axis: int, s: Array, piece: np.ndarray, highest: int = 3
    ) -> Derivatives:
        every = self._evaluate(self._maps(_axis_map, highest, axis), s, piece)
        return _split_columns(every, highest + 1)

    def pose_numbers(self, s: Array, piece: np.ndarray) -> Array:
        x = self._evaluate(pose_map, s, piece)
        if not self.machine.follows:
            return x
        return self.machine.carried_map(self.machine.inputs(x, self._near[piece]))

    def pose_derivatives(self, s: Array, piece: np.ndarray, highest: int = 3) -> Derivatives:
        every = self._evaluate(self._maps(_pose_numbers_map, highest), s, piece)
        return _split_columns(every, highest + 1)

    def position_derivatives(self, s: Array, piece: np.ndarray) -> tuple[Array, Array]:
        """Return the platform's origin and its derivative by path length, each (N, 3)."""
        both = self._evaluate(self._maps(_position_map), s, piece)
        return both[:, :3], both[:, 3:]

    def _maps(
        self, make: Callable[..., Expression], *settings: Hashable
    ) -> Callable[[Shape], Expression]:
        """Return the machine's maps by shape."""
        return lambda shape: _find_map(self.machine, make, shape, *settings)

    def _evaluate(
        self, expression: Callable[[Shape], Expression], s: Array, piece: np.ndarray
    ) -> Array:
        """Evaluate a map of each shape at the places on pieces of this shape."""
        local = s - self.breaks[piece] + self._start[piece]
        out = np.empty((len(s), expression(self._shapes[0]).size[1]))
        for k, shape in enumerate(self._shapes):
            chosen = np.flatnonzero(self._shape_of[piece] == k)
            mapped = expression(shape)
            inputs = self._inputs[k][:, : mapped.size[0]].take(piece[chosen], axis=0)
            inputs[:, 0] = local[chosen]
            out[chosen] = mapped(inputs)
        return out

    def enclose(self, s: Series, piece: np.ndarray) -> Series:
        return self.machine.inverse_map.enclose_columns(self.enclose_inputs(s, piece))

    def enclose_pose(self, s: Series, piece: np.ndarray) -> Series:
        inputs = self.enclose_inputs(s, piece)
        if not self.machine.follows:
            return inputs[:, :12]
        return self.machine.carried_map.enclose_columns(inputs)

    def jacobian(self, s: Series, piece: np.ndarray) -> Series:
        """Return the square Jacobian (order+1, N, n · n), row by row.

        Columns of rotation are divided by the characteristic length.
        """
        entries = self.machine.controlled_map.enclose_columns(self.enclose_inputs(s, piece))
        scale = np.where(columns(self.machine) < 3, 1.0, 1 / self.machine.characteristic_length)
        return entries * np.tile(scale, len(self.names))

    def enclose_inputs(self, s: Series, piece: np.ndarray) -> Series:
        """Return the inputs of the machine's maps along the path: (order+1, N, k).

        Several maps take the same inputs, so the last ones are retained.
        """
        if (
            self._enclosed is not None
            and self._enclosed[0] is s
            and np.array_equal(self._enclosed[1], piece)
        ):
            return self._enclosed[2]
        pose = Series.zeros(s.order, (len(piece), 12))
        local = (s - self.breaks[piece] + self._start[piece])[:, None]
        for k, shape in enumerate(self._shapes):
            chosen = np.flatnonzero(self._shape_of[piece] == k)
            if len(chosen):
                parameters = Series.constant(
                    self._inputs[k][piece[chosen], 1 : 1 + shape.size], s.order
                )
                pose.put(chosen, pose_map(shape).enclose_columns(local[chosen], parameters))
        if self.machine.branched:
            near = Series.constant(self._near[piece], s.order).pad(s.order)
            pose = Series(
                np.concatenate([pose.mid, near.mid], 2),
                np.concatenate([pose.rad, near.rad], 2),
                s.order,
            )
        self._enclosed = s, piece, pose
        return pose

    def __getstate__(self) -> dict[str, object]:
        return self.__dict__ | {"_enclosed": None}


def _split_columns(values: Array, parts: int) -> Derivatives:
    width = values.shape[1] // parts
    return tuple(values[:, first : first + width] for first in range(0, values.shape[1], width))


def _pad_part_ends(ends: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values at the ends of whole pieces, and 0 at the ends between their parts."""
    out = np.zeros(ends[-1] + 1, values.dtype)
    out[ends] = values
    return out


def actuate(program: Program, machine: Machine) -> MachinePath:
    """Return the path of a program in the coordinates of a machine's actuators.

    Raises MotionError with the segment that cannot be drawn.
    """
    chain = chain_pieces(program, machine)
    path = MachinePath(
        machine,
        chain.pieces,
        chain.stops,
        chain.dwells,
        chain.blends,
        chain.fits,
        chain.overshoots,
        tool=program.tool,
        avoidable=chain.avoidable,
    )
    stated = np.array([program.start_speed, program.end_speed])
    if stated.any():  # speeds of the tool, whose path length may differ from s
        ends = make_points(path, path.breaks[[0, -1]], np.array([0, len(path.pieces) - 1]), 2)
        slope = np.linalg.norm(ends.tool_derivatives[1][:, :3], axis=1)
        first, last = stated / np.where(stated > 0, slope, 1.0)
        path.end_speeds = float(first), float(last)
    return path
