"""Splines: through their points and near their polygon, with three continuous derivatives by nearly
their length.
"""

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod, MotionError
from planner import Line, Program, Spline, plan
from planner.path.actuation import actuate
from planner.path.spline import spline

START = RigidTransform.from_components([0.0, 0, 0.25], Rotation.from_rotvec([0.02, -0.01, 0.03]))
POINTS = [[0.004, 0.003, 0.25], [0.009, 0.001, 0.252], [0.012, 0.005, 0.251], [0.008, 0.012, 0.25]]
VECTORS = [[0.1, 0, 0], [0.1, 0.1, 0], [0, 0.2, -0.1], [0.05, 0, 0.3]]


def drawn(machine, spline, frame="base", start=START):
    return actuate(Program([spline], start=start, frame=frame), machine)


def at(path, s, piece):
    numbers = path.pose_numbers(np.asarray(s, float), np.asarray(piece))
    return numbers[:, :3], numbers[:, 3:].reshape(-1, 3, 3)


steps = (
    st.tuples(*[st.floats(-0.01, 0.01)] * 3)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) > 0.001)
)
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
    points = np.concatenate([START.translation[None], spline.through])
    kept = (
        Rotation.concatenate([START.rotation] * len(spline.through))
        if spline.rotate is None
        else spline.rotate
    )
    turned = Rotation.concatenate([START.rotation, kept]).as_matrix()
    count = len(path.pieces)
    for side in (
        0,
        1,
    ):  # at the start and the end of each piece: spans that bend sharply have several
        position, rotation = at(path, path.breaks[side : count + side], np.arange(count))
        away = np.linalg.norm(position[:, None] - points[side : len(points) - 1 + side], axis=2)
        nearest = away.argmin(0)
        assert (np.diff(nearest) > 0).all()
        assert away.min(0).max() < 1e-14 * (path.breaks[-1] + np.abs(points).max())
        assert np.abs(rotation[nearest] - turned[side : len(points) - 1 + side]).max() < 1e-12
    # the joints between the spans are no joints for the motion: three derivatives of the pose and
    # of the legs agree
    inner = np.arange(1, count)
    for evaluate in (path.pose_derivatives, path.derivatives):
        left, right = evaluate(path.breaks[inner], inner - 1), evaluate(path.breaks[inner], inner)
        for k in range(4):
            # a line's curvature is zero but for rounding: against that of the shortest span
            shortest = np.diff(path.breaks).min()
            size = max(
                np.abs(left[k]).max(initial=0), np.abs(right[k]).max(initial=0), shortest ** (1 - k)
            )
            assert np.abs(left[k] - right[k]).max(initial=0) <= 1e-9 * size
    assert not path.stops(3)[1:-1].any()
    assert path.stops(2)[[0, -1]].all()


def test_it_is_straight_at_its_ends(hexapod):
    path = drawn(hexapod, Spline(POINTS, Rotation.from_rotvec(VECTORS)))
    x2 = path.pose_derivatives(path.breaks[[0, -1]], np.array([0, len(path.pieces) - 1]))[2]
    assert np.abs(x2[:, :3]).max() * path.breaks[-1] < 1e-9


def polygon_distance(points, corners):
    """(N,) distance of points from the polygon through corners."""
    sides = zip(corners[:-1], np.diff(corners, axis=0), strict=True)
    shares = (
        (begin, side, np.clip((points - begin) @ side / (side @ side), 0, 1))
        for begin, side in sides
    )
    return np.min(
        [
            np.linalg.norm(points - begin - share[:, None] * side, axis=1)
            for begin, side, share in shares
        ],
        0,
    )


ZIGZAG = [[0, 0, 0], [1, 0.1, 0], [2, -0.1, 0], [3, 0.1, 0]]
UNEVEN = {
    "a last span of 20": [*ZIGZAG, [23, 0, 0], [43, 0, 0]],
    "a first span of 20": [*ZIGZAG, [23, 0, 0], [43, 0, 0]][::-1],
    "a last span of 1000": [*ZIGZAG, [1003, 0, 0]],
    "a long span inside": [
        [0, 0, 0],
        [1, 0.2, 0],
        [2, 0, 0],
        [202, 0, 0],
        [203, 0.2, 0.1],
        [204, 0, 0],
    ],
    "points 1e-3 apart": [
        [0, 0, 0],
        [1, 0.1, 0],
        [1, 0.101, 0],
        [2, 0.2, 0],
        [5, 0, 1],
        [5.001, 0, 1],
        [9, 0, 0],
    ],
    "geometric": [[2.0**k, (-1.0) ** k * 0.3 * 2.0**k, 0] for k in range(8)],
}


@pytest.mark.parametrize("scale", [1e-5, 1e-3])
@pytest.mark.parametrize("corners", UNEVEN.values(), ids=UNEVEN.keys())
def test_it_stays_as_near_to_the_polygon_as_the_centripetal_cubic(corners, scale):
    """That cubic is scipy's; it leaves no chord by more than three quarters of its length."""
    corners = np.array(corners) * scale
    start = RigidTransform.from_components(corners[0], Rotation.identity())
    pieces = spline(start, corners[1:], None, 1)
    chords = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    u = np.concatenate([[0.0], np.cumsum(np.sqrt(chords))])
    cubic = CubicSpline(u, corners, bc_type="natural")
    reference = polygon_distance(cubic(np.linspace(0, u[-1], 4001)), corners).max()
    for piece in pieces:
        x, x1, _, _ = piece.derivatives(np.linspace(0, piece.length, 101))
        away = polygon_distance(x[:, :3], corners)
        assert away.max() < 1.4 * reference
        assert np.linalg.norm(x1[:, :3], axis=1) == pytest.approx(1, abs=0.05)
    for one, other in itertools.pairwise(pieces):
        shorter = min(one.length, other.length)
        left, right = one.derivatives(np.array([one.length])), other.derivatives(np.zeros(1))
        for k in range(4):
            assert np.abs(left[k] - right[k]).max() * shorter ** (k - 1) < 1e-7


@pytest.mark.parametrize("angles", [[0, 60, 60, 60], [60, 60, 0, 0], [0, 0, 90, 90], [0, 0, 0, 0]])
def test_an_orientation_that_changes_over_a_short_chord_stays_on_the_long_ones(angles):
    """By the chords alone the quaternion swung through half a turn; it may pass what is asked for
    by a tenth.
    """
    corners = np.array([[10, 0, 0], [10.1, 0, 0], [110, 0, 0], [210, 5, 0]]) * 1e-3
    pieces = spline(
        RigidTransform.identity(),
        corners,
        Rotation.from_euler("z", np.transpose([angles]), True),
        1,
    )
    headings = []
    for piece in pieces:
        x = piece.poses(np.linspace(0, piece.length, 101))
        headings.append(np.degrees(np.arctan2(x[:, 6], x[:, 3])))
    swing = 0.1 * np.ptp([0, *angles])
    assert np.concatenate(headings).min() >= min(0, *angles) - swing - 1e-9
    assert np.concatenate(headings).max() <= max(0, *angles) + swing + 1e-9


@pytest.mark.parametrize(
    ("corners", "phrase"),
    [
        (
            [[0, 0, 0], [1e-5, 0, 0], [3, 1, 0], [6, 0, 0]],
            "its start and point 1 are 1e-05 mm apart",
        ),
        (
            [[0, 0, 0], [2, 0, 0], [3, 1, 0], [3, 1 + 1e-5, 0], [6, 0, 0]],
            "point 2 and point 3 are 1e-05 mm apart",
        ),
        (
            [[0, 0, 0], [2, 0, 0], [900, 1, 0], [900, 1.00004, 0]],
            "point 2 and point 3 are 4e-05 mm apart",
        ),
    ],
)
def test_near_duplicates_are_refused_by_naming_both(hexapod, corners, phrase):
    points = 1e-3 * np.array(corners) + np.array([0, 0, 0.25])
    start = RigidTransform.from_components(points[0], Rotation.identity())
    program = Program([Spline(points[1:])], start=start, frame="base")
    with pytest.raises(MotionError, match=f"segment 1, spline: {phrase}.*omit one"):
        actuate(program, hexapod)


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
    """Points 10° apart on a radius of 10 mm: inside, the spline is a nanometre off, and its
    parameter is its length.
    """
    angles = np.deg2rad(np.arange(0, 361, 10))
    circle = START.translation + 0.01 * np.stack(
        [np.sin(angles), 1 - np.cos(angles), 0 * angles], 1
    )
    path = drawn(hexapod, Spline(circle[1:]))
    inner = np.arange(14, 22)
    s = np.concatenate([np.linspace(path.breaks[k], path.breaks[k + 1], 21) for k in inner])
    position, slope, _, _ = path.pose_derivatives(s, np.repeat(inner, 21))
    assert (
        np.abs(
            np.linalg.norm(position[:, :3] - START.translation - [0, 0.01, 0], axis=1) - 0.01
        ).max()
        < 1e-9
    )
    assert np.linalg.norm(slope[:, :3], axis=1) == pytest.approx(1, abs=1e-9)


def test_orientation_is_kept_exactly_without_rotate(hexapod):
    path = drawn(hexapod, Spline(POINTS))
    s = np.linspace(path.breaks[1], path.breaks[2], 51)
    assert np.abs(at(path, s, np.full(51, 1))[1] - START.rotation.as_matrix()).max() < 1e-15
    assert not path.pose_derivatives(s, np.full(51, 1))[1][:, 3:].any()


def test_it_looks_alike_in_every_frame(hexapod):
    """The orientation, too, turns the same way wherever the machine's home points."""
    home = RigidTransform.from_components(
        [0.01, -0.02, 0.24], Rotation.from_euler("XYZ", [10, -20, 100], degrees=True)
    )
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
    piece = np.clip(np.searchsorted(path.breaks, s, side="right") - 1, 0, len(path.pieces) - 1)
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
        (
            lambda: Spline([[0, 0, 1]], Rotation.identity(2)),
            "2 orientations for 1 point; give one for each",
        ),
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
    spline = Spline(
        np.array(POINTS) - [0, 0, 0.25] + up, Rotation.from_rotvec(np.array(VECTORS) / 3)
    )
    start = RigidTransform.from_components(up, Rotation.identity())
    made = plan(
        Program([spline, Line([0, 0, 0.025], Rotation.identity())], start=start),
        hexapod,
        order=order,
    )
    assert made.certificate.holds
    assert made.path.stops(order).sum() == 3
    inside = made.trajectory.at(np.linspace(0, made.trajectory.duration, 2001))
    end = made.path.breaks[4]
    assert inside.sd[(inside.s > 1e-3) & (inside.s < end - 1e-3)].min() > 1e-3
