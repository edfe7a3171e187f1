"""Share of each limit that a motion uses, proved over cells of time that are split until it is
tight.

A limit that depends on time is bounded by the coarse enclosure first. Cells whose bounds are loose
then, and all cells of a geometric limit, are bounded by the fine one.
"""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from kinematics.foundation.arrays import (
    Array,
    freeze_array,
    largest_in_rows,
)
from kinematics.foundation.table import Column, Table
from planner.certificate.cells import (
    CELL_BATCH,
    Cells,
    Values,
    evaluate_in_batches,
    refine,
)
from planner.certificate.continuity import (
    INSTANT_ROUNDING,
    allow_gap,
    piece_end_lengths,
)
from planner.certificate.enclosure import enclose, find_extremes
from planner.certificate.path_enclosure import (
    COARSE_BATCH,
    bound_coarsely,
    state_at,
    use_in,
)
from planner.limits.limit import Limit, select_timed
from planner.path.actuation import ActuatorPath, has_constant_speed
from planner.place import Place
from planner.trajectory import State, Trajectory, unit_speed_trajectory

LIMIT_ROUNDING = 1e-9
"""Excess over 1 that counts as rounding where a motion may reach a limit exactly.

That holds for places, and for all of a motion along a path that states speeds. Other motions are
never above 1.
"""
# Refinement ends at this share of a time piece, or at this number of loose cells.
MIN_CELL_SHARE = 2.0**-24
MAX_CELLS = 400_000
# Cells are halved; a few cells are split into more parts, as one evaluation costs the same for all
# of them.
FEW_CELLS = 64
MOST_PARTS = 8
# Order of the series in time, by the highest derivative: q̈ or q⃛ keep a polynomial of degree 3 or
# 4.
EXPANSION = {2: 6, 3: 8}


@dataclass(frozen=True, slots=True)
class ProvedUse:
    """Earlier results, per limit on time: use and attained of each time piece (M,).

    They are NaN where no bound is proved yet.

    of  (6, M) proved time pieces: s, ṡ, s̈ at the start, s⃛, duration and path piece
    """

    use: dict[str, Array]
    attained: dict[str, Array]
    of: Array

    @classmethod
    def make_empty(
        cls,
        limits: Sequence[Limit],
        pieces: int,
    ) -> "ProvedUse":
        unproved = np.full(pieces, np.nan)
        use = {limit.name: unproved for limit in select_timed(limits)}
        return cls(use, use, np.full((6, pieces), np.nan))

    @classmethod
    def join(cls, parts: "Sequence[ProvedUse]") -> "ProvedUse":
        """Join the results of consecutive time pieces."""
        names = parts[0].use
        use = {name: np.concatenate([part.use[name] for part in parts]) for name in names}
        attained = {name: np.concatenate([part.attained[name] for part in parts]) for name in names}
        return cls(
            use,
            attained,
            np.concatenate([part.of for part in parts], axis=1),
        )

    def fit(self, trajectory: Trajectory) -> "ProvedUse":
        """Return the results for the time pieces that also occur in `trajectory`.

        Durations may differ by rounding. Pieces with other coefficients stay unproved.
        """
        lengths = np.diff(trajectory.knots)
        motion = trajectory.s, trajectory.v, trajectory.a, trajectory.j
        numbers = np.stack([*motion, self.of[4], trajectory.piece])
        with np.errstate(invalid="ignore"):
            rounded = np.abs(lengths - self.of[4]) <= INSTANT_ROUNDING * trajectory.knots[1:]
        same = rounded & (numbers == self.of).all(0)
        if same.all():
            return self
        use, attained = (
            {name: np.where(same, values, np.nan) for name, values in each.items()}
            for each in (self.use, self.attained)
        )
        return ProvedUse(use, attained, self.of)


def prove(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    known: ProvedUse | None = None,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return, per limit, the proved bound of its use over each time piece (M,), and the attained
    use.
    """
    cells = Cells.cover(trajectory)
    path = trajectory.path
    # stated speeds have to be met exactly
    stated = max(path.end_speeds) > 0 or has_constant_speed(path)
    proofs = {
        limit.name: LimitProof(
            trajectory,
            limit,
            order,
            reachable=limit.geometric or stated,
        )
        for limit in limits
    }
    if known is not None:
        unknown = np.any([np.isnan(known.use[limit.name]) for limit in limits], axis=0)
        for name, proof in proofs.items():
            proof.use[~unknown] = known.use[name][~unknown]
            proof.attained[~unknown] = known.attained[name][~unknown]
        cells = cells[unknown[cells.k]]
    if limits and len(cells.k):
        # geometry is not bounded over time, so the coarse enclosure does not apply to it
        coarse = not any(limit.geometric for limit in limits)
        bound = partial(
            bound_coarsely if coarse else bound_finely,
            trajectory,
            limits,
            order,
        )
        batch = COARSE_BATCH if coarse else CELL_BATCH
        bounds, attained = evaluate_in_batches(cells, bound, batch)
        for proof, *values in zip(proofs.values(), bounds, attained, strict=True):
            proof.run(cells, tuple(values), coarse=coarse)
    use = {name: proof.use for name, proof in proofs.items()}
    return use, {name: proof.attained for name, proof in proofs.items()}


def bound_finely(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    order: int,
    cells: Cells,
) -> Values:
    """Return bounds of each limit's use over N cells, and the use attained where it seems largest.

    Each (limits, N).
    """
    shape = (len(limits), len(cells.k))
    bounds = np.zeros(shape)
    attained = np.zeros(shape)
    enclosure = enclose(trajectory, cells, EXPANSION[order])
    for n, limit in enumerate(limits):
        value = limit.value(enclosure)
        uses = limit.use(*enclosure.bound(value), enclosure.piece)
        bounds[n] = largest_in_rows(uses)
        places, values = find_extremes(value, len(cells.k), uses.argmax(1))
        ends = [limit.use(each, each, enclosure.piece) for each in values]
        top, bottom = map(largest_in_rows, ends)
        share = (1 + np.where(top >= bottom, places[0], places[1])) / 2
        attained[n] = use_in(limit, state_at(trajectory, cells, share, order))
    return np.where(np.isnan(bounds), np.inf, bounds), attained


@dataclass
class LimitProof:
    """Bounds of one limit, refined until they are tight.

    reachable      whether the motion may reach the limit exactly
    least_share    of a time piece, at which refinement ends
    use (M,)       proved bound over each time piece
    attained (M,)  largest use at any instant evaluated in each time piece
    """

    trajectory: Trajectory
    limit: Limit
    order: int
    reachable: bool = False
    least_share: float = MIN_CELL_SHARE
    use: Array = field(init=False)
    attained: Array = field(init=False)

    def __post_init__(self) -> None:
        self.use = np.zeros(len(self.trajectory.s))
        self.attained = np.zeros(len(self.trajectory.s))

    def run(
        self,
        cells: Cells,
        values: Values,
        *,
        coarse: bool = False,
    ) -> None:
        """Fill use and attained.

        values  bound and attained use (N,) of the cells
        coarse  whether they are of the coarse enclosure: loose cells have the fine one next
        """

        def find_loose(
            cells: Cells,
            values: Values,
        ) -> tuple[np.ndarray, int]:
            nonlocal coarse
            loose, excess = self._find_loose(cells, values)
            if coarse:
                coarse = False
                return loose, 1  # the same cells, by the fine enclosure
            return self._choose_parts(cells, loose, excess)

        cells, (bound, _) = refine(cells, self._evaluate, find_loose, values)
        np.maximum.at(self.use, cells.k, self._round(bound))

    def _evaluate(self, cells: Cells) -> Values:
        bounds, attained = bound_finely(self.trajectory, [self.limit], self.order, cells)
        return bounds[0], attained[0]

    def _round(self, use: Array) -> Array:
        return round_reached_use(use) if self.reachable else use

    def _find_loose(
        self,
        cells: Cells,
        values: Values,
    ) -> tuple[np.ndarray, float]:
        """Return which cells (N,) are not tight, and their largest excess in tolerances."""
        bound, attained = (self._round(each) for each in values)
        np.maximum.at(self.attained, cells.k, attained)
        most = self.attained.max()
        # the bound of a cell that uses less than the most need not be tighter than that
        floor = np.maximum(attained, min(most, 1.0))
        tolerance = self.limit.tight(floor)
        loose = (bound > floor + tolerance) | ((bound > 1) & (attained <= 1))
        with np.errstate(invalid="ignore"):  # an unbounded cell
            excess = np.nanmax((bound - most) / tolerance, where=loose, initial=1.0)
        return loose, float(excess)

    def _choose_parts(
        self,
        cells: Cells,
        loose: np.ndarray,
        excess: float,
    ) -> tuple[np.ndarray, int]:
        """Return which cells (N,) to split, and into how many parts; the others keep their bounds.

        Cells that are too short, and all cells where there would be too many, are not split.
        """
        least = self.least_share * np.diff(self.trajectory.knots)[cells.k]
        possible = cells.lengths / least
        loose = loose & (possible >= 2)
        # bounds converge with the square of the cell's length at least
        most_parts = MOST_PARTS if loose.sum() <= FEW_CELLS else 2
        most_parts = min(most_parts, int(possible.min(where=loose, initial=most_parts)))
        parts = int(np.clip(np.ceil(np.sqrt(excess)), 2, most_parts))
        if parts * loose.sum() > MAX_CELLS:
            loose[:] = False
        return loose, parts


def tabulate_uses(
    title: str,
    uses: Mapping[str, float],
    places: Mapping[str, Place],
    notes: Sequence[str] = (),
) -> Table:
    """Return the proved use of each limit, and where it is largest."""
    columns = (
        Column("limit", [*uses]),
        Column("bound", [*uses.values()], form=".7f", up=True),
        *Place.columns([places[name] for name in uses]),
    )
    return Table(title, columns, tuple(notes))


def round_reached_use(use: Array) -> Array:
    """Return shares of limits, where an excess over 1 by rounding counts as 1."""
    return np.where((use > 1) & (use <= 1 + LIMIT_ROUNDING), 1.0, use)


# Knots at which geometric limits are evaluated first; then all knots around the worst of them.
KNOTS_SAMPLED = 128
# Paths whose proofs are remembered.
REMEMBERED_PATHS = 16


@dataclass(frozen=True, slots=True)
class PathUse:
    """Proved bounds of the use of geometric limits over parts of a path that begin at s (G,)."""

    s: Array
    use: dict[str, Array]


_PROVED: dict[Hashable, PathUse] = {}


def prove_path_use(
    path: ActuatorPath,
    limits: Sequence[Limit],
) -> dict[str, Array]:
    """Return, per geometric limit, the proved bound of its use on every part of a path.

    Parts are the time pieces of `unit_speed_trajectory(path)`.
    """
    return _prove_along(path, limits).use if limits else {}


def _prove_along(path: ActuatorPath, limits: Sequence[Limit]) -> PathUse:
    """Prove the use along a path, or take the proof from memory: retries and reruns share it."""
    key = path.content, *(limit.content for limit in limits)
    proved = _PROVED.pop(key, None)
    if proved is None:
        along = unit_speed_trajectory(path)
        use, _ = prove(along, limits, 2)
        use = {name: freeze_array(values) for name, values in use.items()}
        proved = PathUse(along.s, use)
    _PROVED[key] = proved  # the most recent is the last
    while len(_PROVED) > REMEMBERED_PATHS:
        _PROVED.pop(next(iter(_PROVED)), None)
    return proved


def forget_paths() -> None:
    """Forget all proofs along paths, to measure their time."""
    _PROVED.clear()


def find_geometric_use(
    trajectory: Trajectory,
    limits: Sequence[Limit],
) -> dict[str, Array]:
    """Return, per geometric limit, the proved bound over each time piece (M,).

    It is the largest of the parts of the path that the time piece passes.
    """
    if not limits:
        return {}
    proved = _prove_along(trajectory.path, limits)
    s = np.append(trajectory.s, piece_end_lengths(trajectory)[-1:])
    # `find_gaps` lets a motion leave out a place by this much
    slack = allow_gap(trajectory.path)
    low = np.minimum(s[:-1], s[1:]) - slack
    high = np.maximum(s[:-1], s[1:]) + slack
    parts = proved.s
    first = np.searchsorted(parts, low, side="right") - 1
    last = np.searchsorted(parts, high, side="right")
    first = np.clip(first, 0, len(parts) - 1)
    ranges = np.stack([first, np.maximum(last, 1)], 1).ravel()
    return {
        name: np.maximum.reduceat(np.append(values, 0.0), ranges)[::2]
        for name, values in proved.use.items()
    }


def use_at_knots(
    trajectory: Trajectory,
    limits: Sequence[Limit],
) -> dict[str, Array]:
    """Return, per geometric limit, the larger use attained at the two ends of each time piece (M,).

    It says where a limit is used most, and proves nothing: some knots are evaluated, then all
    around the one that uses most. Both sides of a knot are one place.
    """
    count = len(trajectory.s) + 1
    step = -(-count // KNOTS_SAMPLED)
    sampled = np.append(np.arange(0, count - 1, step), count - 1)
    states = _state_at_knots(trajectory, sampled)
    attained = {}
    for limit in limits:
        use = np.zeros(count)
        use[sampled] = use_in(limit, states)
        if step > 1:
            best = int(use.argmax())
            first = max(best - step + 1, 0)
            around = np.arange(first, min(best + step, count))
            use[around] = use_in(limit, _state_at_knots(trajectory, around))
        larger = np.maximum(use[:-1], use[1:])
        attained[limit.name] = round_reached_use(larger)
    return attained


def _state_at_knots(trajectory: Trajectory, knots: np.ndarray) -> State:
    last = len(trajectory.s) - 1
    k = np.minimum(knots, last)
    lengths = np.diff(trajectory.knots)
    return trajectory.within(k, np.where(knots <= last, 0.0, lengths[k]))
