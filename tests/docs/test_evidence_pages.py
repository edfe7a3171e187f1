"""The pages of evidence: complete."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.evidence import run

ROOT = Path(__file__).parents[2]
RUNNER = "benchmarks.evidence"
COMMANDS = re.compile(rf"python\s-m\s({RUNNER}\s[a-z]\w*|benchmarks[\w.]*)")
"""The runner and the name of a case, or another module."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]


def commands(path):
    found = COMMANDS.findall((ROOT / path).read_text(encoding="utf-8"))
    return {" ".join(command.split()) for command in found}


@pytest.mark.parametrize(
    "path",
    [
        "README.md",
        "docs/evidence.md",
        "docs/evidence/suites.md",
        "docs/findings.md",
        "docs/peers.md",
    ],
)
def test_every_command_that_shows_a_figure_is_in_the_index(path):
    shown = commands(path)
    assert shown
    assert shown <= commands("docs/evidence/index.md")


def test_every_command_in_the_documentation_names_a_case():
    named = set().union(*map(commands, PAGES))
    cases = {command.removeprefix(f"{RUNNER} ") for command in named if " " in command}
    assert len(cases) > 5
    assert cases <= set(run.CASES)
    assert [module for module in named if " " not in module and not find_spec(module)] == []


def test_every_case_is_in_the_index():
    assert {f"{RUNNER} {name}" for name in run.CASES} <= commands("docs/evidence/index.md")


def test_every_figure_of_the_readme_stands_in_the_index_as_it_does_there():
    index = (ROOT / "docs/evidence/index.md").read_text(encoding="utf-8")
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("|") and COMMANDS.search(line)]
    assert [row for row in rows if row not in index] == []
