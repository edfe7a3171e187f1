"""A path of any length, timed window by window: each goes on with the motion of the one before, and ends at rest.

A window is solved to a stop at its end and proved as a whole. The next one goes on from a break before that stop, with
the speed and the acceleration there: what has been planned by any instant is a whole motion that is proved and comes to
rest. The stop is so far behind that break that it changes the motion up to it next to nothing.
"""

from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose
from planner.limits.limit import Limit
from planner.path.actuation import MachinePath
from planner.path.join_and_blend import PathStep
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.problem import Continuation

PIECES = 120
"""Of a window, if a stop does not end it before."""
BRAKINGS = 4.0
"""Times the way to its stop takes a window longer, from where the next goes on, than braking for it."""
MAX_GROWTH = 8
"""Times as many pieces as PIECES are put into a window at most, for a machine that brakes over many."""
KNOWN_SHARE = 0.5
"""Of the time pieces behind a place that is gone on from, those whose grid stays; beside a stop it is far too fine."""
SEAMS = 3
"""Breaks at most from which is gone on, one after the other, until one is found that leads to a motion."""
# Share of a path by which rounding may put the same place before itself.
SEAM_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class Start:
    """How a window begins: at rest, or in the midst of a motion, whose rest it may take.

    begin   s, when it begins, counted from the start of the first window
    steps   of the path before it
    pieces  how many it takes at first; None: as many as the planner says
    """

    begin: float = 0.0
    length: float = 0.0
    steps: int = 0
    pieces: int | None = None
    speed: float = 0.0
    near: Array | None = None
    continuation: Continuation | None = None


@dataclass(frozen=True, slots=True)
class Window:
    """A certified motion from where the window before was left, to rest; the next one goes on in its midst.

    start  how it began; steps: of the path, that it has
    kept   time pieces of it that stay: with the next window's those before these are the motion; the last has all
    next   how the window behind it begins: whoever knows it and the path behind can plan on from there
    """

    solution: Solution
    start: Start
    steps: int
    kept: int
    next: Start

    @property
    def duration(self) -> float:
        """s of what stays of it."""
        return float(self.solution.trajectory.knots[self.kept])


@dataclass(frozen=True, slots=True)
class _Seam:
    """Where a window may be left: at the end of so many of its steps and time pieces."""

    steps: int
    knot: int


@dataclass(frozen=True, slots=True)
class _Held:
    """A window whose successor is not planned yet, of so many steps; seams: where to leave it, the best place last."""

    solution: Solution
    steps: int
    seams: list[_Seam]


@dataclass(frozen=True, slots=True)
class WindowPlanner:
    """The fastest certified motion along steps, window by window, as they come.

    limit   a path -> its limits
    tool    its frame in the platform's, whose path length the pieces have; None: the platform's own
    pieces  of a window at first
    """

    machine: Machine
    limit: Callable[[MachinePath], Sequence[Limit]]
    order: int
    tool: Pose | None = None
    pieces: int = PIECES

    def __call__(self, steps: Iterable[PathStep], start: Start | None = None) -> Iterator[Window]:
        """Of the steps from a start on, by default all of a path from rest.

        Raises as `certified_solve`, at the first window that cannot be, when those before it have been given.
        """
        coming, ahead = iter(steps), list[PathStep]()  # from where the window held begins
        held: _Held | None = None  # to be left in its midst
        rest: _Held | None = None  # the same, or one whose stop is near all of it: what to come to rest by
        start = start or Start()
        count = start.pieces or self.pieces
        while True:
            skip = held.seams[-1].steps if held is not None else 0
            ahead += islice(coming, max(0, skip + count + 1 - len(ahead)))
            if len(ahead) == skip:
                return
            own = _cut_at_last_stop(ahead[skip : skip + count], self.order)
            onward = start if held is None else self._start_from(held, start, count)
            found = attempt(partial(self._solve, own, onward))
            if isinstance(found, MotionError) and held is not None:
                held.seams.pop()
                if held.seams:
                    continue
            if isinstance(found, MotionError):
                if rest is None:
                    raise found
                start = yield from self._stop(rest.solution, start, rest.steps, count)  # its stop remains
                del ahead[: rest.steps]
                held = rest = None
                continue
            if held is not None:
                yield Window(held.solution, start, held.steps, held.seams[-1].knot, onward)
                start = onward
                del ahead[:skip]
            ends = len(own) == len(ahead) or 0 < own[-1].stop <= self.order
            held = rest = _Held(found, len(own), [] if ends else _find_seams(found, own))
            if held.seams:
                continue
            held = None
            if not ends and count < MAX_GROWTH * self.pieces:
                count *= 2  # the stop is near all of it
                continue
            start = yield from self._stop(found, start, len(own), count)
            rest = None
            del ahead[: len(own)]

    def _stop(self, solution: Solution, start: Start, steps: int, count: int) -> Generator[Window, None, Start]:
        """A window of which all stays, and how the next begins."""
        motion = solution.trajectory
        length = start.length + float(motion.path.breaks[-1])
        onward = Start(start.begin + motion.duration, length, start.steps + steps, count)
        yield Window(solution, start, steps, len(motion.s), onward)
        return onward

    def _solve(self, steps: Sequence[PathStep], start: Start) -> Solution:
        """From a start to a stop behind the last step."""
        path = MachinePath(
            self.machine,
            [step.piece for step in steps],
            np.array([1, *(step.stop for step in steps[:-1]), 1]),
            np.array([steps[0].wait, *(step.dwell for step in steps)]),
            tool=self.tool,
            end_speeds=(start.speed, 0.0),
            end_accelerations=(0.0 if start.continuation is None else start.continuation.acceleration, 0.0),
            near=start.near,
            origin=(start.length, start.begin),
        )
        return certified_solve(path, self.limit(path), self.order, continuation=start.continuation)

    def _start_from(self, held: _Held, start: Start, count: int) -> Start:
        """Where the window held, which began at a start, is left."""
        seam, motion, room = held.seams[-1], held.solution.trajectory, held.solution.last_room
        knot = seam.knot
        state = motion.within(np.array([knot]), np.zeros(1))
        s = np.append(motion.s[knot:], motion.path.breaks[-1]) - motion.s[knot]
        first = knot - len(motion.s)
        last = first if room is None else first + int(KNOWN_SHARE * -first)
        continuation = Continuation(
            s[: last - first + 1],
            np.stack([motion.v, motion.a, motion.j, np.diff(motion.knots)])[:, first:last],
            {} if room is None else {name: values[first:last] for name, values in room.items()},
            float(motion.a[knot]),
        )
        begin, length = start.begin + float(motion.knots[knot]), start.length + float(motion.s[knot])
        return Start(begin, length, start.steps + seam.steps, count, float(motion.v[knot]), state.q[0], continuation)


def _cut_at_last_stop(steps: list[PathStep], order: int) -> list[PathStep]:
    """The steps up to the last at whose end a motion of this order rests; all where there is none."""
    stops = [n for n, step in enumerate(steps) if 0 < step.stop <= order]
    return steps[: stops[-1] + 1] if stops else steps


def _find_seams(solution: Solution, steps: Sequence[PathStep]) -> list[_Seam]:
    """Ends of steps behind which the way to the stop takes BRAKINGS times as long as braking for it; the last last."""
    motion = solution.trajectory
    run = 0 if solution.last_room is None else len(motion.s) - len(next(iter(solution.last_room.values()), ()))
    slower = np.flatnonzero(np.diff(motion.v) > 0)  # ṡ falls all the way from the knot behind
    braking = motion.duration - float(motion.knots[slower[-1] + 1 if len(slower) else 0])
    ends = np.cumsum([step.piece.length for step in steps])[:-1]
    knots = np.searchsorted(motion.s, ends - SEAM_ROUNDING * motion.path.breaks[-1])
    kept = np.flatnonzero((motion.knots[knots] <= motion.duration - BRAKINGS * braking) & (knots > run))
    kept = kept[-1 :: -max(1, len(kept) // SEAMS)][:SEAMS]
    return [_Seam(int(n) + 1, int(knots[n])) for n in reversed(kept)]
