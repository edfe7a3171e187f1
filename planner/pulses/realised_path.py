"""The realised path: the pose to which the counts lead the mechanics, at every pulse, against the
planned one.

Its errors are found, and bounded by how far the axes can be from where they are planned while the
counts keep their bound.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Protocol

import numpy as np

from kinematics.analysis.singularity import sensitivity
from kinematics.foundation.arrays import Array, freeze_array, merge_rising
from kinematics.foundation.errors import MotionError
from kinematics.foundation.names import count_noun
from kinematics.foundation.options import check_arguments
from kinematics.foundation.result import Result
from kinematics.foundation.table import Column, Table
from kinematics.machine.axis import Axis
from kinematics.machine.machine import Machine
from kinematics.machine.pose import COMPONENTS, to_numbers
from planner.place import Place
from planner.pulses.compensation.compensate import CompensatedMotion
from planner.pulses.motion import (
    AxesMotion,
    apply_play,
    apply_screw,
    describe_mechanics,
    invert_screw,
    solve_poses,
)
from planner.pulses.schedule import PulseSchedule
from planner.shaping.shaped_motion import ShapedMotion, reached_poses
from planner.trajectory import State, Trajectory


def bound_axis_errors(
    trajectory: AxesMotion,
    driven: Sequence[Axis],
    schedule: PulseSchedule,
    behind: CompensatedMotion | None,
    t: Array,
) -> Array:
    """(N, n) m or rad at instants t (N,): how far each axis can be from where it is planned;
    between two, the larger.

    The counts are δ = bound·pulse and one tick's travel about what is counted; play keeps what δ
    was at the last turn, so with play δ is the largest so far. Play and lead error are whole where
    they are not made up for. Where they are, the screw's slope is on δ, and the axis is off by what
    compensation says: while the play is crossed, and by the farthest run back that turns nothing.
    Schedules that count something else than `behind` may be farther away.
    """
    q, counted = trajectory.at(t).q, trajectory if behind is None else behind
    travel = abs(counted.at(t).qd) / schedule.clock_hz
    away = np.empty(q.shape)
    for k, (axis, pulses) in enumerate(zip(driven, schedule.axes, strict=True)):
        delta = pulses.bound * pulses.pulse + travel[:, k]
        if axis.backlash > 0:
            delta = np.maximum.accumulate(delta)
        slack, off = axis.backlash, np.zeros(len(t))
        if behind is not None and "backlash" in axis.compensate:
            cost, slack = behind.costs[k], 0.0
            delta, off = delta + cost.unturned, cost.off * _is_taking_up(behind.steps[k], t)
        wanted = q[:, k] - pulses.home
        made_up_for = "lead" in axis.compensate
        middle = invert_screw(wanted, axis) if made_up_for else wanted
        behind_by, ahead_by = (slack, 0.0) if axis.pushed == "-" else (0.0, slack)
        below, above = (
            apply_screw(middle - behind_by - delta, axis),
            apply_screw(middle + ahead_by + delta, axis),
        )
        away[:, k] = np.maximum(abs(above - wanted), abs(wanted - below)) + off
        if (
            axis.lead_error is not None and not made_up_for
        ):  # a point of the table between two instants
            counted_at, error = np.array(axis.lead_error).T
            way = abs(np.diff(wanted))
            half = np.maximum(np.append(way, 0.0), np.append(0.0, way)) / 2
            away[:, k] += abs(np.diff(error) / np.diff(counted_at)).max() * half
    return away


def _is_taking_up(steps: Array, t: Array) -> Array:
    """(N,) 1 at the ends of the windows t[i] .. t[i+1] in which play is crossed, else 0."""
    found = np.zeros(len(t))
    for start, time, _ in steps:
        first, last = np.searchsorted(t, (start, start + time))
        found[max(first - 1, 0) : last + 1] = 1.0
    return found


@dataclass(frozen=True, slots=True)
class RealisedError:
    """One error of the realised path: realised - planned, a component in the base frame or a
    distance in space.

    rms         √(1/T ∫ e² dt), the error taken as linear between the instants looked at, window by
                window
    max, where  the largest magnitude and its place
    bound       of the magnitude, the largest along the path: Σⱼ |J⁻¹ᵢⱼ| bⱼ of a component, max ‖J⁻¹
                b‖ over the signs of the bⱼ in space; bⱼ, in m or rad, is the schedule's bound and
                one tick's travel of axis j through its screw, and its play and lead error, or what
                is left of them where they are made up for
    series, bounds  (W,) the same in windows of time: largest magnitude, and largest bound at the
                    windows' two ends
    """

    name: str
    unit: str
    rms: float
    max: float
    where: Place
    bound: float
    series: Array = field(repr=False)
    bounds: Array = field(repr=False)

    @property
    def share(self) -> float:
        """The largest share of the bound that any window's error takes."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return float(
                np.nanmax(np.where(self.bounds > 0, self.series / self.bounds, 0.0), initial=0.0)
            )


@dataclass(frozen=True, slots=True)
class RealisedPath(Result):
    """Quantization error: the pose given by the integer counts against the planned pose.

    rule      of firing that made the pulses
    instants  how many were looked at, each just after a pulse and just before the next
    stride    1: all of them; k: every k-th
    edges     (W+1,) s, the ends of the windows of the errors' series
    errors    of each component that moves, then in space ("position") and of the whole turn
              ("orientation")
    mover     "platform" or "tool": whose pose it is
    mechanics of each axis that states play or lead error, in words: both are simulated, and in the
    bound
    """

    machine: str
    rule: str
    mover: str
    instants: int
    stride: int
    edges: Array = field(repr=False)
    errors: tuple[RealisedError, ...]
    mechanics: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> RealisedError:
        """The error of a name. Raises MotionError for another one."""
        for error in self.errors:
            if error.name == name:
                return error
        known = ", ".join(error.name for error in self.errors)
        raise MotionError(f"the realised path has no error {name!r}; it has {known}")

    def tables(self) -> tuple[Table, ...]:
        """Each error, its bound, and where it is largest."""
        every = "each" if self.stride == 1 else f"one in {self.stride}"
        title = (
            f"realised path of the {self.mover} of {self.machine}, rule {self.rule}: "
            f"{count_noun(self.instants, 'instant')}, "
            f"{every} just after and just before a pulse"
        )
        units = [error.unit for error in self.errors]
        figures = (("RMS", "rms"), ("largest", "max"), ("bound", "bound"))
        columns = (
            Column("error", [error.name for error in self.errors]),
            *(
                Column(
                    name,
                    [getattr(error, field) for error in self.errors],
                    units,
                    "micro",
                    ".4f",
                    up=field == "bound",
                )
                for name, field in figures
            ),
            Column("of bound", [error.share for error in self.errors], form=".3f"),
            *Place.columns([error.where for error in self.errors]),
        )
        return (
            Table(title, columns, tuple(f"in error and bound, {text}" for text in self.mechanics)),
        )

    def data(self) -> Table:
        """The largest of each error in windows of time, and its bound."""
        ends = (Column("from", self.edges[:-1], "s"), Column("to", self.edges[1:], "s"))
        series = (
            Column(f"{error.name}{of}", values, error.unit)
            for error in self.errors
            for of, values in (("", error.series), (" bound", error.bounds))
        )
        return Table(f"realised path of {self.machine}", (*ends, *series))


BLOCK_PULSES = 1 << 12
"""Pulses per axis gone through together, so that memory stays bounded."""
WINDOWS = 1000
"""Windows of time whose largest errors are kept."""
# Which components make up each row of the table after the six of their own.
ROW_COMPONENTS = {"position": slice(0, 3), "orientation": slice(3, 6)}


class CountedMotion(Protocol):
    """A motion of a machine and its pulses: a plan is one."""

    @property
    def machine(self) -> Machine: ...
    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def counted(self) -> AxesMotion: ...
    @property
    def pulses(self) -> PulseSchedule: ...


@check_arguments()
def realised(
    plan: CountedMotion, pulses: PulseSchedule | None = None, *, stride: int = 1
) -> RealisedPath:
    """The realised path of a plan's pulses, or of other pulses for its motion.

    Between two pulses of any axis the counts stand for one pose: the motors are where they are
    counted, the axes where the play and the lead error that they state leave them
    (`planner.pulses.motion`), whatever of both the counts make up for, and the pose is found by
    forward kinematics (Newton from the planned one, to rounding). It is compared with the planned
    pose at both ends, which lie just after the one pulse and just before the next. Ends of windows
    of time are looked at as well: rests and turning points between pulses are seen. Of a machine
    whose platform carries a tool, the pose is the tool's. stride k takes every k-th interval. Each
    axis starts on the side of its play that its `pushed` says. Raises MotionError where counts
    stand for no pose, or the motion has none.
    """
    machine, trajectory = plan.machine, plan.trajectory
    behind = plan.counted if isinstance(plan.counted, CompensatedMotion) else None
    schedule = plan.pulses if pulses is None else pulses
    if len(schedule.axes) != len(machine.axes) or isinstance(stride, bool) or stride < 1:
        raise MotionError(
            f"realised path: {count_noun(len(schedule.axes), 'axis')} of pulses for machine "
            f"{machine.name} with {len(machine.axes)}, "
            f"stride {stride}; give one of each per axis, and a stride from 1 on"
        )
    grid = np.linspace(0.0, _last_tick(schedule), WINDOWS + 1)
    found = _ErrorSums(
        np.zeros((WINDOWS, 8)), np.zeros(WINDOWS), np.zeros((WINDOWS, 8)), np.zeros(8), np.zeros(8)
    )
    instants = 0
    for begin, end, q in _intervals(schedule, machine.axes, grid, stride):
        instants += _compare(found, plan, schedule, grid, begin, end, q)
    bounds = _error_bounds(plan, schedule, behind, grid / schedule.clock_hz)
    rms = np.sqrt((found.square / found.time[:, None]).mean(0))
    moving = [*(machine.freedom + machine.follows), *ROW_COMPONENTS]
    names = [*COMPONENTS, *ROW_COMPONENTS]
    rows = [
        k
        for k, name in enumerate(names)
        if name in moving and (k < 7 or set(moving) & set(COMPONENTS[3:]))
    ]
    errors = tuple(
        RealisedError(
            names[k],
            "m" if k in (0, 1, 2, 6) else "rad",
            float(rms[k]),
            float(found.largest[k]),
            _place(trajectory, float(found.when[k])),
            float(bounds[:, k].max()),
            freeze_array(found.windows[:, k]),
            freeze_array(np.maximum(bounds[:-1, k], bounds[1:, k])),
        )
        for k in rows
    )
    mover = "platform" if trajectory.path.tool is None else "tool"
    edges = freeze_array(grid / schedule.clock_hz)
    return RealisedPath(
        machine.name,
        schedule.rule,
        mover,
        instants,
        stride,
        edges,
        errors,
        _describe_mechanics(machine.axes, behind),
    )


@dataclass(slots=True)
class _ErrorSums:
    """∫ e² dt (W, 8) over how much time (W,), the largest magnitudes (W, 8) in windows and (8,) in
    all, when (8,).
    """

    square: Array
    time: Array
    windows: Array
    largest: Array
    when: Array


def _last_tick(schedule: PulseSchedule) -> float:
    """Ticks up to which counts are looked at: one after the motion, or after its last pulse."""
    last = max((int(axis.ticks[-1]) for axis in schedule.axes if len(axis)), default=0)
    return max(schedule.duration * schedule.clock_hz, last) + 1.0


def _intervals(
    schedule: PulseSchedule, driven: Sequence[Axis], grid: Array, stride: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Begin and end (M,) in ticks of what lies between edges, pulses or the grid's; coordinates (M,
    n).
    """
    marks = np.unique(
        np.concatenate([[0], *(axis.ticks[BLOCK_PULSES::BLOCK_PULSES] for axis in schedule.axes)])
    ).astype(float)
    counts = np.array([axis.start for axis in schedule.axes])
    pushed = [axis.start * axis.pulse for axis in schedule.axes]
    seen = 0
    for lo, hi in zip(marks, [*marks[1:], grid[-1]], strict=True):
        inside = grid[np.searchsorted(grid, lo) : np.searchsorted(grid, hi)]
        spans = [slice(*np.searchsorted(axis.ticks, (lo, hi))) for axis in schedule.axes]
        fired = [axis.ticks[span] for axis, span in zip(schedule.axes, spans, strict=True)]
        edges = merge_rising(np.array([lo, hi]), inside, *fired)
        every = np.arange((-seen) % stride, len(edges) - 1, stride)
        here = np.union1d(
            every, np.searchsorted(edges, inside)
        )  # each window has its first interval at least
        seen += len(edges) - 1
        q = np.empty((len(here), len(counts)))
        for k, (axis, span) in enumerate(zip(schedule.axes, spans, strict=True)):
            running = np.concatenate(
                ([counts[k]], counts[k] + np.cumsum(axis.direction[span], dtype=np.int64))
            )
            pushes = apply_play(running * axis.pulse, driven[k], pushed[k])
            at = np.searchsorted(fired[k], edges[here], side="right")
            q[:, k] = axis.home + apply_screw(pushes[at], driven[k])
            counts[k], pushed[k] = running[-1], pushes[-1]
        if len(here):
            yield edges[here], edges[here + 1], q


def _compare(
    found: _ErrorSums,
    plan: CountedMotion,
    schedule: PulseSchedule,
    grid: Array,
    begin: Array,
    end: Array,
    q: Array,
) -> int:
    """Add the errors of some intervals to what has been found; how many instants that were."""
    machine, path = plan.machine, plan.trajectory.path
    ticks, where = np.unique(np.concatenate([begin, end]), return_inverse=True)
    planned = _planned_poses(plan, ticks / schedule.clock_hz)[0]
    first, last = np.split(where, 2)
    reached = solve_poses(machine, q, begin / schedule.clock_hz, planned[first])
    if path.tool is not None:
        reached, planned = path.tool(reached), path.tool(planned)
    before, after = (_errors(reached, planned[ends]) for ends in (first, last))
    time = (end - begin) / schedule.clock_hz
    square = before**2 + before * after + after**2
    for k, part in enumerate(
        ROW_COMPONENTS.values(), 6
    ):  # vectors: ∫ ‖e‖² is the sum over their components
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


def _planned_poses(plan: CountedMotion, t: Array) -> tuple[Array, Array]:
    """Pose numbers (N, 12) and coordinates (N, n) planned at t (N,): behind input shapers, where
    there are any.
    """
    shaped = _find_shaped(plan)
    if shaped is None:
        state = plan.trajectory.at(t)
        return _pose_numbers(state), state.q
    q = shaped.at(t).q
    return to_numbers(reached_poses(plan.trajectory, shaped, t, q)), q


def _find_shaped(plan: CountedMotion) -> ShapedMotion | None:
    """The motion behind input shapers that is counted, as it is or as motors make it."""
    motion = plan.counted.planned if isinstance(plan.counted, CompensatedMotion) else plan.counted
    return motion if isinstance(motion, ShapedMotion) else None


def _pose_numbers(state: State) -> Array:
    x = state.path.pose_numbers(state.s, state.piece)
    if x is None:
        raise MotionError(
            "this motion has no machine, so it has no pose that counts could stand for"
        )
    return x


def _errors(reached: Array, planned: Array) -> Array:
    """(N, 8) of pose numbers: e = p - p_r and the vector of R R_rᵀ in the base frame, then their
    two magnitudes.

    The turn is small: its vector is that of the skew part, sin φ = φ to φ³/6.
    """
    turn = reached[:, 3:].reshape(-1, 3, 3) @ planned[:, 3:].reshape(-1, 3, 3).swapaxes(1, 2)
    skew = (turn - turn.swapaxes(1, 2)) / 2
    vector = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], 1)
    away = reached[:, :3] - planned[:, :3]
    sizes = [np.linalg.norm(each, axis=1)[:, None] for each in (away, vector)]
    return np.concatenate([away, vector, *sizes], 1)


def _error_bounds(
    plan: CountedMotion, schedule: PulseSchedule, behind: CompensatedMotion | None, t: Array
) -> Array:
    """(N, 8) at instants t (N,): how large counts that keep the schedule's bound can make each
    error.

    Σⱼ |J⁻¹ᵢⱼ| bⱼ of a component; in space the largest ‖J⁻¹ b‖ at the corners of the box of b, where
    a norm is largest.
    """
    (x, q), path = _planned_poses(plan, t), plan.trajectory.path
    step = sensitivity(plan.machine, x, q)
    if path.tool is not None:  # v of the tool = v + ω × r
        lever = path.tool(x)[:, :3] - x[:, :3]
        step[:, :3] += np.cross(step[:, 3:], lever[:, :, None], axis=1)
    step *= bound_axis_errors(
        _find_shaped(plan) or plan.trajectory, plan.machine.axes, schedule, behind, t
    )[:, None, :]
    signs = np.array(
        [(1, *rest) for rest in product((1, -1), repeat=len(schedule.axes) - 1)], float
    ).T
    corners = step @ signs
    sizes = [
        np.linalg.norm(corners[:, part], axis=1).max(1)[:, None] for part in ROW_COMPONENTS.values()
    ]
    return np.concatenate([abs(step).sum(2), *sizes], 1)


def _describe_mechanics(axes: Sequence[Axis], behind: CompensatedMotion | None) -> tuple[str, ...]:
    """What was simulated behind the motors: a line for all axes that state the same."""
    offs = [0.0] * len(axes) if behind is None else [cost.off for cost in behind.costs]
    alike: dict[str, list[tuple[Axis, float]]] = {}
    for axis, off in zip(axes, offs, strict=True):
        alike.setdefault(describe_mechanics(axis, 0.0), []).append((axis, off))
    return tuple(
        f"{', '.join(axis.name for axis, _ in same)}: {describe_mechanics(same[0][0], max(off for _, off in same))}"
        for text, same in alike.items()
        if text
    )


def _place(trajectory: Trajectory, t: float) -> Place:
    state = trajectory.at(t)
    return trajectory.path.place(float(state.s[0]), int(state.piece[0]), t)
