"""Planning under input shapers: what is solved is shaped and proved, and solved anew under less of what it breaks.

Limits of axes are kept by shaping itself. Those of the tool and of forces are kept nearly: their shaped values lie
about a mean of the ones before, at a pose a few micrometres away.
"""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeVar

from kinematics.foundation.errors import MotionError
from kinematics.machine.axis import Axis
from planner.certificate.certify import Certificate, certify
from planner.limits.limit import Limit
from planner.path.actuation import ActuatorPath
from planner.place import Infeasible
from planner.shaping.shaped_motion import shape_motion
from planner.shaping.shaped_proof import ShapedProof, prove_shaped, refuse_unshaped
from planner.trajectory import Trajectory

ROUNDS = 6
"""Of solving, at most."""
ROOM = 1e-4
"""Share of a limit by which more is left than was missing."""
LEAST_SHARE = 0.5
"""Of a limit, below which nothing is solved anew: a shorter shaper is asked for then."""


class Solved(Protocol):
    """A trajectory, proved to keep the limits that it was solved under."""

    @property
    def trajectory(self) -> Trajectory: ...
    @property
    def certificate(self) -> Certificate: ...


S = TypeVar("S", bound=Solved)


def solve_shaped(
    solve: Callable[[tuple[Limit, ...]], S], path: ActuatorPath, limits: tuple[Limit, ...], axes: Sequence[Axis]
) -> tuple[S, Certificate, ShapedProof | None, S]:
    """What is solved so that it keeps the limits behind the axes' shapers too, its proof before them and behind them.

    The last is what was solved first, under the limits themselves: bounds of other rounds are of less of them.
    Without shapers: what is solved, and None. Raises Infeasible for a limit that is not kept behind them, MotionError
    for what cannot be proved there.
    """
    if not any(axis.shaper for axis in axes):
        found = solve(limits)
        return found, found.certificate, None, found
    refuse_unshaped(limits, path)
    kept, shares = limits, dict.fromkeys((limit.name for limit in limits), 1.0)
    first: S | None = None
    for _ in range(ROUNDS):
        found = solve(kept)
        first = first or found
        certificate = found.certificate if kept is limits else certify(found.trajectory, limits)
        motion = shape_motion(found.trajectory, axes)
        assert motion is not None  # some axis has a shaper
        proof = prove_shaped(motion, found.trajectory, axes, limits, certificate)
        if proof.holds:
            return found, certificate, proof, first
        for name, use in proof.worst.items():
            if use > 1:
                shares[name] /= use * (1 + ROOM)
        broken = [limit for limit in limits if proof.worst[limit.name] > 1]
        lost = [limit for limit in broken if limit.geometric or shares[limit.name] < LEAST_SHARE]
        if lost:
            raise unkept_error(lost[0], proof)
        try:
            kept = tuple(limit if shares[limit.name] == 1 else limit.scale(shares[limit.name]) for limit in limits)
        except MotionError:  # a band, which no one number scales
            raise unkept_error(broken[0], proof) from None
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
        "use a shorter shaper (zv, or a higher frequency), "
        + ("move the path away from the limit" if limit.geometric else "lower max_acceleration or the speed there")
        + ", or remove the shapers"
    )
    return Infeasible(
        f"proven bound of the use of {limit.name} behind the input shapers", "", place, 100 * use, 100.0, "%", remedy
    )
