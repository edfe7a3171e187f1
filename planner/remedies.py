"""Remedies for a path that does not fit its machine: the largest scale about its start, of its way
or its angles, or the least move along an axis.

All are found by bisection on the geometric limits at many places of the changed program's path,
which is quick. The result is then proved like any path.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import floor, sqrt
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from kinematics.foundation.arrays import Array
from kinematics.foundation.errors import MotionError, attempt
from kinematics.foundation.units import round_up_digits
from kinematics.machine.machine import Machine
from kinematics.machine.pose import Pose
from planner.certificate.conditioning import PART_SHARES, has_one_sign
from planner.certificate.feasibility import prove_feasibility
from planner.certificate.limit_use import LIMIT_ROUNDING
from planner.limits import Limit, limits_of
from planner.path.actuation import MachinePath, actuate
from planner.path.chain import default_start
from planner.program.model import Curve, Program
from planner.program.transform import (
    rescale_program,
    scale_program,
    scale_rotations,
    shift_program,
    states_destination,
    states_rotation,
)
from planner.trajectory import unit_speed_trajectory

# s after which the search ends: a refusal should not take longer than a plan.
MAX_SEARCH_TIME = 10.0
# Shares and moves (m) tried in turn, before bisecting between the first that fits and the one
# before it.
TRIAL_SHARES = (1.0, *np.linspace(0.95, 0.05, 19).tolist())
TRIAL_MOVES = (0.0, *(4e-4 * 2.0 ** np.arange(9)).tolist())
BISECTIONS = 10
# A unit is suspected only where no scale above this share and no move fits.
UNIT_SHARE = 0.1
# Factors between units of length, the likely mistakes first, and what to state if it was one.
UNIT_FACTORS = {
    25.4: ("multiplied by 25.4", 'the program is in inches, state length = "in"'),
    1 / 25.4: ("divided by 25.4", 'it is in mm but read as inches, state length = "mm"'),
    10.0: ("multiplied by 10", 'the program is in cm, state length = "cm"'),
    0.1: ("divided by 10", 'it is in mm but read as cm, state length = "mm"'),
    1e3: ("multiplied by 1000", 'the program is in m, state length = "m"'),
    1e-3: ("divided by 1000", 'it is in mm but read as m, state length = "mm"'),
}
SMALLER_FACTORS = (0.5, 0.2, 2.0, 5.0)
# A size that fits but cannot be proved is increased by this share, at most MAX_EXTRA_STEPS times.
EXTRA_SHARE = 1e-3
MAX_EXTRA_STEPS = 4
# Bisection between a proved and an unproved size ends at this ratio of moves, or difference of
# shares.
MOVE_AGREEMENT = 1.03
SHARE_AGREEMENT = 1.5e-3
MOVE_DIRECTIONS = tuple(
    (sign + name, float(f"{sign}1") * np.eye(3)[k]) for k, name in enumerate("xyz") for sign in "+-"
)

ProgramChange = Callable[[float], Program]
"""Returns the program changed by a size."""


@dataclass(frozen=True, slots=True)
class Remedy:
    """scale: the largest about the start that fits, as a share; turn: the largest scale of its
    angles, from the start's orientation; move: the least (m) and its direction, "+x" to "-z". None:
    nothing fits.

    home: what the machine exceeds at home, as `Margins.worst` puts it: then its file is at fault
    start: what the machine exceeds at the stated start: then no scale about it can help
    unit: what to state if its unit of length is mistaken; empty: another one would not fit
    movable: whether moves were tried; late: whether the search ran out of time
    """

    scale: float | None = None
    turn: float | None = None
    move: tuple[float, str] | None = None
    home: str = ""
    start: str = ""
    unit: str = ""
    movable: bool = True
    late: bool = False

    def __str__(self) -> str:
        if self.unit:
            return self.unit
        ways = []
        if self.scale is not None:
            ways.append(f"scaled to <= {self.scale * 100:.1f} % about its start")
        if self.turn is not None:
            ways.append(f"with its angles scaled to <= {self.turn * 100:.1f} %")
        if self.move is not None:
            ways.append(f"moved by >= {self.move[0] * 1e3:g} mm along {self.move[1]}")
        if ways:
            return f"the path fits the machine {', or '.join(ways)}"
        if self.home:
            wrong = f"the machine already exceeds a limit at home ({self.home})"
            return f"{wrong}: correct its geometry, home, limits or units"
        if self.start:
            return f"the start of the program already exceeds a limit ({self.start}): change start"
        if self.late:
            return f"what scale or move would fit the path to the machine was not found in {MAX_SEARCH_TIME:g} s"
        moves = (
            f" and no move of up to {TRIAL_MOVES[-1] * 1e3:g} mm along an axis"
            if self.movable
            else ""
        )
        return (
            f"no scale about its start down to {TRIAL_SHARES[-1] * 100:g} %{moves} was found to fit the path to the "
            "machine"
        )


def find_remedy(program: Program, machine: Machine, order: int) -> Remedy:
    """Find remedies for a program whose path exceeds a geometric limit, is out of reach or meets a
    singular pose.

    A scale of the way keeps orientations, one of the angles keeps the way. A move takes a stated
    start along. Equations are moved only if no scale fits.
    """
    search = _Search(machine, order, perf_counter() + MAX_SEARCH_TIME)
    start = (
        default_start(program, machine) if program.start is None else program.start
    ).translation
    scale = search.find_share(lambda share: scale_program(program, start, share))
    turn = (
        search.find_share(lambda share: scale_rotations(program, share))
        if states_rotation(program)
        else None
    )
    # every move of equations is a new expression, to be differentiated again
    costly = scale is not None and any(isinstance(segment, Curve) for segment in program.segments)
    movable = not costly and (program.start is not None or states_destination(program))
    move = search.find_shortest_move(program) if movable else None
    misfit = move is None and (scale is None or scale < UNIT_SHARE)
    unit = search.suspect_unit(program) if misfit else ""
    late = perf_counter() > search.until
    home = _describe_excess(machine, machine.home)
    if "travel" in home and machine.lengths:
        home += "; travel counts from the lengths at home"
    first = (
        ""
        if program.start is None
        else _describe_excess(machine, _platform_at(program.start, program, machine))
    )
    return Remedy(scale, turn, move, home, first, unit, movable, late)


def _platform_at(pose: Pose, program: Program, machine: Machine) -> Pose:
    """Return the platform's pose in the base frame at a pose of the program."""
    frame = machine.home if program.frame == "home" else RigidTransform.identity()
    tool = frame * (pose if program.work is None else program.work * pose)
    return tool if program.tool is None else tool * program.tool.inv()


def _describe_excess(machine: Machine, pose: Pose) -> str:
    """Return the limit that the machine exceeds most in a pose; empty if it exceeds none or cannot
    tell.
    """
    margins = attempt(lambda: machine.check(pose))
    if isinstance(margins, MotionError) or margins.ok.all():
        return ""
    return margins.worst()


def _shift_along(program: Program, direction: Array, size: float) -> Program:
    return shift_program(program, size * direction)


def _round_up_move(size: float) -> float:
    """Round a move (m) up to three digits of mm."""
    return float(round_up_digits(size * 1e3, 3)) / 1e3


def _round_down_share(share: float) -> float:
    return floor(share * 1e3) / 1e3


@dataclass(frozen=True, slots=True)
class _Search:
    """Search for sizes of changes with which a program's path fits a machine; it ends at `until`
    (of perf_counter).
    """

    machine: Machine
    order: int
    until: float

    def find_share(self, change: ProgramChange) -> float | None:
        """Return the largest share that fits, in tenths of a per cent."""
        share = self._find_first(TRIAL_SHARES, change)
        if share is None:
            return None
        sizes = [
            round(_round_down_share(share) - n * EXTRA_SHARE, 3) for n in range(MAX_EXTRA_STEPS)
        ]
        sizes += [trial for trial in TRIAL_SHARES if trial < sizes[-1]]

        def halve(bad: float, good: float) -> float | None:
            return _round_down_share((bad + good) / 2) if bad - good > SHARE_AGREEMENT else None

        return self._prove([size for size in sizes if size > 0], change, halve)

    def suspect_unit(self, program: Program) -> str:
        """Return the remedy for the first unit of length in which the program fits; "" for none.

        Where a factor fits that is nearer to 1 than those of units, no unit is suspected.
        """
        change = partial(rescale_program, program)
        if any(self._fits(change, size) for size in SMALLER_FACTORS):
            return ""
        for size, (changed, meant) in UNIT_FACTORS.items():
            if self._fits(change, size, prove=True):
                return f"with every coordinate {changed}, the path fits: if {meant}"
        return ""

    def find_shortest_move(self, program: Program) -> tuple[float, str] | None:
        """Return the least move (m) along an axis that fits, and its direction."""
        best: tuple[float, str] | None = None
        for name, direction in MOVE_DIRECTIONS:
            below = np.inf if best is None else best[0]
            size = self._find_move(partial(_shift_along, program, direction), below)
            if size is not None:
                best = size, name
        return best

    def _find_move(self, change: ProgramChange, below: float) -> float | None:
        """Return the least move (m) in one direction below another, in three digits of mm."""
        move = self._find_first([size for size in TRIAL_MOVES if size < below], change)
        if move is None:
            return None
        sizes = [_round_up_move(move * (1 + n * EXTRA_SHARE)) for n in range(MAX_EXTRA_STEPS)]
        sizes += [trial for trial in TRIAL_MOVES if trial > sizes[-1]]

        def halve(bad: float, good: float) -> float | None:
            return _round_up_move(sqrt(bad * good)) if good > MOVE_AGREEMENT * bad else None

        return self._prove([size for size in sizes if size < below], change, halve)

    def _find_first(self, sizes: Sequence[float], change: ProgramChange) -> float | None:
        """Return the first size that fits, bisected towards the one before it; the first of all
        does not fit.
        """
        for bad, good in pairwise(sizes):
            if self._fits(change, good):
                for _ in range(BISECTIONS):
                    middle = (bad + good) / 2
                    bad, good = (bad, middle) if self._fits(change, middle) else (middle, good)
                return good
        return None

    def _prove(
        self,
        sizes: Sequence[float],
        change: ProgramChange,
        halve: Callable[[float, float], float | None],
    ) -> float | None:
        """Return the first size that is proved, bisected towards the one before it until `halve`
        returns None.
        """
        first = next(
            (k for k, size in enumerate(sizes) if self._fits(change, size, prove=True)),
            None,
        )
        if first is None:
            return None
        good = sizes[first]
        if first == 0:
            return good
        bad = sizes[first - 1]
        while (middle := halve(bad, good)) is not None:
            bad, good = (bad, middle) if self._fits(change, middle, prove=True) else (middle, good)
        return good

    def _fits(self, change: ProgramChange, size: float, *, prove: bool = False) -> bool:
        """Return whether the path of the changed program can be drawn and fits, at sampled places
        or as proved, in time.
        """
        if perf_counter() > self.until:
            return False
        try:
            path = actuate(change(size), self.machine)
            limits = limits_of(path, self.machine.axes, self.order)
            return (
                not prove_feasibility(path, limits).violations
                if prove
                else _fits_at_samples(path, limits)
            )
        except MotionError:
            return False


def _fits_at_samples(path: MachinePath, limits: Sequence[Limit]) -> bool:
    """Return whether no geometric limit is exceeded, and no singular pose passed, at sampled
    places.
    """
    if not has_one_sign(path):
        return False
    along = unit_speed_trajectory(path)
    part = np.repeat(np.arange(len(along.s)), len(PART_SHARES))
    state = along.within(part, np.tile(PART_SHARES, len(along.s)) * np.diff(along.knots)[part])
    if not np.isfinite(state.q).all():
        return False
    values = [(limit, limit.value(state)) for limit in limits if limit.geometric]
    return all(
        limit.use(value, value, state.piece).max() <= 1 + LIMIT_ROUNDING for limit, value in values
    )
