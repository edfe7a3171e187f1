"""`--dump-config`: what is worked on, as files that give the same again."""

import json
import shlex
import tomllib

import numpy as np
import pytest

from kinematics import load_machine, machine_names
from kinematics.kinds.axis_keys import LinearAxis
from planner import load_program, program_names
from planner.path.actuation import actuate
from pulsepath.inputs import read_inputs


@pytest.mark.parametrize("machine", machine_names())
def test_the_machine_is_the_same(call, tmp_path, machine):
    if machine == "arm":
        pytest.importorskip("pinocchio")
    assert (
        call("check", "bare-circle", "--machine", machine, "--dump-config", tmp_path).exit_code == 0
    )
    made, known = load_machine(tmp_path / "machine.toml"), load_machine(machine)
    assert made.axes == known.axes
    assert made.freedom == known.freedom
    # joints about a tool come back to rounding
    assert made.home_q == pytest.approx(known.home_q, rel=1e-14)
    if machine != "arm":  # whose file stays as it is
        tables = tomllib.loads((tmp_path / "machine.toml").read_text())
        axes = tables["axes" if "axes" in tables else "rotary"]
        assert (
            {"friction", "reflected", "backlash", "pushed", "compensate", "direction"}
            <= axes.keys()
            <= LinearAxis.model_fields.keys()
        )


@pytest.mark.parametrize("program", program_names())
def test_the_path_is_the_same(call, tmp_path, program):
    inputs = read_inputs(program, None)
    done = call("plan", program, "--dump-config", tmp_path, "--json")
    assert done.exit_code == 0
    again = read_inputs(str(tmp_path / "program.toml"), None)
    known, made = actuate(inputs.program, inputs.machine), actuate(again.program, again.machine)
    # turns are held as matrices, lengths in files as millimetres
    np.testing.assert_allclose(made.breaks, known.breaks, rtol=0, atol=1e-12)
    piece = np.arange(len(made.breaks) - 1)
    middle = (known.breaks[:-1] + known.breaks[1:]) / 2
    for one, other in zip(
        made.derivatives(middle, piece), known.derivatives(middle, piece), strict=True
    ):
        np.testing.assert_allclose(
            one, other, rtol=1e-9, atol=1e-9 * max(1.0, float(np.abs(other).max()))
        )
    text = (tmp_path / "program.toml").read_text()
    assert tomllib.loads(text)["repeat"] == 1
    assert 'join = "stop"' in text or program == "blended"


def test_the_options_as_they_come_out(call, tmp_path):
    done = call(
        "plan",
        "bare-circle",
        "--machine",
        "traverser",
        "--rule",
        "floor",
        "--dump-config",
        tmp_path / "d",
    )
    assert done.exit_code == 0
    assert tomllib.loads(done.stdout)["options"] == {
        "order": 2,
        "clock-hz": 10_000_000,
        "objective": "time",
        "rule": "floor",
        "pulses": "binary",
    }
    given = ["--duration", "9 s", "--pulses", "csv"]
    told = json.loads(
        call("plan", "circle", *given, "--dump-config", tmp_path / "e", "--json").stdout
    )
    expected = {
        "order": 3,
        "clock-hz": 10_000_000,
        "duration": "9 s",
        "objective": "time",
        "rule": "nearest",
        "pulses": "csv",
    }
    assert told["options"] == expected
    assert {path.name for path in (tmp_path / "e").iterdir()} == {"machine.toml", "program.toml"}
    # given back, it is the same again
    name, *again = shlex.split(told["command"])
    assert name == "pulsepath"
    once_more = call(*again[: again.index("--out")], "--dump-config", tmp_path / "f", "--json")
    assert json.loads(once_more.stdout)["options"] == told["options"]
    for file in ("machine.toml", "program.toml"):
        first, second = ((tmp_path / folder / file).read_text().splitlines()[1:] for folder in "ef")
        assert first == second


def test_all_of_it_on_stdout(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = call("plan", "circle", "--dump-config", "-")
    assert done.exit_code == 0
    assert list(tmp_path.iterdir()) == []
    _, machine, program, options = done.stdout.split("# ----- ")
    assert call("plan", "circle", "--dump-config", "d").exit_code == 0
    for name, text in (("machine.toml", machine), ("program.toml", program)):
        assert text == f"{name}\n{(tmp_path / 'd' / name).read_text()}\n"
    assert tomllib.loads(options.partition("\n")[2])["options"]["order"] == 3
    told = json.loads(call("check", "circle", "--dump-config", "-", "--json").stdout)
    assert tomllib.loads(told["files"]["program.toml"])["machine"] == "machine.toml"


def test_nothing_is_replaced(call, tmp_path):
    (tmp_path / "machine.toml").write_text("mine")
    done = call("plan", "circle", "--dump-config", tmp_path)
    assert done.exit_code == 2
    assert "--force" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["machine.toml"]


def test_a_program_is_a_program(call, tmp_path):
    call("check", "circle", "--dump-config", tmp_path)
    assert len(load_program(tmp_path / "program.toml").segments) == 9
