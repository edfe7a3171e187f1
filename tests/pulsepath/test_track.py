"""The command `track`: the errors of the plan that is in a directory, and no other."""

import json

import pytest

from controllers import evaluate, find_law, track


def test_it_is_the_motion_that_was_planned(call, plan, job):
    done = call("track", plan, "--law", "3", "--json")
    assert done.exit_code == 0
    record = json.loads(done.stdout)
    assert record == json.loads((plan / "track.json").read_text())
    machine = job.plan.machine
    expected = evaluate(track(job.plan, machine, find_law("3")), job.plan, machine)
    for series in expected.series:
        found = record["laws"][expected.law][series.name]
        assert (found["rms"], found["p95"], found["max"]) == (series.rms, series.p95, series.max)


def test_it_prints_a_table_per_law(call, plan):
    done = call("track", plan, "--law", "open-position", "--law", "6")
    assert done.exit_code == 0
    laws = json.loads((plan / "track.json").read_text())["laws"]
    assert len(laws) == 2
    for law, errors in laws.items():
        text = done.stdout[done.stdout.index(law) :]
        (row,) = [line.split() for line in text.splitlines() if line.startswith(" contour")][:1]
        assert [float(cell) for cell in row[1:4]] == pytest.approx(
            [1e6 * errors["contour"][name] for name in ("rms", "p95", "max")], abs=5e-4
        )


def test_gains_are_given_as_compare_tells_them(call, plan):
    done = call("track", plan, "--law", "closed-position:gain=0.5", "--json")
    assert done.exit_code == 0
    assert list(json.loads(done.stdout)["laws"]) == [find_law("6", gain=0.5).name]


def test_an_earlier_result_is_replaced_only_by_force(call, plan):
    (plan / "track.json").write_text("mine")
    done = call("track", plan, "--law", "3")
    assert done.exit_code == 2
    assert (plan / "track.json").read_text() == "mine"
    assert call("track", plan, "--law", "3", "--force").exit_code == 0
    assert "open-position" in json.loads((plan / "track.json").read_text())["laws"]


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("plan.json", "{}", "holds no plan"),
        ("machine.toml", "# touched", "machine.toml was changed after it was written"),
        ("program.toml", "# touched", "program.toml was changed after it was written"),
        ("motion.json", '{"knots": [0, 1]}', "motion.json"),
        (
            "motion.json",
            '{"knots": [0, 1], "s": [0], "v": [0], "a": [0], "j": [NaN], "piece": [0]}',
            "do not make a motion",
        ),
        (
            "motion.json",
            '{"knots": [0, 1], "s": [0], "v": [0], "a": [0], "j": [0], "piece": [1]}',
            "belongs to another path",
        ),
    ],
)
def test_a_damaged_plan_is_refused(call, plan, name, text, told):
    (plan / name).write_text(text)
    done = call("track", plan, "--law", "3", *(["--unverified"] if name == "motion.json" else []))
    assert done.exit_code == 2
    assert told in done.stderr
    assert not (plan / "track.json").exists()


def test_other_bad_calls(call, plan, tmp_path):
    for arguments, told in [
        ([plan, "--law", "9"], "law '9' is not known"),
        ([tmp_path / "none", "--law", "3"], "holds no plan"),
    ]:
        done = call("track", *arguments)
        assert done.exit_code == 2
        assert told in done.stderr
