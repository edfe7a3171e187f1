"""The command `calibrate`: what it writes and prints, and how bad calls end."""

import json
import re
from importlib.resources import files

import numpy as np
import pytest

from kinematics import calibrate, load_machine, whole_poses
from pulsepath.output.calibration_directory import write
from tests.browser import act_in, needs_browser
from tests.kinematics.calibration.drawn_hexapod import NOISE, add_noise, draw, draw_commands

FILES = {
    "calibration.json",
    "figures",
    "machine.toml",
    "measurements.toml",
    "nominal.toml",
    "report.html",
}


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A machine with errors, and the file of 12 noisy whole poses of it."""
    random = np.random.default_rng(0)
    machine, commanded = draw(load_machine("hexapod"), random), draw_commands(random, 12)
    measured = add_noise(machine.poses(commanded), random)
    lines = [
        f'[noise]\nposition = "{1e6 * NOISE.position!r} um"\nrotation = "{1e6 * NOISE.rotation!r} urad"'
    ]
    for k in range(12):
        lines.append("[[pose]]")
        for key, pose in (("commanded", commanded[k]), ("measured", measured[k])):
            angles = pose.rotation.as_euler("XYZ", degrees=True).tolist()
            lines.append(f"{key} = {[*(1e3 * pose.translation).tolist(), *angles]}")
    path = tmp_path_factory.mktemp("measured") / "twelve.toml"
    path.write_text("\n".join(lines))
    return machine, path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    from click.testing import CliRunner

    from pulsepath.cli import main

    out = tmp_path_factory.mktemp("calibrated") / "o"
    done = CliRunner().invoke(main, ["calibrate", "hexapod", "cmm", "--out", str(out), "--json"])
    assert done.exit_code == 0
    assert json.loads(done.stdout) == {
        **json.loads((out / "calibration.json").read_text()),
        "report": str(out / "report.html"),
    }
    return out


def test_the_published_case_from_end_to_end(folder):
    assert {path.name for path in folder.iterdir()} == FILES
    record = json.loads((folder / "calibration.json").read_text())
    rms = record["rms"]["position"]
    assert rms["before"] == pytest.approx(183e-6, abs=0.5e-6)
    assert rms["after"] <= 14e-6
    assert rms["left_out"] <= 17e-6
    assert len(record["parameters"]) == 5
    assert record["rms"]["axis"]["left_out"] is None
    assert [check["explained"] for check in record["checks"]] == [False]
    (pulse,) = record["pulses"]
    assert pulse["step"]["length"] == pytest.approx(0.762e-6)
    machine, nominal = load_machine(folder / "machine.toml"), load_machine("hexapod")
    assert {axis.pulse for axis in machine.axes} == {pulse["value"]}
    np.testing.assert_array_equal(machine.base, nominal.base)


@needs_browser
def test_on_a_phone_nothing_is_cut_off(folder, tmp_path):
    """No figure and no table is wider than its box, so that nothing has to be scrolled sideways."""
    script = """onload = () => {
      const cut = [...document.querySelectorAll(".scroll")].filter(box => box.scrollWidth > box.clientWidth + 1);
      const seen = [matchMedia("(max-width: 34rem)").matches, document.querySelectorAll(".scroll").length,
        ...cut.map(box => box.textContent.trim().slice(0, 40) || box.querySelector("img").alt)];
      fetch("/said", { method: "POST", body: JSON.stringify(seen) });
    }"""
    page = tmp_path / "report.html"
    text = (folder / "report.html").read_text(encoding="utf-8")
    page.write_text(
        text.replace("default-src 'none'", "default-src 'none'; script-src 'unsafe-inline'"),
        encoding="utf-8",
    )
    seen, _ = act_in(tmp_path, page, script, "500,844")
    narrow, boxes, *cut = seen
    assert narrow
    assert boxes >= 8
    assert not cut


def test_the_report_says_what_was_found_and_loads_nothing(folder):
    text = (folder / "report.html").read_text()
    page = re.sub(r"base64,[\w+/=]+", "", text)
    assert not re.search(r"https?:|//\w|@import|url\(", page)
    assert not re.search(r"<(script|link|iframe|object|base)\b", page)
    # directions of the z axis were not fitted, so there is no such error of theirs
    _, position, axis = [
        of.partition("</thead>")[0] for of in page.split("<caption>Errors of the ")
    ]
    stages = re.compile(r'colspan="\d" class="n">([\w-]+)</th>')
    assert stages.findall(position) == ["before", "after", "leave-one-out"]
    assert stages.findall(axis) == ["before", "after"]
    assert 'class="n">axis u</th>' in axis
    assert text.count("<img src=") == len(list((folder / "figures").iterdir())) == 3
    for told in (
        "183.1 → 13.3 µm",
        "15.8 µm",
        "0.762 µm (half step",
        "1.78 % more",
        "is not explained",
        "Nahvi",
    ):
        assert told in page
    # the machine's place on this disk is nobody's business
    assert str(folder.parent) not in page + (folder / "machine.toml").read_text()


def test_a_whole_calibration_is_read_back(call, tmp_path, drawn):
    machine, path = drawn
    done = call(
        "calibrate", "hexapod", path, "--model", "factors, offsets,joints", "--out", tmp_path / "o"
    )
    assert done.exit_code == 0
    assert "48 of 48 combinations" in done.stdout
    assert f"machine: {tmp_path / 'o' / 'machine.toml'}" in done.stdout
    found = load_machine(tmp_path / "o" / "machine.toml")
    # 72 values for 48 parameters in a small range: joints to a part of their errors, and lengths to
    # what is printed
    assert np.abs(found.base - machine.built.base).max() < 2e-3
    sent = np.array([axis.pulse for axis in found.axes]) / 0.75e-6
    np.testing.assert_allclose(sent, machine.factors, atol=5e-3)
    checked = call("check", "bare-circle", "--machine", tmp_path / "o" / "machine.toml")
    assert checked.exit_code == 0


def test_an_earlier_calibration_is_replaced_only_on_demand(call, tmp_path, folder):
    out = tmp_path / "o"
    assert call("calibrate", "hexapod", "cmm", "--out", out).exit_code == 0
    before = (out / "calibration.json").read_bytes()
    refused = call("calibrate", "hexapod", "cmm", "--model", "factor,frame", "--out", out)
    assert refused.exit_code == 2
    assert "--force" in refused.stderr
    assert (out / "calibration.json").read_bytes() == before
    assert (
        call(
            "calibrate", "hexapod", "cmm", "--model", "factor,frame", "--out", out, "--force"
        ).exit_code
        == 0
    )
    assert json.loads((out / "calibration.json").read_text())["model"] == ["factor", "frame"]
    # a plan is not a calibration, nor the other way round
    foreign = call("plan", "bare-circle", "--out", out, "--force")
    assert foreign.exit_code == 2
    assert "was not written by pulsepath plan" in foreign.stderr


BAD = {
    "one pose for 48 parameters": (
        ["--model", "factors,offsets,joints"],
        "3 values of 1 pose for 48 parameters",
    ),
    "unknown part": (["--model", "factr"], 'nearest is "factor"'),
    "empty": (["--model", ""], "not part of a calibration model"),
}


@pytest.mark.parametrize(("options", "told"), BAD.values(), ids=BAD)
def test_bad_calls_write_nothing(call, tmp_path, options, told):
    path = tmp_path / "one.toml"
    path.write_text("[[pose]]\ndesired = [0, 0, 10, 90, 90, 0]\nerror = [0, 0, 0, 0, 0, 0]\n")
    done = call("calibrate", "hexapod", path, "--out", tmp_path / "o", *options)
    assert done.exit_code == 2
    assert done.stdout == ""
    assert told in done.stderr
    assert [entry.name for entry in tmp_path.iterdir()] == ["one.toml"]


def test_bad_files_are_told_with_their_lines(call, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text("[[pose]]\ndesired = [nan, 0, 10, 90, 90, 0]\nerror = [0, 0, 0, 0, 0]\n")
    done = call("calibrate", "hexapod", path, "--out", tmp_path / "o")
    assert done.exit_code == 2
    assert "bad.toml:2: pose[1].desired[1]" in done.stderr
    assert "bad.toml:3: pose[1].error" in done.stderr


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("count", "parts"), [(2, ("factors", "offsets")), (10, ("joints", "frame"))]
)
def test_what_leaves_nothing_to_say_is_reported_too(tmp_path, count, parts):
    """No error at all and no degree of freedom; and combinations that the data do not show."""
    used = draw_commands(np.random.default_rng(0), count)
    found = calibrate(load_machine("hexapod"), whole_poses(used, used), parts)
    write(tmp_path, found, {"machine": b"", "measurements": b""})
    record = json.loads((tmp_path / "calibration.json").read_text())
    page = (tmp_path / "report.html").read_text()
    if count == 2:
        assert record["residual_scale"] is None
        assert {one["standard_error"] for one in record["parameters"]} == {None}
        assert "no values to spare" in page
    else:
        assert len(record["observability"]["unseen"]) == 6
        assert "affect no measured pose" in page
        assert "not identifiable" in page


def test_what_the_machine_cannot_be_sent_to_is_bad_input(call, tmp_path):
    """m instead of mm; and poses that the machine holds, of which a check is only left out."""
    path = tmp_path / "metres.toml"
    path.write_text(
        'length = "m"\n' + "[[pose]]\ncommanded = [1, 2, 10, 0, 0, 0]\nmeasured = [1, 2, 10]\n" * 3
    )
    far = call("calibrate", "hexapod", path, "--out", tmp_path / "o")
    assert far.exit_code == 2
    for number, line in ((1, 2), (2, 5), (3, 8)):
        assert f"metres.toml:{line}: pose {number}: leg1 would stand" in far.stderr
    held = call("calibrate", "linkage", "cmm", "--other-machine", "--out", tmp_path / "o")
    assert held.exit_code == 2
    assert "pose 1 (6.2): machine linkage holds z" in held.stderr
    assert not (tmp_path / "o").exists()
    assert (
        call("calibrate", "tripod", "cmm", "--other-machine", "--out", tmp_path / "o").exit_code
        == 0
    )
    (skipped,) = json.loads((tmp_path / "o" / "calibration.json").read_text())["skipped_checks"]
    assert skipped.startswith("rotation 1 (6.4): machine tripod holds ry")
    assert skipped in (tmp_path / "o" / "report.html").read_text()


def test_a_model_that_does_not_explain_the_data_is_told(tmp_path, drawn, call):
    """The machine drawn has errors of its joints, which a common factor does not explain."""
    _, path = drawn
    out = tmp_path / "out"
    done = call("calibrate", "hexapod", path, "--model", "factor", "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    (warning,) = record["warnings"]
    assert f"the residuals are {record['residual_scale']:.2g} times the stated noise" in warning
    assert "the model does not explain the data: " in (out / "report.html").read_text()
    done = call("calibrate", "hexapod", path, "--model", "factor", "--out", tmp_path / "text")
    assert "warning: the model does not explain the data: " in " ".join(done.stdout.split())
    # of a machine that is as its file says, with noise as stated, there is nothing to say
    machine, random = load_machine("hexapod"), np.random.default_rng(1)
    commanded = draw_commands(random, 12)
    measured = add_noise(commanded, random)
    assert (
        calibrate(machine, whole_poses(commanded, measured, noise=NOISE), ("factor",)).warnings
        == ()
    )


def test_one_cause_at_every_pose_is_told_once(tmp_path, drawn, call):
    _, path = drawn
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('length = "m"\n' + path.read_text())
    done = call("calibrate", "hexapod", wrong, "--out", tmp_path / "out", "--json")
    assert done.exit_code == 2
    lines = done.stderr.strip().splitlines()
    assert sum("travel is 0 mm to 50.8 mm" in line for line in lines) == 1
    assert "(and 11 more like it, the last in line " in lines[-1]
    assert len(json.loads(done.stdout)["error"]["faults"]) == 12


@pytest.mark.parametrize(
    "name", ["tripod", "hexapod-initial", "hexapod-rotary", "cartesian", "linkage"]
)
def test_measurements_of_another_machine_are_refused(call, tmp_path, name):
    refused = call("calibrate", name, "cmm", "--out", tmp_path / "o")
    assert refused.exit_code == 2
    assert f'cmm.toml was measured on the machine "hexapod", and this is "{name}"' in refused.stderr
    assert "--other-machine" in refused.stderr
    assert not (tmp_path / "o").exists()


def test_a_file_states_its_machine_or_fits_any(call, tmp_path):
    """A calibrated machine may be calibrated again; a file of another name asks for the option."""
    poses = "".join(
        f"[[pose]]\ncommanded = [{x}, {y}, 10, 0, 0, 0]\nmeasured = [{x}, {y}, 10.01, 0, 0, 0]\n"
        for x, y in ((0, 0), (5, 0), (0, 5), (-5, 2))
    )
    machine = (files("kinematics") / "presets" / "hexapod.toml").read_text(encoding="utf-8")
    for name in ("hexapod", "hexapod-calibrated", "mine"):
        (tmp_path / f"{name}.toml").write_text(machine)
    (tmp_path / "any.toml").write_text(poses)
    (tmp_path / "own.toml").write_text('machine = "hexapod"\n' + poses)
    for name, measured, options, code in (
        ("mine", "any", (), 0), ("hexapod", "own", (), 0), ("hexapod-calibrated", "own", (), 0), ("mine", "own", (), 2),
        ("mine", "own", ("--other-machine",), 0),
    ):  # fmt: skip
        files_of = (tmp_path / f"{name}.toml", tmp_path / f"{measured}.toml")
        done = call("calibrate", *files_of, "--out", tmp_path / "o", "--force", *options)
        assert done.exit_code == code, done.stderr
