"""`pulsepath plan FILE` of a file of another format: planned as it is, taken up again, refused with its line."""

import json

import pytest

from pulsepath import FileError, load_program

PART = """\
G21 G90 G64 P0.02
G1 X2 Y0 Z25 F1200
G1 X2.3 Y0.02
G1 X2.6 Y0.08
G1 X2.88 Y0.19
G1 X3.13 Y0.34
G1 X3.35 Y0.52
G1 X3 Y2
M2
"""


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    file = tmp_path_factory.mktemp("files") / "part.nc"
    file.write_text(PART)
    return file


def test_a_file_is_planned_and_taken_up_again(call, part):
    out = part.parent / "plan"
    asked = "--machine", "hexapod", "--order", "2", "--no-figures", "--rapid", "50 mm/s", "--json"
    done = call("plan", part, *asked, "--out", out)
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["certificate"]["holds"]
    assert record["inputs"] == {
        "program": "program.nc",
        "format": "gcode",
        "suffix": ".nc",
        "options": {"rapid": 0.05},
        "fit_m": None,
    }
    fit = record["fit"]
    assert 0 < fit["deviation_m"] <= fit["tolerance_m"] == 2e-5
    assert fit["corners_rounded"] + fit["corners_stopped"] == 2
    assert fit["pieces_before"] == 5
    assert (out / "program.nc").read_text() == PART
    export = call("export", out, "--format", "steps", "--out", part.parent / "part.npz", "--json")
    assert export.exit_code == 0, export.stderr
    page = (out / "report.html").read_text()
    assert "5 pieces became" in page


def test_its_faults_stand_with_their_lines_and_nothing_is_written(call, part):
    bad = part.parent / "bad.nc"
    bad.write_text(PART.replace("X2.88 Y0.19", "X2.88 Q0.19"))
    done = call("plan", bad, "--machine", "hexapod", "--out", part.parent / "none")
    assert done.exit_code == 2
    assert f"{bad}:5: column 10: Q0.19 is not supported" in done.stderr
    assert not (part.parent / "none").exists()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--feed", "1 mm/s"), "part.nc names no machine: give --machine"),
        (("--machine", "hexapod", "--columns", "2"), "No such option '--columns'"),
        (("--machine", "hexapod", "--retract", "2 mm"), "format gcode has no option --retract"),
    ],
)
def test_what_does_not_fit_is_refused(call, part, more, told):
    done = call("check", part, *more)
    assert done.exit_code == 2
    assert told in done.stderr


def test_a_program_is_fitted_where_that_is_asked_for(call, part):
    """Whatever its joins say; and options of formats are told from its own."""
    program = part.parent / "part.toml"
    assert call("import", part, "--out", program, "--join", "stop").exit_code == 0
    done = call("check", program, "--machine", "hexapod", "--fit", "0.05 mm", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["fit"]["tolerance_m"] == 5e-5
    assert call("check", program, "--machine", "hexapod", "--rapid", "1 mm/s").exit_code == 2


def test_who_loads_it_as_a_program_is_told_what_to_do(part):
    with pytest.raises(FileError, match="by its suffix it is gcode: plan it with pulsepath plan"):
        load_program(part)
