"""The activity of a motion in parts: the segments, limits and times of a plan of the whole, in
little memory.
"""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import load_machine
from planner import Blend, Dwell, Line, Program, plan, plan_parts
from planner.active_limits import active_limits, tabulate_segments
from planner.activity import MOST_SEGMENTS, MOST_SLOW, Activity


def line_to(*point, **given):
    return Line(np.array([*point, 0.025]), **given)


def program_of(*segments, **given):
    start = RigidTransform.from_translation([0.0, 0.0, 0.025])
    return Program(segments, start=start, name="walk", **given)


def look(program, machine, **given):
    held = Activity(program)
    for part in plan_parts(program, machine, **given):
        held.add(part.motion, part.start.begin, part.limits)
    return held, part.standing


def columns_of(table):
    return {column.name: column.raw for column in table.columns}


@pytest.fixture(scope="module")
def waved():
    """Dwells at the start, between and beside each other; a last line that is slow."""
    return program_of(
        Dwell(0.2),
        line_to(3e-3, 0.0, line_number=7),
        Dwell(0.1),
        Dwell(0.3),
        line_to(3e-3, 4e-3),
        line_to(0.0, 0.0, speed=1e-3, line_number=12),
    )


def test_the_segments_are_those_of_the_plan_of_the_whole(waved, hexapod):
    held, standing = look(waved, hexapod)
    found, known = (
        columns_of(held.tabulate_longest()),
        columns_of(tabulate_segments(plan(waved, hexapod))),
    )
    assert held.complete
    assert found.keys() == known.keys()
    for name, values in found.items():
        if name in ("length", "time", "mean speed", "for"):
            for one, other in zip(values, known[name], strict=True):
                assert one == other or one == pytest.approx(other, rel=1e-3)
        else:
            assert values == known[name]
    assert sum(found["time"]) == pytest.approx(standing.duration, rel=1e-12)


def test_the_time_of_each_limit_is_that_of_the_whole(waved, hexapod):
    held, standing = look(waved, hexapod)
    told = columns_of(held.tabulate_limits())
    whole = plan(waved, hexapod)
    lengths, active = np.diff(whole.trajectory.knots), active_limits(whole)
    own = {limit.name: float(lengths[active == n].sum()) for n, limit in enumerate(whole.limits)}
    for name, seconds in zip(told["limit"][:-1], told["active"][:-1], strict=True):
        assert seconds == pytest.approx(own[name], abs=2e-3)
    assert sum(told["active"]) == pytest.approx(standing.duration, rel=1e-12)
    slow = told["limit"].index("tool speed")
    assert (told["longest in segment"][slow], told["file line"][slow]) == (6, 12)
    assert told["there"][slow] == pytest.approx(own["tool speed"], abs=2e-3)


def test_a_segment_that_windows_share_is_one(hexapod):
    """Short lines in windows of a few pieces, fitted: the windows are left in the midst of
    segments.
    """
    program = program_of(line_to(4e-3, 0.0), line_to(4e-3, 4e-3), line_to(0.0, 4e-3))
    one, standing = look(program, hexapod)
    held = Activity(program)
    for part in plan_parts(program, hexapod):
        cut = len(part.motion.s) // 2
        for motion, begin in (
            (part.motion.cut(0, cut), part.start.begin),
            (part.motion.cut(cut, len(part.motion.s)), part.start.begin + part.motion.knots[cut]),
        ):
            held.add(motion, float(begin), part.limits)
    assert held.count == one.count == 3
    for name, values in columns_of(held.tabulate_longest()).items():
        for a, b in zip(values, columns_of(one.tabulate_longest())[name], strict=True):
            assert a == b or a == pytest.approx(b, rel=1e-9)
    assert standing.duration == pytest.approx(held.end, rel=1e-12)


def test_repetitions_are_told_apart(hexapod):
    program = program_of(Dwell(0.1), line_to(1e-3, 0.0), line_to(0.0, 0.0), repeat=3)
    held, _ = look(program, hexapod)
    told = columns_of(held.tabulate_longest())
    assert list(zip(told["repetition"], told["segment"], strict=True)) == [
        (r, n) for r in (1, 2, 3) for n in (1, 2, 3)
    ]
    assert told["time"][::3] == pytest.approx([0.1] * 3, abs=1e-9)


def test_blends_count_the_way_that_is_travelled(hexapod):
    program = program_of(
        *(line_to(4e-3 * k, 4e-3 * (k % 2), speed=4e-3, join=Blend(1e-3)) for k in range(1, 5))
    )
    found = columns_of(look(program, hexapod)[0].tabulate_longest())
    known = columns_of(tabulate_segments(plan(program, hexapod)))
    assert found["length"] == pytest.approx(known["length"], rel=1e-3)
    assert max(found["mean speed"]) <= 4e-3 * (1 + 1e-9)


def test_of_many_segments_those_that_tell_most_stay():
    """What is held does not grow; the longest and the slowest are listed, and where each limit is
    active longest.
    """
    rng = np.random.default_rng(5)
    ends = np.cumsum(rng.uniform(1e-4, 3e-4, 90))
    segments = [
        line_to(5e-3 * np.cos(9e2 * s), 5e-3 * np.sin(9e2 * s), speed=rng.uniform(2e-3, 2e-2))
        for s in ends.tolist()
    ]
    program, machine = program_of(*segments), load_machine("cartesian")
    held, standing = Activity(program), None
    sizes = []
    for part in plan_parts(program, machine, order=2, pieces=24):
        held.add(part.motion, part.start.begin, part.limits)
        sizes.append(len(held._rows) - 1)
        standing = part.standing
    assert max(sizes) <= MOST_SEGMENTS + MOST_SLOW + len(held.names)
    assert held.count == 90
    table = held.tabulate_longest()
    found, slow = columns_of(table), columns_of(held.tabulate_slowest())
    known = columns_of(tabulate_segments(plan(program, machine, order=2)))
    longest = sorted(known["time"], reverse=True)
    assert len(table) == MOST_SEGMENTS
    assert found["time"] == pytest.approx(
        longest[:MOST_SEGMENTS], rel=0.02
    )  # parts look ahead less
    assert slow["mean speed"] == pytest.approx(sorted(known["mean speed"])[:MOST_SLOW], rel=0.02)
    (note,) = table.notes
    left = standing.duration - sum(found["time"])
    assert note.startswith(f"the other {90 - MOST_SEGMENTS} take {left:.4f} s together")
