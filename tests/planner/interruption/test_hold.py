"""A plan held and resumed: limits kept, on the path, pulses that continue, and hardly a sooner
stop.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kinematics import load_machine
from kinematics.foundation.errors import MotionError
from planner import Blend, Line, Program, plan
from planner.interruption.instant import look
from planner.timing import REST, Continuation, EndCondition, Run, Task, solve_once

INSTANTS = 5_000


@pytest.fixture(scope="module", params=[2, 3])
def circle(request, planned):
    return planned("circle", request.param)


@pytest.fixture(scope="module")
def stop_at(circle):
    """A share of the circle's duration -> the stop from there, made once."""
    return cache(lambda share: circle.hold(share * circle.trajectory.duration))


def uses(made):
    """The largest shares of speed, acceleration and jerk limits that are seen of a section."""
    axes = made.machine.axes
    state = made.trajectory.at(np.linspace(0, made.duration, INSTANTS)[:-1])
    most = [np.abs(state.qd).max(0) / [axis.max_speed for axis in axes]]
    most.append(np.abs(state.qdd).max(0) / [axis.max_acceleration for axis in axes])
    if any(limit.name == "jerk" for limit in made.limits):
        most.append(np.abs(state.qddd).max(0) / [axis.max_jerk for axis in axes])
    return np.array(most)


@pytest.mark.parametrize("share", [0.003, 0.31, 0.97])
def test_a_stop_goes_on_with_the_motion_and_comes_to_rest_on_its_path(circle, stop_at, share):
    held = stop_at(share)
    before, after = circle.trajectory.at(held.at), held.trajectory.at(0.0)
    end = held.trajectory.at(held.duration)
    assert held.certificate.holds
    assert before.q == pytest.approx(after.q, abs=1e-12)
    assert before.qd == pytest.approx(after.qd, abs=1e-12)
    if circle.order == 3:
        assert before.qdd == pytest.approx(after.qdd, abs=1e-9)
        assert np.abs(end.qdd).max() < 1e-9
    assert np.abs(end.qd).max() < 1e-12
    assert held.duration <= circle.trajectory.duration - held.at + 1e-12
    assert uses(held).max() <= 1 + 1e-9
    # on the path: the same place is passed at the same pose
    place = held.since + held.trajectory.at(np.linspace(0, held.duration, 50)).along
    passed = np.searchsorted(circle.path.breaks, place, "right") - 1
    there = circle.path.derivatives(place, np.clip(passed, 0, len(circle.path.pieces) - 1), 0)[0]
    assert held.trajectory.at(np.linspace(0, held.duration, 50)).q == pytest.approx(
        there, abs=1e-10
    )


def test_hardly_any_stop_is_sooner(circle, stop_at):
    """Than the soonest to any of many rests ahead, each by the engine's own solver on a fine
    grid.
    """
    held = stop_at(0.31)
    whole = circle.whole()
    now = look(circle.trajectory, held.at)
    soonest = np.inf
    for way in held.distance * np.array([0.9, 0.96, 1.0, 1.1]):
        path = whole.draw(now, held.since + way)
        going = Continuation(np.zeros(1), np.zeros((4, 0)), {}) if circle.order == 3 else None
        run = Run(0, len(path.pieces) - 1, (EndCondition(now.v, now.a), REST), continuation=going)
        found = solve_once(Task(path, whole.limits(path), run, circle.order))
        soonest = min(soonest, found.duration if found.solved else np.inf)
    assert held.duration < 1.05 * soonest


def test_no_later_stop_is_sooner():
    """Behind a blend by which the jerk leaves a narrow way, that hardly any grid but the plan's own
    shows.
    """
    program = Program(
        (Line(to=(0.03, 0, 0), join=Blend(5e-4)), Line(to=(0.03, 0.03, 0), speed=0.05))
    )
    made = plan(program, load_machine("corexy"))
    held = made.hold(0.1872)
    assert held.certificate.holds
    assert held.at == pytest.approx(0.1872, abs=1e-6)
    assert held.duration < 1.05 * (0.02 + made.hold(0.2072).duration)


DIAGONAL = Program((Line(to=(0.045, 0.045, 0)), Line(to=(0, 0, 0))))
"""A line there and back along which one belt of a CoreXY moves, √2 times as far."""


@pytest.fixture(scope="module")
def diagonal():
    return plan(DIAGONAL, load_machine("corexy"))


@pytest.mark.parametrize("at", [0.02, 0.115, 0.2])
def test_a_stop_along_a_line_takes_what_its_limits_ask_for(diagonal, at):
    """From its ramp up too, whose last part is the only motion that does not come above the largest
    speed.
    """
    made = diagonal
    hard, jerk = np.array([3.0, 100.0]) / np.sqrt(2)
    now = made.trajectory.at(at)
    speed = float(now.sd[0] + now.sdd[0] ** 2 / (2 * jerk))  # once s̈ is down to 0
    stop = speed / hard + hard / jerk if speed > hard**2 / jerk else 2 * np.sqrt(speed / jerk)
    least = float(now.sdd[0]) / jerk + stop
    assert least * (1 - 1e-6) <= made.hold(at).duration <= 1.03 * least


def test_its_pulses_go_on_with_those_that_were_sent(circle, stop_at):
    held = stop_at(0.31)
    tick = round(held.at * circle.pulses.clock_hz)
    home, end = circle.machine.home_q, held.trajectory.at(held.duration).q[0]
    for k, (sent, own) in enumerate(zip(circle.pulses.axes, held.pulses.axes, strict=True)):
        assert own.start == sent.counts([tick - 1])[0]
        assert abs(own.final - (end[k] - home[k]) / own.pulse) <= 0.5 + 1e-6
        joined = np.concatenate([sent.ticks[sent.ticks < tick], own.ticks + tick])
        assert (np.diff(joined) > 0).all()


def test_what_is_held_can_be_resumed_to_the_end(circle, stop_at):
    held = stop_at(0.31)
    rest = circle.resume(held)
    assert rest.certificate.holds
    assert rest.since == held.until
    ends = [made.trajectory.at(made.trajectory.duration).q for made in (rest, circle)]
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    assert held.at + held.duration + rest.duration > circle.trajectory.duration
    for own, sent in zip(rest.pulses.axes, held.pulses.axes, strict=True):
        assert own.start == sent.final


def test_stops_over_the_motion(tmp_path):
    made = plan(DIAGONAL, load_machine("corexy"), order=2)
    found = made.stops(2)
    held = made.hold(float(found.t[-1]))
    assert (found.time[-1], found.distance[-1]) == pytest.approx(
        (held.duration, held.distance), rel=0.05
    )
    assert "distance to rest" in str(found)
    found.save(tmp_path / "stops.npz")
    with np.load(tmp_path / "stops.npz") as saved:
        assert {name: values.tolist() for name, values in saved.items()} == {
            name: getattr(found, name).tolist() for name in ("t", "place", "time", "distance")
        }


def test_a_short_rapid_is_among_the_stops():
    """Of 0.2 s in ten, between even instants: its own stop is the longest."""
    crawl = Line(to=(0.01, 0.0, 0.0), speed=2e-3)
    program = Program(
        (crawl, Line(to=(0.045, 0.045, 0.0)), Line(to=(0.045, 0.035, 0.0), speed=2e-3))
    )
    made = plan(program, load_machine("corexy"), order=2)
    found, peak = made.stops(3), made.trajectory.v.max()
    held = made.hold(float(made.trajectory.knots[np.argmax(made.trajectory.v)]))
    assert peak > 20 * 2e-3
    assert found.distance.max() == pytest.approx(held.distance, rel=0.02)


def test_a_slow_axis_is_among_the_stops():
    """At the same feed: the axis that decelerates a tenth as hard takes ten times as long."""
    machine = load_machine("corexy")
    slow = replace(machine.axes[2], max_acceleration=0.1, max_speed=0.05)
    machine.axes = (*machine.axes[:2], slow)
    across, down = Line(to=(0.04, 0.0, 0.0), speed=0.03), Line(to=(0.04, 0.0, 0.03), speed=0.03)
    made = plan(Program((across, down, Line(to=(0.0, 0.0, 0.03), speed=0.03))), machine, order=2)
    found = made.stops(2)
    every = [made.hold(float(t)) for t in np.linspace(0.05, 0.95, 13) * made.duration]
    assert found.time.max() > 0.97 * max(stop.duration for stop in every)
    assert found.distance.max() > 0.97 * max(stop.distance for stop in every)


def test_a_way_too_short_to_be_a_motion_is_a_rest():
    made = plan(Program((Line(to=(0.03, 0, 0)),)), load_machine("corexy"), order=2)
    stop = made.hold(made.duration - 2e-7)
    assert stop.duration == stop.distance == 0
    assert stop.certificate.holds
    assert [axis.final for axis in stop.pulses.axes] == [axis.final for axis in made.pulses.axes]


def test_a_file_of_levels_begins_with_every_step_low(tmp_path):
    made = plan(Program((Line(to=(0.03, 0, 0)),)), load_machine("corexy"), order=2)
    axis = made.pulses.axes[0]
    after = (int(axis.ticks[500]) + 1) / made.pulses.clock_hz
    with pytest.raises(MotionError, match=r"choose an instant 1\.9 us later"):
        made.hold(after).export("pulses", tmp_path / "stop.csv")
    made.hold(after + 1.9e-6).export("pulses", tmp_path / "stop.csv")


def test_what_cannot_be_is_refused(circle):
    end = circle.trajectory.duration
    for wrong, words in (
        (lambda: circle.hold(-1.0), "give an instant"),
        (lambda: circle.hold(end + 1e-3), "give an instant"),
        (lambda: circle.resume(1e9), "give a place"),
        (lambda: circle.stops(0), "1 at least"),
    ):
        with pytest.raises(MotionError, match=words):
            wrong()
