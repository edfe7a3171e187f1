"""What a new kind of machine, limit, law, format or firing rule touches: its file, its table, and
few others.
"""

import ast
import re
from collections import defaultdict
from functools import cache, partial
from importlib import import_module
from pathlib import Path

import pytest

from controllers.laws.registry import LAWS
from kinematics.kinds.axis_keys import LinearAxis, RotaryAxis
from kinematics.machine.machine_file import KINDS
from planner.export.format import FORMATS
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS
from planner.pulses import RULES
from planner.sources.source import SOURCES

ROOT = Path(__file__).parents[1]
PACKAGES = ("kinematics", "planner", "controllers", "benchmarks", "pulsepath")
MOST_FILES = 4
REGISTRIES = "pulsepath/registries.py"
"""Lists the names of all tables for the command line; tests/pulsepath/test_registries.py
compares.
"""

TABLES = {
    "machine": (
        "kinematics/machine/machine_file.py",
        {kind for entry in KINDS.values() for kind in entry[:2]},
    ),
    "limit": ("planner/limits/registry.py", {*AXIS_LIMITS, *MACHINE_LIMITS}),
    "law": ("controllers/laws/registry.py", {*LAWS.values()}),
    "export": ("planner/export/format.py", {*FORMATS.values()}),
    "import": ("planner/sources/source.py", {*SOURCES.values()}),
    "rule": ("planner/pulses/generation/rules.py", {*RULES.values()}),
}
"""By the name of its how-to: the file of the table, and what is plugged in there."""

DELIBERATE = {
    "planner/timing/goals/pacing.py": "eases acceleration and jerk, which every axis has, and heeds bands of resonance",
    "planner/timing/goals/constant_speed_errors.py": "explains a stated tool speed that bands of resonance forbid",
    "planner/bounds/lower_bound.py": "proves a bound from the limits whose rows it encloses, and names the others",
    "planner/baselines/classical.py": "trapezoids, whose limits are stated of the axes alone",
}
"""Files that name several entries of one table for what these are: a new entry changes none of
them.
"""


@cache
def parse_product():
    """For each file of the product: its imports (module, name), and the strings that stand in
    it.
    """
    imports, texts = {}, {}
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    for path in paths:
        file = path.relative_to(ROOT).as_posix()
        if file.startswith("benchmarks/evidence"):
            continue
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        imports[file] = {
            (n.module, alias.name)
            for n in nodes
            if isinstance(n, ast.ImportFrom)
            for alias in n.names
        }
        texts[file] = {
            n.value for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str)
        }
    return imports, texts


def origin(entry):
    """(module, name) of what a table holds."""
    entry = entry.func if isinstance(entry, partial) else entry
    return tuple(entry.split(":")) if isinstance(entry, str) else (entry.__module__, entry.__name__)


@pytest.mark.parametrize("point", TABLES)
def test_no_other_file_has_a_list_of_its_own(point):
    """A file that names two entries, beside the table and their own files, is one that a third has
    to be put into.
    """
    table, entries = TABLES[point]
    named = defaultdict(set)
    for module, name in map(origin, entries):
        own = f"{module.replace('.', '/')}.py"
        assert (ROOT / own).is_file()
        for file, imported in parse_product()[0].items():
            if (module, name) in imported and file not in (table, own):
                named[file].add(name)
    lists = {file for file, names in named.items() if len(names) > 1}
    assert lists <= (DELIBERATE.keys() if point == "limit" else set())


def test_no_other_file_tells_kinds_of_machines_apart_by_name():
    """Words such as "hexapod" in code: names of presets as defaults, one to a file; never several
    kinds.
    """
    kinds = set(KINDS) - {"arm"}  # which is a word of its own
    for file, texts in parse_product()[1].items():
        assert file in (TABLES["machine"][0], REGISTRIES) or len(kinds & texts) <= 1, file


@pytest.mark.parametrize("point", TABLES)
def test_its_how_to_lists_few_files_that_all_are_there(point):
    page = (ROOT / "docs" / "howto" / f"add_{point}.md").read_text(encoding="utf-8")
    steps = page.partition("## To contribute it")[2]
    assert 2 <= len(re.findall(r"^\d\. ", steps, re.MULTILINE)) <= MOST_FILES
    files = dict.fromkeys(
        re.findall(r"`((?:kinematics|planner|controllers)/[\w/]+\.(?:py|toml))`", steps)
    )
    assert TABLES[point][0] in files
    assert (f"`{REGISTRIES}`" in steps) == (point != "limit")  # no command lists limits
    assert len(files) <= MOST_FILES + (
        point == "limit"
    )  # of a limit, either an axis' key or a program's
    for file in files:
        assert (ROOT / file).parent.is_dir()
    for file in [file for file in files if not (ROOT / file).exists()]:
        assert (
            (ROOT / "docs" / "examples" / Path(file).name).with_suffix(".py").exists()
        )  # as the page shows it
    for test in re.findall(r"`(tests/[\w/]+\.py)`", steps):
        assert (ROOT / test).is_file()


def test_a_key_of_an_axis_is_stated_once():
    """Its name stands in the model of the axis and in the one table of keys, and in no list of the
    files' code.
    """
    folders = (
        ROOT / "kinematics" / "machine",
        ROOT / "kinematics" / "kinds",
        ROOT / "kinematics" / "files",
    )
    trees = {
        p.name: ast.parse(p.read_text("utf-8")) for folder in folders for p in folder.glob("*.py")
    }
    declared = {
        name: sum(
            isinstance(n, ast.AnnAssign) and getattr(n.target, "id", "") == name
            for n in ast.walk(tree)
        )
        for name in (
            "take_up_acceleration",
            "max_jerk",
            "torque_speed",
            "friction",
            "reflected",
            "max_pulse_rate",
        )
        for tree in [trees["axis_keys.py"]]
    }
    assert set(declared.values()) == {1}
    for file in ("machine_writer.py", "load_keys.py"):
        texts = {n.value for n in ast.walk(trees[file]) if isinstance(n, ast.Constant)}
        assert not texts & declared.keys(), file
    assert LinearAxis.model_fields.keys() == RotaryAxis.model_fields.keys()


def test_what_is_plugged_in_by_name_is_there():
    for module, name in (origin(entry) for _, entries in TABLES.values() for entry in entries):
        assert hasattr(import_module(module), name)
