"""Points chosen for a reader's interpolation: against SciPy's, known remainders, and motions that
need few points.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BPoly, CubicHermiteSpline

from kinematics import Axis, MotionError
from planner.export.knots import MAX_BACKWARD_PULSES, Segments, choose_knots, rows_at

UM = (Axis("X", pulse=1e-6),)


@dataclass
class Polynomial:
    """q(t) = Σ c_i tⁱ (c: (degree + 1, axes)) until `duration`, where it rests; pieces as the knots
    say.
    """

    c: np.ndarray
    duration: float
    knots: np.ndarray

    def at(self, t):
        held = np.clip(t, 0, self.duration)
        rate = [np.polynomial.polynomial.polyder(self.c, k) for k in range(4)]
        values = [np.polynomial.polynomial.polyval(held, c).T for c in rate]
        return _State(*values)


@dataclass
class _State:
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    qddd: np.ndarray


def power(n, scale=1.0, duration=1.0):
    c = np.zeros((n + 1, 1))
    c[n] = scale
    return Polynomial(c, duration, np.array([0.0, duration]))


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.integers(1, 3), st.integers(0, 2**32 - 1))
def test_segments_are_those_of_scipy(rows, seed):
    random = np.random.default_rng(seed)
    t = np.cumsum(random.uniform(1e-3, 1, 6))
    data = random.normal(size=(rows, 6, 2))
    segments = Segments(t[:-1], t[1:], data[:, :-1], data[:, 1:])
    u = np.linspace(0, 1, 7)
    ours = data[0][:-1] + np.einsum(
        "up,psa->usa", u[:, None] ** np.arange(2 * rows), segments.coefficients
    )
    when = segments.start + u[:, None] * (segments.end - segments.start)
    theirs = BPoly.from_derivatives(t, np.moveaxis(data, 0, 1))(when)
    assert np.allclose(ours, theirs, atol=1e-11)
    if rows == 2:
        assert np.allclose(ours, CubicHermiteSpline(t, data[0], data[1])(when), atol=1e-11)


@pytest.mark.parametrize(("rows", "remainder"), [(1, 1 / 8), (2, 1 / 384), (3, 1 / 46080)])
def test_the_deviation_is_the_known_remainder(rows, remainder):
    """|q⁽²ᵐ⁾| h²ᵐ / ((2m)! 4ᵐ) in the middle, told to a hundredth; and no less, but for ë at probes
    beside its peak.
    """
    h = 0.5
    motion = power(2 * rows)
    start, end = np.array([0.25]), np.array([0.25 + h])
    segments = Segments(start, end, rows_at(motion, start, rows), rows_at(motion, end, rows))
    known = np.prod(np.arange(1, 2 * rows + 1)) * h ** (2 * rows) * remainder
    found = segments.deviation(motion, 33)[0, 0]  # an odd number of parts: none ends in the middle
    assert known * (1 - 1e-4) <= found <= 1.01 * known


def test_a_cubic_that_runs_back_is_measured():
    """From rest by 1 in 1 s, to an end speed v: q̇ = (6 - 2v)u + (3v - 6)u² is first negative where
    v > 3.
    """
    one = np.zeros(1), np.ones(1)
    u = np.linspace(0, 1, 200_001)
    turning = Polynomial(np.array([[0.0], [1.0], [-1.0]]), 1.0, np.array([0.0, 1.0]))
    for entry, speed in [(0.0, 2.9), (0.0, 3.1), (0.0, 3.5), (0.05, 3.1), (0.05, 3.5), (3.5, 0.05)]:
        ends = np.array([[0.0, 1.0], [entry, speed]])
        for sign in (1, -1):
            segments = Segments(*one, sign * ends[:, :1, None], sign * ends[:, 1:, None])
            found = segments.backward_way(power(1, scale=sign), 8)[0, 0]
            q = CubicHermiteSpline([0, 1], *ends)(u)
            assert found == pytest.approx((np.maximum.accumulate(q) - q).max(), abs=1e-9)
            assert (found > 0) == ((entry, speed) not in [(0.0, 2.9), (0.05, 3.1)])
            assert (
                segments.backward_way(turning, 8)[0, 0] == 0
            )  # there and back: the motion's own reversal


def test_no_more_points_than_the_remainder_asks_for():
    """q = a t⁴: equal segments of h = (384 · ½ pulse / 24 a)^¼ would do; halving at most doubles
    their number.
    """
    motion = power(4, scale=1e-3)
    knots = choose_knots(motion, UM, 2, step=1e-9, tolerance=None, spacing=None)
    least = (24e-3 / (384 * 0.5e-6)) ** 0.25
    assert least <= len(knots.steps) - 1 <= 2 * least + 1


@pytest.mark.parametrize("n", [1, 2, 3])
def test_what_the_reader_makes_exactly_needs_no_points(n):
    """A line, a parabola and a cubic in a fourth of a second, with the speed: one segment."""
    assert (
        len(
            choose_knots(
                power(n, duration=0.25), UM, 2, step=1e-9, tolerance=1e-3, spacing=None
            ).steps
        )
        == 2
    )


def test_a_jump_of_acceleration_is_parted_at_its_knot():
    @dataclass
    class Jump:
        duration: float = 1.0
        knots = np.array([0.0, 0.3, 1.0])

        def at(self, t):
            after = np.maximum(np.clip(t, 0, 1) - 0.3, 0)[:, None]
            return _State(after**2, 2 * after, 2.0 * (t >= 0.3)[:, None], 0 * after)

    assert choose_knots(Jump(), UM, 2, step=1e-9, tolerance=0.5, spacing=None).steps.tolist() == [
        0,
        300_000_000,
        10**9,
    ]


def test_even_spacing_outlasts_the_motion_by_less_than_one():
    knots = choose_knots(power(1), UM, 1, step=1e-6, tolerance=None, spacing=0.3)
    assert knots.steps.tolist() == [0, 300_000, 600_000, 900_000, 1_200_000]
    assert knots.describe() == "segments: 4, of 300 ms"


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"tolerance": 0.5, "spacing": 0.1}, "exclude"),
        ({"tolerance": 0.0}, "tolerance 0 pulses"),
        ({"tolerance": np.nan}, "tolerance nan"),
        ({"spacing": 0.0}, "spacing 0 s: must be at least 1e-06"),
        ({"spacing": -1.0}, "spacing -1 s"),
        ({"spacing": np.inf}, "spacing inf s"),
        ({"spacing": 0.5}, "at most 0.2 s"),
        (
            {"tolerance": 1e-3, "step": 1e-4},
            "axis X: no spacing of whole 0.0001 s keeps the reader within 0.001 pulses",
        ),
    ],
)
def test_what_cannot_be_is_refused(given, told):
    with pytest.raises(MotionError, match=told):
        choose_knots(
            power(4),
            UM,
            1,
            longest=200_000,
            **{"tolerance": None, "spacing": None, "step": 1e-6} | given,
        )


def test_no_motion_is_refused():
    with pytest.raises(MotionError, match="nothing to export"):
        choose_knots(power(1, duration=0.0), UM, 1, step=1e-6, tolerance=None, spacing=None)


def test_segments_are_cut_to_the_longest():
    knots = choose_knots(
        power(1, scale=0.0), UM, 2, step=1e-3, tolerance=None, spacing=None, longest=300
    )
    assert knots.steps.tolist() == [0, 250, 500, 750, 1000]


def test_chosen_points_leave_no_cubic_that_runs_back():
    """q̇ = (t - ½)² + 1 µm/s comes near to a stop: cubics of long segments run back there."""
    c = np.array([[0.0], [0.25 + 1e-6], [-0.5], [1 / 3]])
    c = np.vstack([c, [[0.0], [0.02]]])
    motion = Polynomial(c, 1.0, np.array([0.0, 1.0]))
    pulse = 1e-3
    axes = (Axis("X", pulse=pulse),)
    ends = np.array([0.3, 0.9])
    long = Segments(ends[:1], ends[1:], rows_at(motion, ends[:1], 2), rows_at(motion, ends[1:], 2))
    t = choose_knots(motion, axes, 2, step=1e-6, tolerance=100.0, spacing=None).steps * 1e-6
    cubic = CubicHermiteSpline(t, *rows_at(motion, t, 2))
    q = cubic(np.linspace(0, 1, 100_001)).ravel()
    assert (np.maximum.accumulate(q) - q).max() <= MAX_BACKWARD_PULSES * pulse
    assert long.deviation(motion, 8)[0, 0] < 100 * pulse


@pytest.mark.parametrize("hours", [20, 100])
def test_a_rest_of_days_is_cut_in_whole_nanoseconds(hours):
    """At rest for days after one second of motion: 100 h are 3.6e14 ns, times 36 000 parts more
    than 63 bits hold.
    """
    duration = 3600.0 * hours
    ramp = np.array([[0.0], [0.0], [3e-3], [-2e-3]])  # 3 t² − 2 t³, from rest to rest

    class Resting(Polynomial):
        def at(self, t):
            state = Polynomial(self.c, 1.0, self.knots).at(np.minimum(t, 1.0))
            still = np.asarray(t)[..., None] >= 1.0
            return _State(
                state.q, *(np.where(still, 0.0, rate) for rate in (state.qd, state.qdd, state.qddd))
            )

    motion = Resting(ramp, duration, np.array([0.0, 1.0, duration]))
    knots = choose_knots(motion, UM, 3, step=1e-9, tolerance=None, spacing=None)
    gaps = np.diff(knots.steps)
    assert gaps.min() > 0
    assert gaps.max() <= 10e9
    assert knots.steps[[0, -1]].tolist() == [0, hours * 3600 * 10**9]
