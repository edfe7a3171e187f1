"""`Plan.export`: the formats by name, from a plan in memory."""

from dataclasses import replace

import pytest

from kinematics import MotionError
from planner.export.format import ExportSource, find_format


def test_it_writes_what_the_format_itself_writes(planned, tmp_path):
    plan = planned("bare-circle", 2)
    done = plan.export("zaber", tmp_path / "circle.csv", spacing=0.01)
    source = ExportSource(plan.program.name, plan.machine, plan.trajectory, plan.pulses)
    same = find_format("zaber")(spacing=0.01).write(source, tmp_path / "same.csv")
    assert (tmp_path / "circle.csv").read_bytes() == (tmp_path / "same.csv").read_bytes()
    assert replace(done, by_axis=()) == same
    assert len(done.by_axis) == 6
    assert max(done.by_axis) == done.error


def test_it_replaces_nothing_unasked(planned, tmp_path):
    plan, file = planned("bare-circle", 2), tmp_path / "circle.csv"
    file.write_text("mine")
    with pytest.raises(MotionError, match=r"circle.csv exists; give force=True"):
        plan.export("zaber", file)
    assert file.read_text() == "mine"
    plan.export("zaber", file, force=True)
    assert file.read_text() != "mine"


@pytest.mark.parametrize(
    ("format", "options", "told"),
    [
        ("zabre", {}, 'no format is called "zabre", nearest is "zaber"'),
        ("zaber", {"spaces": 0.01}, 'format zaber has no option "spaces"'),
        ("zaber", {"step": 2.0}, "step 2.0 s: must be from 1 ns to 1 s"),
    ],
)
def test_what_it_refuses_leaves_no_file(planned, tmp_path, format, options, told):
    with pytest.raises(MotionError, match=told):
        planned("bare-circle", 2).export(format, tmp_path / "circle.csv", **options)
    assert not list(tmp_path.iterdir())
