"""A run in parts, each timed by itself: passages as fast as can be, and constant speeds with their ramps.

A segment is at its constant speed from its first place to its last wherever it is joined without a stop: the ramp lies
in the neighbour, where that is free to be as fast. Of two constant speeds the ramp lies in the faster: each is its
segment's cap as well. Where the motion comes from rest, or out of a slower segment, the ramp lies in its own segment.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from kinematics.array import Array
from kinematics.errors import MotionError
from planner.actuation import ActuatorPath
from planner.certify import TOLERANCE
from planner.limits.limit import Limit
from planner.limits.tool_speed import ToolSpeed
from planner.place import Infeasible
from planner.proved import Timed
from planner.steady import refuse, refuse_joined, steady
from planner.timing.problem import Run
from planner.timing.profile import Profile
from planner.timing.run import Attempt, attempt


@dataclass(frozen=True, slots=True)
class Parted:
    """Motions one after the other, as one."""

    path: ActuatorPath
    parts: tuple[Timed, ...]

    @property
    def profile(self) -> Profile:
        return Profile.joined([part.profile for part in self.parts])

    @property
    def method(self) -> str:
        """That of the first part which was solved for."""
        return next((part.method for part in self.parts if isinstance(part, Attempt)), self.parts[0].method)

    @property
    def floor(self) -> float:
        return sum(part.floor for part in self.parts)

    def tightened(self, use: Mapping[str, Array], slowness: float) -> "Parted":
        """The parts that exceed a limit, each tightened by itself."""
        ends = np.cumsum([0, *(len(part.profile.h) for part in self.parts)])
        own = [{name: values[a:b] for name, values in use.items()} for a, b in pairwise(ends)]
        return replace(
            self,
            parts=tuple(
                self._tightened(part, used, slowness) if max(map(np.max, used.values())) > 1 + TOLERANCE else part
                for part, used in zip(self.parts, own, strict=True)
            ),
        )

    def _tightened(self, part: Timed, use: Mapping[str, Array], slowness: float) -> Timed:
        try:
            return part.tightened(use, slowness)
        except Infeasible:
            raise
        except MotionError as no:  # a ramp between given speeds, which does not know where it lies
            place = self.path.place(float(part.profile.s[0]), int(part.profile.piece[0]))
            raise MotionError(
                f"the ramp from {place}: {no}: lower the constant speed that it joins, or write join = "
                '"stop" where its segments meet'
            ) from None


def parted(path: ActuatorPath, limits: Sequence[Limit], run: Run, order: int) -> Attempt | Parted:
    """The first solve of a run, in parts where its segments ask for constant speeds.

    Raises Infeasible where a constant speed cannot be, or where the passage before or after it cannot reach it.
    """
    blocks = _blocks(path, limits, run)
    if len(blocks) == 1 and path.constant(run.first) is None:
        return attempt(path, limits, run, order)
    for block in blocks:
        speed = path.constant(block.first)
        if speed is not None:
            refuse_joined(path, limits, block, order, speed)
    for before, after in pairwise(blocks):
        both = np.array([before.last, after.first])
        refuse(path, limits, path.breaks[[after.first, after.first]], both, after.start_speed)
    parts: dict[int, Sequence[Timed]] = {}
    # constant speeds first: why they cannot be is soon known
    for block in sorted(blocks, key=lambda block: path.constant(block.first) is None):
        speed = path.constant(block.first)
        try:
            if speed is None:
                parts[block.first] = [attempt(path, limits, block, order)]
            else:
                parts[block.first] = steady(path, limits, block, order, speed)
        except MotionError as no:
            raise _told(path, block, run, no) from None
    return Parted(path, tuple(chain(*(parts[block.first] for block in blocks))))


def _blocks(path: ActuatorPath, limits: Sequence[Limit], run: Run) -> list[Run]:
    """The parts of a run that ask for different speeds, each from and to the largest that both sides are allowed."""
    asked = [path.constant(piece) for piece in range(run.first, run.last + 1)]
    starts = [run.first, *(run.first + k for k in range(1, len(asked)) if asked[k] != asked[k - 1]), run.last + 1]
    if len(starts) == 2:
        return [run]
    (caps,) = (limit.caps for limit in limits if isinstance(limit, ToolSpeed))  # a constant speed is one of them
    speeds = [run.start_speed, *(float(caps[[k - 1, k]].min()) for k in starts[1:-1]), run.end_speed]
    return [
        Run(first, after - 1, start_speed, end_speed)
        for (first, after), (start_speed, end_speed) in zip(pairwise(starts), pairwise(speeds), strict=True)
    ]


def _told(path: ActuatorPath, block: Run, run: Run, no: MotionError) -> MotionError:
    """What to say where a part cannot be run from or to the constant speeds about it: which of them, and the remedy."""
    kind, joint = no.kind if isinstance(no, Infeasible) else "", block.speeds
    for kinds, joined, end, piece, words in (
        (("start speed", ""), block.first > run.first, 0, block.first, ("from", "before")),
        (("end speed", ""), block.last < run.last, -1, block.last, ("to", "after")),
    ):
        if kind in kinds and joined:
            place = path.place(float(block.breaks(path)[end]), piece)
            lies = (
                f"segment {place.segment} is at its constant speed where it joins the segment {words[1]} "
                f"it without a stop, and no motion {words[0]} that speed was found in it"
                if path.constant(piece) == joint[end]
                else f"the ramp {words[0]} the constant speed of the segment {words[1]} lies in segment "
                f"{place.segment}, joined to it without a stop"
            )
            remedy = f'{lies}: lower that speed, or write join = "stop" between the two'
            if isinstance(no, Infeasible):
                return Infeasible("constant speed", no.axis, place, no.value, no.limit, no.unit, remedy)
            return MotionError(f"{place}: {no}; {remedy}")
    return no
