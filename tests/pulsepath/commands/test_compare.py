"""`pulsepath compare`: what it writes, what it refuses, and how it ends."""

import json
import re

import numpy as np
import pytest

from benchmarks.reports.page import Drawing
from benchmarks.sweep import VARIATIONS, Grid, read_setting, sweep
from controllers import load_rig


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
    monkeypatch.setattr("benchmarks.reports.gain.gain_report.draw", lambda *_: {"time": Drawing(b"none")})


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
        again = call("compare", "--from", runs, "--out", out, "--force", "--fail-if", f"contour_rms > {factor:.4f}x")
        assert again.exit_code == code
        assert ("failed: contour_rms" in again.stderr) == bool(code)


def test_the_rig_is_run_once_and_its_runs_stay(tmp_path, runs, call, monkeypatch):
    arguments = ("compare", "servo-rig", "--law", "6r:gain=0.7", "--law", "6:gain=0.7", "--task", "line", "--json")
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
        assert runs == np.prod(factors)
        seconds = int(re.search(r"about (\d+) s on 2 cores", said)[1])
        assert 20 <= seconds <= (70 if not more else 30)
    assert counts["--seeds", "2", "--task", "line"] == 2 * counts[()] / 5


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
        (["--task", "lines"], 'no task "lines"'),
        (["--fail-if", "contour_rms"], "is not understood"),
        (["--fail-if", "contur_rms > 1x"], "no figure contur_rms"),
        (["--fail-if", "contour_rms > 1 s"], "contour_rms > 1 s"),
        (["--baseline", "3t"], "baseline 3t is not among"),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(tmp_path, call, arguments, reason):
    done = call("compare", *arguments, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert reason in done.stderr
    assert not (tmp_path / "out").exists()
