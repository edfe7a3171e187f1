"""Pulse schedules against closed-form crossing times, and the half-pulse bound on random
motions.
"""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from kinematics import Axis, MotionError
from planner import Infeasible, PulseSchedule
from planner.pulses import AxisPulses, check, generate
from planner.pulses.generation import levels
from tests.planner.motions import PULSE, Polynomials, smooth_motions

CLOCK = 10_000_000
ROUNDING = 1e-14  # m: double precision of positions below 1 m, with room for a few operations


@dataclass
class Sines:
    """q = offset + amplitude sin(frequency t + phase) on every axis."""

    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray
    offset: np.ndarray
    knots: np.ndarray

    @property
    def duration(self):
        return float(self.knots[-1])

    def at(self, t):
        t = np.atleast_1d(t)
        w, angle = self.frequency, self.frequency * t[:, None] + self.phase
        q, qd, qdd, qddd = (self.amplitude * w**k * np.sin(angle + k * np.pi / 2) for k in range(4))
        return SimpleNamespace(s=t, q=self.offset + q, qd=qd, qdd=qdd, qddd=qddd)


def one_axis(pieces, knots):
    """Pieces of one axis, each [highest power, …, constant]."""
    return Polynomials(np.array(pieces, float).T[:, :, None], knots)


def fire(motion, home=None, pulse=PULSE, clock=CLOCK):
    axes = [Axis(f"leg{i + 1}", pulse=pulse) for i in range(motion.at(0.0).q.shape[1])]
    return generate(motion, axes, motion.at(0.0).q[0] if home is None else home, clock)


def excess(schedule, motion, t):
    """By how much (m) |count·pulse - (q - home)| passes ½ pulse + one tick's travel at the instants
    t; (N, axes).
    """
    q, tick = motion.at(t).q, 1 / schedule.clock_hz
    home = np.array([axis.home for axis in schedule.axes])
    pulse = np.array([axis.pulse for axis in schedule.axes])
    near = [motion.at(np.clip(t + d * tick, 0, motion.duration)).q for d in (-1, 1)]
    travel = np.maximum(*(abs(other - q) for other in near))
    return abs(schedule.counts(t) * pulse - (q - home)) - pulse / 2 - travel


def assert_sound(schedule, motion, instants=2000):
    rng = np.random.default_rng(1)
    t = np.concatenate((rng.uniform(0, motion.duration, instants), motion.knots))
    ends = motion.at(np.array([motion.duration])).q[0]
    for k, axis in enumerate(schedule.axes):
        assert (np.diff(axis.ticks) > 0).all()
        assert abs(axis.final - (ends[k] - axis.home) / axis.pulse) <= 0.5 + ROUNDING / axis.pulse
        t = np.concatenate(
            (t, axis.ticks[:200] / schedule.clock_hz, axis.ticks[-200:] / schedule.clock_hz)
        )
    assert excess(schedule, motion, np.clip(t, 0, motion.duration)).max() <= ROUNDING


# Closed forms


def test_constant_speed_fires_at_every_half_pulse():
    speed, duration = 0.0173, 0.05
    schedule = fire(one_axis([[speed, 0.0]], [0, duration]))
    (axis,) = schedule.axes
    levels = np.arange(int(speed * duration / PULSE + 0.5)) + 0.5
    assert (axis.ticks == np.rint(levels * PULSE / speed * CLOCK)).all()
    assert (axis.direction == 1).all()
    assert np.ptp(np.diff(axis.ticks)) <= 1


def test_parabola_fires_at_the_roots_of_the_quadratic_both_ways():
    speed, deceleration = 0.02, 0.225
    duration = 2 * speed / deceleration
    schedule = fire(one_axis([[-deceleration / 2, speed, 0.0]], [0, duration]))
    (axis,) = schedule.axes
    levels = (np.arange(round(speed**2 / (2 * deceleration) / PULSE)) + 0.5) * PULSE
    levels = levels[levels < speed**2 / (2 * deceleration)]
    root = np.sqrt(speed**2 - 2 * deceleration * levels)
    up = (speed - root) / deceleration
    down = ((speed + root) / deceleration)[::-1]
    assert (axis.ticks == np.rint(np.concatenate((up, down)) * CLOCK)).all()
    assert (axis.direction == np.repeat([1, -1], len(levels))).all()
    assert schedule.counts(duration)[0, 0] == 0


def test_sine_fires_at_the_arcsines():
    amplitude, frequency = 1.2345e-3, 7.0
    quarter = np.pi / 2 / frequency
    motion = Sines(
        *(np.array([x]) for x in (amplitude, frequency, 0.0, 0.3)), np.linspace(0, 4 * quarter, 30)
    )
    (axis,) = fire(motion, home=[0.3]).axes
    count = int(amplitude / PULSE + 0.5)
    rise = np.arcsin((np.arange(count) + 0.5) * PULSE / amplitude) / frequency
    expected = np.concatenate(
        (rise, 2 * quarter - rise[::-1], 2 * quarter + rise, 4 * quarter - rise[::-1])
    )
    # 0.3 + sin rounds to 5.6e-17 m, at the slowest crossing (0.1 mm/s) 1e-5 tick: a tie may fall
    # the other way.
    assert abs(axis.ticks - expected * CLOCK).max() <= 0.5 + 1e-4
    assert (axis.direction == np.repeat([1, -1, -1, 1], count)).all()


def test_cubic_from_rest_fires_at_the_cube_roots():
    jerk, duration = 4.0, 0.1
    (axis,) = fire(one_axis([[jerk / 6, 0.0, 0.0, 0.0]], [0, duration])).axes
    levels = np.arange(int(jerk / 6 * duration**3 / PULSE + 0.5)) + 0.5
    assert (axis.ticks == np.rint(np.cbrt(levels * PULSE * 6 / jerk) * CLOCK)).all()


def test_acceleration_may_jump_at_a_knot():
    """q̈ from +a to -a: with the wrong side's q̈ at the knot the quintics would miss by a h²/8."""
    a, h = 0.225, 0.1
    motion = one_axis([[a / 2, 0.0, 0.0], [-a / 2, a * h, a * h**2 / 2]], [0, h, 2 * h])
    (axis,) = fire(motion).axes
    half = len(axis) // 2
    levels = (np.arange(len(axis)) + 0.5) * PULSE
    assert (axis.ticks[:half] == np.rint(np.sqrt(2 * levels[:half] / a) * CLOCK)).all()
    mirrored = np.rint((2 * h - np.sqrt(2 * (a * h**2 - levels[half + 1 :]) / a)) * CLOCK)
    assert (axis.ticks[half + 1 :] == mirrored).all()


# The bound


def test_the_bound_holds_at_1e5_random_instants_on_six_legs():
    rng = np.random.default_rng(7)
    motion = Sines(
        rng.uniform(2e-3, 8e-3, 6),
        rng.uniform(2, 4, 6),
        rng.uniform(0, 6, 6),
        rng.uniform(0.2, 0.25, 6),
        np.linspace(0, 3, 40),
    )
    schedule = fire(motion)
    assert schedule.total > 50_000
    assert excess(schedule, motion, rng.uniform(0, motion.duration, 100_000)).max() <= ROUNDING
    assert_sound(schedule, motion)


@settings(deadline=None, max_examples=60)
@given(smooth_motions())
def test_any_motion_is_followed_within_the_bound(motion):
    assert_sound(fire(motion, home=[0.0, 0.0]), motion)


@settings(deadline=None, max_examples=60)
@given(st.floats(1e-7, 5e-3), st.floats(0.1, 300.0), st.floats(0, 6.3), st.integers(1, 5))
@example(1.5 * PULSE, 10.0, 0.0, 3)  # turns exactly on levels
def test_any_sine_is_followed_within_the_bound(amplitude, frequency, phase, pieces):
    parts = (np.array([x]) for x in (amplitude, frequency, phase, 0.22))
    motion = Sines(*parts, np.linspace(0, 20 / frequency, pieces + 1))
    assert_sound(fire(motion, home=[0.22]), motion)


def test_a_motion_run_backwards_fires_the_same_pulses_backwards():
    forward = one_axis([[-3.0, 0.9, 0.02, 0.01 * PULSE]], [0, 0.2])
    c = np.poly1d([-3.0, 0.9, 0.02, 0.01 * PULSE])(np.poly1d([-1.0, 0.2]))  # q(0.2 - t)
    back = one_axis([c.coeffs], [0, 0.2])
    (there,), (again,) = fire(forward, home=[0.0]).axes, fire(back, home=[0.0]).axes
    assert (again.direction[::-1] == -there.direction).all()
    assert abs((2_000_000 - again.ticks[::-1]) - there.ticks).max() <= 1


# Degenerate motions


@pytest.mark.parametrize("ulps", [-8, -2, -1, 0, 1, 2, 8])
@pytest.mark.parametrize("base", [0.0, 0.2190774])
def test_a_turning_point_on_a_level_never_chatters(ulps, base):
    """Four parabolas that touch 1.5 pulses to within rounding: no pulse there."""
    top, span = 1.5 * PULSE + ulps * np.spacing(base + 1.5 * PULSE), 0.01
    curve = -(top - 0.1 * PULSE) / (span / 2) ** 2
    piece = [curve, -curve * span, base + 0.1 * PULSE]
    motion = one_axis([piece] * 4, np.arange(5) * span)
    (axis,) = fire(motion, home=[base]).axes
    at_top = np.flatnonzero(
        abs(axis.ticks[:, None] - (np.arange(4) + 0.5) * span * CLOCK).min(axis=1) < 100
    )
    assert len(at_top) == 0
    assert axis.final == 0
    assert (np.diff(axis.ticks) > 0).all()
    assert (axis.direction == np.tile([1, -1], 4)).all()


def test_a_turning_point_beyond_a_level_fires_a_pair_unless_both_fall_in_one_tick():
    deceleration = 0.225
    for half_width, pulses in (
        (0.2, 0),
        (3.2, 2),
    ):  # ticks from crossing to turn, which is in the middle of a tick
        turn = 100_000 / CLOCK
        top = 0.5 * PULSE + deceleration / 2 * (half_width / CLOCK) ** 2
        motion = one_axis(
            [[-deceleration / 2, deceleration * turn, top - deceleration / 2 * turn**2]],
            [0, 2 * turn],
        )
        (axis,) = generate(motion, [Axis("x", pulse=PULSE)], [0.0], CLOCK).axes
        near = abs(axis.ticks - 100_000) < 10
        assert np.count_nonzero(near) == pulses
        assert axis.direction[near].tolist() == [1, -1][:pulses]
        assert axis.final == axis.start
        assert_sound(PulseSchedule(CLOCK, (axis,), motion.duration), motion)


@pytest.mark.parametrize("level", [-1.5, -0.5, 0.5, 2.5])
@pytest.mark.parametrize("way", [1, -1])
def test_rests_on_a_level_do_not_fire_and_departures_fire_once(level, way):
    """Dwell on a level, leave, come back, dwell: the lower count at the start, at the end the one
    it came with.
    """
    away = way * 3.2 * PULSE
    leave, back = (
        [-2 * away, 3 * away, 0.0, level * PULSE],
        [2 * away, -3 * away, 0.0, level * PULSE + away],
    )
    rest = [0.0, 0.0, 0.0, level * PULSE]
    motion = one_axis([rest, leave, back, rest, rest], [0, 1, 2, 3, 4, 4.5])
    schedule = fire(motion, home=[0.0])
    (axis,) = schedule.axes
    lower = int(np.floor(level))
    assert axis.start == lower
    first_up = way > 0
    assert len(axis) == (4 + 3 if first_up else 3 + 3)
    assert axis.final == (lower + 1 if first_up else lower)
    assert axis.ticks[0] >= CLOCK - 1
    assert axis.ticks[-1] < 3 * CLOCK
    assert_sound(schedule, motion)


def test_a_motion_that_starts_or_ends_on_a_level_keeps_the_bound():
    for start, end in ((0.5, 3.5), (3.5, 0.5), (-0.5, 0.5), (0.5, -2.5)):
        motion = one_axis([[(end - start) * PULSE, start * PULSE]], [0, 1.0])
        schedule = fire(motion, home=[0.0])
        (axis,) = schedule.axes
        assert axis.start == np.ceil(start - 0.5)
        assert axis.final == (np.ceil(end - 0.5) if end > start else np.floor(end + 0.5))
        assert_sound(schedule, motion)


def test_a_pause_on_a_level_is_crossed_once():
    """(t - ½)³ stands still for an instant on the level."""
    motion = one_axis(
        [[8 * PULSE, -12 * PULSE, 6 * PULSE, -0.5 * PULSE]], [0, 1.0]
    )  # from -½ to 1½ through ½ at t = ½
    (axis,) = fire(motion, home=[0.0]).axes
    assert (axis.direction == 1).all()
    assert axis.final - axis.start == len(axis)
    # Position is good to 1e-9 pulse, so the time of a triple root only to its cube root.
    assert abs(axis.ticks - CLOCK / 2).min() < 2e-3 * CLOCK


def test_empty_intervals_between_knots_change_nothing():
    plain = one_axis([[0.02, 0.0]], [0, 0.1])
    doubled = one_axis([[7.0, 0.0], [0.02, 0.0], [7.0, 0.0]], [0, 0, 0.1, 0.1])
    assert (fire(plain).axes[0].ticks == fire(doubled).axes[0].ticks).all()


def test_long_programs_keep_their_ticks():
    """A minute, 6e8 ticks, with the same short move at its end as at its start."""
    speed = 0.0173
    motion = one_axis(
        [[speed, 0.0], [0.0, speed * 0.001], [speed, speed * 0.001]], [0, 0.001, 60.0, 60.001]
    )
    (axis,) = fire(motion).axes
    first, second = axis.ticks[axis.ticks < CLOCK], axis.ticks[axis.ticks > CLOCK]
    exact = (np.arange(round(2 * speed * 0.001 / PULSE)) + 0.5) * PULSE / speed * CLOCK
    assert (first == np.rint(exact[: len(first)])).all()
    assert (
        abs(second - (exact[len(first) :] + 59.999 * CLOCK)).max() <= 0.5 + 1e-6
    )  # 60 s rounds to 7e-8 tick
    assert axis.ticks[-1] > 6e8


def test_pulses_faster_than_the_clock_are_refused_with_axis_time_rate_and_remedy():
    motion = Polynomials(np.array([[0.01, 0.01], [10.0, 0.0], [0.0, 0.0]])[:, None, :], [0, 0.01])
    with pytest.raises(Infeasible, match=r"leg1.*t = .* s; slow the motion") as refused:
        fire(motion)
    assert (refused.value.axis, refused.value.limit) == ("leg1", CLOCK)
    assert refused.value.value == pytest.approx(10.0 / PULSE, rel=1e-3)
    assert len(fire(motion, clock=CLOCK * 2).axes[0]) == round((0.1 + 0.01 * 0.01**2) / PULSE)


def test_speeding_up_past_the_clock_is_refused_at_the_place():
    """One pulse per tick is 7.5 m/s; 20 m/s are reached at 10 ms, whether the average stays below
    one or not.
    """
    for run_in in (0.0, 0.02):
        motion = one_axis([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0]], [0, run_in, run_in + 0.01])
        with pytest.raises(Infeasible) as refused:
            fire(motion)
        assert refused.value.place.t == pytest.approx(run_in + 0.01)
        assert refused.value.value == pytest.approx(20 / PULSE)


def test_a_pulse_that_drowns_in_rounding_is_refused():
    with pytest.raises(MotionError, match=r"axis leg1: pulse .* blurred"):
        fire(one_axis([[1e-9, 1.0]], [0, 1]), pulse=1e-13, home=[1.0])


def test_a_motion_with_a_hidden_kink_is_refused():
    class Kinked(Polynomials):
        def at(self, t):
            state = super().at(t)
            state.q = state.q + 1e-3 * abs(state.s - 0.0501)[:, None]
            state.qd = state.qd + 1e-3 * np.sign(state.s - 0.0501)[:, None]
            return state

    plain = one_axis([[0.01, 0.0]], [0, 0.1])
    with pytest.raises(MotionError, match=r"axis 1: the motion near t = 0\.050.* knot"):
        fire(Kinked(plain.curves[0].c, plain.knots))


def test_a_motion_without_duration_is_refused():
    motion = one_axis([[1.0, 0.0]], [0, 1])
    motion.knots, motion.duration = np.zeros(2), 0.0
    with pytest.raises(MotionError, match="where it starts"):
        fire(motion)


def test_axes_must_match():
    with pytest.raises(MotionError, match="2 machine axes, 1 axes of the motion, 1 home"):
        generate(one_axis([[0.01, 0.0]], [0, 1]), [Axis("a"), Axis("b")], [0.0])


def test_direction_is_in_q_whatever_the_wiring():
    motion = one_axis([[0.01, 0.0]], [0, 0.01])
    (axis,) = generate(motion, [Axis("x", pulse=PULSE, direction=-1)], [0.0]).axes
    assert (axis.direction == 1).all()


# The schedule


def test_counts_change_at_the_instant_of_the_tick():
    rng = np.random.default_rng(3)
    ticks = np.unique(rng.integers(0, 10**12, 10_000))
    axis = AxisPulses("x", ticks, np.ones(len(ticks), np.int8), -5, PULSE, 0.0)
    schedule = PulseSchedule(CLOCK, (axis,), 1e5)
    at = schedule.counts(ticks / CLOCK)[:, 0]
    assert at.dtype == np.int64
    assert (at == np.arange(len(ticks)) - 4).all()
    assert (schedule.counts((ticks - 0.5) / CLOCK)[:, 0] == np.arange(len(ticks)) - 5).all()
    assert (schedule.total, axis.final) == (len(ticks), len(ticks) - 5)
    assert schedule.smallest_interval == np.diff(ticks).min()


def test_a_schedule_cannot_be_changed():
    schedule = fire(one_axis([[0.01, 0.0]], [0, 0.01]))
    (axis,) = schedule.axes
    assert (axis.ticks.dtype, axis.direction.dtype) == (np.int64, np.int8)
    for array in (axis.ticks, axis.direction):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(MotionError, match="differ in shape"):
        AxisPulses("x", np.zeros(2, np.int64), np.ones(1, np.int8), 0, PULSE, 0.0)
    with pytest.raises(MotionError, match="clock 0 Hz"):
        PulseSchedule(0, (axis,), 1.0)


@pytest.mark.parametrize("polishing", [0, 5])
def test_where_the_fitted_pieces_cannot_tell_the_motion_itself_does(
    planned, hexapod, monkeypatch, polishing
):
    """Pieces that stray by 3e-4 pulse take slow crossings to the wrong tick; asked, the motion puts
    them right.
    """
    trajectory = planned("bare-circle", 2).trajectory
    source = levels
    true = source.fit(trajectory, np.full(6, 1e-12))
    stray = 3e-4 * hexapod.axes[0].pulse
    strayed = true.coefficients + stray * np.eye(6)[0][:, None]
    monkeypatch.setattr(
        source, "fit", lambda *_: replace(true, coefficients=strayed, error=true.error + stray)
    )
    monkeypatch.setattr(source, "NEWTON_STEPS", polishing)
    schedule = generate(trajectory, hexapod.axes, hexapod.home_q)
    assert check(schedule, trajectory, hexapod.axes, hexapod.home_q).holds == (polishing > 0)
