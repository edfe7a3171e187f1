"""Every page that shows something to type: it does what it says."""

import sys

import pytest

from controllers.laws.registry import LAWS
from kinematics.machine.machine_file import KINDS
from planner.export.format import FORMATS
from planner.limits.registry import AXIS_LIMITS, MACHINE_LIMITS
from planner.pulses import RULES
from planner.sources.source import SOURCES
from tests.docs.pages import DOCS, agree, fences, run
from tests.drawing import draw_dots

PAGES = [
    *(DOCS / name for name in ("tutorial.md", "conventions.md", "help.md", "api/card.md")),
    *sorted(page for page in (DOCS / "howto").glob("*.md") if page.name != "index.md"),
]
TABLES = (KINDS, AXIS_LIMITS, MACHINE_LIMITS, FORMATS, SOURCES, LAWS, RULES)


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """An empty directory to work in, from which modules are imported; what is plugged in there is
    gone afterwards.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    modules, tables = set(sys.modules), [dict(table) for table in TABLES]
    yield tmp_path
    for table, kept in zip(TABLES, tables, strict=True):
        table.clear()
        table.update(kept)
    for name in set(sys.modules) - modules:
        if str(getattr(sys.modules[name], "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_does_what_it_says(page, scratch):
    with draw_dots():  # no page shows what a figure of a report looks like
        assert run(page) > 0


def test_a_page_that_lies_is_found(scratch):
    page = scratch / "page.md"
    for lie in (
        "```python\nprint(1)\n```\n\n```text\n2\n```\n",
        "```console\n$ pulsepath machines\nno machines\n```\n",
        "```console\n$ pulsepath plan nowhere --out x\n```\n",
        "```python\n1 / 0\n```\n",
    ):
        page.write_text(lie)
        with pytest.raises((AssertionError, ZeroDivisionError)):
            run(page)
    page.write_text("```python\nprint('a   b', 12345)\n```\n\n```text\na b 12...\n```\n")
    assert run(page) == 1


def test_blocks_are_told_apart():
    found = fences("```python\na\n```\n\n```text\nb\n```\nwords\n```toml\n# c.toml\n```\n")
    assert [(fence.language, fence.line, fence.adjacent) for fence in found] == [
        ("python", 1, True),
        ("text", 5, True),
        ("toml", 9, False),
    ]
    agree("here", "1 ... 3\n", "1   2   3\n")
