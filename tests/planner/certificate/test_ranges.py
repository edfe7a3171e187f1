"""Ranges of a motion over cells of time, held against exact arithmetic and against the motion
itself.
"""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.foundation import kernels
from planner import Arc, Line, Program, Trajectory
from planner.certificate import Cells, bound_motion, enclose_along_path
from planner.certificate.ranges import ROUNDINGS
from planner.path.actuation import actuate
from planner.path.polynomial import PolynomialPath
from tests.pace import LONG


def exact(values):
    return [Fraction(float(value)) for value in values]


def differentiate(powers, times):
    """Coefficients of the lowest power first."""
    for _ in range(times):
        powers = [k * power for k, power in enumerate(powers)][1:] or [Fraction(0)]
    return powers


def evaluate(powers, at):
    return sum((power * at**k for k, power in enumerate(powers)), Fraction(0))


def compose(outer, inner):
    found = [Fraction(0)]
    for power in reversed(outer):
        product = [Fraction(0)] * (len(found) + len(inner) - 1)
        for i, a in enumerate(found):
            for j, b in enumerate(inner):
                product[i + j] += a * b
        product[0] += power
        found = product
    return found


@settings(max_examples=25 if LONG else 8, deadline=None)
@given(st.integers(0, 2**31), st.floats(-6, 0), st.floats(0, 3))
def test_what_is_exact_lies_in_the_range(seed, small, far):
    """Polynomials of a path, in exact fractions: every instant's q … q⃛, with all that rounding did
    to the bounds.
    """
    random = np.random.default_rng(seed)
    start = 10**far
    path = PolynomialPath([start, start + 1.0], random.normal(size=(6, 1, 2)), ["a", "b"])
    h = 10**small
    s = start + random.uniform(0, 0.5, 3)
    v, a, j = (
        random.uniform(0.1, 0.4, 3) / h,
        random.normal(0, 0.1, 3) / h**2,
        random.normal(0, 0.1, 3) / h**3,
    )
    walk = Trajectory(path, np.arange(4.0) * h, s, v, a, j, np.zeros(3, int))
    cells = Cells(np.arange(3), random.uniform(0, 0.4, 3) * h, random.uniform(0.5, 1, 3) * h)
    enclosed = enclose_along_path(walk, cells, 3)
    for n, values in enumerate((enclosed.q, enclosed.qd, enclosed.qdd, enclosed.qddd)):
        low, high = enclosed.bound(values)
        assert np.isfinite([low, high]).all()
        for k in range(3):
            x, speed, push, pull = exact([each[k] for each in (walk.s, walk.v, walk.a, walk.j)])
            for axis in range(2):
                q = exact(path.coefficients[::-1, 0, axis])
                motion = differentiate(
                    compose(q, [x - Fraction(start), speed, push / 2, pull / 6]), n
                )
                for part in range(9):
                    lo, hi = Fraction(float(cells.lo[k])), Fraction(float(cells.hi[k]))
                    value = evaluate(motion, lo + (hi - lo) * part / 8)
                    assert Fraction(low[k, axis]) <= value <= Fraction(high[k, axis])


@pytest.fixture(scope="module")
def walk(hexapod):
    """Through a line and an arc, in pieces of all lengths."""
    path = actuate(Program([Line([0.01, 0, 0.03]), Arc([0, 0, 0.03], [0, 0.2, 1], 2.0)]), hexapod)
    random = np.random.default_rng(4)
    piece = np.sort(random.integers(0, 2, 60))
    length = np.diff(path.breaks)[piece]
    h = length * 10 ** random.uniform(-5, -0.5, 60) / 0.1
    s = path.breaks[piece] + length * random.uniform(0, 0.6, 60)
    v, a = 0.1 * random.uniform(0, 1, 60), 0.1 / h * random.uniform(-0.5, 0.5, 60)
    return Trajectory(
        path, np.append(0.0, np.cumsum(h)), s, v, a, 0.1 / h**2 * random.normal(0, 0.2, 60), piece
    )


def whole(walk):
    return Cells(np.arange(len(walk.s)), np.zeros(len(walk.s)), np.diff(walk.knots))


def test_every_sample_lies_in_the_range_of_axes_and_pose(walk):
    cells = whole(walk)
    enclosed = enclose_along_path(walk, cells, 3)
    for share in np.linspace(0, 1, 33):
        state = walk.within(cells.k, share * cells.hi, jerk=True)
        met = [state.q, state.qd, state.qdd, state.qddd, *(state.pose_rate(n) for n in range(3))]
        found = [
            enclosed.q,
            enclosed.qd,
            enclosed.qdd,
            enclosed.qddd,
            *(enclosed.pose_rate(n) for n in range(3)),
        ]
        for value, ball in zip(met, found, strict=True):
            low, high = enclosed.bound(ball)
            off = 1e-12 * np.abs(value).max(0)  # what the sample itself rounds
            assert (value >= low - off).all()
            assert (value <= high + off).all()


def test_what_is_met_for_certain_is_met(walk):
    """No instant's value is needed to know it, and of short cells it is next to the bound."""
    for count, near in ((1, 1.0), (32, 1e-6)):
        cells = whole(walk).parts(count)
        enclosed = enclose_along_path(walk, cells, 3)
        places = cells.lo[:, None] + (cells.hi - cells.lo)[:, None] * np.linspace(0, 1, 257)
        state = walk.within(np.repeat(cells.k, 257), places.ravel(), jerk=True)
        for n, name in enumerate(("q", "qd", "qdd", "qddd")):
            met = getattr(state, name).reshape(len(cells.k), 257, -1)
            low, high = enclosed.bound(getattr(enclosed, name))
            least, most = enclosed.axes[2:, n]
            # between two samples a parabola's peak is 1/256² of its height above both
            beside = np.ptp(met, axis=1) / 256**2 + 1e-12 * np.abs(met).max()
            assert (least >= met.min(1) - beside).all()
            assert (most <= met.max(1) + beside).all()
            assert np.maximum(least - low, high - most).max() <= near * np.abs(met).max()


def _bound_qdd(walk, cells):
    enclosed = enclose_along_path(walk, cells, 3)
    return enclosed.bound(enclosed.qdd)


def test_ranges_of_short_cells_are_near_what_is_met(walk):
    """No wider than the motion's own range but for what goes with the fourth power of a cell."""
    gaps = []
    for count in (1, 2, 4):
        cells = whole(walk).parts(count)
        low, high = _bound_qdd(walk, cells)
        places = cells.lo[:, None] + (cells.hi - cells.lo)[:, None] * np.linspace(0, 1, 65)
        met = walk.within(np.repeat(cells.k, 65), places.ravel()).qdd.reshape(len(cells.k), 65, -1)
        scale = np.abs(met).max()
        gaps.append(np.maximum(met.min(1) - low, high - met.max(1)).max() / scale)
    assert gaps[2] < 1e-9
    assert gaps[0] > 7 * gaps[1] > 49 * gaps[2]


def at_unit_rate(motion):
    """Of coefficients without error."""
    return np.concatenate([motion, 0 * motion, np.ones((1, motion.shape[1]))])


def test_polynomials_of_every_shape_stay_in_their_range():
    """Cubics with two peaks, and what higher powers make of them: values in extended precision, at
    2001 instants.
    """
    random, tau = np.random.default_rng(5), np.linspace(-1, 1, 2001, dtype=np.longdouble)
    polynomial, (cells, width) = np.polynomial.polynomial, (24, 2)
    for _ in range(12 if LONG else 3):
        mid = np.zeros((9, 1, width))
        mid[:8] = random.normal(size=(8, 1, width)) * 10 ** random.uniform(-3, 0, (8, 1, width))
        motion = random.normal(size=(4, cells)) * 10 ** random.uniform(-4, -0.1, (4, cells))
        motion /= np.maximum(1, np.abs(motion).sum(0) / 0.999)
        found = np.empty((4, 4, cells, width))
        bound_motion(np.stack([mid, 0 * mid]), np.zeros(cells, int), at_unit_rate(motion), found)
        for n, c in np.ndindex(cells, width):
            q = [np.longdouble(0)]
            for power in mid[7::-1, 0, c].astype(np.longdouble):
                q = polynomial.polyadd(
                    polynomial.polymul(q, motion[:, n].astype(np.longdouble)), [power]
                )
            for times in range(4):
                value = polynomial.polyval(tau, polynomial.polyder(q, times))
                middle, half, least, most = found[:, times, n, c]
                assert middle - half <= value.min() <= value.max() <= middle + half
                # between two instants a peak is 1/1000² of the range above both at the most, on the
                # steepest of them
                beside = 1e-6 * np.ptp(value) + 1e-13 * np.abs(value).max()
                assert least >= value.min() - beside
                assert most <= value.max() + beside


def test_a_cell_beyond_its_stretch_has_no_bound(walk):
    mid, rad = np.ones((9, 1, 1)), np.zeros((9, 1, 1))
    found = np.empty((4, 4, 1, 1))
    reach = np.array([[0.5], [0.6], [0.0], [0.0]])
    bound_motion(np.stack([mid, rad]), np.zeros(1, np.int64), at_unit_rate(reach), found)
    assert (found[1] == np.inf).all()


def test_the_kernel_is_the_same_in_python(monkeypatch):
    random = np.random.default_rng(1)
    mid, rad = random.normal(size=(9, 2, 2)), 1e-12 * random.uniform(size=(9, 2, 2))
    motion = random.uniform(-0.2, 0.2, (4, 3))
    cells = np.concatenate([motion, 1e-15 * np.abs(motion), random.uniform(1, 9, (1, 3))])
    given = (np.stack([mid, rad]), np.array([0, 1, 1]), cells)
    compiled, plain = np.empty((2, 4, 4, 3, 2))
    bound_motion(*given, compiled)
    source = (
        getattr(bound_motion, "function", None) or bound_motion.py_func
    )  # compiled before this module was loaded
    monkeypatch.setattr(kernels._THREAD, "plain", True, raising=False)  # for those that it calls
    source(*given, plain)
    # of the middle of a narrow range a last place is a little of the ball
    assert plain[0] == pytest.approx(compiled[0], rel=1e-14, abs=ROUNDINGS)
    assert plain[1] == pytest.approx(compiled[1], rel=1e-9, abs=10 * ROUNDINGS)
    assert plain[2:] == pytest.approx(compiled[2:], rel=1e-12, abs=10 * ROUNDINGS)
