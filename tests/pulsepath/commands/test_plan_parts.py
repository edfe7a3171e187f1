"""`plan --stream`: a program planned part by part, its folder taken up by the other commands, ended or whole."""

import json
import re

import numpy as np
import pytest

from benchmarks.evidence.speed.workpieces import spiral
from kinematics import load_machine
from planner.certificate.certify import certify
from planner.export.motion_file import follow_motion, join_parts, motion_parts, read_motion
from planner.path.actuation import actuate
from planner.path.chain import walk_path
from planner.plan_parts import MOST_WHOLE
from planner.sources.source import import_program
from pulsepath import load_plan
from pulsepath.commands import plan as command

LINES = 400
FAR = "G1 X500 Y0"


def code(*more):
    return "\n".join([*spiral(LINES), *more, ""])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("parts")


@pytest.fixture(scope="module")
def planned(call, folder):
    file = folder / "spiral.nc"
    file.write_text(code())
    done = call("plan", file, "--machine", "hexapod", "--stream", "--out", folder / "plan", "--json")
    assert done.exit_code == 0, done.stderr
    return json.loads(done.stdout)


def test_the_record_says_what_was_proved(planned):
    assert planned["windows"] >= 1
    assert planned["ends_before"] is None
    assert planned["certificate"]["holds"]
    assert all(limit["worst_ratio"] <= 1 for limit in planned["certificate"]["limits"].values())
    assert planned["fit"]["deviation_m"] <= 2e-5
    assert planned["pulses"]["check"]["holds"]


def test_other_commands_take_it_up(call, folder, planned):
    for name in ("steps", "binary", "ros"):
        done = call("export", folder / "plan", "--format", name, "--out", folder / f"f.{name}", "--json")
        assert done.exit_code == 0, done.stderr
        assert json.loads(done.stdout)["error_pulses"] < 1
    checked = call("check", folder / "plan", "--json")
    assert checked.exit_code == 0, checked.stderr
    told = json.loads(checked.stdout)
    assert (told["duration_s"], told["pulses"]) == (planned["duration_s"], planned["pulses"]["total"])
    taken = load_plan(folder / "plan")
    assert taken.trajectory.duration == planned["duration_s"]
    assert taken.pulses().total == planned["pulses"]["total"]


def test_the_page_shows_it_and_loads_nothing(folder, planned):
    text = (folder / "plan" / "report.html").read_text()
    assert not re.search(r"https?:|//\w|@import|url\(", re.sub(r"base64,[\w+/=]+", "", text))
    assert text.count("data:image/png;base64,") == 3
    assert f"{planned['duration_s']:.6f} s" in text


def test_each_part_is_proved_by_itself_on_its_own_path(folder, planned):
    hexapod = load_machine("hexapod")
    taken, file = load_plan(folder / "plan"), folder / "plan" / "motion.bin"
    program = import_program(folder / "spiral.nc").program
    parts = list(follow_motion(file, walk_path(program, hexapod), hexapod, None))
    assert len(parts) == planned["windows"]
    for part in parts:
        assert certify(part, taken.find_limits(part)).holds
    whole = read_motion(file, actuate(program, hexapod))
    begin = 0.0
    for part, held in zip(parts, join_parts(motion_parts(file)), strict=True):
        assert held.head.begin == begin
        t = np.linspace(0, part.duration, 50)[1:-1]
        np.testing.assert_allclose(part.at(t).q, whole.at(begin + t).q, atol=1e-10)
        begin += part.duration


def test_a_program_that_goes_out_of_reach_gives_nothing(call, folder):
    file = folder / "far.nc"
    file.write_text(code(FAR))
    done = call("plan", file, "--machine", "hexapod", "--stream", "--order", "2", "--out", folder / "far")
    assert done.exit_code == 1
    assert f"segment {LINES + 2};" in done.stderr
    assert f"segment {LINES + 2} is in line {LINES + 3} of far.nc" in done.stderr
    assert not (folder / "far").exists()


def test_or_what_was_certified_before_it(call, folder):
    file = folder / "long.nc"
    file.write_text("\n".join([*spiral(3 * LINES), FAR, ""]))
    more = ("--stream", "--keep-certified", "--order", "2", "--no-figures")
    done = call("plan", file, "--machine", "hexapod", *more, "--out", folder / "kept")
    assert done.exit_code == 1
    record = json.loads((folder / "kept" / "plan.json").read_text())
    assert "mm is beyond" in record["ends_before"]
    assert "It ends before the program does" in (folder / "kept" / "report.html").read_text()
    checked = call("check", folder / "kept", "--json")
    assert checked.exit_code == 0, checked.stderr
    assert json.loads(checked.stdout)["duration_s"] == record["duration_s"] > 5
    motion = load_plan(folder / "kept").trajectory
    assert np.abs(motion.at(motion.duration).qd).max() < 1e-9


def test_what_needs_the_whole_is_refused_with_the_remedy(call, folder):
    for more, told in ((("--cross-check",), "--cross-check"), (("--duration", "20 s"), "--duration")):
        done = call("plan", "circle", "--stream", *more, "--out", folder / "none")
        assert done.exit_code == 2, done.stderr
        assert told in done.stderr
    done = call("plan", "free-yaw", "--machine", "tripod", "--stream", "--out", folder / "none")
    assert "give --whole" in done.stderr
    assert call("plan", "circle", "--keep-certified", "--out", folder / "none").exit_code == 2


def test_long_programs_are_streamed_unless_told_otherwise():
    assert command.MOST_WHOLE == MOST_WHOLE
