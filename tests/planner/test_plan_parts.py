"""A plan in parts: the motion and the pulses of the whole, which a stop may end after any part."""

import re
import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, load_machine
from planner import Arc, Blend, Dwell, Fit, Line, Program, Trigger, plan, plan_parts
from planner.needs_whole import find_whole_reason
from planner.overview import FINENESS, MOST_WINDOWS, ROW_PERIOD, Overview
from planner.path.chain import walk_path
from planner.plan_parts import come_to_rest
from planner.pulses.schedule import join_schedules
from planner.request import PlanRequest
from planner.trajectory import rows

MIDDLE = RigidTransform.from_translation([0.0, 0.0, 0.025])
"""Of the hexapod's workspace, from home."""


def program_of(*segments, **given):
    return Program(segments, start=MIDDLE, name="walk", **given)


def line_to(*point, **given):
    return Line(np.array([*point, 0.025]), **given)


def draw_walk(count, seed=0, line=4e-4):
    """Short lines of a seeded walk in a plane, fitted as `G64 P0.02` has it."""
    rng, angle, here, segments = np.random.default_rng(seed), 0.0, np.zeros(2), []
    for _ in range(count):
        angle += rng.uniform(-0.6, 0.6)
        here = here + line * np.array([np.cos(angle), np.sin(angle)])
        segments.append(line_to(*here, speed=0.01, join=Fit(2e-5)))
    return program_of(*segments)


@pytest.fixture(scope="module")
def walked(hexapod):
    """A program, its parts, and what is read of it before the first."""
    program, told = draw_walk(60), []
    parts = plan_parts(program, hexapod, pieces=24, progress=lambda *given: told.append(given))
    first, before = next(parts), told.copy()
    return program, [first, *parts], before


def test_parts_are_the_whole_but_for_what_they_look_ahead(walked, hexapod):
    program, parts, _ = walked
    whole = plan(program, hexapod)
    assert len(parts) > 3
    assert parts[-1].standing.duration == pytest.approx(
        whole.trajectory.duration, rel=5e-3
    )  # of 24 pieces each
    assert parts[-1].standing.fit == whole.path.fit
    assert parts[-1].standing.start.length == pytest.approx(float(whole.path.breaks[-1]), rel=1e-12)
    assert parts[-1].standing.segment == 60
    assert parts[-1].standing.certificate.holds


def test_what_is_read_ahead_is_told_before_the_first_part(walked):
    _, _, told = walked
    done = [done for done, _ in told]
    assert done == sorted(done)
    assert 0 < done[0] < done[-1] <= 60
    assert {of for _, of in told} == {60}


def test_the_standing_is_that_of_all_parts(walked):
    _, parts, _ = walked
    standing, schedule = parts[-1].standing, join_schedules([part.pulses for part in parts])
    assert standing.duration == pytest.approx(
        sum(part.motion.duration for part in parts), rel=1e-12
    )
    for axis, (number, net) in zip(schedule.axes, standing.counted, strict=True):
        assert (number, net) == (len(axis), axis.final - axis.start)
    for name, use in standing.certificate.use.items():
        assert len(use) == len(parts)
        assert use.max() == standing.certificate.worst[name]
    axes, other_channels = {f"leg{n}" for n in range(1, 7)}, {"tool", "platform"}
    for name, place in standing.certificate.where.items():
        assert place.axis in axes | other_channels or name in ("tilt", "clearance"), name
        assert (
            0 <= place.t <= standing.duration * (1 + 1e-12)
        )  # a sum is rounded, the duration is not
        assert 0 <= place.s <= standing.start.length


def test_what_there_is_at_any_instant_comes_to_rest(walked):
    _, parts, _ = walked
    for n, part in enumerate(parts[:-1]):
        assert part.rest is not None
        end = part.rest.at(part.rest.duration)
        assert np.abs(end.qd).max() < 1e-9
        every = join_schedules([*(one.pulses for one in parts[: n + 1]), part.rest_pulses])
        counted = come_to_rest(part).counted
        assert [(len(axis), axis.final - axis.start) for axis in every.axes] == list(counted)
        pulse = np.array([axis.pulse for axis in every.axes])
        home = np.array([axis.home for axis in every.axes])
        np.testing.assert_array_less(
            np.abs([axis.final for axis in every.axes] - (end.q[0] - home) / pulse), 0.5 + 1e-6
        )


def test_windows_that_end_at_stops_have_no_way_to_rest(hexapod):
    corners = [[0, 0], [4e-3, 0], [4e-3, 4e-3], [0, 4e-3], [2e-3, 1e-3], [0, 0]]
    program = program_of(*(line_to(*corner) for corner in corners[1:]))
    whole, parts = plan(program, hexapod), list(plan_parts(program, hexapod, pieces=2))
    assert len(parts) == 3
    assert all(part.rest is None for part in parts)
    joined = join_schedules([part.pulses for part in parts])
    assert parts[-1].standing.duration == pytest.approx(whole.trajectory.duration, rel=1e-5)
    assert [axis.final for axis in joined.axes] == [axis.final for axis in whole.pulses.axes]
    for part, other in pairwise(parts):  # what a part holds back, the next gives
        for held, given, stated in zip(
            part.rest_pulses.axes, other.pulses.axes, part.pulses.axes, strict=True
        ):
            assert held.start == given.start == stated.final
            assert (held.ticks >= part.until).all()


def test_a_part_that_cannot_be_is_refused_after_those_that_can(hexapod, limit_search):
    limit_search(0.0)
    program = draw_walk(20)
    far = line_to(5.0, 0.0, speed=0.01)
    parts = []
    with pytest.raises(MotionError, match="segment 21"):
        parts.extend(plan_parts(program_of(*program.segments, far), hexapod, order=2, pieces=8))
    assert parts
    assert parts[-1].rest_pulses is not None


@pytest.mark.parametrize(
    ("program", "machine", "why"),
    [
        (Program([Line(np.ones(3) / 1e3)], duration=3.0), "hexapod", "states a duration"),
        (
            Program([Line(np.ones(3) / 1e3)], start_speed=1e-3),
            "hexapod",
            "begins or ends in motion",
        ),
        (Program([Line(np.ones(3) / 1e3, trigger=Trigger("a"))]), "hexapod", None),
        (
            Program([Line(np.ones(3) / 1e3, speed=0.01, speed_constant=True)]),
            "hexapod",
            "constant speed",
        ),
        (Program([Line(np.ones(3) / 1e3)]), "hexapod", None),
    ],
)
def test_what_needs_the_whole_says_so(program, machine, why):
    machine = load_machine(machine)
    reason = find_whole_reason(PlanRequest(), program, machine)
    assert reason is None if why is None else why in reason
    if why is not None:
        (part,) = plan_parts(program, machine)
        assert_is_whole(part, plan(program, machine))


@pytest.mark.parametrize("rule", ["dda", "sampled"])
def test_rules_that_look_at_the_whole_say_so(hexapod, rule):
    program = draw_walk(4)
    calls = []
    list(
        plan_parts(program, hexapod, rule=rule, progress=lambda done, of: calls.append((done, of)))
    )
    assert calls
    assert calls[-1][0] == calls[-1][1]
    reason = find_whole_reason(PlanRequest(rule=rule), program, hexapod)
    assert re.fullmatch(
        f"rule {rule} needs the whole motion, as it .*: choose rule nearest", reason
    )
    (part,) = plan_parts(program, hexapod, rule=rule)
    assert_is_whole(part, plan(program, hexapod, rule=rule))


@pytest.mark.parametrize(
    ("request_", "why"),
    [
        (PlanRequest(duration=9.0), "a duration is a goal"),
        (PlanRequest(objective="time + 0.2 heat"), "an objective with heat is a goal"),
        (PlanRequest(gap=0.001), "a gap is a goal"),
        (PlanRequest(solver="toppra"), "solver toppra solves the whole motion"),
    ],
)
def test_a_goal_for_the_whole_motion_says_so(hexapod, request_, why):
    assert find_whole_reason(request_, draw_walk(4), hexapod).startswith(why)


@pytest.mark.parametrize("order", [2, 3])
def test_a_window_over_the_whole_path_gives_the_pulses_of_the_whole_plan(hexapod, order):
    program = draw_walk(16)
    (part,) = plan_parts(program, hexapod, order=order, pieces=1000)
    assert_is_whole(part, plan(program, hexapod, order=order))


def assert_is_whole(part, whole):
    assert part.rest is part.rest_pulses is None
    assert part.standing.duration == whole.duration
    assert part.standing.certificate.holds
    for one, other in zip(part.pulses.axes, whole.pulses.axes, strict=True):
        np.testing.assert_array_equal(one.ticks, other.ticks)
        np.testing.assert_array_equal(one.direction, other.direction)


def test_steps_are_the_path(hexapod):
    half = Arc(np.array([1e-3, 1e-3, 0.025]), np.array([0.0, 0, 1]), np.pi)
    program = program_of(line_to(1e-3, 0.0), half)
    steps = list(walk_path(program, hexapod))
    whole = plan(program, hexapod).path
    assert [step.piece.length for step in steps] == [piece.length for piece in whole.pieces]
    assert [step.stop for step in steps] == whole.joins[1:].tolist()


def sample_rows(parts, period):
    """The rows of a motion in parts at even instants."""
    found = []
    for part in parts:
        begin = part.start.begin
        n = np.arange(
            np.ceil(begin / period), np.floor((begin + part.motion.duration) / period) + 1
        )
        found.append(rows(part.motion, np.clip(n * period - begin, 0, part.motion.duration)))
    return np.concatenate(found)


def test_an_overview_has_the_extremes_of_all_rows(walked):
    """Of those that are a period apart, and of nothing but rows."""
    _, parts, _ = walked
    seen = Overview()
    for part in parts:
        seen.add(part.motion, part.start.begin, part.start.length)
    most, every = sample_rows(parts, ROW_PERIOD), sample_rows(parts, ROW_PERIOD / FINENESS)
    assert seen.period <= ROW_PERIOD
    for k in range(2, every.shape[1]):
        assert most[:, k].max() <= seen.high[:, k].max() <= every[:, k].max()
        assert most[:, k].min() >= seen.low[:, k].min() >= every[:, k].min()
    assert (np.diff(seen.t) > 0).all()
    assert len(seen.t) <= MOST_WINDOWS


def test_a_motion_of_a_millisecond_has_windows_of_its_own():
    seen = Overview()
    for part in plan_parts(program_of(line_to(2e-7, 0.0)), load_machine("hexapod"), order=2):
        seen.add(part.motion, part.start.begin, part.start.length)
    assert part.standing.duration < 3e-3
    assert len(seen.t) == np.ceil(part.standing.duration / seen.window)
    assert len(seen.t) >= 3
    assert seen.column("s")[2].max() == pytest.approx(part.standing.start.length, rel=0.2)


def test_a_rest_of_days_is_seen_at_a_glance():
    """What is looked at does not grow with how long a part takes."""
    program = program_of(line_to(1e-3, 0.0), Dwell(3e5), line_to(2e-3, 0.0))
    seen = Overview()
    tracemalloc.start()
    for part in plan_parts(program, load_machine("hexapod"), order=2):
        seen.add(part.motion, part.start.begin, part.start.length)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 3e8
    assert seen.t[-1] > 2.9e5


def test_a_long_whole_plan_is_as_fast_as_its_parts():
    """A grid as coarse as that of short runs made such plans up to 2 % slower than windows of
    them.
    """
    corners = [[20e-3, 0, 0], [10e-3, 17e-3, 3e-3], [0, 0, 0]]
    turned = [[20, 0, 10], [5, 0, -20], [0, 0, 0]]
    lines = [
        Line(corner, rotate=Rotation.from_euler("XYZ", angles, degrees=True), join=Blend(5e-5))
        for corner, angles in zip(corners, turned, strict=True)
    ]
    program = Program([*lines * 13, Line([0, 0, 10e-3])])
    machine = load_machine("five-axis")
    whole = plan(program, machine, order=3).trajectory.duration
    parts = sum(part.motion.duration for part in plan_parts(program, machine, order=3))
    assert whole <= parts * (1 + 2e-4)
