"""The cases of the gallery: programs fit their machines, pictures are there, and one is planned and
drawn.
"""

import re
import shlex

import pytest
from click.testing import CliRunner

from pulsepath.cli import main
from tests.docs.pages import DOCS

PAGE = (DOCS / "gallery.md").read_text(encoding="utf-8")
PLANS = re.findall(r"^pulsepath plan (.+) --out (\S+)$", PAGE, re.MULTILINE)


def call(*arguments):
    return CliRunner().invoke(main, arguments, catch_exceptions=False)


def test_each_has_its_picture():
    names = [name for _, name in PLANS]
    assert len(set(names)) == len(names) >= 12
    pictures = re.findall(r"\(images/gallery/(\S+)\.png\)", PAGE)
    assert pictures == names
    assert {file.stem for file in (DOCS / "images/gallery").iterdir()} == set(names)


@pytest.mark.parametrize("arguments", [arguments for arguments, _ in PLANS])
def test_its_program_fits_its_machine(arguments, monkeypatch):
    monkeypatch.chdir(DOCS / "examples")
    done = call("check", *shlex.split(arguments))
    assert done.exit_code == 0, done.stderr


def test_its_commands_write_its_picture(monkeypatch, tmp_path):
    monkeypatch.chdir(DOCS / "examples")
    plan, picture = tmp_path / "plan", tmp_path / "plan.png"
    assert call("plan", "delta-pick.toml", "--out", str(plan), "--no-figures").exit_code == 0
    assert call("view", str(plan), "--stills", str(picture)).exit_code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
