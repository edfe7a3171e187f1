"""Feed-limited runs: closed forms, any machine, no more time pieces than they need, and near the
least.
"""

from dataclasses import replace

import numpy as np
import pytest

from kinematics import load_machine
from planner import Arc, Blend, Fit, Line, Program, Through, plan
from planner.baselines.classical import classical
from planner.limits import limits_of
from planner.limits.lowered import Shares
from planner.path.actuation import actuate
from planner.timing import certified_solve

# of the bundled cartesian machine, per axis: m/s, m/s², m/s³
SPEED, ACCELERATION, JERK = 0.3, 3.0, 100.0
RADIUS = 0.01
QUARTER = np.pi / 2 * RADIUS


@pytest.fixture(scope="module")
def machine():
    return load_machine("cartesian")


def quarter(feed):
    """A quarter circle: it begins along X and ends along Y."""
    return Program([Arc([0, RADIUS, 0], [0, 0, 1], np.pi / 2, speed=feed)])


@pytest.mark.parametrize("feed", [1e-5, 1e-4, 1e-3, 1e-2])
def test_an_arc_at_order_2_is_two_ramps_and_the_feed(machine, feed):
    """T = L/c + c/A: along X at its start and along Y at its end, each axis has its own A."""
    made = plan(quarter(feed), machine, order=2)
    assert made.trajectory.duration == pytest.approx(QUARTER / feed + feed / ACCELERATION, rel=2e-6)
    assert made.certificate.holds
    assert len(made.trajectory.s) < 3000
    assert made.gap <= 1e-4


@pytest.mark.parametrize("feed", [1e-5, 1e-4, 1e-3, 1e-2])
def test_an_arc_at_order_3_is_two_ramps_and_the_feed(machine, feed):
    """A ramp to c < A²/J takes 2 √(c/J) and goes half as far as c would: T = L/c + 2 √(c/J)."""
    made = plan(quarter(feed), machine, order=3)
    exact = QUARTER / feed + 2 * np.sqrt(feed / JERK)
    assert made.trajectory.duration == pytest.approx(exact, rel=2e-5)
    assert made.trajectory.duration > exact * (1 - 1e-6)
    assert made.certificate.holds
    assert made.gap <= 1e-3


def test_a_change_of_the_feed_is_a_ramp_in_the_faster_segment(machine):
    """Order 2, on a line: from c₁ to c₂ takes (c₂ − c₁)/A, over (c₂² − c₁²)/2A of the faster
    segment.
    """
    slow, fast, length = 1e-3, 5e-2, 0.02
    lines = [
        Line([length, 0, 0], speed=slow, join=Through()),
        Line([2 * length, 0, 0], speed=fast),
    ]
    made = plan(Program(lines), machine, order=2)
    ramps = (fast**2 - slow**2) / (2 * ACCELERATION), fast**2 / (2 * ACCELERATION)
    exact = slow / (2 * ACCELERATION) + length / slow
    exact += (fast - slow) / ACCELERATION + fast / ACCELERATION
    exact += (length - sum(ramps)) / fast
    assert made.trajectory.duration == pytest.approx(exact, rel=2e-6)


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize(
    "program",
    [
        Program([Line([0.02, 0, 0], speed=1e-2)]),
        Program([Arc([0, 0.01, 0], [0, 0, 1], 2.0, speed=1e-2)]),
        Program([Line([0.009, 0, 0], speed=1e-2, join=Through()), Line([0.02, 0, 0], speed=1e-2)]),
    ],
    ids=["line", "arc", "two lines"],
)
def test_where_the_cap_is_lowered_in_places_a_cruise_is_slower_there(machine, program, order):
    """As input shapers need it: 0.8 of the cap c over a stretch l costs l/0.8c − l/c, and little at
    its ends.
    """
    feed, first, last, share = 1e-2, 0.008, 0.01, 0.8
    path = actuate(program, machine)
    limits = limits_of(path, machine.axes, order)
    less = Shares(np.array([first, last]), np.array([share]))
    lowered = [limit.lower(less) if limit.name == "tool speed" else limit for limit in limits]
    whole, found = (certified_solve(path, each, order).trajectory for each in (limits, lowered))

    state = found.at(np.linspace(0, found.duration, 20_001))
    speed = np.linalg.norm(state.qd, axis=1)
    inside = (state.s >= first) & (state.s <= last)
    away = (state.s > 0.002) & (abs(state.s - 0.009) > 0.003) & (state.s < path.breaks[-1] - 0.002)
    assert speed[inside].max() <= share * feed * (1 + 1e-6)
    assert speed[inside].max() > share * feed * (1 - 1e-4)
    assert speed[away].max() > feed * (1 - 1e-4)
    longer = (last - first) / feed * (1 / share - 1)
    assert longer <= found.duration - whole.duration < 1.3 * longer


@pytest.mark.parametrize("order", [2, 3])
def test_a_hexapod_cruises_at_a_feed_too(order):
    """Its legs turn along a circle, so that no row is constant; the feed is."""
    feed = 1e-4
    hexapod = load_machine("hexapod")
    start = [0.005, 0, 0.025]
    circle = Arc([0, 0, 0.025], [0, 0, 1], 2 * np.pi, speed=feed)
    made = plan(Program([Line(start), circle]), hexapod, order=order)
    whole = plan(Program([Line(start)]), hexapod, order=order).trajectory.duration
    way = 2 * np.pi * 0.005
    assert way / feed < made.trajectory.duration - whole < way / feed + 0.2
    assert any("cruise" in method for method in made.methods)
    assert made.certificate.holds
    assert made.gap <= 1e-3


SQUARE = [[0.03, 0, 0], [0.03, 0.03, 0], [0, 0.03, 0], [0, 0, 0.002]]


@pytest.mark.parametrize("join", [Blend(2e-5), Fit(2e-5)], ids=["blend", "fit"])
@pytest.mark.parametrize("order", [2, 3])
def test_corners_that_are_rounded_are_passed_at_the_feed(machine, order, join):
    """Along a blend |dp/ds| varies, and ṡ with it: the tool keeps its cap, and nothing else
    binds.
    """
    feed = 1e-3
    lines = [Line(to, speed=feed, join=join) for to in SQUARE]
    lines[-1] = replace(lines[-1], join=lines[0].join if isinstance(join, Fit) else Through())
    made = plan(Program(lines), machine, order=order)
    state = made.trajectory.at(np.linspace(0, made.trajectory.duration, 20_001))
    speed = np.linalg.norm(np.gradient(state.pose.translation, state.t, axis=0), axis=1)
    assert speed.max() <= feed * (1 + 1e-6)
    assert np.median(speed) == pytest.approx(feed, rel=5e-5)  # MAX_SLOWING
    assert np.mean(speed < 0.999 * feed) < 0.01
    assert made.certificate.holds
    assert made.gap <= 1e-3


@pytest.mark.parametrize(("order", "kind"), [(2, "trapezoid"), (3, "s-curve")])
@pytest.mark.parametrize("feed", [1e-4, 3e-3, 5e-2])
def test_it_is_never_slower_than_the_classical_timing(machine, order, kind, feed):
    segments = [
        Line([0, 0, 0.01]),
        Line([0.03, 0, 0], speed=feed),
        Arc([0.03, 0.01, 0], [0, 0, 1], np.pi / 2, speed=feed),
        Arc([0.06, 0.01, 0], [0, 0, -1], 3.0, speed=3 * feed),
        Line([0, 0, 0.01]),
    ]
    made = plan(Program(segments), machine, order=order)
    assert made.trajectory.duration <= classical(made, kind).duration


def test_ramps_far_from_the_start_of_a_path_are_longer_than_rounding():
    """At 11 µm/s and s = 60 mm the shortest ramp is 1e7 roundings of s: its proof exceeded the cap
    by 5e-7.
    """
    hexapod = load_machine("hexapod")
    segments = [
        Line([0, 0, 0.025]),
        Arc([0.002, 0, 0.025], [0, 0, 1], 6.2),
        Line([-0.00304679, 0.00435033, 0.025], speed=1.11968e-5),
    ]
    made = plan(Program(segments), hexapod, order=2)
    assert any("cruise" in method or method == "straight" for method in made.methods)
    assert made.trajectory.duration <= classical(made).duration


def test_a_closed_form_loses_less_than_the_classical_timing_does(machine):
    """A ramp along an arc whose curvature takes a part of a low acceleration."""
    program = Program([Arc([0, RADIUS, 0], [0, 0, 1], 6.0, speed=1e-3)], acceleration=0.05)
    made = plan(program, machine, order=2)
    assert made.trajectory.duration == pytest.approx(60.02, rel=1e-7)
    assert made.trajectory.duration <= classical(made).duration


def test_the_bound_knows_the_feed_at_a_join_to_a_slower_segment(machine):
    """T = 0.35833 s in closed form; the bound let the tool pass the join at the faster feed, and
    lost 2 %.
    """
    lines = [Line([0.02, 0, 0], speed=0.2, join=Through()), Line([0.04, 0, 0], speed=0.1)]
    made = plan(Program(lines), machine, order=2)
    exact = 0.2 / (2 * ACCELERATION) + 0.1 / (2 * ACCELERATION) + 0.02 / 0.2 + 0.02 / 0.1
    exact += (0.2 - 0.1) ** 2 / (2 * ACCELERATION * 0.2)
    assert made.trajectory.duration == pytest.approx(exact, rel=2e-6)
    assert made.gap <= 1e-3


@pytest.mark.parametrize("angle", [0.08, 0.05])
def test_a_ramp_to_a_falling_cap_may_be_faster_on_the_way(machine, angle):
    """Along an arc that turns towards a slow axis, the cap of the end is the lowest: the fastest
    motion goes faster in between.
    """
    x, y, *others = machine.axes
    slow = machine.driven_by(
        [
            replace(x, max_speed=10.0, max_acceleration=0.05, max_jerk=10.0),
            replace(y, max_speed=0.003, max_acceleration=100.0, max_jerk=1e4),
            *others,
        ]
    )
    center = [-np.sin(0.02), np.cos(0.02), 0.0]
    cap = 0.003 / np.sin(0.02 + angle)
    program = Program((Arc(center, [0.0, 0.0, 1.0], angle),), end_speed=cap * (1 - 1e-6))
    without_jerk = plan(program, slow, order=2)
    fastest = plan(program, slow, order=3)
    assert fastest.lower_estimate <= fastest.duration
    assert without_jerk.duration <= fastest.duration <= 1.002 * without_jerk.duration
