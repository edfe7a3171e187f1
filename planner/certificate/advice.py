"""What would bring a path back within its machine: the largest scale about its start, of its way or its angles, or a
move.

The move is the least along an axis. All are found by bisection on the geometric limits at many places of the changed
program's path, which is quick; what is advised is proved as the check proves it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import floor, sqrt
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.units import round_up_digits
from kinematics.machine.machine import Machine
from planner.certificate.conditioning import PART_SHARES, stays_on_one_side
from planner.certificate.feasibility import prove_feasibility
from planner.certificate.limit_use import LIMIT_ROUNDING
from planner.limits import Limit, limits_of
from planner.path.actuation import MachinePath, actuate
from planner.path.chain import default_start
from planner.program.model import Arc, Curve, Dwell, Line, Program, Segment, Spline, Synchronised, Turn
from planner.trajectory import unit_speed_trajectory


def scale_program(program: Program, start: Array, share: float) -> Program:
    """Every coordinate p taken to start + share · (p − start); orientations as they are."""
    segments = tuple(_scale_segment(segment, share, (1 - share) * start) for segment in program.segments)
    return replace(program, segments=segments)


def shift_program(program: Program, shift: Array) -> Program:
    """Every coordinate moved by (3,) m, the start too where the program states one: else it is where it was."""
    begin = program.start
    if begin is not None:
        begin = RigidTransform.from_components(begin.translation + shift, begin.rotation)
    return replace(
        program, segments=tuple(_scale_segment(segment, 1.0, shift) for segment in program.segments), start=begin
    )


def states_destination(program: Program) -> bool:
    """Whether the program goes from its start to a point that it states, by a line, a spline or a synchronised move."""
    first = next((segment for segment in program.segments if not isinstance(segment, Dwell | Turn)), None)
    return isinstance(first, Line | Spline | Synchronised)


def states_rotation(program: Program) -> bool:
    """Whether any segment states an orientation or an angle; equations do not count."""
    return any(
        isinstance(part, Turn) or (isinstance(part, Line | Arc | Spline | Synchronised) and part.rotate is not None)
        for part in program.segments
    )


def scale_rotations(program: Program, share: float) -> Program:
    """Every orientation taken to a share of its angle from the start's; equations keep theirs."""
    begin = Rotation.identity() if program.start is None else program.start.rotation

    def part(given: Rotation) -> Rotation:
        return begin * Rotation.from_rotvec(share * (begin.inv() * given).as_rotvec())

    segments: list[Segment] = []
    for segment in program.segments:
        match segment:
            case Turn(to=None):
                segments.append(replace(segment, angle=share * segment.angle))
            case Turn(to=Rotation() as given):
                segments.append(replace(segment, to=part(given)))
            case Line() | Arc() | Spline() | Synchronised() if segment.rotate is not None:
                segments.append(replace(segment, rotate=part(segment.rotate)))
            case _:
                segments.append(segment)
    return replace(program, segments=tuple(segments))


def _scale_segment(segment: Segment, share: float, away: Array) -> Segment:
    """With every coordinate p taken to share · p + away."""
    match segment:
        case Line() | Synchronised():
            return replace(segment, to=freeze_array(share * np.asarray(segment.to) + away))
        case Arc():
            centre = freeze_array(share * np.asarray(segment.centre) + away)
            return replace(segment, centre=centre, rise=share * segment.rise)
        case Spline():
            return replace(segment, through=freeze_array(share * np.asarray(segment.through) + away))
        case Curve():
            length = share * segment.length
            texts = zip(segment.position, (away / length).tolist(), strict=True)
            x, y, z = (f"({text})+{offset!r}" if offset else text for text, offset in texts)
            return replace(segment, position=(x, y, z), length=length)
        case Turn() | Dwell():
            return segment


# s after which nothing more is looked for: a refusal is not to take longer than a plan.
MAX_SEARCH_TIME = 10.0
# Shares and moves (m) that are tried before bisecting between one that holds and the one before it.
TRIAL_SHARES = (1.0, *np.linspace(0.95, 0.05, 19).tolist())
TRIAL_MOVES = (0.0, *(4e-4 * 2.0 ** np.arange(9)).tolist())
BISECTIONS_OF_REMEDY = 10
# What does not prove as it is told is taken so much further, so often.
EXTRA_SHARE, MAX_EXTRA_STEPS = 1e-3, 4
# Between what proves and what does not, where only the proof finds what is wrong: factor, and steps of shares, within
# which both are one.
MOVE_AGREEMENT, SHARE_AGREEMENT = 1.03, 1e-3
MOVE_DIRECTIONS = tuple(
    (sign + name, float(f"{sign}1") * np.eye(3)[k]) for k, name in enumerate("xyz") for sign in "+-"
)

ProgramChange = Callable[[float], Program]
"""The program changed by so much."""


@dataclass(frozen=True, slots=True)
class Refit:
    """scale: the largest about the start that holds, as a share; move: the least (m) and its way, "+x" to "-z".

    turn: the largest scale of its angles, from the start's orientation. None: none was found.
    home: what the machine breaks at home, as `Margins.worst` tells it, if it does: then its file is at fault
    movable: whether moves were tried; late: whether the search ended for want of time
    """

    scale: float | None = None
    turn: float | None = None
    move: tuple[float, str] | None = None
    home: str = ""
    movable: bool = True
    late: bool = False

    def __str__(self) -> str:
        told = [] if self.scale is None else [f"scaled to <= {self.scale * 100:.1f} % about its start"]
        told += [] if self.turn is None else [f"with its angles scaled to <= {self.turn * 100:.1f} %"]
        told += [] if self.move is None else [f"moved by >= {self.move[0] * 1e3:g} mm along {self.move[1]}"]
        if told:
            return f"the path fits the machine {', or '.join(told)}"
        if self.home:
            return f"the machine already exceeds a limit at home ({self.home}): correct its geometry, home or limits"
        if self.late:
            return f"what scale or move would fit the path to the machine was not found in {MAX_SEARCH_TIME:g} s"
        moves = f" and no move of up to {TRIAL_MOVES[-1] * 1e3:g} mm along an axis" if self.movable else ""
        return (
            f"no scale about its start down to {TRIAL_SHARES[-1] * 100:g} %{moves} was found to fit the path to the "
            "machine"
        )


def find_remedy(program: Program, machine: Machine, order: int) -> Refit:
    """For a program whose path breaks a geometric limit, is out of reach or meets a singular pose.

    A scale of the way keeps orientations, and one of the angles the way; a move takes the start with it where the
    program states one. Equations are moved where no scale helps.
    """
    search = _ChangeSearch(machine, order, perf_counter() + MAX_SEARCH_TIME)
    begin = default_start(program, machine) if program.start is None else program.start
    start = begin.translation
    scale = search.share(lambda share: scale_program(program, start, share))
    turn = search.share(lambda share: scale_rotations(program, share)) if states_rotation(program) else None
    best: tuple[float, str] | None = None
    # every move of equations is another expression, to be differentiated anew
    costly = scale is not None and any(isinstance(segment, Curve) for segment in program.segments)
    movable = not costly and (program.start is not None or states_destination(program))
    for name, way in MOVE_DIRECTIONS if movable else ():
        found = search.move(partial(_shift_along, program, way), np.inf if best is None else best[0])
        if found is not None:
            best = found, name
    at_home = machine.check(machine.home)
    late = perf_counter() > search.until
    return Refit(scale, turn, best, "" if at_home.ok.all() else at_home.worst(), movable, late)


def _shift_along(program: Program, way: Array, size: float) -> Program:
    return shift_program(program, size * way)


def _round_up_move(size: float) -> float:
    return float(round_up_digits(size * 1e3, 3)) / 1e3


@dataclass(frozen=True, slots=True)
class _ChangeSearch:
    """Sizes of changes with which a program's path fits a machine; after `until` (of perf_counter) none is found."""

    machine: Machine
    order: int
    until: float

    def share(self, made: ProgramChange) -> float | None:
        """The largest share, in tenths of a per cent."""
        found = self._first(TRIAL_SHARES, made)
        if found is None:
            return None
        told = [round(floor(found * 1e3) / 1e3 - n * EXTRA_SHARE, 3) for n in range(MAX_EXTRA_STEPS)]
        told += [share for share in TRIAL_SHARES if share < told[-1]]
        bad, good = self._first_proved([share for share in told if share > 0], made)
        while good is not None and bad is not None and bad - good > 1.5 * SHARE_AGREEMENT:
            middle = floor((bad + good) / 2 * 1e3) / 1e3
            bad, good = (bad, middle) if self._proves(made, middle) else (middle, good)
        return good

    def move(self, made: ProgramChange, below: float) -> float | None:
        """The least move (m) below another, in three digits of mm."""
        found = self._first([size for size in TRIAL_MOVES if size < below], made)
        if found is None:
            return None
        told = [_round_up_move(found * (1 + n * EXTRA_SHARE)) for n in range(MAX_EXTRA_STEPS)]
        told += [size for size in TRIAL_MOVES if size > told[-1]]
        bad, good = self._first_proved([size for size in told if size < below], made)
        while good is not None and bad is not None and good > MOVE_AGREEMENT * bad:
            middle = _round_up_move(sqrt(bad * good))
            bad, good = (bad, middle) if self._proves(made, middle) else (middle, good)
        return good

    def _first_proved(self, sizes: Sequence[float], made: ProgramChange) -> tuple[float | None, float | None]:
        """The last size that does not prove, and the first that does."""
        bad = None
        for size in sizes:
            if self._proves(made, size):
                return bad, size
            bad = size
        return bad, None

    def _first(self, sizes: Sequence[float], made: ProgramChange) -> float | None:
        """The first size that holds, bisected towards the one before it; the first of all is known not to."""
        for before, size in pairwise(sizes):
            if self._fits(made, size):
                bad, good = before, size
                for _ in range(BISECTIONS_OF_REMEDY):
                    middle = (bad + good) / 2
                    bad, good = (bad, middle) if self._fits(made, middle) else (middle, good)
                return good
        return None

    def _fits(self, made: ProgramChange, size: float) -> bool:
        """Whether no geometric limit is broken at the places that are looked at."""
        if perf_counter() > self.until:
            return False
        return self._holds(made, size, _seems_kept)

    def _proves(self, made: ProgramChange, size: float) -> bool:
        """Whether that is proved, in time."""
        return perf_counter() <= self.until and self._holds(made, size, _is_proved_kept)

    def _holds(self, made: ProgramChange, size: float, kept: Callable[[MachinePath, Sequence[Limit]], bool]) -> bool:
        """Whether the path of the changed program can be drawn, and keeps its limits."""
        try:
            path = actuate(made(size), self.machine)
            return kept(path, limits_of(path, self.machine.axes, self.order))
        except MotionError:
            return False


def _seems_kept(path: MachinePath, limits: Sequence[Limit]) -> bool:
    """Whether no geometric limit is broken, and no singular pose passed, at the places that are looked at."""
    if not stays_on_one_side(path):
        return False
    along = unit_speed_trajectory(path)
    part = np.repeat(np.arange(len(along.s)), len(PART_SHARES))
    state = along.within(part, np.tile(PART_SHARES, len(along.s)) * np.diff(along.knots)[part])
    if not np.isfinite(state.q).all():
        return False
    values = [(limit, limit.value(state)) for limit in limits if limit.geometric]
    return all(limit.use(value, value, state.piece).max() <= 1 + LIMIT_ROUNDING for limit, value in values)


def _is_proved_kept(path: MachinePath, limits: Sequence[Limit]) -> bool:
    return not prove_feasibility(path, limits).violations
