"""A small part of the table of tracking laws: the best published law on both paths compared with
ours.
"""

import pytest

from benchmarks.evidence.cases.laws_compared import find_cut, learn_laws, measure_law
from controllers import find_law, load_rig


@pytest.fixture(scope="module")
def stated():
    return load_rig("servo-rig")


def test_ours_cut_the_contour_error_of_the_best_published_law(stated):
    """Law 1 is the best of the seven on both paths (the whole table: `python -m benchmarks.evidence
    laws_compared`).

    5 on the thesis' line is what was set as goal; on the second path, and with 30 % more inertia
    and friction, half.
    """
    theirs, ours = (
        measure_law(find_law(number, stated), stated, ("line", "circle"), (1.3,))
        for number in ("1", "mpc")
    )
    line, *others = find_cut(theirs[None], ours)
    assert line >= 5
    assert len(others) == 3
    assert min(others) >= 2.5
    assert ours[-2] <= 1.1 * theirs[-2]
    assert ours[-1] <= 1.5 * theirs[-1]


def test_the_model_in_a_learned_table_carries_over_to_another_path(stated):
    """The table itself is a motion along its own path."""
    table, fitted = learn_laws(stated, 3)
    (line, *_), (_, circle, *_) = (
        measure_law(table, stated, ("line",), (1.3,)),
        measure_law(fitted, stated, ("line", "circle"), (1.3,)),
    )
    plain = measure_law(find_law("1", stated), stated, ("line", "circle"), (1.3,))
    assert line < plain[0] / 5
    assert circle < plain[1] / 2.5
