"""The certificate: a bound of every limit over continuous time, from the trajectory and the limits' `value` alone.

Time is cut into cells; over each, the motion is enclosed by Taylor series (planner.enclosure) and a limit's value
follows by its own formula. A cell's bound is its largest Bernstein coefficient plus the error; cells are halved until
the bounds are tight.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.array import Array, frozen
from planner.enclosure import Cells, Enclosure, bounds, enclose
from planner.limits.limit import Limit, Term
from planner.place import Place
from planner.trajectory import Trajectory

TOLERANCE = 1e-6
"""A limit holds when its proven bound is at most 1 + TOLERANCE: room for the solvers' own tolerance."""
# How far above the attained value a bound may stay, and how long cells are halved for it.
TIGHT, HALVINGS, MOST_CELLS = 5e-7, 24, 400_000
# Order of the expansions in time, by the highest derivative looked at: q̈ or q⃛ keep a polynomial of degree 3 or 4.
EXPANSION = {2: 6, 3: 8}
# A jump of q, q̇ (and q̈ under jerk limits) between two pieces up to this share of the largest value met is rounding.
JUMP = 1e-9
NARROW = 1e-3


@dataclass(frozen=True, slots=True)
class Certificate:
    """worst: proven upper bound of value/limit over continuous time, per limit; where: the place of each.

    use       per limit, the proven bound over each time piece of the trajectory (M,); worst is its maximum
    attained  per limit, the largest value/limit met in each time piece (M,): the truth lies between the two
    """

    holds: bool
    worst: dict[str, float]
    where: dict[str, Place]
    use: dict[str, Array] = field(repr=False)
    attained: dict[str, Array] = field(repr=False)

    def __str__(self) -> str:
        lines = [f"  {name:<13} ≤ {value:.9f}  at {self.where[name]}" for name, value in self.worst.items()]
        return "\n".join(["the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD", *lines])


@dataclass(frozen=True, slots=True)
class Known:
    """What is proved already: per limit, use and attained of each time piece (M,), NaN where it is still to be proved."""

    use: dict[str, Array]
    attained: dict[str, Array]


def certify(trajectory: Trajectory, limits: Sequence[Limit], known: Known | None = None) -> Certificate:
    """Prove what the trajectory uses of every limit, and that it is as smooth as its order asks: nothing jumps.

    known spares the work on time pieces that did not change since they were proved.
    """
    order = 3 if any(Term.SDDD in limit.terms for limit in limits) else 2
    lengths = np.diff(trajectory.knots)
    whole = Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)[lengths > 0]
    use = {limit.name: np.zeros(len(lengths)) for limit in limits}
    attained = {limit.name: np.zeros(len(lengths)) for limit in limits}
    cells = whole
    if known is not None:
        for name, values in use.items():
            values[:], attained[name][:] = np.nan_to_num(known.use[name]), np.nan_to_num(known.attained[name])
        cells = whole[np.isnan(known.use[limits[0].name])[whole.k]]
    for halving in range(HALVINGS + 1):
        enclosure = enclose(trajectory, cells, EXPANSION[order])
        loose = np.zeros(len(cells.k), bool)
        proven = {}
        for limit in limits:
            bound, met = _judge(limit, enclosure, len(cells.k))
            np.maximum.at(attained[limit.name], cells.k, met)
            target = np.maximum(met, min(attained[limit.name].max(), 1.0)) + TIGHT
            proven[limit.name] = bound
            loose |= bound > target
        if halving == HALVINGS or 2 * loose.sum() > MOST_CELLS:
            loose[:] = False
        for name, bound in proven.items():
            np.maximum.at(use[name], cells.k[~loose], bound[~loose])
        if not loose.any():
            break
        cells = cells[loose].halves()
    worst = {name: float(values.max()) for name, values in use.items()}
    where = {limit.name: _place(trajectory, limit, int(np.argmax(use[limit.name]))) for limit in limits}
    for name, place in _jumps(trajectory, whole, order).items():
        worst[name], where[name] = float("inf"), place
    return Certificate(
        holds=all(value <= 1 + TOLERANCE for value in worst.values()),
        worst=worst,
        where=where,
        use={name: frozen(values) for name, values in use.items()},
        attained={name: frozen(values) for name, values in attained.items()},
    )


def _judge(limit: Limit, enclosure: Enclosure, cells: int) -> tuple[Array, Array]:
    """The bound (N,) of a limit's use over each cell, over all channels, and the use attained in it."""
    with np.errstate(invalid="ignore", over="ignore"):
        low, high, values = bounds(limit.value(enclosure), cells)
        proven = limit.use(low, high, enclosure.piece).max(1)
        attained = np.max([limit.use(value, value, enclosure.piece).max(1) for value in values], 0)
    return np.where(np.isnan(proven), np.inf, proven), np.nan_to_num(attained, nan=0.0)


def _jumps(trajectory: Trajectory, cells: Cells, order: int) -> dict[str, Place]:
    """Each quantity that is not continuous between the pieces, or not at rest at the ends, and where it jumps most.

    Seen in the outermost thousandths of every piece, where a short series leaves nothing to the remainder.
    """
    lengths, count = cells.hi - cells.lo, len(cells.k)
    ends = Cells(
        np.tile(cells.k, 2),
        np.concatenate([cells.lo, cells.hi - lengths * NARROW]),
        np.concatenate([cells.lo + lengths * NARROW, cells.hi]),
    )
    enclosure = enclose(trajectory, ends, order + 2)
    quantities = {"position jump": enclosure.q, "speed jump": enclosure.qd}
    if order == 3:
        quantities["acceleration jump"] = enclosure.qdd
    found: dict[str, Place] = {}
    for name, series in quantities.items():
        _, _, (left, _, right) = bounds(series, 2 * count)
        start, end = left[:count], right[count:]
        # before the first piece and after the last there is rest: where it stood, without speed or acceleration
        before, after = (
            (start[:1], end[-1:]) if name == "position jump" else (np.zeros_like(start[:1]), np.zeros_like(end[:1]))
        )
        gaps = np.abs(np.concatenate([start, after]) - np.concatenate([before, end]))
        scale = np.ptp(start, axis=0).max() + 1e-6 * np.abs(start).max()
        if gaps.max() > JUMP * scale:
            row, axis = np.unravel_index(int(np.argmax(gaps)), gaps.shape)
            cell = min(int(row), count - 1)
            k = int(cells.k[cell])
            t = float(trajectory.knots[k + (0 if row < count else 1)])
            found[name] = _at(trajectory, k, t, trajectory.path.names[int(axis)])
    return found


def _place(trajectory: Trajectory, limit: Limit, k: int) -> Place:
    """Where in time piece k, and in which channel, a limit is used most."""
    span = trajectory.knots[k + 1] - trajectory.knots[k]
    t = trajectory.knots[k] + span * np.linspace(0.0, 1.0, 9, endpoint=False)
    state = trajectory.at(t)
    value = limit.value(state)
    row, channel = np.unravel_index(int(np.argmax(limit.use(value, value, state.piece))), value.shape)
    return _at(trajectory, k, float(t[row]), limit.channels[int(channel)])


def _at(trajectory: Trajectory, k: int, t: float, axis: str) -> Place:
    return Place(float(trajectory.at(t).s[0]), trajectory.path.segment(int(trajectory.piece[k])), t, axis)
