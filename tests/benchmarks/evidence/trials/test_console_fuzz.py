"""A tenth of the random bytes of the full run (benchmarks.evidence.trials.console), of another seed; and that
faults are found."""

from benchmarks.evidence.trials.console import fuzz
from controllers.console import links


def test_random_bytes_move_nothing_that_was_not_asked_for():
    found = fuzz(10_000, seed=2)
    assert found.faults == ()
    # enough of either kind that the run means something
    assert found.motions > 3000
    assert found.refused > 10_000


def test_a_console_that_passes_over_noise_is_found(monkeypatch):
    monkeypatch.setattr(links, "_read", lambda held: links.TextLine(held.decode("ascii", "ignore")))
    assert fuzz(200, seed=3).faults
