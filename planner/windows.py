"""A path of any length, timed window by window: each goes on with the motion of the one before, and ends at rest.

A window is solved to a stop at its end and proved as a whole. The next one goes on from a break before that stop, with
the speed and the acceleration there: what has been planned by any instant is a whole motion that is proved and comes to
rest. The stop is so far behind that break that it changes the motion up to it next to nothing.

From one stop of the path to another, windows depend on nothing else: such stretches can be planned anywhere, and those
of a program that repeats are planned and proved once. The path of a window begins at length 0, so that the windows of
equal stretches are the same numbers, bit for bit; only the path and the limits are made for each place.
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
from planner.path.actuation import MachinePath, split_turns
from planner.path.join_and_blend import PathStep, list_avoidable
from planner.path.shape import Piece
from planner.place import Place
from planner.request import PIECES
from planner.timing.certified_solve import Solution, certified_solve
from planner.timing.problem import Continuation

BRAKINGS = 4.0
"""Times the way to its stop takes a window longer, from where the next goes on, than braking for it."""
MAX_GROWTH = 8
"""Times as many pieces as PIECES are put into a window at most, for a machine that brakes over many."""
KNOWN_SHARE = 0.5
"""Of the time pieces behind a place that is gone on from, those whose grid stays; beside a stop it is far too fine."""
SEAMS = 3
"""Breaks at most from which is gone on, one after the other, until one is found that leads to a motion."""
MAX_SHARED = 4096
"""Steps at most of a stretch that helpers plan: a longer one is planned here as its steps come, in little memory."""
MOST_REMEMBERED = 2 * MAX_SHARED
"""Steps in all of the stretches whose windows are remembered: more would take memory that grows with the path."""
# Share of a path by which rounding may put the same place before itself.
SEAM_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class Start:
    """How a window begins: at rest, or in the midst of a motion, whose rest it may take.

    elapsed  s, when it begins, counted from the start of the first window, exactly; length: m of the path before it
    steps   of the path before it
    pieces  how many it takes at first; None: as many as the planner says, where a stretch from stop to stop begins
    """

    elapsed: Fraction = Fraction(0)
    length: float = 0.0
    steps: int = 0
    pieces: int | None = None
    speed: float = 0.0
    near: Array | None = None
    continuation: Continuation | None = None

    @property
    def begin(self) -> float:
        """s, when it begins: a running sum would drift."""
        return float(self.elapsed)


@dataclass(frozen=True, slots=True)
class Window:
    """A certified motion from where the window before was left, to rest; the next one goes on in its midst.

    start  how it began; steps: of the path, that it has
    kept   time pieces of it that stay: with the next window's those before these are the motion; the last has all
    next   how the following window begins
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


Stretch = tuple[list[PathStep], Array]
"""Steps from a stop to a stop, and the coordinates near which they begin."""


class Share(Protocol):
    """A stretch that was given to a helper."""

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        """Wait for its windows; `here` plans them in this process, where that is all that is left."""


class Helpers(Protocol):
    """Other processes, here or on other computers, that plan stretches."""

    def prepare(self, work: Callable[[Stretch], list[Window]]) -> Callable[[Stretch], Share]:
        """Have them know the work; returns what gives a stretch to one of them."""

    def room(self) -> int:
        """How many stretches they can be given before the first is done; 0: plan the next without them."""

    def tell_alone(self, segment: int) -> None:
        """From this segment on it is a long way to the next stop, which is planned here."""


class _Here:
    """A share of this process: nobody else plans it."""

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        return here()


@dataclass(slots=True)
class _PlannedOnce:
    """A share whose windows serve all stretches that equal its own, which begins with the piece `first`."""

    share: Share
    first: Piece
    windows: list[Window] | None = None

    def result(self, here: Callable[[], list[Window]]) -> list[Window]:
        if self.windows is None:
            self.windows = self.share.result(here)
        return self.windows


class _Memory:
    """The last stretches that were planned, by all that decides their windows."""

    def __init__(self) -> None:
        self._planned: dict[Hashable, tuple[_PlannedOnce, int]] = {}
        self._steps = 0

    def find(self, key: Hashable, steps: Sequence[PathStep], submit: Callable[[], Share]) -> _PlannedOnce:
        """Return the share of an equal stretch, or else submit this one; a stretch without a key equals no other."""
        if key is None:
            return _PlannedOnce(submit(), steps[0].piece)
        planned, count = self._planned.pop(key, (None, 0))
        if planned is None:
            planned, count = _PlannedOnce(submit(), steps[0].piece), len(steps)
            self._steps += count
        self._planned[key] = planned, count  # now the last that is forgotten
        while self._steps > MOST_REMEMBERED:
            self._steps -= self._planned.pop(next(iter(self._planned)))[1]
        return planned


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
    placed  whether places in proofs and refusals count from where the path starts; else from where the window does
    copying  whether equal stretches have equal limits, so that one is planned for all: not with a caller's own limits
    """

    machine: Machine
    limit: Callable[[MachinePath], Sequence[Limit]]
    order: int
    tool: Pose | None = None
    pieces: int = PIECES
    placed: bool = True
    copying: bool = False

    def __call__(self, steps: Iterable[PathStep], helpers: Helpers | None = None) -> Iterator[Window]:
        """Plan all steps of a path, from rest to rest; the windows are the same with and without helpers.

        Raises as `certified_solve`, and as the steps do, when all windows before the step that is refused are given.
        """
        stretches = self._split(steps)
        if helpers is not None:
            yield from self._share(stretches, helpers)
            return
        start, memory = Start(), _Memory()
        for stretch in stretches:
            start = yield from self._plan_or_copy(stretch, start, memory)

    def _split(self, steps: Iterable[PathStep]) -> Iterator[Iterator[PathStep]]:
        """Stretches from stop to stop, each to be taken before the next.

        Up to the last stop that a window at first reaches, or else to the next: which depends on the path alone. Stops
        between repetitions come first, so that the stretches of all repetitions are equal.
        """
        coming, ahead = iter(steps), list[PathStep]()
        while True:
            more, coming = take_items(coming, self.pieces - len(ahead))
            ahead += more
            if not ahead:
                next(coming, None)  # raises what the steps end with, if that is a refusal
                return
            stops = [n + 1 for n, step in enumerate(ahead) if self._stops(step)]
            if stops:
                repetitions = [step.piece.repetition for step in ahead]
                whole = [n for n in stops if n < len(ahead) and repetitions[n - 1] != repetitions[n]]
                last = (whole or stops)[-1]
                yield iter(ahead[:last])
                del ahead[:last]
            else:
                yield chain(ahead, self._take_to_stop(coming))
                ahead = []

    def _stops(self, step: PathStep) -> bool:
        """Whether a motion of this order rests behind it."""
        return 0 < step.stop <= self.order

    def _take_to_stop(self, steps: Iterator[PathStep]) -> Iterator[PathStep]:
        for step in steps:
            yield step
            if self._stops(step):
                return

    def _share(self, stretches: Iterator[Iterator[PathStep]], helpers: Helpers) -> Iterator[Window]:
        """Give stretches to helpers, and yield their windows in order.

        Planned here are a stretch that is long, one that is the only one, and one whose steps end with a refusal, so
        that the refusal comes after the same windows as without helpers.
        """
        submit = helpers.prepare(self.plan_share)
        given = deque[tuple[list[PathStep], _PlannedOnce]]()
        start, memory = Start(), _Memory()
        coming, first = _find_next(stretches), True
        near, alone = self._near(start), list[PathStep]()
        while True:
            while coming is not None and not alone and len(given) < helpers.room():
                steps, rest = take_items(coming, MAX_SHARED + 1)
                if rest is not coming or len(steps) > MAX_SHARED:
                    alone, coming = steps, rest
                    break
                coming = _find_next(stretches)
                if first and coming is None:
                    alone, coming = steps, iter(())
                    break
                work = partial(submit, (steps, near))
                given.append((steps, memory.find(self._describe(steps, near), steps, work)))
                near, first = split_turns(self.machine, [step.piece for step in steps], near)[1][-1], False
            if given:
                start = yield from self._take_share(*given.popleft(), start)
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
        # steps that end with a refusal are planned up to it, and raise it then
        refused = rest is not coming
        if refused or len(steps) > MAX_SHARED:
            return (yield from self._plan_stretch(chain(steps, rest), start))
        planned = memory.find(self._describe(steps, self._near(start)), steps, _Here)
        return (yield from self._take_share(steps, planned, start))

    def _describe(self, steps: Sequence[PathStep], near: Array) -> Hashable:
        """Return all that decides the windows of a stretch but its place; None for one that is not to be copied.

        The numbers of segments and repetitions count from its first piece, so that places can be moved.
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

    def _take_share(self, steps: list[PathStep], share: _PlannedOnce, start: Start) -> Generator[Window, None, Start]:
        """The windows that were planned of a stretch or of an equal one, put where they are on the path."""
        done = 0
        for window in share.result(partial(self.plan_share, (steps, self._near(start)))):
            placed = self._place(window, steps[done:], start, (share.first, steps[0].piece))
            yield placed
            done, start = window.next.steps, placed.next
        if done < len(steps):  # which cannot be planned, and raises here
            start = yield from self._plan_stretch(iter(steps[done:]), start)
        return start

    def plan_share(self, stretch: Stretch) -> list[Window]:
        """What a helper does: the windows of a stretch, up to one that cannot be; without their paths and limits.

        What they count begins with the stretch, their places with themselves.
        """
        steps, near = stretch
        found: list[Window] = []
        with suppress(MotionError):
            for window in replace(self, placed=False)._plan_stretch(iter(steps), Start(near=near)):
                motion = replace(window.solution.trajectory, path=cast(MachinePath, None))
                solution = replace(window.solution, trajectory=motion, limits=(), last_room=None)
                found.append(replace(window, solution=solution))
        return found

    def _place(self, window: Window, steps: Sequence[PathStep], start: Start, firsts: tuple[Piece, Piece]) -> Window:
        """A window that was planned, of the first of some steps, as it is where it begins.

        firsts: the first pieces of the stretch that it was planned for and of the one that it is placed in.
        """
        path, kept, onward = self._draw(steps[: window.steps], start), window.kept, window.next
        motion = replace(window.solution.trajectory, path=path)
        proof = window.solution.certificate
        where = {name: _move_place(at, start, *firsts) for name, at in proof.where.items()}
        solution = replace(
            window.solution, trajectory=motion, certificate=replace(proof, where=where), limits=tuple(self.limit(path))
        )
        length = float(motion.s[kept] if kept < len(motion.s) else path.breaks[-1])
        onward = replace(
            onward,
            elapsed=start.elapsed + Fraction(float(motion.knots[kept])),
            length=start.length + length,
            steps=start.steps + onward.steps - window.start.steps,
        )
        return Window(solution, start, window.steps, kept, onward)

    def _plan_stretch(self, coming: Iterator[PathStep], start: Start) -> Generator[Window, None, Start]:
        """The windows of a stretch, or of what is left of it behind one of them; returns how the next begins."""
        ahead = list[PathStep]()  # from where the window held begins
        held: _Held | None = None  # to be left in its midst
        rest: _Held | None = None  # the same, or one whose stop is near all of it: what to come to rest by
        count = start.pieces or self.pieces
        while True:
            skip = held.seams[-1].steps if held is not None else 0
            more, coming = take_items(coming, max(0, skip + count + 1 - len(ahead)))
            ahead += more
            if len(ahead) == skip:
                next(coming, None)
                return start
            own = ahead[skip : skip + count]
            onward = start if held is None else self._start_from(held, start, count)
            found = attempt(partial(self._solve, own, onward))
            if isinstance(found, MotionError) and held is not None:
                held.seams.pop()
                if held.seams:
                    continue
            if isinstance(found, MotionError):
                if rest is None:
                    if self.placed:  # else whoever places the windows does so
                        yield from self._plan_before(own, start, count)
                    raise found
                start = yield from self._stop(rest.solution, start, rest.steps, count)  # its stop remains
                del ahead[: rest.steps]
                held = rest = None
                continue
            if held is not None:
                yield Window(held.solution, start, held.steps, held.seams[-1].knot, onward)
                start = onward
                del ahead[:skip]
            ends = len(own) == len(ahead)
            held = rest = _Held(found, len(own), [] if ends else _find_seams(found, own))
            if held.seams:
                continue
            held = None
            if not ends and count < MAX_GROWTH * self.pieces:
                count *= 2  # the stop is near all of it
                continue
            start = yield from self._stop(found, start, len(own), None if ends else count)
            rest = None
            del ahead[: len(own)]

    def _plan_before(self, steps: Sequence[PathStep], start: Start, count: int) -> Generator[Window, None, None]:
        """Of steps that are refused as a whole a window of those before the one that is, if there are any."""
        solve = cache(lambda number: attempt(partial(self._solve, steps[:number], start)))
        fine = bisect_left(range(1, len(steps)), True, key=lambda number: isinstance(solve(number), MotionError))
        if fine:
            yield from self._stop(require(solve(fine)), start, fine, count)

    def _stop(self, solution: Solution, start: Start, steps: int, count: int | None) -> Generator[Window, None, Start]:
        """A window of which all stays, and how the next begins."""
        motion = solution.trajectory
        length = start.length + float(motion.path.breaks[-1])
        end = motion.within(np.array([len(motion.s) - 1]), np.diff(motion.knots)[-1:])
        elapsed = start.elapsed + Fraction(motion.duration)
        onward = Start(elapsed, length, start.steps + steps, count, near=end.q[0])
        yield Window(solution, start, steps, len(motion.s), onward)
        return onward

    def _solve(self, steps: Sequence[PathStep], start: Start) -> Solution:
        """From a start to a stop behind the last step."""
        path = self._draw(steps, start)
        return certified_solve(path, self.limit(path), self.order, continuation=start.continuation)

    def _draw(self, steps: Sequence[PathStep], start: Start) -> MachinePath:
        return MachinePath(
            self.machine,
            [step.piece for step in steps],
            np.array([1, *(step.stop for step in steps[:-1]), 1]),
            np.array([steps[0].wait, *(step.dwell for step in steps)]),
            tool=self.tool,
            end_speeds=(start.speed, 0.0),
            end_accelerations=(0.0 if start.continuation is None else start.continuation.acceleration, 0.0),
            near=start.near,
            origin=(start.length, start.begin) if self.placed else (0.0, 0.0),
            avoidable=list_avoidable(steps[:-1]),
        )

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
        elapsed, length = start.elapsed + Fraction(float(motion.knots[knot])), start.length + float(motion.s[knot])
        return Start(elapsed, length, start.steps + seam.steps, count, float(motion.v[knot]), state.q[0], continuation)


def _move_place(at: Place, start: Start, planned: Piece, here: Piece) -> Place:
    """Return a place of a window that begins at a start, in a stretch that begins with `here` instead of `planned`."""
    segment, repetition = at.segment, at.repetition
    if segment is not None:
        segment += here.segment - planned.segment
    if repetition is not None:
        repetition += (here.repetition or 0) - (planned.repetition or 0)
    t = None if at.t is None else start.begin + at.t
    return replace(at, s=start.length + at.s, t=t, segment=segment, repetition=repetition)


def _find_next(stretches: Iterator[Iterator[PathStep]]) -> Iterator[PathStep] | None:
    """A stretch that raises where finding it does."""
    try:
        return next(stretches, None)
    except MotionError as error:
        return refuse_items(error)


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
