"""Straight runs: exact to rounding, whatever the limits, the ends, the pieces and the units."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, PPoly

from kinematics import Axis, load_machine
from planner import Infeasible, Line, Program, plan, time_optimal
from planner.limits import limits_of
from planner.path.polynomial import PolynomialPath
from planner.timing import Run, Task, at_speeds, solve_run


def test_the_reference_keeps_what_it_says(seven_segments):
    """Its regimes meet: at their borders the closed forms agree, and the motion with J alone covers
    L = 2 J (T/4)³.
    """
    v, a, j = 0.7, 1.3, 9.0
    for length in (v * (v / a + a / j), 2 * a**3 / j**2):
        below, above = (
            seven_segments(length * (1 - 1e-12), v, a, j),
            seven_segments(length * (1 + 1e-12), v, a, j),
        )
        assert below == pytest.approx(above, rel=1e-10)
    assert 2 * j * (seven_segments(1e-3, v, a, j) / 4) ** 3 == pytest.approx(1e-3)


def line(*ends, pace=1.0, pieces=1):
    """q from the origin to `ends`, over a parameter of length `pace`, in so many pieces."""
    breaks = np.linspace(0.0, pace, pieces + 1)
    c = np.zeros((2, pieces, len(ends)))
    c[0], c[1] = np.array(ends) / pace, np.outer(breaks[:-1] / pace, ends)
    return PPoly(c, breaks)


positive = st.floats(-3, 3).map(lambda x: 10**x)


@given(length=positive, speed=positive, acceleration=positive, jerk=positive)
@settings(max_examples=60, deadline=None)
def test_one_axis_is_exact(seven_segments, length, speed, acceleration, jerk):
    found = time_optimal(
        line(length), max_speed=speed, max_acceleration=acceleration, max_jerk=jerk
    )
    assert found.methods == ("straight",)
    assert found.rounds == 1
    time = seven_segments(length, speed, acceleration, jerk)
    assert found.trajectory.duration == pytest.approx(time, rel=1e-9)


@given(positive, positive, positive)
@settings(max_examples=30, deadline=None)
def test_without_jerk_it_is_the_trapezoid(length, speed, acceleration):
    found = time_optimal(line(length), max_speed=speed, max_acceleration=acceleration)
    reached = speed**2 <= length * acceleration
    time = length / speed + speed / acceleration if reached else 2 * np.sqrt(length / acceleration)
    assert found.trajectory.duration == pytest.approx(time, rel=1e-9)


@pytest.mark.parametrize("pace", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("pieces", [1, 3, 40])
def test_the_tightest_axis_counts_and_pieces_do_not(pieces, pace, seven_segments):
    """Axis 0 is slow, axis 1 lazy, axis 2 jerky: V, A and J along the way are one axis' each."""
    ends, speeds, pushes, jerks = (
        [0.3, -0.2, 0.1],
        [0.1, 9.0, 9.0],
        [9.0, 0.04, 9.0],
        [900.0, 90.0, 0.02],
    )
    found = time_optimal(
        line(*ends, pace=pace, pieces=pieces),
        max_speed=speeds,
        max_acceleration=pushes,
        max_jerk=jerks,
    )
    assert found.methods == ("straight",)
    assert found.trajectory.duration == pytest.approx(
        seven_segments(1.0, 0.1 / 0.3, 0.04 / 0.2, 0.02 / 0.1), rel=1e-9
    )
    assert set(found.trajectory.piece) == set(range(pieces))


@pytest.mark.parametrize("length", [1e-9, 1e-7, 1e-4])
@pytest.mark.parametrize("limit", [100.0, 10_000.0])
@pytest.mark.parametrize("jerk", [None, 1e6])
def test_tiny_motions_with_huge_limits(length, limit, jerk, seven_segments):
    found = time_optimal(line(length), max_speed=limit, max_acceleration=limit, max_jerk=jerk)
    time = (
        2 * np.sqrt(length / limit) if jerk is None else seven_segments(length, limit, limit, jerk)
    )
    assert found.trajectory.duration == pytest.approx(time, rel=1e-9)
    assert found.certificate.holds


@given(positive, st.floats(0, 1), st.floats(0, 1), st.sampled_from([2, 3]))
@settings(max_examples=60, deadline=None)
def test_between_speeds_the_motion_arrives_in_one_piece(length, start, end, order):
    """V = A = 1, J = 3: continuous, within its limits, at its ends; or the told speed is what just
    can be.
    """
    curve = line(length, pace=length, pieces=2)
    path = PolynomialPath(curve.x, curve.c, ["x"])
    limits = limits_of(path, [Axis("x", max_speed=1.0, max_acceleration=1.0, max_jerk=3.0)], order)
    try:
        p = solve_run(Task(path, limits, Run(0, 1, at_speeds(start, end)), order)).require_profile()
    except Infeasible as no:
        less = [no.limit * (1 - 1e-9) if v == no.value else v for v in (start, end)]
        p = solve_run(Task(path, limits, Run(0, 1, at_speeds(*less)), order)).require_profile()
        start, end = less
    ends = [
        p.s + p.h * (p.v + p.h * (p.a / 2 + p.h * p.j / 6)),
        p.v + p.h * (p.a + p.h * p.j / 2),
        p.a + p.h * p.j,
    ]
    assert np.append(ends[0], length) == pytest.approx(
        np.append(p.s[1:], [length, length]), abs=1e-12 * length
    )
    assert np.append(start, ends[1]) == pytest.approx(np.append(p.v, end), abs=1e-12)
    if order == 3:
        assert np.append(0.0, ends[2]) == pytest.approx(np.append(p.a, 0.0), abs=1e-9)
        assert np.abs(p.j).max() <= 3.0 * (1 + 1e-9)
    assert max(p.v.max(), ends[1].max()) <= 1 + 1e-9
    assert max(np.abs(p.a).max(), np.abs(ends[2]).max()) <= 1 + 1e-9


def test_a_bend_is_not_straight():
    bent = CubicSpline([0.0, 0.5, 1.0], [[0.0, 0.0], [0.5, 1e-6], [1.0, 0.0]], bc_type="natural")
    found = time_optimal(bent, max_speed=1.0, max_acceleration=1.0, max_jerk=10.0)
    assert found.methods[0].startswith("riccati")


def test_slides_that_move_together():
    """A machine whose axes are straight: X and Y at 0.3 in/s² over 0.3 and 0.4 in is 2 √(0.4/0.3)
    s.
    """
    inch = 0.0254
    found = plan(Program([Line(to=(0.3 * inch, 0.4 * inch, 0.0))]), load_machine("traverser"))
    assert found.methods == ("straight",)
    assert found.trajectory.duration == pytest.approx(2 * np.sqrt(0.4 / 0.3), rel=1e-9)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_ramp_too_long_for_its_way_slows_down_first(backwards):
    """Slower it goes less far in more time: ruckig's motion of these numbers turns from −K to J
    before s̈ is back at 0.

    Above the largest speed that this reaches, more than the straight ramp does, the refusal tells
    it.
    """
    length, slow, fast = 0.23404740205613703, 0.07262080343590753, 0.7438943840464933
    limits = {"max_speed": 2.05729146, "max_acceleration": 8.65231728, "max_jerk": 8.08863146}
    path = PPoly(np.array([[[1.0]], [[0.0]]]), [0.0, length])

    def solve(fast):
        ends = (
            {"start_speed": fast, "end_speed": slow}
            if backwards
            else {"start_speed": slow, "end_speed": fast}
        )
        return time_optimal(path, **limits, **ends)

    found = solve(fast)
    assert found.certificate.holds
    assert found.methods == ("straight",)
    assert found.trajectory.duration == pytest.approx(0.7815239623, rel=1e-8)
    turned = found.trajectory.at(
        [found.trajectory.duration - 0.08919133596 if backwards else 0.08919133596]
    )
    assert turned.qd.item() == pytest.approx(0.04044788998, rel=1e-5)
    with pytest.raises(Infeasible) as refused:
        solve(0.8)
    largest = refused.value.limit
    assert fast < largest < 0.8
    assert solve(largest * (1 - 1e-6)).certificate.holds
    with pytest.raises(Infeasible):
        solve(largest * (1 + 1e-6))


@pytest.mark.parametrize(
    ("speed", "acceleration", "jerk"),
    [(1.0, 1e16, None), (1.0, 1.0, 1e16), (1.0, 1.0, 1e18), (1e-12, 1.0, 10.0), (1e-12, 1.0, None)],
)
def test_ramps_that_instants_cannot_tell_apart_are_lengthened(speed, acceleration, jerk):
    """They were refused as a bug of the planner.

    The duration may grow by a few 1e-9, and no more.
    """
    found = time_optimal(line(1.0), max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
    reached = speed**2 <= acceleration
    exact = 1 / speed + speed / acceleration if reached else 2 * np.sqrt(1 / acceleration)
    assert found.certificate.holds
    assert exact * (1 - 1e-12) <= found.trajectory.duration <= exact * (1 + 1e-7)
