"""Pulses part by part: joined they are those of the whole, wherever the motion is cut."""

import json
from dataclasses import replace
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from kinematics.machine.axis import StepTiming
from planner.pulses import PulseStream, find_rule, generate
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan
from planner.pulses.schedule import join_schedules
from tests.planner.motions import PULSE, smooth_motions

CLOCK = 10_000_000
AXES = [Axis("a", pulse=PULSE, max_speed=0.5), Axis("b", pulse=PULSE)]
RULES = ["nearest", "nearest:hysteresis=0.2", "floor", "timer"]
PARTS = st.integers(0, 10**6).map(lambda n: n * 1e-6)  # shares of the time: many parts are shorter than a tick


def cut_motion(motion, cuts):
    """The motion in parts that end at these times (s), and which is the last."""
    ends = np.unique([0.0, *cuts, motion.duration])
    return [(JoinedMotion.of(MotionSpan(motion, a, b)), b == ends[-1]) for a, b in pairwise(ends)]


def attempt(call):
    try:
        return call()
    except MotionError as no:
        return no


@st.composite
def cut_motions(draw):
    motion = draw(smooth_motions())
    cuts = st.one_of(st.sampled_from(motion.knots.tolist()), PARTS.map(lambda share: share * motion.duration))
    return motion, draw(st.lists(cuts, max_size=6))


@settings(max_examples=60, deadline=None)
@given(cut_motions(), st.sampled_from(RULES))
def test_parts_joined_are_the_pulses_of_the_whole(given_motion, rule):
    motion, cuts = given_motion
    axes = AXES
    whole = attempt(lambda: generate(motion, axes, np.zeros(2), CLOCK, rule))
    stream = PulseStream(SimpleNamespace(axes=axes, home_q=np.zeros(2)), CLOCK, find_rule(rule))
    joined = attempt(lambda: join_schedules(stream.add(part, last=last) for part, last in cut_motion(motion, cuts)))
    assert type(joined) is type(whole)
    if isinstance(whole, MotionError):
        return
    for one, other in zip(joined.axes, whole.axes, strict=True):
        assert (one.start, one.bound) == (other.start, pytest.approx(other.bound, rel=1e-9))
        assert np.array_equal(one.ticks, other.ticks)
        assert np.array_equal(one.direction, other.direction)
    assert joined.duration == pytest.approx(whole.duration, rel=1e-15)


@settings(max_examples=30, deadline=None)
@given(cut_motions(), st.sampled_from(RULES), st.integers(0, 6), st.booleans())
def test_what_is_resumed_goes_on_to_the_same_pulses(given_motion, rule, many, driven):
    """Behind any part, through a file of JSON; a drive that needs time leaves more pulses held."""
    motion, cuts = given_motion
    axes = AXES if not driven else [replace(axis, timing=StepTiming(1e-6, 1e-6, 20e-6, 5e-6)) for axis in AXES]
    machine, parts = SimpleNamespace(axes=axes, home_q=np.zeros(2)), cut_motion(motion, cuts)
    stream, resumed = (PulseStream(machine, CLOCK, find_rule(rule)) for _ in range(2))
    for n, (part, last) in enumerate(parts):
        one = attempt(partial(stream.add, part, last))
        if n == many:
            resumed = PulseStream.resume(machine, CLOCK, find_rule(rule), json.loads(json.dumps(resumed.mark())))
        other = attempt(partial(resumed.add, part, last))
        if isinstance(one, MotionError):
            assert str(one) == str(other)
            return
        assert is_same(one, other)
        assert json.dumps(stream.mark()) == json.dumps(resumed.mark())


def is_same(one, other):
    same = all(
        np.array_equal(a.ticks, b.ticks)
        and np.array_equal(a.direction, b.direction)
        and (a.start, a.bound) == (b.start, b.bound)
        for a, b in zip(one.axes, other.axes, strict=True)
    )
    return same and (one.duration, one.moves) == (other.duration, other.moves)
