"""The certificate: a bound of every limit over continuous time, from the trajectory and the limits' `value` alone.

Time is cut into cells; over each, the motion is enclosed by Taylor series (planner.enclosure) and a limit's value
follows by its own formula. A cell's bound is its largest Bernstein coefficient plus the error; cells are cut until the
bounds are tight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from kinematics.array import Array, frozen
from kinematics.result import Result
from kinematics.table import Column, Table
from planner.actuation import ActuatorPath
from planner.continuity import JUMP, STATES, ends, gaps, jumps, place_at
from planner.enclosure import Cells, bounds, enclose
from planner.limits.limit import Limit, order_of
from planner.limits.resonance import Resonance
from planner.place import Place, where_columns
from planner.stays import stays
from planner.steadiness import CONSTANT, claimed, unsteadiness
from planner.trajectory import Trajectory
from planner.walk import walk

if TYPE_CHECKING:
    from matplotlib.axes import Axes

REACHED = 1e-9
"""What is stated may reach a limit exactly, and then counts as 1: places, and motions that have to meet stated speeds,
whose bounds may be beyond 1 by so much rounding. What the timing chooses freely is never above 1."""
# How small and how many cells may become until their bounds are tight.
SMALLEST, MOST_CELLS = 2.0**-24, 400_000
# Cells are cut in two; up to so many, where an evaluation costs the same for one as for all, in more.
FEW, PARTS = 64, 8
CROSSING = "resonance crossing"
"""What no value at an instant tells: the longest stay of an axis in a band of speed, over the time allowed."""
# Order of the expansions in time, by the highest derivative: q̈ or q⃛ keep a polynomial of degree 3 or 4.
EXPANSION = {2: 6, 3: 8}
# Instants of a time piece that are looked at for where it uses a limit most (the bound itself needs none).
LOOKED = 201
# Cells that are looked at together: their series stay in the processor's cache.
TOGETHER = 1024


@dataclass(frozen=True, slots=True)
class Certificate(Result):
    """worst: proven upper bound of value/limit over continuous time, per limit; where: the place of each.

    use       per limit, the proven bound over each time piece of the trajectory (M,); worst is its maximum
    attained  per limit, the largest value/limit met in each time piece (M,): the truth lies between the two
    """

    holds: bool
    worst: dict[str, float]
    where: dict[str, Place]
    use: dict[str, Array] = field(repr=False)
    attained: dict[str, Array] = field(repr=False)

    def tables(self) -> tuple[Table, ...]:
        """The worst proven use of each limit, and where."""
        head = "the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD"
        ratios = Column("bound", [*self.worst.values()], form=".7f", up=True)
        where = where_columns([self.where[name] for name in self.worst])
        names = Column("limit", [*self.worst])
        return (Table(f"{head}: value/limit, bounded over continuous time", (names, ratios, *where)),)

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """The worst proven use of each limit; planner.plots.limit_use shows that of a plan over time."""
        from kinematics.bars import bars

        return bars([*self.worst], [*self.worst.values()], "bound of value/limit", ax, 1.0)


@dataclass(frozen=True, slots=True)
class Known:
    """What is proved already: per limit, use and attained of each time piece (M,), NaN where nothing is yet.

    Of geometric limits, what is attained: what they use is proved along the path.
    """

    use: dict[str, Array]
    attained: dict[str, Array]

    @classmethod
    def nothing(cls, limits: Sequence[Limit], pieces: int) -> "Known":
        names = [[limit.name for limit in some] for some in ([each for each in limits if not each.geometric], limits)]
        use, attained = ({name: np.full(pieces, np.nan) for name in each} for each in names)
        return cls(use, attained)

    @classmethod
    def joined(cls, parts: "Sequence[Known]") -> "Known":
        """Of time pieces one after the other."""
        use, attained = (
            {name: np.concatenate([getattr(part, each)[name] for part in parts]) for name in getattr(parts[0], each)}
            for each in ("use", "attained")
        )
        return cls(use, attained)


def certify(trajectory: Trajectory, limits: Sequence[Limit], known: Known | None = None) -> Certificate:
    """Prove what the trajectory uses of every limit, and that it is the motion asked for.

    It runs the whole path once, forwards, from rest to rest or between the speeds that the path states for its ends,
    and is as smooth as its order asks: nothing jumps.

    known spares the work on time pieces of which the timing limits are proved already. What a geometric limit uses
    depends on the place alone: it is proved once along the path, and each time piece has what the parts of the path
    use through which it passes.
    """
    order = order_of(limits)
    timed, standing = ([limit for limit in limits if limit.geometric is still] for still in (False, True))
    use, attained = prove(trajectory, timed, order, known)
    use |= _placed(trajectory, standing)
    attained |= at_knots(trajectory, standing, known)
    worst = {name: float(values.max()) for name, values in use.items()}
    most = {limit.name: attained if limit.geometric else use for limit in limits}
    where = {limit.name: _place(trajectory, limit, int(np.argmax(most[limit.name][limit.name]))) for limit in limits}
    for limit in limits:
        if isinstance(limit, Resonance) and limit.bands:
            use[CROSSING], attained[CROSSING], where[CROSSING] = _crossing(trajectory, limit)
            worst[CROSSING] = float(use[CROSSING].max())
    if np.isfinite(claimed(trajectory)).any():
        use[CONSTANT], attained[CONSTANT], where[CONSTANT] = unsteadiness(trajectory)
        worst[CONSTANT] = float(use[CONSTANT].max())
    for name, place in (jumps(trajectory, order) | gaps(trajectory)).items():
        worst[name], where[name] = float("inf"), place
    return Certificate(
        holds=all(value <= 1 for value in worst.values()),
        worst=worst,
        where=where,
        use={name: frozen(values) for name, values in use.items()},
        attained={name: frozen(values) for name, values in attained.items()},
    )


def prove(
    trajectory: Trajectory, limits: Sequence[Limit], order: int, known: Known | None = None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Per limit, the proven bound of its use over each time piece (M,), and the largest use met there."""
    lengths = np.diff(trajectory.knots)
    whole = Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)[lengths > 0]
    use = {limit.name: np.zeros(len(lengths)) for limit in limits}
    attained = {limit.name: np.zeros(len(lengths)) for limit in limits}
    cells = whole
    if known is not None:
        for name, values in use.items():
            for new, old in ((values, known.use[name]), (attained[name], known.attained[name])):
                new[:] = np.where(np.isnan(old), 0.0, old)
        cells = whole[np.isnan(known.use[limits[0].name])[whole.k]]
    share, stated = 1.0, _states_speeds(trajectory.path)
    while True:
        bound, met = _judge(trajectory, limits, cells, order)
        for n, limit in enumerate(limits):
            if limit.geometric or stated:
                bound[n], met[n] = count_reached(bound[n]), count_reached(met[n])
        loose = np.zeros(len(cells.k), bool)
        for n, limit in enumerate(limits):
            values = attained[limit.name]
            np.maximum.at(values, cells.k, met[n])
            loose |= bound[n] > np.maximum(met[n], min(values.max(), 1.0)) + limit.tight(met[n])
            loose |= (bound[n] > 1) & (met[n] <= 1)
        parts = PARTS if loose.sum() <= FEW else 2
        share /= parts
        if share < SMALLEST or parts * loose.sum() > MOST_CELLS:
            loose[:] = False
        for n, values in enumerate(use.values()):
            np.maximum.at(values, cells.k[~loose], bound[n, ~loose])
        if not loose.any():
            break
        cells = cells[loose].parts(parts)
    return use, attained


def count_reached(use: Array) -> Array:
    """Shares of limits, of which those that are beyond 1 by rounding count as 1."""
    return np.where((use > 1) & (use <= 1 + REACHED), 1.0, use)


def _states_speeds(path: ActuatorPath) -> bool:
    """Whether a path states speeds, which its motion then has to meet exactly."""
    return max(path.end_speeds) > 0 or any(path.constant(k) is not None for k in range(len(path.breaks) - 1))


_ALONG: WeakKeyDictionary[ActuatorPath, tuple[tuple[Limit, ...], dict[str, Array]]] = WeakKeyDictionary()


def along_path(path: ActuatorPath, limits: Sequence[Limit]) -> dict[str, Array]:
    """Per geometric limit, the proven bound of its use on every part of `walk(path)`; proved once for a path."""
    known, use = _ALONG.get(path, ((), {}))
    if len(known) != len(limits) or any(a is not b for a, b in zip(known, limits, strict=True)):
        use, _ = prove(walk(path), limits, 2)
        _ALONG[path] = tuple(limits), use
    return use


def _placed(trajectory: Trajectory, limits: Sequence[Limit]) -> dict[str, Array]:
    """Per geometric limit, the proven bound of its use over each time piece (M,): that of the parts of the path met."""
    if not limits:
        return {}
    along = walk(trajectory.path)
    proven = along_path(trajectory.path, limits)
    s = np.append(trajectory.s, ends(trajectory)[-1:])
    slack = JUMP * (along.s[-1] - along.s[0])  # by which `gaps` lets a motion stray
    first = np.searchsorted(along.s, np.minimum(s[:-1], s[1:]) - slack, side="right") - 1
    last = np.searchsorted(along.s, np.maximum(s[:-1], s[1:]) + slack, side="right")
    ranges = np.stack([np.clip(first, 0, len(along.s) - 1), np.maximum(last, 1)], 1).ravel()
    return {name: np.maximum.reduceat(np.append(values, 0.0), ranges)[::2] for name, values in proven.items()}


def at_knots(trajectory: Trajectory, limits: Sequence[Limit], known: Known | None = None) -> dict[str, Array]:
    """Per geometric limit, the larger use attained at the two ends of each time piece (M,); known: what is already.

    A knot is one place: what the path uses there is the same on both sides.
    """
    pieces = len(trajectory.s)
    nothing = np.full(pieces, np.nan)
    found = {limit.name: nothing.copy() if known is None else known.attained[limit.name].copy() for limit in limits}
    new = np.flatnonzero(np.isnan(found[limits[0].name])) if limits else np.zeros(0, int)
    knots = np.union1d(new, new + 1)
    k = np.minimum(knots, pieces - 1)
    tau = np.where(knots < pieces, 0.0, np.diff(trajectory.knots)[k])
    met = {limit.name: np.empty(pieces + 1) for limit in limits}
    for some in (slice(first, first + STATES) for first in range(0, len(knots), STATES)):
        state = trajectory.within(k[some], tau[some])
        for limit in limits:
            value = limit.value(state)
            met[limit.name][knots[some]] = limit.use(value, value, state.piece).max(1)
    for name, values in met.items():
        found[name][new] = count_reached(np.maximum(values[new], values[new + 1]))
    return found


def _judge(trajectory: Trajectory, limits: Sequence[Limit], cells: Cells, order: int) -> tuple[Array, Array]:
    """Over each of N cells, the bound of every limit's use over all its channels, and the use attained: (limits, N).

    The bound comes from the enclosure, the attained use from the motion itself at each cell's ends and centre.
    """
    bound, met = np.zeros((len(limits), len(cells.k))), np.zeros((len(limits), len(cells.k)))
    for first in range(0, len(cells.k), TOGETHER):
        chosen = np.arange(first, min(first + TOGETHER, len(cells.k)))
        some = cells[chosen]
        enclosure = enclose(trajectory, some, EXPANSION[order])
        places = np.concatenate([some.lo, (some.lo + some.hi) / 2, some.hi])
        seen = trajectory.within(np.tile(some.k, 3), places, jerk=order == 3)
        with np.errstate(invalid="ignore", over="ignore"):
            for n, limit in enumerate(limits):
                bound[n, chosen] = limit.use(*bounds(limit.value(enclosure), len(chosen)), enclosure.piece).max(1)
                value = limit.value(seen)
                met[n, chosen] = limit.use(value, value, seen.piece).max(1).reshape(3, -1).max(0)
    return np.where(np.isnan(bound), np.inf, bound), np.where(np.isnan(met), np.inf, met)


def _crossing(trajectory: Trajectory, limit: Resonance) -> tuple[Array, Array, Place]:
    """The longest stay that each time piece has part in, as a share of the time allowed: what is proved and what is
    attained (M,), and where the longest of all begins.
    """
    use, attained = np.zeros((2, len(trajectory.s)))
    longest, place = 0.0, place_at(trajectory, 0.0, "")
    for stay in stays(trajectory, limit):
        part = slice(stay.first, stay.last + 1)
        np.maximum(use[part], stay.use, out=use[part])
        np.maximum(attained[part], stay.inside / stay.band.time, out=attained[part])
        if stay.use > longest:
            longest, place = stay.use, place_at(trajectory, stay.start, limit.channels[stay.band.axis])
    return use, attained, place


def _place(trajectory: Trajectory, limit: Limit, k: int) -> Place:
    """Where in time piece k, and in which channel, a limit is used most."""
    span = trajectory.knots[k + 1] - trajectory.knots[k]
    state = trajectory.within(np.full(LOOKED, k), span * np.linspace(0.0, 1.0, LOOKED))
    value = limit.value(state)
    row, channel = np.unravel_index(int(np.argmax(limit.use(value, value, state.piece))), value.shape)
    return place_at(trajectory, float(state.t[row]), limit.channels[int(channel)])
