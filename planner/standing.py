"""What no timing can help: reach, travel, tilt, clearance, holding still; proved along the path before solving."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.errors import MotionError, OutOfReach
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE, prove
from planner.limits.limit import Limit
from planner.path.join import Blended
from planner.place import Infeasible, Place
from planner.trajectory import State, Trajectory

# Parts of a piece at least, and for each radian that it turns; points of a part that are looked at for the worst place.
PARTS, PER_RADIAN, POINTS = 8, 4, 65


@dataclass(frozen=True, slots=True)
class Standing:
    """Every violation, the worst first, and of each limit the largest use that is proved, and where.

    blends: what became of the program's joins that ask for one
    """

    violations: tuple[MotionError, ...]
    largest: dict[str, tuple[float, Place]]
    blends: tuple[Blended, ...] = ()


def standing(path: ActuatorPath, limits: Sequence[Limit]) -> Standing:
    """Bound the geometric limits over the path, walked at unit speed: what they use is the same under every timing."""
    walk = _walk(path)
    geometric = [limit for limit in limits if limit.geometric]
    everywhere = np.repeat(np.arange(len(walk.s)), 3)
    state = walk.within(everywhere, np.tile([0.0, 0.5, 1.0], len(walk.s)) * np.diff(walk.knots)[everywhere])
    lost = ~np.isfinite(state.q).all(1)
    if lost.any():
        first = int(np.argmax(lost))
        place = path.place(float(state.s[first]), int(state.piece[first]))
        return Standing((OutOfReach(f"no actuator coordinates reach the path at {place}; bring it nearer"),), {})
    use, _ = prove(walk, geometric, 2)
    largest: dict[str, tuple[float, Place]] = {}
    found: dict[tuple[str, int, int], tuple[float, Infeasible]] = {}
    for limit in geometric:
        bound = use[limit.name]
        worst, broken = int(np.argmax(bound)), np.flatnonzero(bound > 1 + TOLERANCE).tolist()
        for part in {worst, *broken}:
            look = _look(walk, part)
            value = limit.value(look)
            uses = limit.use(value, value, look.piece)
            rows, most = uses.argmax(0), uses.max(0)
            top, piece = int(np.argmax(most)), int(look.piece[0])
            places = [
                path.place(float(look.s[row]), piece, None, name)
                for row, name in zip(rows, limit.channels, strict=True)
            ]
            if part == worst:
                largest[limit.name] = float(bound[part]), places[top]
            # a peak between the points looked at is proved all the same
            for channel in {top, *np.flatnonzero(most > 1 + TOLERANCE).tolist()} if part in broken else ():
                if most[channel] > found.get((limit.name, piece, channel), (0.0,))[0]:
                    told = refusal(limit, float(value[rows[channel], channel]), channel, places[channel])
                    found[limit.name, piece, channel] = float(most[channel]), told
    return Standing(tuple(told for _, told in sorted(found.values(), key=lambda pair: -pair[0])), largest)


def _walk(path: ActuatorPath) -> Trajectory:
    counts = np.maximum(PARTS, np.ceil(PER_RADIAN * path.turns)).astype(int)
    s = [np.linspace(path.breaks[k], path.breaks[k + 1], count + 1)[:-1] for k, count in enumerate(counts)]
    knots = np.append(np.concatenate(s), path.breaks[-1])
    nothing = np.zeros(len(knots) - 1)
    piece = np.repeat(np.arange(len(counts)), counts)
    return Trajectory(path, knots - knots[0], knots[:-1], nothing + 1, nothing, nothing, piece)


def _look(walk: Trajectory, part: int) -> State:
    span = walk.knots[part + 1] - walk.knots[part]
    return walk.within(np.full(POINTS, part), span * np.linspace(0.0, 1.0, POINTS))


def refusal(limit: Limit, value: float, channel: int, place: Place) -> Infeasible:
    """What to say where a geometric limit is broken."""
    unit, scale = limit.units[channel]
    reached, allowed = (each * scale for each in limit.told(value, channel))
    remedy = limit.remedy(abs(reached - allowed), unit)
    return Infeasible(limit.name, limit.channels[channel], place, reached, allowed, unit, remedy)
