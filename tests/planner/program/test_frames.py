"""Tool and work frames: coordinates say where the tool goes, the machine gets the platform that
takes it there.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import MotionError, load_machine
from planner import Arc, Line, Program, Trajectory, plan
from planner.certificate import Cells, bound_series, enclose
from planner.path.actuation import actuate

# Some roundings of coordinates of decimetres, put together from four transforms.
ROUNDING = 1e-15

FAR = np.array([0.3, 0.0, 0.0])

lengths = st.tuples(*[st.floats(-0.1, 0.1)] * 3)
angles = st.tuples(*[st.floats(-3.0, 3.0)] * 3)
frames = st.builds(
    lambda p, a: RigidTransform.from_components(p, Rotation.from_euler("XYZ", a)), lengths, angles
)


def matrices(path, s, piece):
    """(N, 4, 4) of the platform."""
    x = path.pose_numbers(s, piece)
    out = np.tile(np.eye(4), (len(x), 1, 1))
    out[:, :3, 3], out[:, :3, :3] = x[:, :3], x[:, 3:].reshape(-1, 3, 3)
    return out


def walked(path):
    s = np.linspace(path.breaks[0], path.breaks[-1], 41)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.breaks) - 2)
    return s, piece


@settings(max_examples=15, deadline=None)
@given(tool=frames, work=frames, start=frames, end=frames, frame=st.sampled_from(["home", "base"]))
def test_the_platform_goes_where_the_tool_frame_asks(hexapod, tool, work, start, end, frame):
    """Base · work · (pose asked for) = platform · tool, by matrices of 4 × 4 written out here."""
    segments = (Line(end.translation + FAR, end.rotation), Line(start.translation, start.rotation))
    path = actuate(Program(segments, frame, start, tool=tool, work=work), hexapod)
    base = (hexapod.home.as_matrix() if frame == "home" else np.eye(4)) @ work.as_matrix()
    s, piece = walked(path)
    tool_in_work = np.linalg.inv(base) @ matrices(path, s, piece) @ tool.as_matrix()
    first, length = start.translation, path.breaks[1]
    to = end.translation + FAR
    assert length == pytest.approx(
        np.linalg.norm(to - first), rel=1e-12
    )  # of the tool's way, not the platform's
    on_line = first + (to - first) * (1 - np.abs(1 - s / length))[:, None]
    assert np.abs(tool_in_work[:, :3, 3] - on_line).max() < 10 * ROUNDING
    assert np.abs(tool_in_work[0, :3, :3] - start.as_matrix()[:3, :3]).max() < 10 * ROUNDING
    corner = base @ to_matrix(to, end.rotation) @ np.linalg.inv(tool.as_matrix())
    assert np.abs(matrices(path, np.array([length]), np.array([0]))[0] - corner).max() < 1e-13
    assert np.abs(tool_in_work[-1, :3, :3] - start.as_matrix()[:3, :3]).max() < 1e-13


def to_matrix(position, rotation):
    return RigidTransform.from_components(position, rotation).as_matrix()


@given(tool=frames, work=frames)
@settings(max_examples=10, deadline=None)
def test_without_a_start_the_platform_starts_at_home(hexapod, tool, work):
    for frame in ("home", "base"):
        path = actuate(Program((Line([0.5, 0.5, 0.5]),), frame, tool=tool, work=work), hexapod)
        assert (
            np.abs(
                matrices(path, np.zeros(1), np.zeros(1, int))[0] - hexapod.home.as_matrix()
            ).max()
            < 1e-14
        )


def test_frames_that_move_nothing_change_nothing(hexapod):
    segments = (Arc([0, 0, 0.025], [0, 0, 1], 4.0, Rotation.from_euler("XYZ", [0.1, 0.05, -0.2])),)
    start = RigidTransform.from_components([0.015, 0, 0.025], Rotation.identity())
    bare = actuate(Program(segments, start=start), hexapod)
    identity = RigidTransform.identity()
    framed = actuate(Program(segments, start=start, tool=identity, work=identity), hexapod)
    s, piece = walked(bare)
    for one, other in zip(bare.derivatives(s, piece), framed.derivatives(s, piece), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-13 * np.abs(one).max())


TOOL = RigidTransform.from_components(
    [0.01, -0.02, 0.08], Rotation.from_euler("XYZ", [0.3, -0.2, 0.5])
)
WORK = RigidTransform.from_components(
    [0.01, -0.02, 0.105], Rotation.from_euler("XYZ", [0.02, 0.03, -0.1])
)
SWUNG = TOOL.rotation * Rotation.from_euler("XYZ", [0.06, -0.05, 0.1])


@pytest.fixture(scope="module")
def swung(hexapod):
    """A tool 80 mm above the platform on an arc of 8 mm, turning, its speed capped."""
    start = RigidTransform.from_components([0.008, 0, 0], TOOL.rotation)
    segments = (Arc([0, 0, 0], [0, 0, 1], 3.5, SWUNG, speed=0.012),)
    return plan(Program(segments, start=start, tool=TOOL, work=WORK), hexapod, order=2)


def test_the_cap_is_on_the_tool(swung):
    trajectory = swung.trajectory
    t = np.linspace(0, trajectory.duration, 20001)
    state = trajectory.at(t)
    assert (
        np.abs(swung.machine.inverse(state.pose) - state.q).max() < ROUNDING
    )  # the pose is the platform's
    tool = (state.pose * TOOL).translation
    speed = np.linalg.norm(np.gradient(tool, t, axis=0, edge_order=2), axis=1)
    h = t[1] - t[0]
    assert speed.max() == pytest.approx(
        0.012, abs=h * 0.2
    )  # second differences miss by less than h · acceleration
    np.testing.assert_allclose(np.linalg.norm(state.tool_velocity, axis=1), speed, atol=h * 0.2)
    np.testing.assert_allclose(state.sd, np.linalg.norm(state.tool_velocity, axis=1), atol=1e-12)
    origin = np.linalg.norm(np.gradient(state.pose.translation, t, axis=0), axis=1)
    assert (
        origin.max() > 1.1 * 0.012
    )  # the platform's own speed is another: a cap on it would hold the tool back
    assert swung.certificate.worst["tool speed"] == pytest.approx(1, abs=1e-6)


def test_enclosures_hold_the_tool(swung):
    """Velocity and acceleration of the tool at random instants lie within the bounds of their
    cells.
    """
    trajectory = swung.trajectory
    rng = np.random.default_rng(5)
    k = rng.integers(0, len(trajectory.s), 40)
    h = np.diff(trajectory.knots)[k]
    lo = rng.uniform(0, 0.5, 40) * h
    hi = lo + rng.uniform(0.1, 0.5, 40) * h
    cells = Cells(k, lo, hi)
    enclosure = enclose(trajectory, cells, 6)
    for times in (0, 1, 2):
        low, high = bound_series(enclosure.tool_rate(times), 40)
        assert (high - low).max() < 1e-2
        for share in (0.0, 0.37, 1.0):
            value = trajectory.within(k, lo + share * (hi - lo)).tool_rate(times)
            slack = 1e-13 * np.abs(value).max()  # of the numbers that are held against the bounds
            assert ((low - slack <= value) & (value <= high + slack)).all()


def test_tool_rates_are_derivatives_of_the_tool(hexapod):
    """Twice central differences of the tool's numbers, h² and rounding/h² off, along a steady
    walk.
    """
    start = RigidTransform.from_components([0.008, 0, 0], TOOL.rotation)
    path = actuate(
        Program((Arc([0, 0, 0], [0, 0, 1], 3.5, SWUNG),), start=start, tool=TOOL, work=WORK),
        hexapod,
    )
    length = path.breaks[-1]
    walk = Trajectory(path, np.array([0, 1.0]), np.zeros(1), np.array([length / 3]), np.array([2 * length / 3]) * 2,
                      np.zeros(1) - length * 0, np.zeros(1, int))  # fmt: skip
    t, h = np.linspace(0.1, 0.6, 21), 1e-4
    before, now, after = (walk.at(t + shift).tool_rate(0) for shift in (-h, 0, h))
    np.testing.assert_allclose(walk.at(t).tool_rate(1), (after - before) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(
        walk.at(t).tool_rate(2), (after - 2 * now + before) / h**2, atol=1e-5
    )


def test_a_lever_that_no_axis_turns_is_refused():
    linkage = load_machine("linkage")
    lever = RigidTransform.from_components([0, 0, 0.05], Rotation.identity())
    with pytest.raises(MotionError, match=r"does not control .* 50\] mm off the platform's origin"):
        actuate(Program((Line([0.01, 0, 0]),), tool=lever), linkage)
