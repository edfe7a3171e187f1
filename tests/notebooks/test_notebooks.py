"""The notebooks run, quickly and silently, and their prose states no number that their cells do
not.
"""

import re

import pytest
from jupyter_client.manager import AsyncKernelManager
from jupyter_core.utils import run_sync
from nbclient.exceptions import CellExecutionError

from tests.notebooks.run import NOTEBOOKS, ROOT, executed
from tests.pace import slowness

MOST = 30.0
"""s of CPU that a notebook may take on the machine that the bounds were written on: half of the
minute it may last.
"""
CPU = "from time import process_time\n\nprint(process_time())"
FRESH = "%reset -f\n" + CPU
"""Forgets all names of the notebook before."""
CODE = re.compile(r"`[^`]*`|\$\$.*?\$\$|\$[^$]*\$|\]\([^)]*\)|\[[^\]]*\d{4}[^\]]*\]", re.DOTALL)
"""In prose, what is code, maths, a link's address or a source."""
NUMBER = re.compile(r"\d+(?:\.\d+)?")


@pytest.fixture(scope="module")
def kernel():
    """One for all notebooks, which have no name from each other: to start one, and to load the
    library in it, takes as long as a notebook.
    """
    manager = AsyncKernelManager(kernel_name="python3")
    yield manager
    if manager.has_kernel:
        run_sync(manager.shutdown_kernel)(now=True)


@pytest.fixture(scope="module")
def slower():
    return slowness()


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_it_runs_and_is_as_it_should_be(path, kernel, slower):
    """One test for each, since running it takes the time."""
    try:
        notebook = executed(path, slower=slower, first=FRESH, last=CPU, kernel=kernel)
    except CellExecutionError as failed:
        if (
            failed.ename == "NotInstalled"
        ):  # raised in the kernel, so tests/conftest.py cannot see it
            pytest.skip(failed.evalue)
        raise
    begun = float(notebook.cells.pop(0).outputs[0].text)
    runs_quickly_without_warnings(notebook, begun)
    asks_answers_and_goes_on(notebook)
    states_only_numbers_of_its_cells(notebook)
    leads_somewhere(notebook)


def texts(cells):
    """What cells show: what they print, and the text of their values."""
    for cell in cells:
        for output in cell.get("outputs", ()):
            yield output.get("text") or output.get("data", {}).get("text/plain", "")


def test_there_are_six_and_a_list_of_them():
    assert [path.stem[0] for path in NOTEBOOKS] == list("123456")
    listed = (ROOT / "notebooks" / "README.md").read_text(encoding="utf-8")
    assert [path.name for path in NOTEBOOKS] == re.findall(r"\]\((\w+\.py)\)", listed)


def runs_quickly_without_warnings(notebook, begun):
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    assert not [output for output in outputs if output.output_type == "error"]
    assert not [output.text for output in outputs if output.get("name") == "stderr"]
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 2
    took = float(notebook.cells[-1].outputs[0].text) - begun
    assert took <= MOST or took <= MOST * slowness()


def asks_answers_and_goes_on(notebook):
    prose = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert re.match(r"# .+\n\n\*\*[^*]+\?\*\*", prose[0])
    assert "## The answer" in prose[-2]
    assert prose[-1].startswith("**What to try next.**")
    *_, answer, _ = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert re.search(r"\d", next(texts([answer])))


def states_only_numbers_of_its_cells(notebook):
    """From 10 on, and broken ones; they stand in the code, or come out of it."""
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    told = {*NUMBER.findall("\n".join([*(cell.source for cell in code), *texts(code)]))}
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            stated = NUMBER.findall(CODE.sub(" ", cell.source))
            assert not [
                number
                for number in stated
                if ("." in number or int(number) >= 10) and number not in told
            ]


def leads_somewhere(notebook):
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            for target in re.findall(r"\]\(([^)]+)\)", cell.source):
                assert (ROOT / "notebooks" / target).is_file(), target
