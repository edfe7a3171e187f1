"""`plan --worth` and `--no-baselines`: what is left out is said, with how to get it, and the rest
is as it was.
"""

import json
import subprocess
import sys

import numpy as np
import pytest

import pulsepath.job
from pulsepath import load_plan

ASKED = (
    "plan",
    "bare-circle",
    "--order",
    "2",
    "--no-figures",
    "--no-baselines",
    "--pulses",
    "none",
)


@pytest.fixture
def few(monkeypatch):
    """Nearly every motion has too many time pieces."""
    monkeypatch.setattr(pulsepath.job, "MOST_BOUNDED", 10)


def test_a_long_motion_says_that_worth_is_left_out_and_how_to_get_it(few, call, tmp_path):
    done = call(*ASKED, "--out", tmp_path / "plan")
    (line,) = (line for line in done.stdout.splitlines() if "lower bound, worth" in line)
    assert "not worked out" in line
    assert "--worth" in done.stdout
    record = json.loads((tmp_path / "plan/plan.json").read_text())
    assert record["worth"] is None
    assert "(more than 10 are left out)" in record["worth_left_out"]
    assert record["worth_left_out"] in (tmp_path / "plan/report.html").read_text()
    forced = call(*ASKED, "--worth", "--out", tmp_path / "forced")
    assert "% above the proved least of" in forced.stdout
    assert "limits 1 % higher" in forced.stdout
    record = json.loads((tmp_path / "forced/plan.json").read_text())
    assert record["worth_left_out"] is None
    # proved: the bound lies below the motion, and near it
    assert 0 <= record["lower_bound"]["gap"] < 0.01
    assert record["lower_bound"]["duration_s"] <= record["duration_s"]


def test_what_nobody_wants_is_not_missed(few, call, tmp_path):
    done = call(*ASKED, "--no-worth", "--out", tmp_path / "plan", "-v")
    assert "lower bound, worth" not in done.stdout
    record = json.loads((tmp_path / "plan/plan.json").read_text())
    assert record["worth"] is record["worth_left_out"] is None
    assert "baseline timing" not in done.stdout + done.stderr
    assert "time saved" not in done.stdout
    assert record["classical"] is None
    page = (tmp_path / "plan/report.html").read_text()
    assert "aseline timing" not in page
    assert "nan" not in page.split("</style>")[-1]


def test_a_loaded_plan_knows_what_limits_are_worth(directory, job):
    loaded = load_plan(directory)
    assert loaded.worth.best == job.results.worth.best
    np.testing.assert_allclose(loaded.worth.saved, job.results.worth.saved, rtol=1e-9, atol=1e-12)
    assert loaded.bound.value == job.plan.bound.value


def test_a_report_without_figures_does_not_load_what_draws(tmp_path):
    code = (
        "import sys\nfrom click.testing import CliRunner\nfrom pulsepath.cli import main\n"
        f"done = CliRunner().invoke(main, [*{ASKED!r}, '--bound', 'none', '--out', {str(tmp_path / 'plan')!r}])\n"
        "print(done.exit_code, 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0", "False"]


def test_few_stops_instead_of_blends_are_told_with_place_and_reason(call, tmp_path):
    (tmp_path / "p.toml").write_text(
        'schema = 1\nlength = "mm"\n'
        "[[segment]]\nline = { to = [5, 0, 20] }\njoin = { blend = 0.1 }\n"
        "[[segment]]\nline = { to = [5, 5, 20] }\njoin = { blend = 0.1 }\n"
        "[[segment]]\nline = { to = [5, 0, 20] }\n"
    )
    done = call("check", tmp_path / "p.toml", "--machine", "hexapod")
    told = " ".join(done.stdout.split())
    assert "blends: 2, 1 of them replaced by stops (after segment 2: " in told
    assert "turns back" in told
