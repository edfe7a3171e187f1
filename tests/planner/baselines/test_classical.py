"""The baselines of every saving: each proved, the fastest of its kind, and what it says it is."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from kinematics import Axis, MotionError, load_machine
from kinematics.machine.pose import from_numbers
from planner import Arc, Line, Program, classical, plan
from planner.baselines.classical import PATH_SHAPES, ClassicalFamily
from planner.baselines.shapes import SINE_PARTS, quarter_sine
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing.certified_solve import solve_goal
from planner.timing.certify_loop import RunCertifier


@pytest.fixture(scope="module")
def baseline(planned):
    return {name: classical(planned(name, 2)) for name in ("bare-circle", "circle")}


@pytest.mark.parametrize("name", ["bare-circle", "circle"])
def test_it_holds_its_own_certificate_and_is_not_faster(planned, baseline, name):
    found = baseline[name]
    assert found.certificate.holds
    assert "jerk" not in found.certificate.worst
    assert max(found.certificate.worst.values()) <= 1 + 1e-6
    assert found.duration == found.trajectory.duration > planned(name, 2).trajectory.duration


@pytest.mark.parametrize("name", ["bare-circle", "circle"])
def test_each_segment_is_a_trapezoid_in_arc_length(planned, baseline, name):
    """One acceleration up, none, the same down; as long as its corners say: L/V + V/A."""
    path, trajectory = planned(name, 2).path, baseline[name].trajectory
    h = np.diff(trajectory.knots)
    moving = (trajectory.v > 0) | (trajectory.a > 0)
    for piece, length in enumerate(np.diff(path.breaks)):
        chosen = (trajectory.piece == piece) & moving
        v, a = trajectory.v[chosen], trajectory.a[chosen]
        rate, top = a.max(), (v + a * h[chosen]).max()
        steady = np.abs(a) < 1e-6 * rate
        assert np.abs(np.abs(a[~steady]) - rate).max() < 1e-6 * rate
        assert (np.diff(np.sign(np.where(steady, 0, a))) <= 0).all()
        assert h[chosen].sum() == pytest.approx(length / top + top / rate, rel=1e-6)
        assert (trajectory.j[chosen] == 0).all()
    assert trajectory.duration - h[moving].sum() == pytest.approx(path.dwells.sum(), abs=1e-12)


def test_it_is_the_fastest_trapezoid_of_the_bare_circle(planned, baseline):
    """Against every ramp length in turn, with the largest speed that dense places allow: V falls
    out by proportion.
    """
    path, length = planned("bare-circle", 2).path, planned("bare-circle", 2).path.breaks[-1]
    s = np.linspace(0, length, 4001)
    _, slope, bend, _ = path.derivatives(s, np.zeros(len(s), int))
    best = np.inf
    for ramp in np.geomspace(1e-3, 0.5, 1500) * length:
        # at top speed 1: ṡ² and s̈ along the way; all of them go with V²
        square = np.minimum(1.0, np.minimum(s, length - s) / ramp)
        rate = np.where(s < ramp, 1, np.where(s > length - ramp, -1, 0)) / (2 * ramp)
        top = min(
            0.02 / np.abs(slope * np.sqrt(square)[:, None]).max(),
            np.sqrt(0.225 / np.abs(slope * rate[:, None] + bend * square[:, None]).max()),
        )
        best = min(best, (length + 2 * ramp) / top)
    # ramp lengths 0.4 % apart here; a baseline that is slower by more would flatter the saving that
    # is quoted
    assert baseline["bare-circle"].duration == pytest.approx(best, rel=1e-3)


def straight(length):
    return PolynomialPath([0.0, length], np.array([[[1.0]], [[0.0]]]), ["x"])


def alone(kind, length, speed, acceleration, jerk=None):
    """The baseline timing of one axis on a straight line."""
    path, shapes = straight(length), PATH_SHAPES[kind]
    axes = [Axis("x", max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)]
    limits = tuple(limits_of(path, axes, shapes.order))
    return solve_goal(
        RunCertifier(path, limits, shapes.order, ClassicalFamily(shapes, uniform=False))
    )


MOVES = [
    (1.0, 1.0, 2.0),
    (1.0, 10.0, 1.0),
    (0.05, 0.02, 0.225),
    (20.0, 30.0, 0.5),
    (100.0, 0.01, 10.0),
]


@pytest.mark.parametrize(("length", "speed", "acceleration"), MOVES)
def test_on_a_straight_line_the_trapezoid_is_the_fastest_of_all(length, speed, acceleration):
    """T = L/V + V/A or 2 √(L/A). To 1e-3, of which savings are quoted."""
    found = alone("trapezoid", length, speed, acceleration)
    long = length * acceleration >= speed**2
    time = length / speed + speed / acceleration if long else 2 * np.sqrt(length / acceleration)
    assert found.certificate.holds
    assert time * (1 - 1e-6) <= found.trajectory.duration <= time * (1 + 1e-3)


@pytest.mark.parametrize(
    ("length", "speed", "acceleration", "jerk"),
    [
        (1.0, 1.0, 2.0, 10.0),
        (0.05, 0.02, 0.225, 4.0),
        (1e-3, 0.02, 0.225, 4.0),
        (1.0, 100.0, 2.0, 10.0),
    ],
)
def test_on_a_straight_line_the_s_curve_is_the_fastest_under_a_jerk_limit(
    length, speed, acceleration, jerk
):
    """Seven pieces: T = L/V + V/A + A/J while V and A are reached; else V or A is the largest that
    is.
    """

    def ramp(v):  # how long it takes to reach the speed v
        return (
            v / acceleration + acceleration / jerk
            if v * jerk >= acceleration**2
            else 2 * np.sqrt(v / jerk)
        )

    low, high = 0.0, speed
    for _ in range(100):  # the top speed: ramps up and down make the way v · ramp(v)
        middle = (low + high) / 2
        low, high = (middle, high) if middle * ramp(middle) <= length else (low, middle)
    top = speed if speed * ramp(speed) <= length else low
    time = length / top + ramp(top)
    found = alone("s-curve", length, speed, acceleration, jerk)
    assert found.certificate.holds
    assert time * (1 - 1e-6) <= found.trajectory.duration <= time * (1 + 2e-3)
    assert set(found.certificate.worst) == {"speed", "acceleration", "jerk"}


@pytest.mark.parametrize(("length", "speed", "acceleration"), MOVES)
def test_on_a_straight_line_the_quarter_sine_is_the_fastest_of_its_kind(
    length, speed, acceleration
):
    """Its largest acceleration is V ω, at the start.

    With ω = A/V: T = L/V + (π − 2) V/A, if V is reached at all.
    """
    found = alone("quarter-sine", length, speed, acceleration)
    top = min(speed, np.sqrt(length * acceleration / 2))  # ramps alone make the way 2 V/ω
    time = length / top + (np.pi - 2) * top / acceleration
    assert found.certificate.holds
    assert time * (1 - 1e-6) <= found.trajectory.duration <= time * (1 + 1e-3)


@pytest.mark.parametrize("ramp", [0.5, 0.3, 0.01])
def test_the_quarter_sine_is_one(ramp):
    """[Sahbaz 2007, Appendix B], at instants between the parts; the error is the stated one."""
    unit, t = quarter_sine(ramp), np.linspace(0, 1, 4001)
    omega = np.pi / 2 / ramp
    top = 1 / (2 / omega + 1 - 2 * ramp)
    speed = np.where(
        t < ramp,
        top * np.sin(omega * t),
        np.where(t > 1 - ramp, top * np.cos(omega * (t - 1 + ramp)), top),
    )
    begins = np.concatenate([[0.0], np.cumsum(unit.h)])
    k = np.clip(np.searchsorted(begins, t, side="right") - 1, 0, len(unit.h) - 1)
    s, v, _, _ = unit.at(k, t - begins[k])
    stated = (np.pi / 2 / SINE_PARTS) ** 3 / 124 * top
    assert np.abs(v - speed).max() < stated
    assert s[-1] == pytest.approx(1, abs=1e-12)
    assert s[t <= ramp] == pytest.approx(
        top / omega * (1 - np.cos(omega * t[t <= ramp])), abs=stated * ramp / SINE_PARTS
    )


def test_an_s_curve_keeps_the_jerk_limit_and_is_slower_than_the_optimum(planned):
    plan = planned("bare-circle", 3)
    found = classical(plan, "s-curve")
    assert found.certificate.holds
    assert found.certificate.worst["jerk"] <= 1 + 1e-6
    assert found.duration > plan.trajectory.duration
    state = found.trajectory.at(np.linspace(0, found.duration, 2001))
    assert np.abs(state.qddd).max() <= 4 * (1 + 1e-6)


def line_to(position):
    return plan(Program((Line(np.array(position)),)), load_machine("hexapod"), order=2)


def test_synchronised_legs_start_and_stop_together_and_leave_the_line():
    """max |Δq|/V + V/A; the way of every leg by its own trapezoid, integrated here on its own."""
    made = line_to([15e-3, 5e-3, 25e-3])
    found = classical(made, "synchronised")
    q = made.machine.inverse(
        from_numbers(made.path.pose_numbers(made.path.breaks, np.zeros(2, int)))
    )
    way = q[1] - q[0]
    assert found.duration == pytest.approx(np.abs(way).max() / 0.02 + 0.02 / 0.225, rel=3e-9)
    state = found.trajectory.at(np.linspace(0, found.duration, 20001))
    assert state.q[[0, -1]] == pytest.approx(q, abs=1e-12)
    assert np.trapezoid(state.qd, state.t, axis=0) == pytest.approx(way, abs=1e-9)
    assert np.abs(state.qd).max() <= 0.02 * (1 + 1e-12)
    assert np.abs(state.qdd).max() <= 0.225 * (1 + 1e-12)
    assert (np.abs(state.qd[1:-1]) > 0).all()  # every leg from the start to the end
    assert found.certificate.holds
    # the straight line in the legs is none in space; held against the legs' forward kinematics at
    # half the time
    half = (
        made.machine.forward(found.trajectory.at(found.duration / 2).q[0]).pose.translation
        - made.machine.home.translation
    )
    direction = np.array([15e-3, 5e-3, 25e-3]) / np.linalg.norm([15e-3, 5e-3, 25e-3])
    off = np.linalg.norm(half - half @ direction * direction)
    assert 0 < off <= found.deviation.distance * (1 + 1e-6) < 1e-3
    assert found.deviation.place.segment == 1


def test_independent_axes_end_each_in_their_own_time():
    """d/V + V/A or 2 √(d/A) for each leg."""
    made = line_to([15e-3, 5e-3, 25e-3])
    found = classical(made, "independent")
    q = made.machine.inverse(
        from_numbers(made.path.pose_numbers(made.path.breaks, np.zeros(2, int)))
    )
    way = np.abs(q[1] - q[0])
    long = way * 0.225 >= 0.02**2
    expected = np.where(long, way / 0.02 + 0.02 / 0.225, 2 * np.sqrt(way / 0.225))
    assert found.duration == pytest.approx(expected.max(), rel=3e-9)
    just_before, after = (
        found.trajectory.at(expected + d).qd for d in (-1e-3 * expected.min(), 1e-8)
    )
    assert (np.abs(np.diag(just_before)) > 0).all()
    assert np.abs(np.diag(after)).max() < 1e-12
    assert (
        found.duration <= classical(made, "synchronised").duration < made.trajectory.duration * 1.5
    )
    # legs in step stay nearer to the line than legs on their own
    assert found.deviation.distance > classical(made, "synchronised").deviation.distance


def test_a_circle_from_pose_to_pose_is_not_run(planned):
    """Its ends are one pose: nothing moves there, and the deviation is the diameter."""
    found = classical(planned("circle", 2), "synchronised")
    assert found.deviation.distance == pytest.approx(0.03, rel=1e-3)
    with pytest.raises(MotionError, match="does not move"):
        classical(planned("bare-circle", 2), "independent")


def test_what_cannot_be_timed_says_so(planned, hexapod):
    with pytest.raises(MotionError, match="quarter-sine"):
        classical(planned("bare-circle", 2), "cosine")
    machine = hexapod.driven_by(replace(axis, max_jerk=None) for axis in hexapod.axes)
    bare = replace(planned("bare-circle", 2), machine=machine)
    with pytest.raises(MotionError, match="jerk"):
        classical(bare, "s-curve")


def test_moves_between_poses_run_every_repetition(hexapod):
    """Half a circle there and half back: twice the segment takes twice the time, and a full one
    does not move.
    """
    start = RigidTransform.from_translation([0.01, 0, 0.03])
    half = Arc([0, 0, 0.03], [0, 0, 1], np.pi)
    once, twice = (plan(Program([half], start=start, repeat=n), hexapod, order=2) for n in (1, 2))
    for kind in ("synchronised", "independent"):
        assert classical(twice, kind).duration == pytest.approx(
            2 * classical(once, kind).duration, rel=1e-6
        )
