"""A small version of the table of tracking laws: the best published law on both paths against ours."""

import pytest

from benchmarks.evidence.trials.laws_compared import SECOND, TUNED, error_reductions, measure_learning, row, verdict
from controllers import find_law, load_rig


@pytest.fixture(scope="module")
def stated():
    return load_rig("servo-rig")


def test_ours_cut_the_contour_error_of_the_best_published_law(stated):
    """Law 1 is the best of the seven on both paths (the whole table: `python -m
    benchmarks.evidence.trials.laws_compared`).

    5 on the thesis' line is what was set as goal; on the second path, and with 30 % more inertia and friction, half.
    """
    rows = [row(number, find_law(number, stated), stated, (), shares=(1.3,)) for number in ("1", "mpc")]
    theirs, ours = rows
    cut = error_reductions(ours, rows)
    assert cut[TUNED] >= 5
    assert min(cut[SECOND], cut[f"{TUNED} ±30 %"], cut[f"{SECOND} ±30 %"]) >= 2.5
    assert ours.torque_rms <= 1.1 * theirs.torque_rms
    assert ours.torque_peak <= 1.5 * theirs.torque_peak
    assert ours.name in verdict(rows)


def test_a_learned_table_does_not_transfer_and_the_model_in_it_does(stated):
    table, model = measure_learning(stated, 3, (), (1.3,))
    assert table.paths[SECOND] > 10 * table.paths[TUNED]
    assert model.paths[SECOND] < table.paths[SECOND] / 10
