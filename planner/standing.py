"""What no timing can help: reach, control, travel, tilt, clearance, holding; proved along the path before solving."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kinematics.errors import MotionError, OutOfReach
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.actuation import ActuatorPath, MachinePath
from planner.certify import along_path, count_reached
from planner.control import singular
from planner.departure import Departure, departure_tables
from planner.limits.limit import Limit
from planner.path.join import Blended, blend_tables
from planner.place import Infeasible, Place, where_columns
from planner.trajectory import State, Trajectory
from planner.walk import walk

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Points of a part of the path that are looked at for the worst place.
POINTS = 65


@dataclass(frozen=True, slots=True)
class Standing(Result):
    """Every violation, the worst first, and of each limit the largest use that is proved, and where.

    blends: what became of the program's joins that ask for one
    departures: how far its synchronised moves leave the straight line
    """

    violations: tuple[MotionError, ...]
    largest: dict[str, tuple[float, Place]]
    blends: tuple[Blended, ...] = ()
    departures: tuple[Departure, ...] = ()

    def tables(self) -> tuple[Table, ...]:
        """The largest use of each limit and where, the violations below; the blends."""
        uses = Table(
            "largest use of each limit, proved along the path",
            (
                Column("limit", [*self.largest]),
                Column("bound", [use for use, _ in self.largest.values()], form=".7f", up=True),
                *where_columns([place for _, place in self.largest.values()]),
            ),
            tuple(map(str, self.violations)),
        )
        return uses, *blend_tables(self.blends), *departure_tables(self.departures)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The largest use of each limit."""
        from kinematics.bars import bars

        uses = [use for use, _ in self.largest.values()]
        return bars([*self.largest], uses, "bound of value/limit along the path", ax, 1.0)


def standing(path: ActuatorPath, limits: Sequence[Limit]) -> Standing:
    """Bound the geometric limits over the path, walked at unit speed: what they use is the same under every timing."""
    along = walk(path)
    geometric = [limit for limit in limits if limit.geometric]
    everywhere = np.repeat(np.arange(len(along.s)), 3)
    state = along.within(everywhere, np.tile([0.0, 0.5, 1.0], len(along.s)) * np.diff(along.knots)[everywhere])
    lost = ~np.isfinite(state.q).all(1)
    if lost.any():
        first = int(np.argmax(lost))
        place = path.place(float(state.along[first]), int(state.piece[first]))
        return Standing((OutOfReach(f"no actuator coordinates reach the path at {place}; bring it nearer"),), {})
    if isinstance(path, MachinePath):
        met = singular(path, np.append(along.s, path.breaks[-1]), along.piece)
        if met is not None:
            where = f"the pose at {path.place(*met)} is singular, or too near to one to be told from it"
            lost_there = OutOfReach(f"{where}: the actuators do not hold the platform there; lead the path around it")
            return Standing((lost_there,), {})
    use = along_path(path, geometric)
    largest: dict[str, tuple[float, Place]] = {}
    found: dict[tuple[str, int, int], tuple[float, Infeasible]] = {}
    for limit in geometric:
        bound = use[limit.name]
        worst, broken = int(np.argmax(bound)), np.flatnonzero(bound > 1).tolist()
        for part in {worst, *broken}:
            look = _look(along, part)
            value = limit.value(look)
            uses = limit.use(value, value, look.piece)
            rows, most = uses.argmax(0), uses.max(0)
            top, piece = int(np.argmax(most)), int(look.piece[0])
            places = [
                path.place(float(look.along[row]), piece, None, name)
                for row, name in zip(rows, limit.channels, strict=True)
            ]
            if part == worst:
                largest[limit.name] = float(bound[part]), places[top]
            # a peak between the points looked at is proved all the same
            for channel in {top, *np.flatnonzero(count_reached(most) > 1).tolist()} if part in broken else ():
                if most[channel] > found.get((limit.name, piece, channel), (0.0,))[0]:
                    told = refusal(limit, float(value[rows[channel], channel]), channel, places[channel])
                    found[limit.name, piece, channel] = float(most[channel]), told
    return Standing(tuple(told for _, told in sorted(found.values(), key=lambda pair: -pair[0])), largest)


def _look(along: Trajectory, part: int) -> State:
    span = along.knots[part + 1] - along.knots[part]
    return along.within(np.full(POINTS, part), span * np.linspace(0.0, 1.0, POINTS))


def refusal(limit: Limit, value: float, channel: int, place: Place) -> Infeasible:
    """What to say where a geometric limit is broken."""
    unit, scale = limit.units[channel]
    reached, allowed = (each * scale for each in limit.told(value, channel))
    remedy = limit.remedy(abs(reached - allowed), unit)
    return Infeasible(limit.name, limit.channels[channel], place, reached, allowed, unit, remedy)
