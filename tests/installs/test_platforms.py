"""What the package needs installs from wheels alone on every platform: pip is asked, for each of
them.

pip evaluates the markers of requirements for the machine it runs on, whatever `--platform` says, so
those of pyproject.toml are evaluated here; those of the packages' own requirements are not.
"""

import json
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.pace import LONG

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PLATFORMS = {
    "linux": (
        "Linux",
        "x86_64",
        [f"manylinux_2_{minor}_x86_64" for minor in (5, 12, 17, 24, 27, 28, 31, 34, 35)],
    ),
    "macos": ("Darwin", "arm64", [f"macosx_{major}_0_arm64" for major in range(11, 15)]),
    "windows": ("Windows", "AMD64", ["win_amd64"]),
}
"""What `platform_system` and `platform_machine` say there, and the tags of its wheels, of Linux
those in use.
"""
ABSENT = {"linux": set[str](), "macos": {"toppra"}, "windows": {"toppra", "pin"}}
"""What has no wheel there."""
UNREACHED = ("NewConnectionError", "ConnectTimeout", "ReadTimeout", "ProxyError")
"""What pip says where there is no network."""


def wanted(group: list[str], platform: str, python: str) -> list[str]:
    """The requirements of a group that hold on a platform, without their markers."""
    system, machine, _ = PLATFORMS[platform]
    there = {
        "platform_system": system,
        "platform_machine": machine,
        "python_version": python,
        "python_full_version": f"{python}.0",
    }
    chosen = [Requirement(line) for line in group]
    held = [one for one in chosen if one.marker is None or one.marker.evaluate(there)]
    for one in held:
        one.marker = None
    return [str(one) for one in held]


def pip(*arguments: str) -> None:
    """Run pip; where it reaches no index, the test is skipped."""
    ran = subprocess.run([sys.executable, "-m", "pip", *arguments], capture_output=True, text=True)
    told = ran.stdout + ran.stderr
    if ran.returncode and any(sign in told for sign in UNREACHED):
        pytest.skip("no package index can be reached")
    assert ran.returncode == 0, told[-3000:]


# on Linux the oldest Python's are what the tests themselves were installed from
OTHERS = [
    ("windows", "3.11"),
    ("linux", "3.13"),
    ("macos", "3.11"),
    ("macos", "3.13"),
    ("windows", "3.13"),
]


@pytest.mark.parametrize(("platform", "python"), OTHERS if LONG else OTHERS[:1])
def test_the_core_has_wheels(platform: str, python: str, tmp_path: Path) -> None:
    """With all that it needs in turn; nothing is built, and of the wheels no more is fetched than
    what they need.
    """
    tags = [f"--platform={tag}" for tag in PLATFORMS[platform][2]]
    needs, report = wanted(PROJECT["dependencies"], platform, python), tmp_path / "report.json"
    where = [f"--python-version={python}", *tags, f"--target={tmp_path}", f"--report={report}"]
    pip("install", "--dry-run", "--ignore-installed", "--only-binary=:all:", *where, *needs)
    found = {
        one["metadata"]["name"].lower(): one for one in json.loads(report.read_bytes())["install"]
    }
    assert {Path(one["download_info"]["url"]).suffix for one in found.values()} == {".whl"}
    assert {"casadi", "numpy", "scipy", "osqp", "viser"} <= found.keys()
    assert {"pin", "toppra"} - found.keys() == ABSENT[platform]


@pytest.mark.parametrize("platform", PLATFORMS)
def test_markers_leave_out_only_what_has_no_wheel(platform: str) -> None:
    """The core names the same packages everywhere, but for those."""
    names = [
        {Requirement(line).name for line in wanted(PROJECT["dependencies"], p, "3.12")}
        for p in (platform, "linux")
    ]
    assert names[1] - names[0] == ABSENT[platform]
    assert names[0] <= names[1]


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_the_demo_installs_what_a_user_needs() -> None:
    """The extra dev, a third more to download, comes with the tests."""
    installed = {}
    for target in ("demo", "test"):
        command = ["make", "--dry-run", "--always-make", target]
        shown = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        installed[target] = [
            line.split()[-1] for line in shown.splitlines() if " pip install " in line
        ]
    assert installed == {"demo": ["."], "test": [".", "'.[dev]'"]}


def test_the_dev_extra_has_the_others() -> None:
    """What the tests need is said once, by name of the extra."""
    (others,) = (
        Requirement(line)
        for line in PROJECT["optional-dependencies"]["dev"]
        if line.startswith("pulsepath")
    )
    assert others.extras <= set(PROJECT["optional-dependencies"])
