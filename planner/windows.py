"""Plan a path of any length window by window.

Each window continues the previous one, and ends at rest.

A window is solved to a stop at its end, and proved as a whole. The next window continues from a
break before that stop, at the speed and acceleration there. So the motion planned up to any instant
is proved and comes to rest. The stop is so far after the break that it hardly changes the motion
before it.

Between two stops of the path, windows depend on nothing else. Such stretches can be planned in any
process, and equal ones are planned and proved once. The path of a window begins at length 0, so
that the windows of equal stretches are the same numbers, bit for bit. Only path and limits are made
for each place.
"""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from itertools import chain
from typing import Protocol, cast

import numpy as np

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt, refuse_items, require, take_items
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose
from planner.limits.limit import Limit
from planner.limits.resonance import Resonance
from planner.path.actuation import MachinePath, split_turns
from planner.path.join_and_blend import PathStep, list_avoidable
from planner.path.shape import Piece
from planner.place import Place
from planner.request import PIECES
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.problem import Continuation, Settings

# Time from the break to the end of a window, in braking times: a larger number changes the motion
# before the break less, and solves more of the path twice.
BRAKINGS = 4.0
# Largest window, in initial window sizes, for a machine that brakes over many pieces.
MAX_GROWTH = 8
# Share of the intervals after a break whose grid the next window takes over. Near the stop the grid
# is far too fine for it.
KNOWN_SHARE = 0.5
# Breaks from which the next window may continue. They are tried in turn until one leads to a
# motion.
SEAMS = 3
# Largest stretch for a helper, in steps. A longer one is planned in this process as its steps come,
# in little memory.
MAX_SHARED = 4096
# Steps of all stretches whose windows are remembered: it bounds the memory.
MOST_REMEMBERED = 2 * MAX_SHARED
# Share of a path by which rounding may put the same place before itself.
SEAM_ROUNDING = 1e-12
# Share of a speed by which rounding may put an axis out of a band of resonance.
RESONANCE_ROUNDING = 1e-6


@dataclass(frozen=True, slots=True)
class Start:
    """The beginning of a window: at rest, or at a break of the previous window.

    elapsed       exact time (s) from the start of the first window
    length        length (m) of the path before the window
    steps         number of steps of the path before the window
    pieces        initial size of the window; None: the planner's own, at the beginning of a stretch
    speed         ṡ at the beginning
    acceleration  s̈ at the beginning
    near          (n,) coordinates near which the window begins; None: near home's
    continuation  motion of the previous window from the break on
    """

    elapsed: Fraction = Fraction(0)
    length: float = 0.0
    steps: int = 0
    pieces: int | None = None
    speed: float = 0.0
    acceleration: float = 0.0
    near: Array | None = None
    continuation: Continuation | None = None

    @property
    def begin(self) -> float:
        """Time (s) from the start of the first window."""
        return float(self.elapsed)


@dataclass(frozen=True, slots=True)
class Window:
    """A certified motion from a start to rest. The next window replaces its end.

    start  beginning of the window
    steps  number of steps of the path in the window
    kept   number of time pieces before the break; all of them in the last window of a stretch
    next   beginning of the next window
    """

    solution: Solution
    start: Start
    steps: int
    kept: int
    next: Start

    @property
    def duration(self) -> float:
        """Time (s) from the start to the break."""
        return float(self.solution.trajectory.knots[self.kept])


Stretch = tuple[list[PathStep], Array]
"""Steps between two stops, and the coordinates near which they begin."""


class Share(Protocol):
    """A stretch that a helper plans."""

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        """Wait for the windows. `here` plans them in this process if no helper can."""


class Helpers(Protocol):
    """Other processes, here or on other computers, that plan stretches."""

    def prepare(self, work: Callable[[Stretch], list[Window]]) -> Callable[[Stretch], Share]:
        """Send the work to the helpers. Return the function that submits a stretch."""

    def room(self) -> int:
        """Return how many more stretches can be submitted. 0: plan the next one in this process."""

    def tell_alone(self, segment: int) -> None:
        """Report that a long stretch from this segment on is planned in this process."""


class _Here:
    """A stretch that this process plans."""

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        return here()


@dataclass(slots=True)
class _PlannedOnce:
    """A share whose windows serve all equal stretches. first: first piece of its own stretch."""

    share: Share
    first: Piece
    windows: list[Window] | None = None

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        if self.windows is None:
            self.windows = self.share.result(here)
        return self.windows


class _Memory:
    """The stretches planned last, by the data that determine their windows."""

    def __init__(self) -> None:
        self._planned: dict[Hashable, tuple[_PlannedOnce, int]] = {}
        self._steps = 0

    def find(
        self, key: Hashable, steps: Sequence[PathStep], submit: Callable[[], Share]
    ) -> _PlannedOnce:
        """Return the share of an equal stretch, or submit this one.

        Without a key it equals no other.
        """
        if key is None:
            return _PlannedOnce(submit(), steps[0].piece)
        planned, count = self._planned.pop(key, (None, 0))
        if planned is None:
            planned, count = _PlannedOnce(submit(), steps[0].piece), len(steps)
            self._steps += count
        self._planned[key] = planned, count  # used last, so forgotten last
        while self._steps > MOST_REMEMBERED:
            self._steps -= self._planned.pop(next(iter(self._planned)))[1]
        return planned


@dataclass(frozen=True, slots=True)
class _Seam:
    """A break from which the next window may continue, after this number of steps and time
    pieces.
    """

    steps: int
    knot: int


@dataclass(frozen=True, slots=True)
class _Pending:
    """A solved window whose successor is not solved yet. seams: its breaks, the best one last."""

    solution: Solution
    steps: int
    seams: list[_Seam]


@dataclass(frozen=True, slots=True)
class WindowPlanner:
    """Plans the fastest certified motion along steps, window by window, as they come.

    limit    function of a path that returns its limits
    tool     frame of the tool in the platform's, if the pieces count the tool's path length
    pieces   initial size of a window
    placed   whether places in proofs and refusals count from the start of the path; else of the
             window
    copying  whether equal stretches have equal limits, so that one is planned for all; a caller's
             own limits may depend on the place
    """

    machine: Machine
    limit: Callable[[MachinePath], Sequence[Limit]]
    order: int
    tool: Pose | None = None
    pieces: int = PIECES
    placed: bool = True
    copying: bool = False

    def __call__(
        self, steps: Iterable[PathStep], helpers: Helpers | None = None
    ) -> Iterator[Window]:
        """Plan all steps of a path, from rest to rest.

        The windows are the same with and without helpers.

        Raises as `certified_solve` and as the steps, after all windows before the refused step.
        """
        stretches = self._split(steps)
        if helpers is not None:
            yield from self._share(stretches, helpers)
            return
        start, memory = Start(), _Memory()
        for stretch in stretches:
            start = yield from self._plan_or_copy(stretch, start, memory)

    def _split(self, steps: Iterable[PathStep]) -> Iterator[Iterator[PathStep]]:
        """Yield stretches from stop to stop. Each must be consumed before the next.

        A stretch ends at the last stop within the initial size of a window, or at the next stop.
        That depends on the path alone. Stops between repetitions are preferred, so that the
        stretches of all repetitions are equal.
        """
        coming, ahead = iter(steps), list[PathStep]()
        while True:
            taken, coming = take_items(coming, self.pieces - len(ahead))
            ahead += taken
            if not ahead:
                next(coming, None)  # raises the refusal of the steps, if there is one
                return
            stops = [n + 1 for n, step in enumerate(ahead) if self._stops(step)]
            if stops:
                repetitions = [step.piece.repetition for step in ahead]
                whole = [
                    n for n in stops if n < len(ahead) and repetitions[n - 1] != repetitions[n]
                ]
                last = (whole or stops)[-1]
                yield iter(ahead[:last])
                del ahead[:last]
            else:
                yield chain(ahead, self._take_to_stop(coming))
                ahead = []

    def _stops(self, step: PathStep) -> bool:
        """Return whether a motion of this order rests after a step."""
        return 0 < step.stop <= self.order

    def _take_to_stop(self, steps: Iterator[PathStep]) -> Iterator[PathStep]:
        for step in steps:
            yield step
            if self._stops(step):
                return

    def _share(self, stretches: Iterator[Iterator[PathStep]], helpers: Helpers) -> Iterator[Window]:
        """Submit stretches to helpers, and yield their windows in order.

        This process plans a long stretch, an only stretch, and one whose steps end with a refusal,
        so that the refusal comes after the same windows as without helpers.
        """
        submit = helpers.prepare(self.plan_share)
        submitted = deque[tuple[list[PathStep], _PlannedOnce]]()
        start, memory = Start(), _Memory()
        coming, first = _find_next(stretches), True
        near, alone = self._near(start), list[PathStep]()
        while True:
            while coming is not None and not alone and len(submitted) < helpers.room():
                steps, rest = take_items(coming, MAX_SHARED + 1)
                if rest is not coming or len(steps) > MAX_SHARED:
                    alone, coming = steps, rest
                    break
                coming = _find_next(stretches)
                if first and coming is None:
                    alone, coming = steps, iter(())
                    break
                work = partial(submit, (steps, near))
                submitted.append((steps, memory.find(self._describe(steps, near), steps, work)))
                near, first = (
                    split_turns(self.machine, [step.piece for step in steps], near)[1][-1],
                    False,
                )
            if submitted:
                start = yield from self._take_share(*submitted.popleft(), start)
            elif coming is not None:
                if len(alone) > self.pieces:
                    helpers.tell_alone(alone[0].piece.segment)
                start = yield from self._plan_or_copy(chain(alone, coming), start, memory)
                coming, alone, near, first = _find_next(stretches), [], self._near(start), False
            else:
                return

    def _plan_or_copy(
        self, stretch: Iterator[PathStep], start: Start, memory: _Memory
    ) -> Generator[Window, None, Start]:
        """Plan a stretch in this process, or place the windows of an equal one."""
        first, rest = take_items(stretch, 1)
        coming = chain(first, rest)
        if not self.copying or not first or first[0].piece.repetition is None:
            return (yield from self._plan_stretch(coming, start))
        steps, rest = take_items(coming, MAX_SHARED + 1)
        # Steps that end with a refusal are planned up to it, and then raise it.
        is_refused = rest is not coming
        if is_refused or len(steps) > MAX_SHARED:
            return (yield from self._plan_stretch(chain(steps, rest), start))
        planned = memory.find(self._describe(steps, self._near(start)), steps, _Here)
        return (yield from self._take_share(steps, planned, start))

    def _describe(self, steps: Sequence[PathStep], near: Array) -> Hashable:
        """Return the data that determine the windows of a stretch, apart from its place.

        None: the stretch must not be copied. Numbers of segments and repetitions count from its
        first piece, so that places can be moved.
        """
        first = steps[0].piece
        if not self.copying or first.repetition is None:
            return None
        numbers = tuple(
            (
                step.piece.segment - first.segment,
                (step.piece.repetition or 0) - first.repetition,
                step.piece.content,
                step.stop,
                step.dwell,
                step.wait,
            )
            for step in steps
        )
        return numbers, near.tobytes() if self.machine.branched else b""

    def _near(self, start: Start) -> Array:
        return self.machine.home_q if start.near is None else start.near

    def _take_share(
        self, steps: list[PathStep], share: _PlannedOnce, start: Start
    ) -> Generator[Window, None, Start]:
        """Yield the windows of a stretch, planned for it or for an equal one, at its place on the
        path.
        """
        done = 0
        for window in share.result(partial(self.plan_share, (steps, self._near(start)))):
            placed = self._place(window, steps[done:], start, (share.first, steps[0].piece))
            yield placed
            done, start = window.next.steps, placed.next
        if done < len(steps):  # the rest cannot be planned, and raises here
            start = yield from self._plan_stretch(iter(steps[done:]), start)
        return start

    def plan_share(self, stretch: Stretch) -> list[Window]:
        """Return the windows of a stretch up to a refusal, without their paths and limits: a
        helper's work.

        Time, length and steps count from the start of the stretch, places from that of each window.
        """
        steps, near = stretch
        windows: list[Window] = []
        with suppress(MotionError):
            for window in replace(self, placed=False)._plan_stretch(iter(steps), Start(near=near)):
                motion = replace(window.solution.trajectory, path=cast(MachinePath, None))
                solution = replace(window.solution, trajectory=motion, limits=(), last_room=None)
                windows.append(replace(window, solution=solution))
        return windows

    def _place(
        self, window: Window, steps: Sequence[PathStep], start: Start, firsts: tuple[Piece, Piece]
    ) -> Window:
        """Return a planned window at its place, on the first of these steps.

        firsts: first piece of the stretch that it was planned for, and of the one that it is placed
        in.
        """
        path = self._draw(steps[: window.steps], start)
        onward = window.next
        motion = replace(window.solution.trajectory, path=path)
        proof = window.solution.certificate
        where = {name: _move_place(at, start, *firsts) for name, at in proof.where.items()}
        solution = replace(
            window.solution,
            trajectory=motion,
            certificate=replace(proof, where=where),
            limits=tuple(self.limit(path)),
        )
        length = float(motion.s[window.kept] if window.kept < len(motion.s) else path.breaks[-1])
        onward = replace(
            onward,
            elapsed=start.elapsed + Fraction(float(motion.knots[window.kept])),
            length=start.length + length,
            steps=start.steps + onward.steps - window.start.steps,
        )
        return Window(solution, start, window.steps, window.kept, onward)

    def _plan_stretch(
        self, coming: Iterator[PathStep], start: Start
    ) -> Generator[Window, None, Start]:
        """Yield the windows of a stretch, or of the rest of one.

        Return the start of the next stretch.

        A solved window stays pending until its successor is solved from one of its breaks. If no
        successor can be solved, the motion ends with the stop of the last solved window.
        """
        ahead = list[PathStep]()  # steps from the start of the pending window on
        pending: _Pending | None = None  # solved, with breaks to continue from
        last_stop: _Pending | None = None  # solved last: its stop is the way to come to rest
        count = start.pieces or self.pieces
        while True:
            skip = pending.seams[-1].steps if pending is not None else 0
            taken, coming = take_items(coming, max(0, skip + count + 1 - len(ahead)))
            ahead += taken
            if len(ahead) == skip:
                next(coming, None)
                return start
            steps = ahead[skip : skip + count]
            onward = start if pending is None else self._start_from(pending, start, count)
            solution = attempt(partial(self._solve, steps, onward))
            if isinstance(solution, MotionError) and pending is not None:
                pending.seams.pop()
                if pending.seams:
                    continue
            if isinstance(solution, MotionError):
                if last_stop is None:
                    if self.placed:  # else the caller that places the windows does so
                        yield from self._plan_before(steps, start, count)
                    raise solution
                start = yield from self._stop(last_stop.solution, start, last_stop.steps, count)
                del ahead[: last_stop.steps]
                pending = last_stop = None
                continue
            if pending is not None:
                knot = pending.seams[-1].knot
                yield Window(pending.solution, start, pending.steps, knot, onward)
                start = onward
                del ahead[:skip]
            ends = len(steps) == len(ahead)
            seams = [] if ends else _find_seams(solution, steps)
            pending = last_stop = _Pending(solution, len(steps), seams)
            if seams:
                continue
            pending = None
            if not ends and count < MAX_GROWTH * self.pieces:
                count *= 2  # the stop is close to every break
                continue
            start = yield from self._stop(solution, start, len(steps), None if ends else count)
            last_stop = None
            del ahead[: len(steps)]

    def _plan_before(
        self, steps: Sequence[PathStep], start: Start, count: int
    ) -> Generator[Window, None, None]:
        """Yield a window of the steps before the first refused one, if there are any."""
        solve = cache(lambda number: attempt(partial(self._solve, steps[:number], start)))
        fine = bisect_left(
            range(1, len(steps)), True, key=lambda number: isinstance(solve(number), MotionError)
        )
        if fine:
            yield from self._stop(require(solve(fine)), start, fine, count)

    def _stop(
        self, solution: Solution, start: Start, steps: int, count: int | None
    ) -> Generator[Window, None, Start]:
        """Yield a window with its stop. Return the start of the next."""
        motion = solution.trajectory
        length = start.length + float(motion.path.breaks[-1])
        end = motion.within(np.array([len(motion.s) - 1]), np.diff(motion.knots)[-1:])
        elapsed = start.elapsed + Fraction(motion.duration)
        onward = Start(elapsed, length, start.steps + steps, count, near=end.q[0])
        yield Window(solution, start, steps, len(motion.s), onward)
        return onward

    def _solve(self, steps: Sequence[PathStep], start: Start) -> Solution:
        """Solve the motion from a start to a stop after the last step."""
        path = self._draw(steps, start)
        return certified_solve(
            path, self.limit(path), self.order, settings=Settings(continuation=start.continuation)
        )

    def _draw(self, steps: Sequence[PathStep], start: Start) -> MachinePath:
        return MachinePath(
            self.machine,
            [step.piece for step in steps],
            np.array([1, *(step.stop for step in steps[:-1]), 1]),
            np.array([steps[0].wait, *(step.dwell for step in steps)]),
            tool=self.tool,
            end_speeds=(start.speed, 0.0),
            end_accelerations=(start.acceleration, 0.0),
            near=start.near,
            origin=(start.length, start.begin) if self.placed else (0.0, 0.0),
            avoidable=list_avoidable(steps[:-1]),
        )

    def _start_from(self, pending: _Pending, start: Start, count: int) -> Start:
        """Return the start of the successor of a pending window, which began at `start`."""
        seam = pending.seams[-1]
        motion = pending.solution.trajectory
        room = pending.solution.last_room
        knot = seam.knot
        state = motion.within(np.array([knot]), np.zeros(1))
        s = np.append(motion.s[knot:], motion.path.breaks[-1]) - motion.s[knot]
        first = knot - len(motion.s)
        last = first if room is None else first + int(KNOWN_SHARE * -first)
        continuation = Continuation(
            s[: last - first + 1],
            np.stack([motion.v, motion.a, motion.j, np.diff(motion.knots)])[:, first:last],
            {} if room is None else {name: values[first:last] for name, values in room.items()},
        )
        elapsed, length = (
            start.elapsed + Fraction(float(motion.knots[knot])),
            start.length + float(motion.s[knot]),
        )
        return Start(
            elapsed,
            length,
            start.steps + seam.steps,
            count,
            float(motion.v[knot]),
            float(motion.a[knot]),
            state.q[0],
            continuation,
        )


def _move_place(at: Place, start: Start, planned: Piece, here: Piece) -> Place:
    """Move a place of a window to its start, in a stretch that begins with `here` instead of
    `planned`.
    """
    segment, repetition = at.segment, at.repetition
    if segment is not None:
        segment += here.segment - planned.segment
    if repetition is not None:
        repetition += (here.repetition or 0) - (planned.repetition or 0)
    t = None if at.t is None else start.begin + at.t
    return replace(at, s=start.length + at.s, t=t, segment=segment, repetition=repetition)


def _find_next(stretches: Iterator[Iterator[PathStep]]) -> Iterator[PathStep] | None:
    """Return the next stretch. A refusal is raised by its steps."""
    try:
        return next(stretches, None)
    except MotionError as error:
        return refuse_items(error)


def _find_resonating(solution: Solution, knots: np.ndarray) -> np.ndarray:
    """Return whether an axis may be in a band of resonance at each of these knots.

    The time in a band is proved of each window. No stay may continue from one into the next.
    """
    motion = solution.trajectory
    resonating = np.zeros(len(knots), bool)
    bands = [
        band for limit in solution.limits if isinstance(limit, Resonance) for band in limit.bands
    ]
    if not bands:
        return resonating
    speeds = np.abs(motion.within(knots, np.zeros(len(knots))).qd)
    for band in bands:
        speed = speeds[:, band.axis]
        low = (1 - RESONANCE_ROUNDING) * band.low
        high = (1 + RESONANCE_ROUNDING) * band.high
        resonating |= (speed >= low) & (speed <= high)
    return resonating


def _find_seams(solution: Solution, steps: Sequence[PathStep]) -> list[_Seam]:
    """Return breaks from which the way to the stop takes BRAKINGS times as long as braking, in
    order.
    """
    motion = solution.trajectory
    run = (
        0
        if solution.last_room is None
        else len(motion.s) - len(next(iter(solution.last_room.values()), ()))
    )
    slower = np.flatnonzero(np.diff(motion.v) > 0)  # ṡ falls from the knot after the last of these
    braking = motion.duration - float(motion.knots[slower[-1] + 1 if len(slower) else 0])
    ends = np.cumsum([step.piece.length for step in steps])[:-1]
    knots = np.searchsorted(motion.s, ends - SEAM_ROUNDING * motion.path.breaks[-1])
    is_far = (motion.knots[knots] <= motion.duration - BRAKINGS * braking) & (knots > run)
    far = np.flatnonzero(is_far & ~_find_resonating(solution, knots))
    far = far[-1 :: -max(1, len(far) // SEAMS)][:SEAMS]
    return [_Seam(int(n) + 1, int(knots[n])) for n in reversed(far)]
