"""Blends and segments from far below a pulse to ordinary ones: always a certified answer, no slower
than stopping.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from benchmarks.evidence.cases.robustness import plan_program
from benchmarks.evidence.random_programs import random_program, stop_everywhere
from kinematics import MotionError, load_machine
from kinematics.foundation.errors import require
from planner import Blend, Line, Program, load_program, plan
from planner.limits import Term, limits_of
from planner.path.actuation import actuate
from planner.timing import (
    Block,
    Problem,
    Run,
    RunSolution,
    Task,
    coarse_jerk_problem,
    jerk_problem,
    lower_rooms,
    solve_jerk_limited,
    solve_once,
    third_order,
)
from planner.timing.initial_guess import pass_breaks, slow_breaks
from planner.timing.order3 import solve as solver_module
from planner.timing.problem import EndCondition
from planner.timing.profile import Profile

START = RigidTransform.from_translation([0.0, 0.0, 0.025])


def corner(tolerance):
    return Program(
        (Line([0.01, 0, 0.025], join=Blend(tolerance)), Line([0.01, 0.01, 0.025])), start=START
    )


@pytest.fixture(scope="module")
def stopping(hexapod):
    return plan(stop_everywhere(corner(1e-6)), hexapod, order=3).trajectory.duration


@pytest.mark.parametrize("tolerance", [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4])
def test_a_corner_with_any_blend_is_as_fast_as_with_a_stop(hexapod, stopping, tolerance):
    """To pass at all costs less the larger the blend is: what a small one gains is lost in the
    grid's 1e-3.
    """
    made = plan(corner(tolerance), hexapod, order=3)
    assert made.certificate.holds
    assert made.trajectory.duration < stopping * (1 + 1e-3)
    assert "averaged" not in made.methods[0]
    # as (d³/d²/J)^⅓ goes: 0.1 mm of blend are worth a share that 1 µm cannot have
    assert (made.trajectory.duration < 0.97 * stopping) == (tolerance == 1e-4)


@pytest.mark.parametrize(("tolerance", "stops"), [(1e-9, True), (1e-8, True), (1e-7, False)])
def test_a_blend_too_small_to_compute_with_is_a_stop_that_is_told(hexapod, tolerance, stops):
    (blend,) = actuate(corner(tolerance), hexapod).blends
    assert bool(blend.stop) == stops
    assert not stops or "too little beside rounding" in blend.stop


@pytest.mark.parametrize("order", [2, 3])
def test_equal_lines_whose_blends_take_half_of_each(hexapod, order):
    """As CAM writes them: 0.4 mm each, and turns that a blend of 0.02 mm would cut farther.

    Rounding leaves no line.
    """
    turns = np.cumsum(np.tile([1.2, -1.2], 6))
    steps = 4e-4 * np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    ends = START.translation + np.cumsum(steps, axis=0)
    lines = [Line(end, join=Blend(2e-5)) for end in ends[:-1]]
    program = Program((*lines, Line(ends[-1])), start=START)
    path = actuate(program, hexapod)
    assert np.diff(path.breaks).min() > 1e-5
    assert path.breaks[-1] == pytest.approx(12 * 4e-4, rel=1e-12)
    made = plan(program, hexapod, order=order)
    assert made.certificate.holds
    assert (
        made.trajectory.duration
        < 0.9 * plan(stop_everywhere(program), hexapod, order=order).trajectory.duration
    )


@pytest.mark.parametrize(
    ("machine", "order", "seed"), [("linkage", 2, 3), ("linkage", 3, 24), ("hexapod", 3, 27)]
)
def test_random_programs_are_answered(machine, order, seed):
    """A small part of the case `robustness` of the evidence, kind programs."""
    fault, methods = plan_program(random_program(seed, machine), load_machine(machine), order)
    assert fault == ""
    assert methods


def test_without_an_answer_for_the_whole_it_rests_where_it_is_slowest(
    hexapod, stopping, monkeypatch
):
    """Solvers that fail on the whole: two legs, about as fast as a stop at the corner; 3 % are for
    the curve to it.
    """
    calls = []

    def short_ones(problem, guess, **options):
        calls.append(problem.intervals)
        if problem.piece[0] == 0 and problem.piece[-1] == 3:
            return RunSolution.refused(MotionError("stopped without an answer"))
        return third_order(problem, guess, **options)

    monkeypatch.setattr(solver_module, "third_order", short_ones)
    made = plan(corner(1e-6), hexapod, order=3)
    assert made.certificate.holds
    assert made.methods[0].endswith("with rests")
    assert made.trajectory.duration < 1.03 * stopping
    middle = np.flatnonzero(made.trajectory.s == made.path.breaks[2])
    assert made.trajectory.v[middle] == pytest.approx(0.0, abs=1e-12)
    assert len(calls) < 20


@pytest.mark.parametrize("held", [0.0, 0.9, 0.9999])
def test_less_room_leaves_room_to_hold_still(held):
    """What an excess is taken off is the part that moves: its share of the room falls, what holds
    still has its own.
    """
    one, pushed = np.full((3, 1), held), np.full((3, 1), 1.0)
    block = Block("force", *[{Term.ONE: one, Term.SDD: pushed}] * 2, np.ones(3), np.zeros(1))
    excess = np.array([1.0, 1.0 + 0.5 * (1 - held), 3.0])
    problem = Problem(np.arange(4.0), np.zeros(3, int), (block,))
    room = lower_rooms(problem, {"force": excess}, 1).blocks[0].room
    assert room[0] == 1.0
    assert (room > held).all()
    # of s̈ = room − held, the excess' share less: 1/(1 + 1.1 · 0.5)
    assert room[1] - held == pytest.approx((1 - held) / 1.55, rel=1e-4)
    assert (np.diff(room) < 0).all()
    assert replace(block, room=room).share(one).max() < room.min()


def test_ramps_past_slow_breaks_meet_there_at_the_speeds_given(hexapod):
    """Each from break to break with s̈ = 0 at both, going on where the one before it ends."""
    path = actuate(corner(1e-6), hexapod)
    coarse = coarse_jerk_problem(
        path, limits_of(path, hexapod.axes, 3), Run(0, len(path.breaks) - 2)
    )
    at = np.searchsorted(coarse.s, path.breaks[[0, 2, 4]])
    motion = pass_breaks(coarse, at, np.array([0.0, 1e-3, 0.0]))
    assert motion is not None
    s, v, a, _ = motion.at(np.arange(len(motion.h)), motion.h)
    assert s == pytest.approx(np.append(motion.s[1:], path.breaks[4]), abs=1e-15)
    assert v == pytest.approx(np.append(motion.v[1:], 0.0), abs=1e-12)
    assert a == pytest.approx(np.append(motion.a[1:], 0.0), abs=1e-9)
    assert v[np.argmin(np.abs(s - path.breaks[2]))] == pytest.approx(1e-3)
    assert pass_breaks(coarse, at, np.array([0.0, 100.0, 0.0])) is None


@pytest.mark.parametrize("first", [1e-4, 1e-3, 2.5e-3, 2.75e-3, 1e-2])
def test_a_start_at_speed_slows_down_by_the_jerk_as_far_as_there_is_way(first):
    """Ramps from v down take up to √(32/27) v √(v/J) = 2.94 mm, that to v/3: in less, slow breaks
    are passed faster.
    """
    jerk, speed = 100.0, 0.09
    sizes = [first, 2e-5, 3e-4, 2e-5, 1e-2]
    piece = np.repeat(np.arange(5), 20)
    s = np.concatenate([[0.0], np.cumsum(np.repeat(sizes, 20) / 20)])
    narrow = np.isin(piece, [1, 3])
    rows = {
        "speed": {Term.SD: np.full(100, 10.0)},
        "acceleration": {Term.SDD: np.full(100, 0.2)},
        "jerk": {Term.SD3: np.where(narrow, 1e6, 0.0), Term.SDDD: np.full(100, 1 / jerk)},
    }
    blocks = []
    for name, terms in rows.items():
        side = {term: values[:, None] for term, values in terms.items()}
        blocks.append(Block(name, side, side, np.ones(100), np.zeros(1)))
    ends = EndCondition(speed=speed), EndCondition()
    problem = Problem(s, piece, tuple(blocks), ends)
    breaks = s[::20]
    steady = Profile(
        s[:-1], np.full(100, speed), np.zeros(100), np.zeros(100), np.diff(s) / speed, piece
    )
    slow, speeds = slow_breaks(problem, steady, breaks)
    assert list(slow) == [1, 2, 3, 4]
    assert pass_breaks(problem, np.array([0, 20, 40, 60, 80, 100]), speeds) is not None
    way = np.diff(breaks)
    ramps = (speeds[1:] + speeds[:-1]) * np.sqrt(np.abs(np.diff(speeds)) / jerk)
    assert (ramps <= way * (1 + 1e-9)).all()
    reaches = first > np.sqrt(32 / 27) * speed * np.sqrt(speed / jerk)
    assert (speeds[1] < speed / 3) == reaches
    if not reaches:  # it slows down as fast as it can
        assert ramps[0] == pytest.approx(way[0])


def test_intervals_lie_where_they_gain_time(hexapod):
    """The circle is faster on a grid that follows what a rough answer loses than on as many graded
    for the start.
    """
    path = actuate(load_program("bare-circle"), hexapod)
    limits = limits_of(path, hexapod.axes, 3)
    graded, start = require(jerk_problem(path, limits, Run(0, 0)))
    placed = solve_once(Task(path, limits, Run(0, 0), 3))
    assert len(placed.profile.h) <= graded.intervals + 2
    assert placed.duration < solve_jerk_limited(graded, start.on(graded.s)).duration * (1 - 2e-5)
