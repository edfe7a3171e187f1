"""The page of the architecture names every folder and only files that exist."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("kinematics", "planner", "controllers", "benchmarks", "pulsepath")
PAGE = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")


def test_every_path_on_the_page_exists():
    paths = re.findall(rf"`((?:{'|'.join(PACKAGES)})(?:/[\w/]+(?:\.py)?)?)`", PAGE)
    assert len(paths) > 40
    assert [path for path in paths if not (ROOT / path).exists()] == []


def test_every_folder_of_the_five_floors_has_its_sentence():
    folders = {
        init.parent.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for init in ROOT.glob(f"{package}/*/__init__.py")
    }
    described = set(re.findall(r"^\| \*{0,2}`([\w/]+)`\*{0,2} \|", PAGE, re.MULTILINE))
    assert folders <= described
    assert set(PACKAGES) <= described
