"""Constant tool speed: the shortest ramp up, exactly the speed that is asked for, and a ramp down.

The path's parameter is the tool's way here (planner.path.arc_length), so a constant ṡ is the tool's speed, to 1e-10
of it.

The fastest motion under the speed as a cap tells where the ramps can end: at order 2 no motion is faster anywhere
[Pham and Pham 2018], so none reaches the speed earlier or leaves it later; at order 3 that is taken over as a rule, and
the ramps are some 1 % longer than the shortest found (exact where the path is straight in the actuators).
Between those two places the speed either can be kept, or the plan is infeasible there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.limit_use import LIMIT_ROUNDING
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused, Infeasible
from planner.timing.grid import make_grid
from planner.timing.problem import EndCondition, Run
from planner.timing.profile import MADE_CONSTANT_SPEED, STRAIGHT, Profile, RunSolution
from planner.timing.run import solve_run
from planner.trajectory import State, Trajectory

# Of the motions that ramps are found from: closed forms, and solvers' at order 2 and 3. Share of the speed from which
# on it counts as reached, as a little less than it is what they aim at.
REACHED_SHARE = {STRAIGHT: 2e-9, 2: 2e-6, 3: 1e-5}
# By how much a ramp is longer than the shortest that was found, tried in turn: where the speed is just reached a motion
# has no choice left, and a solver no room. Under jerk limits the speed is neared as a parabola: its last 1e-5 take
# 0.5 % of a ramp.
RAMP_LENGTHENING = {STRAIGHT: (1 + 1e-8, 1.002, 1.02), 2: (1.00001, 1.002, 1.02), 3: (1.01, 1.03, 1.1)}
# A ramp is solved again, on its own finer grid, while it then gets shorter by this share, and so often at most.
MIN_RAMP_GAIN, MAX_SOLVES = {STRAIGHT: 1e-3, 2: 1e-3, 3: 1.5e-2}, 4
# Time pieces of the part at constant speed at least, and for each radian that the path turns.
MIN_PIECES, PER_RADIAN = 200, 100
# Points of a piece looked at before the proof, and where that finds a limit broken.
FIRST_POINTS, CHECK_POINTS = 3, 17
# Halvings that find a largest speed: to rounding.
MAX_HALVINGS = 50


def solve_constant_speed(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float
) -> tuple[RunSolution, ...]:
    """The run at constant speed: the ramp up, the speed, and the ramp down, of which an end at that speed has none.

    Infeasible where a limit does not allow it, or where the run is too short: then that alone.
    """
    staying = _resonance_error(path, limits, run, speed)
    if staying is not None:
        return (RunSolution.refused(staying),)
    first, last = run.breaks(path)[[0, -1]].tolist()
    ends: list[float] = [first, last]
    ramps: list[list[RunSolution]] = [[], []]
    if min(run.speeds) < speed:
        capped = _solve_capped(path, limits, run, order, speed)
        if not capped.solved:
            return (capped,)
        for end in (0, 1):
            if run.speeds[end] < speed:
                ramp = _shortest_ramp(path, limits, run, order, speed, capped, down=end == 1)
                if ramp is None:
                    return (RunSolution.refused(_too_short_error(path, limits, capped.profile, speed)),)
                ramps[end], ends[end] = [ramp[0]], ramp[1]
        if ends[0] >= ends[1]:
            return (RunSolution.refused(_too_short_error(path, limits, capped.profile, speed)),)
    profile = _constant_profile(path, run, ends[0], ends[1], speed)
    refusal = speed_error(path, limits, *_places(profile, np.arange(len(profile.h)), FIRST_POINTS), speed)
    if refusal is not None:
        return (RunSolution.refused(refusal),)
    return (*ramps[0], RunSolution("solved", profile, profile.duration, MADE_CONSTANT_SPEED), *ramps[1])


def tighten_constant_speed(
    path: ActuatorPath, limits: Sequence[Limit], solution: RunSolution, use: Mapping[str, Array]
) -> RunSolution:
    """What the speed itself asks of a limit cannot be changed, so an excess is a refusal."""
    profile, k = solution.profile, np.flatnonzero(np.max([*use.values()], axis=0) > 1)
    refusal = speed_error(path, limits, *_places(profile, k, CHECK_POINTS), float(profile.v[0]))
    return solution if refusal is None else RunSolution.refused(refusal)


def joined_speed_error(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float
) -> ConstantRefused | None:
    """Why the speed cannot be beside an end of the run at which it is already kept, where a limit does not allow it.

    That is the half up to the run's middle, if a ramp to the other end fits behind it; all of it, if none is needed.
    """
    breaks = run.breaks(path)
    first, last = float(breaks[0]), float(breaks[-1])
    if min(run.speeds) == speed:
        return speed_error(path, limits, *_sample_places(path, run, first, last, speed), speed)
    if max(run.speeds) == speed:
        down, middle = run.speeds[0] == speed, (first + last) / 2
        places = _sample_places(path, run, *((first, middle) if down else (middle, last)), speed)
        if _limit_use(path, limits, *places, np.full(len(places[0]), speed)).max() <= 1 + LIMIT_ROUNDING:
            return None
        if _solve_ramp(path, limits, run, order, speed, [middle], down) is not None:
            return speed_error(path, limits, *places, speed)
    return None


def _sample_places(path: ActuatorPath, run: Run, since: float, until: float, speed: float) -> tuple[Array, np.ndarray]:
    """Places between two path lengths, close together, and their path pieces."""
    profile = _constant_profile(path, run, since, until, speed)
    return _places(profile, np.arange(len(profile.h)), CHECK_POINTS)


def _solve_capped(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float) -> RunSolution:
    """The fastest motion under the speed. Infeasible where no ramp, however long, would help."""
    tried = solve_run(path, limits, run, order, probing=True)
    if not tried.solved:  # told why, or given the next best
        tried = solve_run(path, limits, run, order)
    if not tried.solved:
        return tried
    motion = tried.profile
    fastest = [int(np.argmax(motion.v))]
    refusal = None
    if _limit_use(path, limits, motion.s[fastest], motion.piece[fastest], np.array([speed])).max() > 1 + LIMIT_ROUNDING:
        refusal = speed_error(path, limits, motion.s, motion.piece, speed)
    return tried if refusal is None else RunSolution.refused(refusal)


def _shortest_ramp(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float, capped: RunSolution, down: bool
) -> tuple[RunSolution, float] | None:
    """The shortest ramp between an end of the run and the speed, and where it meets it; None where there is none.

    capped: the motion under the speed
    """
    end = float(run.breaks(path)[-1 if down else 0])
    best: tuple[RunSolution, float] | None = None
    tried = capped
    for _ in range(MAX_SOLVES):
        profile, kind = tried.profile, STRAIGHT if tried.method == STRAIGHT else order
        reached = np.flatnonzero(profile.v >= speed * (1 - REACHED_SHARE[kind]))
        if not len(reached):
            break
        way = float(profile.s[reached[-1 if down else 0]]) - end
        if best is not None and abs(way) > abs(best[1] - end) * (1 - MIN_RAMP_GAIN[kind]):
            break
        found = _solve_ramp(
            path, limits, run, order, speed, [end + way * longer for longer in RAMP_LENGTHENING[kind]], down
        )
        if found is None:
            break
        best, tried = found, found[0]
    return best


def _solve_ramp(
    path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int, speed: float, places: list[float], down: bool
) -> tuple[RunSolution, float] | None:
    """The ramp to the first of some places to which there is one."""
    breaks = run.breaks(path)
    for place in places:
        if not breaks[0] < place < breaks[-1]:
            break
        piece = run.first + int(np.searchsorted(breaks, place)) - 1
        part = (
            replace(run, first=piece, since=place, ends=(EndCondition(speed), run.ends[1]))
            if down
            else replace(run, last=piece, until=place, ends=(run.ends[0], EndCondition(speed)))
        )
        ramp = solve_run(path, limits, part, order, probing=True)
        if ramp.solved:
            return ramp, place
    return None


def _constant_profile(path: ActuatorPath, run: Run, since: float, until: float, speed: float) -> Profile:
    """The speed itself, in pieces that the certificate tells apart."""
    breaks = run.breaks(path)
    first = run.first + int(np.searchsorted(breaks, since, side="right")) - 1
    last = run.first + int(np.searchsorted(breaks, until)) - 1
    pieces = max(MIN_PIECES, int(PER_RADIAN * path.turns[first : last + 1].sum()))
    s, piece = make_grid(path, Run(first, last, since=since, until=until), pieces)
    nothing = np.zeros(len(piece))
    return Profile(s[:-1], nothing + speed, nothing, nothing, np.diff(s) / speed, piece)


def _places(profile: Profile, k: np.ndarray, points: int) -> tuple[Array, np.ndarray]:
    """Path lengths at so many points of time pieces k of constant speed, and their path pieces."""
    s = profile.s[k, None] + (profile.v * profile.h)[k, None] * np.linspace(0, 1, points)
    return s.ravel(), np.repeat(profile.piece[k], points)


def _resonance_error(path: ActuatorPath, limits: Sequence[Limit], run: Run, speed: float) -> Infeasible | None:
    """Where an axis stays in a band too long because of the constant speed itself: no timing exists."""
    breaks = run.breaks(path)
    for limit in limits:
        for held in limit.held if isinstance(limit, Resonance) else ():
            s = np.linspace(max(held.first, breaks[0]), min(held.last, breaks[-1]), MIN_PIECES)
            if s[0] >= s[-1]:
                continue
            piece = run.first + np.clip(np.searchsorted(breaks, s, side="right") - 1, 0, len(breaks) - 2)
            band, slope = held.band, np.abs(path.derivatives(s, piece)[1][:, held.band.axis])
            inside = np.flatnonzero((slope * speed >= band.low) & (slope * speed <= band.high))
            if not len(inside):
                continue
            unit, scale = limit.units[band.axis]
            most = int(inside[np.argmax(slope[inside])])
            place = path.place(float(s[most]), int(piece[most]), None, limit.channels[band.axis])
            since, until = s[inside[[0, -1]]] * 1e3
            below, above = band.low / slope[inside].max() * 1e3, band.high / slope[inside].min() * 1e3
            remedy = (
                f"at {speed * 1e3:.6g} mm/s it stays in its resonance band of {band.low * scale:.6g} to "
                f"{band.high * scale:.6g} {unit} for longer than the {band.time:.6g} s allowed, between "
                f"s = {since:.6g} mm and {until:.6g} mm: take a speed below {below:.6g} mm/s or above {above:.6g} mm/s"
            )
            value = float(slope[most]) * speed * scale
            return Infeasible(limit.name, limit.channels[band.axis], place, value, band.low * scale, unit, remedy)
    return None


def speed_error(
    path: ActuatorPath, limits: Sequence[Limit], s: Array, piece: np.ndarray, speed: float
) -> ConstantRefused | None:
    """What to say where the speed breaks a limit: with what is possible at the place that allows the least.

    Geometric limits are no speed's: they were proved before, and one that is used up, as by a home at an end of travel,
    is beyond 1 by rounding.
    """
    limits = [limit for limit in limits if not limit.geometric]
    over = _limit_use(path, limits, s, piece, np.full(len(s), speed)).max(0) > 1 + LIMIT_ROUNDING
    if not over.any():
        return None
    s, piece = s[over], piece[over]
    low, high = np.zeros(len(s)), np.full(len(s), speed)
    for _ in range(MAX_HALVINGS):
        middle = (low + high) / 2
        kept = _limit_use(path, limits, s, piece, middle).max(0) <= 1
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    worst = [int(np.argmin(low))]
    limit = limits[int(np.argmax(_limit_use(path, limits, s[worst], piece[worst], high[worst])[:, 0]))]
    value = limit.value(_state_at_speed(path, s[worst], piece[worst], np.array([speed])))
    channel = int(np.argmax(limit.use(value, value, piece[worst])[0]))
    unit, scale = limit.units[channel]
    reached, allowed = limit.report_value(float(value[0, channel]), channel, int(piece[worst[0]]))
    place = path.place(float(s[worst[0]]), int(piece[worst[0]]), None, limit.channels[channel])
    band = limit.first_band(channel) if isinstance(limit, Resonance) else ""
    remedy = (
        f"{band}so {speed * 1e3:.6g} mm/s cannot be kept constant: there it could be "
        f"{float(low[worst[0]]) * 1e3:.6g} mm/s; "
        "lower the speed, or omit speed_constant"
    )
    told = limit.name, limit.channels[channel], place, reached * scale, allowed * scale, unit, remedy
    return ConstantRefused(*told, requested=speed, possible=float(low[worst[0]]))


def _too_short_error(path: ActuatorPath, limits: Sequence[Limit], capped: Profile, speed: float) -> Infeasible:
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
        f"the segment is too short for its ramps, limited by the {timed[holding].name} of {channel}: "
        f"lower the speed below {fastest * 1e3:.6g} mm/s, or omit speed_constant"
    )
    told = "constant speed", channel, place, speed * 1e3, fastest * 1e3, "mm/s", remedy
    return ConstantRefused(*told, requested=speed, possible=fastest)


def _limit_use(path: ActuatorPath, limits: Sequence[Limit], s: Array, piece: np.ndarray, speed: Array) -> Array:
    """(limits, N) the largest share of each limit that constant speeds use at N places."""
    state = _state_at_speed(path, s, piece, speed)
    return np.stack([limit.use(value, value, piece).max(1) for limit in limits for value in [limit.value(state)]])


def _state_at_speed(path: ActuatorPath, s: Array, piece: np.ndarray, speed: Array) -> State:
    nothing = np.zeros(len(s))
    walk = Trajectory(path, np.arange(len(s) + 1.0), s, speed, nothing, nothing, piece)
    return walk.within(np.arange(len(s)), nothing)
