"""Paths in the actuators: derivatives against independent evaluation, guaranteed enclosures, and
where to stop.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.polynomial import chebyshev
from scipy.interpolate import PPoly
from scipy.spatial.transform import RigidTransform, Rotation

from kinematics import load_machine
from kinematics.foundation.errors import NotFree
from planner import Arc, Line, Program, Trajectory, Turn, load_program, plan
from planner.certificate import Cells, bound_series, enclose
from planner.path.actuation import actuate
from planner.path.polynomial import PolynomialPath

HOME = np.array([0, 0, 0.2336362])


@dataclass
class Move:
    """A segment, and the same in the base frame by the textbook: position(s) (N, 3) and rotation(s)
    (N, 3, 3).
    """

    segment: object
    length: float
    position: object
    rotation: object


def moves(rodrigues):
    """One of each shape, all of them turning, from (15, 0, 25) mm."""
    start, vector = np.array([0.015, 0, 0.025]), np.array([0.1, -0.15, 0.05])
    angle = np.linalg.norm(vector)
    to = Rotation.from_rotvec(vector)

    def turning(length):
        return lambda s: rodrigues(vector, angle * s / length)

    end = np.array([-0.01, 0.012, 0.02])
    way = np.linalg.norm(end - start)
    line = Move(
        Line(end, to),
        way,
        lambda s: HOME + start + (end - start) * (s / way)[:, None],
        turning(way),
    )

    normal = np.array([0, -np.sin(0.35), np.cos(0.35)])
    bow = 0.015 * 7.0

    def round_about(s):
        return HOME + [0, 0, 0.025] + rodrigues(normal, -s / 0.015) @ [0.015, 0, 0]

    arc = Move(Arc([0, 0, 0.025], normal, -7.0, to), bow, round_about, turning(bow))
    spin = angle * np.hypot(0.1, 0.011)
    turn = Move(Turn(to), spin, lambda s: np.repeat((HOME + start)[None], len(s), 0), turning(spin))
    return {"line": line, "arc": arc, "turn": turn}


def path_of(machine, *segments):
    start = RigidTransform.from_components([0.015, 0, 0.025], Rotation.identity())
    return actuate(Program(segments, start=start), machine)


@pytest.mark.parametrize("shape", ["line", "arc", "turn"])
def test_derivatives_of_leg_lengths(hexapod, own_lengths, rodrigues, shape):
    """Against the derivatives of the Chebyshev interpolant of lengths computed without the package.

    Lengths are analytic well beyond ±8 mm about any place, so 25 nodes leave rounding only; the
    k-th derivative makes of it about (2.2e-16 · 0.25 m) · 25ᵏ/(8 mm)ᵏ. Tolerances are ten times
    that, or less.
    """
    move = moves(rodrigues)[shape]
    path = path_of(hexapod, move.segment)
    assert path.breaks[-1] == pytest.approx(move.length, rel=1e-13)
    half, nodes = 8e-3, chebyshev.chebpts1(25)
    for centre in np.linspace(0, move.length, 7):
        s = centre + half * nodes
        interpolant = chebyshev.chebfit(nodes, own_lengths(move.position(s), move.rotation(s)), 24)
        ours = path.derivatives(np.array([centre]), np.zeros(1, int))
        for k, tolerance in enumerate((1e-15, 2e-12, 5e-9, 2e-5)):
            theirs = chebyshev.chebval(0.0, chebyshev.chebder(interpolant, k)) / half**k
            assert np.abs(ours[k][0] - theirs).max() < tolerance, (k, centre)


def test_pieces_of_one_path_keep_their_own_parameters(hexapod, own_lengths):
    """Shapes are evaluated in batches: every instant must get its own piece's numbers, in its own
    place.
    """
    path = path_of(
        hexapod, Line([0.0, 0, 0.03]), Arc([0, 0.01, 0.03], [0, 0, 1], 2.0), Line([0, 0, 0.02])
    )
    rng = np.random.default_rng(4)
    piece = rng.integers(0, 3, 60)
    s = path.breaks[piece] + rng.random(60) * np.diff(path.breaks)[piece]
    together = path.derivatives(s, piece)
    for n in range(60):
        for k, alone in enumerate(path.derivatives(s[n : n + 1], piece[n : n + 1])):
            assert (together[k][n] == alone[0]).all()
    numbers = path.pose_numbers(s, piece)
    lengths = own_lengths(numbers[:, :3], numbers[:, 3:].reshape(-1, 3, 3))
    assert np.abs(together[0] - lengths).max() < 1e-15


@settings(max_examples=60, deadline=None)
@given(data=st.data(), shape=st.tuples(st.integers(1, 8), st.integers(1, 4), st.integers(1, 3)))
def test_polynomial_path_has_scipy_s_derivatives(data, shape):
    degree, pieces, axes = shape[0] - 1, *shape[1:]
    values = data.draw(arrays(float, shape, elements=st.floats(-10, 10)))
    lengths = data.draw(st.lists(st.floats(0.01, 3), min_size=pieces, max_size=pieces))
    breaks = np.cumsum([-1.0, *lengths])
    path = PolynomialPath(breaks, values, [f"axis{k}" for k in range(axes)])
    curve = PPoly(values, breaks)
    # inside, where no neighbour can be mistaken for the piece
    piece = np.repeat(np.arange(pieces), 5)
    s = breaks[piece] + np.tile([0.05, 0.3, 0.5, 0.8, 0.95], pieces) * np.diff(breaks)[piece]
    # both round at most a few times per coefficient; |x| ≤ 3
    largest = np.abs(values).max() * (degree + 1) * 3.0**degree
    for k, ours in enumerate(path.derivatives(s, piece)):
        assert np.abs(ours - curve(s, k)).max() <= 1e-15 * largest * max(degree, 1) ** k


@pytest.mark.parametrize("highest", [2, 3])
def test_one_axis_alone_is_as_among_all(hexapod, highest):
    """To rounding: the same operations, but perhaps in another order."""
    machine_path = actuate(load_program("circle"), hexapod)
    rng = np.random.default_rng(2)
    polynomials = PolynomialPath(np.array([0.0, 1, 3]), rng.normal(size=(5, 2, 3)), ("a", "b", "c"))
    for path in (machine_path, polynomials):
        piece = rng.integers(0, len(path.breaks) - 1, 100)
        s = path.breaks[piece] + np.diff(path.breaks)[piece] * rng.random(100)
        every = path.derivatives(s, piece, highest)
        for axis in range(len(path.names)):
            alone = path.axis_derivatives(axis, s, piece, highest)
            for one, all_ in zip(alone, every, strict=True):
                assert one.shape == (100, 1)
                assert np.allclose(
                    one[:, 0], all_[:, axis], rtol=1e-12, atol=1e-12 * abs(all_).max()
                )


def test_the_motion_of_one_axis_is_as_among_all(planned):
    trajectory = planned("bare-circle", 3).trajectory
    t = np.concatenate(
        ([-0.1, trajectory.duration, trajectory.duration + 1], trajectory.knots[1:-1:7])
    )
    every, axis = trajectory.at(t), 4
    alone = trajectory.axis_at(t, axis)
    for name in ("q", "qd", "qdd", "qddd"):
        values = getattr(every, name)
        scale = 1e-11 * abs(values).max()
        assert np.allclose(getattr(alone, name)[:, 0], values[:, axis], rtol=0, atol=scale)


def test_on_a_break_the_piece_tells_the_side():
    path = PolynomialPath(
        [0.0, 1.0, 2.0], np.array([[[1.0], [-2.0]], [[0.0], [3.0]], [[5.0], [6.0]]]), ["x"]
    )
    at = np.array([1.0, 1.0])
    q, q1, q2, _ = path.derivatives(at, np.array([0, 1]))
    assert q.ravel().tolist() == [6, 6]
    assert q1.ravel().tolist() == [2, 3]
    assert q2.ravel().tolist() == [2, -4]


def loose_motion(path, rng, count):
    """Time pieces that need not fit together, each crossing about an eighth of a path piece."""
    piece = np.sort(rng.integers(0, len(path.breaks) - 1, count))
    length = np.diff(path.breaks)[piece]
    h = rng.uniform(0.5, 1.5, count)
    return Trajectory(
        path,
        np.concatenate([[0.0], np.cumsum(h)]),
        path.breaks[piece] + length * rng.uniform(0.2, 0.8, count),
        length * rng.uniform(-0.1, 0.1, count),
        length * rng.uniform(-0.1, 0.1, count),
        length * rng.uniform(-0.3, 0.3, count),
        piece,
    )


def looked_at(trajectory, points=33):
    """Every time piece at `points` places: state, and its values as (points, pieces, m)."""
    k = np.tile(np.arange(len(trajectory.s)), points)
    share = np.repeat(np.linspace(0, 1, points), len(trajectory.s))
    return trajectory.within(k, np.diff(trajectory.knots)[k] * share), (
        points,
        len(trajectory.s),
        -1,
    )


def whole(trajectory):
    lengths = np.diff(trajectory.knots)
    return Cells(np.arange(len(lengths)), np.zeros(len(lengths)), lengths)


def own_polynomials():
    rng = np.random.default_rng(0)
    return PolynomialPath([0.0, 0.4, 1.0], rng.normal(size=(7, 2, 2)), ["x", "y"])


@pytest.mark.parametrize("kind", ["machine", "polynomials"])
@pytest.mark.parametrize("order", [4, 6, 9])
def test_enclosures_contain_the_motion(hexapod, rodrigues, kind, order):
    """Cells as wide as whole time pieces and short series: what the remainder must make up for is
    large.
    """
    if kind == "machine":
        path = path_of(
            hexapod,
            *(move.segment for move in list(moves(rodrigues).values())[1:2]),
            Line([0.0, 0, 0.02]),
        )
    else:
        path = own_polynomials()
    trajectory = loose_motion(path, np.random.default_rng(7), 40)
    state, shape = looked_at(trajectory)
    enclosure = enclose(trajectory, whole(trajectory), order)
    for name in ("q", "qd", "qdd", "qddd"):
        low, high = bound_series(getattr(enclosure, name), 40)
        sampled = getattr(state, name).reshape(shape)
        rounding = 1e-12 * np.abs(sampled).max()  # of the samples
        assert (low <= sampled + rounding).all(), name
        assert (high >= sampled - rounding).all(), name
    if kind == "machine":
        low, high = bound_series(enclosure.evaluate(hexapod.tilt_map, enclosure.pose_rate(0)), 40)
        cosines = state.evaluate(hexapod.tilt_map, state.pose_rate(0)).reshape(shape)
        assert (low <= cosines + 1e-14).all()
        assert (high >= cosines - 1e-14).all()
        low, high = bound_series(enclosure.pose_rate(1)[:, :3], 40)
        velocity = state.tool_velocity.reshape(shape)
        assert (low <= velocity + 1e-14).all()
        assert (high >= velocity - 1e-14).all()


def test_enclosures_shrink_with_their_cells(hexapod, rodrigues):
    """The remainder of a series to τ⁶ falls with the seventh power of a cell's width, for q⃛ with
    the fourth.
    """
    path = path_of(hexapod, moves(rodrigues)["arc"].segment)
    trajectory = loose_motion(path, np.random.default_rng(1), 10)
    overshoot = []
    for cells in (whole(trajectory), whole(trajectory).parts(4)):
        low, high = bound_series(enclose(trajectory, cells, 6).qddd, len(cells.k))
        share = np.linspace(0, 1, 101)[:, None]
        state = trajectory.within(
            np.tile(cells.k, 101), (cells.lo + share * (cells.hi - cells.lo)).ravel()
        )
        sampled = state.qddd.reshape(101, len(cells.k), -1)
        overshoot.append(max((high - sampled.max(0)).max(), (sampled.min(0) - low).max()))
    # a quarter of the width: 1/4 of the Bernstein part's parabola squared, far less of the
    # remainder
    assert overshoot[1] < overshoot[0] / 16


def test_a_machine_path_stops_at_every_join(hexapod):
    path = path_of(hexapod, Line([0.0, 0, 0.025]), Line([-0.01, 0, 0.025]))
    assert path.stops(2).all()


# q over three pieces of length 1: a corner after the first, or only a jump of curvature
@pytest.mark.parametrize(
    ("pieces", "order_2", "order_3"),
    [
        ([[0, 0, 1, 0], [0, 0, 2, 1], [0, 0, 2, 3]], True, True),  # q′ jumps
        ([[0, 0, 1, 0], [0, 0.5, 1, 1], [0, 0.5, 2, 2.5]], False, True),  # q″ jumps
        ([[0, 0, 1, 0], [1, 0, 1, 1], [1, 3, 4, 3]], False, False),  # only q‴ jumps
    ],
)
@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
@pytest.mark.parametrize("pace", [1.0, 1e-9, 1e9])
def test_stops_of_polynomials(pieces, order_2, order_3, unit, pace):
    """At corners, and under jerk limits at jumps of curvature, whatever the units of values and
    parameter.
    """
    powers = pace ** np.arange(-3.0, 1.0)
    values = (
        np.moveaxis(np.array([pieces, np.zeros((3, 4))]) * powers, 0, -1).transpose(1, 0, 2) * unit
    )
    path = PolynomialPath(pace * np.arange(4.0), values, ["x", "still"])
    assert path.stops(2).tolist() == [True, order_2, False, True]
    assert path.stops(3).tolist() == [True, order_3, False, True]


def test_a_refusal_of_a_pose_that_the_machine_holds_carries_its_segment():
    """By this number, a program that was made from a file is reported with the line of the file."""
    machine = load_machine("cartesian")
    there = Line(np.array([0.01, 0.0, 0.0]))
    turned = Line(np.array([0.02, 0.0, 0.0]), rotate=Rotation.from_euler("x", 1, degrees=True))
    with pytest.raises(NotFree, match="segment 2") as raised:
        actuate(Program((there, turned)), machine)
    assert raised.value.segment == 2


def test_a_changed_joint_of_one_machine_does_not_change_another():
    """Maps along paths are made of the geometry that was read, whoever is the first to need them."""
    before = plan("bare-circle", "hexapod", order=2).duration
    changed = load_machine("hexapod")
    changed._derived.clear()  # as in a new process
    changed.base = 1.05 * np.array(changed.base)
    plan("bare-circle", changed, order=2)
    assert plan("bare-circle", "hexapod", order=2).duration == before
