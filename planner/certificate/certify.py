"""The certificate: a bound of every limit over continuous time.

It depends on the trajectory and on the limits' `value` and `use`, and on no row of a solver. Time
is cut into cells. Over each, the motion is enclosed (`planner.certificate.enclosure`) and each
limit's value is bounded by its own formula; cells are split until the bounds are tight. It is also
proved that the motion is continuous and complete (`planner.certificate.continuity`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.result import Result
from kinematics.foundation.table import Table
from planner.certificate.cells import sample_pieces
from planner.certificate.constant_speed import (
    CONSTANT_SPEED,
    prove_speed_deviation,
)
from planner.certificate.continuity import find_gaps, find_jumps, place_at
from planner.certificate.limit_use import (
    ProvedUse,
    find_geometric_use,
    prove,
    tabulate_uses,
    use_at_knots,
)
from planner.certificate.resonance_dwell import find_stays
from planner.limits.limit import Limit, order_of, select_timed
from planner.limits.resonance import Resonance
from planner.place import Place
from planner.trajectory import Trajectory

CROSSING = "resonance crossing"
"""Name in a certificate: the longest stay of an axis in a band of speed, over the time allowed."""
# Shares of a time piece at which the place of the largest use is sought, which no bound needs.
PLACES = np.linspace(0.0, 1.0, 65)


@dataclass(frozen=True, slots=True)
class Certificate(Result):
    """Proof of a motion, by the name of each limit and of each other condition.

    worst     proven upper bound of value/limit over continuous time
    where     place of the worst
    use       per limit, the proven bound over each time piece of the trajectory (M,). worst is its
              maximum, and tight; a piece that surely uses less is only proved to be below that
    attained  per limit, the largest value/limit at an evaluated instant of each time piece (M,), 0
              without one: the truth lies between the two
    """

    holds: bool
    worst: dict[str, float]
    where: dict[str, Place]
    use: dict[str, Array] = field(repr=False)
    attained: dict[str, Array] = field(repr=False)

    def __repr__(self) -> str:
        most = max(self.worst, key=lambda name: self.worst[name], default="")
        used = f": {self.worst[most]:.7f} of {most}, of {len(self.worst)} limits" if most else ""
        return f"<Certificate {'holds' if self.holds else 'DOES NOT HOLD'}{used}>"

    def tables(self) -> tuple[Table, ...]:
        """Return the worst proven use of each limit, and where."""
        head = "the certificate holds" if self.holds else "THE CERTIFICATE DOES NOT HOLD"
        title = f"{head}: value/limit, bounded over continuous time"
        return (tabulate_uses(title, self.worst, self.where),)


def certify(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    known: ProvedUse | None = None,
) -> Certificate:
    """Prove bounds of the use of every limit, and that the trajectory is the whole motion.

    It runs the path once, forwards, from rest to rest or between the speeds that the path states
    for its ends, and is as smooth as its order requires.

    known  earlier results: time pieces with the same coefficients are not proved again
    """
    order = order_of(limits)
    known = None if known is None else known.fit(trajectory)
    timed = select_timed(limits)
    geometric = [limit for limit in limits if limit.geometric]
    use, attained = prove(trajectory, timed, order, known)
    use |= find_geometric_use(trajectory, geometric)
    attained |= use_at_knots(trajectory, geometric)
    where: dict[str, Place] = {}
    for limit in limits:
        # a bound below 1 need not be tight everywhere
        exceeded = not limit.geometric and use[limit.name].max() > 1
        most = use if exceeded else attained
        k = int(np.argmax(most[limit.name]))
        where[limit.name] = _find_place(trajectory, limit, k)
    others: dict[str, tuple[Array, Array, Place]] = {}
    for limit in limits:
        if isinstance(limit, Resonance) and limit.bands:
            others[CROSSING] = _prove_crossing(trajectory, limit)
    if np.isfinite(trajectory.constant_speeds).any():
        others[CONSTANT_SPEED] = prove_speed_deviation(trajectory)
    for name, (bound, value, place) in others.items():
        use[name] = bound
        attained[name] = value
        where[name] = place
    worst = {name: float(values.max()) for name, values in use.items()}
    faults = find_jumps(trajectory, order) | find_gaps(trajectory)
    for name, place in faults.items():
        worst[name] = float("inf")
        where[name] = place
    return Certificate(
        holds=all(value <= 1 for value in worst.values()),
        worst=worst,
        where=where,
        use={name: freeze_array(values) for name, values in use.items()},
        attained={name: freeze_array(values) for name, values in attained.items()},
    )


def _prove_crossing(
    trajectory: Trajectory,
    limit: Resonance,
) -> tuple[Array, Array, Place]:
    """Return the longest stay that each time piece (M,) takes part in, and where the longest
    begins.

    Shares of the time allowed: the proved bound, and the attained value.
    """
    use, attained = np.zeros((2, len(trajectory.s)))
    stays = find_stays(trajectory, limit)
    for stay in stays:
        pieces = slice(stay.first, stay.last + 1)
        use[pieces] = np.maximum(use[pieces], stay.use)
        attained[pieces] = np.maximum(attained[pieces], stay.inside / stay.band.time)
    longest = max(stays, key=lambda stay: stay.use, default=None)
    if longest is None:
        return use, attained, place_at(trajectory, 0.0, "")
    axis = limit.channels[longest.band.axis]
    return use, attained, place_at(trajectory, longest.start, axis)


def find_place(
    trajectory: Trajectory,
    limits: Sequence[Limit],
    name: str,
    k: int,
) -> Place:
    """Return where in time piece k an entry of a certificate is used most, and by which axis.

    Other entries, such as a stay in a band of speed, are placed where the piece begins.
    """
    limit = next((limit for limit in limits if limit.name == name), None)
    if limit is not None:
        return _find_place(trajectory, limit, k)
    return trajectory.path.place(trajectory.s[k], trajectory.piece[k], trajectory.knots[k])


def _find_place(trajectory: Trajectory, limit: Limit, k: int) -> Place:
    """Return where in time piece k, and in which channel, a limit is used most."""
    state = sample_pieces(trajectory, np.array([k]), PLACES)
    use = limit.use_at(state)
    row, channel = np.unravel_index(int(np.argmax(use)), use.shape)
    return place_at(trajectory, float(state.t[row]), limit.channels[int(channel)])
