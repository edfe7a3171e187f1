"""Refusals of a constant speed: which limit, where, and which speed is possible."""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array, bisect
from planner.certificate.limit_use import LIMIT_ROUNDING
from planner.limits.limit import Limit, select_timed
from planner.limits.resonance import Resonance
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused, Infeasible
from planner.timing.grid import Task
from planner.timing.profile import Profile
from planner.trajectory import State, Trajectory

# Places of a run at which a band of resonance is looked for.
BAND_PLACES = 200


Places = tuple[Array, np.ndarray]
"""s (N,) of some places of a path, and their pieces (N,)."""


def _find_use(task: Task, places: Places, speed: Array) -> Array:
    """Return the largest use (N,) of any limit on time by constant speeds (N,) at N places.

    Geometric limits were proved before. One that is attained, as by a home at an end of travel,
    exceeds 1 by rounding.
    """
    state = _state_at_speed(task.path, places, speed)
    use = np.zeros(len(speed))
    for limit in select_timed(task.limits):
        use = np.maximum(use, limit.use_at(state).max(1))
    return use


def _state_at_speed(path: ActuatorPath, places: Places, speed: Array) -> State:
    s, piece = places
    zero = np.zeros(len(s))
    knots = np.arange(len(s) + 1.0)
    motion = Trajectory(path, knots, s, speed, zero, zero, piece)
    return motion.within(np.arange(len(s)), zero)


def _find_binding(limits: Sequence[Limit], state: State) -> tuple[Limit, int]:
    """Return the limit that a single state uses most, and its channel."""
    uses = [limit.use_at(state)[0] for limit in limits]
    most = int(np.argmax([use.max() for use in uses]))
    return limits[most], int(np.argmax(uses[most]))


def speed_error(task: Task, places: Places, speed: float) -> ConstantRefused | None:
    """Return the refusal of a constant speed that exceeds a limit at one of N places, or None.

    It names the place that allows the least speed.
    """
    path = task.path
    s, piece = places
    over = _find_use(task, places, np.full(len(s), speed)) > 1 + LIMIT_ROUNDING
    if not over.any():
        return None
    s = s[over]
    piece = piece[over]
    possible = bisect(
        lambda speeds: _find_use(task, (s, piece), speeds) <= 1,
        np.zeros(len(s)),
        np.full(len(s), speed),
    )
    worst = [int(np.argmin(possible))]
    possible_speed = float(possible[worst[0]])
    place = s[worst], piece[worst]
    fastest = _state_at_speed(path, place, possible[worst])
    limit, channel = _find_binding(select_timed(task.limits), fastest)
    value = limit.value(_state_at_speed(path, place, np.array([speed])))[0, channel]
    attained, allowed = limit.report_value(float(value), channel, int(piece[worst[0]]))
    name = limit.channels[channel]
    unit, scale = limit.units[channel]
    band = limit.first_band(channel) if isinstance(limit, Resonance) else ""
    return ConstantRefused(
        limit.name,
        name,
        path.place(s[worst[0]], piece[worst[0]], None, name),
        attained * scale,
        allowed * scale,
        unit,
        f"{band}so {speed * 1e3:.6g} mm/s cannot be kept constant: there it could be "
        f"{possible_speed * 1e3:.6g} mm/s; lower the speed, or omit speed_constant",
        requested=speed,
        possible=possible_speed,
    )


def too_short_error(task: Task, capped: Profile, speed: float) -> Infeasible:
    """Return the refusal of a segment that is too short for its ramps.

    capped  fastest motion under the speed: it shows how fast the tool gets, and what limits it
    """
    path = task.path
    k = np.array([max(int(np.argmax(capped.v)) - 1, 0)])
    others = [limit for limit in select_timed(task.limits) if limit.name != ToolSpeed.name]
    limit, number = _find_binding(others, capped.along(path).within(k, capped.h[k] / 2))
    channel = limit.channels[number]
    fastest = float(capped.v.max())
    return ConstantRefused(
        "constant speed",
        channel,
        path.place(capped.s[k[0]], capped.piece[k[0]], None, channel),
        speed * 1e3,
        fastest * 1e3,
        "mm/s",
        f"the segment is too short for its ramps, limited by the {limit.name} of {channel}: "
        f"lower the speed below {fastest * 1e3:.6g} mm/s, or omit speed_constant",
        requested=speed,
        possible=fastest,
    )


def resonance_error(task: Task, speed: float) -> Infeasible | None:
    """Return the refusal where the constant speed itself keeps an axis in a band too long."""
    path = task.path
    run = task.run
    breaks = run.breaks(path)
    for limit in task.limits:
        for cap in limit.held if isinstance(limit, Resonance) else ():
            since = max(cap.first, breaks[0])
            until = min(cap.last, breaks[-1])
            if since >= until:
                continue
            band = cap.band
            s = np.linspace(since, until, BAND_PLACES)
            inner = np.searchsorted(breaks, s, side="right") - 1
            piece = run.first + np.clip(inner, 0, len(breaks) - 2)
            slope = np.abs(path.derivatives(s, piece)[1][:, band.axis])
            inside = (slope * speed >= band.low) & (slope * speed <= band.high)
            if not inside.any():
                continue
            worst = int(np.argmax(np.where(inside, slope, -np.inf)))
            name = limit.channels[band.axis]
            unit, scale = limit.units[band.axis]
            first, last = s[np.flatnonzero(inside)[[0, -1]]] * 1e3
            below = band.low / slope[inside].max() * 1e3
            above = band.high / slope[inside].min() * 1e3
            return Infeasible(
                limit.name,
                name,
                path.place(s[worst], piece[worst], None, name),
                float(slope[worst]) * speed * scale,
                band.low * scale,
                unit,
                f"at {speed * 1e3:.6g} mm/s it stays in its resonance band of "
                f"{band.low * scale:.6g} to {band.high * scale:.6g} {unit} for longer than the "
                f"{band.time:.6g} s allowed, between s = {first:.6g} mm and {last:.6g} mm: "
                f"take a speed below {below:.6g} mm/s or above {above:.6g} mm/s",
            )
    return None
