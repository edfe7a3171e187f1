"""The pages of evidence: complete."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMMANDS = re.compile(r"python\s-m\s(benchmarks[\w.]*)")


def commands(path):
    return set(COMMANDS.findall((ROOT / path).read_text(encoding="utf-8")))


@pytest.mark.parametrize(
    "path", ["README.md", "docs/evidence.md", "docs/evidence/suites.md", "docs/findings.md", "docs/peers.md"]
)
def test_every_command_that_shows_a_figure_is_in_the_index(path):
    named = commands(path) - {"benchmarks.evidence.peers.page"}  # makes a page of what is measured
    assert named <= commands("docs/evidence/index.md")


def test_every_command_of_the_index_is_there():
    assert all(find_spec(name) for name in commands("docs/evidence/index.md"))


def test_every_figure_of_the_readme_stands_in_the_index_as_it_does_there():
    index = (ROOT / "docs/evidence/index.md").read_text(encoding="utf-8")
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("|") and COMMANDS.search(line)]
    assert [row for row in rows if row not in index] == []
