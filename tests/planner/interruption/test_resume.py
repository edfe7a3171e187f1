"""The way on at a share of the plan's speed: limits, speed, dwells, the ramp, pulses, and a stop
within it.
"""

from itertools import cycle

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from planner import Dwell, Line, Program, Turn, load_program, plan
from tests.planner.interruption.test_hold import uses


@pytest.fixture(scope="module", params=[2, 3])
def circle(request, planned):
    return planned("bare-circle", request.param)


@pytest.fixture(scope="module", params=[2, 3])
def straight(request):
    """By one belt of a CoreXY, which moves √2 times as far: speed 0.3 m/s, acceleration 3 m/s²,
    jerk 100 m/s³.
    """
    program = Program((Line(to=(0.045, 0.045, 0)), Dwell(0.2), Line(to=(0, 0, 0))))
    return plan(program, load_machine("corexy"), order=request.param)


def rates_at(motion, begin, places):
    """ṡ of a motion where it comes by places (m of the plan's path)."""
    t = np.linspace(0, motion.duration, 20_001)
    state = motion.at(t)
    return np.interp(places, begin + state.along, state.sd)


def find_dwell(made):
    """Begin and end (s) of the dwell of a plan."""
    motion = made.trajectory
    (rest,) = np.flatnonzero((motion.v == 0) & (motion.a == 0) & (motion.j == 0))
    return motion.knots[rest], motion.knots[rest + 1]


@pytest.mark.parametrize(
    ("circle", "at", "share"),
    [(2, 0.1, 0.15), (2, 0.37, 0.6), (2, 0.8, 0.6), (3, 0.37, 0.6)],
    indirect=["circle"],
)
def test_the_way_on_takes_up_the_share_of_the_plans_speed(circle, at, share):
    held = circle.hold(at * circle.trajectory.duration)
    slow = circle.resume(held, share)
    begin = slow.trajectory.at(0.0)
    assert slow.certificate.holds
    assert uses(slow).max() <= 1 + 1e-9
    assert begin.q == pytest.approx(held.trajectory.at(held.duration).q, abs=1e-12)
    assert np.abs(begin.qd).max() == 0
    assert slow.until == pytest.approx(float(circle.path.breaks[-1]), abs=1e-15)
    # on the later half of what is left, which is long after the ramp
    places = np.linspace((slow.since + slow.until) / 2, slow.until - 1e-4, 50)
    speeds = rates_at(slow.trajectory, slow.since, places)
    assert speeds == pytest.approx(share * rates_at(circle.trajectory, 0.0, places), rel=1e-4)
    for axis, sent, whole in zip(
        slow.pulses.axes, held.pulses.axes, circle.pulses.axes, strict=True
    ):
        assert (axis.start, axis.final) == (sent.final, whole.final)


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_the_ramp_along_a_line_takes_what_its_limits_ask_for(straight, share):
    """From rest to a speed V within A, and within J: V/A, and A/J more; 2 √(V/J) where the jerk
    does not reach A.
    """
    top, hard, jerk = np.array([0.3, 3.0, 100.0]) / np.sqrt(2)
    assert straight.trajectory.at(0.2).sd[0] == pytest.approx(top, rel=1e-6)  # in its cruise
    # from rest a third of the way along the first line, which is passed at that speed
    slow = straight.resume(0.02, share)
    assert slow.certificate.holds
    t = np.linspace(0, slow.duration, 20_001)
    speed = share * top
    reached = t[np.argmax(slow.trajectory.at(t).sd >= speed * (1 - 1e-6))]
    ramp = speed / hard
    if straight.order == 3:
        ramp = ramp + hard / jerk if speed > hard**2 / jerk else 2 * np.sqrt(speed / jerk)
    # 0.2 %: the last √(2e-6) of a ramp that ends with jerk
    assert ramp * (1 - 2e-3) <= reached <= 1.03 * ramp


@pytest.mark.parametrize("share", [1.0, 0.37])
def test_the_whole_plan_at_a_share_scales_rates_by_its_powers(circle, share):
    slower = circle.resume(0.0, share)
    t = np.linspace(0.0, 0.9 * circle.trajectory.duration, 40)
    now, then = circle.trajectory.at(t), slower.trajectory.at(t / share)
    assert slower.certificate.holds
    assert slower.duration == pytest.approx(circle.trajectory.duration / share, rel=1e-12)
    assert then.q == pytest.approx(now.q, abs=1e-12)
    assert then.qd == pytest.approx(share * now.qd, abs=1e-9)
    assert then.qdd == pytest.approx(share**2 * now.qdd, abs=1e-6)
    assert slower.pulses.total == circle.pulses.total


def test_dwells_last_as_long_as_before(straight):
    begins, ends = find_dwell(straight)
    moves = straight.trajectory.duration - (ends - begins)
    assert straight.resume(0.0, 0.5).duration == pytest.approx(ends - begins + 2 * moves, rel=1e-12)
    # a dwell that was broken off is repeated
    stop = straight.hold(begins + 0.05)
    after = straight.resume(stop, 0.5)
    assert stop.duration == 0
    assert after.duration == pytest.approx(
        ends - begins + 2 * (straight.trajectory.duration - ends), rel=1e-9
    )


def test_a_plan_of_a_stated_duration_is_resumed_at_its_own_speed():
    made = plan(load_program("bare-circle"), load_machine("hexapod"), order=2, duration=4.0)
    held = made.hold(1.4)
    rest = made.resume(held)
    places = np.linspace(held.until + 0.02, 0.09, 50)
    own, whole = (
        rates_at(rest.trajectory, rest.since, places),
        rates_at(made.trajectory, 0.0, places),
    )
    assert rest.certificate.holds
    assert own == pytest.approx(whole, rel=1e-4)
    slow = made.resume(held, 0.5)
    assert rates_at(slow.trajectory, slow.since, places) == pytest.approx(0.5 * whole, rel=1e-4)
    assert made.resume(held, 1.0).duration == rest.duration < slow.duration
    assert uses(slow).max() <= 1 + 1e-9


@pytest.mark.parametrize(("straight", "share"), [(2, None), (3, 0.3)], indirect=["straight"])
def test_the_way_on_can_be_held_and_resumed_again(straight, share):
    """Each continues the motion and the pulses of the one before it, and the last ends where the
    plan does.
    """
    on = straight.resume(straight.hold(0.15), share)
    held = straight.hold(0.1, on)
    last = straight.resume(held, share)
    now, begin = on.trajectory.at(held.at), held.trajectory.at(0.0)
    assert now.sd[0] > 0.03
    assert held.certificate.holds
    assert last.certificate.holds
    assert held.since == pytest.approx(on.since + float(now.along[0]), abs=1e-12)
    assert begin.q == pytest.approx(now.q, abs=1e-12)
    assert begin.qd == pytest.approx(now.qd, abs=1e-12)
    assert uses(held).max() <= 1 + 1e-9
    tick = round(held.at * straight.pulses.clock_hz)
    for axis, sent, after, whole in zip(
        held.pulses.axes, on.pulses.axes, last.pulses.axes, straight.pulses.axes, strict=True
    ):
        assert axis.start == sent.counts([tick - 1])[0]
        assert (after.start, after.final) == (axis.final, whole.final)


@pytest.mark.parametrize(("straight", "circle"), [(2, 2)], indirect=True)
def test_what_cannot_be_is_refused(straight, circle):
    held, other = straight.hold(0.2), circle.hold(0.3)
    for wrong, words in (
        (lambda: straight.resume(held, 1.5), "above 0 and at most 1"),
        (lambda: straight.resume(held, 0.0), "above 0 and at most 1"),
        (lambda: straight.hold(held.duration + 1e-3, held), "the hold lasts from 0 to"),
        (lambda: straight.resume(other), "is not of this plan"),
        (lambda: straight.hold(0.01, other), "is not of this plan"),
    ):
        with pytest.raises(MotionError, match=words):
            wrong()


def test_pulses_go_on_with_those_of_the_stop_by_every_rule():
    program = Program((Line(to=(0.03, 0.01, 0)), Line(to=(0.03, 0.03, 0)), Line(to=(0, 0, 0))))
    made = plan(program, load_machine("corexy"), order=2, rule="nearest:hysteresis=0.4")
    for at in np.random.default_rng(1).uniform(0.01, 0.9 * made.trajectory.duration, 12).tolist():
        stop = made.hold(at)
        if stop.until < float(made.path.breaks[-1]):
            rest = made.resume(stop)
            for own, sent, whole in zip(
                rest.pulses.axes, stop.pulses.axes, made.pulses.axes, strict=True
            ):
                assert (own.start, own.final) == (sent.final, whole.final)


@pytest.mark.parametrize(("order", "away"), [(2, 1e-7), (2, 1e-5), (3, 1e-7)])
def test_beside_a_rest_the_way_on_is_as_elsewhere(order, away):
    """After the start, a corner and a dwell, and before them: distances of less than an atom are no
    ramps.
    """
    program = Program(
        (Line((0.01, 0.005, 0.002)), Line((0.012, 0, 0)), Dwell(0.1), Line((0, 0, 0)))
    )
    made = plan(program, load_machine("corexy"), order=order)
    rests = np.unique(made.trajectory.s[made.trajectory.v == 0])
    both = (1.0, 0.3)
    places = np.concatenate([rests + away, rests[rests > 0] - away]).tolist()
    # a way on takes ten times as long at order 3, so that one share of two is tried there
    for place, one in zip(places, cycle(both)):
        for share in both if order == 2 else (one,):
            with np.errstate(all="raise"):
                slow = made.resume(place, share)
            assert slow.certificate.holds
            assert slow.until == pytest.approx(float(made.path.breaks[-1]), abs=1e-15)
            there = made.path.derivatives(
                np.array([place]), np.array([slow_piece(made, place)]), 0
            )[0]
            assert slow.trajectory.at(0.0).q == pytest.approx(there, abs=1e-13)


def slow_piece(made, place):
    """The piece of a plan's path at a place (m)."""
    return int(np.searchsorted(made.path.breaks, place, "right")) - 1


@pytest.mark.parametrize(
    ("machine", "program"),
    [
        ("arm", "arm-line"),
        ("linkage", "linkage-line"),
        ("traverser", "traverser-scan"),
        ("tripod", "tripod-circle"),
    ],
)
def test_every_kind_of_machine_resumes_at_a_share(machine, program):
    """At order 2; the circle of the hexapod and the line of the CoreXY resume at order 3 too."""
    made = plan(load_program(program), load_machine(machine), order=2)
    stop = made.hold(0.4 * made.duration)
    rest = made.resume(stop, 0.5)
    assert stop.certificate.holds
    assert rest.certificate.holds
    assert uses(rest).max() <= 1 + 1e-9
    places = np.linspace((rest.since + rest.until) / 2, rest.until, 20)[:-1]
    speeds = rates_at(rest.trajectory, rest.since, places)
    assert speeds == pytest.approx(0.5 * rates_at(made.trajectory, 0.0, places), rel=1e-3, abs=1e-5)
    assert [axis.final for axis in rest.pulses.axes] == [axis.final for axis in made.pulses.axes]


@pytest.mark.parametrize("share", [None, 0.5])
def test_an_axis_that_has_turned_by_more_than_half_a_turn_goes_on_from_there(share):
    """The way on is drawn near the coordinates of the stop, not near home, which is a turn away."""
    machine = load_machine("traverser")
    made = plan(Program((Turn((0, 0, 2.5)), Turn((0, 0, -2.5)))), machine, order=2)
    stop = made.hold(0.8 * made.duration)
    rest = made.resume(stop, share)
    end = stop.trajectory.at(stop.duration).q
    assert np.abs(end - machine.home_q).max() > np.pi
    assert rest.trajectory.at(0.0).q == pytest.approx(end, abs=1e-12)
