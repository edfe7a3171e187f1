"""The names by which other folders and tests use timing, certificate, bounds and interruption.

A test that imports these names from a folder, not from a file below it, protects what moves within
the folder.
"""

import ast
from importlib import import_module
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
FOLDERS = {f"planner.{name}" for name in ("timing", "certificate", "bounds", "interruption")}

# Tests that reach below a folder, because a step of an algorithm is what they test.
INTERNALS = {
    # steps of the interior point and of the passes: against finite differences, dense solves and
    # linear programmes
    "planner/timing/order3/test_interior_point.py",
    "planner/timing/order2/test_passes.py",
    "planner/timing/order3/test_pose.py",
    "planner/timing/order3/test_solve.py",
    "planner/certificate/test_limit_use.py",
    "planner/bounds/test_duration_bound.py",
    "planner/timing/test_stated_duration.py",
    # kernels, whose descriptions name the folders of compiled code
    "kinematics/foundation/test_kernel_description.py",
    # attempts in their order: each is reached only where the one before it is made to fail
    "planner/baselines/test_classical.py",
    "planner/test_cross_check.py",
    "planner/timing/test_slowed_runs.py",
    "planner/timing/test_end_speeds.py",
    "planner/timing/test_small_blends.py",
    "planner/interruption/test_hold.py",
    "planner/interruption/test_seams.py",
    "planner/interruption/test_shaped_hold.py",
    # averages and enclosures to the last bit
    "planner/timing/test_long_durations.py",
    "planner/timing/test_sampling.py",
    "planner/certificate/test_ranges.py",
    "planner/limits/test_tool_jerk.py",
    "planner/limits/test_resonance.py",
    # how much work a bound may be, and what an adapter says
    "pulsepath/commands/test_plan_bound.py",
    "pulsepath/commands/test_plan_cross_check.py",
    "pulsepath/test_quantity_sizes.py",
    "pulsepath/test_results.py",
}


def find_private(path):
    """Imports of a test from one of the folders that are none of its names."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            folder = ".".join(node.module.split(".")[:2])
            if folder in FOLDERS:
                public = import_module(folder).__all__ if node.module == folder else []
                yield from (alias.name for alias in node.names if alias.name not in public)


@pytest.mark.parametrize("folder", sorted(FOLDERS))
def test_every_name_of_a_folder_is_there(folder):
    package = import_module(folder)
    assert package.__all__
    for name in package.__all__:
        assert not hasattr(getattr(package, name), "__spec__"), f"{name} is a file"


def test_only_tests_of_an_algorithm_s_steps_reach_below_a_folder():
    reaching = {
        path.relative_to(TESTS).as_posix()
        for path in TESTS.rglob("test_*.py")
        if any(find_private(path))
    }
    assert reaching - INTERNALS == set()
