"""Parts of the full runs (benchmarks.evidence.trials.console), of other seeds; and that faults are found."""

from benchmarks.evidence.trials.console import fuzz, run_crowd
from controllers.console import links, serve


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


def test_random_bytes_move_nothing_that_was_not_asked_for():
    found = fuzz(10_000, seed=2)
    assert found.faults == ()
    # enough of either kind that the run means something
    assert found.motions > 3000
    assert found.refused > 10_000


def test_a_console_that_passes_over_noise_is_found(monkeypatch):
    monkeypatch.setattr(links, "_read", lambda held: links.TextLine(held.decode("ascii", "ignore")))
    assert fuzz(200, seed=3).faults
