"""Observability indices: by their definitions, and indifferent to units."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kinematics.calibration.result import describe_combination, observe


def test_the_indices_of_a_jacobian_by_hand():
    """Columns of length √2 at 60°: scaled, σ² = 1 ± ½."""
    observed = observe(np.array([[1.0, 0], [0, 1], [1, 1]]), poses=3)
    first, last = np.sqrt(1.5), np.sqrt(0.5)
    np.testing.assert_allclose(observed.singular, [first, last], rtol=1e-15)
    expected = {
        "O1": np.sqrt(first * last) / np.sqrt(3),
        "O2": last / first,
        "O3": last,
        "O4": last**2 / first,
    }
    assert observed.indices == pytest.approx(expected, rel=1e-14)


@given(st.integers(0, 1000), st.lists(st.floats(-6, 6), min_size=4, max_size=4))
def test_units_of_the_parameters_do_not_matter(seed, powers):
    jacobian = np.random.default_rng(seed).normal(size=(9, 4))
    scale = 10.0 ** np.array(powers)
    assert observe(jacobian * scale, 3).indices == pytest.approx(
        observe(jacobian, 3).indices, rel=1e-6
    )


@given(st.integers(0, 1000))
def test_seen_changes_give_independent_errors_of_unit_length(seed):
    jacobian = np.random.default_rng(seed).normal(size=(8, 3)) * [1.0, 1e-3, 1e3]
    errors = jacobian @ observe(jacobian, 4).observable_changes
    np.testing.assert_allclose(errors.T @ errors, np.eye(3), atol=1e-10)


def test_a_parameter_without_effect_and_two_of_the_same():
    random = np.random.default_rng(0)
    a, b = random.normal(size=(2, 6))
    observed = observe(np.stack([a, np.zeros(6), b, 1e3 * b], 1), poses=2)
    assert observed.rank == 2
    assert set(observed.indices.values()) == {0.0}
    np.testing.assert_array_equal(observed.separate, [True, False, False, False])
    assert (
        np.stack([a, np.zeros(6), b, 1e3 * b], 1) @ observed.unobservable_changes.T
    ) == pytest.approx(0, abs=1e-10)


def test_the_weakest_combination_is_one_standard_error_long():
    jacobian = np.random.default_rng(3).normal(size=(8, 3))
    observed = observe(jacobian, 4)
    assert np.linalg.norm(jacobian @ observed.weakest) == pytest.approx(1)
    others = np.random.default_rng(4).normal(size=(100, 3))
    gain = np.linalg.norm(others / observed.scale @ (jacobian * observed.scale).T, axis=1)
    assert (
        gain / np.linalg.norm(others / observed.scale, axis=1) >= observed.singular[-1] - 1e-12
    ).all()


def test_combinations_in_words():
    assert describe_combination(np.array([-0.5, 1e-4, 0.25]), ["a", "b", "c"]) == "1·a − 0.5·c"
    assert describe_combination(np.ones(10), list("abcdefghij")).endswith("+ 1·h and 2 more")
