"""A part of the crowd of the full run (benchmarks.evidence.trials.console), of another seed; and that faults
are found."""

from benchmarks.evidence.trials.console import run_crowd
from controllers.console import serve


def test_lines_that_come_mid_move_wait_and_stop_drops_them():
    found = run_crowd(2000, seed=2)
    assert found.faults == ()
    # enough of each kind that the run means something
    assert found.midway > 1000
    assert found.done > 100
    assert found.stopped > 50


def test_a_queue_that_is_longer_is_found(monkeypatch):
    monkeypatch.setattr(serve, "WAITING", 4)
    assert run_crowd(300, seed=3).faults
