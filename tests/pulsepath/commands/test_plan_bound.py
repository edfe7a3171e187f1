"""`plan --bound` and `--baselines`: by default they cost little, and what is left out is said with
its option.
"""

import json
from itertools import pairwise
from time import process_time

import numpy as np
import pytest

from planner import plan
from planner.baselines.classical import course
from planner.bounds import bound_duration
from planner.bounds.duration_bound import LEAST_SHARED_CELLS
from planner.bounds.spans import split_run
from pulsepath.job import find_affordable_cells, time_like_baseline

ASKED = ("plan", "bare-circle", "--no-figures", "--pulses", "none")


def run_plan(call, folder, *more):
    done = call(*ASKED, *more, "--out", folder, "--force")
    assert done.exit_code == 0, done.stderr
    return " ".join(done.stdout.split()), json.loads((folder / "plan.json").read_text())


@pytest.fixture(scope="module")
def usual(call, tmp_path_factory):
    """What the command prints and writes by default."""
    folder = tmp_path_factory.mktemp("usual") / "plan"
    return *run_plan(call, folder), folder


def test_by_default_the_bound_is_quick_and_what_is_left_out_is_said(usual, inputs):
    printed, quick, folder = usual
    bound = quick["lower_bound"]
    assert bound["kind"] == "proved"
    assert 0 < quick["duration_s"] - bound["duration_s"] < 0.02 * quick["duration_s"]
    assert any("--bound full" in told for told in quick["left_out"])
    assert any("--worth" in told for told in quick["left_out"])
    assert quick["worth"]["planned_again"] is None
    left_out = ", ".join(quick["left_out"])
    assert f"left out {left_out}" in printed
    assert left_out in (folder / "report.html").read_text()
    # the same each time: cells are counted, not timed
    again = plan(inputs.program, inputs.machine)
    cells = find_affordable_cells(again)
    proved = bound_duration(again.trajectory, again.limits, again.order, most_cells=cells)
    assert proved.value == bound["duration_s"]


def test_the_full_bound_is_nearer_and_misses_nothing(usual, call, tmp_path):
    _, quick, _ = usual
    printed, full = run_plan(call, tmp_path / "full", "--no-baselines", "--bound", "full")
    assert full["lower_bound"]["gap"] < quick["lower_bound"]["gap"] / 2
    assert full["left_out"] == []
    assert "left out" not in printed
    assert full["worth"]["planned_again"] is not None


def test_without_a_bound_there_is_none_and_nobody_misses_it(call, tmp_path):
    printed, record = run_plan(call, tmp_path / "plan", "--bound", "none", "--no-baselines")
    assert record["lower_bound"]["kind"] == "estimate"
    assert record["worth"] is record["worth_left_out"] is None
    assert record["left_out"] == []
    assert "above the proved least" not in printed


@pytest.mark.parametrize("more", [("--gap", "1 %"), ("--worth",)])
def test_what_needs_a_bound_is_refused_without_one(call, tmp_path, more):
    done = call(*ASKED, "--bound", "none", *more, "--out", tmp_path / "plan")
    assert done.exit_code == 2
    assert f"{more[0]} needs a lower bound" in done.stderr
    assert not (tmp_path / "plan").exists()


def test_a_bound_without_worth(call, tmp_path):
    _, record = run_plan(call, tmp_path / "plan", "--bound", "auto", "--no-worth", "--no-baselines")
    assert record["lower_bound"]["kind"] == "proved"
    assert record["worth"] is None


def test_a_motion_of_many_runs_says_that_it_has_no_bound_and_how_to_get_it(call, tmp_path):
    file = tmp_path / "part.nc"
    file.write_text(
        "G21 G90 F6000\n"
        + "".join(f"G1 X{(k + 1) // 2} Y{k // 2}\n" for k in range(1, 61))
        + "M2\n"
    )
    asked = (
        "plan",
        file,
        "--machine",
        "cartesian",
        "--no-figures",
        "--pulses",
        "none",
        "--no-baselines",
    )
    printed = " ".join(call(*asked, "--out", tmp_path / "plan").stdout.split())
    record = json.loads((tmp_path / "plan/plan.json").read_text())
    assert record["lower_bound"]["kind"] == "estimate"
    assert "60 runs between stops would take longer than planning" in record["worth_left_out"]
    assert "--bound full" in printed
    stops = record["avoidable_stops"]
    assert stops["count"] == 59
    assert 0 < stops["cost_s"] < record["duration_s"]
    assert f"{stops['count']} avoidable, of {stops['joins']} joins: passing them within" in printed
    assert stops["remedy"] in printed
    page = (tmp_path / "plan/report.html").read_text()
    assert "Avoidable stops" in page.split('id="summary"')[0]  # on the first screen


def test_one_baseline_is_timed_by_default_and_every_one_if_asked_for(usual, call, tmp_path):
    _, one, _ = usual
    assert [*one["classical"]["kinds"]] == ["s-curve"]
    assert one["classical"]["leaves_out"] == []
    assert any("--baselines" in told for told in one["left_out"])
    _, every = run_plan(call, tmp_path / "every", "--baselines", "--bound", "none")
    assert {"s-curve", "trapezoid", "quarter-sine"} <= {*every["classical"]["kinds"]}
    assert every["classical"]["duration_s"] == one["classical"]["duration_s"]


def test_at_order_2_the_baseline_is_a_trapezoid(inputs):
    own = course(inputs.program, inputs.machine, 2)
    (timing,) = time_like_baseline(own, 2).timings
    assert timing.kind == "trapezoid"
    (timing,) = time_like_baseline(own, 3).timings
    assert timing.kind == "s-curve"


@pytest.mark.parametrize("order", [2, 3])
def test_a_quick_bound_holds_and_takes_about_as_long_as_planning(order):
    made = plan("circle", "hexapod", order=order)
    cells = find_affordable_cells(made)
    begin = process_time()
    plan("circle", "hexapod", order=order)
    planning = process_time() - begin
    bound_duration(
        made.trajectory, made.limits, order, most_cells=cells
    )  # with what is compiled and kept
    begin = process_time()
    quick = bound_duration(made.trajectory, made.limits, order, most_cells=cells)
    assert process_time() - begin < 2 * planning  # 0.8 times as a rule
    # cruises at the capped speed have a cell for each time piece, which costs next to nothing
    stops = np.flatnonzero(made.path.stops(order)).tolist()
    spans = [
        span for ends in pairwise(stops) for span in split_run(made.trajectory, made.limits, ends)
    ]
    cruising = sum(len(span.pieces) for span in spans if span.cruising)
    assert len(quick.s) - cruising <= cells + LEAST_SHARED_CELLS * len(spans)
    # the machine takes so long at least, and the fine bound is a bound too
    assert 0.97 * made.duration < quick.value < made.duration
