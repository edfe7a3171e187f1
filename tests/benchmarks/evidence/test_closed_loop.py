"""A small version of the evaluation of closed loops."""

import numpy as np

from benchmarks.evidence.cases.closed_loop import cut_batches, evaluate_batch, simulate_batch


def test_every_run_of_every_batch_has_its_figures():
    """Three runs in batches of two: the contour error is at most the tracking error."""
    batches = cut_batches([0.1, 0.5, 0.9], 2)
    figures = [run for batch in batches for run in evaluate_batch(batch, simulate_batch(batch))]
    assert len(figures) == 3
    assert all(np.isfinite(run["contour_rms"]) and run["contour_rms"] <= run["tracking_rms"] for run in figures)
