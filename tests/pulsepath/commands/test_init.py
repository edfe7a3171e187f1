"""`init`: files that plan at once; with --all, files that state every key."""

import json
import re
import tomllib
from pathlib import Path

import click
import numpy as np
import pytest

from kinematics import load_machine, machine_names
from kinematics.foundation.errors import FileError
from kinematics.kinds.axis_keys import LinearDrive, RotaryDrive, TimingTable
from kinematics.kinds.legged import Plate
from kinematics.kinds.load_keys import HomeTable, Mass
from kinematics.machine.first_machine import short_machine_starter
from kinematics.machine.machine_file import KINDS
from kinematics.machine.machine_writer import companions, known_keys, machine_starter
from planner import load_program, plan, program_names
from planner.program.program_file import (
    ArcTable,
    LineTable,
    PoseTable,
    ProgramFile,
    SplineTable,
    TurnBy,
    TurnTo,
)
from planner.program.program_writer import HEAD, MODIFIERS, SHAPES, program_starter
from planner.program.segment_tables import (
    BlendTable,
    CurveTable,
    FitTable,
    FreeTable,
    PathEntry,
    TriggerTable,
)
from pulsepath.cli import main

HEADER = re.compile(r"(#?)\[\[?(\w+)\]\]?")
KEY = re.compile(r"(#?)(\w+) = ")
NEEDS_PINOCCHIO = {"arm"}
# Of a machine of formulas, what only other formulas and joints go with.
WITH_OTHER_FORMULAS = {"geometry.rotary", "geometry.follows", "geometry.orientation"}


def tables(text):
    """Of a file to start from: [header, is it a comment, {key: (is it a comment, its lines)}] for
    each table.
    """
    found, lines = [["", False, {}]], iter(text.splitlines())
    for line in lines:
        if header := HEADER.match(line):
            found.append([header[2], bool(header[1]), {}])
        elif key := KEY.match(line):
            block = [line]
            while block[0].rstrip().endswith("[") and not block[-1].lstrip("#").startswith("]"):
                block.append(next(lines))
            found[-1][2][key[2]] = bool(key[1]), block
    return found


def written(parts, changed=()):
    """A file again; changed: (table's number, key) that are taken out of their comments, or put
    into one.
    """
    lines = []
    for n, (header, comment, keys) in enumerate(parts):
        if header:
            array = header in ("segment", "axis", "vibration")
            comment = comment and not any(n == number for number, _ in changed)
            lines.append(
                f"{'#' if comment else ''}{'[[' if array else '['}{header}{']]' if array else ']'}"
            )
        for key, (hidden, block) in keys.items():
            if (n, key) in changed:
                block = [line.removeprefix("#") if hidden else f"#{line}" for line in block]
            lines += block
    return "\n".join(lines)


def variants(parts, known):
    """(what, text) with each key taken out of its comment, with what it needs, and without what it
    replaces.
    """
    keys = {key.name: key for key in known}
    for n, (header, comment, entries) in enumerate(parts):
        hidden = [key for key, (is_comment, _) in entries.items() if is_comment]
        if comment:
            first: list[str] = []  # of keys that take each other's place, one
            for key in hidden:
                first += [] if key in keys and set(keys[key].instead) & set(first) else [key]
            yield header, written(parts, {(n, key) for key in first})
            continue
        for name in hidden:
            key = keys[name]
            also = [need for need in key.needs if need in hidden]
            off = [other for other in key.instead if other in entries and other not in hidden]
            yield f"{header}.{name}", written(parts, {(n, each) for each in (name, *also, *off)})


def optional(*models):
    """Names of the keys in files that some tables do not ask for."""
    return {
        f.alias or name
        for model in models
        for name, f in model.model_fields.items()
        if not f.is_required()
    }


@pytest.fixture(scope="module", params=sorted(machine_names()))
def machine(request):
    if request.param in NEEDS_PINOCCHIO:
        pytest.importorskip("pinocchio")
    return request.param


def test_a_machine_file_says_every_key_of_its_schema(machine):
    text = machine_starter(machine)
    parts = tables(text)
    kind = tomllib.loads(text)["kind"]
    schema = KINDS[kind][0]
    models = {
        name: schema.tables_of(name) for name in ("geometry", "axes", "rotary", "platform", "legs")
    }
    said = {}
    for header, _, keys in parts:
        said.setdefault(header, set()).update(keys)
    assert {field.alias or name for name, field in schema.model_fields.items()} <= {
        *said,
        *said[""],
    }
    for header, models_of_it in models.items():
        assert said.get(header, set()) == {
            name for model in models_of_it for name in model.model_fields
        }
    legged = kind in ("hexapod", "tripod")
    nested = [
        TimingTable,
        *([HomeTable] if kind != "arm" else []),
        *([Plate, Mass] if legged else []),
    ]
    nested += [LinearDrive] if kind != "arm" else []
    nested += [RotaryDrive] if kind in ("arm", "traverser") else []
    for name in optional(*nested):
        assert re.search(rf"\b{name}\b", text), name


def test_each_key_in_a_comment_makes_a_file_that_loads(tmp_path, machine):
    text = machine_starter(machine)
    data, (kind, path) = (
        tomllib.loads(text),
        (tomllib.loads(text)["kind"], tmp_path / "machine.toml"),
    )
    for name, content in companions(machine).items():
        (tmp_path / name).write_bytes(content)
    parts = tables(text)
    assert tomllib.loads(written(parts)) == data  # the tests read it as TOML does
    keys = known_keys(kind)
    tried = list(
        variants(
            parts,
            [
                key
                for table in ("", "geometry", "rotary", "axes", "platform")
                for key in keys.get(table, ())
            ],
        )
    )
    for part in parts:  # whose examples have other units than the slides'
        if part[0] == "rotary":
            assert part[2].keys() <= {key.name for key in keys["rotary"]}
    assert len(tried) > 15
    for what, changed in tried:
        if kind == "equations" and what in WITH_OTHER_FORMULAS:
            continue
        path.write_text(changed)
        assert tomllib.loads(changed) != data, what
        assert load_machine(path).name == ("mine" if ".name" in what else "machine"), what


def test_a_machine_file_is_the_machine_that_it_was_made_of(tmp_path, machine):
    (tmp_path / "machine.toml").write_text(machine_starter(machine))
    for name, content in companions(machine).items():
        (tmp_path / name).write_bytes(content)
    made, bundled = load_machine(tmp_path / "machine.toml"), load_machine(machine)
    assert made.axes == bundled.axes
    assert made.home_q.tolist() == bundled.home_q.tolist()


@pytest.mark.parametrize("preset", [None, *program_names()])
def test_a_program_file_says_every_key_and_loads_with_each(tmp_path, preset):
    text = program_starter("hexapod", "hexapod", preset)
    parts, path = tables(text), tmp_path / "program.toml"
    assert tomllib.loads(written(parts)) == tomllib.loads(text)
    segments = [part[2] for part in parts if part[0] == "segment"]
    assert parts[0][2].keys() | {"segment"} == {
        field.alias or name for name, field in ProgramFile.model_fields.items()
    }
    assert {key for keys in segments for key in keys} == {*PathEntry.model_fields, *SHAPES}
    shapes = (
        PoseTable,
        LineTable,
        ArcTable,
        SplineTable,
        CurveTable,
        TurnTo,
        TurnBy,
        BlendTable,
        FitTable,
        TriggerTable,
        FreeTable,
    )
    for name in optional(*shapes):
        assert re.search(rf"\b{name}\b", text), name
    for what, changed in variants(parts, [*HEAD, *SHAPES.values(), *MODIFIERS]):
        path.write_text(changed)
        assert load_program(path).name == ("mine" if ".name" in what else "program"), what


def test_what_is_written_plans_at_once(call, tmp_path, machine):
    done = call("init", tmp_path / "new" / "one", "--machine", machine, "--json")
    assert done.exit_code == 0
    written = json.loads(done.stdout)["files"]
    assert {Path(file).name for file in written} == {
        "machine.toml",
        "program.toml",
        *companions(machine),
    }
    folder = tmp_path / "new" / "one"
    program = load_program(folder / "program.toml")
    assert program.machine == "machine.toml"
    assert plan(program, load_machine(folder / program.machine)).certificate.holds


def test_a_short_file_is_the_same_machine_without_what_can_wait(tmp_path, machine):
    """Joints are rounded to 0.1 µm and leg lengths to 0.01 mm; limits of speed, acceleration and
    jerk are exact.
    """
    (tmp_path / "short.toml").write_text(short_machine_starter(machine))
    for name, content in companions(machine).items():
        (tmp_path / name).write_bytes(content)
    short, bundled = load_machine(tmp_path / "short.toml"), load_machine(machine)
    np.testing.assert_allclose(short.home_q, bundled.home_q, rtol=0, atol=2e-7)
    for one, other in zip(short.axes, bundled.axes, strict=True):
        for limit in ("name", "kind", "max_speed", "max_acceleration", "max_jerk"):
            assert getattr(one, limit) == getattr(other, limit)
        assert one.pulse == pytest.approx(other.pulse, rel=1e-12)
        np.testing.assert_allclose(one.travel, other.travel, rtol=0, atol=1.1e-5)
        assert one.travel[0] <= other.travel[0] + 2e-7
        assert one.travel[1] >= other.travel[1] - 2e-7


@pytest.mark.parametrize("option", [[], ["--all"]])
def test_plain_numbers_of_a_file_keep_their_unit(call, tmp_path, option):
    (tmp_path / "inches.toml").write_text(
        'schema = 1\nkind = "tripod"\nlength = "in"\n[geometry]\n'
        "base_joints = [[7, 0, 0], [-3.5, 6, 0], [-3.5, -6, 0]]\n"
        "platform_joints = [[1.4, 0, 0], [-0.7, 1.2, 0], [-0.7, -1.2, 0]]\n"
        "tool = [0, 0, -2]\nhome = { to = [0, 0, -12] }\nbase_rest = [0, 0, -1]\nplatform_rest = [0, 0, -1]\n"
        '[axes]\nleg_length = [8, 14]\npulse = "1 um"\nmax_speed = "15 mm/s"\nmax_acceleration = "150 mm/s^2"\n'
        'backlash = "1 um"\n[wiring]\narm1 = ["PCI-8164", 0]\n'
    )
    assert (
        call("init", tmp_path / "new", "--machine", tmp_path / "inches.toml", *option).exit_code
        == 0
    )
    made, source = (
        load_machine(tmp_path / "new" / "machine.toml"),
        load_machine(tmp_path / "inches.toml"),
    )
    np.testing.assert_allclose(made.base, source.base, rtol=1e-12)
    np.testing.assert_allclose(made.home_q, source.home_q, rtol=1e-12)
    for one, other in zip(made.axes, source.axes, strict=True):
        np.testing.assert_allclose(one.travel, other.travel, rtol=1e-12)
    text = (tmp_path / "new" / "machine.toml").read_text()
    assert ("# Left out: backlash, [wiring]." in text) == (not option)


def test_each_key_of_a_short_file_has_a_line_of_comment(machine):
    kind = tomllib.loads(short_machine_starter(machine))["kind"]
    for text in (short_machine_starter(machine), program_starter("m.toml", kind, short=True)):
        lines = text.splitlines()
        explained, table = set(), ""
        for n, line in enumerate(lines):
            table = line.strip("[]") if line.startswith("[") else table
            key = re.match(r"(\w+) = ", line)
            if key is None or "." in table:  # formulas by the names that their machine gives them
                continue
            commented = "  # " in line or lines[n - 1].startswith("# ")
            assert commented or (table == "segment" and key[1] in explained), line
            explained.add(key[1])
        assert len(explained) >= 5
        assert not any(re.match(r"#\w", line) for line in lines)  # no key is a comment
        assert len(text) < 0.5 * len(machine_starter(machine))


@pytest.mark.parametrize(
    "folder", ["mine", "my hexapod (2)", "größer", '"quoted"', "...x", "back\\slash", "x" * 101]
)
def test_machine_and_program_are_named_after_the_folder(call, tmp_path, monkeypatch, folder):
    fits = len(folder) <= 100 and "\\" not in folder
    done = call("init", tmp_path / folder)
    assert done.exit_code == 0
    again = tmp_path / "again" / folder
    again.mkdir(parents=True)
    monkeypatch.chdir(again)
    assert call("init").exit_code == 0
    for place in (tmp_path / folder, again):
        assert {path.name for path in place.iterdir()} == {"machine.toml", "program.toml"}
        program = load_program(place / "program.toml")
        assert program.machine == "machine.toml"
        assert program.name == (folder if fits else "program")
        assert load_machine(place / "machine.toml").name == (folder if fits else "machine")


@pytest.mark.parametrize("name", ["", "a/b", "..", "  ", "tab\t", "x" * 101])
def test_a_name_that_is_none_is_refused(tmp_path, name):
    text = short_machine_starter("hexapod", "mine").replace(
        'name = "mine"', f"name = {json.dumps(name)}"
    )
    (tmp_path / "machine.toml").write_text(text)
    with pytest.raises(FileError, match="is not a name: give 1 to 100 characters") as told:
        load_machine(tmp_path / "machine.toml")
    assert [fault.key for fault in told.value.faults] == ["name"]


def test_the_folder_for_its_file_is_pointed_to_the_file(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("init", "mine").exit_code == 0
    cases = (
        (("plan", "mine", "--out", "out"), "program.toml"),
        (("pose", "mine", "0,0,0"), "machine.toml"),
    )
    for command, file in cases:
        done = call(*command)
        assert done.exit_code == 2
        assert f"or give the path of a file, e.g. {Path('mine', file)}" in done.stderr


@pytest.mark.parametrize("option", [[], ["--all"]])
def test_all_asks_for_every_key(call, tmp_path, option):
    assert call("init", tmp_path / "mine", *option).exit_code == 0
    machine = (tmp_path / "mine" / "machine.toml").read_text()
    program = (tmp_path / "mine" / "program.toml").read_text()
    assert ("#backlash" in machine, "#join" in program) == (bool(option), bool(option))
    if option:
        assert machine == machine_starter("hexapod", "mine")


@pytest.mark.parametrize("folder", ["new", "-dash"])
def test_the_commands_that_it_ends_with_are_commands(call, tmp_path, monkeypatch, folder):
    monkeypatch.chdir(tmp_path)
    done = call("init", "--", folder)
    assert done.stdout.splitlines()[-3] == "next:"
    for line in done.stdout.splitlines()[-2:]:
        program, *arguments = line.split()
        assert program == "pulsepath"
        name, command, rest = main.resolve_command(click.Context(main), arguments)
        assert Path(command.make_context(name, rest).params["program"]) == Path(
            folder, "program.toml"
        )


def test_a_program_to_start_from_brings_its_machine(call, tmp_path):
    folder = tmp_path / "mine"
    assert call("init", folder, "--program", "arm-square").exit_code == 0
    assert tomllib.loads((folder / "machine.toml").read_text())["kind"] == "arm"
    assert len(load_program(folder / "program.toml").segments) == 4


def test_nothing_is_replaced_without_force(call, tmp_path):
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "program.toml").write_text("mine")
    done = call("init", folder)
    assert (done.exit_code, done.stdout) == (2, "")
    assert "--force" in done.stderr
    assert [path.name for path in folder.iterdir()] == ["program.toml"]
    assert call("init", folder, "--force").exit_code == 0
    assert {path.name for path in folder.iterdir()} == {"machine.toml", "program.toml"}


def test_whole_or_not_at_all(call, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device", "program.toml")

    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "machine.toml").write_text("mine")
    write, written_ = Path.write_bytes, []

    def second_fails(path, content):
        written_.append(path)
        return fail() if len(written_) == 2 else write(path, content)

    monkeypatch.setattr(Path, "write_bytes", second_fails)
    for place in (folder, folder / "a" / "b"):
        written_.clear()
        assert call("init", place, "--force").exit_code == 2
    assert [path.name for path in folder.iterdir()] == ["machine.toml"]
    assert (folder / "machine.toml").read_text() == "mine"


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_kind_is_something_to_start_from(tmp_path, kind):
    main(["init", str(tmp_path / "mine"), "--machine", kind], standalone_mode=False)
    assert tomllib.loads((tmp_path / "mine" / "machine.toml").read_text())["kind"] == kind


SHORT = """
schema = 1
length = "mm"
[[segment]]
line = { to = [0, 0, 0.1] }
"""


SIZES = ("leg_radius", "base_disc", "platform_disc")


def test_doubts_about_a_file_are_warnings(call, tmp_path, limit_search):
    """Two rows swapped in one list, and a speed in the wrong unit; the commands go on."""
    limit_search(0.0)
    short = tmp_path / "short.toml"
    short.write_text(SHORT, encoding="utf-8")
    assert call("init", tmp_path / "mine").exit_code == 0
    file = tmp_path / "mine" / "machine.toml"
    text = file.read_text()
    rows = "    [86.6025, 50, -11],\n", "    [0, 100, -11],\n"
    assert "".join(rows) in text
    swapped = text.replace("".join(rows), "".join(reversed(rows))).replace("20 mm/s", "20 m/s")
    # without sizes of legs and plates: of swapped legs the proof that they do not collide takes 3 s
    bare = [line for line in swapped.splitlines() if not line.startswith(SIZES)]
    assert len(bare) == len(swapped.splitlines()) - len(SIZES)
    file.write_text("\n".join(bare))
    for done in (
        call("check", short, "--machine", file, "-v"),
        call("pose", file, "0,0,0"),
    ):
        warnings = [line for line in done.stderr.splitlines() if line.startswith("warning: ")]
        speed, swapped = warnings
        assert "max_speed 20000 mm/s takes" in speed
        assert "leg1 and leg2 are" in swapped
    quiet = call("pose", tmp_path / "mine" / "machine.toml", "0,0,0", "-q")
    assert "warning" not in quiet.stderr


def test_a_speed_that_the_axes_never_come_near_is_a_warning(call, tmp_path):
    assert call("init", tmp_path / "mine", "--machine", "cartesian").exit_code == 0
    file = tmp_path / "mine" / "program.toml"
    text = file.read_text()
    options = (
        "--order",
        2,
        "--no-figures",
        "--pulses",
        "none",
        "--no-baselines",
        "--bound",
        "none",
    )
    for speed, doubted in (("40 m/s", True), ("40 mm/s", False)):
        file.write_text(text.replace('frame = "home"', f'frame = "home"\nspeed = "{speed}"'))
        done = call("plan", file, *options, "--out", tmp_path / speed.replace("/", "_"))
        assert done.exit_code == 0
        assert ("of the program's speed: check its unit" in done.stderr) == doubted
