"""Planning under input shapers: what is solved is shaped and proved, and solved anew under less of
what it breaks.

Limits of axes are kept by shaping itself. Those of the tool and of forces are kept nearly: their
shaped values lie about a mean of the ones before, at a pose a few micrometres away. Where one is
exceeded, less of it is planned with on the stretch of the path that the copies are on meanwhile;
all along the path where that is not enough.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol, TypeVar

import numpy as np

from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.certificate.certify import Certificate, certify
from planner.limits.limit import Limit
from planner.limits.lowered import ALL, Shares
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.shaping.shaped_motion import shape_motion, shaper_length
from planner.shaping.shaped_proof import ShapedProof, advise_shapers, prove_shaped, refuse_unshaped
from planner.shaping.shaping_cost import ShapingCost, find_stretches
from planner.timing.goals.stated_duration import SHORT_DURATION, short_duration_error
from planner.trajectory import Trajectory

LOCAL_ROUNDS, ROUNDS = 4, 5
"""Of solving anew, at most: with less of a limit in places, and all along the path."""
ROOM = 1e-4
"""Share of a limit by which more is left than was missing, all along the path."""
LOCAL_ROOM, ROOM_GROWTH = 1e-3, 3.0
"""The same in places, at first, where it costs next to nothing; and times as much with every
round.
"""
LEAST_SHARE = 0.5
"""Of a limit, below which nothing is solved anew."""


class Solved(Protocol):
    """A trajectory, proved to keep the limits that it was solved under."""

    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def certificate(self) -> Certificate: ...


S = TypeVar("S", bound=Solved)
Solve = Callable[[tuple[Limit, ...]], S]


Kept = tuple[S, Certificate, ShapedProof | None, S]


def solve_shaped(
    solve: Solve[S],
    path: ActuatorPath,
    limits: tuple[Limit, ...],
    axes: Sequence[Axis],
    fastest: Solve[S] | None = None,
) -> Kept[S]:
    """What is solved so that it keeps the limits behind the axes' shapers too, its proof before
    them and behind them.

    The last is what was solved first, under the limits themselves: bounds of other rounds are of
    less of them. Without shapers: what is solved, and None. fastest: solves for the least time,
    where `solve` takes a stated one. Raises Infeasible for a limit that is not kept behind them,
    and for a stated duration below that of the fastest motion behind them; MotionError for what
    cannot be proved there.
    """
    try:
        return _keep_limits(solve, path, limits, axes)
    except Infeasible as no:
        if fastest is None or no.kind != SHORT_DURATION or not any(axis.shaper for axis in axes):
            raise
        stated = no.value + shaper_length(axes)
    _, _, shaped, first = _keep_limits(fastest, path, limits, axes)
    assert shaped is not None  # some axis has a shaper
    less = {} if shaped.cost is None else shaped.cost.lowered
    if stated < shaped.duration:
        raise short_duration_error(stated, shaped.duration)
    # slow enough for the limits only with less of them from the start, as the fastest has it
    solution, certificate, shaped, _ = _keep_limits(
        lambda kept: solve(tuple(_lower_further(limit, less) for limit in kept)), path, limits, axes
    )
    assert shaped is not None
    if shaped.cost is not None:
        lowered = {
            name: _multiply(shaped.cost.lowered.get(name, ALL), shares)
            for name, shares in less.items()
        }
        lowered = {**shaped.cost.lowered, **lowered}
        cost = replace(shaped.cost, lowered=lowered, stretches=find_stretches(path, lowered))
        shaped = replace(shaped, cost=cost)
    return solution, certificate, shaped, first


def _lower_further(limit: Limit, less: Mapping[str, Shares]) -> Limit:
    return limit.lower(_multiply(limit.shares, less[limit.name])) if limit.name in less else limit


def _multiply(shares: Shares, less: Shares) -> Shares:
    return shares.lower(less.ends[:-1], less.ends[1:], less.values)


def _keep_limits(
    solve: Solve[S], path: ActuatorPath, limits: tuple[Limit, ...], axes: Sequence[Axis]
) -> Kept[S]:
    """As `solve_shaped` without the fastest."""
    if not any(axis.shaper for axis in axes):
        first = solve(limits)
        return first, first.certificate, None, first
    refuse_unshaped(limits, path)
    first = solve(limits)
    prove = partial(_prove, axes=axes, limits=limits)
    proof = prove(first, first.certificate)
    found, certificate, everywhere = first, first.certificate, False
    lowered: Mapping[str, Shares] = {}
    if not proof.holds:
        local = _lower_in_places(solve, limits, prove, proof)
        everywhere = local is None
        found, certificate, proof, lowered = local or _lower_everywhere(
            solve, path, limits, prove, proof
        )
    cost = ShapingCost(
        proof.motion.copies.length,
        first.trajectory.duration,
        found.trajectory.duration - first.trajectory.duration,
        float(path.breaks[-1]),
        lowered,
        everywhere,
        find_stretches(path, lowered),
    )
    return found, certificate, replace(proof, cost=cost), first


Prove = Callable[[Solved, Certificate], ShapedProof]
Lowered = tuple[S, Certificate, ShapedProof, Mapping[str, Shares]]


def _prove(
    found: Solved, certificate: Certificate, *, axes: Sequence[Axis], limits: Sequence[Limit]
) -> ShapedProof:
    motion = shape_motion(found.trajectory, axes)
    assert motion is not None  # some axis has a shaper
    return prove_shaped(motion, found.trajectory, axes, limits, certificate)


def _lower_in_places(
    solve: Solve[S], limits: Sequence[Limit], prove: Prove, proof: ShapedProof
) -> Lowered[S] | None:
    """Solved anew with less of the limits where they are exceeded, until none is; None where that
    is not enough.
    """
    shares: dict[str, Shares] = {}
    for n in range(LOCAL_ROUNDS):
        room = 1 + LOCAL_ROOM * ROOM_GROWTH**n
        if any(use > 1 and name not in proof.excess for name, use in proof.worst.items()):
            return None  # geometry, which slowing down does not mend
        for name, (first, last, use) in proof.excess.items():
            shares[name] = shares.get(name, ALL).lower(first, last, 1 / (use * room))
        if min(each.least for each in shares.values()) < LEAST_SHARE:
            return None
        try:
            found = solve(tuple(limit.lower(shares.get(limit.name, ALL)) for limit in limits))
            proof = prove(found, found.certificate)
        except MotionError:
            return None
        if proof.holds:
            return found, found.certificate, proof, shares
    return None


def _lower_everywhere(
    solve: Solve[S], path: ActuatorPath, limits: tuple[Limit, ...], prove: Prove, proof: ShapedProof
) -> Lowered[S]:
    """Solved anew with less of the limits all along the path, until none is exceeded.

    Raises as `solve_shaped`.
    """
    shares = dict.fromkeys((limit.name for limit in limits), 1.0)
    for _ in range(ROUNDS):
        for name, use in proof.worst.items():
            if use > 1:
                shares[name] /= use * (1 + ROOM)
        broken = [limit for limit in limits if proof.worst[limit.name] > 1]
        lost = [limit for limit in broken if limit.geometric or shares[limit.name] < LEAST_SHARE]
        if lost:
            raise unkept_error(lost[0], proof)
        try:
            kept = tuple(
                limit if shares[limit.name] == 1 else limit.scale(shares[limit.name])
                for limit in limits
            )
        except MotionError:  # a band, which no one number scales
            raise unkept_error(broken[0], proof) from None
        found = solve(kept)
        certificate = certify(found.trajectory, limits)
        proof = prove(found, certificate)
        if proof.holds:
            ends = path.breaks[[0, -1]]
            lowered = {
                name: Shares(ends, np.array([share])) for name, share in shares.items() if share < 1
            }
            return found, certificate, proof, lowered
    broken = [limit for limit in limits if proof.worst[limit.name] > 1]
    raise unkept_error(broken[0], proof)


def refuse_unkept(limits: Sequence[Limit], proof: ShapedProof | None) -> None:
    """Raise Infeasible for the first limit that is not proved behind shapers, if there are any."""
    if proof is not None:
        for limit in limits:
            if proof.worst[limit.name] > 1:
                raise unkept_error(limit, proof)


def unkept_error(limit: Limit, proof: ShapedProof) -> Infeasible:
    """Of a limit that is not proved behind shapers."""
    place, use = proof.where[limit.name], proof.worst[limit.name]
    remedy = (
        "move the path away from the limit"
        if limit.geometric
        else "lower max_acceleration or the speed there"
    ) + f", {advise_shapers(proof.axes)}, or remove the shapers"
    return Infeasible(
        f"proven bound of the use of {limit.name} behind the input shapers",
        "",
        place,
        100 * use,
        100.0,
        "%",
        remedy,
    )
