"""Pulses part by part: joined they are those of the whole, wherever the motion is cut."""

from fractions import Fraction
from functools import partial
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from kinematics.machine.axis import StepTiming
from planner import Infeasible
from planner.limits import limits_of
from planner.path.actuation import actuate
from planner.pulses import PulseStream, check, find_rule, generate
from planner.pulses.checking import check_motion_parts
from planner.pulses.compensation.compensate import counted_motion
from planner.pulses.generation.motion_parts import JoinedMotion, MotionSpan, PieceMotion
from planner.pulses.schedule import join_schedules
from planner.windows import WindowPlanner
from tests.planner.motions import PULSE, example, in_pulses, smooth_motions
from tests.planner.test_windows import draw_polyline, steps_of

CLOCK = 10_000_000
AXES = [Axis("a", pulse=PULSE, max_speed=0.5), Axis("b", pulse=PULSE)]
RULES = ["nearest", "nearest:hysteresis=0.2", "floor", "timer"]
PARTS = st.integers(0, 10**6).map(
    lambda n: n * 1e-6
)  # shares of the time: many parts are shorter than a tick


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
    cuts = st.one_of(
        st.sampled_from(motion.knots.tolist()), PARTS.map(lambda share: share * motion.duration)
    )
    return motion, draw(st.lists(cuts, max_size=6))


def has_ties(motion, axis):
    """Return whether an axis ends, rests or turns on a level.

    Levels are whole and half pulses, and those with hysteresis: all are multiples of 0.1 pulses.
    """
    turns = motion.curves[1].roots(extrapolate=False)[axis]
    times = np.concatenate([motion.knots[1:], turns[np.isfinite(turns)]])
    state = motion.at(times)
    tenths = 10 * state.q[:, axis] / PULSE
    on_level = np.abs(tenths - np.round(tenths)) < 1e-6
    stands = (times == motion.duration) | (np.abs(state.qd[:, axis]) < 1e-9)
    return bool((on_level & stands).any())


def largest_error(motion, axis, pulses):
    """Return the largest distance (pulses) of count and motion just before and after each pulse.

    Less the travel in one tick of the clock, by which the bound of a count may be exceeded.
    """
    if len(pulses.ticks) == 0:
        return 0.0
    after = pulses.start + np.cumsum(pulses.direction.astype(int))
    before = after - pulses.direction
    state = motion.at(pulses.ticks / CLOCK)
    place = state.q[:, axis] / PULSE
    travel = np.abs(state.qd[:, axis]) / PULSE / CLOCK
    return float((np.maximum(np.abs(before - place), np.abs(after - place)) - travel).max())


@settings(max_examples=60, deadline=None)
@given(cut_motions(), st.sampled_from(RULES))
def test_parts_joined_are_the_pulses_of_the_whole(given_motion, rule):
    """Where a motion ends or turns on a level exactly, rounding decides on a pulse: a tie."""
    motion, cuts = given_motion
    whole = attempt(lambda: generate(motion, AXES, np.zeros(2), CLOCK, rule))
    stream = PulseStream(SimpleNamespace(axes=AXES, home_q=np.zeros(2)), CLOCK, find_rule(rule))

    def join():
        parts = cut_motion(motion, cuts)
        return join_schedules(stream.add(part, last=last) for part, last in parts)

    joined = attempt(join)
    assert type(joined) is type(whole)
    if isinstance(whole, MotionError):
        return
    for axis, (one, other) in enumerate(zip(joined.axes, whole.axes, strict=True)):
        assert one.start == other.start
        # bounds come from fits of the pieces, so those of parts and of the whole differ
        assert largest_error(motion, axis, one) <= one.bound + 1e-9
        assert largest_error(motion, axis, other) <= other.bound + 1e-9
        if has_ties(motion, axis):
            continue
        assert np.array_equal(one.ticks, other.ticks)
        assert np.array_equal(one.direction, other.direction)
    assert abs(joined.duration - whole.duration) <= 1e-15 * (1 + len(cuts))


def test_what_parts_cannot_do_is_refused_with_what_can():
    motion = in_pulses([6.0, 0.0], [6.0, 6.0])[0]
    ((first, _), (second, last)) = cut_motion(motion, [1.0])

    def begin(rule, **more):
        machine = SimpleNamespace(axes=[Axis("x", pulse=PULSE, **more)], home_q=np.zeros(1))
        return PulseStream(machine, CLOCK, find_rule(rule))

    for rule in ("sampled", "dda"):
        with pytest.raises(
            MotionError,
            match=rf"rule {rule} makes no pulses of a motion part by part: .*use nearest",
        ):
            begin(rule).add(first)
    stream = begin("nearest")
    stream.add(first)
    with pytest.raises(MotionError, match="begins -6 pulses from its count 6"):
        stream.add(first)
    assert (
        stream.add(second, last=bool(last)).axes[0].final == 12
    )  # the refusal left it where it stood
    with pytest.raises(MotionError, match="the motion has ended"):
        stream.add(second)


def test_a_refusal_names_the_place_on_the_whole():
    """A reversal that the drive has no time for, behind the seam: t and path length (here also t)
    are the whole's.
    """
    motion = in_pulses([0.0, 6.0, 0.25], [-6.0, 6.0, 6.25], [0.0, -6.0, 6.25])[0]
    axes = [Axis("x", pulse=PULSE, timing=StepTiming(1e-6, 1e-6, 0.0, 1.9))]
    with pytest.raises(Infeasible) as whole:
        generate(motion, axes, np.zeros(1), CLOCK)
    stream = PulseStream(
        SimpleNamespace(axes=axes, home_q=np.zeros(1)), CLOCK, find_rule("nearest")
    )
    with pytest.raises(Infeasible) as parted:
        join_schedules(stream.add(part, last) for part, last in cut_motion(motion, [1.0, 2.0, 2.5]))
    assert str(parted.value) == str(whole.value)


def test_windows_of_a_path_are_proved_part_by_part(hexapod):
    """As a program is planned: the parts' paths are their own; pulses and the check know nothing
    but the parts.
    """
    path = actuate(draw_polyline(40), hexapod)
    planner = WindowPlanner(hexapod, lambda part: limits_of(part, hexapod.axes, 2), 2, pieces=16)
    windows = list(planner(steps_of(path)))
    motions = [window.solution.trajectory.cut(0, window.kept) for window in windows]
    stream = PulseStream(hexapod, CLOCK, find_rule("nearest"))
    pulses = [stream.add(motion, last=motion is motions[-1]) for motion in motions]
    joined = join_schedules(pulses)
    assert len(motions) > 2
    assert joined.total > 1000
    assert joined.duration == pytest.approx(sum(window.duration for window in windows), rel=1e-14)
    assert all((np.diff(axis.ticks) > 0).all() for axis in joined.axes)
    assert check_motion_parts(joined, pulses, motions, hexapod.axes, hexapod.home_q).holds


TABLE = ((-1e-3, 2e-6), (0.0, 0.0), (3e-4, -4e-6), (1e-3, 1e-6))
KINDS = [
    {"backlash": 8e-6, "compensate": ("backlash",), "pushed": "-"},
    {"lead_error": TABLE, "compensate": ("lead",)},
    {"backlash": 4e-6, "lead_error": TABLE, "compensate": ("lead", "backlash")},
]


@settings(max_examples=12)
@given(st.integers(0, 200), st.lists(PARTS, max_size=8), st.sampled_from(RULES))
def test_what_motors_make_up_for_is_the_same_in_parts(seed, cuts, rule):
    """Three axes with play, with a screw's errors and with both; turns, rests and crossings of play
    span the seams.
    """
    motion = example(seed, size=3.0)
    home = motion.at(np.zeros(1)).q[0]
    axes = [
        Axis(f"leg{k}", pulse=PULSE, max_acceleration=20.0, **kinds)
        for k, kinds in enumerate(KINDS)
    ]
    machine = SimpleNamespace(axes=axes, home_q=home)
    whole = attempt(lambda: generate(motion, axes, home, CLOCK, rule))
    stream, parts = PulseStream(machine, CLOCK, find_rule(rule)), []
    for part, last in cut_motion(motion, [share * motion.duration for share in cuts]):
        made = attempt(partial(stream.add, part, last))
        if isinstance(made, MotionError):
            assert isinstance(whole, MotionError), made
            return
        parts.append(made)
    joined = join_schedules(parts)
    for one, other in zip(joined.axes, whole.axes, strict=True):
        assert one.start == other.start
        assert np.array_equal(one.direction, other.direction)
        assert np.array_equal(one.ticks, other.ticks)
    for one, other in zip(joined.compensations, whole.compensations, strict=True):
        assert (one.kinds, one.crossings) == (other.kinds, other.crossings)
        assert np.array(one.windows) == pytest.approx(np.array(other.windows), abs=1e-9)
        assert one.off == pytest.approx(other.off, rel=1e-6, abs=1e-12)
    assert check(joined, counted_motion(motion, axes, home), axes, home).holds


def test_ten_hours_before_change_no_tick():
    """A hundred rests of 360.1 s, which no binary number is: their sum is exact, and a tick is that
    at the start.
    """
    motion = example(7)
    home = motion.at(np.zeros(1)).q[0]
    machine = SimpleNamespace(axes=[Axis(f"leg{k}", pulse=PULSE) for k in range(3)], home_q=home)
    hours = round(100 * Fraction(360.1) * CLOCK)
    assert hours > 36_000 * CLOCK
    constant = np.zeros((3, 6, 1))
    constant[:, 0, 0] = home
    rest = JoinedMotion.of(MotionSpan(PieceMotion([0.0, 360.1], constant, [0.0, 0.0]), 0.0, 360.1))
    streams = [PulseStream(machine, CLOCK, find_rule("nearest")) for _ in range(2)]
    for _ in range(100):
        assert streams[1].add(rest).total == 0
    soon, late = (
        [stream.add(part, last) for part, last in cut_motion(motion, [0.05])] for stream in streams
    )
    for one, other in zip(soon, late, strict=True):
        assert one.total
        for early, after in zip(one.axes, other.axes, strict=True):
            assert np.array_equal(early.ticks + hours, after.ticks)
    assert late[1].duration == pytest.approx(36_010 + soon[1].duration, rel=1e-15)
