"""Taylor series in ball arithmetic: every enclosure contains the exact coefficients, and not much
more.
"""

from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from math import factorial, isqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinematics.foundation.taylor_model import EPS, Series

pytestmark = pytest.mark.filterwarnings(
    "ignore:invalid value:RuntimeWarning"
)  # unbounded: ∞ · 0 reads as no bound

ENTRIES = 2
BITS = 400
"""Binary digits of the irrational truths: roots and sines of numbers below 1e6 are then good to
1e-80 and better.
"""

EXACTLY = Context(prec=120)
"""Digits of exponentials and logarithms."""

nothing = st.just(0.0)
# Far from overflow and underflow in every power that order 4 takes; signs and scales mixed.
numbers = st.one_of(
    nothing,
    *(st.floats(low, high) for low, high in ((-1e9, -1e-9), (1e-9, 1e9), (-4, -0.25), (0.25, 4))),
)
radii = st.one_of(nothing, st.floats(1e-12, 1e3), st.floats(1e-3, 0.5))
halves = st.one_of(nothing, st.floats(-0.5, -1e-6), st.floats(1e-6, 0.5))
angles = st.one_of(nothing, st.floats(-60, -1e-6), st.floats(1e-6, 60))
spans = st.one_of(nothing, st.floats(1e-12, 4))
shares = st.sampled_from([Fraction(n, 4) for n in range(-4, 5)])


@dataclass
class Drawn:
    """A series of balls, and in every entry one exact series (coefficients 0 … order) that the
    balls contain.
    """

    series: Series
    points: list[list[Fraction]]


@st.composite
def balls(draw, order, values=numbers, errors=radii):
    count = draw(st.integers(1, order + 1)) * ENTRIES

    def column(strategy):
        return draw(st.lists(strategy, min_size=count, max_size=count))

    mid, rad, share = column(values), column(errors), column(shares)
    exact = [Fraction(m) + t * Fraction(r) for m, r, t in zip(mid, rad, share, strict=True)]
    points = [(exact[k::ENTRIES] + [Fraction(0)] * order)[: order + 1] for k in range(ENTRIES)]
    shape = (-1, ENTRIES)
    return Drawn(Series(np.reshape(mid, shape), np.reshape(rad, shape), order), points)


def product(a, b):
    return [sum((a[j] * b[k - j] for j in range(k + 1)), Fraction(0)) for k in range(len(a))]


def composed(outer, a):
    """Coefficients of f(a(τ)) from the Taylor coefficients of f at a(0): no recurrence of the code
    under test.
    """
    inner, result = [Fraction(0), *a[1:]], [Fraction(0)] * len(a)
    for coefficient in reversed(outer):
        result = product(result, inner)
        result[0] += coefficient
    return result


def reciprocal(a):
    return composed([(-1) ** n / a[0] ** (n + 1) for n in range(len(a))], a) if a[0] else None


def quotient(a, b):
    return product(a, reciprocal(b)) if b[0] else None


def root(a):
    if a[0] <= 0:
        return None
    outer = [Fraction(isqrt((a[0].numerator << 2 * BITS) // a[0].denominator), 1 << BITS)]
    for n in range(len(a) - 1):  # binomial series of √(a0 + u)
        outer.append(outer[-1] * (Fraction(1, 2) - n) / (n + 1) / a[0])
    return composed(outer, a)


def sine_cosine(x):
    """By the power series, in fixed-point integers."""
    angle, term, sums = (x.numerator << BITS) // x.denominator, 1 << BITS, [0, 0]
    for n in range(1, 600):
        sums[(n - 1) % 2] += term if (n - 1) % 4 < 2 else -term
        term = (term * angle >> BITS) // n
    return Fraction(sums[1], 1 << BITS), Fraction(sums[0], 1 << BITS)


def circular(a, turned):
    sine, cosine = sine_cosine(a[0])
    cycle = [sine, cosine, -sine, -cosine][turned:] + [sine, cosine, -sine, -cosine][:turned]
    factorial, outer = 1, []
    for n in range(len(a)):
        factorial *= max(n, 1)
        outer.append(cycle[n % 4] / factorial)
    return composed(outer, a)


def arctangent(t):
    """Fixed-point, |t| ≤ 1: halved three times by t/(1 + √(1 + t²)), then the power series."""
    one = 1 << BITS
    t = (t.numerator << BITS) // t.denominator
    for _ in range(3):
        t = (t << BITS) // (one + isqrt((one << BITS) + t * t))
    total, power, n = 0, t, 0
    while power:
        total += (power if n % 2 == 0 else -power) // (2 * n + 1)
        power = (power * t >> BITS) * t >> BITS
        n += 1
    return Fraction(8 * total, one)


def angle(y, x):
    """Coefficients of Im log(x + i y): the logarithm's own power series about the point, in complex
    fractions.
    """
    if not (x[0] or y[0]):
        return None
    quarter = 2 * arctangent(Fraction(1))
    if abs(x[0]) >= abs(y[0]):
        start = arctangent(y[0] / x[0]) + (
            0 if x[0] > 0 else 2 * quarter * (1 if y[0] >= 0 else -1)
        )
    else:
        start = quarter * (1 if y[0] > 0 else -1) - arctangent(x[0] / y[0])
    square = x[0] ** 2 + y[0] ** 2
    real = [
        Fraction(0),
        *((x[0] * a + y[0] * b) / square for a, b in zip(x[1:], y[1:], strict=True)),
    ]
    imaginary = [
        Fraction(0),
        *((x[0] * b - y[0] * a) / square for a, b in zip(x[1:], y[1:], strict=True)),
    ]
    result, power = [start, *[Fraction(0)] * (len(x) - 1)], (real, imaginary)
    for n in range(1, len(x)):
        result = [
            r + Fraction((-1) ** (n + 1), n) * p for r, p in zip(result, power[1], strict=True)
        ]
        (a, b), (c, d) = power, (real, imaginary)
        power = (
            [p - q for p, q in zip(product(a, c), product(b, d), strict=True)],
            [p + q for p, q in zip(product(a, d), product(b, c), strict=True)],
        )
    return result


def exponential(a):
    start = Fraction(
        EXACTLY.divide(Decimal(a[0].numerator), Decimal(a[0].denominator)).exp(EXACTLY)
    )
    return composed([start / factorial(n) for n in range(len(a))], a)


def logarithm(a):
    if a[0] <= 0:
        return None
    start = Fraction(EXACTLY.divide(Decimal(a[0].numerator), Decimal(a[0].denominator)).ln(EXACTLY))
    return composed([start, *(-1 / (n * (-a[0]) ** n) for n in range(1, len(a)))], a)


EXACT = {
    "sum": (
        lambda a, b: a + b,
        lambda a, b: [x + y for x, y in zip(a, b, strict=True)],
        numbers,
        radii,
    ),
    "difference": (
        lambda a, b: a - b,
        lambda a, b: [x - y for x, y in zip(a, b, strict=True)],
        numbers,
        radii,
    ),
    "product": (lambda a, b: a * b, product, numbers, radii),
    "quotient": (lambda a, b: a / b, quotient, numbers, radii),
    "opposite": (lambda a: -a, lambda a: [-x for x in a], numbers, radii),
    "square": (lambda a: a * a, lambda a: product(a, a), numbers, radii),
    "reciprocal": (lambda a: 1 / a, reciprocal, numbers, radii),
    "root": (lambda a: a.sqrt(), root, numbers, radii),
    "sine": (lambda a: a.sincos()[0], lambda a: circular(a, 0), angles, spans),
    "cosine": (lambda a: a.sincos()[1], lambda a: circular(a, 1), angles, spans),
    "exponential": (lambda a: a.exp(), exponential, angles, spans),
    "logarithm": (lambda a: a.log(), logarithm, numbers, radii),
    "angle": (lambda a, b: a.atan2(b), angle, numbers, radii),
    "derivative": (
        lambda a: a.derivative(),
        lambda a: [k * x for k, x in enumerate(a)][1:],
        numbers,
        radii,
    ),
    "second derivative at a rate of 3/4": (
        lambda a: a.differentiate(2, np.array([0.75])),
        lambda a: [k * (k - 1) * x * Fraction(9, 16) for k, x in enumerate(a)][2:],
        numbers,
        radii,
    ),
}
"""Operation on series; on exact coefficients (None where it is not defined); what to draw."""


def coefficient(series, k, entry):
    """(mid, rad) of one ball; coefficients above the degree are exactly zero."""
    if k > series.degree:
        return 0.0, 0.0
    both = np.broadcast_arrays(series.mid[k], series.rad[k], np.zeros(ENTRIES))
    return both[0][entry], both[1][entry]


def bounded(mid, rad):
    return bool(np.isfinite(mid) and np.isfinite(rad))


def assert_contains(series, truths):
    """Every bounded ball contains its coefficient; where nothing is defined, other tests say what
    may be claimed.
    """
    for entry, truth in enumerate(truths):
        for k in range(series.order + 1 if truth else 0):
            mid, rad = coefficient(series, k, entry)
            if bounded(mid, rad):
                assert abs(truth[k] - Fraction(mid)) <= Fraction(rad), (
                    f"τ^{k}: {float(truth[k])!r} not in {mid} ± {rad}"
                )


@pytest.mark.parametrize("name", EXACT)
@settings(max_examples=20)
@given(data=st.data())
def test_balls_contain_the_exact_coefficients_of_every_series_in_the_arguments(name, data):
    operation, exact, values, errors = EXACT[name]
    order = data.draw(st.integers(1, 4))
    arguments = [
        data.draw(balls(order, values, errors)) for _ in range(operation.__code__.co_argcount)
    ]
    result = operation(*(a.series for a in arguments))
    assert_contains(
        result, [exact(*points) for points in zip(*(a.points for a in arguments), strict=True)]
    )


@pytest.mark.parametrize("name", EXACT)
@settings(max_examples=20)
@given(data=st.data())
def test_thin_arguments_give_thin_results(name, data):
    """Order 5 takes some dozen roundings of 1.1e-16 on coefficients that these arguments keep below
    20.
    """
    operation, exact, *_ = EXACT[name]

    def drawn():
        tail = data.draw(st.lists(halves, min_size=10, max_size=10))
        mid = np.reshape([*data.draw(st.tuples(*[st.floats(1, 2)] * 2)), *tail], (6, ENTRIES))
        return Series(mid, np.zeros_like(mid), 5)

    arguments = [drawn() for _ in range(operation.__code__.co_argcount)]
    result = operation(*arguments)
    assert result.rad.max() <= 1e-13
    exact_arguments = [
        [[Fraction(x) for x in a.mid[:, k]] for k in range(ENTRIES)] for a in arguments
    ]
    assert_contains(result, [exact(*points) for points in zip(*exact_arguments, strict=True)])


@given(
    st.floats(0.5, 100),
    st.floats(0, 0.999),
    angles,
    st.one_of(nothing, st.floats(1e-6, 50)),
    st.sampled_from([1, -1]),
)
def test_wide_balls_are_as_tight_as_the_image_of_the_interval(mid, share, other, width, sign):
    def ball(m, r):
        return Series(np.array([[m]]), np.array([[r]]), 0)

    def covers(series, low, high):
        """The ball is [low, high], within rounding of the largest number involved."""
        slack = 1e-14 * max(abs(low), abs(high))
        assert series.mid[0, 0] - series.rad[0, 0] == pytest.approx(low, abs=slack)
        assert series.mid[0, 0] + series.rad[0, 0] == pytest.approx(high, abs=slack)

    low, high = mid - share * mid, mid + share * mid
    positive = ball(mid, share * mid)
    covers(1 / ball(sign * mid, share * mid), *sorted((sign / low, sign / high)))
    covers(positive.sqrt(), np.sqrt(low), np.sqrt(high))
    extreme = (abs(other) + width) * high
    assert (positive * ball(other, width)).rad[0, 0] == pytest.approx(
        extreme - abs(other) * mid, abs=1e-14 * extreme
    )
    for part, slope in zip(
        ball(other, width).sincos(), (np.cos(other), np.sin(other)), strict=True
    ):
        assert part.rad[0, 0] <= min(abs(slope) * width + width**2 / 2, 2) + 16 * EPS


zero_inside = st.tuples(st.floats(-1, 1), st.floats(0, 10)).map(
    lambda pair: (pair[0] * pair[1], pair[1])
)
tails = st.lists(numbers, max_size=3)


def around(first, tail, order=3):
    """A series whose constant coefficient is the ball (mid, rad), the others exact; two equal
    entries.
    """
    mid = np.repeat(np.array([first[0], *tail])[:, None], ENTRIES, 1)
    return Series(
        mid,
        np.concatenate([np.full((1, ENTRIES), first[1]), np.zeros((len(tail), ENTRIES))]),
        order,
    )


@given(
    zero_inside,
    tails,
    st.one_of(balls(3), st.just(Drawn(Series.constant(np.zeros(ENTRIES), 3), []))),
)
def test_a_divisor_that_may_vanish_bounds_nothing(first, tail, top):
    """0/0 included: a quotient that is not defined has no value, not even zero."""
    result = top.series / around(first, tail)
    assert not any(bounded(*coefficient(result, 0, entry)) for entry in range(ENTRIES))
    assert not np.isfinite(result.mid + result.rad).any()


@given(zero_inside, tails)
def test_a_root_of_what_may_vanish_has_no_bounded_slope(first, tail):
    result = around(first, tail).sqrt()
    assert not np.isfinite(result.mid[1:] + result.rad[1:]).any()
    top = np.sqrt(first[0] + first[1])
    mid, rad = coefficient(result, 0, 0)
    assert not bounded(mid, rad) or (mid - rad <= 0 and mid + rad >= top)


@given(st.floats(-10, -1e-6), st.floats(0, 0.99), tails)
def test_a_root_of_negative_numbers_bounds_nothing(mid, share, tail):
    result = around((mid, -mid * share), tail).sqrt()
    assert not np.isfinite(result.mid + result.rad).any()


@given(balls(4), balls(4), st.integers(0, 3))
def test_degree_and_order(a, b, extra):
    a, b = a.series, b.series
    zero = not (a.mid.any() or a.rad.any()), not (b.mid.any() or b.rad.any())
    assert (a + b).degree == (a - b).degree == max(a.degree, b.degree)
    if not any(zero):
        assert (a * b).degree == min(a.degree + b.degree, 4)
    assert a.derivative().degree == max(a.degree - 1, 0)
    assert a.derivative().order == 3
    assert a.pad(a.degree + extra).degree == a.degree + extra
    for part in a.sincos():
        assert part.degree == (
            4 if a.degree else 0
        )  # constants stay constants, which keeps what follows short
    for series in (a + b, a - b, a * b, -a, a.pad(4), *a.sincos()):
        assert series.order == 4
        assert (series.rad >= 0).all()


def test_what_is_cut_off_is_never_claimed():
    """Of (1 + τ)² cut after τ² the derivative is known to τ only: no sum or product with it knows
    more.
    """
    square = Series(np.array([[1.0], [2.0], [1.0]]), np.zeros((3, 1)), 2)
    cut = Series(
        np.array([[1.0], [3.0], [3.0]]), np.zeros((3, 1)), 2
    ).derivative()  # of (1 + τ)³: 3 + 6τ + 3τ²
    assert cut.order == 1
    for known, truth in (
        (square + cut, [4, 8, 4]),
        (cut + square, [4, 8, 4]),
        (square * cut, [3, 12, 18]),
        (cut * square, [3, 12, 18]),
        (square / cut, [Fraction(1, 3), 0, 0]),
        (cut / square, [3, 0, 0]),
    ):
        assert_contains(known, [[Fraction(x) for x in truth]])


@given(balls(3), balls(3), st.floats(-5, 5))
def test_numbers_and_arrays_stand_on_either_side(a, b, number):
    a, array = a.series, b.series.mid[0]
    for plain in (number, array):
        series = Series.constant(np.broadcast_to(plain, ENTRIES), 3)
        for left, right in (
            (plain + a, series + a),
            (a + plain, a + series),
            (plain - a, series - a),
            (a - plain, a - series),
            (plain * a, series * a),
            (a * plain, a * series),
        ):
            assert isinstance(left, Series)
            assert np.array_equal(*np.broadcast_arrays(left.mid, right.mid))
            # the radius of a product is rounded differently with its factors exchanged
            np.testing.assert_allclose(*np.broadcast_arrays(left.rad, right.rad), rtol=4 * EPS)


@pytest.mark.parametrize("name", EXACT)
@settings(max_examples=20)
@given(data=st.data())
def test_entries_do_not_touch_each_other(name, data):
    """Every entry of an array of series gives what it gives alone; a series of one entry serves
    all.
    """
    operation = EXACT[name][0]
    well = st.floats(0.5, 4)
    arguments = [
        data.draw(balls(3, well, st.floats(0, 0.25))).series
        for _ in range(operation.__code__.co_argcount)
    ]
    whole = operation(*arguments)
    for k in range(ENTRIES):
        alone = operation(*(a[k : k + 1] for a in arguments))
        # where a series has no value, as beside a root of 0, neither of them has
        assert np.array_equal(alone.mid[:, 0], whole.mid[:, k], equal_nan=True)
        assert np.array_equal(alone.rad[:, 0], whole.rad[:, k], equal_nan=True)
    if len(arguments) == 2:
        one, many = arguments[0][:1], arguments[1]
        spread = operation(one, many)
        repeated = operation(one[np.zeros(ENTRIES, int)], many)
        assert np.array_equal(*np.broadcast_arrays(spread.mid, repeated.mid), equal_nan=True)
        assert np.array_equal(*np.broadcast_arrays(spread.rad, repeated.rad), equal_nan=True)


@given(balls(3), balls(3))
def test_series_are_put_side_by_side_and_taken_apart(a, b):
    a, b = a.series, b.series
    both = Series.stack([a, b])
    assert both.mid.shape == (max(a.degree, b.degree) + 1, ENTRIES, 2)
    for part, original in zip((both[:, 0], both[:, 1]), (a, b), strict=True):
        assert np.array_equal(part.mid, original.pad(both.degree).mid)
        assert np.array_equal(part.rad, original.pad(both.degree).rad)
    filled = Series.zeros(3, (3,))
    filled.put(np.array([True, False, True]), a)
    assert np.array_equal(filled[np.array([0, 2])].mid, a.pad(3).mid)
    assert np.array_equal(filled[np.array([0, 2])].rad, a.pad(3).rad)
    assert not filled[1].mid.any()


@given(balls(3))
def test_zero_annihilates_and_stays_short(a):
    for result in (a.series * 0.0, Series.constant(np.zeros(ENTRIES), 3) * a.series):
        assert result.degree == 0
        assert not result.mid.any()
        assert not result.rad.any()


def test_side_by_side_nothing_is_claimed_beyond_what_is_known_least():
    """x known to τ⁴ beside its second derivative, known to τ²: both to τ² afterwards."""
    x = Series(np.arange(1.0, 6.0).reshape(5, 1), np.zeros((5, 1)), 4)
    for parts in ((x, x.derivative().derivative()), (x.derivative().derivative(), x)):
        both = Series.stack(parts)
        assert (both.order, both.degree) == (2, 2)
        assert np.sort(both.mid[:, 0], axis=1).tolist() == [[1.0, 6.0], [2.0, 24.0], [3.0, 60.0]]
