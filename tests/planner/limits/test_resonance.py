"""Resonance bands of an axis: kept below, or crossed within a stated time; one axis by hand, two by
dense samples.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from kinematics import Axis, MotionError
from planner import Trajectory
from planner.certificate import CROSSING, certify, find_stays
from planner.certificate.resonance_dwell import MIN_CELL_SHARE
from planner.limits import limits_of
from planner.limits.resonance import Resonance
from planner.path.polynomial import PolynomialPath
from planner.timing import certified_solve

LENGTH, SPEED, PUSH, BAND = 0.05, 0.02, 0.225, (0.003, 0.004)
LINE = PolynomialPath([0.0, LENGTH], np.array([[[1.0]], [[0.0]]]), ["x"])


def solved(order=2, path=LINE, **own):
    stated = {
        "max_speed": SPEED,
        "max_acceleration": PUSH,
        "max_jerk": 4.0,
        "resonance": (BAND,),
    } | own
    return certified_solve(
        path, limits_of(path, [Axis(name, **stated) for name in path.names], order), order
    )


def sampled(trajectory, low, high, count=200_001):
    """Longest time of each axis with low ≤ |q̇| ≤ high, by counting, and the sampling interval."""
    t = np.linspace(0, trajectory.duration, count)
    longest = []
    for speed in np.abs(trajectory.at(t).qd).T:
        edges = np.diff(np.concatenate([[0], (speed >= low) & (speed <= high), [0]]))
        longest.append(
            (np.flatnonzero(edges < 0) - np.flatnonzero(edges > 0)).max(initial=0) * t[1]
        )
    return np.array(longest), t[1]


def test_without_a_time_the_axis_keeps_below_the_band():
    """T = L/v + v/a with v the band's lower edge, to what the last of 9 intervals of a ramp
    loses.
    """
    moved = solved(max_acceleration=0.01)
    assert moved.certificate.worst["resonance"] == pytest.approx(1.0, abs=1e-6)
    assert moved.trajectory.duration == pytest.approx(LENGTH / BAND[0] + BAND[0] / 0.01, rel=1e-4)
    assert CROSSING not in moved.certificate.worst


def test_a_quick_crossing_costs_nothing():
    """At acceleration a it lasts (high − low)/a."""
    moved, free = solved(resonance_time=0.05), solved(resonance=None)
    assert moved.trajectory.duration == free.trajectory.duration
    exact = (BAND[1] - BAND[0]) / PUSH / 0.05
    assert exact <= moved.certificate.worst[CROSSING] <= exact + 2.1 * MIN_CELL_SHARE
    place = moved.certificate.where[CROSSING]
    assert place.axis == "x"
    # on the way up or down
    assert min(place.t, moved.trajectory.duration - place.t) == pytest.approx(
        BAND[0] / PUSH, abs=0.005
    )


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("own", [{"max_acceleration": 0.01}, {"max_speed": 0.0035}])
def test_what_cannot_cross_in_time_stays_below(order, own):
    moved = solved(order, resonance_time=0.05, **own)
    assert moved.certificate.holds
    assert moved.certificate.worst[CROSSING] == 0.0
    top = moved.trajectory.v.max()
    assert BAND[0] * 0.998 < top < BAND[0]
    assert moved.trajectory.duration < 1.02 * LENGTH / BAND[0]


def test_stays_of_a_known_motion():
    """x = a t²/2 up to the middle, then down: |q̇| is between two speeds for (high − low)/a each
    way.
    """
    half = np.sqrt(LENGTH / PUSH)
    top = PUSH * half
    motion = Trajectory(
        LINE, np.array([0, half, 2 * half]), np.array([0, LENGTH / 2]), np.array([0, top]), PUSH * np.array([1, -1]),
        np.zeros(2), np.zeros(2, int),
    )  # fmt: skip
    bands = ((0.2 * top, 0.3 * top), (0.95 * top, 1.2 * top))
    limit = Resonance([Axis("x", resonance=bands, resonance_time=0.1)])
    found = find_stays(motion, limit)
    assert [stay.band.low for stay in found] == [bands[0][0]] * 2 + [bands[1][0]]
    for stay, (start, end) in zip(found, [(0.2, 0.3), (1.7, 1.8), (0.95, 1.05)], strict=True):
        assert start * half - 0.1 * MIN_CELL_SHARE <= stay.start <= start * half
        assert end * half <= stay.end <= end * half + 0.1 * MIN_CELL_SHARE
        assert 0.1 * half - 0.2 * MIN_CELL_SHARE <= stay.inside <= 0.1 * half
    assert [(stay.first, stay.last) for stay in found] == [(0, 0), (1, 1), (0, 1)]
    certificate = certify(motion, [limit])
    assert certificate.worst[CROSSING] == pytest.approx(0.1 * half / 0.1, abs=2 * MIN_CELL_SHARE)
    assert certificate.holds == (certificate.worst[CROSSING] <= 1 + 1e-6)


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.03, 0.2))
def test_no_stay_of_two_axes_is_longer_than_proved(seed, time):
    random = np.random.default_rng(seed)
    spline = CubicSpline(np.arange(5.0), np.cumsum(random.uniform(-0.02, 0.02, (5, 2)), 0))
    path = PolynomialPath(spline.x, spline.c, ["x", "y"])
    free = solved(path=path, resonance=None)
    moved = solved(path=path, resonance_time=time)
    assert moved.certificate.holds
    longest, step = sampled(moved.trajectory, *BAND)
    assert longest.max() <= moved.certificate.worst[CROSSING] * time + 2 * step
    assert moved.certificate.attained[CROSSING].max() * time <= longest.max() + 2 * step
    assert (
        longest.max()
        >= moved.certificate.worst[CROSSING] * time - 2.1 * MIN_CELL_SHARE * time - 2 * step
    )
    assert moved.trajectory.duration >= free.trajectory.duration * (1 - 1e-9)
    before = sampled(free.trajectory, *BAND)[0].max()
    if before < 0.99 * time:
        assert moved.trajectory.duration == free.trajectory.duration


def test_what_is_no_band_is_refused():
    for bands in (((0.004, 0.003),), ((0.003, 0.005), (0.004, 0.006))):
        with pytest.raises(MotionError, match=r"axis x: resonance .* rising and apart"):
            Axis("x", resonance=bands)
    for bands in (((0.0, 0.003),), ((0.003, np.inf),)):
        with pytest.raises(
            MotionError,
            match=r"axis x: resonance .* must be finite numbers \(N, 2\) in m/s above 0",
        ):
            Axis("x", resonance=bands)
    with pytest.raises(MotionError, match="resonance_time without resonance"):
        Axis("x", resonance_time=0.1)
    with pytest.raises(MotionError, match=r"resonance_time .* above 0, not 0.0"):
        Axis("x", resonance=(BAND,), resonance_time=0.0)


@pytest.mark.parametrize("seed", [0, 5, 15, 29])
def test_bands_that_can_be_kept_below_are_never_refused(seed):
    """Slow enough, every motion is below all bands; some used to be held at the same speed again
    and again.
    """
    rng = np.random.default_rng([seed, 14])
    axes, knots = int(rng.integers(1, 4)), int(rng.integers(2, 7))
    spline = CubicSpline(
        np.arange(float(knots)), 0.05 * rng.normal(size=(knots, axes)), bc_type="natural"
    )
    order = int(rng.choice([2, 3]))
    lows = np.sort(rng.uniform(1e-3, 15e-3, int(rng.integers(1, 3))))
    bands = [(low, low * rng.uniform(1.05, 1.6)) for low in lows]
    time = 10.0 ** rng.uniform(-2.3, 0)
    stated = [
        Axis(
            f"a{k}", max_speed=0.02, max_acceleration=10 ** rng.uniform(-2, 0), max_jerk=10 ** rng.uniform(0, 2),
            resonance=tuple(bands), resonance_time=time,
        )
        for k in range(axes)
    ]  # fmt: skip
    path = PolynomialPath(spline.x, spline.c, [axis.name for axis in stated])
    moved = certified_solve(path, limits_of(path, stated, order), order)
    assert moved.certificate.holds
    for band in bands:
        longest, step = sampled(moved.trajectory, *band, count=100_001)
        assert (longest <= time + 2 * step).all()
