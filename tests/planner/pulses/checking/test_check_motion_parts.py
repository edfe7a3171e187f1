"""Motion part by part beside pulses part by part: the verdict of the whole, in memory for a few
parts.
"""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from kinematics.machine.axis import StepTiming
from planner.pulses import PulseStream, check, find_rule, generate
from planner.pulses.checking import check_motion_parts
from planner.pulses.schedule import join_schedules
from tests.planner.motions import PULSE, example, smooth_motions
from tests.planner.pulses.generation.test_stream import CLOCK, attempt, cut_motion

TIMING = StepTiming(1e-6, 1e-6, 20e-6, 5e-6)
AXES = [Axis("a", pulse=PULSE, timing=TIMING), Axis("b", pulse=PULSE)]
SHARES = st.lists(st.integers(1, 10**4).map(lambda n: n * 1e-4), max_size=6)
RULES = ["nearest", "nearest:hysteresis=0.2", "floor", "timer"]


@settings(max_examples=20)
@given(smooth_motions(), SHARES, SHARES, st.sampled_from(RULES))
def test_parts_are_found_right_wherever_motion_and_pulses_are_cut(motion, cuts, others, rule):
    stream = PulseStream(SimpleNamespace(axes=AXES, home_q=np.zeros(2)), CLOCK, find_rule(rule))
    made = cut_motion(motion, [share * motion.duration for share in cuts])
    pulses = attempt(lambda: [stream.add(part, last=last) for part, last in made])
    if isinstance(pulses, MotionError):
        return
    stated = replace(join_schedules(pulses))
    seen = [part for part, _ in cut_motion(motion, [share * motion.duration for share in others])]
    found = check_motion_parts(stated, pulses, seen, AXES, np.zeros(2))
    assert found.holds == check(stated, motion, AXES, np.zeros(2)).holds
    assert found.holds, found


@pytest.mark.parametrize(
    "fault", ["late", "missing", "turned", "motion short", "pulses of another"]
)
@pytest.mark.parametrize("near", ["a seam", "the middle of a part"])
def test_a_fault_is_found_as_in_the_whole(fault, near):
    motion, axes = example(4), [Axis(f"leg{k}", pulse=PULSE) for k in range(3)]
    home = motion.at(np.zeros(1)).q[0]
    schedule = generate(motion, axes, home)
    parts = [part for part, _ in cut_motion(motion, np.linspace(0, motion.duration, 8)[1:-1])]
    assert check_motion_parts(schedule, split(schedule, 5), parts, axes, home).holds
    axis = schedule.axes[1]
    at = motion.duration / 7 * (3 if near == "a seam" else 3.5) * CLOCK
    n = int(np.searchsorted(axis.ticks, at))
    changed = {
        "late": lambda: replace(axis, ticks=axis.ticks + 2 * (np.arange(len(axis)) == n)),
        "missing": lambda: replace(
            axis, ticks=np.delete(axis.ticks, n), direction=np.delete(axis.direction, n)
        ),
        "turned": lambda: replace(
            axis, direction=axis.direction * np.where(np.arange(len(axis)) == n, -1, 1)
        ),
        "pulses of another": lambda: replace(
            axis, ticks=schedule.axes[0].ticks, direction=schedule.axes[0].direction
        ),
    }
    if fault == "motion short":
        del parts[3 if near == "a seam" else -1]
    else:
        axes_of = list(schedule.axes)
        axes_of[1] = changed[fault]()
        schedule = replace(schedule, axes=tuple(axes_of))
    assert not check_motion_parts(schedule, split(schedule, 5), parts, axes, home).holds


def split(schedule, count):
    """The pulses in parts of equal time."""
    ends = np.linspace(0, schedule.duration * CLOCK, count + 1)[1:-1].astype(int)
    for lo, hi in pairwise([0, *ends, 1 << 62]):
        axes = []
        for axis in schedule.axes:
            inside = (axis.ticks >= lo) & (axis.ticks < hi)
            axes.append(replace(axis, ticks=axis.ticks[inside], direction=axis.direction[inside]))
        yield replace(schedule, axes=tuple(axes))


def test_only_a_few_parts_of_the_motion_are_held():
    """A long rest has no pulses to go by, and is let go of all the same."""
    import weakref

    motion, axes = example(5), [Axis(f"leg{k}", pulse=PULSE) for k in range(3)]
    home = motion.at(np.zeros(1)).q[0]
    schedule = generate(motion, axes, home)
    alive: weakref.WeakSet = weakref.WeakSet()
    most = 0

    class Held:
        def __init__(self, motion):
            self.motion, self.knots, self.duration = motion, motion.knots, motion.duration

        def at(self, t):
            return self.motion.at(t)

    def come():
        nonlocal most
        for part, _ in cut_motion(motion, np.linspace(0, motion.duration, 25)[1:-1]):
            held = Held(part)
            alive.add(held)
            most = max(most, len(alive))
            yield held
            del held

    assert check_motion_parts(schedule, split(schedule, 50), come(), axes, home).holds
    assert most <= 8


def test_pulses_listed_over_the_whole_are_not_checked_in_parts():
    motion, axes = example(5), [Axis(f"leg{k}", pulse=PULSE) for k in range(3)]
    home = motion.at(np.zeros(1)).q[0]
    schedule = generate(motion, axes, home, rule="dda:spacing=2 ms,pulses_per_count=2")
    parts = [part for part, _ in cut_motion(motion, [motion.duration / 2])]
    with pytest.raises(MotionError, match="part by part"):
        check_motion_parts(schedule, [schedule], parts, axes, home)
    made_up = [replace(axis, backlash=1e-6, compensate=("backlash",)) for axis in axes]
    with pytest.raises(MotionError, match="check the whole"):
        check_motion_parts(schedule, [schedule], parts, made_up, home)
    with pytest.raises(MotionError, match="without parts"):
        check_motion_parts(schedule, [schedule], [], axes, home)
