"""What a motion uses of each limit, proved over cells of time that are cut until their bounds are tight."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.foundation.arrays import Array, largest_in_rows
from planner.certificate.continuity import INSTANT_ROUNDING
from planner.certificate.enclosure import Cells, bound_series, enclose, find_extremes
from planner.certificate.ranges import Ranges, bound_balls, bound_ranges
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.trajectory import State, Trajectory

LIMIT_ROUNDING = 1e-9
"""What is stated may reach a limit exactly, and then counts as 1: places, and motions that have to meet stated speeds,
whose bounds may be beyond 1 by so much rounding. What the timing chooses freely is never above 1."""
# How small and how many cells may become until their bounds are tight.
MIN_CELL_SHARE, MAX_CELLS = 2.0**-24, 400_000
# Cells are cut in two; up to so many, where an evaluation costs the same for one as for all, in more.
FEW_CELLS, CELL_PARTS = 64, 8
# Order of the expansions in time, by the highest derivative: q̈ or q⃛ keep a polynomial of degree 3 or 4.
EXPANSION = {2: 6, 3: 8}
# Cells that are looked at together: their series stay in the processor's cache.
CELL_BATCH, LOOK_BATCH = 1024, 1 << 13
# Cells in a row that are first looked at as one, where there are so many or more.
GROUP_CELLS, MIN_GROUPED = 16, 512


@dataclass(frozen=True, slots=True)
class ProvedUse:
    """What is proved already: per limit, use and attained of each time piece (M,), NaN where nothing is yet.

    Of geometric limits, what is attained: what they use is proved along the path.

    of  (6, M)  that it was proved of: s, ṡ, s̈ at the start, s⃛, duration and path piece of each time piece
    """

    use: dict[str, Array]
    attained: dict[str, Array]
    of: Array

    @classmethod
    def make_empty(cls, limits: Sequence[Limit], pieces: int) -> "ProvedUse":
        names = [[limit.name for limit in some] for some in ([each for each in limits if not each.geometric], limits)]
        use, attained = ({name: np.full(pieces, np.nan) for name in each} for each in names)
        return cls(use, attained, np.full((6, pieces), np.nan))

    @classmethod
    def join(cls, parts: "Sequence[ProvedUse]") -> "ProvedUse":
        """Of time pieces one after the other."""
        use, attained = (
            {name: np.concatenate([getattr(part, each)[name] for part in parts]) for name in getattr(parts[0], each)}
            for each in ("use", "attained")
        )
        return cls(use, attained, np.concatenate([part.of for part in parts], axis=1))

    def fit(self, trajectory: Trajectory) -> "ProvedUse":
        """What of it is of a trajectory: of time pieces with other numbers, rounded instants aside, nothing."""
        lengths = np.diff(trajectory.knots)
        own = np.stack([trajectory.s, trajectory.v, trajectory.a, trajectory.j, self.of[4], trajectory.piece])
        with np.errstate(invalid="ignore"):
            rounded = np.abs(lengths - self.of[4]) <= INSTANT_ROUNDING * trajectory.knots[1:]
        same = rounded & (own == self.of).all(0)
        if same.all():
            return self
        kinds = self.use, self.attained
        use, attained = ({name: np.where(same, values, np.nan) for name, values in each.items()} for each in kinds)
        return ProvedUse(use, attained, self.of)


def prove(
    trajectory: Trajectory, limits: Sequence[Limit], order: int, known: ProvedUse | None = None
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Per limit, the proven bound of its use over each time piece (M,), and the largest use met there."""
    lengths = np.diff(trajectory.knots)
    whole = Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)[lengths > 0]
    use = {limit.name: np.zeros(len(lengths)) for limit in limits}
    attained = {limit.name: np.zeros(len(lengths)) for limit in limits}
    cells = whole
    if known is not None:
        unknown = np.any([np.isnan(known.use[name]) for name in use], axis=0)
        for name, values in use.items():
            for new, old in ((values, known.use[name]), (attained[name], known.attained[name])):
                new[:] = np.where(unknown, 0.0, old)
        cells = whole[unknown[whole.k]]
    if not len(cells.k):
        return use, attained
    # what geometry asks for is not bounded over time
    look = _bound_use if any(limit.geometric for limit in limits) else _look_at_use
    stated = _has_stated_speeds(trajectory.path)
    for limit, bound, met in zip(limits, *look(trajectory, limits, cells, order), strict=True):
        first, rounds = look is _look_at_use, limit.geometric or stated
        seen = cells, bound, met
        _tighten_cells(trajectory, limit, order, seen, first, rounds, use[limit.name], attained[limit.name])
    return use, attained


def _tighten_cells(
    trajectory: Trajectory,
    limit: Limit,
    order: int,
    seen: tuple[Cells, Array, Array],
    first: bool,
    rounds: bool,
    use: Array,
    attained: Array,
) -> None:
    """Cut cells until their bounds are tight, and fill use and attained (M,) of the time pieces.

    seen: cells, and the bound and the use met of each; first: at a first look, after which series in time are due
    rounds: whether the limit may be reached
    """
    (cells, bound, met), share = seen, 1.0
    while True:
        if rounds:
            bound, met = round_reached_use(bound), round_reached_use(met)
        np.maximum.at(attained, cells.k, met)
        known_most = np.maximum(met, min(attained.max(), 1.0))
        loose = bound > known_most + limit.tight(known_most)
        loose |= (bound > 1) & (met <= 1)
        with np.errstate(invalid="ignore"):  # of what has no bound
            over = np.nanmax((bound - attained.max()) / limit.tight(known_most), where=loose, initial=1.0)
        # bounds close in with the square of a cell at least
        parts = 1 if first else int(np.clip(np.ceil(np.sqrt(over)), 2, CELL_PARTS if loose.sum() <= FEW_CELLS else 2))
        share, first = share / parts, False
        if share < MIN_CELL_SHARE or parts * loose.sum() > MAX_CELLS:
            loose[:] = False
        np.maximum.at(use, cells.k[~loose], bound[~loose])
        if not loose.any():
            return
        cells = cells[loose].parts(parts) if parts > 1 else cells[loose]
        (bound,), (met,) = _bound_use(trajectory, [limit], cells, order)


def round_reached_use(use: Array) -> Array:
    """Shares of limits, of which those that are beyond 1 by rounding count as 1."""
    return np.where((use > 1) & (use <= 1 + LIMIT_ROUNDING), 1.0, use)


def _has_stated_speeds(path: ActuatorPath) -> bool:
    """Whether a path states speeds, which its motion then has to meet exactly."""
    return max(path.end_speeds) > 0 or any(path.constant(k) is not None for k in range(len(path.breaks) - 1))


def _look_at_use(trajectory: Trajectory, limits: Sequence[Limit], cells: Cells, order: int) -> tuple[Array, Array]:
    """Over each of N cells, as `_bound_use` but cheaper: bounds from ranges, and the use attained at some instants.

    Of many, groups first, each as a whole and at the centre of one: the cells only of those that may use the most.
    """
    bound, met = np.zeros((2, len(limits), len(cells.k)))
    alone = all(limit.by_axis for limit in limits)
    for begin in range(0, len(cells.k), LOOK_BATCH):
        some = cells[np.arange(begin, min(begin + LOOK_BATCH, len(cells.k)))]
        piece, every = trajectory.piece[some.k], np.arange(len(some.k))
        with np.errstate(invalid="ignore", over="ignore"):
            ranges, whole = bound_ranges(trajectory, some, order), None
            groups = _group(trajectory, ranges, some, order) if len(every) >= MIN_GROUPED and not alone else None
            for n, limit in enumerate(limits):
                found, seen, rest = np.zeros(len(every)), np.zeros(len(every)), every
                if limit.by_axis:
                    (found, seen), rest = _use_of_axes(limit, ranges), every[:0]
                    most = np.maximum(seen, min(seen.max(), 1.0))
                    loose = np.flatnonzero((found > most + limit.tight(most)) & (found < np.inf))
                    if len(loose):  # once more, in parts
                        parts, rows = some[loose].parts(CELL_PARTS), np.tile(loose, CELL_PARTS)
                        closer = _use_of_axes(limit, ranges.range_over(trajectory, parts, rows))
                        found[loose], seen[loose] = (use.reshape(CELL_PARTS, -1).max(0) for use in closer)
                elif groups is not None:
                    one, state, merged, group = groups
                    most = largest_in_rows(limit.use(*bound_balls(limit.value(merged)), merged.piece))
                    seen[one] = _use_of(limit, state)
                    enough = min(seen.max(), 1.0) + limit.tight(seen.max())
                    found, rest = most[group], np.flatnonzero(~(most < enough)[group])
                if len(rest) == len(every):
                    whole = whole or _states(trajectory, some, 0.5, order)
                    found = largest_in_rows(limit.use(*bound_balls(limit.value(ranges)), piece))
                    seen = _use_of(limit, whole)
                elif len(rest):
                    mine = ranges[rest]
                    found[rest] = largest_in_rows(limit.use(*bound_balls(limit.value(mine)), mine.piece))
                    seen[rest] = _use_of(limit, _states(trajectory, some[rest], 0.5, order))
                bound[n, begin + every], met[n, begin + every] = found, seen
    return np.where(np.isnan(bound), np.inf, bound), np.where(np.isnan(met), np.inf, met)


def _use_of_axes(limit: Limit, ranges: Ranges) -> tuple[Array, Array]:
    """(N,) the bound of the use of a limit that looks at axes one by one, and the use that is met for certain."""
    least, most = (limit.value(each).mid[0] for each in ranges.met)
    bound = limit.use(*bound_balls(limit.value(ranges)), ranges.piece)
    return largest_in_rows(bound), largest_in_rows(limit.use(least, most, ranges.piece))


def _group(
    trajectory: Trajectory, ranges: Ranges, cells: Cells, order: int
) -> tuple[np.ndarray, State, Ranges, np.ndarray]:
    """Cells in a row on one stretch of path, put together: one of each group and the state at its centre, the groups'
    ranges, and the group of each cell."""
    stretch, every = ranges.stretches.stretch, np.arange(len(cells.k))
    runs = np.flatnonzero(np.append(True, stretch[1:] != stretch[:-1]))
    own = every - np.repeat(runs, np.diff(np.append(runs, len(every))))
    first = np.flatnonzero(own % GROUP_CELLS == 0)
    one = (first + np.append(first[1:], len(every))) // 2
    state = _states(trajectory, cells[one], 0.5, order)
    return one, state, ranges.merge(first), np.cumsum(own % GROUP_CELLS == 0) - 1


def _states(trajectory: Trajectory, cells: Cells, share: Array | float, order: int) -> State:
    """At such shares (N,) of the cells."""
    return trajectory.within(cells.k, cells.lo + share * (cells.hi - cells.lo), jerk=order == 3)


def _use_of(limit: Limit, state: State) -> Array:
    """(N,) the use attained at N instants."""
    value = limit.value(state)
    return largest_in_rows(limit.use(value, value, state.piece))


def _bound_use(trajectory: Trajectory, limits: Sequence[Limit], cells: Cells, order: int) -> tuple[Array, Array]:
    """Over each of N cells, the bound of every limit's use over all its channels, and the use attained: (limits, N).

    The bound comes from the enclosure, the attained use from the motion itself where that says that it is largest.
    """
    bound, met = np.zeros((2, len(limits), len(cells.k)))
    for first in range(0, len(cells.k), CELL_BATCH):
        chosen = np.arange(first, min(first + CELL_BATCH, len(cells.k)))
        some = cells[chosen]
        enclosure = enclose(trajectory, some, EXPANSION[order])
        with np.errstate(invalid="ignore", over="ignore"):
            for n, limit in enumerate(limits):
                value = limit.value(enclosure)
                uses = limit.use(*bound_series(value, len(chosen)), enclosure.piece)
                bound[n, chosen] = largest_in_rows(uses)
                places, about = find_extremes(value, len(chosen), uses.argmax(1))
                more, less = (largest_in_rows(limit.use(each, each, enclosure.piece)) for each in about)
                share = (1 + np.where(more >= less, places[0], places[1])) / 2
                met[n, chosen] = _use_of(limit, _states(trajectory, some, share, order))
    return np.where(np.isnan(bound), np.inf, bound), np.where(np.isnan(met), np.inf, met)
