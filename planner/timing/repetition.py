"""Runs with equal numbers: one of them is solved and proved, the others take over its motion.

Runs are equal if the numbers of their pieces and of their limits are equal, bit for bit. A copy is
then the same function of time, except for the path length at which it begins. Path lengths are
rounded: measured from the start of its piece, a place of the copy is within `PLACE_ROUNDING` times
the length of the path of the place that it copies. The proof encloses every motion whose places
are that near (`planner.certificate.enclosure.expand_motion`), so that it holds for the copy. That
copies join without a jump or a gap is proved of the whole motion.
"""

from collections.abc import Hashable, Sequence
from dataclasses import replace

from kinematics.foundation.arrays import Array
from planner.certificate.limit_use import ProvedUse
from planner.limits.limit import Limit
from planner.limits.lowered import ALL
from planner.limits.registry import PLACELESS
from planner.limits.resonance import Resonance
from planner.limits.tool import ToolLimit
from planner.path.actuation import ActuatorPath, MachinePath
from planner.timing.certify_loop import CertifiedRun
from planner.timing.problem import Run

# Number of different runs that are remembered: a path without repetition must not fill the memory.
MOST_REMEMBERED = 1024


def find_first_equals(
    path: ActuatorPath,
    limits: Sequence[Limit],
    runs: Sequence[Run],
) -> list[int]:
    """Return for each run the index of an earlier run that equals it, or else its own index."""
    firsts = list(range(len(runs)))
    if not isinstance(path, MachinePath):
        return firsts
    # most runs differ from all others in the numbers of their first piece
    begins = [path.pieces[run.first].parameters.tobytes() for run in runs]
    if len(set(begins)) == len(runs) or not all(map(ignores_place, limits)):
        return firsts
    caps = [limit.caps for limit in limits if isinstance(limit, ToolLimit)]
    remembered: dict[Hashable, int] = {}
    for n, run in enumerate(runs):
        # a run that continues a motion has that motion's numbers as well
        if run.continuation is not None:
            continue
        key = _describe_run(path, caps, run)
        firsts[n] = remembered.pop(key, n)
        remembered[key] = firsts[n]  # now the last to be forgotten
        if len(remembered) > MOST_REMEMBERED:
            del remembered[next(iter(remembered))]
    return firsts


def ignores_place(limit: Limit) -> bool:
    """Return whether a limit is the same for equal pieces of path, wherever they are on the path.

    A caller's own limit may look at the number of the piece. Shares are lowered at stated path
    lengths, and so are the speeds of axes that are held below a band of resonance.
    """
    if type(limit) not in PLACELESS:
        return False
    if isinstance(limit, Resonance) and (limit.bands or limit.held):
        return False
    return limit.shares is ALL


def _describe_run(path: MachinePath, caps: Sequence[Array], run: Run) -> Hashable:
    """Return all that decides the motion of a run, except where on the path it is."""
    pieces = slice(run.first, run.last + 1)
    return (
        replace(run, first=0, last=run.last - run.first),
        path.describe_pieces(run.first, run.last),
        tuple(cap[pieces].tobytes() for cap in caps),
    )


def move_run(path: ActuatorPath, one: CertifiedRun, run: Run) -> CertifiedRun:
    """Return the motion and the proof of a run for another run that equals it."""
    profile = one.solution.profile
    piece = profile.piece + run.first - one.run.first
    # the break itself stays exact: motions rest there
    s = path.breaks[piece] + (profile.s - path.breaks[profile.piece])
    moved = replace(profile, s=s, piece=piece)
    known = ProvedUse(one.known.use, one.known.attained, moved.numbers())
    return replace(one, run=run, solution=replace(one.solution, profile=moved), known=known)
