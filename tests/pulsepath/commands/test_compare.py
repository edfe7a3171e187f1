"""`pulsepath compare`: what it writes, what it refuses, and how it ends."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reports.page import Picture
from benchmarks.sweep import VARIATIONS, Grid, described, load_runs, read_setting, sweep
from benchmarks.sweep.result import DIGESTS, SEAL, Store
from controllers import load_rig
from controllers.metrics import FIGURES
from pulsepath.commands.compare import _make_pace, _time_command


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A sweep of two settings on the line of the thesis' rig, on two rigs."""
    folder = tmp_path_factory.mktemp("compare") / "runs"
    settings = (read_setting("6:gain=0.7"), read_setting("6r:gain=0.7"))
    sweep(Grid(settings, ("line",), VARIATIONS[:3]), load_rig("servo-rig"), folder)
    return folder


@pytest.fixture(autouse=True)
def undrawn(monkeypatch):
    """Figures have tests of their own."""
    monkeypatch.setattr(
        "benchmarks.reports.gain.gain_report.draw", lambda *_: {"time": Picture(b"none")}
    )


def test_saved_runs_are_compared_and_the_condition_decides_the_exit(tmp_path, runs, call):
    out = tmp_path / "out"
    done = call("compare", "--from", runs, "--out", out, "--fail-if", "contour_rms > 1.1x")
    assert (done.exit_code, done.stderr.count("failed:")) == (0, 0), done.stderr
    assert {path.name for path in out.iterdir()} == {"report.html", "runs.csv", "compare.json"}
    record = json.loads((out / "compare.json").read_text())
    assert record["kind"] == "pulsepath compare"
    assert record["verdict"]["best"]["law"] == "closed-position-repaired"
    assert record["verdict"]["text"] in " ".join(done.stdout.split())
    ratio = record["verdict"]["ratio"]
    assert 0.1 < ratio < 0.9
    for factor, code in ((0.9 * ratio, 1), (1.1 * ratio, 0)):
        again = call(
            "compare",
            "--from",
            runs,
            "--out",
            out,
            "--force",
            "--fail-if",
            f"contour_rms > {factor:.4f}x",
        )
        assert again.exit_code == code
        assert ("failed: contour_rms" in again.stderr) == bool(code)


def test_quiet_prints_the_path_alone_and_failures(tmp_path, runs, call):
    out = tmp_path / "out"
    done = call("compare", "-q", "--from", runs, "--out", out)
    assert (done.exit_code, done.stdout, done.stderr) == (0, f"{out / 'report.html'}\n", "")
    failed = call(
        "compare", "-q", "--from", runs, "--out", out, "--force", "--fail-if", "contour_rms < 1x"
    )
    assert (failed.exit_code, failed.stdout) == (1, f"{out / 'report.html'}\n")
    assert failed.stderr.startswith("failed: contour_rms < 1x")


def test_a_mistaken_condition_is_told_before_the_folder(tmp_path, runs, call):
    out = tmp_path / "out"
    assert call("compare", "--from", runs, "--out", out).exit_code == 0
    done = call("compare", "--from", runs, "--out", out, "--fail-if", "contour_rms > 10")
    assert done.exit_code == 2
    assert "needs a unit" in done.stderr
    assert "--force" not in done.stderr
    assert len(done.stderr) < 300
    assert "holds a comparison" in call("compare", "--from", runs, "--out", out).stderr


def test_figures_that_a_condition_may_name_are_listed(call):
    told = json.loads(call("figures", "--json").stdout)
    assert [one["name"] for one in told] == [figure.name for figure in FIGURES]


def test_runs_say_what_drives_they_are_of():
    for name, kind, encoder in (
        ("hexapod-steppers", "stepper", False),
        ("servo-rig", "servo", True),
    ):
        rig = load_rig(name)
        grid = Grid((read_setting("3"),), ())
        assert set(map(str, described(grid, rig)["drives"].values())) == {
            str({"kind": kind, "encoder": encoder})
        }


def test_the_rig_is_run_once_and_its_runs_stay(tmp_path, runs, call, monkeypatch):
    arguments = (
        "compare",
        "servo-rig",
        "--law",
        "6r:gain=0.7",
        "--law",
        "6:gain=0.7",
        "--task",
        "line",
        "--json",
    )
    out = tmp_path / "out"
    done = call(*arguments, "--out", out)
    assert done.exit_code == 0, done.stderr
    assert "closed-position-repaired" in json.loads(done.stdout)["verdict"]
    assert len(list((out / "cells").iterdir())) == 10
    assert call(*arguments, "--out", out).exit_code == 2  # without --force

    def never(*_):
        raise AssertionError("ran again")

    monkeypatch.setattr("benchmarks.sweep.run.score", never)
    assert call(*arguments, "--out", out, "--force").exit_code == 0
    # an interrupted comparison goes on without --force
    for name in ("compare.json", "report.html", "runs.csv"):
        (out / name).unlink()
    assert call(*arguments, "--out", out).exit_code == 0


def test_what_is_going_to_run_and_for_how_long_is_told_first(tmp_path, call, monkeypatch):
    def never(*_, **__):
        raise NotImplementedError

    monkeypatch.setattr("benchmarks.sweep.sweep", never)
    monkeypatch.setattr("planner.parallel.cores", lambda: 2)
    counts = {}
    for more in ((), ("--seeds", "2", "--task", "line")):
        done = call("compare", *more, "--out", tmp_path / "out")
        said = done.stderr.splitlines()[0]
        runs, *factors = map(int, re.findall(r"\d+", said.partition(")")[0]))
        counts[more] = runs
        assert more or runs == np.prod(factors)
        assert re.search(r": about \d+ (s|min) on 2 idle cores(; |$)", said)
    # the seed changes the runs of law 2 alone, on the rig as stated and four others
    assert counts["--seeds", "2", "--task", "line"] == counts[()] / 5 + 5
    assert "× up to 2 seeds)" in said
    assert said.endswith("; 190 more would equal one of these and are not run")


def test_a_law_that_solves_a_problem_for_each_run_takes_its_time():
    """An estimate without it is several times too short."""
    rig = load_rig("servo-rig")
    task = rig.task("sine")
    assert _time_command(read_setting("6"), rig, task) == 0
    # OSQP takes a tenth of a millisecond at least
    assert _time_command(read_setting("mpc"), rig, task) > 1e-4


def test_the_time_left_is_told_by_the_runs_own_pace():
    now = iter([100.0, 103.0, 110.0, 130.0, 400.0])
    describe = _make_pace(lambda: next(now))
    assert describe(25, 100) == "25 of 100"  # saved ones tell nothing
    assert describe(25, 100) == "25 of 100"
    assert describe(50, 100) == "50 of 100, about 20 s left"
    assert describe(85, 100) == "85 of 100, about 8 s left"
    assert describe(100, 100) == "100 of 100"
    slow = _make_pace(iter([0.0, 60.0]).__next__)
    assert [slow(0, 10), slow(1, 10)] == ["0 of 10", "1 of 10, about 9 min left"]


def worsen(source, folder, factor, setting):
    """The same runs, but for the errors of a setting, which are larger by a factor."""
    worse, keys = Store(folder), []
    for key, one in source.results.items():
        hit = one.cell.setting == read_setting(setting)
        figures = {name: value * (factor if hit else 1.0) for name, value in one.figures.items()}
        series = source.series(key)
        worse.keep(
            key,
            replace(
                one, figures={**one.figures, "contour_rms": figures["contour_rms"]}, series=series
            ),
        )
        keys.append(key)
    worse.record(
        {
            name: value
            for name, value in source.record.items()
            if name not in ("cells", SEAL, DIGESTS)
        },
        keys,
    )
    return folder


def test_each_setting_is_guarded_by_its_own_saved_runs(tmp_path, runs, call):
    """Though the best setting stays as it was."""
    worse = worsen(load_runs(runs), tmp_path / "worse", 1.2, "6:gain=0.7")
    asked = ("--against", runs, "--fail-if", "contour_rms > 1.1x", "--out")
    done = call("compare", "--from", worse, *asked, tmp_path / "out", "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 1
    assert len(told["failed"]) == 1
    assert "closed-position gain 0.7 on line: contour_rms 1.2 times the saved" in told["failed"][0]
    ratios = {row["law"]: row["ratio"] for row in told["against_saved"]}
    assert ratios == pytest.approx({"closed-position": 1.2, "closed-position-repaired": 1.0})
    assert (
        json.loads((tmp_path / "out" / "compare.json").read_text())["against_saved"]
        == told["against_saved"]
    )
    assert "Against saved runs" in (tmp_path / "out" / "report.html").read_text()
    # the same two the other way round are better, and runs against themselves are as they were
    done = call("compare", "--from", runs, "--against", worse, *asked[2:], tmp_path / "better")
    assert done.exit_code == 0, done.stderr
    done = call("compare", "--from", runs, *asked, tmp_path / "same")
    assert (done.exit_code, "contour_rms 1 times the saved" in done.stdout) == (0, True)


def test_the_settings_and_tasks_of_saved_runs_are_run_again(tmp_path, runs, call, monkeypatch):
    def never(*_, **__):
        raise NotImplementedError

    monkeypatch.setattr("benchmarks.sweep.sweep", never)
    done = call("compare", "--against", runs, "--out", tmp_path / "out")
    assert done.stderr.startswith("10 runs (2 settings × 5 variations of the rig)")


def test_a_baseline_alone_is_as_good_as_itself(tmp_path, runs, call):
    alone = tmp_path / "alone"
    one = (read_setting("6:gain=0.7"),)
    sweep(Grid(one, ("line",), VARIATIONS[:2]), load_rig("servo-rig"), alone)
    for condition, code in (("contour_rms > 1.1x", 0), ("contour_rms > 0.9x", 1)):
        done = call(
            "compare", "--from", alone, "--fail-if", condition, "--out", tmp_path / f"out{code}"
        )
        assert done.exit_code == code, done.stderr
    told = " ".join(done.stdout.split())
    assert (
        "closed-position gain 0.7 is stable in all of 2 runs. RMS contour error on the rig as stated: "
        in told
    )
    assert "Not run: feedforward, predictive." in told
    assert "pulsepath compare servo-rig --law closed-position:gain=0.7 --law ff --law mpc" in told


def test_what_is_no_comparison_is_not_touched(tmp_path, runs, call):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    done = call("compare", "--from", runs, "--out", tmp_path / "mine", "--force")
    assert done.exit_code == 2
    assert "holds no saved runs" in done.stderr
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["servo-rig", "--from", "."], "with --from nothing is run"),
        (["--from", "nowhere"], "holds no saved runs"),
        (["servo-rigg"], 'no rig is called "servo-rigg"'),
        (["--law", "8"], 'no law is called "8"'),
        (["--against", "nowhere"], "holds no saved runs"),
        (["--task", "lines"], 'no task "lines"'),
        (["--fail-if", "contour_rms"], "is not understood"),
        (["--fail-if", "contur_rms > 1x"], "no figure contur_rms; the nearest are contour_rms, "),
        (["--fail-if", "contour_rms > 10"], 'contour_rms needs a unit, as "10 um"'),
        (["--fail-if", "contour_rms > 1 s"], "contour_rms > 1 s"),
        (["--baseline", "3t"], "baseline 3t is not among"),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(tmp_path, call, arguments, reason):
    done = call("compare", *arguments, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert reason in done.stderr
    assert not (tmp_path / "out").exists()
