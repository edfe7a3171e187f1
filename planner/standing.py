"""What no timing can help: travel and tilt along the path, looked at before anything is solved."""

from collections.abc import Sequence

import numpy as np

from kinematics.array import Array
from kinematics.errors import OutOfReach
from planner.actuation import ActuatorPath
from planner.limits.limit import Limit
from planner.place import Infeasible, Place
from planner.trajectory import State

# Points looked at in each piece; what lies between them is the certificate's to find.
POINTS = 201
ROUNDING = 1e-9


def at_rest(path: ActuatorPath, s: Array, piece: np.ndarray) -> State:
    """The state of standing still at places along a path."""
    q = path.derivatives(s, piece)[0]
    nothing = np.zeros_like(q)
    return State(np.full(len(s), np.nan), s, q, nothing, nothing, nothing, np.zeros(len(s)), path, piece)


def violations(path: ActuatorPath, limits: Sequence[Limit]) -> list[Infeasible]:
    """One for every piece, limit and channel that is exceeded, at its worst place, worst first. Raises OutOfReach."""
    pieces = len(path.breaks) - 1
    piece = np.repeat(np.arange(pieces), POINTS)
    s = (path.breaks[:-1, None] + np.diff(path.breaks)[:, None] * np.linspace(0, 1, POINTS)).ravel()
    state = at_rest(path, s, piece)
    lost = ~np.isfinite(state.q).all(1)
    if lost.any():
        first = int(np.argmax(lost))
        place = Place(float(s[first]), path.segment(int(piece[first])))
        raise OutOfReach(f"no actuator coordinates reach the path at {place}; bring the path nearer")
    found: list[tuple[float, Infeasible]] = []
    for limit in limits:
        if not limit.geometric:
            continue
        value = limit.value(state)
        use = limit.use(value, value, piece).reshape(pieces, POINTS, -1)
        for n, channel in np.argwhere(use.max(1) > 1 + ROUNDING):
            row = n * POINTS + int(np.argmax(use[n, :, channel]))
            place = Place(float(s[row]), path.segment(int(n)), None, limit.channels[channel])
            told = refusal(limit, float(value[row, channel]), int(channel), place)
            found.append((float(use[n, :, channel].max()), told))
    return [told for _, told in sorted(found, key=lambda pair: -pair[0])]


def refusal(limit: Limit, value: float, channel: int, place: Place) -> Infeasible:
    """What to say where a geometric limit is broken."""
    unit, scale = limit.units[channel]
    reached, allowed = limit.told(value, channel)
    remedy = f"no timing can help: move the path so that it uses {abs(reached - allowed) * scale:.4g} {unit} less"
    return Infeasible(limit.name, limit.channels[channel], place, reached * scale, allowed * scale, unit, remedy)
