"""The names by which other folders and tests use timing, certificate, tradeoffs and interruption.

A test that imports from a folder, not from a file below it, protects what moves within the folder.
"""

import re
from importlib import import_module
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
FOLDERS = ("timing", "certificate", "tradeoffs", "interruption")

BELOW = re.compile(rf"from planner\.(?:{'|'.join(FOLDERS)})\.\w")

# Here the internal step is what is tested: against finite differences, a dense solve, a linear programme, an exact sum.
INTERNALS = {
    "planner/timing/solvers",
    "planner/test_cross_check.py",
    "planner/timing/test_constant_speed_runs.py",
    "planner/timing/test_small_blends.py",
    "planner/timing/test_stated_duration.py",
    "planner/timing/test_duration_bound.py",
    "planner/timing/test_long_durations.py",
    "planner/certificate/test_ranges.py",
    "planner/interruption/test_seams.py",
    "planner/limits/test_resonance.py",
    "pulsepath/commands/test_plan_bound.py",
    "pulsepath/commands/test_plan_cross_check.py",
}


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_name_of_a_folder_is_there(folder):
    package = import_module(f"planner.{folder}")
    assert package.__all__
    assert all(not hasattr(getattr(package, name), "__path__") for name in package.__all__)


def test_only_tests_of_an_algorithm_s_steps_reach_below_a_folder():
    reaching = {
        path.relative_to(TESTS).as_posix()
        for path in TESTS.rglob("test_*.py")
        if BELOW.search(path.read_text(encoding="utf-8"))
    }
    assert {file for file in reaching if not any(file.startswith(known) for known in INTERNALS)} == set()
