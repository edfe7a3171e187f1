"""What the command line lists before it loads anything, against the classes and tables
themselves.
"""

import ast
from importlib import import_module
from pathlib import Path

import pytest

from controllers import rig_names
from kinematics import machine_names
from kinematics.foundation.names import presets
from planner import program_names
from planner.export.format import FORMATS, find_format, takes_stop
from planner.sources.source import SOURCES, find_source, suffix_formats
from pulsepath import known_names, registries
from pulsepath.docstrings import first_paragraph
from pulsepath.format_options import EXPORTS, STOPS, list_options

FORMAT_TABLES = {
    "exports": (FORMATS, find_format, registries.EXPORTS, registries.EXPORT_OPTIONS),
    "imports": (SOURCES, find_source, registries.IMPORTS, registries.IMPORT_OPTIONS),
}


def test_it_imports_nothing():
    tree = ast.parse(Path(registries.__file__).read_text(encoding="utf-8"))
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom)]


@pytest.mark.parametrize("what", registries.TABLES)
def test_names_are_those_of_the_table(what):
    module, _, table = registries.TABLES[what].partition(":")
    keys = getattr(import_module(module), table)
    words = [word for key in keys for word in ((key,) if isinstance(key, str) else key)]
    assert words
    assert [*registries.NAMES[what]] == words


def test_names_of_presets_are_those_that_load():
    assert set(known_names.machines()) == set(machine_names())
    assert set(known_names.programs()) == set(program_names())
    assert set(known_names.rigs()) == set(rig_names())
    assert set(known_names.measurements()) == set(presets("kinematics.calibration"))


@pytest.mark.parametrize("what", FORMAT_TABLES)
def test_help_is_the_first_line_of_the_docstring(what):
    table, find, helps, _ = FORMAT_TABLES[what]
    assert helps == {name: first_paragraph(find(name)) for name in table}


@pytest.mark.parametrize("what", FORMAT_TABLES)
def test_options_are_the_fields(what):
    table, find, _, listed = FORMAT_TABLES[what]
    fields = [row for name in table for row in list_options(name, find(name))]
    rows = [
        (name, takes, each, text)
        for name, takes, formats, text in listed
        for each in formats.split()
    ]
    assert sorted(rows, key=str) == sorted(fields, key=str)


def test_formats_from_rest_are_those_that_cannot_hold_a_stop():
    from_rest = [name for name in FORMATS if not takes_stop(find_format(name))]
    assert registries.FROM_REST.split() == from_rest


def test_suffixes_are_those_of_the_formats():
    assert suffix_formats() == registries.SUFFIXES


def test_controllers_get_a_format_with_options_that_it_has():
    for given in registries.CONTROLLERS.values():
        name, *flags = given.split()
        options = {option for option, *_ in list_options(name, find_format(name))}
        assert {flag.removeprefix("--") for flag in flags} <= options


def test_a_format_that_a_program_adds_is_listed_with_its_options(monkeypatch):
    monkeypatch.setitem(FORMATS, "own", FORMATS["csp"])
    assert known_names.exports() == [*registries.EXPORTS, "own"]
    assert EXPORTS.names() == known_names.exports()
    assert EXPORTS.helps()["own"] == registries.EXPORTS["csp"]
    (cycle,) = (option for option in STOPS.options() if option.name == "cycle")
    assert "[csp]" in cycle.help
    assert "[own]" in cycle.help


def test_a_format_from_rest_that_a_program_adds_is_not_offered_for_stops(monkeypatch):
    monkeypatch.setitem(FORMATS, "own", FORMATS["g93"])
    assert "own" in EXPORTS.names()
    assert "own" not in STOPS.names()
