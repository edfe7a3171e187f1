"""Workpieces as the benchmark makes and plans them, small ones."""

import pytest

from benchmarks.evidence.speed.workpieces import WORKPIECES, plan_workpiece, write_workpiece
from planner.sources.source import import_program


@pytest.mark.parametrize("name", WORKPIECES)
def test_every_workpiece_is_read(name, tmp_path):
    program = import_program(write_workpiece(name, 60, tmp_path / "part.nc")).program
    assert 50 <= len(program.segments) <= 80


def test_a_part_is_planned_as_fast_in_windows_as_at_once():
    found = plan_workpiece("slots", 60, 2, "hexapod", whole=True)
    assert found.worst <= 1
    assert found.duration == pytest.approx(found.whole, rel=1e-3)
    assert 0 < found.processor < 60
    assert 1e8 < found.memory < 6e8
    assert 1e4 < found.files < 1e7
