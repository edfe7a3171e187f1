"""time_optimal: any SciPy piecewise polynomial, and what it refuses."""

import numpy as np
import pytest
from scipy.interpolate import (
    Akima1DInterpolator,
    BPoly,
    BSpline,
    CubicSpline,
    PPoly,
    make_interp_spline,
)

from kinematics import MotionError
from planner import time_optimal
from planner.time_optimal import polynomials

KNOTS = np.array([0.0, 0.5, 1.0, 1.4, 2.0])
POINTS = np.array([[0.0, 0.0], [0.3, -0.2], [0.1, 0.4], [0.2, 0.5], [0.0, 0.1]])


def checked(path, start, end, **limits):
    """The solution, after the promises that every solution makes: continuous, from rest to rest,
    within limits.
    """
    found = time_optimal(path, **limits)
    trajectory = found.trajectory
    assert found.certificate.holds
    assert set(found.certificate.worst) == {name.removeprefix("max_") for name in limits}
    t = np.linspace(0, trajectory.duration, 4001)
    state = trajectory.at(t)
    assert state.pose is None
    size = np.ptp(state.q, axis=0).max()
    assert np.abs(state.q[0] - start).max() < 1e-9 * size
    assert np.abs(state.q[-1] - end).max() < 1e-9 * size
    for name, values in (
        ("max_speed", state.qd),
        ("max_acceleration", state.qdd),
        ("max_jerk", state.qddd),
    ):
        if name in limits:
            assert (np.abs(values).max(0) <= np.asarray(limits[name]) * (1 + 1e-6)).all()
    # q̇ is the derivative of q: its integral by Simpson's rule comes back to q, within a step of
    # changing acceleration
    dt = t[1] - t[0]
    middle = trajectory.at(t[:-1] + dt / 2)
    travelled = np.cumsum((state.qd[:-1] + 4 * middle.qd + state.qd[1:]) * dt / 6, axis=0)
    assert (
        np.abs(state.q[1:] - state.q[0] - travelled).max()
        < np.abs(state.qdd).max() * dt**2 + 1e-9 * size
    )
    return found


def bernstein():
    """Cubics with control points, joined so that they bend smoothly."""
    return BPoly(np.array([[[0.0, 0]], [[0.1, 0.0]], [[0.4, -0.2]], [[0.5, 0.3]]]), [0.0, 1.0])


PATHS = {
    "CubicSpline": (CubicSpline(KNOTS, POINTS), POINTS[0], POINTS[-1]),
    "clamped": (CubicSpline(KNOTS, POINTS, bc_type="clamped"), POINTS[0], POINTS[-1]),
    "BSpline": (make_interp_spline(KNOTS, POINTS, k=3), POINTS[0], POINTS[-1]),
    "quintic BSpline": (
        make_interp_spline(np.arange(7.0), np.tile(POINTS, (2, 1))[:7], k=5),
        POINTS[0],
        POINTS[1],
    ),
    "BSpline of one axis": (make_interp_spline(KNOTS, POINTS[:, 1], k=3), [0.0], [0.1]),
    "BSpline with knots outside": (
        BSpline(np.arange(10) - 3.0, [9.0, 0, 1, 3, 2, 9], 3),
        [5 / 3],
        [10 / 3],
    ),
    "Akima": (Akima1DInterpolator(KNOTS, POINTS), POINTS[0], POINTS[-1]),
    "BPoly": (bernstein(), [0.0, 0.0], [0.5, 0.3]),
    "PPoly": (
        PPoly(np.array([[[1.0, 0.5]], [[0.0, 1.0]], [[3.0, 4.0]]]), [0.0, 1.0]),
        [3.0, 4.0],
        [4.0, 5.5],
    ),
}


@pytest.mark.parametrize("kind", PATHS)
def test_every_kind_of_piecewise_polynomial(kind):
    path, start, end = PATHS[kind]
    checked(path, start, end, max_speed=1.0, max_acceleration=np.array([5.0, 4.0])[: len(start)])


@pytest.mark.parametrize("kind", ["CubicSpline", "clamped", "BPoly", "PPoly"])
def test_every_kind_with_jerk(kind):
    """Of splines whose curvature is continuous; Akima's jumps at every knot, where the motion then
    stops.
    """
    path, start, end = PATHS[kind]
    found = checked(path, start, end, max_speed=1.0, max_acceleration=[5.0, 4.0], max_jerk=50.0)
    free = time_optimal(path, max_speed=1.0, max_acceleration=[5.0, 4.0])
    assert found.trajectory.duration > free.trajectory.duration
    ends = found.trajectory.at(np.array([0.0, found.trajectory.duration]))
    assert np.abs(ends.qdd).max() < 1e-7


def test_kinds_of_the_same_curve_take_the_same_time():
    """One cubic, as PPoly, BPoly, BSpline and CubicSpline."""
    cubic = PPoly(np.array([[[1.0, -2.0]], [[0.5, 1.0]], [[1.0, 0.3]], [[0.0, 0.0]]]), [0.0, 1.0])
    knots = np.linspace(0, 1, 5)
    same = [
        cubic,
        BPoly.from_power_basis(cubic),
        CubicSpline(knots, cubic(knots)),
        make_interp_spline(knots, cubic(knots)),
    ]
    times = [
        time_optimal(path, max_speed=2.0, max_acceleration=3.0).trajectory.duration for path in same
    ]
    assert times == pytest.approx(
        [times[0]] * 4, rel=2e-4
    )  # the grids differ: their breaks are theirs


def test_scalar_and_single_and_per_axis_limits_are_the_same():
    path = CubicSpline(KNOTS, POINTS)
    times = [
        time_optimal(path, max_speed=v, max_acceleration=a).trajectory.duration
        for v, a in ((1.0, 4.0), ([1.0], np.array([4.0])), ([1.0, 1.0], [4.0, 4.0]), (1, 4))
    ]
    assert len(set(times)) == 1


def test_scalar_values_are_one_axis():
    """A path of shape () has one axis: T = L/V + V/A."""
    found = checked(
        PPoly([[2.0], [0.0]], [0.0, 1.0]), [0.0], [2.0], max_speed=0.5, max_acceleration=1.0
    )
    assert found.trajectory.duration == pytest.approx(2 / 0.5 + 0.5 / 1.0, rel=1e-5)


@pytest.mark.parametrize("jerk", [None, 60.0])
def test_the_motion_stops_at_a_corner(jerk):
    """Two lines at right angles: each is a motion of its own, and the corner is a rest."""
    corner = PPoly(np.array([[[1.0, 0], [0, 1.0]], [[0.0, 0], [1.0, 0]]]), [0.0, 1.0, 2.0])
    limits = {"max_speed": 1.0, "max_acceleration": 2.0} | (
        {} if jerk is None else {"max_jerk": jerk}
    )
    found = checked(corner, [0, 0], [1, 1], **limits)
    each = 1 / 1.0 + 1.0 / 2.0 + (0 if jerk is None else 2.0 / jerk)
    assert found.trajectory.duration == pytest.approx(2 * each, rel=1e-3)
    k = int(np.searchsorted(found.trajectory.piece, 1))
    at = found.trajectory.within(
        np.array([k - 1, k]), np.array([np.diff(found.trajectory.knots)[k - 1], 0.0])
    )
    assert at.q == pytest.approx(np.array([[1.0, 0], [1.0, 0]]), abs=1e-9)
    assert np.abs(at.qd).max() < 1e-9
    assert len(found.methods) == 2


def test_a_jump_of_curvature_is_a_stop_only_under_jerk_limits():
    bend = PPoly(
        np.array([[[0.0, 0.0], [0.0, 0.5]], [[1.0, 0], [1.0, 0]], [[0.0, 0], [1.0, 0]]]),
        [0.0, 1.0, 2.0],
    )
    limits = {"max_speed": 1.0, "max_acceleration": 2.0}
    assert len(checked(bend, [0, 0], [2.0, 0.5], **limits).methods) == 1
    found = checked(bend, [0, 0], [2.0, 0.5], **limits, max_jerk=40.0)
    assert len(found.methods) == 2
    assert (
        np.abs(
            found.trajectory.at(
                found.trajectory.knots[np.searchsorted(found.trajectory.piece, 1)]
            ).qd
        ).max()
        < 1e-9
    )


def test_the_contract_s_case():
    path = CubicSpline([0, 0.5, 1], [[0, 0], [0.3, -0.2], [0.1, 0.4]])
    for jerk in ({}, {"max_jerk": 50.0}):
        checked(path, [0, 0], [0.1, 0.4], max_speed=1.0, max_acceleration=[5.0, 4.0], **jerk)


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": 50.0}])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_path_that_sets_out_without_slope(jerk, reverse):
    """q = s² over [0, 1] has q′ = 0 at its start: the same motion as along q = s, in another
    parameter.
    """
    c = [[1.0], [-2.0], [1.0]] if reverse else [[1.0], [0.0], [0.0]]
    ends = ([1.0], [0.0]) if reverse else ([0.0], [1.0])
    found = checked(PPoly(c, [0.0, 1.0]), *ends, max_speed=1.0, max_acceleration=2.0, **jerk)
    time = 1.0 + 0.5 + (2.0 / 50 if jerk else 0.0)
    assert found.trajectory.duration == pytest.approx(time, rel=1e-9)


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": [50.0, 1e-12]}])
def test_an_axis_that_never_moves_binds_nothing(jerk):
    path = PPoly(np.array([[[1.0, 0.0]], [[0.0, 7.0]]]), [0.0, 1.0])
    found = checked(
        path, [0, 7], [1, 7], max_speed=[1.0, 1e-12], max_acceleration=[2.0, 1e-12], **jerk
    )
    assert found.trajectory.duration == pytest.approx(1.5 + (2 / 50 if jerk else 0), rel=1e-3)


@pytest.mark.parametrize("jerk", [{}, {"max_jerk": 50.0}])
@pytest.mark.parametrize("pace", [1e-9, 1e9])
def test_tiny_and_huge_parameters(pace, jerk):
    limits = {"max_speed": 1.0, "max_acceleration": [5.0, 4.0], **jerk}
    plain = time_optimal(CubicSpline(KNOTS, POINTS), **limits)
    found = checked(CubicSpline(KNOTS * pace, POINTS), POINTS[0], POINTS[-1], **limits)
    assert found.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-4)


def test_a_parameter_that_starts_far_from_zero():
    limits = {"max_speed": 1.0, "max_acceleration": 4.0}
    plain = time_optimal(CubicSpline(KNOTS, POINTS), **limits)
    found = checked(CubicSpline(KNOTS + 1e4, POINTS), POINTS[0], POINTS[-1], **limits)
    assert found.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-4)


@pytest.mark.parametrize(("count", "jerk"), [(301, {}), (61, {"max_jerk": 500.0})])
def test_hundreds_of_pieces(count, jerk):
    """A spline through so many points of an ellipse is one run, as fast as a spline through 41 of
    them.
    """

    def ellipse(count):
        phi = np.linspace(0, 2 * np.pi, count)
        return CubicSpline(
            phi, np.stack([0.2 * np.cos(phi), 0.1 * np.sin(phi)], 1), bc_type="periodic"
        )

    limits = {"max_speed": 1.0, "max_acceleration": 20.0, **jerk}
    fine = checked(ellipse(count), [0.2, 0], [0.2, 0], **limits)
    coarse = time_optimal(ellipse(41), **limits)
    assert len(fine.methods) == 1
    # the third derivative of a spline is a staircase: 1e-3 is what its coarser one costs under the
    # jerk limit
    assert fine.trajectory.duration == pytest.approx(coarse.trajectory.duration, rel=1e-3)


def test_pieces_of_no_length_are_left_out():
    doubled = PPoly(np.array([[[1.0], [5.0], [1.0]], [[0.0], [3.0], [0.5]]]), [0.0, 0.5, 0.5, 1.0])
    assert time_optimal(
        doubled, max_speed=1.0, max_acceleration=2.0
    ).trajectory.duration == pytest.approx(1.5, rel=1e-5)


def ppoly(*pieces, breaks=(0.0, 1.0, 2.0), dtype=float):
    """One axis: coefficients of each piece, highest power first."""
    return PPoly(np.array(pieces, dtype).T[:, :, None], list(breaks)[: len(pieces) + 1])


@pytest.mark.parametrize(
    ("path", "phrases"),
    [
        pytest.param(ppoly([1, 0], [1, 1.5]), ["jumps by 0.5 in axis1", "s = 1"], id="jump"),
        pytest.param(ppoly([np.nan, 0]), ["not finite"], id="nan"),
        pytest.param(ppoly([np.inf, 0]), ["not finite"], id="infinite"),
        pytest.param(ppoly([0, 4.0], [0, 4.0]), ["nothing moves"], id="constant"),
        pytest.param(ppoly([4.0]), ["nothing moves"], id="degree 0"),
        pytest.param(ppoly([1j, 0], dtype=complex), ["real"], id="complex"),
        pytest.param(
            ppoly([1, 0], [1, -1], breaks=(2.0, 1.0, 0.0)),
            ["breaks decrease", "reverse it"],
            id="falling",
        ),
        pytest.param(PPoly(np.ones((2, 1, 2, 2)), [0, 1]), ["shape (2, 2)"], id="matrix"),
        pytest.param(lambda s: s, ["piecewise polynomial", "function"], id="function"),
        pytest.param([[0, 0], [1, 1]], ["piecewise polynomial", "list"], id="list"),
    ],
)
def test_what_is_no_path_is_refused(path, phrases):
    with pytest.raises(MotionError) as refusal:
        time_optimal(path, max_speed=1.0, max_acceleration=1.0)
    for phrase in phrases:
        assert phrase in str(refusal.value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("max_speed", [1.0, 1.0, 1.0]),
        ("max_speed", [[1.0, 1.0]]),
        ("max_speed", 0.0),
        ("max_acceleration", -1.0),
        ("max_acceleration", [1.0, 0.0]),
        ("max_jerk", np.nan),
        ("max_jerk", np.inf),
        ("max_jerk", []),
        ("max_speed", "fast"),
        ("max_speed", [1.0, None]),
        ("max_speed", 1j),
    ],
)
def test_what_is_no_limit_is_refused(name, value):
    limits = {"max_speed": 1.0, "max_acceleration": 1.0} | {name: value}
    with pytest.raises(MotionError, match=name):
        time_optimal(CubicSpline(KNOTS, POINTS), **limits)


def test_the_path_given_stays_as_it_was():
    path = CubicSpline(KNOTS, POINTS)
    before = path.c.copy()
    time_optimal(path, max_speed=1.0, max_acceleration=1.0)
    assert (path.c == before).all()
    assert path.c.flags.writeable


@pytest.mark.parametrize("degree", [1, 3, 5, 6, 9])
def test_a_b_spline_of_any_degree_is_its_polynomials(degree):
    """SciPy's conversion of degree 6 and more gives rubbish, or ends the process."""
    rng = np.random.default_rng(degree)
    knots = np.concatenate([np.zeros(degree), np.arange(4.0), np.full(degree, 3.0)])
    spline = BSpline(knots, rng.normal(size=(3 + degree, 2)), degree)
    s = np.linspace(0.0, 2.999, 50)
    np.testing.assert_allclose(polynomials(spline)(s), spline(s), rtol=0, atol=1e-11)
    assert time_optimal(spline, max_speed=1.0, max_acceleration=1.0).certificate.holds
