"""Every module of the folder that is run as `python -m benchmarks.NAME` prints something; the others serve these."""

from importlib import import_module
from pathlib import Path
from re import findall

import pytest

import benchmarks

FOLDER = Path(benchmarks.__file__).parent
SERVE = {"__init__", "calibration_report", "compared", "markdown_page", "page", "published_lines", "report"}
"""Reports and tables that commands write; they have nothing of their own to print."""
QUICK = ("conformance", "initial_design", "raster", "sahbaz_geometry", "sasidhar_deflection", "sasidhar_sizing")


def test_every_module_that_is_not_there_for_others_can_be_run():
    runs = {file.stem for file in FOLDER.glob("*.py") if 'if __name__ == "__main__":' in file.read_text("utf-8")}
    assert {file.stem for file in FOLDER.glob("*.py")} - runs == SERVE


def test_every_command_that_the_documentation_names_is_there():
    docs = FOLDER.parent / "docs"
    files = [FOLDER.parent / "README.md", *docs.rglob("*.md"), *FOLDER.rglob("*.py")]
    named = {name for file in files for name in findall(r"python -m benchmarks\.(\w+)", file.read_text("utf-8"))}
    assert len(named) > 20
    for name in named:
        assert (FOLDER / f"{name}.py").is_file() or (FOLDER / name / "__main__.py").is_file(), name
        assert name not in SERVE


@pytest.mark.parametrize("name", QUICK)
def test_it_prints_what_it_found(name, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", [name])
    import_module(f"benchmarks.{name}").main()
    said = capsys.readouterr().out
    assert len(said.splitlines()) > 5
    assert any(sign.isdigit() for sign in said)


def test_the_initial_design_is_told_beside_print(capsys):
    import_module("benchmarks.initial_design").main()
    said = capsys.readouterr().out
    assert "47.58" in said
    assert "54.563" in said
    assert "do not follow" in said
