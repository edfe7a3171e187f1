"""Which limits there are: one line each; and those that one plan alone has beside them."""

from collections.abc import Callable, Iterator, Sequence
from inspect import signature
from itertools import groupby

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.limits.axis import Acceleration, Jerk, PulseRate, Speed
from planner.limits.force import Force, Holding, TorqueSpeed
from planner.limits.geometric import Clearance, Room, Tilt, Travel
from planner.limits.limit import Limit, Term
from planner.limits.resonance import Resonance
from planner.limits.tool import AngularSpeed, ToolAcceleration, ToolJerk, ToolSpeed, make_tool_jerk
from planner.path.actuation import ActuatorPath, MachinePath, make_points
from planner.program.model import Program
from planner.trajectory import unit_speed_trajectory

# Of the axes alone, with the order of motion that they belong to.
AXIS_LIMITS: dict[type[Limit], tuple[int, Callable[[Sequence[Axis]], Limit]]] = {
    Speed: (2, lambda axes: Speed(axes, [axis.max_speed for axis in axes])),
    Acceleration: (2, lambda axes: Acceleration(axes, [axis.max_acceleration for axis in axes])),
    PulseRate: (2, PulseRate),
    Resonance: (2, Resonance),
    Jerk: (3, lambda axes: Jerk(axes, [axis.max_jerk for axis in axes])),
}

# Of the machine and its path in space.
MACHINE_LIMITS: dict[type[Limit], Callable[[Machine, MachinePath], Limit]] = {
    Travel: lambda machine, path: Travel(machine.axes, machine.home_q),
    Room: lambda machine, path: Room(machine),
    Tilt: lambda machine, path: Tilt(machine),
    Clearance: lambda machine, path: Clearance(machine),
    ToolSpeed: lambda machine, path: ToolSpeed(piece.tool_speed for piece in path.pieces),
    ToolAcceleration: lambda machine, path: ToolAcceleration(
        piece.tool_acceleration for piece in path.pieces
    ),
    ToolJerk: lambda machine, path: make_tool_jerk(path),
    AngularSpeed: lambda machine, path: AngularSpeed(piece.angular_speed for piece in path.pieces),
    Holding: lambda machine, path: Holding(machine),
    Force: Force,
    TorqueSpeed: TorqueSpeed,
}

PLACELESS: frozenset[type[Limit]] = frozenset(
    {
        *(Speed, Acceleration, PulseRate, Resonance, Jerk),
        *(Travel, Room, Tilt, Clearance),
        *(ToolSpeed, ToolAcceleration, ToolJerk, AngularSpeed),
        *(Holding, Force, TorqueSpeed),
    }
)
"""Limits that are equal wherever geometry and caps of a piece are equal.

Equal runs are timed and proved once, unless a limit is missing here. A limit that depends on the
number of a piece or on the path length does not belong here: its proof in one place says nothing
about another.
"""


OwnLimit = Limit | Callable[[Machine, MachinePath], Limit]
"""A limit of a caller's own: itself, or what makes it for a machine and a path, where it depends on
them.
"""
# Of a caller, usually.
NO_LIMITS: tuple[OwnLimit, ...] = ()


def limits_of(
    path: ActuatorPath, axes: Sequence[Axis], order: int, own: Sequence[OwnLimit] = NO_LIMITS
) -> tuple[Limit, ...]:
    """The limits of a motion of an order (2: to acceleration, 3: to jerk) along a path, if they
    bind anything.

    own: limits beside those of the table. Raises MotionError for one that the motion cannot be held
    to.
    """
    limits = [make(axes) for least, make in AXIS_LIMITS.values() if least <= order]
    if isinstance(path, MachinePath):
        makers = [
            make
            for kind, make in MACHINE_LIMITS.items()
            if order == 3 or Term.SDDD not in kind.terms
        ]
        limits += [make(path.machine, path) for make in makers]
    found = [limit for limit in limits if limit.binds]
    for limit in () if own is NO_LIMITS else make_own_limits(path, own):
        if any(limit.name == other.name for other in found):
            raise MotionError(
                f'limits: there is a limit "{limit.name}" already; give yours a name of its own'
            )
        if Term.SDDD in limit.terms and order < 3:
            raise MotionError(
                f'limits: "{limit.name}" limits jerk, and the motion is of order {order}; give order=3'
            )
        if limit.binds:
            found.append(limit)
    return tuple(found)


def make_own_limits(path: ActuatorPath, own: Sequence[OwnLimit]) -> Iterator[Limit]:
    """A caller's own limits along a path.

    Raises MotionError for what is none, and for one that is not whole.
    """
    if not isinstance(own, Sequence):
        raise MotionError(
            f"limits must be a list of limits, as [PayloadAcceleration()], not {own!r:.80}"
        )
    for given in own:
        made: object = given
        if (
            not isinstance(given, Limit | type)
            and callable(given)
            and isinstance(path, MachinePath)
        ):
            made = _make_own(given, path)
        if not isinstance(made, Limit):
            raise MotionError(
                f"limits: {made!r:.80} is no limit: give an instance of planner.limits.Limit, or a function of the "
                "machine and the path that returns one"
            )
        _check_statement(made)
        _check_shapes(made, path)
        yield made


def _make_own(given: Callable[[Machine, MachinePath], object], path: MachinePath) -> object:
    try:
        signature(given).bind(path.machine, path)
    except TypeError as error:
        raise MotionError(
            f"limits: {given!r:.60} must take two arguments, the machine and the path: {error}"
        ) from None
    except ValueError:  # what is built in may state no signature
        pass
    return given(path.machine, path)


def _check_shapes(limit: Limit, path: ActuatorPath) -> None:
    """Raise MotionError for a limit whose value, use or rows are not (N, m), tried at some places
    of the path.
    """
    walk, channels = unit_speed_trajectory(path), len(limit.channels)
    state = walk.at(
        np.linspace(0.0, walk.duration, channels + 1)
    )  # not as many: rows and columns tell apart
    wanted = (len(state.t), channels)
    found = {"value": np.shape(limit.value(state))}
    if found["value"] == wanted:
        value = np.asarray(limit.value(state))
        found["use"] = np.shape(limit.use(value, value, state.piece))
    if not limit.geometric:
        rows = limit.rows(make_points(path, state.along, state.piece))
        width = np.shape(rows.bound)[-1:]  # facets of a round limit are more than its channels
        for term, each in rows.coefficients.items():
            if np.shape(each) != wanted[:1] + width:
                found[f"coefficient of {term.value}"] = np.shape(each)
    for what, shape in found.items():
        if shape != wanted:
            raise MotionError(
                f'limit "{limit.name}": its {what} is of shape {shape} at {count_noun(len(state.t), "place")}; '
                f"expected {wanted}, "
                f"a row for each place and a column for each channel ({', '.join(map(str, limit.channels))})"
            )


def _check_statement(limit: Limit) -> None:
    """Raise MotionError for a limit that leaves out what the table's own state, or states what does
    not agree.
    """
    named = f"limits: {type(limit).__name__}"
    if not isinstance(getattr(limit, "name", None), str) or not limit.name:
        raise MotionError(f"{named} has no name, by which the certificate calls it")
    missing = [part for part in ("channels", "bounds", "units") if not hasattr(limit, part)]
    if missing:
        raise MotionError(
            f'{named} "{limit.name}" states no {missing[0]}; see planner.limits.Limit'
        )
    bounds = np.asarray(limit.bounds)
    count = len(limit.channels)
    if bounds.shape != (count,) or len(limit.units) != count or not (bounds > 0).all():
        raise MotionError(
            f'{named} "{limit.name}": bounds and units must be {count}, one for each of its channels '
            f"({', '.join(map(str, limit.channels))}), and bounds above 0, not {bounds.tolist()!s:.80}"
        )
    strange = set(limit.terms) - set(Term)
    if strange:
        raise MotionError(
            f'{named} "{limit.name}": {strange!s:.80} are no terms; terms are of planner.limits.Term'
        )


def geometric_limits() -> tuple[str, ...]:
    """Names of the limits that no timing can help: those without rows for a solver."""
    return tuple(
        limit.name for limit in (*AXIS_LIMITS, *MACHINE_LIMITS) if limit.rows is Limit.rows
    )


AxisBounds = tuple[str, Array, Array, list[str]]
"""Speed, acceleration or jerk; (n,) its bounds towards smaller q and towards greater; what says so,
of each axis.
"""


def tabulate_axis_bounds(axes: Sequence[Axis], limits: Sequence[Limit], order: int) -> Table:
    """The most that each axis may do by the limits that a motion is planned with, and what says so.

    axes: as stated, by which a pulse rate that the clock lowers is told. Axes next to each other
    that may do the same share rows, and so do both directions. Forces are left out: what they allow
    depends on the place.
    """
    bounds = [found for limit in limits for found in _find_axis_bounds(limit, axes)]
    rows: list[tuple[str, str, float, str, str]] = []
    told = [list(_list_bounds(k, axis, bounds, order)) for k, axis in enumerate(axes)]
    for alike, group in groupby(range(len(axes)), key=told.__getitem__):
        names = [axes[k].name for k in group]
        some = ", ".join(names) if len(names) <= 3 else f"{names[0]} … {names[-1]}"
        rows += [("" if n else some, *row) for n, row in enumerate(alike)]
    shown, what, most, units, sources = zip(*rows, strict=True)
    forced = any(isinstance(limit, Force | TorqueSpeed) for limit in limits)
    return Table(
        "limits of the axes, as planned with",
        (
            Column("axis", shown),
            Column("limit", what),
            Column("at most", most, units, "human", words={"inf": "unlimited"}),
            Column("from", sources),
        ),
        ("forces may allow less acceleration",) if forced else (),
    )


def _find_axis_bounds(limit: Limit, axes: Sequence[Axis]) -> Iterator[AxisBounds]:
    match limit:
        case Speed():
            screws = [
                " of the motor, which makes up for its screw" if ratio > 1 else ""
                for ratio in limit.ratio
            ]
            said = [f"max_speed{screw}" for screw in screws]
            yield "speed", limit.below / limit.ratio, limit.bounds / limit.ratio, said
        case Acceleration() | Jerk():
            yield limit.name, limit.below, limit.bounds, [f"max_{limit.name}"] * len(axes)
        case PulseRate():
            most = limit.bounds * limit.pulse
            yield (
                "speed",
                most,
                most,
                [_tell_rate(axis, rate) for axis, rate in zip(axes, limit.bounds, strict=True)],
            )
        case Resonance():
            yield "speed", limit.below, limit.bounds, ["start of its resonance band"] * len(axes)
        case TorqueSpeed():
            ends = np.array(
                [limit.curves[k].fastest if k in limit.curves else np.inf for k in range(len(axes))]
            )
            yield "speed", ends, ends, ["end of its torque_speed curve"] * len(axes)


def _tell_rate(axis: Axis, rate: float) -> str:
    """A pulse rate that bounds an axis' speed, and the one that is stated where whole ticks hold
    less.
    """
    less = (
        f", of {axis.pulse_rate:.6g} stated: pulses are whole ticks apart"
        if rate < axis.pulse_rate
        else ""
    )
    return f"{rate:.6g} pulses/s of {1e6 * axis.pulse:.6g} µ{axis.unit}{less}"


def _list_bounds(
    k: int, axis: Axis, bounds: Sequence[AxisBounds], order: int
) -> Iterator[tuple[str, float, str, str]]:
    """Of axis k each limit, what it allows at most, its unit and what says so; directions apart
    where they differ.
    """
    for power, what in enumerate(("speed", "acceleration", "jerk")[:order], 1):
        unit = f"{axis.unit}/s{f'^{power}' if power > 1 else ''}"
        sides = [
            min(
                ((float(both[side][k]), said[k]) for of, *both, said in bounds if of == what),
                default=(np.inf, ""),
            )
            for side in (0, 1)
        ]
        ways = (
            ("",)
            if sides[0] == sides[1]
            else (" towards smaller positions", " towards greater positions")
        )
        for way, (most, said) in zip(ways, sides, strict=False):
            yield f"{what}{way}", most, unit, said if most < np.inf else ""


def usual_order(axes: Sequence[Axis], program: Program | None = None) -> int:
    """Return 3 where an axis states a limit of jerk or the program caps the tool's, else 2."""
    jerk = any(axis.max_jerk is not None for axis in axes)
    return 3 if jerk or (program is not None and program.caps_jerk) else 2


# What an axis may state that says nothing where the machine states no masses, friction or wrench.
LOAD_LIMITS = ("max_force", "torque_speed")


def find_unkept_limits(machine: Machine) -> tuple[str, ...]:
    """The limits that some axis states and that no plan keeps, as its file calls them: nothing says
    what they bear.
    """
    stated = tuple(
        field
        for field in LOAD_LIMITS
        if any(getattr(axis, field) is not None for axis in machine.axes)
    )
    return stated if stated and not machine.loaded else ()
