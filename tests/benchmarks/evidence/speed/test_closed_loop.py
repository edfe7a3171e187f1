"""A small version of the timing of figures."""

import numpy as np

from benchmarks.evidence.speed.closed_loop import time_metrics


def test_every_run_of_every_part_has_its_figures():
    """Three runs in parts of two: the figures of a run do not depend on its part, and take time."""
    figures, clock, processor = time_metrics([0.1, 0.5, 0.9], size=2)
    assert len(figures) == 3
    assert all(np.isfinite(run["contour_rms"]) and run["contour_rms"] <= run["tracking_rms"] for run in figures)
    assert clock > 0
    assert processor > 0
