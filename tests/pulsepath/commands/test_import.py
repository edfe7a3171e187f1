"""The command `import`: a program from another format, whole or not at all, and what is said of
it.
"""

import json
import struct
from typing import get_type_hints

import pytest

from kinematics.foundation.options import options
from planner import load_program
from planner.sources.source import SOURCES, find_source

FLAT = "G21 G64 P0.05\nG0 X10\nF600 G2 X10 I-10\nG1 X0 Y0\nM30\n"


@pytest.fixture
def part(tmp_path):
    path = tmp_path / "part.nc"
    path.write_text(FLAT)
    return path


def test_the_program_is_written_drawn_and_told(call, part, tmp_path):
    out = tmp_path / "program.toml"
    image = tmp_path / "program.png"
    done = call("import", part, "--out", out, "--figure", image, "--json")
    assert done.exit_code == 0, done.stderr
    record = json.loads(done.stdout)
    assert record["figure"] == str(image)
    assert record["entities"] == {"G0": 1, "G1": 1, "G2": 1}
    assert record["length"] == pytest.approx(0.02 + 0.02 * 3.141592653589793)
    assert record["low"] == pytest.approx([-0.01, -0.01, 0])
    assert record["high"] == pytest.approx([0.01, 0.01, 0])
    assert len(load_program(out).segments) == record["segments"] == 3
    content = image.read_bytes()
    assert content.startswith(b"\x89PNG")
    assert struct.unpack(">II", content[16:24])[0] > 500

    image.unlink()
    text = call("import", part, "--out", out, "--force").stdout
    assert not image.exists()
    assert "drawn" not in text
    assert "entities: 1 G0, 1 G1, 1 G2" in text
    assert "extents: x -10 to 10 mm, y -10 to 10 mm, z 0 to 0 mm" in text
    assert "length: 82.83185 mm" in text


def test_options_belong_to_formats(call, part, tmp_path):
    done = call(
        "import",
        part,
        "--out",
        tmp_path / "p.toml",
        "--join",
        "stop",
        "--rapid",
        "2 m/min",
        "--json",
    )
    assert done.exit_code == 0, done.stderr
    assert load_program(tmp_path / "p.toml").segments[0].speed == pytest.approx(2 / 60)
    help_text = " ".join(call("import", "--help").stdout.split())
    for name in SOURCES:
        kind = find_source(name)
        assert kind.__doc__.splitlines()[0].split()[0] in help_text
        assert options(kind).keys() <= get_type_hints(kind).keys()
        assert kind.suffixes
        assert all(suffix.startswith(".") for suffix in kind.suffixes)
        for option in options(kind):
            assert f"--{option.replace('_', '-')}" in help_text


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (FLAT + "G5 X1", ["--format", "gcod"], 'nearest is "gcode"'),
        ("G0 X1\nG5 X2\n", [], "part.nc:2: column 1: G5 is not supported"),
        (FLAT, ["--figure", "part.txt"], "a figure is one of .png, .svg, .pdf"),
        (FLAT, ["--blend", "3"], "a number without a unit"),
        (FLAT, ["--blend", "-3 mm"], "must be positive"),
        (FLAT, ["--length", "furlong"], 'option --length: "furlong" is none of mm, in'),
    ],
)
def test_bad_input_leaves_nothing(call, part, tmp_path, text, options, words):
    part.write_text(text)
    done = call("import", part, "--out", tmp_path / "p.toml", *options)
    assert done.exit_code == 2, done.stdout
    assert words in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["part.nc"]


def test_spindle_words_are_warned_of_and_with_strict_refused(call, part, tmp_path):
    """When a file is imported, and when it is planned or checked as it is."""
    part.write_text("G21 M3 S900\nG1 Z3 F600\nM5\n")
    done = call("import", part, "--out", tmp_path / "p.toml")
    assert done.exit_code == 0, done.stderr
    assert "warning: marked by triggers: M3 (1x: line 1)" in done.stdout
    assert "# line 2 of part.nc" in (tmp_path / "p.toml").read_text()
    checked = call("check", part, "--machine", "hexapod")
    assert checked.exit_code == 0, checked.stderr
    assert "M5 (line 3): NO TRIGGER" in checked.stderr
    for command in (
        ("import", part, "--out", tmp_path / "p.toml", "--force"),
        ("check", part, "--machine", "hexapod"),
    ):
        strict = call(*command, "--strict")
        assert strict.exit_code == 2
        assert "part.nc:1: column 5: M3 is not supported" in strict.stderr


def test_nothing_is_replaced_unasked(call, part, tmp_path):
    for taken in ("p.toml", "p.png"):
        (tmp_path / taken).write_text("mine")
        done = call("import", part, "--out", tmp_path / "p.toml", "--figure", tmp_path / "p.png")
        assert done.exit_code == 2
        assert "give --force" in done.stderr
        assert (tmp_path / taken).read_text() == "mine"
        (tmp_path / taken).unlink()
    done = call("import", part, "--out", part, "--force")
    assert done.exit_code == 2
    assert part.read_text() == FLAT
    missing = call("import", tmp_path / "none.nc", "--out", tmp_path / "p.toml")
    assert missing.exit_code == 2
    assert "No such file" in missing.stderr


def test_figures_are_of_the_kind_that_the_suffix_says(call, part, tmp_path):
    done = call("import", part, "--out", tmp_path / "p.toml", "--figure", tmp_path / "p.svg")
    assert done.exit_code == 0, done.stderr
    assert "<svg" in (tmp_path / "p.svg").read_text()
    part.write_text("G0 Z5\nX10\nY10\n")  # in space
    assert (
        call("import", part, "--out", tmp_path / "q.toml", "--figure", tmp_path / "q.png").exit_code
        == 0
    )


def test_more_segments_than_a_program_holds_are_refused_before_anything_is_written(
    call, part, tmp_path, monkeypatch
):
    monkeypatch.setattr("planner.program.validation.MOST_SEGMENTS", 2)
    done = call("import", part, "--out", tmp_path / "program.toml")
    assert done.exit_code == 2
    assert (
        "3 segments; a TOML program has at most 2: plan the file as it is (pulsepath plan part.nc)"
        in done.stderr
    )
    assert [path.name for path in tmp_path.iterdir()] == ["part.nc"]


def test_the_import_of_a_long_file_holds_none_of_its_segments(call, tmp_path, monkeypatch):
    """Its segments are read again and written one by one; many share a stroke of the drawing."""
    monkeypatch.setattr("planner.sources.outline.MOST_STROKES", 10)
    part, out = tmp_path / "long.nc", tmp_path / "long.toml"
    part.write_text("G21 F600\n" + "".join(f"G1 X{k % 7} Y{k % 5}\n" for k in range(1, 200)))
    monkeypatch.setattr("planner.sources.gcode.Gcode.read", None)  # which would hold them
    done = call("import", part, "--out", out, "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["segments"] == 199
    assert len(load_program(out).segments) == 199
