"""Every module of the folder that is run as `python -m benchmarks.evidence.NAME` prints; the others serve these."""

from importlib import import_module
from pathlib import Path
from re import findall

import pytest

from benchmarks import evidence

FOLDER = Path(evidence.__file__).parent
SERVE = {"timing", "published.compared", "thesis.outcome"}
"""What scripts share, and tables that pages show."""
PACKAGES = {"peers"}
"""Run as a whole."""
QUICK = ("published.sizing",)


def commands():
    """Every module of the folder by its dotted name, and its text."""
    for file in FOLDER.rglob("*.py"):
        if file.stem != "__init__" and file.parent.name not in PACKAGES:
            yield ".".join(file.relative_to(FOLDER).with_suffix("").parts), file.read_text("utf-8")


def test_every_module_that_is_not_there_for_others_can_be_run():
    assert {name for name, text in commands() if 'if __name__ == "__main__":' not in text} == SERVE


def test_every_command_that_the_documentation_names_is_there():
    root = FOLDER.parents[1]
    files = [root / "README.md", *(root / "docs").rglob("*.md"), *FOLDER.rglob("*.py")]
    named = {name for file in files for name in findall(r"python -m (benchmarks\.[\w.]*\w)", file.read_text("utf-8"))}
    assert len(named) > 20
    for name in named:
        file = root.joinpath(*name.split("."))
        assert file.with_suffix(".py").is_file() or (file / "__main__.py").is_file(), name
        assert name.removeprefix("benchmarks.evidence.") not in SERVE


@pytest.mark.parametrize("name", QUICK)
def test_it_prints_what_it_found(name, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", [name])
    import_module(f"benchmarks.evidence.{name}").main()
    said = capsys.readouterr().out
    assert len(said.splitlines()) > 5
    assert any(sign.isdigit() for sign in said)


def test_the_initial_design_is_told_beside_print(capsys):
    import_module("benchmarks.evidence.published.sizing").main()
    said = capsys.readouterr().out
    assert "47.58" in said
    assert "54.563" in said
    assert "do not follow" in said
