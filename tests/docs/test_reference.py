"""The reference pages: tables of keys that a code host shows too, and examples that can be
copied.
"""

import re
import shlex

import click
import pytest

from pulsepath.cli import main
from tests.docs.pages import DOCS

PAGE = DOCS / "reference" / "files.md"


@pytest.fixture
def extensions(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))


def commands(group, path="pulsepath"):
    for name, command in group.commands.items():
        yield f"{path} {name}", command
        if isinstance(command, click.Group):
            yield from commands(command, f"{path} {name}")


def test_the_tables_of_keys_are_those_of_the_schemas(extensions):
    """After a change of a schema: python docs/_ext/file_keys.py."""
    from file_keys import fill

    text = PAGE.read_text(encoding="utf-8")
    assert fill(text) == text


def test_the_page_shows_keys_without_being_built():
    text = PAGE.read_text(encoding="utf-8")
    shown = set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))
    assert {
        "max_acceleration",
        "lead",
        "gear",
        "through",
        "commanded",
        "urdf",
        "trigger",
    } - shown == set()
    assert "{file-keys}" not in text
    assert not re.search(
        r"<!-- (?:file-keys [^\n]*|kind-keys|drive-times) -->\s*<!-- end -->", text
    )
    assert text.count("<!-- end -->") >= 30


def test_examples_of_commands_are_code_that_can_be_copied(extensions):
    """Prose would get typographic dashes and quotes, which no shell takes."""
    from command_line import markdown

    told = 0
    for path, command in commands(main):
        text = markdown(command, path)
        for example in re.findall(r"^Example:\n\n```text\n(.*)\n```$", text, re.MULTILINE):
            words = shlex.split(example)
            assert " ".join(words[: len(path.split())]) == path or words[0] == "pulsepath"
            assert example.isascii()
            told += 1
        assert not re.search(r"^Example: ", text, re.MULTILINE), path
    assert told > 15
