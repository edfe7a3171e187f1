"""The command `export`: the plan in a directory, in another format, whole or not at all."""

import json
import re
from importlib.resources import files
from pathlib import Path
from shutil import copytree
from typing import get_type_hints

import numpy as np
import pytest

import pulsepath as pp
from kinematics.foundation.options import options
from planner.export.format import FORMATS, find_format
from tests import read_lines

FEW = ("--no-figures", "--no-baselines", "--no-worth")
"""What no export reads is left out of plans."""


def test_pulses_are_those_of_the_plan(call, plan, job):
    done = call(
        "export",
        plan,
        "--format",
        "pulses",
        "--width",
        "1 us",
        "--out",
        plan / "mine.csv",
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["error_pulses"] == 0
    machine, pulses = job.plan.machine, job.plan.pulses
    held = read_lines.read(record["file"], pulses.clock_hz, machine.axes, machine.home_q).schedule
    for got, axis in zip(held.axes, pulses.axes, strict=True):
        assert np.array_equal(got.ticks, axis.ticks)
        assert np.array_equal(got.direction, axis.direction)


@pytest.mark.parametrize(
    ("name", "head", "row", "relative", "unit"),
    [
        (
            "zaber",
            "Time (ms),X Position (mm),X Velocity (mm/s),",
            r"[\d.]+,(.*),false",
            False,
            1e-3,
        ),
        ("xps", "0.0", r"[\d.]+, (.*)", True, 1e-3),
        ("pmac", "; ", r"X(.*)", True, 1e-3),
        ("g93", "(pulsepath: ", r"G1 (.*) F.*", False, 1e-3),
        ("ros", 'joint_names: ["leg1", ', r"  - positions: \[(.*)\]", False, 1.0),
    ],
)
def test_points_lead_to_where_the_plan_ends(call, plan, job, name, head, row, relative, unit):
    """The rows of the file, added up where they are moves: from the start to within half a pulse of
    the end.
    """
    done = call("export", plan, "--format", name, "--tolerance", "0.4", "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert 0 < record["error_pulses"] <= 0.4
    assert "the points" in record["against"]
    assert record["notes"][0].startswith("segments: ")
    text = Path(record["file"]).read_bytes().decode()
    assert text.startswith(head)
    assert text.endswith("\n")
    axes, motion = job.plan.machine.axes, job.plan.trajectory
    found = np.array(
        [re.findall(r"-?\d+\.\d+", numbers) for numbers in re.findall(f"(?m)^{row}$", text)], float
    )
    places = found[:, :: found.shape[1] // len(axes)] * unit
    start, end = motion.at(np.array([0.0, motion.duration])).q
    reached = (
        start + places.sum(0)
        if relative
        else places[-1] + (0 if name == "ros" else job.plan.machine.home_q)
    )
    assert abs(reached - end).max() <= 0.5 * axes[0].pulse


def test_the_error_and_what_to_know_are_printed(call, plan):
    done = call("export", plan, "--format", "xps", "--spacing", "20 ms", "--out", plan / "mine.trj")
    assert done.exit_code == 0, done.stderr
    first, *notes = done.stdout.splitlines()
    told = r"cubic between the points \(at most 0\.\d+ µm of an axis\)"
    assert re.fullmatch(rf".*mine\.trj: error 0\.\d+ pulses against the motion, {told}", first)
    assert notes[:2] == [
        "  segments: 64, of 20 ms",
        "  group in the order leg1, leg2, leg3, leg4, leg5, leg6; in mm",
    ]


@pytest.mark.parametrize(
    ("name", "options", "most", "note"),
    [
        ("vcd", [], 0.0, "times in units of 1 ns"),
        (
            "steps",
            ["--within", "10 us", "--named"],
            0.3,
            "a pulse is off by up to 10 us",
        ),  # pulses are 37.5 us apart
        ("halstreamer", ["--period", "2 ms", "--unit", "mm"], 0.5, "a sample lasts 0.002 s"),
        (
            "galil",
            ["--interval", "1"],
            1.0,
            "A = leg1, B = leg2, C = leg3, D = leg4, E = leg5, F = leg6",
        ),
    ],
)
def test_streams_say_how_far_they_are_off(call, plan, name, options, most, note):
    done = call("export", plan, "--format", name, *options, "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert 0 <= record["error_pulses"] <= most
    assert note in record["notes"]
    assert Path(record["file"]).stat().st_size > 1000


@pytest.mark.parametrize(
    ("program", "name", "file"),
    [
        ("circle", "steps", "circle.steps"),
        ("circle", "npz", "circle.npz"),
        ("a/b: 50 %", "zaber", "a_b_50.zaber.csv"),
        ("...", "vcd", "plan.vcd"),
        ("", "binary", "folder.binary.bin"),
    ],
)
def test_a_file_is_named_after_program_and_format(call, corner, tmp_path, program, name, file):
    folder = tmp_path / "folder"
    copytree(corner, folder)
    record = json.loads((folder / "plan.json").read_text())
    (folder / "plan.json").write_text(json.dumps({**record, "program": program}))
    done = call("export", folder, "--format", name, "--unverified", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["file"] == str(folder / file)


def test_pulses_that_are_there_are_read(call, plan, directory):
    """plan: without a file of pulses; directory: with it."""
    for folder, told in ((plan, "generating pulses"), (directory, "reading pulses.bin")):
        done = call(
            "export", folder, "--format", "npz", "--out", plan / f"{folder.name}.npz", "--force"
        )
        assert done.exit_code == 0, done.stderr
        assert told in done.stderr
        assert ("generating" in done.stderr) == (folder == plan)


def test_every_format_says_what_it_is_and_its_options_what_they_are_about(call):
    told = call("export", "--help").stdout
    for name in FORMATS:
        assert (find_format(name).__doc__ or "").splitlines()[0] in told
        assert f"  {name} " in told


def test_the_calls_of_the_motion_cards_leave_the_plans_directory(call, plan, job):
    done = call(
        "export",
        plan,
        "--format",
        "adlink-csv",
        "--spacing",
        "4 ms",
        "--speed-range",
        "100000 1/s",
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert 0.4 < record["error_pulses"] <= 0.51
    *_, last = Path(record["file"]).read_text().splitlines()
    assert float(last.split(",")[0]) < job.plan.trajectory.duration


def test_a_format_of_another_machine_is_refused_by_name(call, plan):
    before = sorted(plan.iterdir())
    for name in ("kmitl-arms", "kmitl-positions", "byte", "sasidhar"):
        done = call("export", plan, "--format", name)
        assert done.exit_code == 2
        assert (
            "machine hexapod" in done.stderr
        )  # as it was planned, not machine.toml, the copy of its file
    assert sorted(plan.iterdir()) == before


def test_an_earlier_file_is_replaced_only_by_force(call, plan):
    target = plan / "mine.csv"
    target.write_text("mine")
    done = call("export", plan, "--format", "pulses", "--out", target)
    assert done.exit_code == 2
    assert "give --force to replace it" in done.stderr
    assert target.read_text() == "mine"
    assert call("export", plan, "--format", "pulses", "--out", target, "--force").exit_code == 0
    assert target.read_text().startswith("Time[s]")


def test_a_file_of_the_plan_itself_is_written_again_but_not_changed(call, plan, edges):
    """Else the next command would refuse the plan."""
    for name in ("plan.json", "motion.bin"):
        (plan / name).write_bytes((edges / name).read_bytes())
    directory = edges
    made = plan / "pulses.csv"
    assert call("export", plan, "--format", "pulses", "--out", made).exit_code == 0
    assert made.read_bytes() == (directory / "pulses.csv").read_bytes()
    for name, given in (
        ("pulses.csv", ["--width", "1 us"]),
        ("plan.json", []),
        ("./motion.bin", []),
    ):
        done = call("export", plan, "--format", "pulses", "--out", plan / name, *given, "--force")
        assert done.exit_code == 2
        assert "is one of the plan's own files" in done.stderr
    for name in ("pulses.csv", "plan.json", "motion.bin"):
        assert (plan / name).read_bytes() == (directory / name).read_bytes()
    made.write_text("mine")
    done = call("export", plan, "--format", "pulses", "--out", made, "--force")
    assert done.exit_code == 2
    assert f"{made} was changed after it was written" in done.stderr
    assert made.read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--format", "pulses", "--width", "1"], "1"),
        (["--format", "pulses", "--width", "1 mm"], "mm"),
        (["--format", "pulses", "--width", "1 s"], "pulse width"),
        (["--format", "xps", "--spacing", "0 s"], "spacing 0 s: must be at least"),
        (
            ["--format", "xps", "--spacing", "10 ms", "--tolerance", "1"],
            "tolerance and spacing exclude each other",
        ),
        (["--format", "g93", "--tolerance", "-1"], "tolerance -1 pulses: must be above 0"),
        (["--format", "pmac", "--spacing", "5 s"], "at most 4.09599975 s"),
        (
            ["--format", "xps", "--letters", "XYZABC"],
            "format xps has no option --letters; its options: --tolerance",
        ),
        (
            ["--format", "g93", "--letters", "XYZABB"],
            "letters XYZABB: G-code needs 6 different ones of XYZABCUVW",
        ),
    ],
)
def test_bad_input_is_told_and_leaves_no_file(call, plan, options, told):
    before = sorted(plan.iterdir())
    done = call("export", plan, *options)
    assert done.exit_code == 2
    assert told in done.stderr
    assert sorted(plan.iterdir()) == before


def test_an_arm_is_exported_with_its_links_from_beside_the_plan(call, tmp_path):
    (tmp_path / "p.toml").write_text(
        'schema = 1\nlength = "mm"\nangle = "deg"\n[[segment]]\nline = { to = [1, 0, 1] }\n'
    )
    assert (
        call(
            "plan", tmp_path / "p.toml", "--machine", "arm", "--out", tmp_path / "o", *FEW
        ).exit_code
        == 0
    )
    done = call("export", tmp_path / "o", "--format", "ros")
    assert done.exit_code == 0, done.stderr


def test_files_name_the_machine_as_it_was_planned(call, plan):
    """Not by the copy of its file in the directory, machine.toml."""
    assert pp.load_plan(plan).machine.name == "hexapod"
    done = call("export", plan, "--format", "adlink")
    assert done.exit_code == 0, done.stderr
    assert (plan / "bare-circle.adlink.c").read_text().startswith('/* "bare-circle" on "hexapod"\n')


def test_triggers_that_a_format_does_not_hold_are_named(call, tmp_path):
    (tmp_path / "p.toml").write_text(
        'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 10] }\ntrigger = { name = "photo", at = 0.5 }\n'
    )
    out = tmp_path / "o"
    made = call(
        "plan",
        tmp_path / "p.toml",
        "--machine",
        "hexapod",
        "--order",
        "2",
        "--out",
        out,
        "--no-figures",
    )
    assert made.exit_code == 0, made.stderr
    for name, held in (("steps", False), ("ros", False), ("g93", True), ("pulses", True)):
        done = call("export", out, "--format", name)
        assert done.exit_code == 0, done.stderr
        assert (
            'WARNING: the file does not hold the program\'s triggers: "photo" at 0.' in done.stdout
        ) != held
        assert ("triggers: 1" in done.stdout) == held


def test_an_error_is_told_in_the_units_of_axes_that_move(call, tmp_path):
    """The slides are off by up to 29 mm between stops, as they do not follow the path.

    R turns by 9 deg, or not.
    """
    text = (
        'schema = 1\nlength = "mm"\nangle = "deg"\n[[segment]]\nline = {{ to = [100, 0, 0]{} }}\n'
    )
    text += "[[segment]]\nline = {{ to = [100, 200, 50] }}\n"
    for turn, known in (("", None), (", rotate = [0, 0, 9]", 9.9e3)):
        (tmp_path / "p.toml").write_text(text.format(turn))
        out = tmp_path / f"o{len(turn)}"
        made = call("plan", tmp_path / "p.toml", "--machine", "traverser", "--out", out, *FEW)
        assert made.exit_code == 0, made.stderr
        done = call("export", out, "--format", "sasidhar")
        assert done.exit_code == 0, done.stderr
        told = dict(
            re.findall(
                r"([\d.e+]+) (µm|m°)",
                done.stdout.partition("at most ")[2].partition(" of an axis")[0],
            )[::1]
        )
        units = {unit: float(number) for number, unit in told.items()}
        assert units["µm"] == pytest.approx(29e3, rel=0.05)
        assert units.get("m°") == (None if known is None else pytest.approx(known))


def test_what_compensates_is_exported_as_its_motors_run(call, tmp_path):
    """The points of a PVT file end where the pulses do: where the screws have been made up for."""
    machine = (files("kinematics") / "presets" / "traverser.toml").read_text()
    (tmp_path / "m.toml").write_text(
        machine.replace("[axes]", '[axes]\ncompensate = ["lead", "backlash"]')
    )
    (tmp_path / "p.toml").write_text(
        'schema = 1\nlength = "mm"\nangle = "deg"\n[[segment]]\nline = { to = [100, 50, 80] }\n'
        '[[segment]]\ndwell = "0.2 s"\n[[segment]]\nline = { to = [90, 50, 80] }\n'
    )
    out = tmp_path / "o"
    made = call(
        "plan", tmp_path / "p.toml", "--machine", tmp_path / "m.toml", "--out", out, "-v", *FEW
    )
    assert made.exit_code == 0, made.stderr
    # 0.002 in of play while the axis rests, at the 0.3 in/s² of the axis
    assert "7.620 7.620" in " ".join(made.stdout.split())  # mm/s², of what is allowed
    record = json.loads((out / "plan.json").read_text())
    x, y, _, r = record["pulses"]["compensations"]
    assert (x["crossings"], y["crossings"], r["crossings"]) == (1, 0, 0)
    assert x["acceleration"] == pytest.approx(0.3 * 25.4e-3, rel=1e-9)
    assert x["max_acceleration"] == pytest.approx(0.3 * 25.4e-3, rel=1e-12)
    assert record["realised"]["mechanics"][0].startswith("X, Y: play 50.8 (made up for")
    done = call("export", out, "--format", "galil")
    assert done.exit_code == 0, done.stderr
    assert "made up for" in done.stdout
    rows = [
        line[3:].split(",")
        for line in (out / "p.galil.dmc").read_text().splitlines()
        if line.startswith("CD ")
    ]
    total = np.array(
        [[int(n.partition("=")[0]) for n in row] for row in rows if "=" not in row[-1]]
    ).sum(axis=0)
    axes = json.loads((out / "plan.json").read_text())["pulses"]["axes"].values()
    assert total.tolist() == [axis["net_count"] for axis in axes]
    refused = call("export", out, "--format", "sasidhar")
    assert refused.exit_code == 2
    assert "axis X compensates lead and backlash" in refused.stderr


def test_an_option_of_several_formats_is_the_same_kind_of_value_in_each():
    kinds = {}
    for name in FORMATS:
        format_ = find_format(name)
        hints = get_type_hints(format_)
        for key, field in options(format_).items():
            kinds.setdefault(key, set()).add(
                (str(hints[key]).replace(" | None", ""), field.metadata["unit"])
            )
    assert {key: found for key, found in kinds.items() if len(found) > 1} == {}


@pytest.mark.parametrize(
    ("name", "taken"),
    [
        ("linuxcnc", "halstreamer"),
        ("EtherCAT", "csp"),
        ("klipper", "steps --named"),
        ("grbl", "g93"),
    ],
)
def test_a_controllers_name_tells_the_format_that_it_takes(call, plan, name, taken):
    done = call("export", plan, "--format", name)
    assert done.exit_code == 2
    assert f'no format is called "{name}"; for that, give --format {taken}' in done.stderr
    assert taken.split()[0] in FORMATS


def test_a_format_names_itself_and_the_size_of_its_own_option(call, plan, tmp_path):
    assert 'write e.g. "1 ms"' in call("export", plan, "--format", "csp", "--cycle", "2").stderr
