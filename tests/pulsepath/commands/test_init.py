"""`init`: files that plan at once, and say every key that there is."""

import json
import re
import tomllib
from pathlib import Path

import click
import pytest

from kinematics import load_machine, machine_names
from kinematics.kinds.axis_keys import LinearDrive, RotaryDrive, TimingTable
from kinematics.kinds.legged import Plate
from kinematics.kinds.load_keys import HomeTable, Mass
from kinematics.machine.machine_file import KINDS
from kinematics.machine.machine_writer import companions, known_keys, machine_starter
from planner import load_program, plan, program_names
from planner.program.program_file import ArcTable, LineTable, PoseTable, ProgramFile, SplineTable, TurnBy, TurnTo
from planner.program.program_writer import HEAD, MODIFIERS, SHAPES, program_starter
from planner.program.segment_tables import BlendTable, CurveTable, FitTable, FreeTable, PathEntry, TriggerTable
from pulsepath.cli import main

HEADER = re.compile(r"(#?)\[\[?(\w+)\]\]?")
KEY = re.compile(r"(#?)(\w+) = ")
NEEDS_PINOCCHIO = {"arm"}
# Of a machine of formulas, what only other formulas and joints go with.
WITH_OTHER_FORMULAS = {"geometry.rotary", "geometry.follows", "geometry.orientation"}


def tables(text):
    """Of a file to start from: [header, is it a comment, {key: (is it a comment, its lines)}] for each table."""
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
    """A file again; changed: (table's number, key) that are taken out of their comments, or put into one."""
    lines = []
    for n, (header, comment, keys) in enumerate(parts):
        if header:
            array = header in ("segment", "axis", "vibration")
            comment = comment and not any(n == number for number, _ in changed)
            lines.append(f"{'#' if comment else ''}{'[[' if array else '['}{header}{']]' if array else ']'}")
        for key, (hidden, block) in keys.items():
            if (n, key) in changed:
                block = [line.removeprefix("#") if hidden else f"#{line}" for line in block]
            lines += block
    return "\n".join(lines)


def variants(parts, known):
    """(what, text) with each key taken out of its comment, with what it needs, and without what it replaces."""
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
    return {f.alias or name for model in models for name, f in model.model_fields.items() if not f.is_required()}


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
    models = {name: schema.tables_of(name) for name in ("geometry", "axes", "rotary", "platform", "legs")}
    said = {}
    for header, _, keys in parts:
        said.setdefault(header, set()).update(keys)
    assert {field.alias or name for name, field in schema.model_fields.items()} <= {*said, *said[""]}
    for header, models_of_it in models.items():
        assert said.get(header, set()) == {name for model in models_of_it for name in model.model_fields}
    legged = kind in ("hexapod", "tripod")
    nested = [TimingTable, *([HomeTable] if kind != "arm" else []), *([Plate, Mass] if legged else [])]
    nested += [LinearDrive] if kind != "arm" else []
    nested += [RotaryDrive] if kind in ("arm", "traverser") else []
    for name in optional(*nested):
        assert re.search(rf"\b{name}\b", text), name


def test_each_key_in_a_comment_makes_a_file_that_loads(tmp_path, machine):
    text = machine_starter(machine)
    data, (kind, path) = tomllib.loads(text), (tomllib.loads(text)["kind"], tmp_path / "machine.toml")
    for name, content in companions(machine).items():
        (tmp_path / name).write_bytes(content)
    parts = tables(text)
    assert tomllib.loads(written(parts)) == data  # the tests read it as TOML does
    keys = known_keys(kind)
    tried = list(
        variants(
            parts, [key for table in ("", "geometry", "rotary", "axes", "platform") for key in keys.get(table, ())]
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
        assert load_machine(path).name == "machine", what


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
    assert parts[0][2].keys() | {"segment"} == {field.alias or name for name, field in ProgramFile.model_fields.items()}
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
        assert load_program(path).name == "program", what


def test_what_is_written_plans_at_once(call, tmp_path, machine):
    done = call("init", tmp_path / "new" / "one", "--machine", machine, "--json")
    assert done.exit_code == 0
    told = json.loads(done.stdout)
    assert {Path(file).name for file in told["files"]} == {"machine.toml", "program.toml", *companions(machine)}
    folder = tmp_path / "new" / "one"
    program = load_program(folder / "program.toml")
    assert program.machine == "machine.toml"
    assert plan(program, load_machine(folder / program.machine), order=2).certificate.holds


def test_the_commands_that_it_ends_with_are_commands(call, tmp_path):
    done = call("init", tmp_path / "new")
    assert done.stdout.splitlines()[-3] == "next:"
    for line in done.stdout.splitlines()[-2:]:
        program, *arguments = line.split()
        assert program == "pulsepath"
        name, command, rest = main.resolve_command(click.Context(main), arguments)
        assert Path(command.make_context(name, rest).params["program"]) == tmp_path / "new" / "program.toml"


def test_a_program_to_start_from_brings_its_machine(call, tmp_path):
    assert call("init", tmp_path, "--program", "arm-square").exit_code == 0
    assert tomllib.loads((tmp_path / "machine.toml").read_text())["kind"] == "arm"
    assert len(load_program(tmp_path / "program.toml").segments) == 4


def test_nothing_is_replaced_without_force(call, tmp_path):
    (tmp_path / "program.toml").write_text("mine")
    done = call("init", tmp_path)
    assert (done.exit_code, done.stdout) == (2, "")
    assert "--force" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["program.toml"]
    assert call("init", tmp_path, "--force").exit_code == 0
    assert {path.name for path in tmp_path.iterdir()} == {"machine.toml", "program.toml"}


def test_whole_or_not_at_all(call, tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device", "program.toml")

    (tmp_path / "machine.toml").write_text("mine")
    write, written_ = Path.write_bytes, []

    def second_fails(path, content):
        written_.append(path)
        return fail() if len(written_) == 2 else write(path, content)

    monkeypatch.setattr(Path, "write_bytes", second_fails)
    for place in (tmp_path, tmp_path / "a" / "b"):
        written_.clear()
        assert call("init", place, "--force").exit_code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["machine.toml"]
    assert (tmp_path / "machine.toml").read_text() == "mine"


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_kind_is_something_to_start_from(tmp_path, kind):
    main(["init", str(tmp_path), "--machine", kind], standalone_mode=False)
    assert tomllib.loads((tmp_path / "machine.toml").read_text())["kind"] == kind
