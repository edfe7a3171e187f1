"""The wheel holds all that the packages need, and works without the clone; the citation states its
version.
"""

import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import pulsepath
from tests.installs.test_platforms import pip

ROOT = Path(__file__).parents[2]
PACKAGES = ("kinematics", "planner", "controllers", "benchmarks", "pulsepath")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    pip("wheel", "--no-deps", "--wheel-dir", str(folder), str(ROOT))
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        file.extractall(folder / "content")
    return folder / "content"


def test_it_holds_every_file_of_the_packages(unpacked):
    held = {file.relative_to(unpacked).as_posix() for file in unpacked.rglob("*") if file.is_file()}
    tracked = subprocess.run(
        ["git", "ls-files", *PACKAGES], cwd=ROOT, capture_output=True, text=True, check=True
    )
    own = {
        name for name in tracked.stdout.splitlines() if not name.startswith("benchmarks/evidence/")
    }
    assert {name for name in held if not re.match(r"pulsepath-[\w.]+\.dist-info/", name)} == own
    assert any(name.endswith("licenses/LICENSE") for name in held)


def test_it_works_outside_the_clone(unpacked, tmp_path):
    """The same environment, but for the clone; what takes kernels would compile them anew, for half
    a minute.
    """
    done = subprocess.run(
        [sys.executable, "-P", "-m", "pulsepath", "pose", "hexapod", "5,5,35", "--json"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(unpacked)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(json.loads(done.stdout)["axes"]) == 6


def test_the_citation_states_the_version():
    stated = re.search(
        r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert stated is not None
    assert stated[1] == pulsepath.__version__
