"""Equations of the theory pages that have a small numeric check, run; and the files that the pages
name, looked up.
"""

import re

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.interpolate import CubicSpline, PPoly

from benchmarks.evidence.peers.problems import circle, spline
from planner import time_optimal
from planner.certificate import bound_polynomials
from planner.path.join_and_blend import overlap_lengths
from planner.timing import largest_speeds
from tests.docs.pages import DOCS

INTERVALS = 1000
CODE = re.compile(r"`([\w/]+\.py|[a-z_]+(?:/[a-z_]+)*/)`")


def test_every_file_that_a_page_names_is_there():
    """With its path, or as its name alone."""
    root = DOCS.parent
    floors = [
        root / name
        for name in ("kinematics", "planner", "controllers", "benchmarks", "pulsepath", "tests")
    ]
    names = {path.name for floor in floors for path in floor.rglob("*.py")}
    told = [
        (page.name, name)
        for page in (DOCS / "theory").glob("*.md")
        for name in CODE.findall(page.read_text("utf-8"))
    ]
    assert len(told) > 50
    assert [
        (page, name) for page, name in told if not ((root / name).exists() or name in names)
    ] == []


def timed(case, *, both_ends):
    """s and x = ṡ² (N+1,) of the fastest motion whose rows are kept at the intervals' starts, or at
    both ends.
    """
    s = case.path.breaks[0] + case.length * np.linspace(0, 1, INTERVALS + 1)
    step, piece = np.diff(s), case.piece((s[1:] + s[:-1]) / 2)
    speed, acceleration, _ = case.bounds[:, 1]
    rows, ceiling = [], np.full(len(s), np.inf)
    for at, points in ((s[:-1], slice(None, -1)), (s[1:], slice(1, None))):
        _, q1, q2, _ = case.path.derivatives(at, piece)
        ceiling[points] = np.minimum(ceiling[points], 1 / np.abs(q1 / speed).max(1) ** 2)
        end = 0 if points.start is None else 2 * step[:, None]
        rows.append(((q1 + end * q2) / acceleration, q2 / acceleration))
    a, b = (np.concatenate(part, 1) for part in zip(*rows[: 1 + both_ends], strict=True))
    a, b = (np.concatenate([part, part[-1:]]) for part in (a, b))
    unit = np.median(ceiling)  # so that x is about one
    x = unit * largest_speeds(
        [a * unit / case.length, b * unit, 0 * a], ceiling / unit, step / case.length
    )
    return s, x


def acceleration_used(case, s, x):
    """The largest share of a limit on acceleration at 21 places of every interval."""
    step, most = np.diff(s), 0.0
    u, piece = np.diff(x) / (2 * step), case.piece((s[1:] + s[:-1]) / 2)
    for share in np.linspace(0, 1, 21):
        _, q1, q2, _ = case.path.derivatives(s[:-1] + share * step, piece)
        here = x[:-1] + 2 * share * step * u
        most = max(
            most, float((np.abs(q1 * u[:, None] + q2 * here[:, None]) / case.bounds[1, 1]).max())
        )
    return most


@pytest.mark.parametrize(
    ("case", "starts", "both"), [(circle(), 1.007, 1.0000), (spline(), 2.17, 1.004)]
)
def test_rows_at_starts_are_broken_at_ends(case, starts, both):
    """order2.md; the figures are those printed there, to their last digit."""
    assert acceleration_used(case, *timed(case, both_ends=False)) == pytest.approx(
        starts, abs=0.006
    )
    s, x = timed(case, both_ends=True)
    assert acceleration_used(case, s, x) == pytest.approx(both, abs=6e-4)
    t = np.append(0, np.cumsum(2 * np.diff(s) / (np.sqrt(x[1:]) + np.sqrt(x[:-1]))))
    q = case.path.derivatives(
        s, np.append(case.piece((s[1:] + s[:-1]) / 2), len(case.path.breaks) - 2)
    )[0]
    fitted = CubicSpline(t, q, bc_type="clamped")(np.linspace(0, t[-1], 40_001), 2)
    assert (np.abs(fitted) / case.bounds[1, 1]).max() == pytest.approx(1.10, abs=0.01)


def test_a_blend_meets_its_neighbours_with_three_derivatives():
    """path.md: a = s − d and b = 0 to the third derivative at the start, a = 0 and b = s − d at the
    end.
    """
    reach = 0.7
    a, b = overlap_lengths(Polynomial([0, 1]), reach)
    assert np.abs((a + b - Polynomial([-reach, 1])).coef).max() < 1e-13
    for order, run in enumerate((-reach, 1.0, 0.0, 0.0)):
        first, last = (one.deriv(order) if order else one for one in (a, b))
        assert first(0.0) == pytest.approx(run, abs=1e-12)
        assert last(2 * reach) == pytest.approx(abs(run), abs=1e-11)
        assert first(2 * reach) == pytest.approx(0, abs=1e-11)
        assert last(0.0) == pytest.approx(0, abs=1e-12)


def test_leaving_rest_with_constant_jerk_is_singular_in_the_squared_speed():
    """order3.md: x = (9/2 j)^⅔ s^⁴⁄₃, so x″ grows without bound towards rest."""
    line = PPoly(np.array([[[1.0]], [[0.0]]]), np.array([0.0, 1.0]))
    jerk = 50.0
    state = time_optimal(line, max_speed=1.0, max_acceleration=5.0, max_jerk=jerk).trajectory.at(
        np.geomspace(1e-3, 0.05)
    )
    assert state.sd**2 == pytest.approx((4.5 * jerk) ** (2 / 3) * state.s ** (4 / 3), rel=1e-9)


@pytest.mark.parametrize("length", [1.0, 10.0])
def test_a_line_that_reaches_all_its_limits(length):
    """order3.md: T = L/V + V/A + A/J."""
    line = PPoly(np.array([[[length]], [[0.0]]]), np.array([0.0, 1.0]))
    speed, acceleration, jerk = 0.8, 2.0, 20.0
    found = time_optimal(line, max_speed=speed, max_acceleration=acceleration, max_jerk=jerk)
    expected = length / speed + speed / acceleration + acceleration / jerk
    assert found.trajectory.duration == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("columns", [1, 2000])
def test_values_at_places_over_estimate_a_parabola_by_a_small_share(columns):
    """certificate.md."""
    parabolas = np.tile([[1.0], [0.0], [-1.0]], columns)  # 1 − τ² on [−1, 1], of height 1
    low, high = bound_polynomials(parabolas)
    assert high == pytest.approx(np.full(columns, 1 + 1 / 4096), abs=1e-12)
    assert low == pytest.approx(np.full(columns, -1 / 4096), abs=1e-12)


def test_no_polynomial_leaves_its_range():
    """certificate.md."""
    random = np.random.default_rng(2)
    polynomial = random.normal(size=(9, 50)) * 2.0 ** -np.arange(9)[:, None]
    low, high = bound_polynomials(polynomial)
    for n in range(50):
        own = Polynomial(polynomial[:, n])
        turns = own.deriv().roots()
        places = np.append(turns[np.abs(turns.imag) < 1e-9].real.clip(-1, 1), [-1, 1])
        assert low[n] <= own(places).min()
        assert high[n] >= own(places).max()


def test_learning_by_the_plant_itself_shortens_every_error():
    """laws.md: e⁺ = e − P (PᵀP + σI)⁻¹ Pᵀ e = σ (P Pᵀ + σI)⁻¹ e."""
    random = np.random.default_rng(0)
    plant, error, sigma = np.tril(random.normal(size=(8, 8))), random.normal(size=8), 0.1
    step = np.linalg.solve(plant.T @ plant + sigma * np.eye(8), plant.T @ error)
    after = error - plant @ step
    assert after == pytest.approx(
        sigma * np.linalg.solve(plant @ plant.T + sigma * np.eye(8), error), abs=1e-12
    )
    assert np.linalg.norm(after) < np.linalg.norm(error)
