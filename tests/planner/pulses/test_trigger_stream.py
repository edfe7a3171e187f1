"""Triggers of a plan in parts: places as the whole has them, times by the parts' motion, counts by
all its pulses.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError
from planner import Arc, Blend, Dwell, Line, Program, Spline, Trigger, Turn, plan, plan_parts
from planner.path.chain import walk_path
from planner.plan_parts import come_to_rest
from planner.pulses.schedule import join_schedules
from planner.pulses.trigger_stream import mark_steps

TWIST = Rotation.from_euler("XYZ", [0.05, 0.0, 0.0])
ROUND = Blend(2e-4)
SEGMENTS = (
    Line([0.001, 0, 0.03], join=ROUND, trigger=Trigger("begins", 0.0)),
    Line([0.012, 0, 0.03], join=ROUND, trigger=Trigger("third", 1 / 3)),
    Line([0.012, 0.004, 0.03], join=ROUND),
    Line([0.009, 0.006, 0.03], join=ROUND, trigger=Trigger("most", 0.9)),
    Spline(
        [[0.006, 0.004, 0.03], [0.003, 0.006, 0.03], [0.0, 0.004, 0.03]],
        join=ROUND,
        trigger=Trigger("wave", 0.6),
    ),
    Line([0.0, 0.0, 0.03], trigger=Trigger("there")),
    Dwell(0.1),
    Turn(TWIST, trigger=Trigger("half turned", 0.5)),
    Line([0.01, 0, 0.03], Rotation.identity(), trigger=Trigger("off again", 0.0)),
    Arc([0, 0, 0.03], [0, 0, 1], -2.0, trigger=Trigger("arc done")),
    Line([0, 0, 0.03]),
)
ALL = ["begins", "third", "most", "wave", "there", "half turned", "off again", "arc done"]


def program(**given):
    start = RigidTransform.from_components([0, 0, 0.03], Rotation.identity())
    return Program(SEGMENTS, start=start, name="marked", repeat=2, **given)


@pytest.fixture(scope="module")
def whole(hexapod):
    return plan(program(), hexapod, order=2)


@pytest.fixture(scope="module")
def parts(hexapod):
    made = [*plan_parts(program(), hexapod, order=2, pieces=3)]
    assert sum(part.rest is not None for part in made) > 3  # else no trigger would be beside a seam
    return made


def test_names_and_places_are_those_of_the_whole(parts, whole):
    found = [event for part in parts for event in part.triggers]
    assert [event.name for event in found] == 2 * ALL
    for event, other in zip(found, whole.triggers, strict=True):
        assert (event.name, event.where.segment, event.where.repetition) == (
            other.name, other.where.segment, other.where.repetition,
        )  # fmt: skip
        assert event.where.s == pytest.approx(other.where.s, abs=1e-12)
        assert event.pose.translation == pytest.approx(other.pose.translation, abs=1e-9)
        assert (event.pose.rotation.inv() * other.pose.rotation).magnitude() < 1e-7
    assert parts[-1].standing.triggers == len(found)
    assert parts[-1].rest_triggers == ()


def test_in_one_window_they_are_the_whole_to_the_last_bit(hexapod):
    """Without repetitions, between which a window ends."""
    once = replace(program(), repeat=1)
    (part,) = plan_parts(once, hexapod, pieces=200)
    for event, other in zip(part.triggers, plan(once, hexapod).triggers, strict=True):
        assert (event.name, event.time, event.where) == (other.name, other.time, other.where)
        np.testing.assert_array_equal(event.counts, other.counts)
        np.testing.assert_array_equal(event.pose.as_matrix(), other.pose.as_matrix())


def test_times_by_another_root_finder(parts):
    """Brent on s(t) − s along the parts put end to end, to 1e-12 s, where the motion does not
    rest.
    """
    ends = [(part.start.begin, part.start.length, part.motion) for part in parts]

    def s(t):
        begin, length, motion = [each for each in ends if each[0] <= t][-1]
        return length + float(motion.at(t - begin).along[0])

    for event in (event for part in parts for event in part.triggers):
        if event.name in ("third", "most", "wave", "half turned"):
            root = brentq(
                lambda t, at=event.where.s: s(t) - at, 0, parts[-1].standing.duration, xtol=1e-14
            )
            assert event.time == pytest.approx(root, abs=1e-11)
        elif event.time > 0:
            assert s(event.time - 1e-4) < event.where.s == pytest.approx(s(event.time), abs=1e-12)


def test_counts_are_those_of_all_pulses(parts):
    every = join_schedules([part.pulses for part in parts])
    for event in (event for part in parts for event in part.triggers):
        for axis, count in zip(every.axes, event.counts, strict=True):
            fired = axis.ticks <= np.floor(np.nextafter(event.time * every.clock_hz, np.inf))
            assert count == axis.start + axis.direction[fired].sum()


def test_what_there_is_at_any_instant_has_those_up_to_its_rest(parts):
    for n, part in enumerate(parts):
        standing = come_to_rest(part)
        found = [*(event for one in parts[: n + 1] for event in one.triggers), *part.rest_triggers]
        assert standing.triggers == len(found)
        assert [event.name for event in found] == (2 * ALL)[: len(found)]
        # an event at the end of the rest is summed up in another order: one unit in the last place
        assert all(0 <= event.time <= standing.duration * (1 + 1e-15) for event in found)
        pulses = [one.pulses for one in parts[: n + 1]] + [part.rest_pulses] * (
            part.rest_pulses is not None
        )
        every = join_schedules(pulses)
        for event in part.rest_triggers:
            np.testing.assert_array_equal(event.counts, every.counts(event.time)[0])


def test_parts_are_in_the_order_of_time(parts):
    times = [event.time for part in parts for event in part.triggers]
    assert all(one <= other for one, other in pairwise(times))


def test_marked_steps_are_the_steps_and_are_refused_behind_the_same(hexapod):
    far = Program((*SEGMENTS, Arc([5.0, 0, 0], [1, 0, 0], 1.0)), start=program().start)

    def take(steps):
        taken = []
        with pytest.raises(MotionError, match="out of the plane"):
            taken.extend(steps)
        return taken

    plain = take(walk_path(far, hexapod))
    marked = take(mark_steps(walk_path(far, hexapod), far, hexapod))
    assert [step.piece.length for step, _ in marked] == [step.piece.length for step in plain]
    assert len(plain) > len(SEGMENTS) - 3
