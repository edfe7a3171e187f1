"""`plan --cross-check`: toppra's motion beside ours in every place where a plan is
describe_error.
"""

import json
import sys

from planner.timing.order2 import toppra_
from pulsepath.process.exits import describe_error


def test_both_motions_are_in_the_record_the_report_and_the_terminal(call, tmp_path):
    out = tmp_path / "plan"
    done = call(
        "plan",
        "bare-circle",
        "--order",
        "2",
        "--no-figures",
        "--cross-check",
        "--out",
        out,
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    record = json.loads((out / "plan.json").read_text())
    found = record["cross_check"]
    assert json.loads(done.stdout)["cross_check"] == found
    assert found["pulsepath"]["duration_s"] == record["duration_s"]
    assert found["toppra"]["certified"] is True
    assert abs(found["difference"]) < 1e-5
    assert found["toppra"]["worst_ratios"].keys() == record["certificate"]["limits"].keys()
    assert record["provenance"]["versions"]["toppra"]
    page = (out / "report.html").read_text()
    assert "Cross-check by toppra" in page
    assert f"{found['toppra']['duration_s']:.6f}" in page


def test_without_it_nothing_is_said_of_toppra(directory):
    assert json.loads((directory / "plan.json").read_text())["cross_check"] is None
    assert "toppra" not in (directory / "report.html").read_text()


def test_it_is_refused_before_the_work_where_toppra_is_not_there(call, tmp_path, monkeypatch):
    # to see the refusal instead of skipping
    monkeypatch.setattr("pulsepath.command_group.describe_error", describe_error)
    monkeypatch.setitem(sys.modules, "toppra.algorithm", None)
    toppra_._toppra.cache_clear()
    done = call("plan", "bare-circle", "--cross-check", "--out", tmp_path / "plan")
    toppra_._toppra.cache_clear()
    assert done.exit_code == 2
    assert "--cross-check needs toppra" in done.stderr
    assert not (tmp_path / "plan").exists()


def test_the_command_that_is_dumped_asks_for_it_again(call, tmp_path):
    done = call("plan", "bare-circle", "--cross-check", "--dump-config", tmp_path, "--json")
    assert " --cross-check --out " in json.loads(done.stdout)["command"]
