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
# A jump of q, q̇ (and q̈ under jerk limits) between two pieces, as a share of the largest value met, up to which it is
# rounding.
JUMP = 1e-9
NARROW = 1e-3


@dataclass(frozen=True, slots=True)
class Certificate:
    """worst: proven upper bound of value/limit over continuous time, per limit; where: the place of each.

    attained  the largest value/limit met at the points looked at: the truth lies between attained and worst
    use       per limit, the bound over each time piece of the trajectory (M,)
    """

    holds: bool
    worst: dict[str, float]
    where: dict[str, Place]
    attained: dict[str, float]
    use: dict[str, Array] = field(repr=False)

    def __str__(self) -> str:
        lines = [f"  {name:<13} ≤ {value:.9f}  at {self.where[name]}" for name, value in self.worst.items()]
        return "\n".join(["the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD", *lines])


@dataclass(slots=True)
class _Finding:
    """What is known of one limit while cells are settled."""

    attained: float = 0.0
    proven: float = 0.0
    cell: tuple[int, float] = (0, 0.0)
    channel: int = 0

    def settle(self, bound: Array, cells: Cells) -> None:
        if bound.size and bound.max() >= self.proven:
            row, self.channel = (int(n) for n in np.unravel_index(int(np.argmax(bound)), bound.shape))
            self.proven, self.cell = float(bound.max()), (int(cells.k[row]), float((cells.lo[row] + cells.hi[row]) / 2))


def certify(trajectory: Trajectory, limits: Sequence[Limit]) -> Certificate:
    """Prove what the trajectory uses of every limit, and that it is as smooth as its order asks: nothing jumps."""
    lengths = np.diff(trajectory.knots)
    cells = Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)[lengths > 0]
    findings = [_Finding() for _ in limits]
    use = [np.zeros(len(lengths)) for _ in limits]
    jumps = _jumps(trajectory, cells, any(Term.SDDD in limit.terms for limit in limits))
    for halving in range(HALVINGS + 1):
        enclosure = enclose(trajectory, cells)
        judged = [_judge(limit, enclosure, len(cells.k)) for limit in limits]
        loose = np.zeros(len(cells.k), bool)
        for finding, (proven, attained) in zip(findings, judged, strict=True):
            finding.attained = max(finding.attained, float(attained.max()))
            target = np.maximum(attained, min(finding.attained, 1.0)) + TIGHT
            loose |= (proven > target).any(1)
        if halving == HALVINGS or 2 * loose.sum() > MOST_CELLS:
            loose[:] = False
        settled = cells[~loose]
        for finding, found, (proven, _) in zip(findings, use, judged, strict=True):
            finding.settle(proven[~loose], settled)
            np.maximum.at(found, settled.k, proven[~loose].max(1))
        if not loose.any():
            break
        cells = cells[loose].halves()
    worst = {limit.name: finding.proven for limit, finding in zip(limits, findings, strict=True)}
    where = {
        limit.name: _place(trajectory, *finding.cell, limit.channels[finding.channel])
        for limit, finding in zip(limits, findings, strict=True)
    }
    for name, place in jumps.items():
        worst[name], where[name] = float("inf"), place
    return Certificate(
        holds=all(value <= 1 + TOLERANCE for value in worst.values()),
        worst=worst,
        where=where,
        attained={limit.name: finding.attained for limit, finding in zip(limits, findings, strict=True)},
        use={limit.name: frozen(found) for limit, found in zip(limits, use, strict=True)},
    )


def _judge(limit: Limit, enclosure: Enclosure, cells: int) -> tuple[Array, Array]:
    """The bound (N, m) of a limit's use over each cell, and the use attained in it."""
    with np.errstate(invalid="ignore", over="ignore"):
        low, high, values = bounds(limit.value(enclosure), cells)
        proven = limit.use(low, high, enclosure.piece)
        attained = np.max([limit.use(value, value, enclosure.piece) for value in values], 0)
    return np.where(np.isnan(proven), np.inf, proven), np.nan_to_num(attained, nan=0.0)


def _jumps(trajectory: Trajectory, cells: Cells, third: bool) -> dict[str, Place]:
    """Each quantity that is not continuous between the pieces, or not at rest at the ends, and where it jumps most.

    Seen in the outermost thousandths of every piece, where a short series leaves nothing to the remainder.
    """
    lengths, count = cells.hi - cells.lo, len(cells.k)
    ends = Cells(
        np.tile(cells.k, 2),
        np.concatenate([cells.lo, cells.hi - lengths * NARROW]),
        np.concatenate([cells.lo + lengths * NARROW, cells.hi]),
    )
    enclosure = enclose(trajectory, ends, 5)
    quantities = {"position jump": enclosure.q, "speed jump": enclosure.qd}
    if third:
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
            tau = 0.0 if row < count else float(cells.hi[cell])
            found[name] = _place(trajectory, int(cells.k[cell]), tau, trajectory.path.names[int(axis)])
    return found


def _place(trajectory: Trajectory, k: int, tau: float, axis: str) -> Place:
    t = float(trajectory.knots[k] + tau)
    s = trajectory.s[k] + tau * (trajectory.v[k] + tau * (trajectory.a[k] / 2 + tau * trajectory.j[k] / 6))
    return Place(float(s), trajectory.path.segment(int(trajectory.piece[k])), t, axis)
