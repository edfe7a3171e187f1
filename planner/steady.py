"""Constant tool speed: a segment as the shortest ramp up, exactly the speed that is asked for, and a ramp down.

The fastest motion under the speed as a cap tells where the ramps can end: at order 2 no motion is faster anywhere
[Pham and Pham 2018], so none reaches the speed earlier or leaves it later; at order 3 that is taken over as a rule, and
the ramps are some 1 % longer than the shortest found (exact where the path is straight in the actuators).
Between those two places the speed either can be kept, or the plan is infeasible there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE
from planner.limits.limit import Limit
from planner.limits.tool_speed import ToolSpeed
from planner.place import Infeasible, Place
from planner.timing.leg import STRAIGHT
from planner.timing.problem import Run, grid
from planner.timing.profile import Profile
from planner.timing.run import Attempt, attempt
from planner.trajectory import State, Trajectory

# Share of the speed from which on it counts as reached, where a motion is exact and where a solver has its tolerance.
REACHED = {True: 1e-9, False: 1e-5}
# By how much a ramp is longer than the shortest that was found, tried in turn: where the speed is just reached a motion
# has no choice left, and a solver no room. Under jerk limits the speed is neared as a parabola: its last 1e-5 take
# 0.5 % of a ramp.
LONGER = {True: (1.0, 1.002, 1.02), False: (1.01, 1.03, 1.1)}
# A ramp is solved again, on its own finer grid, while it then gets shorter by this share, and so often at most.
GAIN, SOLVES = {True: 1e-3, False: 1.5e-2}, 4
# Time pieces of the part at constant speed at least, and for each radian that the path turns.
PIECES, PER_RADIAN = 200, 100
# Points of a piece looked at where it breaks a limit.
POINTS = 17
# Halvings that find a largest speed: to rounding.
HALVINGS = 50


@dataclass(frozen=True, slots=True)
class Steady:
    """A run at constant speed, in the place of an `Attempt`: ramp up, the speed itself, ramp down.

    A ramp is None where the run begins or ends at that speed.
    """

    path: ActuatorPath
    limits: tuple[Limit, ...]
    up: Attempt | None
    cruise: Profile
    down: Attempt | None

    @property
    def profile(self) -> Profile:
        parts = [part for part in (self.up and self.up.profile, self.cruise, self.down and self.down.profile) if part]
        return Profile.joined(parts)

    @property
    def method(self) -> str:
        return next((ramp.method for ramp in (self.up, self.down) if ramp is not None), "constant speed")

    @property
    def floor(self) -> float:
        """An estimate of the least time: of the ramps, and what the constant speed takes."""
        return float(self.cruise.h.sum()) + sum(ramp.floor for ramp in (self.up, self.down) if ramp is not None)

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Steady":
        """The ramps solved again; at constant speed there is nothing to give, so an excess there is a refusal."""
        first = 0 if self.up is None else len(self.up.profile.h)
        last = first + len(self.cruise.h)
        over = np.max([values[first:last] for values in use.values()], axis=0) > 1 + TOLERANCE
        if over.any():
            k = np.flatnonzero(over)
            s = self.cruise.s[k, None] + (self.cruise.v * self.cruise.h)[k, None] * np.linspace(0, 1, POINTS)
            _refuse(self.path, self.limits, s.ravel(), np.repeat(self.cruise.piece[k], POINTS), float(self.cruise.v[0]))
        up = self.up and _tightened(self.up, {name: values[:first] for name, values in use.items()}, slowness)
        down = self.down and _tightened(self.down, {name: values[last:] for name, values in use.items()}, slowness)
        return replace(self, up=up, down=down)


def _tightened(ramp: Attempt, use: Mapping[str, Array], slowness: float) -> Attempt:
    return ramp.tightened(use, slowness) if any((values > 1 + TOLERANCE).any() for values in use.values()) else ramp


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of a segment that is run at exactly `speed` (m/s), from one place to another."""

    speed: float
    since: Place
    until: Place


def stretches(path: ActuatorPath, trajectory: Trajectory) -> tuple[Stretch, ...]:
    """Where a motion along a path has the constant speeds that its segments ask for."""
    asked = np.array([path.constant(int(piece)) or np.nan for piece in trajectory.piece])
    at_it = (trajectory.v == asked) & (trajectory.a == 0) & (trajectory.j == 0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_it, [False]])))
    found = []
    for first, last in zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True):
        start, end = (float(trajectory.knots[k]) for k in (first, last + 1))
        s = float(trajectory.s[last] + trajectory.v[last] * (end - trajectory.knots[last]))
        since = path.place(float(trajectory.s[first]), int(trajectory.piece[first]), start)
        found.append(Stretch(float(asked[first]), since, path.place(s, int(trajectory.piece[last]), end)))
    return tuple(found)


def steady(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float) -> Steady:
    """The run at constant speed. Raises Infeasible where a limit does not allow it, or where the run is too short."""
    try:
        tried = attempt(path, limits, run, order, probing=True)
    except MotionError:  # told why, or given the next best
        tried = attempt(path, limits, run, order)
    capped = tried.profile
    breaks = run.breaks(path)
    fastest = [int(np.argmax(capped.v))]
    if _use(path, limits, capped.s[fastest], capped.piece[fastest], np.array([speed])).max() > 1 + TOLERANCE:
        _refuse(path, limits, capped.s, capped.piece, speed)  # no ramp, however long, would help
    up = _ramp(path, limits, run, order, speed, tried, down=False) if run.start_speed < speed else None
    down = _ramp(path, limits, run, order, speed, tried, down=True) if run.end_speed < speed else None
    since = float(breaks[0]) if up is None else up[1]
    until = float(breaks[-1]) if down is None else down[1]
    if since >= until:
        raise _too_short(path, limits, capped, speed)
    cruise = _cruise(path, run, since, until, speed)
    s = np.concatenate([cruise.s + cruise.h * speed * share for share in (0.0, 0.5, 1.0)])
    _refuse(path, limits, s, np.tile(cruise.piece, 3), speed)
    return Steady(path, tuple(limits), up and up[0], cruise, down and down[0])


def _ramp(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float, capped: Attempt, down: bool
) -> tuple[Attempt, float]:
    """The shortest ramp between an end of the run and the speed, and where it meets it; capped: the motion under it."""
    end = float(run.breaks(path)[-1 if down else 0])
    best: tuple[Attempt, float] | None = None
    tried = capped
    for _ in range(SOLVES):
        profile, exact = tried.profile, order == 2 or tried.method == STRAIGHT
        reached = np.flatnonzero(profile.v >= speed * (1 - REACHED[exact]))
        if not len(reached):
            break
        way = float(profile.s[reached[-1 if down else 0]]) - end
        if best is not None and abs(way) > abs(best[1] - end) * (1 - GAIN[exact]):
            break
        found = _solved(path, limits, run, order, speed, [end + way * longer for longer in LONGER[exact]], down)
        if found is None:
            break
        best, tried = found, found[0]
    if best is None:
        raise _too_short(path, limits, capped.profile, speed)
    return best


def _solved(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float, places: list[float], down: bool
) -> tuple[Attempt, float] | None:
    """The ramp to the first of some places to which there is one."""
    breaks = run.breaks(path)
    for place in places:
        if not breaks[0] < place < breaks[-1]:
            break
        piece = run.first + int(np.searchsorted(breaks, place)) - 1
        part = (
            replace(run, first=piece, since=place, start_speed=speed)
            if down
            else replace(run, last=piece, until=place, end_speed=speed)
        )
        try:
            return attempt(path, limits, part, order, probing=True), place
        except MotionError:
            continue
    return None


def _cruise(path: ActuatorPath, run: Run, since: float, until: float, speed: float) -> Profile:
    """The speed itself, in pieces that the certificate tells apart."""
    breaks = run.breaks(path)
    first = run.first + int(np.searchsorted(breaks, since, side="right")) - 1
    last = run.first + int(np.searchsorted(breaks, until)) - 1
    pieces = max(PIECES, int(PER_RADIAN * path.turns[first : last + 1].sum()))
    s, piece = grid(path, Run(first, last, speed, speed, since, until), pieces)
    nothing = np.zeros(len(piece))
    return Profile(s[:-1], nothing + speed, nothing, nothing, np.diff(s) / speed, piece)


def _refuse(path: ActuatorPath, limits: Sequence[Limit], s: Array, piece: np.ndarray, speed: float) -> None:
    """Raise Infeasible where the speed breaks a limit: with what is possible at the place that allows the least."""
    over = _use(path, limits, s, piece, np.full(len(s), speed)).max(0) > 1 + TOLERANCE
    if not over.any():
        return
    s, piece = s[over], piece[over]
    low, high = np.zeros(len(s)), np.full(len(s), speed)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        kept = _use(path, limits, s, piece, middle).max(0) <= 1
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    worst = [int(np.argmin(low))]
    limit = limits[int(np.argmax(_use(path, limits, s[worst], piece[worst], high[worst])[:, 0]))]
    value = limit.value(_at_speed(path, s[worst], piece[worst], np.array([speed])))
    channel = int(np.argmax(limit.use(value, value, piece[worst])[0]))
    unit, scale = limit.units[channel]
    reached, allowed = limit.told(float(value[0, channel]), channel)
    place = path.place(float(s[worst[0]]), int(piece[worst[0]]), None, limit.channels[channel])
    remedy = (
        f"so {speed * 1e3:.6g} mm/s cannot be kept constant: there it could be {float(low[worst[0]]) * 1e3:.6g} mm/s; "
        "lower the speed, or let the segment run without speed_constant"
    )
    raise Infeasible(limit.name, limit.channels[channel], place, reached * scale, allowed * scale, unit, remedy)


def _too_short(path: ActuatorPath, limits: Sequence[Limit], capped: Profile, speed: float) -> Infeasible:
    """What to say where the ramps leave nothing between them: how fast the motion gets, and what holds it there."""
    k = np.array([max(int(np.argmax(capped.v)) - 1, 0)])
    state = capped.along(path).within(k, capped.h[k] / 2)
    timed = [limit for limit in limits if not limit.geometric and limit.name != ToolSpeed.name]
    uses = [limit.use(value, value, state.piece)[0] for limit in timed for value in [limit.value(state)]]
    holding = int(np.argmax([use.max() for use in uses]))
    channel = timed[holding].channels[int(np.argmax(uses[holding]))]
    fastest = float(capped.v.max())
    place = path.place(float(capped.s[k[0]]), int(capped.piece[k[0]]), None, channel)
    remedy = (
        f"the segment is too short for its ramps, held by the {timed[holding].name} of {channel}: "
        f"lower the speed below {fastest * 1e3:.6g} mm/s, or let it run without speed_constant"
    )
    return Infeasible("constant speed", channel, place, speed * 1e3, fastest * 1e3, "mm/s", remedy)


def _use(path: ActuatorPath, limits: Sequence[Limit], s: Array, piece: np.ndarray, speed: Array) -> Array:
    """(limits, N) the largest share of each limit that constant speeds use at N places."""
    state = _at_speed(path, s, piece, speed)
    return np.stack([limit.use(value, value, piece).max(1) for limit in limits for value in [limit.value(state)]])


def _at_speed(path: ActuatorPath, s: Array, piece: np.ndarray, speed: Array) -> State:
    nothing = np.zeros(len(s))
    walk = Trajectory(path, np.arange(len(s) + 1.0), s, speed, nothing, nothing, piece)
    return walk.within(np.arange(len(s)), nothing)
