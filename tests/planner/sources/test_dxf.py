"""DXF: each entity against its analytic geometry, contours chained back together, and whatever is
no drawing.
"""

import random
import sys
from contextlib import suppress
from itertools import pairwise, permutations
from math import cos, hypot, pi, sin, tau
from time import process_time

import ezdxf
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import FileError, MotionError
from planner import (
    Arc,
    Blend,
    Line,
    Program,
    Spline,
    Stop,
    Through,
    import_program,
    load_program,
    plan,
)
from planner.program.program_writer import program_toml
from planner.sources.contours import find_tour
from planner.sources.dxf import METRES
from planner.sources.outline import outline
from tests.pace import slowness
from tests.planner.sources.drawings import draw, scatter


@pytest.fixture
def sheet(tmp_path):
    """Model space of a drawing in mm, and how it is read."""
    document = ezdxf.new(units=4)

    def read(**options):
        path = tmp_path / "part.dxf"
        document.saveas(path)
        return import_program(path, **options)

    return document.modelspace(), read


def ends(program, here=(0, 0, 0)):
    """Points (N+1, 3) in mm where segments begin and end: arcs turned by SciPy's rotations."""
    found = [np.array(here, float)]
    for part in program.segments:
        match part:
            case Line():
                found.append(part.to)
            case Spline():
                found.append(part.through[-1])
            case Arc():
                u = found[-1] - part.centre
                turned = Rotation.from_rotvec(part.angle * part.normal).apply(u)
                found.append(part.centre + turned + part.rise * part.normal)
    return np.array(found) * 1e3


def contours(program):
    """Segments of each contour, that is what comes between the ways to and from it, none of which
    is capped.
    """
    parts = [[]]
    for part, (start, _) in zip(program.segments, pairwise(ends(program)), strict=True):
        if part.speed is None:
            parts.append([])
        else:
            parts[-1].append((start, part))
    return [part for part in parts if part]


# --- geometry
# -------------------------------------------------------------------------------------------------------


def test_a_line_runs_from_its_start_to_its_end(sheet):
    space, read = sheet
    space.add_line((1, 2, 3), (4, 6, 3))
    found = read()
    assert ends(found.program) == pytest.approx(
        np.array([[0, 0, 0], [1, 2, 3], [4, 6, 3]]), abs=1e-12
    )
    assert found.entities == {"LINE": 1}
    assert found.program.frame == "home"


@pytest.mark.parametrize(
    ("first", "last", "turn"), [(0, 90, 90), (350, 20, 30), (90, 0, 270), (-30, 30, 60)]
)
@pytest.mark.parametrize("up", [1, -1])
def test_arcs_turn_against_the_clock_about_their_extrusion(sheet, first, last, turn, up):
    space, read = sheet
    space.add_arc((10, 5, 2), 3, first, last, dxfattribs={"extrusion": (0, 0, up)})
    program = read(order="file", speed=1).program
    ((start, arc),) = contours(program)[0]
    # along −z, the drawing's x is turned round, and so is its z
    assert start == pytest.approx(
        [up * (10 + 3 * cos(np.radians(first))), 5 + 3 * sin(np.radians(first)), 2 * up]
    )
    assert ends(program)[-1] == pytest.approx(
        [up * (10 + 3 * cos(np.radians(last))), 5 + 3 * sin(np.radians(last)), 2 * up]
    )
    assert arc.centre * 1e3 == pytest.approx([10 * up, 5, 2 * up])
    assert arc.angle * arc.normal[2] == pytest.approx(np.radians(turn) * up, abs=1e-12)


def test_circles_are_one_whole_turn_in_any_plane(sheet):
    space, read = sheet
    tilted = (1, 2, 2)
    made = space.add_circle((1, 2, 3), 4, dxfattribs={"extrusion": tilted})
    program = read(speed=1).program
    ((start, arc),) = contours(program)[0]
    assert abs(arc.angle) == tau
    assert arc.normal == pytest.approx(np.array(tilted) / 3)
    centre = np.array(list(made.ocs().to_wcs((1, 2, 3))))
    assert arc.centre * 1e3 == pytest.approx(centre)
    assert np.linalg.norm(start - centre) == pytest.approx(4, abs=1e-12)
    assert (start - centre) @ tilted == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("heavy", [True, False])
def test_bulges_are_the_arcs_that_ezdxf_makes_of_them(sheet, up, closed, heavy):
    space, read = sheet
    rows = [(0, 0, 0.5), (10, 0, -1), (12, 8, 0), (3, 9, 2.5), (1, 4, -0.01), (0, 2, 0)]
    given_ = {"format": "xyb", "close": closed, "dxfattribs": {"extrusion": (0, 0, up)}}
    if heavy:
        made = space.add_polyline2d(rows, **given_)
        made.dxf.elevation = (0, 0, 2)
    else:
        made = space.add_lwpolyline(rows, **given_)
        made.dxf.elevation = 2
    found = read(order="file", speed=1)
    (parts,) = contours(found.program)
    virtual = list(made.virtual_entities())
    assert len(parts) == len(virtual) == 5 + closed
    at = [*ends(found.program)[1:]]
    for (start, part), end, own in zip(parts, at[1:], virtual, strict=True):
        if own.dxftype() == "LINE":
            assert isinstance(part, Line)
            known = [own.dxf.start, own.dxf.end]
        else:
            assert part.centre * 1e3 == pytest.approx(
                list(own.ocs().to_wcs(own.dxf.center)), abs=1e-9
            )
            assert np.linalg.norm(start - part.centre * 1e3) == pytest.approx(
                own.dxf.radius, rel=1e-12
            )
            assert abs(part.angle) == pytest.approx(
                np.radians((own.dxf.end_angle - own.dxf.start_angle) % 360)
            )
            known = [own.start_point, own.end_point]
        known = np.array([list(point) for point in known])
        forward = abs(known - [start, end]).max()
        assert min(forward, abs(known[::-1] - [start, end]).max()) < 1e-9
    assert at[0] == pytest.approx([0, 0, 2 * up])


def test_polylines_in_space_are_lines(sheet):
    space, read = sheet
    places = [(0, 0, 0), (1, 2, 3), (4, 0, 1)]
    space.add_polyline3d(places, close=True)
    program = read(order="file").program
    assert ends(program)[-4:] == pytest.approx(np.array([*places, places[0]]), abs=1e-12)


def test_a_smoothed_polyline_is_what_the_smoothing_made(sheet):
    space, read = sheet
    made = space.add_polyline2d([(0, 0), (5, 9), (10, 0)])
    made.vertices[1].dxf.flags |= 16  # a control point, which the curve does not run through
    assert len(read(order="file", speed=1).program.segments) == 1


@pytest.mark.parametrize(
    ("first", "last", "axis", "up"),
    [
        (0, tau, (8, 0, 0), 1),
        (0.3, 2, (8, 0, 0), 1),
        (5, 1, (3, 4, 0), -1),
        (0, tau, (8, 0, 0), -1),
        (1, 2, (0, 3, 4), 1),
    ],
)
@pytest.mark.parametrize("deviation", [1e-5, 1e-7])
def test_ellipses_stay_within_the_tolerance_that_is_told(sheet, first, last, axis, up, deviation):
    space, read = sheet
    normal = (1, 0, 0) if axis[2] else (0, 0, up)
    space.add_ellipse((3, 2, 1), axis, 0.4, first, last, dxfattribs={"extrusion": normal})
    found = read(deviation=deviation, speed=1)
    points = found.outline.strokes[-1] * 1e3
    major, minor = np.array(axis, float), 0.4 * np.cross(normal, axis)
    fine = np.linspace(first, first + ((last - first) % tau or tau), 400_001)
    exact = [3, 2, 1] + np.cos(fine)[:, None] * major + np.sin(fine)[:, None] * minor
    # 400 001 points lie 7 mm·2π/4e5 apart: the nearest is off by half of that, at right angles to
    # the distance
    off = cKDTree(exact).query(points)[0].max()
    along = 8 * tau / 400_000 / 2
    assert off <= hypot(deviation * 1e3, along)
    said = float(found.warnings[0].split("off by ")[1].split()[0]) * 1e-3
    assert said <= deviation * 1e3
    # the points of the figure may lie elsewhere than those that were measured at
    assert off <= hypot(1.2 * said, along)
    found_ends, exact_ends = points[[0, -1]], exact[[0, -1]]
    assert min(abs(found_ends - exact_ends).max(), abs(found_ends[::-1] - exact_ends).max()) < 1e-9


def test_a_round_ellipse_is_an_arc(sheet):
    space, read = sheet
    space.add_ellipse((3, 2), (0, 5), 1.0, 0, pi / 2)
    ((start, arc),) = contours(read(order="file", speed=1).program)[0]
    assert start == pytest.approx([3, 7, 0])
    assert (arc.angle, arc.normal[2]) == (pytest.approx(pi / 2), 1)


def test_splines_follow_their_b_spline(sheet):
    space, read = sheet
    made = space.add_open_spline([(0, 0), (5, 12), (9, -4), (14, 6), (20, 3, 2)])
    weighted = space.add_rational_spline([(0, 30), (5, 42), (9, 26), (14, 36)], [1, 3, 0.5, 1])
    found = read(order="file")
    for entity, stroke in zip((made, weighted), found.outline.strokes[::2], strict=True):
        tool = entity.construction_tool()
        exact = np.array([list(point) for point in tool.points(np.linspace(0, tool.max_t, 20_001))])
        apart = np.linalg.norm(np.diff(exact, axis=0), axis=1).max()
        assert cKDTree(exact).query(stroke * 1e3)[0].max() < hypot(1.2e-3, apart / 2)
        assert stroke[[0, -1]] * 1e3 == pytest.approx(exact[[0, -1]], abs=1e-9)


def test_a_spline_with_a_corner_is_parted_there(sheet):
    space, read = sheet
    corner = space.add_spline(degree=2)
    corner.control_points = [(0, 0), (5, 5), (10, 0), (15, 5), (20, 0)]
    corner.knots = [0, 0, 0, 1, 1, 2, 2, 2]
    polygon = space.add_spline(degree=1)
    polygon.control_points, polygon.knots = [(0, 9), (5, 9), (5, 20)], [0, 0, 1, 2, 2]
    first, second = contours(read(order="file", speed=1).program)
    assert [type(part) for _, part in first] == [Spline, Spline]
    assert first[1][0] == pytest.approx([10, 0, 0], abs=1e-6)
    assert [type(part) for _, part in second] == [Line, Line]


def test_splines_of_fit_points_pass_through_them(sheet):
    space, read = sheet
    through = np.array([(0, 0, 0), (5, 3, 0), (9, -2, 0), (14, 1, 0)])
    space.add_spline(through.tolist())
    stroke = read(order="file").outline.strokes[-1] * 1e3
    for point in through:
        assert (
            np.linalg.norm(stroke - point, axis=1).min() < 0.05
        )  # the distance of points of the figure
    assert stroke[[0, -1]] == pytest.approx(through[[0, -1]])


# --- full turns
# -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "last"),
    [
        (0, 360), (90, 450), (-180, 180), (180, -180), (360, 0), (0, 360.0000001), (0, 360.00001), (12.5, 372.5),
        (1e-9, 360), (0, 720), (30, 390.001), (-45, 315),
    ],
)  # fmt: skip
def test_arcs_between_different_angles_of_one_place_are_full_turns(sheet, first, last):
    space, read = sheet
    space.add_arc((10, 5), 3, first, last)
    found = read(order="file", speed=1)
    ((start, arc),) = contours(found.program)[0]
    assert arc.angle == tau
    assert start == pytest.approx(
        [10 + 3 * cos(np.radians(first)), 5 + 3 * sin(np.radians(first)), 0]
    )
    assert found.entities == {"ARC": 1}


@pytest.mark.parametrize(
    ("first", "last", "turn"),
    [(0, 370, 10), (0, 0.001, 0.001), (359.999, 0, 0.001), (0, 359.99, 359.99), (350, 370, 20)],
)
def test_arcs_of_less_or_more_than_a_full_turn_end_where_they_are_stored_to_end(
    sheet, first, last, turn
):
    space, read = sheet
    space.add_arc((10, 5), 300, first, last)
    ((_, arc),) = contours(read(order="file", speed=1).program)[0]
    assert arc.angle == pytest.approx(np.radians(turn), rel=1e-9)


@pytest.mark.parametrize("last", [tau, 6.28319, 6.2831855, 6.2832, 6.283186, 2 * tau])
@pytest.mark.parametrize("ratio", [0.4, 1.0])
def test_ellipses_to_a_rounded_full_turn_are_full_turns(sheet, last, ratio):
    """The circumference of an ellipse is 4 a E(1 − ratio²); of a curve beside it at d, 2 π d more
    or less.
    """
    from scipy.special import ellipe

    deviation = 1e-9  # m; the way is in mm
    space, read = sheet
    space.add_ellipse((3, 2), (8, 0), ratio, 0, last)
    found = read(order="file", deviation=deviation)
    way = hypot(11, 2) + 4 * 8 * ellipe(1 - ratio**2)
    assert found.outline.length * 1e3 == pytest.approx(way, abs=tau * deviation * 1e3)
    assert found.outline.strokes[-1][-1] == pytest.approx(found.outline.strokes[-1][0], abs=1e-12)


def test_curves_between_equal_stored_angles_are_points(sheet):
    space, read = sheet
    space.add_line((0, 0), (9, 0))
    space.add_arc((3, 3), 2, 90, 90)
    space.add_ellipse((3, 3), (8, 0), 0.4, 1.5, 1.5)
    found = read()
    assert len(found.program.segments) == 1
    assert any("skipped 2 shapes without length" in line for line in found.warnings)


# --- bulges and knots
# ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("heavy", [True, False])
@pytest.mark.parametrize("bulge", [1e-8, -1e-8, 3e-10, -1e-12, 1e-15, 5e-324])
@pytest.mark.parametrize("side", [0.5, 40.0, 5000.0])
def test_sides_with_a_bulge_of_rounding_are_straight(sheet, heavy, bulge, side):
    """The arc rises bulge/2 of its side above it: 25 nm of 5 m."""
    space, read = sheet
    rows = [(0, 0, 0), (side, 0, bulge), (side, side, 0.5), (0, side, 0)]
    (space.add_polyline2d if heavy else space.add_lwpolyline)(rows, format="xyb")
    kinds = [type(part) for _, part in contours(read(order="file", speed=1).program)[0]]
    assert kinds == [Line, Line, Arc]


def test_a_small_bulge_that_matters_is_an_arc(sheet):
    space, read = sheet
    space.add_lwpolyline([(0, 0, 1e-3), (10, 0, 0)], format="xyb")
    ((_, part),) = contours(read(order="file", speed=1).program)[0]
    assert part.angle == pytest.approx(4e-3, rel=1e-6)


def _spline(space, degree, knots, points):
    made = space.add_spline(degree=degree)
    made.control_points, made.knots = points, knots


def _fill_in(points):
    """Points of a polygon that lie at most 0.2 mm apart."""
    shares = [
        np.linspace(0, 1, 2 + int(np.linalg.norm(b - a) / 0.2))[:, None]
        for a, b in pairwise(points)
    ]
    return np.concatenate(
        [a + share * (b - a) for (a, b), share in zip(pairwise(points), shares, strict=True)]
    )


def _dense(found):
    """Points of all contours in mm, at most 0.2 mm apart."""
    drawn = zip(found.program.segments, found.outline.strokes, strict=True)
    return np.concatenate(
        [_fill_in(stroke * 1e3) for part, stroke in drawn if part.speed is not None]
    )


def _de_boor(degree, knots, points, t, from_left):
    """A point of a B-spline by the recursion of de Boor, in the span on the side of t that is asked
    for.
    """
    knots = np.array(knots, float)
    k = int(np.searchsorted(knots, t, "left" if from_left else "right")) - 1
    d = [np.array(points[j + k - degree], float) for j in range(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[j + k - degree], knots[j + 1 + k - r]
            share = (t - low) / (high - low)
            d[j] = (1 - share) * d[j - 1] + share * d[j]
    return d[degree]


@pytest.mark.parametrize("gap", [0.0, 7.0])
@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_a_knot_repeated_once_more_than_the_degree_splits_a_spline(sheet, degree, gap):
    space, read = sheet
    rng = np.random.default_rng(degree)
    n = degree + 3
    points = np.cumsum(rng.uniform(1, 5, (2 * n, 2)) * [1, -0.4], 0)
    points[n:] += points[n - 1] - points[n] + [0, gap]
    inner = [1.0, 2.0]
    half = [*[0.0] * (degree + 1), *inner, *[3.0] * (degree + 1)]
    knots = [*half, *[3 + x for x in inner], *[6.0] * (degree + 1)]
    _spline(space, degree, knots, points.tolist())
    program = read(order="file", speed=1).program
    parts = contours(program)
    assert len(parts) == (2 if gap else 1)
    begins = [start for start, _ in parts[0]] + ([start for start, _ in parts[1]] if gap else [])
    after = _de_boor(degree, knots, points, 3.0, from_left=False)
    assert any(np.linalg.norm(start[:2] - after) < 1e-9 for start in begins)
    everything = _dense(read(order="file", speed=1))
    for t in np.linspace(0.01, 5.99, 40):
        exact = [*_de_boor(degree, knots, points, t, from_left=True), 0]
        assert (
            np.linalg.norm(everything - exact, axis=1).min() < 0.13
        )  # points of the figure lie 0.2 mm apart
    assert ends(program)[-1][:2] == pytest.approx(points[-1])


def test_knots_of_a_corner_may_differ_by_rounding(sheet):
    space, read = sheet
    points = [(0, 0), (5, 5), (10, 0), (15, 5), (20, 0)]
    _spline(space, 2, [0, 0, 0, 0.333333333, 0.3333333333, 1, 1, 1], points)
    (parts,) = contours(read(order="file", speed=1).program)
    assert len(parts) == 2
    assert parts[1][0] == pytest.approx([10, 0, 0], abs=1e-6)


# --- blocks
# ---------------------------------------------------------------------------------------------------------


def _fill(block):
    """One entity of each kind that is traced, some of them seen from below."""
    block.add_line((0, 0), (10, 1))
    block.add_arc((10, 5), 4, 270, 60)
    block.add_arc((-8, 5), 3, 20, 200, dxfattribs={"extrusion": (0, 0, -1)})
    block.add_circle((4, 12), 2)
    block.add_lwpolyline(
        [(0, 20, 0.5), (6, 20, -1.5), (6, 26, 0), (0, 27, 0)], format="xyb", close=True
    )
    block.add_ellipse((3, 32), (5, 1), 0.4, 0.3, 4)
    block.add_open_spline([(0, 40), (5, 48), (9, 36), (14, 44)])
    block.add_polyline3d([(0, 50, 0), (3, 52, 2), (6, 50, 1)])


def _flat_points(entities):
    """Points of ezdxf's own disassembly of the entities, at most 0.001 mm off them."""
    from ezdxf.disassemble import recursive_decompose
    from ezdxf.path import make_path

    found = []
    for entity in recursive_decompose(entities):
        found.append(
            _fill_in(
                np.array([list(point) for point in make_path(entity).flattening(1e-3, segments=16)])
            )
        )
    return np.concatenate(found)


def _assert_same_curves(found, exact, apart=0.2):
    """Each drawn point lies on an exact curve, and each of those is drawn; exact points lie `apart`
    mm apart.
    """
    drawn = _dense(found)
    assert cKDTree(exact).query(drawn)[0].max() < 0.6 * apart
    assert cKDTree(drawn).query(exact)[0].max() < 0.13


PLACED = {
    "moved": {}, "turned": {"rotation": 37}, "scaled": {"xscale": 1.5, "yscale": 1.5, "zscale": 1.5},
    "mirrored": {"xscale": -1}, "mirrored twice": {"xscale": -1, "yscale": -1, "rotation": 20},
    "stretched": {"xscale": 2, "yscale": 0.5, "rotation": -70}, "stretched and mirrored": {"xscale": 2, "yscale": -0.7},
    "from below": {"extrusion": (0, 0, -1), "rotation": 15}, "upright": {"extrusion": (1, 2, 2), "yscale": -1.2},
    "array": {"row_count": 2, "column_count": 3, "row_spacing": 70, "column_spacing": 40, "rotation": 10, "xscale": -1},
    "array on one place": {"row_count": 3, "column_count": 2, "column_spacing": 40},
}  # fmt: skip


@pytest.mark.parametrize("placed", PLACED)
def test_blocks_are_what_ezdxf_takes_apart(sheet, placed):
    space, read = sheet
    block = space.doc.blocks.new("PART", base_point=(3, 4, 1))
    _fill(block)
    space.add_blockref("PART", (20, -10, 5), dxfattribs=PLACED[placed])
    found = read(speed=1)
    _assert_same_curves(found, _flat_points(space))
    copies = {"array": 6, "array on one place": 2}.get(placed, 1)
    assert found.entities == {
        "ARC": 2 * copies, "CIRCLE": copies, "ELLIPSE": copies, "LINE": copies, "LWPOLYLINE": copies,
        "POLYLINE": copies, "SPLINE": copies,
    }  # fmt: skip


def test_nested_blocks_are_sheared_where_an_outer_one_is_stretched(sheet):
    """Held against the product of the maps: ezdxf's own way to take such blocks apart has no
    shear.
    """
    space, read = sheet
    inner = space.doc.blocks.new("INNER", base_point=(1, 1))
    _fill(inner)
    outer = space.doc.blocks.new("OUTER", base_point=(-5, 2))
    outer.add_blockref("INNER", (0, 0), dxfattribs={"rotation": 30, "xscale": 2})
    array = {"column_count": 2, "column_spacing": 30, "rotation": -10}
    outer.add_blockref("INNER", (60, 0), dxfattribs={"xscale": -1, **array})
    space.add_blockref(
        "OUTER", (7, 8), dxfattribs={"rotation": 45, "xscale": 0.5, "yscale": 1.5, "zscale": 1}
    )

    def turn(degrees):
        return Rotation.from_euler("z", degrees, degrees=True).as_matrix()

    points = _flat_points(inner) - [1, 1, 0]
    first = points @ (turn(30) @ np.diag([2, 1, 1])).T
    mirrored = points @ (turn(-10) @ np.diag([-1, 1, 1])).T + [60, 0, 0]
    both = np.concatenate([first, mirrored, mirrored + turn(-10) @ [30, 0, 0]])
    exact = (both - [-5, 2, 0]) @ (turn(45) @ np.diag([0.5, 1.5, 1])).T + [7, 8, 0]
    _assert_same_curves(read(speed=1), exact, 0.2 * 2 * 1.5)


def test_arcs_and_full_turns_of_blocks_remain_exact(sheet):
    """A mirrored quarter from (4, 0) to (0, 4) runs from (-4, 0) to (0, 4), clockwise; a full turn
    remains one.
    """
    space, read = sheet
    block = space.doc.blocks.new("B")
    block.add_arc((0, 0), 4, 0, 90)
    block.add_arc((20, 0), 3, 90, 450)
    space.add_blockref("B", (0, 0), dxfattribs={"xscale": -1})
    quarter, whole = contours(read(order="file", speed=1).program)
    ((start, arc),) = quarter
    assert start == pytest.approx([-4, 0, 0])
    assert arc.angle * arc.normal[2] == pytest.approx(-pi / 2, abs=1e-12)
    ((start, arc),) = whole
    assert (abs(arc.angle), arc.centre[0]) == (tau, pytest.approx(-0.02))
    assert start == pytest.approx([-20, 3, 0])


def test_layers_of_blocks(sheet):
    """Entities on layer 0 lie on the layer of their INSERT; a frozen one hides all of it, one that
    is off its own.
    """
    space, read = sheet
    for name in ("CUT", "MARK", "NOTES"):
        space.doc.layers.add(name)
    inner, outer = space.doc.blocks.new("INNER"), space.doc.blocks.new("OUTER")
    inner.add_line((0, 0), (5, 0))
    inner.add_circle((2, 2), 1, dxfattribs={"layer": "MARK"})
    inner.add_text("here", dxfattribs={"layer": "NOTES"})
    outer.add_blockref("INNER", (0, 0))
    outer.add_arc((9, 9), 1, 0, 90, dxfattribs={"invisible": 1})
    made = space.add_blockref("OUTER", (0, 0), dxfattribs={"layer": "CUT"})
    assert read().entities == {"CIRCLE": 1, "LINE": 1}
    assert any("skipped TEXT (1×)" in line for line in read().warnings)
    assert any("1 entity marked invisible" in line for line in read().warnings)
    assert read(layers="cut").entities == {"LINE": 1}
    assert read(layers="mark").entities == {"CIRCLE": 1}
    assert read(skip="mark").entities == {"LINE": 1}
    with pytest.raises(FileError, match="nothing to run"):
        read(skip="cut")
    cut = space.doc.layers.get("CUT")
    cut.off()
    assert read().entities == {"CIRCLE": 1}
    cut.on()
    cut.freeze()
    with pytest.raises(FileError, match="nothing to run"):
        read()
    cut.thaw()
    made.dxf.invisible = 1
    with pytest.raises(FileError, match="nothing to run"):
        read()


def test_blocks_that_cannot_be_taken_apart_are_refused_by_name(sheet):
    from ezdxf.xclip import XClip

    space, read = sheet
    space.doc.layers.add("X")
    blocks = space.doc.blocks
    space.add_line((0, 0), (9, 0))
    blocks.new("CLIPPED").add_line((0, 0), (1, 1))
    for name in ("ONE", "TWO"):
        blocks.new(name)
    blocks.get("ONE").add_blockref("TWO", (0, 0))
    blocks.get("TWO").add_blockref("ONE", (0, 0))
    space.doc.add_xref_def("other.dxf", "OTHER")
    made = {
        words: space.add_blockref(name, (0, 0), dxfattribs={"layer": "X"})
        for name, words in (
            ("GONE", 'the drawing has no block "GONE"'), ("OTHER", 'block "OTHER" is in another drawing'),
            ("CLIPPED", 'block "CLIPPED" is clipped'),
        )
    }  # fmt: skip
    space.add_blockref("ONE", (0, 0), dxfattribs={"layer": "X"})
    XClip(made['block "CLIPPED" is clipped']).set_block_clipping_path([(0, 0), (1, 1)])
    with pytest.raises(FileError) as refused:
        read()
    lines = str(refused.value).splitlines()
    assert len(lines) == 4
    for words, insert in made.items():
        assert any(words in line and line.endswith(f"handle {insert.dxf.handle}") for line in lines)
    assert 'block "ONE" contains itself' in str(refused.value)
    assert read(skip="x").entities == {"LINE": 1}


def test_faults_of_blocks_are_named_once(sheet):
    space, read = sheet
    block = space.doc.blocks.new("B")
    block.add_solid([(0, 0), (1, 0), (0, 1)])
    bad = block.add_circle((0, 0), -1)
    for k in range(3):
        space.add_blockref("B", (k, 0))
    with pytest.raises(FileError) as refused:
        read()
    lines = str(refused.value).splitlines()
    assert len(lines) == 2
    assert any(f"CIRCLE {bad.dxf.handle}: radius -1" in line for line in lines)


def test_blocks_that_multiply_without_end_are_refused(sheet, monkeypatch):
    """Ten nested arrays of a hundred copies would be 1e20 lines."""
    monkeypatch.setattr("planner.sources.dxf_blocks.MAX_COPIES", 1000)
    space, read = sheet
    space.doc.blocks.new("B0").add_line((0, 0), (1, 0))
    array = {"row_count": 10, "column_count": 10, "row_spacing": 2, "column_spacing": 2}
    for k in range(1, 10):
        space.doc.blocks.new(f"B{k}").add_blockref(f"B{k - 1}", (0, 0), dxfattribs=array)
    space.add_blockref("B9", (0, 0), dxfattribs=array)
    with pytest.raises(FileError, match="blocks make more than"):
        read()


# --- chaining
# -------------------------------------------------------------------------------------------------------

ROUNDED = [
    ("line", (5, 0), (20, 0)), ("arc", (25, 0), 5, 0, 180), ("line", (30, 0), (45, 0)), ("arc", (45, 5), 5, 270, 360),
    ("line", (50, 5), (50, 40)), ("arc", (45, 40), 5, 0, 90), ("line", (45, 45), (5, 45)), ("arc", (5, 40), 5, 90, 180),
    ("line", (0, 40), (0, 5)), ("arc", (5, 5), 5, 180, 270),
]  # fmt: skip
"""A closed contour, with a half circle cut in: its arcs run against the clock, whichever way the
contour goes.
"""


@settings(max_examples=12, deadline=None, derandomize=True)
@given(
    order=st.permutations(ROUNDED),
    flips=st.lists(st.booleans(), min_size=10, max_size=10),
    gap=st.floats(0, 9e-4),
)
def test_whatever_the_order_and_the_directions_a_contour_comes_back(
    tmp_path_factory, order, flips, gap
):
    """Ends are off by up to 0.9 µm each, and the tolerance is 2 µm."""
    document = ezdxf.new(units=4)
    space, rng = document.modelspace(), random.Random(3)
    for (kind, *own), flip in zip(order, flips, strict=True):
        if kind == "line":
            start, end = own[::-1] if flip else own
            space.add_line(*[(x + rng.uniform(-gap, gap), y) for x, y in (start, end)])
        elif flip:  # seen from below
            (x, y), radius, first, last = own
            space.add_arc(
                (-x, y), radius, 180 - last, 180 - first, dxfattribs={"extrusion": (0, 0, -1)}
            )
        else:
            space.add_arc(*own)
    path = tmp_path_factory.mktemp("dxf") / "part.dxf"
    document.saveas(path)
    program = import_program(path, speed=1, tolerance=2e-6, retract=5e-3).program
    (parts,) = contours(program)
    assert len(parts) == 10
    at = ends(program)
    assert at[-2] == pytest.approx(at[3], abs=2.1e-3)
    length = sum(
        np.linalg.norm(part.to * 1e3 - start)
        if isinstance(part, Line)
        else abs(part.angle) * np.linalg.norm(start - part.centre * 1e3)
        for start, part in parts
    )
    assert length == pytest.approx(15 + 15 + 35 + 40 + 35 + 10 * pi / 2 * 2 + 5 * pi, abs=0.05)
    for start, part in parts:
        if isinstance(part, Arc):
            known = [own for kind, *own in ROUNDED if kind == "arc"]
            near = min(
                known, key=lambda own: np.linalg.norm(np.array(own[0]) - part.centre[:2] * 1e3)
            )
            # where ends are off, an arc is led through them: by so much it may lie elsewhere
            assert np.linalg.norm(np.array(near[0]) - part.centre[:2] * 1e3) <= 2 * gap + 1e-9
            assert abs(part.angle) == pytest.approx(np.radians(near[3] - near[2]), abs=1e-12)
            assert np.linalg.norm(start - part.centre * 1e3) == pytest.approx(5, abs=2 * gap + 1e-9)


def test_the_tolerance_is_what_parts_contours(sheet):
    space, read = sheet
    space.add_line((0, 0), (10, 0))
    space.add_line((10.02, 0), (20, 0))
    space.add_arc((20.02, 5), 5, 270, 0)
    assert len(contours(read(speed=1).program)) == 3
    (parts,) = contours(read(speed=1, tolerance=2.1e-5).program)
    start, arc = parts[2]
    assert start == pytest.approx([20, 0, 0])
    assert ends(read(speed=1, tolerance=2.1e-5).program)[-1] == pytest.approx([25.02, 5, 0])
    assert arc.angle == pytest.approx(pi / 2)
    space.delete_entity(space.query("ARC").first)
    with pytest.raises(MotionError, match="no lines or curves longer than the tolerance"):
        read(tolerance=1.0)
    for k in range(200):
        space.add_line((k, 0), (k, 1500))
    with pytest.raises(MotionError, match="tolerance 1000 mm: too many ends"):
        read(tolerance=1.0)


def test_at_a_fork_contours_go_on_straight(sheet):
    space, read = sheet
    for far in ((10, 0.2), (-10, 0), (0.3, 10), (0, -10)):
        space.add_line((0, 0), far)
    space.add_line((50, 50), (51, 50))
    found = read(speed=1)
    assert any("1 point with more than two ends" in told for told in found.warnings)
    ways = [[part for _, part in parts] for parts in contours(found.program)]
    assert sorted(map(len, ways)) == [1, 2, 2]
    for way, at in zip(ways, contours(found.program), strict=True):
        if len(way) == 2:
            first, last = at[0][0], way[1].to * 1e3
            assert np.linalg.norm(first - last) == pytest.approx(20, abs=0.02)


def test_a_star_of_thousands_is_no_crowd(sheet):
    space, read = sheet
    for k in range(2000):
        space.add_line((0, 0), (100 * cos(tau * k / 2000), 100 * sin(tau * k / 2000)))
    assert len(contours(read(speed=1, order="file").program)) == 2000


# --- the way between, and into contours
# ------------------------------------------------------------------------------


def test_heights_speeds_and_joins(sheet):
    space, read = sheet
    space.add_line((10, 0), (20, 0))
    space.add_arc((20, 5), 5, 270, 90)
    program = read(retract=4e-3, approach=1e-3, rapid=0.05, speed=0.01, blend=1e-5).program
    at = ends(program)
    assert at == pytest.approx(
        np.array(
            [
                [0, 0, 0],
                [0, 0, 4],
                [10, 0, 4],
                [10, 0, 1],
                [10, 0, 0],
                [20, 0, 0],
                [20, 10, 0],
                [20, 10, 4],
            ]
        ),
        abs=1e-12,
    )
    assert [part.speed for part in program.segments] == [0.05, 0.05, 0.05, 0.01, 0.01, 0.01, 0.05]
    joins = [part.join for part in program.segments]
    assert joins[4] == Blend(1e-5)
    assert all(isinstance(join, Stop) for k, join in enumerate(joins) if k != 4)
    assert isinstance(read(retract=4e-3).program.segments[3].join, Through)
    space.add_line((0, 0, 1), (5, 5, 2))
    with pytest.raises(MotionError, match="retract 1 mm must be at least 2 mm"):
        read(retract=1e-3)
    space.add_arc(
        (0, 0, 0), 7, 0, 180, dxfattribs={"extrusion": (0, -1, 0)}
    )  # a bow that stands upright
    with pytest.raises(MotionError, match="retract 4 mm must be at least 7 mm"):
        read(retract=4e-3)


@pytest.mark.parametrize("lead", ["line", "arc"])
@pytest.mark.parametrize("side", ["outside", "inside"])
@pytest.mark.parametrize("clockwise", [True, False])
def test_a_lead_in_is_tangential_and_as_long_as_stated(sheet, lead, side, clockwise):
    space, read = sheet
    corners = [(10, 10), (30, 10), (30, 40), (10, 40)]
    space.add_lwpolyline(corners[::-1] if clockwise else corners, close=True)
    program = read(speed=1, lead_in=3e-3, lead=lead, side=side).program
    (parts,) = contours(program)
    (start, first), (begin, onto) = parts[:2]
    ahead = (onto.to * 1e3 - begin) / np.linalg.norm(onto.to * 1e3 - begin)
    assert len(parts) == 5
    if lead == "line":
        assert begin - start == pytest.approx(3 * ahead)
        return
    radius = np.linalg.norm(begin - first.centre * 1e3)
    assert radius * abs(first.angle) == pytest.approx(3)
    arriving = np.cross(first.normal, begin - first.centre * 1e3) * np.sign(first.angle) / radius
    assert arriving == pytest.approx(ahead, abs=1e-12)
    middle = [20, 25, 0]
    assert (np.dot(first.centre * 1e3 - begin, np.array(middle) - begin) > 0) == (side == "inside")


def test_only_closed_contours_are_led_into(sheet):
    space, read = sheet
    space.add_line((10, 0), (20, 0))
    assert len(read(lead_in=1e-3, order="file").program.segments) == 2


def way_between(program):
    """mm of lines that are not capped: the way between contours."""
    return sum(
        np.linalg.norm(end - start)
        for part, (start, end) in zip(program.segments, pairwise(ends(program)), strict=True)
        if part.speed is None
    )


def test_the_order_shortens_the_way(sheet):
    space, read = sheet
    rng = random.Random(2)
    for _ in range(60):
        x, y = rng.uniform(0, 300), rng.uniform(0, 300)
        if rng.random() < 0.5:
            space.add_line((x, y), (x + rng.uniform(-9, 9), y + rng.uniform(-9, 9)))
        else:
            space.add_circle((x, y), rng.uniform(1, 4))
    near, as_drawn = read(speed=1).program, read(speed=1, order="file").program
    assert sorted(map(len, contours(near))) == sorted(map(len, contours(as_drawn)))
    # 60 random places in a square: about 0.7124 √(60 · 300²) mm by the best way; 0.52 · 300 mm each
    # as they come
    assert way_between(near) < 1.25 * 0.7124 * np.sqrt(60) * 300
    assert way_between(as_drawn) > 60 * 0.4 * 300


@pytest.mark.parametrize("seed", range(12))
def test_a_tour_is_never_longer_than_from_nearest_to_nearest(seed):
    rng = np.random.default_rng(seed)
    closed = (rng.random(6) < 0.5).tolist()
    entries = [rng.uniform(0, 1, (3 if loop else 2, 3)) for loop in closed]
    start = np.zeros(3)

    def length(way):
        here, total = start, 0.0
        for k, by in way:
            total += np.linalg.norm(entries[k][by] - here)
            here = entries[k][by if closed[k] else 1 - by]
        return total

    left, here, plain = set(range(6)), start, []
    while left:
        k, by = min(((k, by) for k in left for by in range(len(entries[k]))),
                    key=lambda pair: np.linalg.norm(entries[pair[0]][pair[1]] - here))  # fmt: skip
        plain.append((k, by))
        here = entries[k][by if closed[k] else 1 - by]
        left.remove(k)
    found = find_tour(start, entries, closed)
    assert sorted(k for k, _ in found) == list(range(6))
    assert length(found) <= length(plain) + 1e-12
    if all(not loop for loop in closed) or seed < 4:
        orders = permutations(range(6))
        # every order, each contour entered where it is nearest: no shorter way exists than the
        # least of these, halved
        best = min(length(_greedy(order, entries, closed, start)) for order in orders)
        assert length(found) <= 1.35 * best


def _greedy(order, entries, closed, start):
    way, here = [], start
    for k in order:
        by = int(np.linalg.norm(entries[k] - here, axis=1).argmin())
        way.append((k, by))
        here = entries[k][by if closed[k] else 1 - by]
    return way


# --- what a drawing says of itself
# ----------------------------------------------------------------------------------


@pytest.mark.parametrize("code", METRES)
def test_units_are_those_that_it_states(tmp_path, code):
    document = ezdxf.new(units=code)
    document.modelspace().add_line((0, 0), (1, 0))
    document.saveas(tmp_path / "part.dxf")
    metres = {1: 0.0254, 2: 0.3048, 4: 0.001, 5: 0.01, 6: 1, 9: 25.4e-6, 13: 1e-6, 14: 0.1}.get(
        code, METRES[code]
    )
    found = import_program(tmp_path / "part.dxf", tolerance=1e-12)
    assert found.program.segments[-1].to[0] == pytest.approx(metres, rel=1e-15)


def test_without_a_unit_it_has_to_be_stated(tmp_path, sheet):
    bare = "0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n10\n0\n20\n0\n11\n1\n21\n0\n0\nENDSEC\n0\nEOF\n"
    (tmp_path / "bare.dxf").write_text(bare)
    document = ezdxf.new(units=0)
    document.modelspace().add_line((0, 0), (1, 0))
    document.saveas(tmp_path / "none.dxf")
    ezdxf.new("R12").saveas(tmp_path / "old.dxf")
    for name in ("bare", "none", "old"):
        with pytest.raises(
            FileError, match=r"states no unit \(\$INSUNITS\); give the option length"
        ):
            import_program(tmp_path / f"{name}.dxf")
    assert import_program(tmp_path / "bare.dxf", length="in").program.segments[-1].to[0] == 0.0254
    space, read = sheet
    space.add_line((0, 0), (1, 0))
    other = read(length="in")
    assert other.program.segments[-1].to[0] == 0.0254
    assert "states units of 1 mm; in was taken" in other.warnings[0]
    with pytest.raises(MotionError, match="not convertible"):
        read(length="deg")


def test_annotations_are_skipped_with_a_warning_and_geometry_is_not(sheet):
    space, read = sheet
    space.add_line((0, 0), (9, 0))
    alone = read()
    space.add_text("here")
    space.add_mtext("there")
    space.add_linear_dim((0, 2), (0, 0), (9, 0)).render()
    space.add_hatch()
    for _ in range(2):
        space.add_point((1, 1))
    found = read()
    assert found.entities == {"LINE": 1}
    assert ends(found.program).tolist() == ends(alone.program).tolist()
    told = "skipped DIMENSION (1×), HATCH (1×), MTEXT (1×), POINT (2×), TEXT (1×): nothing to trace"
    assert any(told in warning for warning in found.warnings)
    with pytest.raises(FileError, match="TEXT is not supported: take it out"):
        read(strict=True)
    space.add_solid([(0, 0), (1, 0), (0, 1)])
    with pytest.raises(FileError, match="SOLID is not supported") as refused:
        read()
    assert "TEXT" not in str(refused.value)


def test_what_is_not_supported_is_listed_and_the_drawing_refused(sheet):
    space, read = sheet
    space.doc.layers.add("NOTES")
    block = space.doc.blocks.new("B")
    block.add_line((0, 0), (1, 1))
    space.add_line((0, 0), (9, 0))
    texts = [space.add_text("here", dxfattribs={"layer": "NOTES"}) for _ in range(150)]
    hatch = space.add_hatch()
    space.add_blockref("B", (0, 0), dxfattribs={"layer": "NOTES"})
    mesh = space.add_polymesh((3, 3))
    point = space.add_point((1, 1))
    with pytest.raises(FileError) as refused:
        read(strict=True)
    told = [str(line) for line in str(refused.value).splitlines()]
    assert len(told) == 4
    (line,) = [line for line in told if "TEXT" in line]
    assert 'layer "NOTES": TEXT is not supported' in line
    assert all(f" {text.dxf.handle}" in line for text in texts)
    for entity, words in (
        (hatch, "HATCH"),
        (mesh, "POLYLINE"),
        (point, "POINT"),
    ):
        assert any(words in line and line.endswith(f"handle {entity.dxf.handle}") for line in told)
    for entity in (hatch, mesh, point):
        space.delete_entity(entity)
    left = read(skip="notes")
    assert left.entities == {"LINE": 1}
    assert 'skipped 151 entities on layer "NOTES", as the options say' in left.warnings
    with pytest.raises(FileError, match=r'no layer "note".*nearest is "notes"'):
        read(skip="note")


def test_layers(sheet):
    space, read = sheet
    for number, name in enumerate(("CUT", "OFF", "ICE", "MARK")):
        space.doc.layers.add(name)
        space.add_line((0, number), (9, number), dxfattribs={"layer": name})
    space.add_line((0, 7), (9, 7), dxfattribs={"invisible": 1})
    space.doc.layers.get("OFF").off()
    space.doc.layers.get("ICE").freeze()
    space.doc.layout("Layout1").add_line((0, 0), (1, 1))
    found = read()
    assert found.entities == {"LINE": 2}
    told = " ".join(found.warnings)
    for words in ('"OFF", which is off or frozen', '"ICE", which is', "skipped 1 entity marked invisible",
                  'not read: 1 entity of layout "Layout1"'):  # fmt: skip
        assert words in told
    assert read(layers="cut, off").entities == {"LINE": 2}


def test_the_plane_may_lie_anywhere(sheet):
    space, read = sheet
    space.add_line((10, 0), (20, 5))
    program = read(origin="1 mm, 2 mm, 30 mm, 90 deg, 0 deg, 0 deg", retract=3e-3).program
    assert ends(program)[-2] == pytest.approx([20, 5, 0])
    assert program.work.apply(np.array([0.02, 0.005, 0.001])) == pytest.approx(
        [0.021, 0.001, 0.035]
    )
    # it begins at home, up along the drawing's normal if that lies below the height of the way
    home = program.work.inv().translation * 1e3
    assert ends(program, home)[1:3] == pytest.approx(np.array([[*home[:2], 3], [10, 0, 3]]))


def test_widths_and_lengths_of_nothing_are_told(sheet):
    space, read = sheet
    space.add_lwpolyline([(0, 0, 1, 1), (5, 0, 1, 1), (5, 0, 0, 0), (9, 3, 0, 0)], format="xyse")
    space.add_line((3, 3), (3, 3))
    space.add_circle((0, 0), 0)
    space.add_line((40, 40), (40.001, 40))
    found = read()
    told = " ".join(found.warnings)
    assert "skipped 3 shapes without length" in told
    assert "skipped 1 entity shorter than the tolerance" in told
    assert "1 entity with a width or a thickness" in told
    assert len(found.program.segments) == 2


# --- files that are none
# --------------------------------------------------------------------------------------------


def _saved(tmp_path, make):
    document = ezdxf.new(units=4)
    made = make(document.modelspace())
    document.saveas(tmp_path / "part.dxf")
    return made, (tmp_path / "part.dxf").read_bytes()


@pytest.mark.parametrize(
    "change",
    [
        lambda raw: b"", lambda raw: raw[: len(raw) // 2], lambda raw: raw[:-40], lambda raw: bytes(range(256)) * 64,
        lambda raw: b"\x89PNG\r\n\x1a\n" + bytes(100), lambda raw: b"hello\nworld\n",
        lambda raw: raw.replace(b"12.5", b"twelve"), lambda raw: raw.replace(b"LINE", b"L\xffNE"),
        lambda raw: raw[: raw.rfind(b"ENDSEC")] + b"EOF\n",
        lambda raw: b"AutoCAD Binary DXF\r\n\x1a\x00" + bytes(range(200)),
        lambda raw: b"0\nSECTION\n2\nENTITIES\n0\nFOO\n8\nL\n0\nENDSEC\n0\nEOF\n",
        lambda raw: b"0\nSECTION\n2\nENTITIES\n0\nLINE\n8\n0\n0\nENDSEC\n0\nEOF\n",
        lambda raw: b"0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n8\n0\n10\n1\n20\n1\n0\nENDSEC\n0\nEOF\n",
        lambda raw: b"0\nSECTION\n2\nENTITIES\n0\nENDSEC\n0\nEOF\n",
    ],
)  # fmt: skip
def test_broken_files_are_refused_with_their_name(tmp_path, change):
    _, raw = _saved(tmp_path, lambda space: space.add_line((12.5, 0), (3, 4)))
    (tmp_path / "bad.dxf").write_bytes(change(raw))
    with pytest.raises(FileError, match=r"bad\.dxf"):
        import_program(tmp_path / "bad.dxf", length="mm")


@pytest.mark.parametrize("version", ["R12", "R2000", "R2018"])
@pytest.mark.parametrize(
    "kind", ["DICTIONARY", "LAYER", "XRECORD", "MATERIAL", "GROUP", "BLOCK_RECORD", "ENDBLK", "FOO"]
)
def test_objects_among_entities_are_refused_at_their_line(tmp_path, version, kind):
    document = ezdxf.new(version, units=4)
    document.modelspace().add_line((0, 0), (5, 5))
    document.saveas(tmp_path / "part.dxf")
    text = (tmp_path / "part.dxf").read_text()
    at = text.index("  0\nENDSEC", text.index("ENTITIES"))
    text = text[:at] + f"  0\n{kind}\n  5\nFFFF\n" + text[at:]
    (tmp_path / "bad.dxf").write_text(text)
    with pytest.raises(FileError) as refused:
        import_program(tmp_path / "bad.dxf", length="mm")
    line = text[:at].count("\n") + 2
    assert str(refused.value).startswith(
        (f"{tmp_path / 'bad.dxf'}:{line}: ", f"{tmp_path / 'bad.dxf'}:{line + 2}: ")
    )


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda space: space.add_line((float("nan"), 0), (1, 1)), "is not a place"),
        (lambda space: space.add_line((0, 0), (1e300, 1)), "is not a place"),
        (lambda space: space.add_circle((0, 0), -1), "radius -1"),
        (lambda space: space.add_circle((0, 0), float("inf")), "radius inf"),
        (lambda space: space.add_arc((0, 0), 1, float("nan"), 3), "must be finite"),
        (lambda space: space.add_lwpolyline([(0, 0, float("nan")), (1, 0, 0)], format="xyb"), "bulge nan"),
        (lambda space: space.add_lwpolyline([(0, 0, 1e-6), (9e5, 0, 0)], format="xyb"), "bulge 1e-06"),
        (lambda space: space.add_lwpolyline([(0, 0, 1e200), (1, 0, 0)], format="xyb"), r"bulge 1e\+200"),
        (lambda space: space.add_ellipse((0, 0), (1, 0), 0.5, float("nan"), 1), "must be finite"),
        (lambda space: space.add_open_spline([(0, 0), (1, 1), (float("nan"), 1), (2, 2)]), "is not a place"),
        (lambda space: space.add_rational_spline([(0, 0), (1, 1), (3, 1), (2, 2)], [1, -1, 1, 1]), "weights"),
        (lambda space: space.add_spline(), "SPLINE"),
    ],
)  # fmt: skip
def test_entities_that_make_no_sense_are_told_by_their_handles(tmp_path, make, words):
    made, _ = _saved(tmp_path, make)
    with pytest.raises(FileError, match=words) as refused:
        import_program(tmp_path / "part.dxf")
    assert f"{made.dxftype()} {made.dxf.handle}: " in str(refused.value)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 0.0}, "tolerance 0.0"), ({"deviation": float("nan")}, "deviation nan"),
        ({"lead_in": -1.0}, "lead_in -1"), ({"approach": 1e-3}, "approach needs retract"),
        ({"retract": float("inf")}, "must be finite"), ({"origin": "1 mm"}, "origin"), ({"layers": "none"}, "no layer"),
    ],
)  # fmt: skip
def test_options_that_make_no_sense(sheet, options, words):
    space, read = sheet
    space.add_line((0, 0), (1, 1))
    with pytest.raises(MotionError, match=words):
        read(**options)


def test_without_ezdxf_the_extra_is_named(sheet, monkeypatch):
    space, read = sheet
    space.add_line((0, 0), (1, 1))
    read()
    monkeypatch.setitem(sys.modules, "ezdxf.filemanagement", None)
    with pytest.raises(MotionError, match=r"pip install 'pulsepath\[cad\]'"):
        import_program("part.dxf")


# --- from end to end
# ------------------------------------------------------------------------------------------------


def test_a_sheet_of_parts(tmp_path):
    """A small one of the benchmark: all its contours, each of them closed but the splines."""
    count = draw(tmp_path / "sheet.dxf", 200)
    found = import_program(tmp_path / "sheet.dxf", retract=5e-3, speed=1)
    assert sum(found.entities.values()) == 200
    parts = contours(found.program)
    assert len(parts) == count == 90
    assert sum(map(len, parts)) == 10 * (12 + 3 * 4 + 4 + 1)


def test_a_drawing_is_planned_and_certified(sheet, hexapod, tmp_path):
    space, read = sheet
    space.add_line((-5, 0), (5, 0))
    space.add_arc((5, 3), 3, 270, 90)
    space.add_line((5, 6), (-5, 6))
    space.add_ellipse((0, 3), (3, 0), 0.5)
    program = read(origin="0 mm, 0 mm, 25 mm", retract=2e-3, deviation=1e-5).program
    (tmp_path / "program.toml").write_text(program_toml(program), encoding="utf-8")
    made = plan(load_program(tmp_path / "program.toml"), hexapod, order=2)
    assert made.certificate.holds
    assert made.trajectory.at(made.trajectory.duration).pose.translation[-1] == pytest.approx(
        hexapod.home.translation + ends(program)[-1] * 1e-3 + [0, 0, 0.025]
    )


def test_any_bytes_are_a_program_or_a_refusal(tmp_path):
    """A small drawing, with bytes of it changed, lost and doubled."""
    document = ezdxf.new("R12")
    space = document.modelspace()
    space.add_line((0, 0), (5, 0))
    space.add_arc((5, 2), 2, 270, 90)
    space.add_polyline2d([(0, 0, 0.5), (0, 4, 0), (5, 4, 0)], format="xyb")
    document.saveas(tmp_path / "whole.dxf")
    raw, rng, read = (tmp_path / "whole.dxf").read_bytes(), random.Random(5), 0
    begin = raw.index(b"ENTITIES")
    for _ in range(60):
        changed = bytearray(raw)
        for _ in range(rng.randint(1, 2)):
            at = rng.randrange(begin, len(changed))
            match rng.randrange(3):
                case 0:
                    changed[at] = rng.choice(b"0123456789.-e \nX\xff\x00")
                case 1:
                    del changed[at : at + rng.randint(1, 30)]
                case _:
                    changed[at:at] = changed[at - 20 : at]
        (tmp_path / "part.dxf").write_bytes(changed)
        with suppress(MotionError):
            found = import_program(tmp_path / "part.dxf", length="mm", retract=1e3)
            read += 1
            assert np.isfinite(ends(found.program)).all()
    assert 0 < read < 60


def time_spline_evaluations():
    """Return the CPU time of calls of SciPy and NumPy as reading makes them, the least of three."""
    curve = BSpline(np.arange(17.0), np.cos(np.arange(39.0)).reshape(13, 3), 3)
    u = np.linspace(3.0, 13.0, 65)
    took = []
    for _ in range(3):
        begin = process_time()
        for _ in range(2000):
            places = curve(u)
            np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
            np.stack([places, places * u[:, None]], 2).max()
        took.append(process_time() - begin)
    return min(took)


@pytest.mark.parametrize(("splines", "usual"), [(False, 7.5), (True, 18.5)])
def test_curves_are_fitted_and_drawn_in_time(tmp_path, splines, usual):
    """150 of 10 000 entities, by the processor's time, the least of up to three.

    usual: times that 2000 evaluations of a spline take; the bound is 2.5 of it, so that a machine
    may be slow. An outline takes 0.03 s at most on the machine that this was written on.
    """
    path = tmp_path / "sheet.dxf"
    scatter(path, 3, splines)
    import_program(path, retract=5e-3)  # what is loaded the first time
    scatter(path, 150, splines)
    most_drawn = 0.1
    read, drawn = [], []
    for _ in range(3):
        begin = process_time()
        found = import_program(path, retract=5e-3)
        read.append(process_time() - begin)
        assert found.outline.length > 0
        drawn.append(process_time() - begin - read[-1])
        is_read = min(read) < 2.5 * usual * time_spline_evaluations()
        if is_read and min(drawn) < most_drawn * slowness():
            return
    pytest.fail(f"{min(read):.2f} s to read, {min(drawn):.2f} s to draw")


@pytest.mark.parametrize("wild", [False, True])
def test_the_length_of_a_spline_is_that_of_its_pieces(wild):
    """Against quadrature by SciPy of the pieces as they are run; wild: spans that all but turn."""
    from scipy.integrate import quad

    from planner.path.spline import spline

    turned = (
        np.random.default_rng(3).normal(size=(6, 3))
        if wild
        else [[k, 0.1 * k * k, 0] for k in range(6)]
    )
    corners = 1e-2 * np.cumsum(turned, 0)
    start = RigidTransform.from_components(corners[0], Rotation.identity())
    asked = sum(
        quad(
            lambda s, piece=piece: np.linalg.norm(piece.derivatives(np.array([s]))[1][0, :3]),
            0,
            piece.length,
        )[0]
        for piece in spline(start, corners[1:], None, 1)
    )
    found = outline(Program((Line(corners[0]), Spline(corners[1:])), "base"))
    # the outline is of the curve that the pieces follow within a thousandth of a chord
    assert found.length == pytest.approx(asked, rel=1e-4 if wild else 1e-5)
    assert found.strokes[1][-1] == pytest.approx(corners[-1], abs=1e-15)
