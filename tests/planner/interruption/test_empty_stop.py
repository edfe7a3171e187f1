"""A plan held at a rest: an empty stop where the plan stands, without a pulse, from which the plan
goes on.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import MotionError, load_machine
from kinematics.machine.shaper import Shaper
from planner import Blend, Dwell, Line, Program, Turn, plan, read_pulses
from planner.export.format import FORMATS
from planner.pulses import find_rule

CORNERS = (Line(to=(0.01, 0, 0)), Line(to=(0.01, 0.012, 0)), Dwell(0.1), Line(to=(0.0, 0.002, 0)))


def list_rests(made):
    """Instants (s) at which a plan rests: its start and end, its corners, and the beginning and
    midst of its dwells.
    """
    motion = made.trajectory
    still = np.flatnonzero(motion.v <= 1e-12 * motion.v.max())
    resting = [k for k in still if motion.a[k] == 0 and motion.j[k] == 0]
    inside = [(motion.knots[k] + motion.knots[k + 1]) / 2 for k in resting]
    return sorted({0.0, motion.duration, *map(float, motion.knots[still]), *map(float, inside)})


def assert_empty(made, stop, at):
    """It takes no time and no way, keeps every limit, sends nothing, and stands where the plan
    rests.
    """
    assert stop.trajectory.duration == stop.duration == 0
    assert stop.distance == 0
    assert stop.certificate.holds
    assert stop.certificate.worst["speed"] == stop.certificate.worst["acceleration"] == 0
    assert stop.pulses.total == 0
    assert stop.pulses.duration == 0
    grain = find_rule(made.pulses.rule).grain(made.pulses.clock_hz) / made.pulses.clock_hz
    assert stop.at == pytest.approx(at, abs=grain)
    there = made.trajectory.at(min(at, made.trajectory.duration))
    np.testing.assert_allclose(stop.trajectory.at(0.0).q, there.q, rtol=0, atol=1e-9)
    travel = [
        2 * abs((q - np.mean(a.travel)) / np.ptp(a.travel)) for q, a in positions(made, there)
    ]
    if travel:
        assert stop.certificate.worst["travel"] == pytest.approx(max(travel), abs=1e-6)


def positions(made, state):
    """Places from home and axes, of those that have ends of travel."""
    q = state.q[0] - made.machine.home_q
    return [
        (float(place), axis)
        for place, axis in zip(q, made.machine.axes, strict=True)
        if np.isfinite(axis.travel).all()
    ]


@pytest.mark.parametrize("order", [2, 3])
def test_at_every_rest_the_stop_is_empty_and_the_way_on_is_the_plans(order):
    made = plan(Program(CORNERS), load_machine("corexy"), order=order)
    rests = list_rests(made)
    assert len(rests) == 6  # both ends, a corner, and begin, midst and end of the dwell
    for at in rests:
        stop = made.hold(at)
        assert_empty(made, stop, at)
        ticks = [axis.ticks < round(stop.at * made.pulses.clock_hz) for axis in made.pulses.axes]
        sent = [
            int(axis.direction[before].sum())
            for axis, before in zip(made.pulses.axes, ticks, strict=True)
        ]
        assert [
            axis.start - whole.start
            for axis, whole in zip(stop.pulses.axes, made.pulses.axes, strict=True)
        ] == sent
        if at == made.duration:
            continue
        rest = made.resume(stop)
        assert rest.certificate.holds
        assert rest.since == stop.until
        assert [axis.start for axis in rest.pulses.axes] == [
            axis.final for axis in stop.pulses.axes
        ]
        assert [axis.final for axis in rest.pulses.axes] == [
            axis.final for axis in made.pulses.axes
        ]


@pytest.mark.parametrize("rule", ["floor", "sampled", "dda", "timer"])
def test_rules_that_lag_are_left_where_they_are(rule):
    """Nothing is sent to what stands; the bound of the counts says how far that is from the
    plan.
    """
    made = plan(Program(CORNERS), load_machine("corexy"), order=2, rule=rule)
    for at in list_rests(made):
        stop = made.hold(at)
        assert_empty(made, stop, at)
        state = made.trajectory.at(at)
        wanted = (state.q[0] - made.machine.home_q) / [axis.pulse for axis in made.machine.axes]
        for axis, place in zip(stop.pulses.axes, wanted, strict=True):
            assert abs(axis.start - place) <= axis.bound + 1e-6


def test_the_last_pulse_of_the_way_to_a_rest_is_sent_if_it_is_due():
    """By the rule "floor" it falls as the axis arrives: who holds there has not sent it yet."""
    made = plan(
        Program((Line(to=(0.01, 0, 0)),)),
        load_machine("corexy"),
        order=2,
        rule="floor",
        clock_hz=14_000,
    )
    stop = made.hold(made.duration)
    assert stop.duration == 0
    assert stop.certificate.holds
    assert [axis.final for axis in stop.pulses.axes] == [axis.final for axis in made.pulses.axes]
    assert stop.pulses.total <= len(made.machine.axes)


@pytest.mark.parametrize("clock_hz", [16_000, 1_000_000])
def test_at_the_end_of_a_slow_clock_the_stop_is_empty(clock_hz):
    """The end is between two ticks, at the last of which the axes still move."""
    made = plan(
        Program((Line(to=(0.0101, 0.003, 0)),)), load_machine("corexy"), order=2, clock_hz=clock_hz
    )
    stop = made.hold(made.duration)
    assert stop.duration == stop.distance == 0
    assert stop.certificate.holds


def test_a_machine_of_legs_at_the_end_of_its_travel_and_in_a_turn():
    program = Program(
        (
            Line(to=(0, 0, 0.01)),
            Turn(0.05 * np.array([0, 1.0, 0])),
            Dwell(0.05),
            Line(to=(0.002, 0, 0.012)),
        )
    )
    made = plan(program, load_machine("hexapod"), order=2)
    for at in list_rests(made):
        stop = made.hold(at)
        assert_empty(made, stop, at)
        assert 0 < stop.certificate.worst["tilt"] < 1
        assert 0 < stop.certificate.worst["clearance"] < 1
    assert made.hold(0.0).certificate.worst["travel"] == pytest.approx(
        1.0
    )  # home is the lower end of every leg


def test_a_blended_corner_is_no_rest_and_stops_as_ever():
    made = plan(
        Program((Line(to=(0.01, 0, 0), join=Blend(1e-4)), Line(to=(0.01, 0.01, 0)))),
        load_machine("corexy"),
        order=2,
    )
    assert len(list_rests(made)) == 2
    assert made.hold(made.duration / 2).duration > 0.01


def test_an_empty_stop_of_a_section_that_rests():
    made = plan(Program(CORNERS), load_machine("corexy"), order=2)
    held = made.hold(0.05)
    assert held.duration > 0
    again = made.hold(held.duration, held)
    assert again.duration == again.distance == 0
    assert again.certificate.holds
    assert again.until == pytest.approx(held.until, abs=1e-12)
    assert made.hold(0.0, again).duration == 0
    assert made.hold(0.0, made.hold(made.duration)).duration == 0


def test_behind_shapers_the_stop_is_empty_once_every_copy_rests():
    machine = load_machine("corexy")
    machine = machine.driven_by([axis.add_shaper(Shaper("zv", 20.0)) for axis in machine.axes])
    made = plan(Program(CORNERS), machine, order=2)
    still = made.shaped.motion.copies.length
    begin, end = list_rests(made)[2], list_rests(made)[4]  # of the dwell
    assert end - begin > still
    for at in (0.0, begin + still + 1e-3, end, made.duration):
        stop = made.hold(at)
        assert stop.duration == stop.distance == 0
        assert stop.certificate.holds
        assert stop.pulses.total == 0
    assert made.hold(begin + still / 4).duration > 0  # a copy still moves
    assert [axis.final for axis in made.resume(made.hold(end)).pulses.axes] == [
        a.final for a in made.pulses.axes
    ]


def test_play_that_is_made_up_for_stays_as_it_is():
    machine = load_machine("corexy")
    axes = [replace(axis, backlash=2e-5, compensate=("backlash",)) for axis in machine.axes]
    made = plan(
        Program((Line(to=(0.01, 0, 0)), Dwell(0.2), Line(to=(0.0, 0, 0)))),
        machine.driven_by(axes),
        order=2,
    )
    for at in list_rests(made)[:3]:
        stop = made.hold(at)
        assert stop.duration == 0
        assert stop.pulses.total == 0
        assert [a.final for a in made.resume(stop).pulses.axes] == [
            a.final for a in made.pulses.axes
        ]


def test_formats_write_an_empty_stop_or_say_why_not(tmp_path):
    stop = plan(Program(CORNERS), load_machine("corexy"), order=2).hold(0.0)
    written = []
    for name in FORMATS:
        try:
            assert stop.export(name, tmp_path / name).moves == 0
        except MotionError:
            continue
        written.append(name)
    assert {"pulses", "vcd", "steps", "npz", "binary", "csp"} <= set(written)
    assert read_pulses(tmp_path / "binary").total == 0


def test_a_stop_that_is_too_short_for_a_pulse_is_written(tmp_path):
    """Shortly before the end less than half a pulse is left."""
    made = plan(Program(CORNERS, frame="home"), load_machine("corexy"))
    stop = made.hold(made.duration - 5e-4)
    assert stop.distance > 0
    assert stop.pulses.total == 0
    for name in ("npz", "binary", "steps"):
        file = tmp_path / name
        stop.export(name, file)
        assert file.is_file()


def test_stops_from_rests_are_nothing():
    made = plan(Program(CORNERS), load_machine("corexy"), order=2)
    stops = made.stops(12)
    assert not stops.refused
    assert (stops.time >= 0).all()
    assert (stops.time == 0).any()  # in the dwell
    assert (stops.distance[stops.time == 0] == 0).all()
