"""Which limits there are: one line each."""

from collections.abc import Callable, Sequence

from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from planner.limits.axis import Acceleration, Jerk, PulseRate, Speed
from planner.limits.force import Force, Holding, TorqueSpeed
from planner.limits.geometric import Clearance, Tilt, Travel
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.limits.tool import AngularSpeed, ToolAcceleration, ToolSpeed
from planner.path.actuation import ActuatorPath, MachinePath

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
    Tilt: lambda machine, path: Tilt(machine),
    Clearance: lambda machine, path: Clearance(machine),
    ToolSpeed: lambda machine, path: ToolSpeed(piece.tool_speed for piece in path.pieces),
    ToolAcceleration: lambda machine, path: ToolAcceleration(piece.tool_acceleration for piece in path.pieces),
    AngularSpeed: lambda machine, path: AngularSpeed(piece.angular_speed for piece in path.pieces),
    Holding: lambda machine, path: Holding(machine),
    Force: Force,
    TorqueSpeed: TorqueSpeed,
}


def limits_of(path: ActuatorPath, axes: Sequence[Axis], order: int) -> tuple[Limit, ...]:
    """The limits of a motion of an order (2: to acceleration, 3: to jerk) along a path, if they bind anything."""
    limits = [make(axes) for least, make in AXIS_LIMITS.values() if least <= order]
    if isinstance(path, MachinePath):
        limits += [make(path.machine, path) for make in MACHINE_LIMITS.values()]
    return tuple(limit for limit in limits if limit.binds)


def geometric_limits() -> tuple[str, ...]:
    """Names of the limits that no timing can help: those without rows for a solver."""
    return tuple(limit.name for limit in (*AXIS_LIMITS, *MACHINE_LIMITS) if limit.rows is Limit.rows)


def usual_order(axes: Sequence[Axis]) -> int:
    """3 where some axis states a limit of jerk, else 2."""
    return 3 if any(axis.max_jerk is not None for axis in axes) else 2


# What an axis may state that says nothing where the machine states no masses, friction or wrench.
LOAD_LIMITS = ("max_force", "torque_speed")


def find_unkept_limits(machine: Machine) -> tuple[str, ...]:
    """The limits that some axis states and that no plan keeps, as its file calls them: nothing says what they bear."""
    stated = tuple(field for field in LOAD_LIMITS if any(getattr(axis, field) is not None for axis in machine.axes))
    return stated if stated and not machine.loaded else ()
