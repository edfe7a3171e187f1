"""Splines: through their points, smooth to the fourth derivative, with a parameter that is nearly path length."""

from math import factorial

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, MotionError
from planner import Line, Program, Spline, plan
from planner.path.actuation import actuate

START = RigidTransform.from_components([0.0, 0, 0.25], Rotation.from_rotvec([0.02, -0.01, 0.03]))
POINTS = [[0.004, 0.003, 0.25], [0.009, 0.001, 0.252], [0.012, 0.005, 0.251], [0.008, 0.012, 0.25]]
VECTORS = [[0.1, 0, 0], [0.1, 0.1, 0], [0, 0.2, -0.1], [0.05, 0, 0.3]]


def drawn(machine, spline, frame="base", start=START):
    return actuate(Program([spline], start=start, frame=frame), machine)


def at(path, s, piece):
    numbers = path.pose_numbers(np.asarray(s, float), np.asarray(piece))
    return numbers[:, :3], numbers[:, 3:].reshape(-1, 3, 3)


steps = st.tuples(*[st.floats(-0.01, 0.01)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.001)
turns = st.tuples(*[st.floats(-0.5, 0.5)] * 3).map(Rotation.from_rotvec)


@st.composite
def splines(draw):
    walk = draw(st.lists(steps, min_size=1, max_size=8))
    rotate = None
    if draw(st.booleans()):
        rotate = Rotation.concatenate([draw(turns) for _ in walk])
    return Spline(START.translation + np.cumsum(walk, axis=0), rotate)


@settings(max_examples=40, deadline=None)
@given(spline=splines())
def test_it_passes_through_its_points_in_their_orientations(hexapod, spline):
    try:
        path = drawn(hexapod, spline)
    except MotionError as refusal:
        assume("turns back" not in str(refusal))
        raise
    count = len(spline.through)
    assert len(path.pieces) == count
    for side in (0, 1):  # at the start and the end of each piece
        position, rotation = at(path, path.breaks[side : count + side], np.arange(count))
        points = np.concatenate([START.translation[None], spline.through])
        assert np.abs(position - points[side : count + side]).max() < 1e-14 * (path.breaks[-1] + np.abs(points).max())
        kept = Rotation.concatenate([START.rotation] * count) if spline.rotate is None else spline.rotate
        turned = Rotation.concatenate([START.rotation, kept]).as_matrix()
        assert np.abs(rotation - turned[side : count + side]).max() < 1e-12
    # the joints between the spans are no joints for the motion: three derivatives of the pose and of the legs agree
    inner = np.arange(1, count)
    for evaluate in (path.pose_derivatives, path.derivatives):
        left, right = evaluate(path.breaks[inner], inner - 1), evaluate(path.breaks[inner], inner)
        for k in range(4):
            # a line's curvature is zero but for rounding: against that of the shortest span
            shortest = np.diff(path.breaks).min()
            size = max(np.abs(left[k]).max(initial=0), np.abs(right[k]).max(initial=0), shortest ** (1 - k))
            assert np.abs(left[k] - right[k]).max(initial=0) <= 1e-9 * size
    assert not path.stops(3)[1:-1].any()
    assert path.stops(2)[[0, -1]].all()


def test_it_is_the_natural_quintic(hexapod):
    """Interpolating, C⁴ and straight at its ends (no 2nd and 4th derivative): that is one curve only."""
    path = drawn(hexapod, Spline(POINTS, Rotation.from_rotvec(VECTORS)))
    spans = [piece.parameters.reshape(6, 7) for piece in path.pieces]
    lengths = [piece.length for piece in path.pieces]

    def derivative(span, s, order):
        powers = [factorial(k) / factorial(k - order) * s ** (k - order) for k in range(order, 6)]
        return np.array(powers) @ span[order:]

    for k in range(5):
        size = max(np.abs(derivative(span, 0.0, k)).max() for span in spans)
        for n in range(len(spans) - 1):
            gap = derivative(spans[n], lengths[n], k) - derivative(spans[n + 1], 0.0, k)
            assert np.abs(gap).max() < 1e-9 * size
        if k in (2, 4):
            assert np.abs(derivative(spans[0], 0.0, k)).max() < 1e-9 * size
            assert np.abs(derivative(spans[-1], lengths[-1], k)).max() < 1e-9 * size


def test_points_on_a_line_make_a_line(hexapod):
    """At unit speed, however unevenly they lie; and one point is a line too."""
    direction = np.array([2.0, -1, 2]) / 3
    shares = np.array([0.001, 0.0015, 0.006, 0.01])
    path = drawn(hexapod, Spline(START.translation + shares[:, None] * direction))
    s = np.linspace(0, 0.01, 101)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, 3)
    x, x1, x2, x3 = path.pose_derivatives(s, piece)
    assert np.abs(x[:, :3] - START.translation - s[:, None] * direction).max() < 1e-15
    assert np.abs(x1[:, :3] - direction).max() < 1e-12
    assert np.abs(x2).max() * 0.01 < 1e-11
    assert np.abs(x3).max() * 0.01**2 < 1e-8
    (single,) = drawn(hexapod, Spline([START.translation + 0.01 * direction])).pieces
    assert single.length == pytest.approx(0.01, rel=1e-12)
    assert np.abs(single.derivatives(np.array([0.0, 0.005]))[1][:, :3] - direction).max() < 1e-12


def test_a_circle_s_points_give_a_circle(hexapod):
    """Points 10° apart on a radius of 10 mm: inside, the spline is a nanometre off, |dp/ds| that of arc over chord."""
    angles = np.deg2rad(np.arange(0, 361, 10))
    circle = START.translation + 0.01 * np.stack([np.sin(angles), 1 - np.cos(angles), 0 * angles], 1)
    path = drawn(hexapod, Spline(circle[1:]))
    inner = np.arange(14, 22)
    s = np.concatenate([np.linspace(path.breaks[k], path.breaks[k + 1], 21) for k in inner])
    position, slope, _, _ = path.pose_derivatives(s, np.repeat(inner, 21))
    assert np.abs(np.linalg.norm(position[:, :3] - START.translation - [0, 0.01, 0], axis=1) - 0.01).max() < 1e-9
    assert np.linalg.norm(slope[:, :3], axis=1) == pytest.approx(np.deg2rad(5) / np.sin(np.deg2rad(5)), rel=1e-6)


def test_orientation_is_kept_exactly_without_rotate(hexapod):
    path = drawn(hexapod, Spline(POINTS))
    s = np.linspace(path.breaks[1], path.breaks[2], 51)
    assert np.abs(at(path, s, np.full(51, 1))[1] - START.rotation.as_matrix()).max() < 1e-15
    assert not path.pose_derivatives(s, np.full(51, 1))[1][:, 3:].any()


def test_it_looks_alike_in_every_frame(hexapod):
    """The orientation, too, turns the same way wherever the machine's home points."""
    home = RigidTransform.from_components([0.01, -0.02, 0.24], Rotation.from_euler("XYZ", [10, -20, 100], degrees=True))
    machine = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=home)
    spline = Spline(POINTS, Rotation.from_rotvec(VECTORS))
    base, moved = drawn(hexapod, spline), drawn(machine, spline, frame="home")
    s, piece = np.linspace(base.breaks[1], base.breaks[2], 51), np.full(51, 1)
    position, rotation = at(base, s, piece)
    position_moved, rotation_moved = at(moved, s, piece)
    assert np.abs(home.apply(position) - position_moved).max() < 1e-14
    assert np.abs(home.rotation.as_matrix() @ rotation - rotation_moved).max() < 1e-13


def test_a_turn_by_quarters_goes_all_the_way_round(hexapod):
    """Quaternions have two signs: the side of the one before is kept over a whole turn."""
    quarters = Rotation.from_rotvec(np.outer([0.5, 1.0, 1.5, 2.0], [0, 0, np.pi]))
    start = RigidTransform.from_components(START.translation, Rotation.identity())
    path = drawn(hexapod, Spline(POINTS, quarters), start=start)
    s = np.linspace(0, path.breaks[-1], 401)
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, 3)
    heading = np.unwrap(np.arctan2(*at(path, s, piece)[1][:, [1, 0], 0].T))
    assert heading[-1] - heading[0] == pytest.approx(2 * np.pi, abs=1e-12)
    assert np.diff(heading).min() > 0


@pytest.mark.parametrize(
    ("make", "phrase"),
    [
        (
            lambda: Spline([[0, 0, 1], [1, 0, 0], [1, 0, 0]]),
            "spline: points 2 and 3 are the same; omit one of them",
        ),
        (lambda: Spline([]), "points of three finite numbers, at least one"),
        (lambda: Spline([[0, 0]]), "points of three finite numbers"),
        (lambda: Spline([[0, 0, np.inf]]), "points of three finite numbers"),
        (lambda: Spline([[0, 0, 1]], Rotation.identity(2)), "2 orientations for 1 point; give one for each"),
        (lambda: Spline([[0, 0, 1]], Rotation.identity()), None),
        (lambda: Spline([[0, 0, 1]], speed=-1), "speed -1 m/s"),
    ],
)
def test_nonsense_is_refused_with_its_name(make, phrase):
    with pytest.raises(MotionError) as refusal:
        make()
    assert (phrase or "1 orientation for") in str(refusal.value)


@pytest.mark.parametrize("order", [2, 3])
def test_a_spline_is_run_without_a_stop(hexapod, order):
    up = np.array([0, 0, 0.025])
    spline = Spline(np.array(POINTS) - [0, 0, 0.25] + up, Rotation.from_rotvec(np.array(VECTORS) / 3))
    start = RigidTransform.from_components(up, Rotation.identity())
    made = plan(Program([spline, Line([0, 0, 0.025], Rotation.identity())], start=start), hexapod, order=order)
    assert made.certificate.holds
    assert made.path.stops(order).sum() == 3
    inside = made.trajectory.at(np.linspace(0, made.trajectory.duration, 2001))
    end = made.path.breaks[4]
    assert inside.sd[(inside.s > 1e-3) & (inside.s < end - 1e-3)].min() > 1e-3
