"""The workspace: proofs against points, machines whose reach is known, and the largest boxes and
spheres in it.
"""

from itertools import product
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.contour import ContourSet
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import Axis, Hexapod, Machine, MotionError, OutOfReach, workspace
from kinematics.analysis.containment import contains, uses
from kinematics.analysis.workspace import largest_block


class Gantry(Machine):
    """Three slides: it reaches a box."""

    freedom: ClassVar = ("x", "y", "z")
    characteristic_length = 1.0

    def expression(self, position, rotation, near):
        return position


class Tether(Gantry):
    """Two slides, and a line of limited length from the origin: it reaches a ball, or a shell."""

    def expression(self, position, rotation, near):
        return ca.vertcat(ca.norm_2(position), position[1:])


def gantry(**travel):
    slides = [Axis(name, travel=travel.get(name, (-1, 1))) for name in "xyz"]
    return Gantry("gantry", slides, RigidTransform.identity())


def tether(shortest, longest, home=0.5):
    axes = [
        Axis("line", travel=(shortest - home, longest - home)),
        Axis("y", travel=(-9, 9)),
        Axis("z", travel=(-9, 9)),
    ]
    return Tether("tether", axes, RigidTransform.from_translation([home, 0, 0]))


@pytest.fixture(scope="module")
def reaches(preset):
    """The preset's workspace in planes and volumes, level and tilted, and of one that every limit
    bounds.
    """
    tilted = Rotation.from_euler("XYZ", [6, -7, 3], degrees=True)
    slides = [Axis(f"leg{n}", travel=(0, 0.1)) for n in range(1, 7)]
    limits = {"max_tilt": np.deg2rad(40), "leg_radius": 0.036}
    wide = Hexapod(preset.base, preset.platform, axes=slides, home=preset.home, **limits)
    return [
        workspace(preset, z=0.26, cells=24),
        workspace(preset, y=0.01, rotation=tilted, cells=24),
        workspace(preset, cells=10),
        workspace(preset, rotation=tilted, cells=10),
        workspace(wide, rotation=Rotation.from_rotvec([0, 0, 0.1]), cells=10),
    ]


def cells_of(reach, chosen):
    """Low and high (N, 3) of chosen cells."""
    edges = [np.repeat(nodes, 2) if len(nodes) == 1 else nodes for nodes in reach.nodes]
    index = np.argwhere(chosen)
    return (np.stack([edges[k][index[:, k] + end] for k in range(3)], 1) for end in (0, 1))


# proofs


def test_every_point_of_a_proved_cell_is_inside(reaches):
    random = np.random.default_rng(1)
    for reach in reaches:
        assert reach.proved.sum() > 30
        low, high = cells_of(reach, reach.proved)
        for share in (
            random.uniform(size=(5_000 // len(low), len(low), 3)),
            random.integers(0, 2, (8, len(low), 3)),
        ):
            points = (low + share * (high - low)).reshape(-1, 3)
            assert uses(reach.machine, reach.rotation, points).max() <= 1 + 1e-9


def test_a_cell_is_proved_unless_a_limit_is_near(reaches):
    """Where all nodes are inside, hardly a cell is left unproved, and it is one that a limit
    grazes.
    """
    for reach in reaches:
        inside = reach.reachable
        for k in range(3):
            if inside.shape[k] > 1:
                lines = np.moveaxis(inside, k, 0)
                inside = np.moveaxis(lines[:-1] & lines[1:], 0, k)
        assert not (reach.proved & ~inside).any()
        left = inside & ~reach.proved
        assert left.sum() <= 0.1 * inside.sum()
        low, high = cells_of(reach, left)
        corners = np.array(list(product((0, 1), repeat=3)))
        for a, b in zip(low, high, strict=True):
            assert uses(reach.machine, reach.rotation, a + corners * (b - a)).max() > 0.9


def test_all_limits_count(reaches):
    """In the wide machine each of the three limits is the one that ends the reach somewhere."""
    broken = reaches[-1].uses > 1
    alone = [broken[..., k] & ~np.delete(broken, k, -1).any(-1) for k in range(3)]
    assert all(a.any() for a in alone)


def test_a_box_is_told_of_its_bad_corner():
    """In a ball of radius 1, a cube of half side 0.65: faces at 0.65, edges at 0.92, corners at
    1.126.
    """
    reach = workspace(tether(0, 1), cells=8)
    half = np.full(3, 0.65)
    for axis, sign in product(
        range(3), (-1, 1)
    ):  # the middles of its faces and, of these, of their edges
        face = np.zeros(3)
        face[axis] = sign * 0.65
        edge = face + 0.65 * np.roll(np.eye(3)[axis], 1)
        assert (uses(reach.machine, reach.rotation, np.array([face, edge])) <= 1).all()
    told = reach.contains(-half, half)
    assert not told
    assert np.abs(told.place) == pytest.approx(half)
    assert told.reason.startswith("corner")
    assert "line travel: 125.2% of its limit" in told.reason  # |1.1258 − 0.5| / 0.5
    fits = 0.999 / np.sqrt(3) * np.ones(3)
    assert reach.contains(-fits, fits)


def test_a_box_is_told_of_the_hole_in_it():
    """Corners, edges and faces inside; a ball of radius 0.05 about the origin is not."""
    reach = workspace(tether(0.05, 1), cells=6)
    told = reach.contains([-0.4, -0.37, -0.41], [0.43, 0.39, 0.38])
    assert not told
    assert np.linalg.norm(told.place) < 0.05
    assert told.reason.startswith("position")
    assert "line travel" in told.reason
    assert reach.contains([0.03, 0.03, 0.03], [0.5, 0.5, 0.5])  # (0.03, 0.03, 0.03) is 0.052 away


def test_a_limit_that_is_just_reached_is_kept():
    """The cube in the ball, corners on the surface; and one that is larger by a millionth."""
    reach = workspace(tether(0, 1), cells=4)
    touching = np.full(3, 1 / np.sqrt(3))
    assert reach.contains(-touching, touching)
    assert not reach.contains(-touching, touching * (1 + 1e-6))


def test_what_is_not_proved_is_not_called_so(preset):
    """Without halving, the enclosure of a large box is too wide; nothing outside is found, and that
    is what is told.
    """
    low, high = np.array([-0.03, -0.03, 0.25]), np.array([0.03, 0.03, 0.26])
    told = contains(preset, preset.home.rotation, low, high, depth=0)
    assert not told
    assert "not proved near (0, 0, 255) mm" in told.reason
    assert contains(preset, preset.home.rotation, low, high)


# what is largest


def measure_volume(reach):
    """Return the volume of the proved cells, m³."""
    return reach.proved.sum() * np.prod([nodes[1] - nodes[0] for nodes in reach.nodes])


def test_a_gantry_reaches_its_travel():
    reach = workspace(
        gantry(x=(-0.3, 0.5), y=(-0.2, 0.1), z=(0, 0.05)),
        x=(-0.3, 0.5),
        y=(-0.2, 0.1),
        z=(0, 0.05),
        cells=8,
    )
    assert reach.proved.all()
    box, sphere = reach.largest_box(), reach.largest_sphere(around=[0, 0, 0.02])
    assert box.low == pytest.approx([-0.3, -0.2, 0])
    assert box.high == pytest.approx([0.5, 0.1, 0.05])
    assert measure_volume(reach) == pytest.approx(0.8 * 0.3 * 0.05)
    assert sphere.radius == pytest.approx(0.02)  # to the floor
    assert reach.largest_sphere().radius == pytest.approx(
        0.025, rel=1 / 8
    )  # no cell's centre lies in the middle


def test_the_largest_in_a_ball():
    """Radius 1: the cube with corners on the surface, and the ball itself; a grid of 24 loses a
    cell at every side.
    """
    reach = workspace(tether(0, 1), x=(-1.1, 1.1), y=(-1.1, 1.1), z=(-1.1, 1.1), cells=24)
    side, cell = 2 / np.sqrt(3), 2.2 / 24
    box = reach.largest_box()
    assert (side - 2 * cell) ** 3 < box.size.prod() < side**3
    assert np.abs([box.low, box.high]).max() < 1
    assert reach.contains(box.low, box.high)
    sphere = reach.largest_sphere()
    assert (
        1 - np.sqrt(3) * cell <= sphere.radius < 1
    )  # a cell's diagonal, about a node in the middle
    assert np.linalg.norm(sphere.centre) + sphere.radius <= 1
    ball = 4 / 3 * np.pi
    assert ball - 4 * np.pi * 2 * cell < measure_volume(reach) < ball


def test_the_largest_around_a_place():
    reach = workspace(tether(0, 1), x=(-1.1, 1.1), y=(-1.1, 1.1), z=(-1.1, 1.1), cells=20)
    place = np.array([0.05, 0.75, 0.02])
    box, sphere = reach.largest_box(around=place), reach.largest_sphere(around=place)
    assert (box.low <= place).all()
    assert (place <= box.high).all()
    assert box.size.prod() < reach.largest_box().size.prod()
    assert np.array_equal(sphere.centre, place)
    assert 0.02 < sphere.radius < 1 - np.linalg.norm(place)


def test_a_plane_is_a_plane(reaches):
    for reach in reaches[:2]:
        held = next(k for k in range(3) if len(reach.nodes[k]) == 1)
        box, sphere = reach.largest_box(), reach.largest_sphere()
        value = reach.nodes[held][0]
        assert box.low[held] == box.high[held] == sphere.centre[held] == value
        assert reach.contains(box.low, box.high)
        turn = np.linspace(0, 2 * np.pi, 400)
        rim = np.tile(sphere.centre, (400, 1))
        rim[:, [k for k in range(3) if k != held]] += sphere.radius * np.stack(
            [np.cos(turn), np.sin(turn)], 1
        )
        assert uses(reach.machine, reach.rotation, rim).max() <= 1 + 1e-9


def test_spheres_stay_clear_of_all_that_is_not_proved(reaches):
    """And none about another cell's centre is larger: by the distances to all other cells."""
    for reach in reaches[2:]:
        low, high = cells_of(reach, ~reach.proved)
        ends = np.array([[nodes[0], nodes[-1]] for nodes in reach.nodes]).T

        def radius(centre, low=low, high=high, ends=ends):
            gaps = np.maximum(0, np.maximum(low - centre, centre - high))
            return min(np.linalg.norm(gaps, axis=1).min(), np.abs(ends - centre).min())

        sphere = reach.largest_sphere()
        assert sphere.radius == pytest.approx(radius(sphere.centre), rel=1e-12)
        low, high = cells_of(reach, reach.proved)
        candidates = (
            low[:, None] + np.array(list(product((0, 0.5, 1), repeat=3))) * (high - low)[:, None]
        ).reshape(-1, 3)
        assert sphere.radius == pytest.approx(
            max(map(radius, np.unique(candidates, axis=0))), rel=1e-12
        )


def volume(solid, first, end, sides):
    block = solid[tuple(slice(a, b) for a, b in zip(first, end, strict=True))]
    return block.size * np.prod(sides) if block.all() else 0


@settings(max_examples=60, deadline=None)
@given(
    arrays(
        bool,
        st.tuples(*[st.integers(1, 4)] * 3),
        elements=st.sampled_from([True, True, True, False]),
    ),
    st.booleans(),
    st.randoms(use_true_random=False),
)
def test_no_block_is_larger(solid, around, random):
    """Against every block there is."""
    sides = [0.5, 2.0, 3.0]
    holding = tuple(random.randrange(n) for n in solid.shape) if around else None
    best = 0
    for first in np.ndindex(*solid.shape):
        for end in product(*(range(f + 1, n + 1) for f, n in zip(first, solid.shape, strict=True))):
            held = holding is None or all(
                f <= h < e for f, h, e in zip(first, holding, end, strict=True)
            )
            best = max(best, held * volume(solid, first, end, sides))
    found = largest_block(solid, sides, holding)
    if found is None:
        assert best == 0
    else:
        assert volume(solid, *found, sides) == pytest.approx(best)
        assert holding is None or all(
            f <= h < e for f, h, e in zip(found[0], holding, found[1], strict=True)
        )


# its extent, its figure, and what it refuses


def test_the_grid_holds_all_that_is_reached(preset, reaches):
    """No pose of the level platform inside all limits lies off the grid; nor of the ball."""
    reach = reaches[2]
    random = np.random.default_rng(4)
    points = preset.home.translation + random.uniform(-0.3, 0.3, (40_000, 3))
    inside = points[uses(preset, reach.rotation, points).max(1) <= 1]
    assert len(inside) > 100
    for k, nodes in enumerate(reach.nodes):
        assert nodes[0] <= inside[:, k].min()
        assert inside[:, k].max() <= nodes[-1]
    ball = workspace(tether(0, 3), cells=4)
    assert all(nodes[0] <= -3 and nodes[-1] >= 3 for nodes in ball.nodes)


def test_figures_show_the_largest(reaches):
    flat = reaches[0]
    ax = flat.plot()
    box, (outline, circle) = flat.largest_box(), ax.patches
    assert outline.get_xy() == pytest.approx(1e3 * box.low[:2])
    assert (outline.get_width(), outline.get_height()) == pytest.approx(tuple(1e3 * box.size[:2]))
    assert circle.get_radius() == pytest.approx(1e3 * flat.largest_sphere().radius)
    assert ax.get_xlabel() == "x (mm)"
    assert flat.plot(ax) is ax
    body = reaches[2].plot()
    assert body.name == "3d"
    with pytest.raises(MotionError, match="plane or a volume"):
        workspace(tether(0, 1), y=0.0, z=0.0, cells=2).plot()


def test_refusals(preset, reaches):
    class Table(Gantry):
        freedom: ClassVar = ("x", "y")

        def expression(self, position, rotation, near):
            return position[:2]

    table = Table("table", [Axis(n, travel=(-1, 1)) for n in "xy"], RigidTransform.identity())
    assert workspace(table, cells=4).nodes[2].tolist() == [0.0]  # held at home
    with pytest.raises(OutOfReach, match="holds z"):
        workspace(table, x=(-1, 1), y=(-1, 1), z=0.1)
    with pytest.raises(OutOfReach, match="holds rz"):
        workspace(table, x=(-1, 1), y=(-1, 1), rotation=Rotation.from_rotvec([0, 0, 0.1]))
    with pytest.raises(MotionError, match="give its axes a travel"):
        workspace(Gantry("gantry", [Axis(n) for n in "xyz"], RigidTransform.identity()))
    with pytest.raises(MotionError, match=r"z from 1\.0 to 0\.0 m"):
        workspace(preset, z=(1, 0))
    with pytest.raises(MotionError, match=r"x, held or .* must be finite numbers .*nan"):
        workspace(preset, x=(np.nan, 0))
    with pytest.raises(MotionError, match="cells must be a whole number from 1 to 1000, not 0"):
        workspace(preset, cells=0)
    with pytest.raises(
        MotionError, match=r"nothing inside all limits .* at \(0, 0, 233\.636\) mm: leg\d"
    ):
        workspace(preset, rotation=Rotation.from_rotvec([2, 0, 0]))
    with pytest.raises(MotionError, match="y = 5000 mm lies outside the grid"):
        reaches[2].largest_box(around=[0, 5, 0.26])
    with pytest.raises(MotionError, match="around must be finite numbers"):
        reaches[2].largest_sphere(around=[0, 5])
    with pytest.raises(MotionError, match="no box around"):
        reaches[2].largest_box(around=[nodes[0] for nodes in reaches[2].nodes])
    with pytest.raises(MotionError, match=r"no coordinate of low .* may be above"):
        reaches[2].contains([0, 0, 0.3], [0, 0, 0.2])
    with pytest.raises(MotionError, match=r"low must be finite numbers .*nan"):
        reaches[2].contains([0, 0, np.nan], [0, 0, 0.2])
    with pytest.raises(OutOfReach, match="holds z: high"):
        workspace(table, cells=4).contains([0, 0, 0], [0, 0, 0.1])


class Swing(Gantry):
    """A slide along z behind a rod of 1 m, and two slides: it ends where the rod lies flat."""

    def expression(self, position, rotation, near):
        return ca.vertcat(position[:2], position[2] + ca.sqrt(1 - ca.sumsqr(position[:2])))


def test_a_figure_shows_the_limits_that_there_are_and_where_reach_ends():
    axes = [Axis("x", travel=(-9, 9)), Axis("y", travel=(-9, 9)), Axis("rod", travel=(-0.5, 9))]
    swing = Swing("swing", axes, RigidTransform.identity())
    ax = workspace(swing, x=(-1.5, 1.5), y=(-1.5, 1.5), z=0.0, cells=60).plot()
    told = ax.get_legend_handles_labels()[1]
    assert [text for text in told if "largest" not in text] == [
        "travel limit",
        "end of reach",
    ]  # no tilt, no bodies
    borders = [drawn for drawn in ax.collections if isinstance(drawn, ContourSet)]
    travel, end = (
        np.concatenate([path.vertices for path in border.get_paths()]) for border in borders
    )
    # where the rod stands half a metre up, drawn between nodes; and to a cell, whose side is 50 mm
    assert np.linalg.norm(travel, axis=1) == pytest.approx(1e3 * np.sqrt(0.75), abs=25)
    assert np.linalg.norm(end, axis=1) == pytest.approx(1e3, abs=50)
