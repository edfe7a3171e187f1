"""The realised path: the pose to which the counts lead the mechanics, at every pulse, against the planned one."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Protocol

import numpy as np

from kinematics.array import Array, distinct, frozen
from kinematics.axis import Axis
from kinematics.errors import MotionError
from kinematics.freedom import COMPONENTS
from kinematics.machine import Machine
from kinematics.sensitivity import sensitivity
from planner.place import Place
from planner.pulses.axes_away import axes_away
from planner.pulses.compensate import Compensated
from planner.pulses.mechanics import carried, screw, told
from planner.pulses.motion import Motion
from planner.pulses.reached import poses
from planner.pulses.realised_path import RealisedError, RealisedPath
from planner.pulses.schedule import PulseSchedule
from planner.trajectory import State, Trajectory

BLOCK = 1 << 12
"""Pulses per axis gone through together, so that memory stays bounded."""
WINDOWS = 1000
"""Windows of time whose largest errors are kept."""
# Which components make up each row of the table after the six of their own.
SPACE = {"position": slice(0, 3), "orientation": slice(3, 6)}


class Planned(Protocol):
    """A motion of a machine and its pulses: a plan is one."""

    @property
    def machine(self) -> Machine: ...
    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def counted(self) -> Motion: ...
    @property
    def pulses(self) -> PulseSchedule: ...


def realised(plan: Planned, pulses: PulseSchedule | None = None, *, stride: int = 1) -> RealisedPath:
    """The realised path of a plan's pulses, or of other ones that stand for its motion.

    Between two pulses of any axis the counts stand for one pose: the motors are where they are counted, the axes where
    the play and the lead error that they state leave them (`planner.pulses.mechanics`), whatever of both the counts
    make up for, and the pose is found by forward kinematics (Newton from the planned one, to rounding). It is compared
    with the planned pose at both ends, which lie just after the one pulse and just before the next. Ends of windows of
    time are looked at as well: rests and turning points between pulses are seen. Of a machine whose platform carries a
    tool, the pose is the tool's. stride k takes every k-th interval. Each axis starts on the side of its
    play that its `pushed` says. Raises MotionError where counts stand for no pose, or the motion has none.
    """
    machine, trajectory = plan.machine, plan.trajectory
    behind = plan.counted if isinstance(plan.counted, Compensated) else None
    schedule = plan.pulses if pulses is None else pulses
    if len(schedule.axes) != len(machine.axes) or isinstance(stride, bool) or stride < 1:
        raise MotionError(
            f"realised path: {len(schedule.axes)} axes of pulses for machine {machine.name} with {len(machine.axes)}, "
            f"stride {stride}; give one of each per axis, and a stride from 1 on"
        )
    grid = np.linspace(0.0, _end(schedule), WINDOWS + 1)
    found = _Found(np.zeros((WINDOWS, 8)), np.zeros(WINDOWS), np.zeros((WINDOWS, 8)), np.zeros(8), np.zeros(8))
    instants = 0
    for begin, end, q in _intervals(schedule, machine.axes, grid, stride):
        instants += _compare(found, plan, schedule, grid, begin, end, q)
    bounds = _bounds(plan, schedule, behind, grid / schedule.clock_hz)
    rms = np.sqrt((found.square / found.time[:, None]).mean(0))
    moving = [*(machine.freedom + machine.follows), *SPACE]
    names = [*COMPONENTS, *SPACE]
    rows = [k for k, name in enumerate(names) if name in moving and (k < 7 or set(moving) & set(COMPONENTS[3:]))]
    errors = tuple(
        RealisedError(
            names[k],
            "m" if k in (0, 1, 2, 6) else "rad",
            float(rms[k]),
            float(found.largest[k]),
            _place(trajectory, float(found.when[k])),
            float(bounds[:, k].max()),
            frozen(found.windows[:, k]),
            frozen(np.maximum(bounds[:-1, k], bounds[1:, k])),
        )
        for k in rows
    )
    mover = "platform" if trajectory.path.tool is None else "tool"
    edges = frozen(grid / schedule.clock_hz)
    return RealisedPath(
        machine.name, schedule.rule, mover, instants, stride, edges, errors, _mechanics(machine.axes, behind)
    )


@dataclass(slots=True)
class _Found:
    """∫ e² dt (W, 8) over how much time (W,), the largest magnitudes (W, 8) in windows and (8,) in all, when (8,)."""

    square: Array
    time: Array
    windows: Array
    largest: Array
    when: Array


def _end(schedule: PulseSchedule) -> float:
    """Ticks up to which counts are looked at: one after the motion, or after its last pulse."""
    last = max((int(axis.ticks[-1]) for axis in schedule.axes if len(axis)), default=0)
    return max(schedule.duration * schedule.clock_hz, last) + 1.0


def _intervals(
    schedule: PulseSchedule, driven: Sequence[Axis], grid: Array, stride: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Begin and end (M,) in ticks of what lies between edges, pulses or the grid's; coordinates (M, n)."""
    marks = np.unique(np.concatenate([[0], *(axis.ticks[BLOCK::BLOCK] for axis in schedule.axes)])).astype(float)
    counts = np.array([axis.start for axis in schedule.axes])
    pushed = [axis.start * axis.pulse for axis in schedule.axes]
    seen = 0
    for lo, hi in zip(marks, [*marks[1:], grid[-1]], strict=True):
        inside = grid[np.searchsorted(grid, lo) : np.searchsorted(grid, hi)]
        spans = [slice(*np.searchsorted(axis.ticks, (lo, hi))) for axis in schedule.axes]
        fired = [axis.ticks[span] for axis, span in zip(schedule.axes, spans, strict=True)]
        edges = distinct(np.array([lo, hi]), inside, *fired)
        every = np.arange((-seen) % stride, len(edges) - 1, stride)
        here = np.union1d(every, np.searchsorted(edges, inside))  # each window has its first interval at least
        seen += len(edges) - 1
        q = np.empty((len(here), len(counts)))
        for k, (axis, span) in enumerate(zip(schedule.axes, spans, strict=True)):
            running = np.concatenate(([counts[k]], counts[k] + np.cumsum(axis.direction[span], dtype=np.int64)))
            pushes = carried(running * axis.pulse, driven[k], pushed[k])
            at = np.searchsorted(fired[k], edges[here], side="right")
            q[:, k] = axis.home + screw(pushes[at], driven[k])
            counts[k], pushed[k] = running[-1], pushes[-1]
        if len(here):
            yield edges[here], edges[here + 1], q


def _compare(
    found: _Found,
    plan: Planned,
    schedule: PulseSchedule,
    grid: Array,
    begin: Array,
    end: Array,
    q: Array,
) -> int:
    """Add the errors of some intervals to what has been found; how many instants that were."""
    machine, path = plan.machine, plan.trajectory.path
    ticks, where = np.unique(np.concatenate([begin, end]), return_inverse=True)
    planned = _numbers(plan.trajectory.at(ticks / schedule.clock_hz))
    first, last = np.split(where, 2)
    reached = poses(machine, q, begin / schedule.clock_hz, planned[first])
    if path.tool is not None:
        reached, planned = path.tool(reached), path.tool(planned)
    before, after = (_errors(reached, planned[ends]) for ends in (first, last))
    time = (end - begin) / schedule.clock_hz
    square = before**2 + before * after + after**2
    for k, part in enumerate(SPACE.values(), 6):  # vectors: ∫ ‖e‖² is the sum over their components
        square[:, k] = square[:, part].sum(1)
    both = np.maximum(abs(before), abs(after))
    window = np.searchsorted(grid, begin, side="right") - 1
    np.add.at(found.square, window, square * time[:, None] / 3)
    np.add.at(found.time, window, time)
    np.maximum.at(found.windows, window, both)
    worst, every = both.argmax(0), np.arange(8)
    beaten = both[worst, every] > found.largest
    at = np.where(abs(before[worst, every]) >= abs(after[worst, every]), begin[worst], end[worst])
    found.largest = np.where(beaten, both[worst, every], found.largest)
    found.when = np.where(beaten, at / schedule.clock_hz, found.when)
    return 2 * len(begin)


def _numbers(state: State) -> Array:
    x = state.path.pose_numbers(state.s, state.piece)
    if x is None:
        raise MotionError("this motion has no machine, so it has no pose that counts could stand for")
    return x


def _errors(reached: Array, planned: Array) -> Array:
    """(N, 8) of pose numbers: e = p - p_r and the vector of R R_rᵀ in the base frame, then their two magnitudes.

    The turn is small: its vector is that of the skew part, sin φ = φ to φ³/6.
    """
    turn = reached[:, 3:].reshape(-1, 3, 3) @ planned[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
    skew = (turn - turn.swapaxes(1, 2)) / 2
    vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)
    away = reached[:, :3] - planned[:, :3]
    sizes = [np.linalg.norm(each, axis=1)[:, None] for each in (away, vector)]
    return np.concatenate([away, vector, *sizes], 1)


def _bounds(plan: Planned, schedule: PulseSchedule, behind: Compensated | None, t: Array) -> Array:
    """(N, 8) at instants t (N,): how large counts that keep the schedule's bound can make each error.

    Σⱼ |J⁻¹ᵢⱼ| bⱼ of a component; in space the largest ‖J⁻¹ b‖ at the corners of the box of b, where a norm is largest.
    """
    state = plan.trajectory.at(t)
    x, path = _numbers(state), plan.trajectory.path
    step = sensitivity(plan.machine, x, state.q)
    if path.tool is not None:  # v of the tool = v + ω × r
        lever = path.tool(x)[:, :3] - x[:, :3]
        step[:, :3] += np.cross(step[:, 3:], lever[:, :, None], axis=1)
    step *= axes_away(plan.trajectory, plan.machine.axes, schedule, behind, t)[:, None, :]
    signs = np.array([(1, *rest) for rest in product((1, -1), repeat=len(schedule.axes) - 1)], float).T
    corners = step @ signs
    sizes = [np.linalg.norm(corners[:, part], axis=1).max(1)[:, None] for part in SPACE.values()]
    return np.concatenate([abs(step).sum(2), *sizes], 1)


def _mechanics(axes: Sequence[Axis], behind: Compensated | None) -> tuple[str, ...]:
    """What was simulated behind the motors: a line for all axes that state the same."""
    offs = [0.0] * len(axes) if behind is None else [cost.off for cost in behind.costs]
    alike: dict[str, list[tuple[Axis, float]]] = {}
    for axis, off in zip(axes, offs, strict=True):
        alike.setdefault(told(axis, 0.0), []).append((axis, off))
    return tuple(
        f"{', '.join(axis.name for axis, _ in same)}: {told(same[0][0], max(off for _, off in same))}"
        for text, same in alike.items()
        if text
    )


def _place(trajectory: Trajectory, t: float) -> Place:
    state = trajectory.at(t)
    return trajectory.path.place(float(state.s[0]), int(state.piece[0]), t)
