"""Orientation where a program leaves it free: chosen for time, for small tilts, or to make a path
feasible at all.

What is chosen (planner.orientation.nlp) is an estimate at order 2. For time, both that and the
program as it says, or else what is merely feasible, are really planned, and the faster is kept:
stretch by stretch, where the motion rests between.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import Any, get_args

import numpy as np

from kinematics.foundation.arrays import Array, freeze_array
from kinematics.foundation.errors import MotionError
from kinematics.foundation.options import check_arguments
from kinematics.machine.machine import Machine
from kinematics.machine.machine_file import MachineSource, load_machine
from planner.limits import limits_of, usual_order
from planner.orientation.nlp import FreePart, Objective, PartEnd, solve_controls
from planner.path.actuation import MachinePath, actuate
from planner.path.chain import chain_pieces, draw_segments
from planner.path.shape import DEGREE, Piece, carry_tool
from planner.program.model import Dwell, Program, SegmentStream
from planner.program.modifiers import Free
from planner.program.program_file import ProgramSource, load_program
from planner.trajectory import Trajectory

Choice = Mapping[int, Array]
"""Controls (3, DEGREE + 1) of free segments, by their index."""


@check_arguments()
def orient(
    program: ProgramSource,
    machine: MachineSource,
    objective: Objective = "time",
    order: int | None = None,
) -> Program:
    """Choose the orientation of a program's free segments.

    Neighbouring free segments are chosen together; they begin, and unless they end the program also
    end, in the orientation that it says.

    Parameters
    ----------
    program, machine
        As they are, by name, or by the path of a file.
    objective
        "time": as fast as the machine's limits on speed and acceleration allow, and never slower
        than as the program
        says, where that is feasible. "tilt": the largest tilt of any joint as small as can be.
        "feasible": as far
        inside travel and tilt as can be.
    order
        Of the plans that are compared. None: as `plan` has it.

    Returns
    -------
    Program
        The program with its orientations chosen; itself where none is free.

    Raises
    ------
    MotionError
        The machine does not control what is left free.
    """
    program, machine = load_program(program), load_machine(machine)
    if objective not in get_args(Objective):
        raise MotionError(
            f'no objective "{objective}"; objectives: {", ".join(get_args(Objective))}'
        )
    free = {
        k: each
        for k, segment in enumerate(program.segments)
        if (each := _segment_freedom(segment)) is not None
    }
    for k, each in free.items():
        _refuse(each, k + 1, machine)
    if not free:
        return program
    order = usual_order(machine.axes, program) if order is None else order
    held = {k: np.zeros((3, DEGREE + 1)) for k in free}
    moving = _find_moving_ends(apply_choice(program, held), machine, order)
    known, motion = (
        held,
        _solve_motion(apply_choice(program, held), machine, order) if objective == "time" else None,
    )
    if motion is None:  # nothing to be kept: begin with what is feasible, if anything is
        known = _solve_groups(program, machine, "feasible", moving, {}, held)
        motion = (
            _solve_motion(apply_choice(program, known), machine, order)
            if objective == "time"
            else None
        )
    if objective == "feasible":
        return apply_choice(program, known)
    speeds = {} if motion is None else _end_speeds(motion)
    chosen = _solve_groups(program, machine, objective, moving, speeds, known)
    if motion is not None:
        made = _solve_motion(apply_choice(program, chosen), machine, order)
        chosen = (
            known
            if made is None
            else _choose_faster(program, moving, (known, motion), (chosen, made))
        )
    return apply_choice(program, chosen)


def orient_open(program: Program, machine: Machine, order: int) -> Program:
    """The program with whatever is still open chosen for time."""
    if isinstance(program.segments, SegmentStream):
        return program
    still = any(
        free is not None and free.controls is None
        for free in map(_segment_freedom, program.segments)
    )
    return orient(program, machine, order=order) if still else program


def apply_choice(program: Program, choice: Choice) -> Program:
    """The program with the orientation of free segments chosen so."""
    segments: list[Any] = list(program.segments)
    for k, controls in choice.items():
        segments[k] = replace(
            segments[k], free=replace(segments[k].free, controls=freeze_array(controls))
        )
    return replace(program, segments=tuple(segments))


def find_choice(program: Program) -> Choice:
    """What was chosen for the free segments of a program."""
    if isinstance(program.segments, SegmentStream):
        return {}
    free = {k: _segment_freedom(segment) for k, segment in enumerate(program.segments)}
    return {
        k: each.controls
        for k, each in free.items()
        if each is not None and each.controls is not None
    }


def _segment_freedom(segment: Any) -> Free | None:
    return None if isinstance(segment, Dwell) else getattr(segment, "free", None)


def _refuse(free: Free, number: int, machine: Machine) -> None:
    wanted = (["rz"] if free.yaw else []) + (["rx", "ry"] if free.tilt > 0 else [])
    missing = [name for name in wanted if name not in machine.freedom]
    if missing:
        raise MotionError(
            f"segment {number} leaves free what machine {machine.name} does not control: {', '.join(missing)}; "
            f"it controls {', '.join(machine.freedom)}: leave free out"
        ).in_segment(number)


def _find_moving_ends(program: Program, machine: Machine, order: int) -> frozenset[int]:
    """The segments at whose end the motion need not rest, be it before the next one or the next
    repetition.
    """
    drawn = chain_pieces(replace(program, repeat=min(program.repeat, 2)), machine)
    rests = (drawn.stops[1:-1] > 0) & (drawn.stops[1:-1] <= order)
    return frozenset(
        a.segment - 1
        for a, b, rest in zip(drawn.pieces[:-1], drawn.pieces[1:], rests, strict=True)
        if _place(a) != _place(b) and not rest
    )


def _place(piece: Piece) -> tuple[int, int | None]:
    return piece.segment, piece.repetition


def _solve_motion(program: Program, machine: Machine, order: int) -> Trajectory | None:
    """Return the fastest motion. None: the program cannot be planned."""
    # The solvers load only for programs with open orientations: `pulsepath check` does without.
    from planner.timing.certified_solve import certified_solve

    try:
        path = actuate(program, machine)
        return certified_solve(path, limits_of(path, machine.axes, order), order).trajectory
    except MotionError:
        return None


def _pieces(motion: Trajectory) -> tuple[Piece, ...]:
    assert isinstance(motion.path, MachinePath)  # programs have no others
    return motion.path.pieces


def _end_speeds(motion: Trajectory) -> dict[int, float]:
    """ṡ at the end of every segment, the least of all repetitions; at −1 what it begins with."""
    pieces, found = _pieces(motion), {-1: float(motion.v[0])}
    for k in np.flatnonzero(np.diff(motion.piece)).tolist():
        before, after = pieces[motion.piece[k]], pieces[motion.piece[k + 1]]
        if _place(before) != _place(after):
            speed = float(motion.v[k + 1])
            found[before.segment - 1] = min(speed, found.get(before.segment - 1, speed))
    found[pieces[-1].segment - 1] = found.get(pieces[-1].segment - 1, motion.path.end_speeds[1])
    return found


def _solve_groups(
    program: Program,
    machine: Machine,
    objective: Objective,
    moving: frozenset[int],
    speeds: Mapping[int, float],
    start: Choice,
) -> dict[int, Array]:
    """Neighbouring free segments, each such group by itself."""
    once = (
        part.pieces
        for part in draw_segments(replace(apply_choice(program, start), repeat=1), machine)
    )
    drawn = {
        pieces[0].segment - 1: [_carry_piece(piece, program) for piece in pieces]
        for pieces in once
        if pieces
    }
    found: dict[int, Array] = {}
    for group in _group_neighbours(list(drawn), start):
        parts = [FreePart.from_pieces(drawn[k], _chosen_freedom(program, k)) for k in group]
        before = max((k for k in drawn if k < group[0]), default=-1)
        joints = [PartEnd(speeds.get(k, 0.0), k in moving) for k in (before, *group)]
        joints[0] = replace(joints[0], given=True)
        joints[-1] = replace(joints[-1], given=group[-1] != max(drawn) or program.repeat > 1)
        controls = solve_controls(
            machine, parts, joints, objective, np.array([start[k] for k in group])
        )
        found |= dict(zip(group, controls, strict=True))
    return found


def _group_neighbours(segments: Sequence[int], free: Choice) -> list[list[int]]:
    return [
        list(members) for is_free, members in groupby(segments, key=lambda k: k in free) if is_free
    ]


def _chosen_freedom(program: Program, k: int) -> Free:
    free = _segment_freedom(program.segments[k])
    assert free is not None  # it was chosen from those
    return free


def _carry_piece(piece: Piece, program: Program) -> Piece:
    return piece if program.tool is None else carry_tool(piece, program.tool)


def _choose_faster(
    program: Program,
    moving: frozenset[int],
    known: tuple[Choice, Trajectory],
    other: tuple[Choice, Trajectory],
) -> dict[int, Array]:
    """The better of two choices, for each stretch between rests in the orientation that the program
    says.
    """
    segments = [k for k, segment in enumerate(program.segments) if not isinstance(segment, Dwell)]
    before, after = (_durations(motion) for _, motion in (known, other))
    inside = {k for group in _group_neighbours(segments, known[0]) for k in group[:-1]}
    stretches: list[list[int]] = [[]]
    for k in segments:
        stretches[-1].append(k)
        if k not in moving and k not in inside:
            stretches.append([])
    if stretches[-1]:  # without a rest into the next repetition
        last = stretches.pop()
        stretches = [[*last, *stretches[0]], *stretches[1:]] if stretches else [last]
    found: dict[int, Array] = {}
    for stretch in stretches:
        better = (
            other if sum(after[k] for k in stretch) < sum(before[k] for k in stretch) else known
        )
        found |= {k: better[0][k] for k in stretch if k in known[0]}
    return found


def _durations(motion: Trajectory) -> dict[int, float]:
    """s that every segment takes, with all its repetitions."""
    segment = np.array([piece.segment - 1 for piece in _pieces(motion)])[motion.piece]
    spent = np.bincount(segment, np.diff(motion.knots))
    return dict(enumerate(spent.tolist()))
