"""The pages of evidence and of peers: made by their commands, and complete."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.evidence import run
from benchmarks.evidence.peers.page import COMMAND, MEASURED_FILE, PeerFigures, cells, page, put_rows, read_answers

ROOT = Path(__file__).parents[2]
RUNNER = "benchmarks.evidence"
COMMANDS = re.compile(rf"python\s-m\s({RUNNER}\s[a-z]\w*|benchmarks[\w.]*)")
"""The runner and the name of a case, or another module."""
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]


def commands(path):
    found = COMMANDS.findall((ROOT / path).read_text(encoding="utf-8"))
    return {" ".join(command.split()) for command in found}


@pytest.mark.parametrize(
    "path", ["README.md", "docs/evidence.md", "docs/evidence/suites.md", "docs/findings.md", "docs/peers.md"]
)
def test_every_command_that_shows_a_figure_is_in_the_index(path):
    # one command makes a page of what another measured
    shown = commands(path) - {"benchmarks.evidence.peers.page"}
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


def test_the_page_of_peers_is_what_its_command_makes():
    assert (ROOT / "docs/peers.md").read_text(encoding="utf-8") == page(), f"stale: {COMMAND} --out docs/peers.md"


def test_what_is_read_of_the_measurements_is_what_was_written():
    lines = MEASURED_FILE.read_text(encoding="utf-8").splitlines()
    again = [
        ",".join(f'"{cell}"' if "," in cell else cell for cell in cells(answer))
        for answer in read_answers(MEASURED_FILE)
    ]
    # the last number is worked out of those before it, which are rounded
    assert [line.split(",")[:-2] for line in again] == [line.split(",")[:-2] for line in lines[1:]]


def test_rows_that_tell_of_peers_are_those_measured():
    figures = PeerFigures(read_answers(MEASURED_FILE))
    for path, rows in (("README.md", figures.readme_rows()), ("docs/evidence/index.md", [figures.index_row()])):
        text = (ROOT / path).read_text(encoding="utf-8")
        assert put_rows(text, rows) == text, f"stale: {COMMAND} --out docs/peers.md"
    with pytest.raises(ValueError, match="unpack"):
        put_rows(text, ["| no such row | 1 |"])


def test_what_the_page_says_of_peers_holds():
    """Its words; its figures are worked out of the measurements."""
    figures = PeerFigures(read_answers(MEASURED_FILE))
    assert figures.reference_ratio > 1  # "times the time"
    assert 0 < figures.reference_gain < 0.05  # "shorter", and order3.md: 0.03 %
    assert figures.straight_ratio > 1  # "times faster"
    assert not figures.coarse or figures.coarse_loss[0] > 0.5  # "longer when they hold"
    assert figures.lead < 1  # "where ours is ahead"
    assert 0 < figures.finer_gain[0] <= figures.finer_gain[1] < 0.1
    assert figures.grid_loss[0] > 1
    most = [a.feasible / a.duration for a in figures.found if "certified" in a.method and "un" not in a.method]
    assert max(most) < 1 + 1e-6  # "no certified motion has to be slowed"
