"""Constant tool speed: exactly the speed between the shortest ramps, or a refusal that names the
place.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, Traverser, load_machine
from planner import Arc, Infeasible, Line, Program, plan
from planner.certificate import SPEED_TOLERANCE

A, J = 0.5, 10.0
RIM = RigidTransform.from_components([0.015, 0, 0.025], Rotation.identity())


@pytest.fixture(scope="module")
def table():
    """Two straight axes with no couplings: every answer has a closed form."""
    bundled = load_machine("traverser")
    axes = [
        replace(axis, max_speed=0.1, max_acceleration=A, max_jerk=J, max_pulse_rate=None)
        for axis in bundled.axes
    ]
    return Traverser(axes=axes, home=bundled.home)


def ramp(speed, order):
    """Length of the shortest ramp of one axis: half the speed for as long as it takes (A²/J is not
    reached).
    """
    return speed / 2 * (speed / A if order == 2 else 2 * np.sqrt(speed / J))


def kept(made, speed, number=1):
    """Asserts that the stretch at constant speed is there, by the trajectory itself; its ends along
    the segment.
    """
    (stretch,) = (each for each in made.constant_speeds if each.since.segment == number)
    assert stretch.speed == speed
    assert stretch.deviation <= SPEED_TOLERANCE
    t = np.linspace(stretch.since.t, stretch.until.t, 5001)[1:-1]
    moved = np.linalg.norm(made.trajectory.at(t).tool_velocity, axis=1)
    assert np.abs(moved / speed - 1).max() < 1e-9
    pieces = [k for k, piece in enumerate(made.path.pieces) if piece.segment == number]
    first, last = made.path.breaks[pieces[0]], made.path.breaks[pieces[-1] + 1]
    assert made.certificate.holds
    return stretch.since.s - first, last - stretch.until.s


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("speed", [0.01, 0.02])
def test_a_straight_axis_has_the_shortest_ramps(table, order, speed):
    made = plan(
        Program((Line([0.05, 0, 0], speed=speed, speed_constant=True),)), table, order=order
    )
    for length in kept(made, speed):
        assert length == pytest.approx(
            ramp(speed, order), rel=3e-8
        )  # the share at which the speed counts as reached
    least = (0.05 - 2 * ramp(speed, order)) / speed + 4 * ramp(speed, order) / speed
    assert made.trajectory.duration == pytest.approx(least, rel=3e-9)


LINE, ARC = Line([0, 0, 0.025], speed=0.02), Arc([0.01, 0, 0.025], [0, 0.6, 0.8], 4.0, speed=0.025)


@pytest.mark.parametrize(("order", "segments"), [(2, (LINE, ARC)), (3, (ARC,))])
def test_lines_and_arcs_of_a_hexapod(hexapod, order, segments):
    free = plan(Program(segments, start=RIM), hexapod, order=order)
    constant = tuple(replace(segment, speed_constant=True) for segment in segments)
    made = plan(Program(constant, start=RIM), hexapod, order=order)
    # against the motion under the same caps: where it is first, and last, within 1e-4 of them; its
    # own grid is 1/240
    moved, breaks = free.trajectory, free.path.breaks
    for number, speed in enumerate(segment.speed for segment in segments):
        there = moved.s[(moved.piece == number) & (moved.v > speed * (1 - 1e-4))]
        up, down = kept(made, speed, number + 1)
        assert up <= 1.04 * (there[0] - breaks[number])
        assert (
            down
            <= 1.04 * (breaks[number + 1] - there[-1]) + (breaks[number + 1] - breaks[number]) / 240
        )


def test_a_program_that_begins_and_ends_at_the_speed_has_no_ramps(table):
    arc = Arc([0.02, 0.04, 0], [0, 0, 1], 2.0, speed=0.03, speed_constant=True)
    start = RigidTransform.from_components([0.02, 0.02, 0], Rotation.identity())
    made = plan(Program((arc,), start=start, start_speed=0.03, end_speed=0.03), table, order=3)
    assert kept(made, 0.03) == pytest.approx((0, 0), abs=1e-15)
    assert made.trajectory.duration == pytest.approx(2.0 * 0.02 / 0.03, rel=1e-12)


def told(refusal):
    return float(re.search(r"could be ([\d.]+) mm/s", str(refusal.value))[1]) / 1e3


@pytest.mark.parametrize("order", [2, 3])
def test_a_circle_that_is_too_fast_names_the_axis_the_place_and_the_speed(table, order):
    """On a circle of radius r each axis needs v²/r where it turns: √(A r) is what can be kept."""
    radius = 0.02
    speed = 1.08 * np.sqrt(A * radius)
    start = RigidTransform.from_components([0.03, 0.03 + radius, 0], Rotation.identity())
    arc = Arc([0.03, 0.03, 0], [0, 0, 1], 7 * np.pi, speed=speed, speed_constant=True)
    axes = [replace(axis, max_speed=1.0, max_jerk=1e3) for axis in table.axes]
    with pytest.raises(Infeasible) as refusal:
        plan(Program((arc,), start=start), Traverser(axes=axes, home=table.home), order=order)
    no = refusal.value
    assert (no.kind, no.place.segment) == ("acceleration", 1)
    assert no.value == pytest.approx(speed**2 / radius * 1e3, rel=1e-4)
    assert no.limit == pytest.approx(A * 1e3)
    assert told(refusal) == pytest.approx(np.sqrt(A * radius), rel=1e-4)
    turned = no.place.s / radius / (np.pi / 2)  # whole where an axis turns
    assert turned == pytest.approx(round(turned), abs=0.02)
    assert no.axis == ("Y" if round(turned) % 2 == 0 else "X")


@pytest.mark.parametrize("speed", [0.0865, 0.1])
def test_the_refusal_agrees_with_a_scan_of_its_own(hexapod, own_lengths, speed):
    """Leg speeds and accelerations by differences of the legs' own lengths along the circle, 1e-5
    rad apart.

    86.5 mm/s can be kept along parts of the circle, 100 mm/s nowhere.
    """
    limit_v, limit_a = hexapod.axes[0].max_speed, hexapod.axes[0].max_acceleration
    arc = Arc([0, 0, 0.025], [0, 0, 1], 2 * np.pi, speed=speed, speed_constant=True)
    with pytest.raises(Infeasible) as refusal:
        plan(Program((arc,), start=RIM), hexapod, order=2)

    def allowed(angle):
        h = 1e-5
        home = hexapod.home.translation

        def circle(x):
            return home + np.stack(
                [0.015 * np.cos(x), 0.015 * np.sin(x), np.full(len(x), 0.025)], 1
            )

        legs = [
            own_lengths(circle(angle + k * h), np.tile(np.eye(3), (len(angle), 1, 1)))
            for k in (-1, 0, 1)
        ]
        first, second = (
            (legs[2] - legs[0]) / (2 * h * 0.015),
            (legs[2] - 2 * legs[1] + legs[0]) / (h * 0.015) ** 2,
        )
        return 1 / np.maximum(np.abs(first) / limit_v, np.sqrt(np.abs(second) / limit_a)).max(1)

    place = refusal.value.place
    assert told(refusal) == pytest.approx(float(allowed(np.array([place.s / 0.015]))[0]), rel=1e-4)
    least = allowed(np.linspace(0, 2 * np.pi, 4001))
    assert told(refusal) == pytest.approx(float(least.min()), rel=1e-4)


def test_a_segment_too_short_for_its_ramps_says_how_fast_it_gets(table):
    """From rest to rest over L one axis gets to √(A L)."""
    with pytest.raises(
        Infeasible, match="too short for its ramps, limited by the acceleration of X"
    ) as refusal:
        plan(Program((Line([0.001, 0, 0], speed=0.05, speed_constant=True),)), table, order=2)
    assert refusal.value.limit / 1e3 == pytest.approx(np.sqrt(A * 0.001), rel=1e-3)


def test_a_constant_speed_needs_a_speed():
    with pytest.raises(MotionError, match="give speed too"):
        Line([0, 0, 0.01], speed_constant=True)
    with pytest.raises(MotionError, match="give speed too"):
        Arc([0, 0, 0.01], [0, 0, 1], 1, speed_constant=True)


def test_an_end_of_travel_at_home_is_not_blamed_for_a_speed(hexapod):
    """All legs stand at an end of their travel at home, to rounding: what stops the speed is the
    legs' own.
    """
    asked = Program((Line([0, 0, 0.025], speed=0.08, speed_constant=True),))
    with pytest.raises(Infeasible) as refusal:
        plan(asked, hexapod, order=2)
    assert refusal.value.kind == "speed"
    found = re.search(r"there it could be ([\d.]+) mm/s", str(refusal.value))
    # a leg is slower than the tool by its slope on the path, which is above 0.9
    assert 20 < float(found[1]) < 20 / 0.9
    proved = re.search(r"([\d.]+) mm/s was found to hold", str(refusal.value))
    assert plan(
        Program((replace(asked.segments[0], speed=float(proved[1]) / 1e3),)), hexapod, order=2
    )
