"""Blends: smooth to the third derivative, as far from the corner as the tolerance says, in position
and orientation.
"""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Hexapod
from planner import Arc, Blend, Dwell, Line, Program, Spline, Stop, Through, Turn, check, plan
from planner.path.actuation import actuate
from planner.program.joins import stop_at_joins

START = RigidTransform.from_components([0.0, 0, 0.25], Rotation.identity())
START_FROM_HOME = RigidTransform.from_components([0.0, 0, 0.025], Rotation.identity())
TOLERANCE = 2e-5
# Shares of the tolerance between which every blend's deviation has to lie.
LEAST, MOST = 0.9, 1.0


def drawn(hexapod, *segments, start=START):
    return actuate(Program(segments, start=start, frame="base"), hexapod)


def is_blend(path, piece):
    return path.pieces[piece].shape.name.startswith("blend")


def blends_of(path):
    """Index of the first piece of every blend; its other half is the next."""
    halves = [k for k in range(len(path.pieces)) if is_blend(path, k)]
    return halves[::2]


def along(path, piece, points=2001):
    """Poses over a piece, or over both of a blend."""
    end = piece + 2 if is_blend(path, piece) else piece + 1
    s = np.linspace(path.breaks[piece], path.breaks[end], points)
    x = path.pose_numbers(
        s, np.clip(np.searchsorted(path.breaks, s, side="right") - 1, piece, end - 1)
    )
    return x[:, :3], x[:, 3:].reshape(-1, 3, 3)


def jumps(path, at):
    """Largest jump of the pose's and of the actuators' k-th derivative at a break, as a share of
    its size nearby.
    """
    found = []
    for evaluate in (path.pose_derivatives, path.derivatives):
        left = evaluate(path.breaks[[at]], np.array([at - 1]))
        right = evaluate(path.breaks[[at]], np.array([at]))
        blend = at if is_blend(path, at) else at - 1
        s = np.linspace(path.breaks[blend], path.breaks[blend + 1], 101)
        inside = evaluate(s, np.full(101, blend))
        found += [
            np.abs(a - b).max() / np.abs(c).max()
            for a, b, c in zip(left, right, inside, strict=True)
        ]
    return np.array(found)


unit = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.2)
unit = unit.map(lambda v: v / np.linalg.norm(v))
turns = st.tuples(*[st.floats(-0.2, 0.2)] * 3).map(Rotation.from_rotvec)


class Straight:
    """A line of some length from a point on, and its distance from points."""

    def __init__(self, start, direction, length):
        self.start, self.direction, self.length = start, direction, length
        self.end = start + length * direction
        self.tangents = direction, direction

    def segment(self, **options):
        return Line(self.end, **options)

    def distance(self, points):
        foot = np.clip((points - self.start) @ self.direction, 0, self.length)
        return np.linalg.norm(points - self.start - foot[:, None] * self.direction, axis=1)


class Bent:
    """An arc of less than half a turn from a point on along a direction, and its distance from
    points.
    """

    def __init__(self, start, direction, other, radius, angle):
        normal = np.cross(direction, other)
        self.normal = normal / np.linalg.norm(normal)
        inward = np.cross(
            self.normal, direction
        )  # the right hand about the normal turns towards it
        self.start, self.radius, self.angle, self.length = start, radius, angle, radius * angle
        self.centre = start + radius * inward
        self.out, self.ahead = -inward, direction
        end = np.cos(angle) * self.out + np.sin(angle) * self.ahead
        self.end = self.centre + radius * end
        self.tangents = direction, np.cross(self.normal, end)

    def segment(self, **options):
        return Arc(self.centre, self.normal, self.angle, **options)

    def distance(self, points):
        spoke = points - self.centre
        angle = np.clip(np.arctan2(spoke @ self.ahead, spoke @ self.out), 0, self.angle)
        foot = np.cos(angle)[:, None] * self.out + np.sin(angle)[:, None] * self.ahead
        return np.linalg.norm(spoke - self.radius * foot, axis=1)


@st.composite
def legs(draw, start):
    """A line or an arc of 5 to 20 mm or so from a point on."""
    direction, length = draw(unit), draw(st.floats(0.005, 0.02))
    if draw(st.booleans()):
        return Straight(start, direction, length)
    other = draw(unit)
    assume(np.linalg.norm(np.cross(direction, other)) > 0.2)
    angle = draw(st.floats(0.3, 2.0))
    return Bent(start, direction, other, length / angle, angle)


@st.composite
def corners(draw):
    first = draw(legs(START.translation))
    second = draw(legs(first.end))
    return first, second, draw(st.floats(1e-6, 1e-4))


@settings(max_examples=40, deadline=None)
@given(corner=corners())
def test_a_blend_leaves_the_corner_by_its_tolerance(hexapod, corner):
    """Line–line, line–arc, arc–arc: measured with distances of our own, at 2001 points of the
    blend.
    """
    first, second, tolerance = corner
    cosine = first.tangents[1] @ second.tangents[0]
    assume(abs(cosine) < 0.999)
    path = drawn(hexapod, first.segment(join=Blend(tolerance)), second.segment())
    (told,) = path.blends
    if told.stop:  # within 6° of a reversal an arc leaves no blend on its inner side
        assert (told.stop, cosine < -0.994) == ("it turns back", True)
        return
    (blend,) = blends_of(path)
    points, _ = along(path, blend)
    farthest = np.minimum(first.distance(points), second.distance(points)).max()
    assert farthest <= MOST * tolerance
    # told from fewer points; nanometres are roundings of decimetres times the sharpness of the
    # corner
    assert told.deviation == pytest.approx(farthest, rel=2e-3, abs=1e-12)
    half = min(first.length, second.length) / 2
    if told.half_of:
        assert told.reach == pytest.approx(half, rel=1e-12)
        assert set(told.half_of) == {
            n for n, leg in enumerate(corner[:2], 1) if leg.length <= 2 * half * (1 + 1e-12)
        }
    else:
        assert told.reach < half
        assert farthest >= LEAST * tolerance
    for at in (blend, blend + 1, blend + 2):
        assert (jumps(path, at) < 1e-9).all()


@pytest.mark.parametrize("degrees", [1, 30, 90, 150, 178])
def test_between_lines_the_blend_is_the_polynomial_of_degree_7(hexapod, degrees):
    """Its middle is 5/16 d sin(θ/2) from the corner and so 5/32 d sin θ from the lines."""
    theta = np.deg2rad(degrees)
    bend = np.array([np.cos(theta), np.sin(theta), 0.0])
    corner = START.translation + np.array([0.02, 0, 0])
    path = drawn(hexapod, Line(corner, join=Blend(1e-5)), Line(corner + 0.02 * bend))
    (told,) = path.blends
    assert told.deviation == pytest.approx(5 / 32 * told.reach * np.sin(theta), rel=1e-3)
    points, _ = along(path, blends_of(path)[0])
    assert np.linalg.norm(points[1000] - corner) == pytest.approx(
        5 / 16 * told.reach * np.sin(theta / 2), rel=1e-9
    )
    # value and three derivatives at both ends fix a polynomial of degree 7: SciPy's own must be the
    # same curve
    from scipy.interpolate import BPoly

    ends = [
        [p, t, np.zeros(3), np.zeros(3)] for p, t in ((points[0], [1, 0, 0]), (points[-1], bend))
    ]
    hermite = BPoly.from_derivatives([0, 2 * told.reach], ends)
    assert np.abs(hermite(np.linspace(0, 2 * told.reach, 2001)) - points).max() < 1e-15
    # and the parameter runs on at nearly the tool's speed: cos(θ/2) at least
    s = np.linspace(path.breaks[1], path.breaks[3], 201)
    speed = np.linalg.norm(
        path.pose_derivatives(s, np.repeat([1, 2], [100, 101]))[1][:, :3], axis=1
    )
    assert speed.min() == pytest.approx(np.cos(theta / 2), rel=1e-9)
    assert speed.max() < 1 + 1e-12


SMOOTH_PAIRS = {
    "a tangent arc and its line": (
        Arc([0, 0.01, 0.25], [0, 0, 1], 1.0),
        lambda p, t: Line(p + 0.01 * t),
    ),
    "a line that starts to turn": (
        Line([0.01, 0, 0.25]),
        lambda p, t: Line(p + 0.01 * t, Rotation.from_rotvec([0, 0.1, 0])),
    ),
    "a turn and a line": (
        Turn(Rotation.from_rotvec([0.1, 0, 0])),
        lambda p, t: Line([0.01, 0, 0.25]),
    ),
    "a line and a turn": (
        Line([0.01, 0, 0.25]),
        lambda p, t: Turn(Rotation.from_rotvec([0.1, 0, 0])),
    ),
    "two turns": (
        Turn(Rotation.from_rotvec([0.1, 0, 0])),
        lambda p, t: Turn(Rotation.from_rotvec([0.1, 0.1, 0])),
    ),
    "lines that turn": (
        Line([0.01, 0, 0.25], Rotation.from_rotvec([0.1, 0, 0])),
        lambda p, t: Line(p + np.array([0, 0.01, 0]), Rotation.from_rotvec([0.1, 0.05, 0.1])),
    ),
    "a spline and a helix": (
        Spline([[0.003, 0, 0.25], [0.006, 0.004, 0.251], [0.01, 0, 0.253]]),
        lambda p, t: Arc(
            p + np.array([0, 0.01, 0]),
            [0, 0, 1],
            2.0,
            Rotation.from_rotvec([0, 0, 0.2]),
            rise=0.002,
        ),
    ),
}


@pytest.mark.parametrize("name", SMOOTH_PAIRS)
def test_what_meets_is_smooth_to_the_third_derivative(hexapod, name):
    first, second = SMOOTH_PAIRS[name]
    first = replace(first, join=Blend(TOLERANCE))
    tangent = (
        np.array([np.cos(1.0), np.sin(1.0), 0]) if isinstance(first, Arc) else np.array([1.0, 0, 0])
    )
    end = along(drawn(hexapod, first), len(drawn(hexapod, first).pieces) - 1)[0][-1]
    path = drawn(hexapod, first, second(end, tangent))
    (blend,), (told,) = blends_of(path), path.blends
    assert LEAST <= told.tolerance_use <= MOST
    assert not path.stops(3)[1:-1].any()
    for at in (blend, blend + 1, blend + 2):
        assert (jumps(path, at) < 1e-9).all()


def farthest(poses, path, join, reach, radius):
    """Largest distance and angle of poses to the nearest of an unblended path near a join; angles
    count `radius`.
    """
    s = join + reach * np.linspace(-2, 2, 8001)
    there = path.pose_numbers(s, (s > join).astype(int))
    # turned by a small angle, the nine numbers of a matrix are √2 of it away
    scale = np.append(np.ones(3), np.full(9, radius / np.sqrt(2)))
    here = np.concatenate([poses[0], poses[1].reshape(-1, 9)], axis=1)
    nearest = cKDTree(there * scale).query(here * scale)[1]
    off = here - there[nearest]
    apart = np.linalg.norm(off[:, :3], axis=1)
    angle = 2 * np.arcsin(np.minimum(np.linalg.norm(off[:, 3:], axis=1) / np.sqrt(8), 1))
    return np.array([apart.max(), angle.max()])


@pytest.mark.parametrize("angle", [None, 1e-4, 1e-2])
@pytest.mark.parametrize(
    "name", ["a line that starts to turn", "two turns", "lines that turn", "a turn and a line"]
)
def test_orientation_has_its_own_tolerance(hexapod, name, angle):
    """Against the unblended path, sampled densely: the pose that comes nearest, angles weighed by
    the tolerances.
    """
    first, second = SMOOTH_PAIRS[name]
    first = replace(first, join=Blend(TOLERANCE, angle))
    end = along(drawn(hexapod, first), 0)[0][-1]
    follows = second(end, np.array([1.0, 0, 0]))
    path = drawn(hexapod, first, follows)
    (told,) = path.blends
    allowed = TOLERANCE / hexapod.characteristic_length if angle is None else angle
    assert told.angle == allowed
    plain = drawn(hexapod, replace(first, join=Stop()), follows)
    poses = along(path, blends_of(path)[0], 801)
    # samples of both lie 1/400 and 1/2000 of the reach apart: less than 1 % of the deviation
    measured = farthest(poses, plain, plain.breaks[1], told.reach, TOLERANCE / allowed)
    shares = measured / [TOLERANCE, allowed]
    assert shares.max() <= MOST
    if not told.half_of:
        assert shares.max() >= LEAST
    assert told.tolerance_use == pytest.approx(shares.max(), rel=0.01)


def test_short_segments_give_half_and_blends_never_overlap(hexapod):
    """A zigzag of segments shorter than the blends would need, down to a tenth of them."""
    steps = [[0.01, 0, 0.25], [0, 2e-4, 0], [5e-5, 0, 0], [0, 4e-4, 0], [0.01, 0, 0]]
    points = np.cumsum(steps, axis=0)
    path = drawn(hexapod, *(Line(point, join=Blend(5e-5)) for point in points))
    lengths = np.array([0.01, 2e-4, 5e-5, 4e-4, 0.01])
    reach = np.array([blend.reach for blend in path.blends])
    assert reach == pytest.approx([1e-4, 2.5e-5, 2.5e-5, 2e-4], rel=1e-9)
    assert [blend.half_of for blend in path.blends] == [(2,), (3,), (3,), (4,)]
    assert [blend.segment for blend in path.blends] == [1, 2, 3, 4]
    taken = np.append(reach, 0) + np.append(0, reach)
    assert (taken <= lengths * (1 + 1e-12)).all()
    # segment 3 is used up: its two blends follow each other at once
    assert [is_blend(path, k) for k in range(len(path.pieces))] == [
        bool(int(c)) for c in "011011110110"
    ]
    assert path.breaks[-1] == pytest.approx(lengths.sum(), rel=1e-12)
    for at in range(1, len(path.pieces)):
        assert (jumps(path, at) < 1e-9).all()
    assert not path.stops(3)[1:-1].any()


BACK = Rotation.from_rotvec([0, 0, 0.1])


@pytest.mark.parametrize(
    ("segments", "why"),
    [
        ([Line([0.01, 0, 0.25], join=Blend(TOLERANCE)), Line([0.005, 0, 0.25])], "turns back"),
        (
            [Line([0.01, 0, 0.25], join=Blend(TOLERANCE)), Line([0.005, 0, 0.25], BACK)],
            "turns back",
        ),
        ([Turn(BACK, join=Blend(TOLERANCE)), Turn(Rotation.identity())], "turns back"),
        (
            [Line([0.01, 0, 0.25], join=Blend(TOLERANCE)), Dwell(0.1), Line([0.01, 0.01, 0.25])],
            "a dwell",
        ),
    ],
)
def test_what_cannot_be_blended_stops_and_says_why(hexapod, segments, why):
    path = drawn(hexapod, *segments)
    (told,) = path.blends
    assert why in told.stop
    assert path.stops(2).all()
    assert not blends_of(path)
    assert told.deviation == told.reach == 0


def test_nothing_is_blended_where_nothing_bends(hexapod):
    """Two halves of a line, and of an arc, run on; a blend at the program's end has nothing to lead
    to.
    """
    path = drawn(
        hexapod,
        Line([0.005, 0, 0.25], join=Blend(TOLERANCE)),
        Line([0.010, 0, 0.25]),
        Arc([0.01, 0.01, 0.25], [0, 0, 1], 1.0, join=Blend(TOLERANCE)),
        Arc([0.01, 0.01, 0.25], [0, 0, 1], 1.0, join=Blend(TOLERANCE)),
    )
    assert path.blends == ()
    assert path.stops(3).tolist() == [True, False, True, False, True]


def test_through_passes_what_is_smooth_enough_for_the_motion(hexapod):
    """A corner stops all motions, a jump of curvature those with jerk limits, a dwell all; a line's
    middle none.
    """
    on = Through()
    path = drawn(
        hexapod,
        Line([0.005, 0, 0.25], join=on),
        Line([0.010, 0, 0.25], join=on),
        Arc([0.01, 0.01, 0.25], [0, 0, 1], np.pi / 2, join=on),
        Line([0.01, 0.01, 0.25], join=on),
        Line([0.005, 0.01, 0.25], join=on),
        Dwell(0.1),
        Line([0.001, 0.01, 0.25], join=on),
        Line([-0.001, 0.01, 0.25], BACK),
    )
    assert path.stops(2).tolist() == [True, False, False, True, False, True, True, True]
    assert path.stops(3).tolist() == [True, False, True, True, False, True, True, True]


def test_each_half_of_a_blend_belongs_to_the_segment_whose_place_it_takes(hexapod):
    path = drawn(
        hexapod,
        Line([0.01, 0, 0.25], speed=0.02, join=Blend(TOLERANCE)),
        Line([0.01, 0.01, 0.25], speed=0.01, join=Blend(TOLERANCE)),
        Line([0, 0.01, 0.25]),
    )
    assert [piece.tool_speed for piece in path.pieces] == [0.02, 0.02, 0.01, 0.01, 0.01, None, None]
    assert [path.segment(k) for k in range(7)] == [1, 1, 2, 2, 2, 3, 3]


def round_trip(join):
    arc = Arc(
        [0, 0, 0.025],
        [0, 0, 1],
        np.pi / 2,
        Rotation.from_rotvec([0, 0, 0.05]),
        speed=0.018,
        join=join,
    )
    return Program(
        [
            Line([0.01, 0.0, 0.025], join=join),
            Line([0.01, 0.01, 0.025], join=join),
            arc,
            Line([-0.01, 0, 0.025]),
        ],
        start=START_FROM_HOME,
    )


@pytest.mark.parametrize("order", [2, 3])
def test_a_blended_plan_is_certified_and_faster(hexapod, order):
    rounded, stopping = (
        plan(round_trip(join), hexapod, order=order) for join in (Blend(5e-5), Stop())
    )
    assert rounded.certificate.holds
    assert stopping.certificate.holds
    assert rounded.trajectory.duration < {2: 0.98, 3: 0.96}[order] * stopping.trajectory.duration
    assert rounded.path.stops(order).sum() == 2  # it rests at its ends only
    t = np.linspace(0, rounded.trajectory.duration, 4001)
    state = rounded.trajectory.at(t)
    assert state.sd[1:-1].min() > 0
    # and the tool keeps the cap of the arc, on its halves of the blends too
    capped = np.isin(
        state.piece, [k for k, piece in enumerate(rounded.path.pieces) if piece.tool_speed == 0.018]
    )
    fastest = np.linalg.norm(state.tool_velocity[capped], axis=1).max()
    assert 0.99 * 0.018 < fastest < 0.018 * (1 + 1e-6)


def test_a_check_tells_of_the_blends(hexapod):
    found = check(round_trip(Blend(TOLERANCE)), hexapod)
    assert not found.violations
    assert [blend.segment for blend in found.blends] == [1, 2, 3]
    assert all(blend.tolerance_use <= 1 for blend in found.blends)


def test_a_blend_looks_alike_in_every_frame(hexapod):
    """Moved and turned with its machine's home, the same program makes the same blends."""
    home = RigidTransform.from_components(
        [0.01, -0.02, 0.24], Rotation.from_euler("XYZ", [10, -20, 30], degrees=True)
    )
    machine = Hexapod(hexapod.base, hexapod.platform, axes=hexapod.axes, home=home)
    here, there = (
        actuate(round_trip(Blend(TOLERANCE)), hexapod),
        actuate(round_trip(Blend(TOLERANCE)), machine),
    )
    for one, other in zip(here.blends, there.blends, strict=True):
        assert one.reach == pytest.approx(other.reach, rel=1e-6)
        assert one.deviation == pytest.approx(other.deviation, rel=1e-6)


def test_a_program_stops_everywhere_when_asked_to(hexapod):
    path = actuate(stop_at_joins(round_trip(Blend(TOLERANCE))), hexapod)
    assert path.stops(2).all()
    assert path.blends == ()
    assert [piece.tool_speed for piece in path.pieces] == [None, None, 0.018, None]
