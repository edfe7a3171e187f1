"""Nothing that comes from a file or a path controls the terminal, a page, or what reads the
JSON.
"""

import json
import re
import shutil

import pytest

from kinematics.files.plain_text import plain, plain_json, plain_line
from kinematics.foundation.table import Column, Table

HOSTILE = "a\x1b[31m\x07\x9b2J\u202eb\u2028"
OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")
LINE = 'schema = 1\nlength = "mm"\n[[segment]]\nline = { to = [0, 0, 0.1] }\n'


def test_what_is_obeyed_is_escaped():
    assert plain("a\x1b\r\n\t\x85\u202eµ≤") == "a\\x1b\\r\n\t\\x85\\u202eµ≤"
    assert plain_line("a\tb\n") == "a\\tb\\n"
    for k in range(0x110000):
        letter = chr(k)
        if OBEYED.match(letter) or (0xD800 <= k < 0xE000):
            assert plain(letter).isascii()
            assert plain(letter).isprintable()
    text = json.dumps([HOSTILE], ensure_ascii=False)
    assert json.loads(plain_json(text)) == [HOSTILE]
    assert not OBEYED.search(plain_json(text))


def test_tables_show_it_escaped_and_hold_it_as_it_is():
    table = Table(f"t{HOSTILE}", (Column(f"n{HOSTILE}", [f"v{HOSTILE}"]),), (f"w{HOSTILE}",))
    assert not OBEYED.search(str(table))
    assert not OBEYED.search(table._repr_html_())
    assert table.columns[0].raw == [f"v{HOSTILE}"]


@pytest.mark.parametrize("text", [
    'name = "a\\u001b[31m"', 'name = "a\\u202e"', '"a\\u0007" = 1', "x = ['a', { b = \"\\u009b\" }]",
])  # fmt: skip
def test_files_with_such_names_are_refused_with_their_line(call, tmp_path, text):
    (tmp_path / "p.toml").write_text(f"{LINE}{text}\n")
    for more in ([], ["--json"]):
        done = call("check", tmp_path / "p.toml", "--machine", "hexapod", *more)
        assert done.exit_code == 2
        assert f"{tmp_path / 'p.toml'}:5: " in done.stderr
        assert "controls how text is shown; take it out" in done.stderr
        assert not OBEYED.search(done.output)


CASES = {
    "a program": ("check", "{h}.toml", "--machine", "hexapod"),
    "a program that is not there": ("check", "{h}/none.toml", "--machine", "hexapod"),
    "a machine": ("check", "line.toml", "--machine", "{h}.machine.toml"),
    "a word of G-code": ("import", "word.nc", "--out", "{h}.word.toml"),
    "a file of G-code": ("import", "part.nc", "--out", "{h}.part.toml"),
    "a file of no kind": ("import", "{h}.toml", "--out", "x.toml", "--format", "{h}"),
    "a plan": ("export", "{h}", "--format", "g93"),
    "an argument": ("laws", "{h}"),
    "a plan that is none": ("view", "{h}.toml", "--html", "x.html"),
    "a folder to begin in": ("init", "{h}.new"),
    "an option": ("plan", "circle", "--{h}", "1"),
}


@pytest.mark.parametrize("asked", [[], ["--json"]])
@pytest.mark.parametrize("arguments", CASES.values(), ids=CASES)
def test_nothing_that_a_command_says_is_obeyed(
    call, tmp_path, directory, monkeypatch, arguments, asked
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / f"{HOSTILE}.toml").write_text(LINE)
    (tmp_path / "line.toml").write_text(LINE)
    (tmp_path / f"{HOSTILE}.machine.toml").write_text((directory / "machine.toml").read_text())
    (tmp_path / "part.nc").write_text("G21 G90\nG1 X5 F600\n")
    (tmp_path / "word.nc").write_text(f"G21 G90\n(MSG {HOSTILE})\nG1 X5 {HOSTILE} F600\n")
    if arguments[0] == "export":
        shutil.copytree(directory, tmp_path / HOSTILE)
    done = call(*(argument.format(h=HOSTILE) for argument in arguments), *asked)
    assert done.exit_code in (0, 2), done.output
    assert done.output.strip()
    assert not OBEYED.search(done.output), repr(done.output)
    if asked and done.stdout:
        json.loads(done.stdout)


@pytest.mark.usefixtures("planned")
def test_no_file_of_a_plan_is_obeyed(call, tmp_path, monkeypatch, job):
    """The report, the page of the viewer, and what is exported, of a program by a hostile name."""
    from dataclasses import replace

    program = replace(job.plan.program, name=HOSTILE)
    renamed = replace(job.plan, program=program)
    named = replace(job, results=replace(job.results, plan=renamed))
    monkeypatch.setattr("pulsepath.job.run", lambda *_: named)
    out = tmp_path / "o"
    done = call("plan", "bare-circle", "--no-figures", "--out", out)
    assert done.exit_code == 0, done.output
    assert not OBEYED.search(done.output)
    assert call("view", out, "--html", out / "v.html", "--frames", "2").exit_code == 0
    for form in ("g93", "adlink", "vcd"):
        call("export", out, "--format", form)
    for path in out.iterdir():
        if path.is_file() and path.suffix not in (".npz", ".bin"):
            found = OBEYED.search(path.read_bytes().decode("utf-8").replace("\r\n", "\n"))
            assert found is None or path.name == "v.html", (path.name, found)
    page = (out / "v.html").read_text("utf-8")
    assert HOSTILE not in page
    assert "\\x1b[31m" in page
