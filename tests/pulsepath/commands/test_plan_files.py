"""`pulsepath plan FILE` of a file of another format: planned as it is, taken up again, refused with
its line.
"""

import json
from importlib.resources import files

import numpy as np
import pytest

from planner.pulses import open_pulses
from pulsepath import FileError, load_machine, load_program

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


@pytest.mark.parametrize("how", ["--whole", "--stream"])
def test_what_drives_need_and_get_is_shown(call, tmp_path, how):
    """At 20 mm/s and 0.75 µm a pulse comes every 37.5 µs: with 15 µs of STEP high, 22.5 µs of it
    low are left.
    """
    machine = (files("kinematics") / "presets" / "hexapod.toml").read_text(encoding="utf-8")
    needs = '{ high = "15 us", low = "20 us", setup = "50 us", hold = "1 us" }'
    (tmp_path / "m.toml").write_text(
        machine.replace("[axes]", f"[axes]\ntiming = {needs}"), encoding="utf-8"
    )
    asked = (
        "plan",
        "bare-circle",
        "--machine",
        tmp_path / "m.toml",
        "--order",
        "2",
        "--no-figures",
        how,
    )
    first = call(*asked, "--out", tmp_path / "one")
    assert first.exit_code == 0, first.stderr
    assert "STEP low of leg1 22.5 us, its drive needs 20; all with -v" in first.stdout
    full = call(*asked, "--out", tmp_path / "two", "-v")
    assert "lines of STEP and DIR" in full.stdout
    assert "22.5 / 20" in full.stdout
    assert "26.6667 / 28.5714" in full.stdout  # 1/37.5 µs, and 1/(15 µs + 20 µs)
    for record in (
        json.loads((tmp_path / "two" / name).read_text())
        for name in ("plan.json", "certificate.json")
    ):
        leg = record.get("pulses", record)["axes"]["leg1"]
        assert leg["lines_s"]["low"] == pytest.approx(22.5e-6)
        assert leg["drive_needs_s"]["setup"] == pytest.approx(50e-6)


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


LINES = [f"G1 X{5.1 + k / 10:.1f} Y{(k % 7) / 10:.1f}" for k in range(18)]
MIDDLE = 11


def write_with(file, bad):
    """A file whose line MIDDLE is bad."""
    head = ["G21 G90 G64 P0.02", "G1 X5 Y0 Z25 F1200"]
    lines = [line.encode() for line in [*head, *LINES]]
    lines[MIDDLE - 1] = bad
    file.write_bytes(b"\n".join(lines) + b"\nM2\n")
    return file


@pytest.mark.parametrize("way", ["--stream", "--whole"])
@pytest.mark.parametrize(
    ("bad", "told"),
    [
        (b"G5 X1", "column 1: G5 is not supported; take it out"), (b"G1 X", 'column 4: "X" is not a word: write'),
        (b"G2 X9 R0.1", "R 0.1 mm is too small: its ends are"), (b"G2 X9 Y1", "needs either its centre I J K or"),
        (b"G1 Xnan", 'column 4: "Xnan" is not a word'), (b"X1" + b"0" * 10**6, "1000002 characters; a line has at"),
        (bytes(range(128, 256)), "not the start of a word; take it out"), (b"X1 (no end", "the comment has no"),
        (b"X1 no start)", 'column 4: "no start)" is not a word'), (b"G90 G91 X1", "G91 and G90 exclude each other"),
        (b"X1 X2", "column 4: X appears twice"), (b"G80 X1", "no G0, G1, G2 or G3 is active"), (b"F0", "F0 must be"),
        (b"X[1/0]", "column 3: 1/0 has no value"), (b"o1 while [1]", "o1 while has no end: write o1 endwhile"),
        (b"G1 X5\0", "column 6"), (b"G64", "G64 needs P"), (b"G4 P-1", "G4 needs P, the dwell time"),
    ],
    ids=lambda value: value[:12].decode("latin1") if isinstance(value, bytes) else "",
)  # fmt: skip
def test_a_bad_line_in_the_middle_is_told_and_nothing_is_left(call, tmp_path, bad, told, way):
    file = write_with(tmp_path / "part.nc", bad)
    done = call("plan", file, "--machine", "hexapod", way, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert f"{file}:{MIDDLE}: " in done.stderr
    assert told in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == [file]


def test_what_cannot_be_reached_in_the_middle_is_told_with_its_line(call, tmp_path, limit_search):
    """All or nothing; by a check as well."""
    limit_search(0.0)
    file, out = write_with(tmp_path / "part.nc", b"G1 Z-300"), tmp_path / "out"
    asked = "--machine", "hexapod"
    for done in (
        call("plan", file, *asked, "--order", "2", "--stream", "--out", out),
        call("check", file, *asked),
    ):
        assert done.exit_code == 1
        assert f"segment {MIDDLE - 1} is in line {MIDDLE} of part.nc" in done.stderr
        assert "is singular, or too close" in done.output
        assert list(tmp_path.iterdir()) == [file]


def test_what_was_proved_before_is_kept_where_that_is_asked_for(call, tmp_path, limit_search):
    """The motion rests where the line that is refused begins."""
    limit_search(0.0)
    file, out = write_with(tmp_path / "part.nc", b"G1 X500"), tmp_path / "out"
    asked = "--machine", "hexapod", "--order", "2", "--no-figures", "--out", out
    done = call("plan", file, *asked, "--stream", "--keep-certified")
    assert done.exit_code == 1
    assert f"segment {MIDDLE - 1} is in line {MIDDLE} of part.nc" in done.stderr
    record = json.loads((out / "plan.json").read_text())
    assert record["certificate"]["holds"]
    assert "travel 370" in record["ends_before"]
    machine, counted = load_machine("hexapod"), np.zeros(6)
    for part in open_pulses(out / "pulses.bin").parts():
        counted += [axis.direction.sum(dtype=np.int64) for axis in part.axes]
    q = machine.home_q + counted * [axis.pulse for axis in machine.axes]
    there = machine.forward(q).pose.translation - machine.home.translation
    np.testing.assert_allclose(
        there * 1e3, [5.8, 0.0, 25.0], atol=0.15
    )  # on the rounding of the corner


def test_the_line_of_a_segment_that_breaks_several_limits_is_told_once(call, tmp_path):
    (tmp_path / "far.toml").write_text(
        'schema = 1\nname = "mine"\nmachine = "hexapod"\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 90] }\n'
    )
    done = call("check", tmp_path / "far.toml", "-v")
    assert done.output.count("beyond 50.8 mm at leg") == 6
    assert done.stderr == "segment 1 is in line 5 of far.toml\n"


@pytest.mark.parametrize(
    ("blend", "told"), [("5 m", "5000 mm, more than the whole path of"), ("0.05 mm", "")]
)
def test_a_tolerance_beyond_the_path_is_told(call, tmp_path, blend, told):
    corner = f'[[segment]]\nline = {{ to = [0, 5, 0] }}\njoin = {{ blend = "{blend}" }}\n'
    head = 'schema = 1\nmachine = "traverser"\nlength = "mm"\n'
    (tmp_path / "p.toml").write_text(f"{head}{corner}[[segment]]\nline = {{ to = [5, 5, 0] }}\n")
    done = call(
        "plan", tmp_path / "p.toml", "--out", tmp_path / "out", "--no-figures", "--pulses", "none"
    )
    assert done.exit_code == 0, done.stderr
    assert told in done.stdout
    assert ("is the unit as meant?" in done.stdout) == bool(told)
