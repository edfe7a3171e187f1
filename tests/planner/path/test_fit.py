"""Fitting: curves that stay within the tolerance of what is programmed, proved, and are smooth
enough for order 3.
"""

from dataclasses import replace
from itertools import count, groupby, islice, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import load_machine
from planner import Arc, Blend, Fit, Line, Program, Stop, Trigger, plan
from planner.path.actuation import actuate
from planner.path.chain import draw_segments, walk_path
from planner.path.closeness import bound_distance
from planner.path.fit import fit_chains
from planner.path.shape import LINE, NO_TURN, Drawn, arc, line
from planner.path.spline import SPLINE, STEADY_SPLINE
from planner.program.joins import stop_at_joins

HEIGHT, TOLERANCE = 0.025, 2e-5


def chain(points, join=None, **given):
    """Lines through points (N, 2 or 3) in m."""
    points = np.asarray(points, float)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.full(len(points), HEIGHT)])
    join = Fit(TOLERANCE) if join is None else join
    first = RigidTransform.from_components(points[0], Rotation.identity())
    return Program(tuple(Line(point, join=join, **given) for point in points[1:]), start=first)


def spiral(lines, step=0.42e-3, pitch=1.5e-3):
    """Points of an Archimedean spiral as CAM writes them: to 1 µm."""
    angle = np.linspace(0.0, 200.0, 200_001)
    radius = 1e-3 + pitch * angle / (2 * np.pi)
    way = np.concatenate([[0.0], np.cumsum(np.hypot(radius[1:] * np.diff(angle), np.diff(radius)))])
    angle = np.interp(np.arange(lines + 1) * step, way, angle)
    radius = 1e-3 + pitch * angle / (2 * np.pi)
    return np.round(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), 6)


def positions(pieces, points=513):
    """Positions (N, 3) along pieces, closely."""
    return np.concatenate(
        [p.poses(p.start + np.linspace(0, p.length, points))[:, :3] for p in pieces]
    )


def distance_to_polyline(x, corners):
    """The distance (N,) of points to the nearest of some lines: by brute force."""
    a, d = corners[:-1], np.diff(corners, axis=0)
    share = np.clip(((x[:, None] - a) * d).sum(2) / np.maximum((d * d).sum(1), 1e-30), 0, 1)
    return np.linalg.norm(x[:, None] - a - share[..., None] * d, axis=2).min(1)


def hausdorff(pieces, corners):
    """The larger of both ways, as far as samples show it."""
    x = positions(pieces, 129)
    along = np.concatenate(
        [a + np.linspace(0, 1, 9)[:, None] * (b - a) for a, b in pairwise(corners)]
    )
    return max(distance_to_polyline(x, corners).max(), distance_to_polyline(along, x).max())


def fit_pieces(program, machine):
    parts = list(fit_chains(draw_segments(program, machine), machine.characteristic_length))
    return parts, [piece for part in parts for piece in part.pieces]


@pytest.fixture(scope="module")
def fitted(hexapod):
    """150 lines of a spiral, and what became of them; the programmed corners in the base frame."""
    points = spiral(150)
    program = chain(points)
    corners = hexapod.home.apply(np.column_stack([points, np.full(len(points), HEIGHT)]))
    return program, corners, *fit_pieces(program, hexapod)


def test_short_lines_become_few_smooth_pieces_within_the_tolerance(hexapod, fitted):
    program, corners, parts, pieces = fitted
    assert len(pieces) < 30
    assert all(piece.shape is STEADY_SPLINE for piece in pieces)
    proved = max(part.fitted.deviation for part in parts)
    apart = hausdorff(pieces, corners)  # of samples: about what it is
    assert 0.99 * apart <= proved <= TOLERANCE
    assert proved <= 1.3 * apart  # which is Hausdorff's, never more than Fréchet's
    assert sum(part.fitted.before for part in parts) >= 150
    for a, b in pairwise(pieces):
        ends = zip(
            a.derivatives(np.array([a.start + a.length])),
            b.derivatives(np.array([b.start])),
            strict=True,
        )
        for k, (left, right) in enumerate(ends):
            assert np.abs(left - right).max() <= 1e-9 * 1e3**k
    path = actuate(program, hexapod)
    assert path.stops(3).sum() == 2
    assert path.fit.after == len(pieces)
    assert path.fit.rounded == path.fit.stopped == 0
    place, x = path.fit.deviates_at, positions(path.pieces)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    near = np.abs(way - place.s) < 2e-4  # half a line
    nearest = np.linalg.norm(corners - x[near].mean(0), axis=1).argsort()[:3]
    both = (
        distance_to_polyline(x[near], corners).max(),
        distance_to_polyline(corners[nearest], x).max(),
    )
    assert max(both) > 0.9 * apart
    assert min(abs(nearest + 0.5 - place.segment)) <= 0.5


def straight(a, b):
    ends = (RigidTransform.from_components(end, Rotation.identity()) for end in (a, b))
    return line(*ends, float(np.linalg.norm(b - a)), 1)


def test_a_fit_wrong_by_more_than_the_tolerance_is_caught(fitted):
    """A span moved aside until samples show 1.01 times the tolerance: never is the bound below
    that.
    """
    _, corners, parts, _ = fitted
    pieces = list(parts[1].pieces)
    ends = [
        piece.poses(np.array([s]))[0, :3]
        for piece, s in ((pieces[0], 0.0), (pieces[-1], pieces[-1].length))
    ]
    nearest = [int(np.linalg.norm(corners - end, axis=1).argmin()) for end in ends]
    own = np.concatenate([ends[:1], corners[nearest[0] + 1 : nearest[1]], ends[1:]])
    given = [straight(*pair) for pair in pairwise(own)]
    rng = np.random.default_rng(17)
    for _ in range(20):
        k, way = int(rng.integers(len(pieces))), rng.normal(size=3)
        low, high = 0.0, 4 * TOLERANCE
        while high - low > 1e-4 * TOLERANCE:
            by = (low + high) / 2
            parameters = pieces[k].parameters.copy()
            parameters[:3] += by * way / np.linalg.norm(way)  # the position at its start
            wrong = replace(pieces[k], parameters=parameters)
            near = distance_to_polyline(positions([wrong]), own).max() < 1.01 * TOLERANCE
            low, high = (by, high) if near else (low, by)
        moved = [*pieces[:k], wrong, *pieces[k + 1 :]]
        assert bound_distance(moved, given, TOLERANCE, 1e-3).worst[0] > 1.009 * TOLERANCE


def test_bounds_are_what_is_known(hexapod):
    """Of parallel lines their distance; of an arc and its chord the sagitta; of turned frames the
    angle.
    """
    one = straight(np.zeros(3), np.array([0.01, 0, 0]))
    other = straight(np.array([0, 1e-5, 0]), np.array([0.01, 1e-5, 0]))
    assert 1e-5 <= bound_distance([one], other.cut(7), 1e-5, 1e-3).worst[0] <= 1e-5 * (1 + 1e-9)
    radius, angle = 5e-3, 0.1
    start = np.concatenate([[radius, 0, 0], np.eye(3).ravel()])
    curve = arc(start, np.zeros(3), np.array([0, 0, 1.0]), angle, NO_TURN, 1)
    chord = straight(*curve.poses(np.array([0, curve.length]))[:, :3])
    sagitta = radius * (1 - np.cos(angle / 2))
    assert sagitta <= bound_distance([curve], [chord], 1e-5, 1e-3).worst[0] <= 1.01 * sagitta
    assert sagitta <= bound_distance([chord], [curve], 1e-5, 1e-3).worst[0] <= 1.01 * sagitta
    turned = RigidTransform.from_components([0.01, 0, 0], Rotation.from_rotvec([0, 1e-3, 0]))
    tilting = line(RigidTransform.identity(), turned, 0.01, 1)
    assert 1e-3 <= bound_distance([one], [tilting], 1e-5, 1e-3).worst[1] <= 1e-3 * (1 + 1e-6)


def test_a_loop_is_not_cut_off():
    """Every point of a straight way is on the path that makes a loop at its middle, and yet they
    are far apart.
    """
    corners = (
        np.array([[0, 0, 0], [5, 0, 0], [5, 1, 0], [6, 1, 0], [6, 0, 0], [5, 0, 0], [10, 0, 0]])
        * 1e-3
    )
    loop = [straight(*pair) for pair in pairwise(corners)]
    way = straight(corners[0], corners[-1])
    assert bound_distance([way], loop, 1e-5, 1e-3).worst[0] >= 1e-3


def test_long_lines_stay_lines_and_corners_blends(hexapod):
    """As without fitting, but that the corner itself is as near to the blend as the tolerance
    says.
    """
    square = [(0, 0), (0.01, 0), (0.01, 0.01), (0, 0.01), (0, 0)]
    path = actuate(chain(square), hexapod)
    kinds = [piece.shape.name for piece in path.pieces]
    assert kinds == ["line", *3 * ["blend_line_line", "blend_line_line", "line"]]
    assert path.fit.curves == 0
    assert path.fit.rounded == 3
    corners = hexapod.home.apply(np.column_stack([square, np.full(5, HEIGHT)]))
    away = [
        np.linalg.norm(positions(path.pieces, 2001) - corner, axis=1).min()
        for corner in corners[1:-1]
    ]
    np.testing.assert_allclose(away, TOLERANCE, rtol=1e-3)
    assert path.fit.deviation <= TOLERANCE
    at = path.fit.deviates_at
    k = int(np.searchsorted(path.breaks, at.s, side="right")) - 1
    x = path.pieces[k].poses(np.array([path.pieces[k].start + at.s - path.breaks[k]]))[0, :3]
    assert np.linalg.norm(x - corners[at.segment]) == pytest.approx(TOLERANCE, rel=1e-3)


@pytest.mark.parametrize("angle", [20, 50, 90, 150])
def test_corners_between_arcs_are_proved(hexapod, angle):
    """A blend of arcs, or of an arc and a line, is within the tolerance of the corner and of
    both.
    """
    first = Arc([0.005, 0, HEIGHT], [0, 0, 1], np.pi / 2, join=Fit(TOLERANCE))
    start = RigidTransform.from_components([0, 0, HEIGHT], Rotation.identity())
    heading = np.deg2rad(angle)  # the arc ends at (5, −5) mm, along x
    end = np.array([0.005, -0.005, HEIGHT]) + 8e-3 * np.array([np.cos(heading), np.sin(heading), 0])
    path = actuate(Program((first, Line(end)), start=start), hexapod)
    (blend,) = path.blends
    assert not blend.stop
    assert 0.85 * TOLERANCE < blend.deviation <= TOLERANCE
    corner = hexapod.home.apply([0.005, -0.005, HEIGHT])
    assert (
        np.linalg.norm(positions(path.pieces, 2001) - corner, axis=1).min()
        <= 1.0001 * blend.deviation
    )


def test_long_lines_between_chains_keep_their_middle(hexapod):
    """A line that short lines lead into and out of: its middle is the line itself, to rounding."""
    bow = [(5 * np.sin(a), 5 * np.cos(a)) for a in np.linspace(-1.2, 0, 12)]
    points = (
        np.array(
            [
                *bow,
                (12, 5),
                *[(12 + 5 * np.sin(a), 5 * np.cos(a)) for a in np.linspace(0.11, 1.2, 11)],
            ]
        )
        * 1e-3
    )
    program = chain(points - [3e-3, 0])
    parts, _ = fit_pieces(program, hexapod)
    assert [len(part.pieces) for part in parts if part.fitted is None] == [1]
    middle = next(part.pieces[0] for part in parts if part.fitted is None)
    assert middle.shape is LINE
    assert 6e-3 < middle.length < 12e-3
    assert actuate(program, hexapod).stops(3).sum() == 2
    assert max(part.fitted.deviation for part in parts if part.fitted) <= TOLERANCE


def test_orientation_is_fitted_too(hexapod):
    """It turns with the chain, and what the fit leaves it by is proved and small."""
    points = spiral(120)[40:]
    tilt = np.deg2rad(3) * np.sin(np.linspace(0, 2, len(points)))
    first = RigidTransform.from_components(
        [*points[0], HEIGHT], Rotation.from_rotvec([tilt[0], 0, 0])
    )
    lines = [
        Line([*point, HEIGHT], Rotation.from_rotvec([angle, 0, 0]), join=Fit(TOLERANCE, 1e-4))
        for point, angle in zip(points[1:], tilt[1:], strict=True)
    ]
    path = actuate(Program(tuple(lines), start=first), hexapod)
    assert path.stops(3).sum() == 2
    assert len(path.pieces) < 40
    assert 0 < path.fit.turned <= 1e-4
    first, last = path.pieces[0], path.pieces[-1]
    ends = first.poses(np.array([first.start])), last.poses(np.array([last.start + last.length]))
    for row, angle in zip(np.concatenate(ends)[:, 3:], tilt[[0, -1]], strict=True):
        np.testing.assert_allclose(
            row.reshape(3, 3), Rotation.from_rotvec([angle, 0, 0]).as_matrix(), atol=1e-9
        )


def test_a_chain_that_begins_to_turn_stays_smooth(hexapod):
    """Curves at one orientation and the first that turns meet in position and orientation with
    three derivatives.
    """
    points = np.column_stack([spiral(400), np.full(401, HEIGHT)])
    tilts = 4e-4 * np.maximum(np.arange(401) - 250, 0)
    join = Fit(TOLERANCE, 2e-4)
    lines = [
        Line(point, Rotation.from_rotvec([tilt, 0, 0]) if tilt else None, join=join)
        for point, tilt in zip(points[1:], tilts[1:], strict=True)
    ]
    start = RigidTransform.from_components(points[0], Rotation.identity())
    parts, pieces = fit_pieces(Program(tuple(lines), start=start), hexapod)
    assert [shape for shape, _ in groupby(piece.shape for piece in pieces)] == [
        STEADY_SPLINE,
        SPLINE,
    ]
    assert max(part.fitted.deviation for part in parts) <= TOLERANCE
    assert max(part.fitted.turned for part in parts) <= 2e-4
    for a, b in pairwise(pieces):
        ends = zip(
            a.derivatives(np.array([a.start + a.length])),
            b.derivatives(np.array([b.start])),
            strict=True,
        )
        for k, (left, right) in enumerate(ends):
            assert np.abs(left - right).max() <= 1e-9 * 1e3**k


def test_caps_change_where_their_lines_meet_and_events_keep_their_segment(hexapod):
    points = spiral(60)[20:]
    program = chain(points)
    lines = [
        replace(part, speed=0.01 if k < 15 else 0.02) for k, part in enumerate(program.segments)
    ]
    lines[30] = replace(lines[30], trigger=Trigger("camera", 0.5))
    path = actuate(replace(program, segments=tuple(lines)), hexapod)
    ends = hexapod.home.apply(np.column_stack([points, np.full(len(points), HEIGHT)]))
    change = next(
        k for k, (a, b) in enumerate(pairwise(path.pieces)) if a.tool_speed != b.tool_speed
    )
    place = path.pieces[change + 1].poses(np.array([path.pieces[change + 1].start]))[0, :3]
    assert np.linalg.norm(place - ends[15]) <= TOLERANCE
    assert [piece.tool_speed for piece in path.pieces[: change + 1]] == [0.01] * (change + 1)
    marked = [piece for piece in path.pieces if piece.segment == 31]
    assert {"blend_steady_spline_line", "blend_line_steady_spline"} <= {
        piece.shape.name for piece in marked
    }


def test_a_stream_is_read_no_farther_than_a_window(hexapod):
    """A chain without an end is fitted as it comes."""
    taken = 0

    def endless():
        nonlocal taken
        for k in count():
            a, b = (
                [5e-3 * np.cos(angle), 5e-3 * np.sin(angle), 1e-6 * k]
                for angle in (0.08 * k, 0.08 * (k + 1))
            )
            taken += 1
            yield Drawn([straight(np.array(a), np.array(b))], Fit(TOLERANCE), plain=True)

    done = 0
    for part in islice(fit_chains(endless(), 0.1), 10):
        done += part.fitted.before
        assert taken - done < 1600
    assert taken > 300


def test_a_fitted_chain_is_faster_than_its_blends(hexapod):
    program = chain(spiral(40))
    assert plan(program, hexapod, order=3).certificate.holds
    fitted = plan(program, hexapod, order=2)
    lines = [replace(part, join=Blend(TOLERANCE)) for part in program.segments]
    stopped = [replace(part, join=Stop()) for part in program.segments]
    blended = plan(replace(program, segments=tuple(lines)), hexapod, order=2)
    assert (
        fitted.trajectory.duration
        < blended.trajectory.duration
        < plan(replace(program, segments=tuple(stopped)), hexapod, order=2).trajectory.duration
    )
    assert "fit" in {table.title for table in fitted.tables()}


def test_corners_are_stops_where_that_is_asked_for(hexapod):
    """As a program says, and as of a control that rounds nothing; in between the curve stays as it
    is.
    """
    bow = 5e-3 * np.array([(np.cos(a), np.sin(a)) for a in np.linspace(0, 1.5, 20)])
    points = np.vstack([bow, bow[-1] + [2e-3, 0]])
    program = chain(points, Fit(TOLERANCE, stop=True))
    path = actuate(program, hexapod)
    assert path.stops(2).sum() == 3
    assert (path.fit.rounded, path.fit.stopped, path.fit.curves) == (0, 1, 1)
    rounded = chain(points)
    assert actuate(rounded, hexapod).stops(2).sum() == 2
    assert actuate(stop_at_joins(rounded), hexapod).stops(2).sum() == 3


def test_a_curve_leaves_a_turning_line_smoothly(hexapod):
    """Position and orientation meet those of the line with three derivatives, so that order 3
    passes.
    """
    bow = [
        np.array([5e-3 * np.sin(a), 5e-3 * np.cos(a), HEIGHT]) for a in np.linspace(0.08, 1.2, 15)
    ]
    points = [np.array([0, 5e-3, HEIGHT]), *bow]
    tilts = 0.02 + 0.0012 * np.arange(len(points))
    lines = [
        Line(point, Rotation.from_rotvec([tilt, 0, 0]), join=Fit(TOLERANCE, 2e-4))
        for point, tilt in zip(points, tilts, strict=True)
    ]
    start = RigidTransform.from_components([-8e-3, 5e-3, HEIGHT], Rotation.identity())
    path = actuate(Program(tuple(lines), start=start), hexapod)
    first, second = path.pieces[:2]
    assert (first.shape, second.shape) == (LINE, SPLINE)
    ends = (
        first.derivatives(np.array([first.start + first.length])),
        second.derivatives(np.array([second.start])),
    )
    for k, (left, right) in enumerate(zip(*ends, strict=True)):
        assert np.abs(left - right).max() <= 1e-13 * 1e3**k
    assert path.stops(3).sum() == 2


@settings(max_examples=20)
@given(st.integers(0, 2**32))
def test_no_piece_is_left_of_lines_whose_blends_take_both_halves(seed):
    """Of lines of one length between corners nothing is left between two blends, not even rounding
    of it.
    """
    rng = np.random.default_rng(seed)
    turns = rng.choice([-1, 1], 12) * rng.uniform(0.7, 2.4, 12)
    length = rng.uniform(2e-5, 2e-4)
    steps = length * np.exp(1j * np.cumsum(turns))
    points = np.concatenate([[0.0], np.cumsum(steps)]) + 1e-2
    steps = walk_path(
        chain(np.column_stack([points.real, points.imag]), Fit(1e-4)), load_machine("hexapod")
    )
    assert min(step.piece.length for step in steps) > 1e-3 * length


def test_the_like_of_a_place_is_found_where_one_path_runs_ahead(hexapod):
    """Lines of 20 µm, the second half of which are a zigzag: a straight line is ahead of them by
    eight of them.
    """
    steps = 2e-5 * np.exp(
        1j * np.where(np.arange(500) < 250, 0.0, np.where(np.arange(500) % 2, 0.35, -0.35))
    )
    points = np.concatenate([[0.0], np.cumsum(steps)]) + 1e-2
    rows = np.column_stack([points.real, points.imag])
    links, whole = (
        [part.pieces[0] for part in draw_segments(chain(places), hexapod)]
        for places in (rows, rows[[0, -1]])
    )
    apart = np.abs(points.imag).max()
    assert apart <= bound_distance(whole, links, TOLERANCE, 1.0).worst[0] < 1.01 * apart
