"""A comparison and its report, which the tests of reports share, and reports without figures."""

import pytest

from benchmarks.reports.gain import compare
from benchmarks.reports.gain.gain_report import gain_report
from tests.benchmarks.reports.gain.saved_runs import saved


@pytest.fixture(scope="session")
def runs(tmp_path_factory):
    """Saved runs of six settings on two paths; not to be changed."""
    return saved(tmp_path_factory.mktemp("saved") / "runs")


@pytest.fixture(scope="session")
def comparison(runs):
    return compare([runs])


@pytest.fixture(scope="session")
def page(comparison):
    """The report of that comparison, with all its figures."""
    return gain_report(comparison)[1]


@pytest.fixture
def undrawn(monkeypatch):
    """Leave the figures out: drawing them takes nine tenths of writing a report."""
    monkeypatch.setattr("benchmarks.reports.gain.gain_report.draw", lambda *_: {})
