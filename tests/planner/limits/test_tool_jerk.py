"""The tool's jerk, and third derivatives of the pose in states, enclosures, ranges and points."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, load_machine
from planner import Arc, Blend, Line, Program, Spline, load_program, plan
from planner.certificate import Cells, bound_series, enclose, enclose_along_path
from planner.certificate.path_enclosure import GroupEnclosure
from planner.limits.tool import ToolJerk
from planner.path.actuation import make_points

TOOL = RigidTransform.from_translation([0.01, 0.005, 0.04])
START = RigidTransform.from_components([0.01, 0.005, 0.07], Rotation.identity())


@pytest.fixture(scope="module")
def made(hexapod):
    """A motion that turns and bends, of a tool beside the platform's origin."""
    segments = [
        Line([0.015, 0.009, 0.07], Rotation.from_rotvec([0.03, -0.02, 0.05])),
        Arc([0.015, 0.004, 0.07], [0, 0, 1], 1.2, rise=0.002),
    ]
    return plan(Program(segments, start=START, tool=TOOL), hexapod, order=3)


def instants(trajectory, count=60):
    """Well inside time pieces: s⃛ jumps at their ends."""
    long = np.flatnonzero(np.diff(trajectory.knots) > 1e-4)
    k = long[:: max(1, len(long) // count)]
    return (trajectory.knots[k] + trajectory.knots[k + 1]) / 2


def test_the_third_derivative_is_that_of_the_second(made):
    """By central differences of 1 µs: of poses, of the tool and of the platform."""
    trajectory, h = made.trajectory, 1e-6
    t = instants(trajectory)
    for rate in ("pose_rate", "tool_rate"):
        before, after = (getattr(trajectory.at(t + shift), rate)(2) for shift in (-h, h))
        third = getattr(trajectory.at(t), rate)(3)
        assert np.abs(third).max() > 0.1
        assert third == pytest.approx((after - before) / (2 * h), abs=1e-5 * np.abs(third).max())


@pytest.mark.parametrize("times", [4, 7, -1, 1.5, "3", True])
def test_other_orders_are_refused(made, times):
    trajectory = made.trajectory
    cells = Cells(np.array([0]), np.zeros(1), np.diff(trajectory.knots)[:1])
    for motion in (
        trajectory.at(0.1),
        enclose(trajectory, cells, 6),
        enclose_along_path(trajectory, cells, 3),
    ):
        for rate in (motion.pose_rate, motion.tool_rate):
            with pytest.raises(MotionError, match=r"of a pose is not supported: give 0, 1, 2 or 3"):
                rate(times)


def test_enclosures_and_ranges_hold_it(made):
    """At places inside cells, of single ones and of groups."""
    trajectory = made.trajectory
    k = np.arange(len(trajectory.s))[:: max(1, len(trajectory.s) // 50)]
    width = np.diff(trajectory.knots)[k]
    cells = Cells(k, np.zeros(len(k)), width)
    enclosed = bound_series(enclose(trajectory, cells, 6).tool_rate(3), len(k))
    ranges = enclose_along_path(trajectory, cells, 3)
    first = np.flatnonzero(np.diff(ranges.interval, prepend=-1))
    merged = GroupEnclosure(trajectory.path, ranges.piece[first], ranges, first)
    group = np.cumsum(np.diff(ranges.interval, prepend=-1) != 0) - 1
    balls = ranges.bound(ranges.tool_rate(3))
    wide = tuple(each[group] for each in merged.bound(merged.tool_rate(3)))
    size = np.abs(enclosed[1]).max()
    for share in (0.0, 0.3, 0.5, 1.0):
        third = trajectory.within(k, share * width).tool_rate(3)
        for low, high in (enclosed, balls, wide):
            assert (low - 1e-9 * size <= third).all()
            assert (third <= high + 1e-9 * size).all()
    assert (enclosed[1] - enclosed[0]).max() < size  # it says something


@pytest.mark.parametrize("rate", ["pose_derivative", "tool_derivative"])
def test_points_have_it(made, rate):
    path = made.path
    s, piece = np.array([0.3, 0.6]) * path.breaks[1], np.zeros(2, int)
    h = 1e-6
    third = getattr(make_points(path, s, piece), rate)(3)
    second = [getattr(make_points(path, s + shift, piece, 2), rate)(2) for shift in (-h, h)]
    assert third == pytest.approx((second[1] - second[0]) / (2 * h), abs=1e-4 * np.abs(third).max())
    with pytest.raises(MotionError, match="derivative 4 of a pose is not supported"):
        getattr(make_points(path, s, piece), rate)(4)


CARTESIAN = load_machine("cartesian")


def quick(**caps):
    """The slides with no limit that binds but the tool's jerk."""
    free = {"max_speed": 10.0, "max_acceleration": 1e3, "max_jerk": None, "max_pulse_rate": None}
    return CARTESIAN.driven_by([replace(axis, **free | caps) for axis in CARTESIAN.axes])


def test_a_line_under_a_tool_jerk_alone():
    """From rest to rest with |p⃛| ≤ j: T = (32 L/j)^⅓, in any direction, by default at order 3."""
    length, jerk = 0.05, 20.0
    direction = np.array([2.0, -1, 2]) / 3
    program = Program(
        [Line(length * direction)], start=RigidTransform.identity(), max_tool_jerk=jerk
    )
    made = plan(program, quick())
    assert made.order == 3
    assert made.certificate.holds
    assert made.certificate.worst["tool jerk"] == pytest.approx(1.0, abs=1e-5)
    assert made.trajectory.duration == pytest.approx(np.cbrt(32 * length / jerk), rel=1e-3)


@pytest.mark.parametrize("rise", [0.0, 0.02])
def test_on_a_circle_and_a_helix_it_caps_the_speed(rise):
    """At constant speed v on a curve of curvature κ and torsion τ, |p⃛| = v³ κ √(κ² + τ²)."""
    radius, jerk, turn = 0.02, 2.0, 6 * np.pi
    start = RigidTransform.from_translation([radius, 0, 0])
    arc = Arc([0, 0, 0], [0, 0, 1], turn, rise=rise, max_tool_jerk=jerk)
    made = plan(Program([arc], start=start), quick())
    pitch = rise / turn
    bend, twist = radius / (radius**2 + pitch**2), pitch / (radius**2 + pitch**2)
    cruise = np.cbrt(jerk / (bend * np.hypot(bend, twist)))
    assert made.certificate.holds
    speed = np.linalg.norm(made.trajectory.at(made.trajectory.duration / 2).tool_velocity[0])
    assert speed == pytest.approx(
        cruise, rel=1e-3 if rise == 0 else 0.01
    )  # the polyhedron's 2.3 % of jerk


def test_a_blend_and_a_spline_keep_it():
    """Sampled by differences of the velocities, without the limit's own code."""
    jerk = 5.0
    segments = [
        Line([0.03, 0, 0], join=Blend(1e-3)),
        Spline([[0.04, 0.02, 0.01], [0.02, 0.03, 0.0], [0.0, 0.02, 0.01]], max_tool_jerk=jerk),
    ]
    made = plan(Program(segments, start=RigidTransform.identity(), max_tool_jerk=2 * jerk), quick())
    assert made.certificate.holds
    t, h = instants(made.trajectory, 400), 1e-5
    before, now, after = (made.trajectory.at(t + shift).tool_velocity for shift in (-h, 0, h))
    felt = np.linalg.norm(after - 2 * now + before, axis=1) / h**2
    on_spline = np.array([made.path.segment(k) == 2 for k in made.trajectory.at(t).piece])
    assert felt[on_spline].max() < jerk * (1 + 1e-3)
    assert felt.max() < 2 * jerk * (1 + 1e-3)
    assert felt.max() > 0.9 * jerk


def test_an_own_limit_can_use_it():
    class OwnJerk(ToolJerk):
        name = "own jerk"

    program = Program([Line([0.05, 0, 0])], start=RigidTransform.identity())
    made = plan(
        program, quick(), order=3, limits=[lambda machine, path: OwnJerk([20.0] * len(path.pieces))]
    )
    assert made.trajectory.duration == pytest.approx(np.cbrt(32 * 0.05 / 20), rel=0.01)


def test_a_file_states_it(tmp_path):
    file = tmp_path / "jerk.toml"
    file.write_text(
        'schema = 1\nmachine = "cartesian"\nmax_tool_jerk = "30 m/s^3"\n\n[[segment]]\n'
        'line = { to = ["10 mm", "0 mm", "0 mm"] }\n\n[[segment]]\n'
        'line = { to = ["0 mm", "0 mm", "0 mm"] }\nmax_tool_jerk = "5 m/s^3"\n',
        "utf-8",
    )
    program = load_program(file)
    assert (program.max_tool_jerk, program.segments[1].max_tool_jerk) == (30.0, 5.0)
    made = plan(program, CARTESIAN)
    assert made.order == 3
    assert made.certificate.worst["tool jerk"] <= 1
    with pytest.raises(MotionError, match="max_tool_jerk"):
        Program([Line([0.01, 0, 0])], max_tool_jerk=-1.0)
