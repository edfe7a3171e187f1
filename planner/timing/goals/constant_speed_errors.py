"""Refusals of a constant speed: which limit, where, and which speed is possible."""

from collections.abc import Sequence

import numpy as np

from kinematics.foundation.arrays import Array
from planner.certificate.limit_use import LIMIT_ROUNDING
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.limits.tool import ToolSpeed
from planner.path.actuation import ActuatorPath
from planner.place import ConstantRefused, Infeasible
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.trajectory import State, Trajectory

# Halvings for the largest possible speed: down to rounding.
MAX_HALVINGS = 50
# Places of a run at which a band of resonance is looked for.
BAND_PLACES = 200


def find_use(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    speed: Array,
) -> Array:
    """Return the largest use (limits, N) of each limit by constant speeds (N,) at N places."""
    state = _state_at_speed(path, s, piece, speed)
    uses = []
    for limit in limits:
        value = limit.value(state)
        uses.append(limit.use(value, value, piece).max(1))
    return np.stack(uses)


def _state_at_speed(path: ActuatorPath, s: Array, piece: np.ndarray, speed: Array) -> State:
    zero = np.zeros(len(s))
    knots = np.arange(len(s) + 1.0)
    motion = Trajectory(path, knots, s, speed, zero, zero, piece)
    return motion.within(np.arange(len(s)), zero)


def is_allowed(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    speed: float,
) -> bool:
    """Return whether all limits allow a constant speed at all places."""
    use = find_use(path, limits, s, piece, np.full(len(s), speed))
    return bool(use.max() <= 1 + LIMIT_ROUNDING)


def speed_error(
    path: ActuatorPath,
    limits: Sequence[Limit],
    s: Array,
    piece: np.ndarray,
    speed: float,
) -> ConstantRefused | None:
    """Return the refusal of a constant speed that breaks a limit at one of N places, or None.

    It names the place that allows the least speed. Geometric limits were proved before and do not
    depend on speed; one that is used up, as by a home at an end of travel, exceeds 1 by rounding.
    """
    limits = [limit for limit in limits if not limit.geometric]
    use = find_use(path, limits, s, piece, np.full(len(s), speed)).max(0)
    over = use > 1 + LIMIT_ROUNDING
    if not over.any():
        return None
    s = s[over]
    piece = piece[over]
    low = np.zeros(len(s))
    high = np.full(len(s), speed)
    for _ in range(MAX_HALVINGS):
        middle = (low + high) / 2
        possible = find_use(path, limits, s, piece, middle).max(0) <= 1
        low = np.where(possible, middle, low)
        high = np.where(possible, high, middle)
    worst = [int(np.argmin(low))]
    use_there = find_use(path, limits, s[worst], piece[worst], high[worst])
    limit = limits[int(np.argmax(use_there[:, 0]))]
    value = limit.value(_state_at_speed(path, s[worst], piece[worst], np.array([speed])))
    channel = int(np.argmax(limit.use(value, value, piece[worst])[0]))
    name = limit.channels[channel]
    unit, scale = limit.units[channel]
    attained, allowed = limit.report_value(float(value[0, channel]), channel, int(piece[worst[0]]))
    band = limit.first_band(channel) if isinstance(limit, Resonance) else ""
    possible_speed = float(low[worst[0]])
    return ConstantRefused(
        limit.name,
        name,
        path.place(float(s[worst[0]]), int(piece[worst[0]]), None, name),
        attained * scale,
        allowed * scale,
        unit,
        f"{band}so {speed * 1e3:.6g} mm/s cannot be kept constant: there it could be "
        f"{possible_speed * 1e3:.6g} mm/s; lower the speed, or omit speed_constant",
        requested=speed,
        possible=possible_speed,
    )


def too_short_error(
    path: ActuatorPath,
    limits: Sequence[Limit],
    capped: Profile,
    speed: float,
) -> Infeasible:
    """Return the refusal of a segment that is too short for its ramps.

    capped  fastest motion under the speed: it shows how fast the tool gets, and what limits it
    """
    k = np.array([max(int(np.argmax(capped.v)) - 1, 0)])
    state = capped.along(path).within(k, capped.h[k] / 2)
    timed = [limit for limit in limits if not limit.geometric and limit.name != ToolSpeed.name]
    values = [limit.value(state) for limit in timed]
    uses = [limit.use(value, value, state.piece)[0] for limit, value in zip(timed, values, strict=True)]
    binding = int(np.argmax([use.max() for use in uses]))
    limit = timed[binding]
    channel = limit.channels[int(np.argmax(uses[binding]))]
    fastest = float(capped.v.max())
    return ConstantRefused(
        "constant speed",
        channel,
        path.place(float(capped.s[k[0]]), int(capped.piece[k[0]]), None, channel),
        speed * 1e3,
        fastest * 1e3,
        "mm/s",
        f"the segment is too short for its ramps, limited by the {limit.name} of {channel}: "
        f"lower the speed below {fastest * 1e3:.6g} mm/s, or omit speed_constant",
        requested=speed,
        possible=fastest,
    )


def resonance_error(
    path: ActuatorPath,
    limits: Sequence[Limit],
    run: Run,
    speed: float,
) -> Infeasible | None:
    """Return the refusal where the constant speed itself keeps an axis in a band too long."""
    breaks = run.breaks(path)
    for limit in limits:
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
                path.place(float(s[worst]), int(piece[worst]), None, name),
                float(slope[worst]) * speed * scale,
                band.low * scale,
                unit,
                f"at {speed * 1e3:.6g} mm/s it stays in its resonance band of "
                f"{band.low * scale:.6g} to {band.high * scale:.6g} {unit} for longer than the "
                f"{band.time:.6g} s allowed, between s = {first:.6g} mm and {last:.6g} mm: "
                f"take a speed below {below:.6g} mm/s or above {above:.6g} mm/s",
            )
    return None
