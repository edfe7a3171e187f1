"""A plan slowed and sped up in its midst: limits kept, the plan's motion at its share, and hardly a sooner change."""

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from planner import Dwell, Line, Program, load_program, plan
from tests.planner.interruption.test_hold import uses


@pytest.fixture(scope="module", params=[2, 3])
def circle(request, planned):
    return planned("bare-circle", request.param)


@pytest.fixture(scope="module", params=[2, 3])
def straight(request):
    """By one belt of a CoreXY, which moves √2 times as far: speed 0.3 m/s, acceleration 3 m/s², jerk 100 m/s³."""
    program = Program((Line(to=(0.045, 0.045, 0)), Dwell(0.2), Line(to=(0, 0, 0))))
    return plan(program, load_machine("corexy"), order=request.param)


def rates_at(motion, begin, places):
    """ṡ of a motion where it comes by places (m of the plan's path)."""
    t = np.linspace(0, motion.duration, 200_001)
    state = motion.at(t)
    return np.interp(places, begin + state.along, state.sd)


@pytest.mark.parametrize("share", [0.15, 0.6])
@pytest.mark.parametrize("at", [0.1, 0.37, 0.8])
def test_the_speed_falls_to_its_share_and_the_plan_goes_on_at_it(circle, share, at):
    slower = circle.override(share, at * circle.trajectory.duration)
    before, after = circle.trajectory.at(slower.at), slower.trajectory.at(0.0)
    assert slower.certificate.holds
    assert after.q == pytest.approx(before.q, abs=1e-12)
    assert after.qd == pytest.approx(before.qd, abs=1e-12)
    if circle.order == 3:
        assert after.qdd == pytest.approx(before.qdd, abs=1e-9)
    assert uses(slower).max() <= 1 + 1e-9
    assert slower.until == pytest.approx(float(circle.path.breaks[-1]), abs=1e-15)
    # on the later half of what is left, which it reaches long before: at its share of the plan's own speed
    places = np.linspace((slower.since + slower.until) / 2, slower.until - 1e-4, 50)
    own, whole = rates_at(slower.trajectory, slower.since, places), rates_at(circle.trajectory, 0.0, places)
    assert own == pytest.approx(share * whole, rel=1e-4)
    for axis, sent in zip(slower.pulses.axes, circle.pulses.axes, strict=True):
        assert axis.final == sent.final


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_no_change_along_a_line_is_sooner_than_its_ramp(straight, share):
    """From V to its share within A, and within J: ΔV/A, and A/J more where the jerk leaves A to be reached."""
    top, hard, jerk = np.array([0.3, 3.0, 100.0]) / np.sqrt(2)
    slower = straight.override(share, 0.2)
    assert straight.trajectory.at(0.2).sd[0] == pytest.approx(top, rel=1e-6)  # in its cruise
    assert slower.certificate.holds
    t = np.linspace(0, slower.duration, 200_001)
    reached = t[np.argmax(slower.trajectory.at(t).sd <= share * top * (1 + 1e-6))]
    ramp = (1 - share) * top / hard + (hard / jerk if straight.order == 3 else 0)
    assert ramp * (1 - 1e-3) <= reached <= 1.03 * ramp


def test_what_was_slowed_is_sped_up_held_and_a_hold_is_taken_back(straight):
    slower = straight.override(0.3, 0.15)
    again = straight.override(1.0, 0.12, slower)
    place = slower.trajectory.at(0.12)
    assert again.certificate.holds
    assert again.since == pytest.approx(slower.since + float(place.along[0]), abs=1e-12)
    assert again.trajectory.at(0.0).qd == pytest.approx(place.qd, abs=1e-12)
    assert uses(again).max() <= 1 + 1e-9
    fastest = again.trajectory.at(np.linspace(0, again.duration, 2001)).sd.max()
    assert fastest == pytest.approx(0.3 / np.sqrt(2), rel=1e-4)
    assert slower.at + 0.12 + again.duration < slower.at + slower.duration
    held = straight.hold(0.12, slower)
    assert held.certificate.holds
    assert held.duration < straight.hold(0.15).duration  # it is slower
    taken_back = straight.override(1.0, 0.4 * straight.hold(0.15).duration, straight.hold(0.15))
    assert taken_back.certificate.holds
    assert taken_back.until == pytest.approx(float(straight.path.breaks[-1]))
    for made, running in ((again, slower), (held, slower)):
        tick = round(made.at * straight.pulses.clock_hz)
        for own, sent in zip(made.pulses.axes, running.pulses.axes, strict=True):
            assert own.start == sent.counts([tick - 1])[0]


def test_dwells_last_as_long_as_before(straight):
    motion = straight.trajectory
    (rest,) = np.flatnonzero((motion.v == 0) & (motion.a == 0) & (motion.j == 0))
    begins, ends = motion.knots[rest], motion.knots[rest + 1]
    within = straight.override(0.5, begins + 0.05)
    state = within.trajectory.at(np.linspace(0, ends - begins - 0.05 - 1e-9, 50))
    assert np.abs(state.qd).max() == 0
    assert within.duration == pytest.approx(ends - begins - 0.05 + 2 * (motion.duration - ends), abs=2e-7)
    late = straight.override(0.5, begins - 1e-3)  # nothing is to slow before the rest
    assert late.duration == pytest.approx(1e-3 + ends - begins + 2 * (motion.duration - ends), abs=3e-3)


def test_a_plan_of_a_stated_duration_is_resumed_at_its_own_speed():
    made = plan(load_program("bare-circle"), load_machine("hexapod"), duration=4.0)
    held = made.hold(1.4)
    rest = made.resume(held)
    places = np.linspace(held.until + 0.02, 0.09, 50)
    own, whole = rates_at(rest.trajectory, rest.since, places), rates_at(made.trajectory, 0.0, places)
    assert rest.certificate.holds
    assert own == pytest.approx(whole, rel=1e-4)
    slow = made.resume(held, 0.5)
    assert rates_at(slow.trajectory, slow.since, places) == pytest.approx(0.5 * whole, rel=1e-4)
    assert made.resume(held, 1.0).duration == rest.duration < slow.duration
    assert uses(slow).max() <= 1 + 1e-9


@pytest.mark.parametrize("before", [2e-3, 1e-4])
def test_what_is_about_to_rest_rests(circle, before):
    """Nothing slower comes to the plan's end from there: it goes on."""
    late = circle.override(0.2, circle.trajectory.duration - before)
    assert late.certificate.holds
    assert before * (1 - 1e-3) <= late.duration <= 3 * before


def test_what_runs_at_its_share_goes_on(circle):
    same = circle.override(1.0, 0.4)
    assert same.duration == pytest.approx(circle.trajectory.duration - same.at, abs=1e-9)


def test_what_cannot_be_changed_is_refused(straight):
    held = straight.hold(0.2)
    for wrong, words in (
        (lambda: straight.override(0.5, -0.1), "the plan lasts from 0 to .* give an instant"),
        (lambda: straight.override(1.5, 0.1), "at most 1"),
        (lambda: straight.override(0.5, held.duration, held), "rests there to its end; resume from there"),
        (lambda: straight.override(0.5, held.duration + 1, held), "the hold lasts from 0 to"),
        (lambda: straight.override(0.5, during=held), "give the instant"),
        (lambda: straight.hold(held.duration + 1e-3, held), "the hold lasts from 0 to"),
    ):
        with pytest.raises(MotionError, match=words):
            wrong()


def test_a_dwell_that_is_changed_twice_is_as_long_as_stated(straight):
    motion = straight.trajectory
    (rest,) = np.flatnonzero((motion.v == 0) & (motion.a == 0) & (motion.j == 0))
    begins, ends = motion.knots[rest], motion.knots[rest + 1]
    once = straight.override(0.5, begins + 0.03)
    twice = straight.override(0.8, 0.02, once)
    assert twice.certificate.holds
    assert twice.duration == pytest.approx(ends - begins - 0.05 + (motion.duration - ends) / 0.8, abs=1e-6)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.95])
def test_a_stop_is_taken_back_up_to_its_end(straight, share):
    """Where no motion leads on any more, it comes to its rest first."""
    stop = straight.hold(0.12)
    on = straight.override(1.0, share * stop.duration, stop)
    assert on.certificate.holds
    assert on.until == pytest.approx(float(straight.path.breaks[-1]))
    assert uses(on).max() <= 1 + 1e-9
    assert share * stop.duration + on.duration <= stop.duration + straight.resume(stop, 1.0).duration + 1e-3


def test_pulses_go_on_with_those_of_the_stop_by_every_rule():
    program = Program((Line(to=(0.03, 0.01, 0)), Line(to=(0.03, 0.03, 0)), Line(to=(0, 0, 0))))
    made = plan(program, load_machine("corexy"), order=2, rule="nearest:hysteresis=0.4")
    for at in np.random.default_rng(1).uniform(0.01, 0.9 * made.trajectory.duration, 12).tolist():
        stop = made.hold(at)
        if stop.until < float(made.path.breaks[-1]):
            rest = made.resume(stop)
            for own, sent, whole in zip(rest.pulses.axes, stop.pulses.axes, made.pulses.axes, strict=True):
                assert (own.start, own.final) == (sent.final, whole.final)


def test_a_section_of_another_plan_is_refused(straight, circle):
    other = circle.hold(0.3)
    for wrong in (
        lambda: straight.resume(other),
        lambda: straight.hold(0.01, other),
        lambda: straight.override(0.5, 0.01, other),
    ):
        with pytest.raises(MotionError, match="is not of this plan"):
            wrong()


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("away", [1e-7, 5e-6, 2e-5])
def test_beside_a_rest_speeds_change_as_elsewhere(order, away):
    """Behind the start, a corner and a dwell, and before them: ways of less than an atom are no ramps."""
    program = Program((Line((0.01, 0.005, 0.002)), Line((0.012, 0, 0)), Dwell(0.1), Line((0, 0, 0))))
    made = plan(program, load_machine("corexy"), order=order)
    motion = made.trajectory
    rests = motion.knots[:-1][motion.v == 0]
    lasting, still = np.diff(motion.knots), (motion.v == 0) & (motion.a == 0) & (motion.j == 0)
    for at in np.unique(np.concatenate([[0.0], rests + away, rests[rests > 0] - away])):
        for share in (1.0, 0.3):
            with np.errstate(all="raise"):
                slower = made.override(share, float(at))
            assert slower.certificate.holds
            now, own = motion.at(slower.at), slower.trajectory.at(0.0)
            assert own.q == pytest.approx(now.q, abs=1e-13)
            assert own.qd == pytest.approx(now.qd, abs=1e-9)
            assert slower.until == pytest.approx(float(made.path.breaks[-1]), abs=1e-15)
            # dwells stay; what is begun, or about to rest, goes on as it is for some milliseconds
            left = np.minimum(lasting, np.maximum(motion.knots[1:] - slower.at, 0.0))
            slowed = left[still].sum() + left[~still].sum() / share
            assert slowed - (0.02 / share if share < 1 else 1e-9) <= slower.duration <= slowed + 1e-9


def test_at_the_very_end_nothing_is_left_to_slow(straight):
    """The motion's own end, and as good as that, is named as what it is; of a stop the way on is."""
    for at in (straight.duration, straight.duration - 1e-7):
        with pytest.raises(MotionError, match=f"at {at:.6f} s: .* the program ends there, and nothing is left to slow"):
            straight.override(0.5, at)
    stop = straight.hold(0.2)
    with pytest.raises(MotionError, match="resume from there"):
        straight.override(0.5, stop.duration, stop)
