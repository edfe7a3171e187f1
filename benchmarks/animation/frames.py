"""The frames of an animation: the machine at even instants of a plan, its use of limits, and both
paths.

For every axis and the tool, a frame has the limit that is nearest to its bound, and the tilt of the
joints. They come from the limits' own `value` and `use`, as the certificate does. This module also
has the four views, and the colours of a limit's use.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import casadi as ca
import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.machine.kind import Bar, Pivot, PlacedSkeleton
from kinematics.machine.machine import Machine
from kinematics.machine.model import place_skeleton
from kinematics.machine.pose import from_numbers
from planner.limits import Limit
from planner.limits.geometric import Tilt
from planner.program.model import Program
from planner.pulses import PulseSchedule
from planner.pulses.motion import find_reached_poses
from planner.shaping.shaped_motion import find_copies
from planner.trajectory import State, Trajectory

TOOL = "tool"
"""Owner of limits that belong to no axis: the caps of a program."""
NO_LIMIT = -1
"""Index in `which` of an owner without a limit."""


@dataclass(frozen=True, slots=True)
class NearestLimit:
    """At N instants, the use of each owner's limit that is nearest to its bound (N, owners), and
    its index in `limits`.

    owners  the axes, and the tool where anything limits it
    """

    owners: tuple[str, ...]
    limits: tuple[str, ...]
    use: Array
    which: np.ndarray


def nearest(limits: Sequence[Limit], state: State, axes: Sequence[str]) -> NearestLimit:
    """Return the owners of all limits but tilt, which belongs to the joints.

    A clearance belongs to both legs.
    """
    owners = (*axes, TOOL)
    use, which = (
        np.zeros((len(state.t), len(owners))),
        np.full((len(state.t), len(owners)), NO_LIMIT),
    )
    for n, limit in enumerate(limits):
        if isinstance(limit, Tilt):
            continue
        value = limit.value(state)
        shares = limit.use(value, value, state.piece)
        for channel, share in zip(limit.channels, shares.T, strict=True):
            for owner in _owners(channel, axes):
                beats = (share > use[:, owner]) | (which[:, owner] == NO_LIMIT)
                use[beats, owner], which[beats, owner] = share[beats], n
    count = len(owners) if (which[:, -1] != NO_LIMIT).any() else len(axes)
    names = tuple(limit.name for limit in limits)
    return NearestLimit(
        owners[:count], names, freeze_array(use[:, :count]), freeze_array(which[:, :count], int)
    )


def tilt_use(limits: Sequence[Limit], state: State, joints: Sequence[str]) -> Array:
    """(N, joints) share of the tilt limit; NaN for joints that have none."""
    use = np.full((len(state.t), len(joints)), np.nan)
    for limit in limits:
        if isinstance(limit, Tilt):
            value = limit.value(state)
            shares = limit.use(value, value, state.piece)
            for k, name in enumerate(joints):
                if name in limit.channels:
                    use[:, k] = shares[:, limit.channels.index(name)]
    return freeze_array(use)


def _owners(channel: str, axes: Sequence[str]) -> list[int]:
    """Indices of those a channel belongs to: an axis, both legs of a pair ("leg1–leg2"), else the
    tool, the last.
    """
    named = {channel, *channel.split("–")}
    return [n for n, axis in enumerate(axes) if axis in named] or [len(axes)]


MIN_PATH_INSTANTS, PATH_INSTANT_RATE, MAX_PATH_INSTANTS = 1200, 100.0, 6000
"""Instants at which both paths are drawn, evenly in time: at least; 1/s of a motion that lasts
longer; at most, so that the page stays small.
"""
DRAWN_ERROR_SHARE, PLAIN_LENGTH = 0.01, 6.0
"""Share of the path's size that the largest error of the pulses is drawn as, at most, if nothing
else is asked for; and how many times its size a path is long, from which on it is less: what lies
beside each other is not to cross.
"""
TOOL_AXES_SHARE = 0.15
"""Share of the path's extent that the axes of the tool are long, by which a machine without a
skeleton is drawn.
"""
FLATNESS_SHARE = 1e-6
"""Share of its size up to which a machine lies in one plane."""


class AnimatablePlan(Protocol):
    """The data that an animation draws, as a plan or a `DrawnPlan` has them."""

    @property
    def program(self) -> Program: ...
    @property
    def machine(self) -> Machine: ...
    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def limits(self) -> tuple[Limit, ...]: ...
    @property
    def pulses(self) -> PulseSchedule: ...


@dataclass(frozen=True, slots=True)
class DrawnPlan:
    """A plan that was taken up again, as far as it is shown."""

    program: Program
    machine: Machine
    trajectory: Trajectory
    limits: tuple[Limit, ...]
    pulses: PulseSchedule


@dataclass(frozen=True)
class Frames:
    """The machine at instants t (N,) s, everything in the base frame, m.

    bars, pivots  what the skeleton consists of, and the tool's shank; of a machine without a
                  skeleton the tool's axes
    placed        where they are
    tool          (N, 3) its place: the platform's origin's where there is none
    axes, units   names of the axes, and m or rad of each
    q             (N, axes) their coordinates, which are `what`: lengths of legs between joints, or
                  positions
    pose          (N, 6) x, y, z (m) of the tool and θx, θy, θz (rad) of the platform, in the frame
                  of the home pose
    nearest, tilt how near every axis, the tool and each pivot (N, pivots) are to their limits
    planned       (M, 3) the path of the tool, evenly in time
    errors        (M, 3) by how much the pulses' path is off there; None where counts stand for no
                  pose
    magnified     how many times the errors are drawn
    shaped        whether the pulses are behind input shapers, and all else is before them
    """

    program: str
    machine: str
    t: Array
    bars: tuple[Bar, ...]
    pivots: tuple[Pivot, ...]
    placed: PlacedSkeleton
    tool: Array
    nearest: NearestLimit
    tilt: Array
    planned: Array
    errors: Array | None
    magnified: float
    shaped: bool
    axes: tuple[str, ...]
    units: tuple[str, ...]
    q: Array
    pose: Array
    what: str

    def use_of(self, owners: Sequence[str]) -> Array:
        """Return (N, owners) the use of each owner's nearest limit; NaN: no limit concerns it."""
        known = self.nearest
        uses = [
            known.use[:, known.owners.index(owner)] if owner in known.owners else np.nan
            for owner in owners
        ]
        return np.stack([np.broadcast_to(use, self.t.shape) for use in uses], 1)

    @cached_property
    def realised(self) -> Array | None:
        """(M, 3) the path that the pulses make, its errors magnified."""
        return None if self.errors is None else self.planned + self.magnified * self.errors

    @cached_property
    def box(self) -> Array:
        """(2, 3) the least and the greatest of all that is drawn."""
        drawn = [self.placed.bars.reshape(-1, 3), self.placed.pivots.reshape(-1, 3), self.planned]
        points = np.concatenate(drawn)
        return np.stack([points.min(0), points.max(0)])

    @property
    def flat(self) -> bool:
        """Return whether the whole scene lies in one plane, z = constant."""
        return bool(np.ptp(self.box[:, 2]) <= FLATNESS_SHARE * self.size)

    @property
    def size(self) -> float:
        """m of the box's diagonal."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))


def compute_frames(plan: AnimatablePlan, t: Array, magnified: float | None = None) -> Frames:
    """The frames at instants t (N,) s; magnified: as `magnification` chooses by default, 1 is true
    scale.
    """
    machine = plan.machine
    state = plan.trajectory.at(t)
    x = _numbers(state)
    along = even_instants(plan.trajectory, count_instants(plan.trajectory.duration))
    poses = _numbers(plan.trajectory.at(along))
    planned = _tool(plan, poses)
    copies = find_copies(machine.axes)
    late = (
        along if copies is None else along + copies.centre
    )  # behind input shapers, by the path where it was
    try:
        errors = _tool(plan, find_reached_poses(machine, plan.pulses, late, poses)) - planned
    except MotionError:  # singular on the way: `plan` tells it too
        errors = None
    pivots, tool = machine.parts.pivots, _tool(plan, x)
    bars, placed = _add_tool_bar(plan, place_skeleton(machine, x, state.q), x[:, :3], tool)
    if not bars:
        bars, placed = _draw_tool_axes(
            placed, x, tool, float(np.linalg.norm(np.ptp(planned, axis=0)))
        )
    return Frames(
        plan.program.name,
        machine.name,
        freeze_array(t),
        bars,
        pivots,
        placed,
        freeze_array(tool),
        nearest(plan.limits, state, [axis.name for axis in machine.axes]),
        tilt_use(plan.limits, state, [pivot.name for pivot in pivots]),
        freeze_array(planned),
        None if errors is None else freeze_array(errors),
        magnification(planned, errors) if magnified is None else magnified,
        copies is not None,
        tuple(axis.name for axis in machine.axes),
        tuple(axis.unit for axis in machine.axes),
        freeze_array(state.q),
        freeze_array(_home_frame_pose(machine, x, tool)),
        "length" if machine.lengths else "position",
    )


def _home_frame_pose(machine: Machine, x: Array, tool: Array) -> Array:
    """(N, 6) where the tool is and how the platform is turned, as programs in the frame "home" say
    it.
    """
    back = machine.home.inv()
    angles = (back * from_numbers(x)).rotation.as_euler("XYZ", suppress_warnings=True)
    return np.concatenate([back.apply(tool), angles], 1)


def even_instants(trajectory: Trajectory, count: int) -> Array:
    """(count,) instants from the start of a motion to its end, evenly."""
    return np.linspace(0.0, trajectory.duration, count)


def count_instants(duration: float) -> int:
    """At how many instants the paths of a motion of `duration` s are drawn."""
    return int(np.clip(PATH_INSTANT_RATE * duration, MIN_PATH_INSTANTS, MAX_PATH_INSTANTS))


def magnification(planned: Array, errors: Array | None) -> float:
    """1, 2 or 5 times a power of ten that draws the largest error at most DRAWN_ERROR_SHARE of the
    path's size; 1 at least.
    """
    largest = 0.0 if errors is None else float(np.linalg.norm(errors, axis=1).max())
    if largest == 0.0:
        return 1.0
    size = float(np.linalg.norm(np.ptp(planned, axis=0)))
    length = float(np.linalg.norm(np.diff(planned, axis=0), axis=1).sum())
    room = DRAWN_ERROR_SHARE * size / max(1.0, length / (PLAIN_LENGTH * (size or 1.0))) / largest
    steps = [step * 10.0**power for power in range(12) for step in (1, 2, 5)]
    return max([step for step in steps if step <= room], default=1.0)


def _add_tool_bar(
    plan: AnimatablePlan, placed: PlacedSkeleton, origin: Array, tip: Array
) -> tuple[tuple[Bar, ...], PlacedSkeleton]:
    """The machine's bars, and one from the platform's origin to the tool's where that lies
    elsewhere, both (N, 3).
    """
    bars, tool = plan.machine.parts.bars, plan.trajectory.path.tool
    if tool is None or not (tip != origin).any():
        return bars, placed
    x = ca.SX.sym("x", 12)
    shank = np.stack([origin, tip], 1)[:, None]
    return (
        (*bars, Bar("platform", x[:3], tool.function(x)[:3])),
        PlacedSkeleton(freeze_array(np.concatenate([placed.bars, shank], 1)), placed.pivots),
    )


def _draw_tool_axes(
    placed: PlacedSkeleton, x: Array, tip: Array, extent: float
) -> tuple[tuple[Bar, ...], PlacedSkeleton]:
    """Return the tool's three axes at its place (N, 3), for a machine without a skeleton.

    extent: size (m) of the path, which scales them; 0: as for a metre
    """
    length = TOOL_AXES_SHARE * (extent or 1.0)
    ends = tip[:, None] + length * x[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
    bars = np.stack([np.broadcast_to(tip[:, None], ends.shape), ends], 2)
    at = ca.SX.sym("x", 12)
    return (Bar("platform", at[:3], at[:3]),) * 3, PlacedSkeleton(freeze_array(bars), placed.pivots)


def _tool(plan: AnimatablePlan, x: Array) -> Array:
    """(N, 3) its place at the platform's pose numbers."""
    tool = plan.trajectory.path.tool
    return (x if tool is None else tool(x))[:, :3]


def _numbers(state: State) -> Array:
    x = state.path.pose_numbers(state.s, state.piece)
    if x is None:
        raise MotionError("this motion has no machine, so there is nothing to draw")
    return x


RAMP = ((0.0, "#B4C0CA"), (0.5, "#56B4E9"), (0.8, "#E69F00"), (1.0, "#C8102E"))
"""Share of a limit and its colour, straight between: ever darker, so that it reads without hue
too.
"""
NO_LIMIT_COLOUR = "#3C464E"
"""Colour of parts without a limit."""
PLANNED_COLOUR, REALISED_COLOUR = "#6B7178", "#009E73"
"""The two paths."""


@dataclass(frozen=True, slots=True)
class View:
    """From where one looks: towards the machine against `back`, with `up` upwards; both unit
    vectors, base frame.
    """

    name: str
    back: Array
    up: Array
    parallel: bool = True

    @property
    def right(self) -> Array:
        return np.cross(self.up, self.back)


def _view(name: str, back: tuple[float, ...], up: tuple[float, ...], parallel: bool = True) -> View:
    return View(
        name, freeze_array(np.array(back) / np.linalg.norm(back)), freeze_array(up), parallel
    )


VIEWS = (
    _view("top", (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    _view("front", (0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    _view("side", (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    _view("3-D", (1.0, -1.5, 0.9), (0.0, 0.0, 1.0), parallel=False),
)


def colour_uses(use: Array) -> np.ndarray:
    """Return (…, 3) uint8 colours of shares of a limit; NaN: the plain colour."""
    shares = np.clip(use, 0.0, 1.0)
    places = [place for place, _ in RAMP]
    stops = np.array([parse_colour(colour) for _, colour in RAMP])
    mixed = np.stack([np.interp(np.nan_to_num(shares), places, channel) for channel in stops.T], -1)
    return np.where(np.isnan(use)[..., None], parse_colour(NO_LIMIT_COLOUR), np.rint(mixed)).astype(
        np.uint8
    )


def parse_colour(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of "#RRGGBB"."""
    red, green, blue = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue
