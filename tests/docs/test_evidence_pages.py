"""The pages of evidence and of peers: made by their commands, and complete."""

import re
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.evidence.peers.page import COMMAND, MEASURED_FILE, cells, page, read_answers

ROOT = Path(__file__).parents[2]
COMMANDS = re.compile(r"python\s-m\s(benchmarks[\w.]*)")


def commands(path):
    return set(COMMANDS.findall((ROOT / path).read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", ["README.md", "docs/evidence.md", "docs/findings.md", "docs/peers.md"])
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


def test_what_the_page_says_of_peers_is_what_was_measured():
    """Its words between the tables, each with room for the next run on another machine."""
    found = {(a.case, a.order, a.method, a.intervals): a for a in read_answers(MEASURED_FILE)}
    circle, spline, line = "hexapod, circle", "spline, 50 waypoints", "straight, one axis"

    def ratio(one, other):
        return found[one].again / found[other].again

    ours = (circle, 3, "ours, certified", None)
    even, graded = "copp-py TOPP3-SOCP, even grid", "copp-py TOPP3-SOCP, graded grid, 1 at rest"
    reference = (circle, 3, "IPOPT (reference)", 2000)
    assert 20 < ratio(reference, ours) < 60  # "some 35 times the time"
    assert found[reference].feasible < found[ours].feasible < found[reference].feasible * 1.0005  # "0.03 % shorter"
    assert 0.2 < ratio((circle, 3, even, 100), ours) < 0.7  # "a third of our time"
    for grid in (even, graded):
        assert 1.005 < found[circle, 3, grid, 100].feasible / found[ours].feasible < 1.025  # "1 to 2 % longer"
    assert ratio((line, 3, "ruckig", None), (line, 3, "ours, certified", None)) < 1 / 8  # "a sixteenth"
    assert ratio((spline, 2, "copp-py TOPP2-RA", 1000), (spline, 2, "ours, uncertified", 1000)) < 0.75  # "about half"
    most = [a.feasible / a.duration for a in found.values() if "certified" in a.method and "un" not in a.method]
    assert max(most) < 1 + 1e-6  # "no certified motion has to be slowed"
