"""Files that users really get wrong, through the real command line: what each must be told, all of
it in one pass.

The files are in tests/corpus, and what must be said of each in expected.toml there: every fault
with its line, in the order of the lines, and nothing else.
"""

import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from kinematics import FileError, load_actuators, load_machine, load_measurements
from planner import load_program
from pulsepath.cli import main

CORPUS = Path(__file__).parents[1] / "corpus"
EXPECTED = tomllib.loads((CORPUS / "expected.toml").read_text(encoding="utf-8"))
COMMANDS = {
    "machines": ["plan", "bare-circle", "--machine", "FILE", "--out", "out"],
    "urdf": ["plan", "arm-line", "--machine", "FILE", "--out", "out"],
    "programs": ["plan", "FILE", "--out", "out"],
    "equations": ["plan", "FILE", "--out", "out"],
    "rigs": ["compare", "FILE", "--out", "out"],
    "measurements": ["calibrate", "hexapod", "FILE", "--out", "out"],
    "gcode": ["import", "FILE", "--out", "out.toml"],
    "positions": ["import", "FILE", "--out", "out.toml"],
    "drawings": ["import", "FILE", "--out", "out.toml"],
}
PROGRESS = ("note:", "planning ", "reading ", "identifying ", "writing ", "running ")


def command(file):
    return [file if part == "FILE" else part for part in COMMANDS[file.split("/")[0]]]


def refused(args):
    """What was said, line by line, by a command that must refuse its input and leave nothing
    behind.
    """
    before = sorted(Path().iterdir())
    result = CliRunner().invoke(main, args)
    assert result.exit_code == 2, result.stderr
    assert result.stdout == ""
    assert "Traceback" not in result.stderr
    assert sorted(Path().iterdir()) == before
    return [line for line in result.stderr.splitlines() if not line.startswith(PROGRESS)]


@pytest.fixture
def corpus(tmp_path, monkeypatch):
    """A folder of one's own, in which the corpus is where its own table says."""
    monkeypatch.chdir(tmp_path)
    for area in COMMANDS:
        (tmp_path / area).symlink_to(CORPUS / area)
    return tmp_path


def test_the_table_tells_of_every_file():
    companions = {"urdf/arm.urdf", "urdf/broken.urdf", "urdf/not_a_robot.urdf"}
    there = {
        f"{path.parent.name}/{path.name}" for area in COMMANDS for path in (CORPUS / area).iterdir()
    }
    assert there - companions == set(EXPECTED["file"])
    assert len(there) >= 40


@pytest.mark.parametrize("file", sorted(EXPECTED["file"]))
def test_every_fault_is_told_with_its_line_and_nothing_is_written(corpus, file):
    said = refused(command(file))
    wanted = EXPECTED["file"][file]
    assert len(said) == len(wanted)
    for line, told in zip(said, wanted, strict=True):
        assert line.startswith(f"{file}:{told}"), line
    lines = [int(line.removeprefix(f"{file}:").split(":")[0]) for line in said]
    assert lines == sorted(lines)


@pytest.mark.parametrize("case", EXPECTED["option"], ids=lambda case: " ".join(case["args"])[:60])
def test_a_bad_option_names_what_may_stand_there(corpus, case):
    said = " ".join(refused(case["args"]))
    for told in case["says"]:
        assert told in said


@pytest.mark.parametrize("file", ["machines/many.toml", "gcode/words.ngc"])
def test_the_same_from_a_process_of_its_own(corpus, file):
    run = [sys.executable, "-m", "pulsepath", *command(file)]
    environment = {**os.environ, "PYTHONPATH": str(CORPUS.parents[1]), "PYTHONIOENCODING": "utf-8"}
    result = subprocess.run(
        run, capture_output=True, encoding="utf-8", env=environment, check=False
    )
    assert (result.returncode, result.stdout) == (2, "")
    assert all(f"{file}:{told}" in result.stderr for told in EXPECTED["file"][file])
    assert "Traceback" not in result.stderr
    assert not Path("out").exists()
    assert not Path("out.toml").exists()


def test_a_check_says_the_same(corpus):
    assert refused(["check", "programs/many.toml"]) == refused(command("programs/many.toml"))


def test_the_same_as_data(corpus):
    result = CliRunner().invoke(main, [*command("machines/many.toml"), "--json"])
    assert result.exit_code == 2
    told = json.loads(result.stdout)["error"]
    assert (told["exit_code"], told["kind"]) == (2, "file")
    faults = {fault["key"]: fault for fault in told["faults"]}
    assert faults["axes.max_jerk"] == {
        "file": "machines/many.toml",
        "line": 18,
        "key": "axes.max_jerk",
        "value": '"-4 m/s^3"',
        "allowed": "above 0 mm/s^3",
        "nearest": None,
        "message": '"-4 m/s^3", which is -4000 mm/s^3, must be above 0 mm/s^3',
    }
    assert faults["geometry.base_gapp"]["nearest"] == "base_gap"
    assert "machines/many.toml:18" in result.stderr


def test_a_fault_has_its_parts_as_fields():
    with pytest.raises(FileError) as refusal:
        load_machine(CORPUS / "machines/many.toml")
    faults = {fault.key: fault for fault in refusal.value.faults}
    assert refusal.value.file == str(CORPUS / "machines/many.toml")
    assert faults["geometry.base_gapp"].nearest == "base_gap"
    assert (faults["axes.travel"].line, faults["axes.travel"].value) == (14, ("50.8 mm", "0 mm"))
    assert (faults["axes.pulse"].value, faults["axes.pulse"].allowed) == ("0 um", "above 0 mm")
    assert faults["axis[1].name"].nearest == "leg6"
    assert faults["geometry.base_gap"].value is None


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (
            "columns.csv",
            [
                ":3: stroke_mm: ",
                '"fifty"',
                ":4: 2 cells for 3 columns",
                ':5: stroke_mm: "-5 mm" must be above 0 mm',
            ],
        ),
        ("header.csv", [':2: stroke: "50.8": a number without a unit']),
        ("empty.csv", [":1: ", "empty"]),
    ],
)
def test_a_catalogue(name, says):
    with pytest.raises(FileError) as refusal:
        load_actuators(CORPUS / "catalogues" / name)
    assert all(told in str(refusal.value) for told in says)


LOADERS = {"machine": load_machine, "program": load_program, "measurement": load_measurements}


@pytest.mark.parametrize("load", LOADERS.values(), ids=LOADERS)
def test_a_directory_nothing_and_too_much(tmp_path, load):
    with pytest.raises(
        FileError, match=r"Is a directory|Permission denied"
    ):  # as Linux and Windows have it
        load(tmp_path)
    (tmp_path / "mine.toml").write_text("schema = 1")
    with pytest.raises(FileError, match=r'No such file or directory, nearest is "mine\.toml"'):
        load(tmp_path / "mien.toml")
    with pytest.raises(FileError, match="there is no folder"):
        load(tmp_path / "nowhere" / "mine.toml")
    with (tmp_path / "huge.toml").open("wb") as huge:
        huge.truncate((16 << 20) + 1)
    with pytest.raises(FileError, match="larger than 16 MB"):
        load(tmp_path / "huge.toml")


@pytest.mark.skipif(
    not Path("/proc/self/mem").exists(),
    reason="a file that no one can read, root neither, is Linux's",
)
@pytest.mark.parametrize("load", LOADERS.values(), ids=LOADERS)
def test_an_unreadable_file(load):
    with pytest.raises(FileError, match="/proc/self/mem: Input/output error"):
        load(Path("/proc/self/mem"))
